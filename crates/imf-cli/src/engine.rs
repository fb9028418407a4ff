//! Choosing where networks run.

use anyhow::{Context, Result, ensure};
use imf_core::siren::SirenShape;
use imf_core::siren::engine::{CpuEvaluator, CpuTrainer};
use imf_core::training::run::TrainingPlan;
use imf_core::training::{EvaluationEngine, TrainingEngine, TrainingState};
use imf_gpu::{DeviceChoice, Gpu, GpuEvaluator, GpuTrainer};

use crate::ranks::Rank;
use crate::session::Session;

/// The CPU engine or an opened GPU.
pub(crate) enum Device {
    Cpu,
    Gpu(Gpu),
}

impl Device {
    /// Opens what `--device` names. `auto` takes a discrete or integrated GPU, else the CPU engine.
    pub(crate) fn open(name: &str, session: &Session) -> Result<Self> {
        let alone = session.rank().of() == 1;
        if name.eq_ignore_ascii_case("cpu") || (!alone && name.eq_ignore_ascii_case("auto")) {
            return Ok(Self::Cpu);
        }
        ensure!(alone, "--mpi trains on CPUs alone: add --device cpu");
        let choice: DeviceChoice = match name.parse() {
            Ok(choice) => choice,
            Err(never) => match never {},
        };
        match Gpu::open(&choice) {
            Ok(gpu) => {
                session.note(&format!("device: {}", gpu.describe()));
                Ok(Self::Gpu(gpu))
            }
            Err(error) if name.eq_ignore_ascii_case("auto") => {
                session.detail(&format!("no GPU: {error}"));
                Ok(Self::Cpu)
            }
            Err(error) => Err(error).with_context(|| format!("--device {name}")),
        }
    }

    /// Bytes of this machine's memory, or of the GPU's, that an engine takes, about.
    pub(crate) fn training_memory(&self, shape: SirenShape, batch: usize) -> Result<u64> {
        Ok(match self {
            Self::Cpu => CpuTrainer::memory_bytes(shape, batch),
            Self::Gpu(gpu) => GpuTrainer::memory_bytes(gpu, shape, batch)?,
        })
    }

    /// An engine for batches of up to `batch` samples, of which `rank` has its share.
    pub(crate) fn trainer(
        &self,
        rank: Rank,
        shape: SirenShape,
        plan: &TrainingPlan,
        batch: usize,
        state: TrainingState,
    ) -> Result<Box<dyn TrainingEngine>> {
        Ok(match self {
            Self::Cpu => {
                let rows = rank.most_rows(batch);
                rank.trainer(CpuTrainer::new(shape, plan.adam, plan.loss, rows, state)?)
            }
            Self::Gpu(gpu) => Box::new(GpuTrainer::new(gpu, shape, plan.adam, plan.loss, batch, &state)?),
        })
    }

    pub(crate) fn evaluator(
        &self,
        shape: SirenShape,
        parameters: &[f32],
    ) -> Result<Box<dyn EvaluationEngine>> {
        Ok(match self {
            Self::Cpu => Box::new(CpuEvaluator::new(shape, parameters)?),
            Self::Gpu(gpu) => Box::new(GpuEvaluator::new(gpu, shape, parameters)?),
        })
    }
}
