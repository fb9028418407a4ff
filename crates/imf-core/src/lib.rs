//! Core.
pub mod atomic_file;
pub mod control;
pub mod dataset;
pub mod field_files;
pub mod grid;
pub mod mesh;
pub mod metrics;
pub mod occupancy;
pub mod orientation;
pub mod samples;
pub mod scene;
pub mod section;
pub mod siren;
pub mod tool;
pub mod training;
pub mod unit;
pub mod voxelize;
