//! The C interface: fields that evaluate poses, for planners that are not written in Rust.
//!
//! It owns the boundary between C and [`imf_core::field`], and computes nothing itself: values, gradients, decisions
//! and proofs are those of the Rust calls, bit for bit. Fields come from files; toolpaths are checked in Rust ([`imf_core::check`](mod@imf_core::check)) or
//! by the command, while [`imf_check_motion`] proves single motions, which takes no tolerance. Without a file, obstacles come from meshes
//! ([`imf_world_create`]) and a checker decides ([`imf_checker_create`]). Conventions of the boundary:
//!
//! - every function that can fail returns an [`ImfStatus`]; [`imf_last_error`] has the message of this thread's last failure;
//! - results go to memory of the caller; fields, worlds and checkers are what is opened or created, and closed;
//! - no panic crosses the interface: it becomes a status;
//! - null and misaligned pointers, and counts that no memory could hold, are refused; what else a pointer guarantees cannot be
//!   checked.
//!
//! `include/imf.h` is generated from these sources; a test keeps it the same. `examples/poses.c` is compiled and run by the tests.
//! Build with `cargo build --release -p imf-c`, and link `target/release/libimf_c.so` (`.dylib`, `.dll`), or `libimf_c.a` with the
//! system's libraries (`-lpthread -ldl -lm` on Linux).
//!
//! `imf.pc` names both to pkg-config from the sources' tree: `PKG_CONFIG_PATH=crates/imf-c pkg-config --cflags --libs imf`.
//!
//! The same calls, from Rust:
//! ```
//! use std::ptr::null_mut;
//!
//! use imf_c::{ImfStatus, imf_last_error, imf_open_verified};
//!
//! let mut field = null_mut();
//! // SAFETY: a text that ends with 0, and a place for the field.
//! let status = unsafe { imf_open_verified(c"no/such/file.safetensors".as_ptr(), &mut field) };
//! assert_eq!(status, ImfStatus::File);
//! // SAFETY: read before the next call.
//! let why = unsafe { std::ffi::CStr::from_ptr(imf_last_error()) };
//! assert!(why.to_string_lossy().contains("no/such/file.safetensors"));
//! ```

#![allow(unsafe_code, reason = "C hands over raw pointers, and its names must not be mangled")]

mod boundary;
mod field;
mod query;
mod values;
mod world;

pub use boundary::{ImfStatus, imf_last_error, imf_version};
pub use field::{
    ImfField, ImfInfo, imf_close, imf_info, imf_open_exact, imf_open_model, imf_open_verified,
    imf_open_verified_from_memory, imf_open_verified_with_clearance,
};
pub use query::{imf_best, imf_check_motion, imf_classify, imf_gradients, imf_values};
pub use values::{
    ImfBest, ImfDecision, ImfDistance, ImfGradient, ImfMesh, ImfMotion, ImfMotionKind, ImfPose, ImfQuantity,
    ImfUnit, imf_pose_along,
};
pub use world::{
    ImfChecker, ImfWorld, imf_checker_classify, imf_checker_close, imf_checker_create, imf_checker_distance,
    imf_checker_follow, imf_checker_guarantee, imf_checker_motion, imf_checker_warning, imf_world_add_file,
    imf_world_add_mesh, imf_world_close, imf_world_create, imf_world_place, imf_world_remove,
    imf_world_warning,
};
