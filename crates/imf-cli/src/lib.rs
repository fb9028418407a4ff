//! The command `imf`: where, and from which directions, a tool reaches a part without collision.
//!
//! ```sh
//! imf access bracket --pitch 4 --orientations fibonacci:16 --out access
//! ```
//!
//! Every command, with what it prints, is in the guide (`docs/guide` in the sources). A command is a file in `commands`; its
//! arguments, in [`arguments`], become validated settings in one step; what computes is in `imf-core`, `imf-fields`, `imf-train` and
//! `imf-gpu`. A training with its checkpoints and its log is in [`job`], a field's evaluation with its pictures in [`report`].
//!
//! This library part is for the binary `imf` and for the laboratory `imf-bench` alone, whose measurements share the command's
//! sessions, trainings, reports and pictures. It is not a stable interface: programs use `imf-core`.

pub mod arguments;
pub mod commands;
pub mod engine;
pub mod exit;
pub mod interrupt;
pub mod job;
pub mod output;
pub mod picture;
pub mod progress;
pub mod ranks;
pub mod report;
pub mod session;
pub mod slices;
mod view;
