//! Where, and from which directions, a tool reaches a part without collision.
//!
//! A tool assembly `T` (cutter, shank, holder) moves by translations `x` and rotations `R` around an obstacle `O`, the
//! part on its fixtures:
//!
//! - `overlap(x, R) = vol[O ∩ (R T + x)] / vol(T)`: does the tool collide when its tip is *here*, and how much;
//! - `CMF(x, R) = min_k overlap(x − R k, R)` over the tool's sharp points `k`: the collision measure field, can *some*
//!   sharp point reach `x`;
//! - `IMF(x) = min_R CMF(x, R)`: the inaccessibility measure field.
//!
//! Exact values are whole numbers of voxels, computed for one rotation at a time ([`section`]) or one pose at a time ([`field`]).
//! Fields that hold every direction at once are in the crate `imf-fields`, which builds on this one.
//!
//! This crate is the reference: it owns geometry, exact counts, what a tool reaches, toolpaths, and the interface of every
//! field ([`field`]). It imports no other crate of the project.
//!
//! # Where to begin
//! | to | see |
//! | --- | --- |
//! | make a scene of part, tool and grid | [`Scene::builder`](scene::Scene::builder) |
//! | read a mesh and make voxels of it | [`mesh::read`], [`voxelize`](mod@voxelize) |
//! | describe a tool | [`tool::Tool`]: from a file, or element by element |
//! | know what a tool reaches of the part's surface | [`surface`] |
//! | know where in space the tip gets, and what stock goes | [`access`] |
//! | count sections, or their minimum over orientations | [`section::SectionPlan`], [`section::stream_sections`] |
//! | check a toolpath, and follow the stock that it cuts | [`check`](mod@check), [`toolpath`] |
//! | query single poses | [`field`]: values, gradients, decisions, of any family |
//! | move a tool among several obstacles, in a planner | [`world`]: checkers of poses and of all poses between two |
//!
//! # Features
//! - `parallel`, on by default: all threads of the current rayon pool; without it the thread that calls.
//! - `random`, on by default: random sets of orientations.
//! - `formats`, on by default: STL, PLY and 3MF meshes, tool files and tool libraries, fields for other programs, and writing files at
//!   all. Without `parallel` and `random` the crate builds for `wasm32-unknown-unknown`.
//!
//! # Conventions
//! - Lengths are in the mesh's own unit, millimetres by default; angles are degrees, pairs always (θ, φ).
//! - Right-handed world. A [`grid::Grid`] has cubic voxels; the centre of voxel `i` is `origin + pitch·(i + ½)`.
//!   Arrays are C-ordered `[x, y, z]`, `z` contiguous.
//! - Tool frame: tip at the origin, axis +z from tip to holder; `R(θ, φ) = R_z(θ) R_y(φ)`.
//! - "Exact" is exact for voxel centres. Space outside the obstacle's grid is empty.
//!
//! # Errors
//! Every library function that can fail for its input gives a small error of its own area: [`file_error::FileError`] for files that are
//! read (file, line, kind, cause and remedy) and `AtomicFileError` for those that are written, [`scene::SceneError`], [`grid::GridError`],
//! [`tool::ToolError`], [`tool::ClearanceError`], [`orientation::OrientationSetError`] and those of sections, fields and checks.
//! Warnings are values ([`scene::SceneWarning`]).
//!
//! # Example
//! Where can the built-in tool stand upright on the built-in bracket?
//! ```
//! use imf_core::field::{ExactField, GridField};
//! use imf_core::orientation::Orientation;
//! use imf_core::parts::ReferencePart;
//! use imf_core::scene::Scene;
//!
//! let scene = Scene::builder().reference(ReferencePart::Bracket).dims([12, 36, 22]).build()?.scene;
//! let field = ExactField::of_scene(&scene, &scene.record.clearance)?;
//! let mut cmf = vec![0.0; field.grid().len()];
//! field.section(&Orientation::new(0.0, 0.0), &mut cmf)?;
//! let free = cmf.iter().filter(|&&v| v == 0.0).count();
//! assert!(free > 0 && free < cmf.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Source of the method: Harabin, Mirzendehdel, Behandish, *Deep Neural Implicit Representation of Accessibility for
//! Multi-Axis Manufacturing*, arXiv 2409.02115.

/// The vectors and quaternions of this interface.
pub use glam;

pub mod access;
// For the files of the project's other crates.
#[cfg(feature = "formats")]
#[doc(hidden)]
pub mod atomic_file;
pub mod certificate;
pub mod check;
pub mod control;
pub mod distance;
pub mod field;
#[cfg(feature = "formats")]
pub mod field_files;
pub mod file_error;
pub mod grid;
pub mod machine;
pub mod mesh;
pub mod obstacle;
pub mod occupancy;
pub mod orientation;
mod parallel;
pub mod parts;
pub mod pose;
pub mod scene;
pub mod section;
pub mod set_cover;
pub mod surface;
pub mod tool;
pub mod toolpath;
pub mod unit;
// For inner loops of the project's other crates.
#[doc(hidden)]
pub mod vectorised;
pub mod voxelize;
// For the scratch memory of the project's other crates.
#[doc(hidden)]
pub mod workspaces;
pub mod world;
