//! The real binary, each time in a fresh folder: what the commands write, and what they refuse.

mod fields;
mod folder;
mod info;
mod model;
mod queries;
mod refusals;
mod voxels;
