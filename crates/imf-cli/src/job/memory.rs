//! What a training takes beside its samples. All messages and refusals about memory are computed here:
//!
//! - for every parameter, on the CPU: the engine ([`CpuTrainer::BYTES_PER_PARAMETER`]: weights, weights transposed, gradient,
//!   two moments), and beside it [`BYTES_BESIDE_ENGINE`],
//!   and between ranks the exchanged slices ([`Rank::bytes_per_parameter`]);
//! - for every sample of a window of 1024: activations and slopes of all layers ([`CpuTrainer::memory_bytes`]);
//! - for every sample of a batch: its inputs and its target;
//! - for every pose held out: its inputs, its exact value and the network's, and while they are drawn the sections
//!   that they are of;
//! - for every sample of the dataset in memory: [`Samples::BYTES_PER_SAMPLE`](imf_train::samples::Samples).
//!
//! [`CpuTrainer::BYTES_PER_PARAMETER`]: imf_train::engine::CpuTrainer::BYTES_PER_PARAMETER
//! [`Rank::bytes_per_parameter`]: crate::ranks::Rank::bytes_per_parameter
//! [`CpuTrainer::memory_bytes`]: imf_train::engine::CpuTrainer::memory_bytes

use std::fmt;

use anyhow::Result;
use imf_core::scene::SceneRecord;
use imf_core::section::SectionPlan;
use imf_fields::recipe::TrainingPlan;
use imf_fields::siren::{INPUTS, SirenShape};
use imf_train::training::BYTES_BESIDE_ENGINE;

use crate::engine::Device;
use crate::session::{Session, show_bytes};

/// Bytes of a pose held out while training goes on, and while it is drawn.
const POSE_BYTES: u64 = 4 * (INPUTS as u64 + 2);
const DRAWN_POSE_BYTES: u64 = POSE_BYTES + 16;
/// The program, its libraries, the stacks of its threads.
const PROGRAM_BYTES: u64 = 24 << 20;

/// Memory of a training without its samples.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    shape: SirenShape,
    batch: usize,
    /// Bytes for each parameter that this machine takes beside the engine.
    beside_engine: u64,
    /// Engine, checkpoints, batches.
    training: u64,
    /// Poses held out, while training goes on.
    poses: u64,
    /// The same while they are drawn, with their sections, which are gone when the engine comes.
    held_out: u64,
    /// The scene's voxels.
    scene: u64,
}

impl Footprint {
    /// Of training a network on a scene in batches of `batch`, with `held_out` poses held out.
    pub fn new(
        session: &Session,
        device: &Device,
        shape: SirenShape,
        plan: &TrainingPlan,
        scene: &SceneRecord,
        batch: usize,
        held_out: usize,
    ) -> Result<Self> {
        let rank = session.rank();
        let beside_engine = BYTES_BESIDE_ENGINE + rank.bytes_per_parameter();
        let sections = SectionPlan::memory_estimate(&scene.grid, &scene.tool, session.threads());
        Ok(Self {
            shape,
            batch,
            training: device.training_memory(shape, rank.most_rows(batch), plan.precision)?
                + beside_engine * shape.parameter_count() as u64
                + 4 * (INPUTS as u64 + 1) * batch as u64,
            beside_engine,
            poses: POSE_BYTES.saturating_mul(held_out as u64),
            held_out: match held_out {
                0 => 0,
                poses => DRAWN_POSE_BYTES.saturating_mul(poses as u64).saturating_add(sections),
            },
            // One byte a voxel in the dataset's scene and in the model's, and another where checkpoints pack it.
            scene: 3 * scene.grid.len() as u64,
        })
    }

    /// All of it.
    pub(super) fn bytes(&self) -> u64 {
        (PROGRAM_BYTES + self.scene).saturating_add((self.training + self.poses).max(self.held_out))
    }

    /// What would take less.
    pub(super) fn remedy(&self) -> &'static str {
        if self.held_out > self.training + self.poses {
            "hold out fewer poses (--set held_out=0 needs no section), use fewer --threads, or a smaller --network or --batch"
        } else {
            "use a smaller --network or --batch"
        }
    }

    /// Refuses a training that would not fit.
    ///
    /// # Errors
    /// Less memory than this.
    pub fn require(&self, session: &Session) -> Result<()> {
        session.require_memory(self.bytes(), || format!("{self}; {}", self.remedy()))
    }
}

impl fmt::Display for Footprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (parameters, batch) = (self.shape.parameter_count(), self.batch);
        let SirenShape { hidden, width, .. } = self.shape;
        write!(
            f,
            "training {hidden} layers of {width} in batches of {batch} takes {} beside its samples ({parameters} parameters at {} \
             bytes each, activations of a window, the batch, the scene)",
            show_bytes(self.bytes()),
            self.beside_engine + imf_train::engine::CpuTrainer::BYTES_PER_PARAMETER,
        )?;
        if self.held_out > self.training + self.poses {
            write!(f, ", most of it for {} poses held out and their sections", self.poses / POSE_BYTES)?;
        }
        Ok(())
    }
}
