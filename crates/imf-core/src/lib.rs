//! Core.
pub mod grid;
pub mod mesh;
pub mod parts;
pub mod samples;
pub mod siren;
pub mod training;
