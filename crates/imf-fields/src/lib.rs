//! Fields of every direction that stand for the exact one.
//!
//! Exact values are counted for one rotation at a time (`imf-core`). Harmonics fitted to some of them hold every direction at
//! once ([`harmonic`]); networks with sine activations hold the field over all poses, continuous and differentiable, in about a
//! megabyte: [`factored`] is distilled from harmonics, [`siren`] is the paper's. [`file`](mod@file) reads any from its file.
//!
//! This crate may import `imf-core` alone. It evaluates, calibrates and exports fields, and fits harmonic ones; networks are
//! trained in `imf-train`, whose settings are here too ([`recipe`]), since a field's file says how it was made.
//!
//! # Where to begin
//! | to | see |
//! | --- | --- |
//! | query a field from a file of any family: poses, whole grids | [`field::Field`] |
//! | plan: a model to steer by, a checker that decides | [`field::Planner`] |
//! | make a field in seconds | [`harmonic::file::HarmonicFile::fit`] |
//! | know how reliable a field's decisions are | [`calibration`] |
//! | know its errors | [`evaluation`] |
//!
//! What a field returns, and in which units, is said once for all families at [`imf_core::field`].
//!
//! # Example
//! ```no_run
//! use imf_core::field::PoseField;
//! use imf_core::glam::DVec3;
//! use imf_core::pose::Pose;
//! use imf_fields::field::Planner;
//!
//! let planner = Planner::load("bracket.safetensors")?;
//! let above = Pose::along(DVec3::new(24.5, 73.5, 100.0), DVec3::Z);
//! let mut values = [0.0];
//! planner.values(&[above], &mut values)?;
//! println!("{}, {}", values[0], planner.checker.is_free(&above));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Features
//! All are on by default. Without any, a field of every family is loaded from a file, a reader or bytes and queried for values,
//! gradients, decisions, sections and minima, with at most 60 crates.
//! - `parallel`: all threads of the current rayon pool; without it the thread that calls.
//! - `fit`: making fields (harmonic fits, starting weights' teachers) and saving them.
//! - `calibration`: measuring how reliable a field's decisions are.
//! - `export`: ONNX graphs.
#![cfg_attr(not(feature = "fit"), allow(dead_code, reason = "fits and files alone use it"))]

pub mod calibration;
pub mod evaluation;
pub mod factored;
pub mod field;
pub mod file;
pub mod harmonic;
pub mod metrics;
pub mod model;
#[cfg(feature = "export")]
pub mod onnx;
mod parallel;
pub mod recipe;
pub mod siren;
mod tensor_file;
