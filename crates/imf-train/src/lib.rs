//! How fields are learnt: samples and datasets, the training engine of the CPU with its optimisers, the training loop, and
//! distillation of a network from a harmonic field.
//!
//! This crate may import `imf-core` and `imf-fields`. A GPU's training engine implements [`training::TrainingEngine`] elsewhere.
//!
//! # Where to begin
//! [`training::run::train`] is the loop, [`engine::CpuTrainer`] runs its steps on the CPU, [`distill::distil`] trains the network of a
//! factored field from a harmonic one, [`dataset::generate`] makes samples of exact sections.

pub mod dataset;
pub mod distill;
pub mod engine;
#[cfg(test)]
mod fixtures;
pub mod held_out;
pub mod samples;
pub mod training;
