//! Fields of every direction that stand for the exact one.
//!
//! Exact values are counted for one rotation at a time (`imf-core`). Harmonics fitted to some of them hold every direction at
//! once ([`harmonic`]); networks with sine activations hold the field over all poses, continuous and differentiable, in about a
//! megabyte: [`factored`] is distilled from harmonics, [`siren`] is the paper's. [`file`](mod@file) reads any from its file.
//!
//! This crate may import `imf-core` alone. It evaluates, calibrates and exports fields, and fits harmonic ones; networks are
//! trained in `imf-train`, whose settings are here too ([`recipe`]), since a field's file tells how it was made.
//!
//! # Where to begin
//! [`field::Field`] is a field from a file of any family, which answers poses and whole grids; [`field::VerifiedField`]
//! decides by proof as well.

pub mod calibration;
pub mod evaluation;
pub mod factored;
pub mod field;
pub mod file;
#[cfg(test)]
mod fixtures;
pub mod harmonic;
pub mod metrics;
pub mod model;
pub mod onnx;
pub mod recipe;
pub mod siren;
pub mod tensor_file;
