//! What a training takes beside its samples. All that is said about it, and all that is refused, is computed here:
//!
//! - for every parameter, on the CPU: the engine ([`CpuTrainer::BYTES_PER_PARAMETER`]: weights, weights transposed, gradient,
//!   two moments), and beside it [`HOST_BYTES_PER_PARAMETER`],
//!   and between ranks the exchanged slices ([`Rank::bytes_per_parameter`]);
//! - for every sample of a window of 1024: activations and slopes of all layers ([`CpuTrainer::memory_bytes`]);
//! - for every sample of a batch: its inputs and its target;
//! - for every sample of the dataset in memory: [`Samples::BYTES_PER_SAMPLE`](imf_core::samples::Samples).
//!
//! [`CpuTrainer::BYTES_PER_PARAMETER`]: imf_core::siren::engine::CpuTrainer::BYTES_PER_PARAMETER
//! [`Rank::bytes_per_parameter`]: crate::ranks::Rank::bytes_per_parameter
//! [`CpuTrainer::memory_bytes`]: imf_core::siren::engine::CpuTrainer::memory_bytes

use std::fmt;

use anyhow::Result;
use imf_core::model::Model;
use imf_core::section::SectionPlan;
use imf_core::siren::{INPUTS, SirenShape};

use crate::engine::Device;
use crate::session::{Session, show_bytes};

/// Bytes of this machine's memory for each parameter, beside the engine's: the state that was saved last (weights and two
/// moments), the same as it is written to a checkpoint (twice: as tensors, and as a file), and the weights of the evaluator
/// at held-out poses (as rows, and transposed).
pub(crate) const HOST_BYTES_PER_PARAMETER: u64 = 4 * (3 + 2 * 3 + 2);
/// The program, its libraries, the stacks of its threads.
const PROGRAM_BYTES: u64 = 24 << 20;

/// Memory of a training without its samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    shape: SirenShape,
    batch: usize,
    /// Bytes for each parameter that this machine takes beside the engine.
    beside_engine: u64,
    /// Engine, checkpoints, batches.
    training: u64,
    /// Sections of the held-out poses, which are gone when the engine comes.
    held_out: u64,
    /// The scene's voxels.
    scene: u64,
}

impl Footprint {
    /// Of training `model` in batches of `batch`, with or without poses held out.
    pub(super) fn new(
        session: &Session,
        device: &Device,
        model: &Model,
        batch: usize,
        held_out: bool,
    ) -> Result<Self> {
        let rank = session.rank();
        let beside_engine = HOST_BYTES_PER_PARAMETER + rank.bytes_per_parameter();
        let scene = &model.scene.record;
        let sections = SectionPlan::memory_estimate(&scene.grid, &scene.tool, session.threads());
        Ok(Self {
            shape: model.shape,
            batch,
            training: device.training_memory(
                model.shape,
                rank.most_rows(batch),
                model.record.plan.precision,
            )? + beside_engine * model.shape.parameter_count() as u64
                + 4 * (INPUTS as u64 + 1) * batch as u64,
            beside_engine,
            held_out: if held_out { sections } else { 0 },
            // One byte a voxel in the dataset's scene and in the model's, and another where checkpoints pack it.
            scene: 3 * scene.grid.len() as u64,
        })
    }

    /// All of it.
    pub(super) fn bytes(&self) -> u64 {
        PROGRAM_BYTES + self.scene + self.training.max(self.held_out)
    }
}

impl fmt::Display for Footprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parameters = self.shape.parameter_count() as u64;
        write!(
            f,
            "training {} layers of {} in batches of {} takes {} beside its samples ({parameters} parameters at {} bytes \
             each, activations of a window, the batch, the scene)",
            self.shape.hidden,
            self.shape.width,
            self.batch,
            show_bytes(self.bytes()),
            self.beside_engine + imf_core::siren::engine::CpuTrainer::BYTES_PER_PARAMETER,
        )
    }
}
