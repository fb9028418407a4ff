//! Core.
pub mod atomic_file;
pub mod field_files;
pub mod grid;
pub mod mesh;
pub mod samples;
pub mod siren;
pub mod training;
pub mod unit;
