//! The real binary, each time in a fresh folder: what the commands write, and what they refuse.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod access;
mod check;
mod decisions;
mod export;
mod fields;
mod folder;
mod harmonic;
mod info;
mod machine;
mod model;
mod page;
mod queries;
mod refusals;
mod rolls;
mod stick_out;
mod stock;
mod voxels;
