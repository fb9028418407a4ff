//! Choosing where networks run.

use anyhow::{Context, Result, ensure};
use imf_core::siren::SirenShape;
use imf_core::siren::engine::{CpuEvaluator, CpuTrainer};
use imf_core::training::run::TrainingPlan;
use imf_core::training::{EvaluationEngine, Precision, TrainingEngine, TrainingState};
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

    /// Refuses a device for fields that are evaluated on the CPU alone.
    pub(crate) fn require_cpu(name: &str) -> Result<()> {
        let cpu = ["auto", "cpu"].iter().any(|cpu| name.eq_ignore_ascii_case(cpu));
        ensure!(cpu, "harmonic and factored fields are answered on the CPU: leave out --device {name}");
        Ok(())
    }

    /// Bytes of this machine's memory, or of the GPU's, that an engine takes, about.
    pub(crate) fn training_memory(
        &self,
        shape: SirenShape,
        batch: usize,
        precision: Precision,
    ) -> Result<u64> {
        Ok(match self {
            Self::Cpu => CpuTrainer::memory_bytes(shape, batch, precision),
            Self::Gpu(gpu) => GpuTrainer::memory_bytes(gpu, shape, batch)?,
        })
    }

    /// Refuses a precision that this device does not have, before anything is spent.
    pub(crate) fn require_precision(&self, precision: Precision) -> Result<()> {
        match self {
            Self::Cpu => Ok(CpuTrainer::check_precision(precision)?),
            Self::Gpu(gpu) => Ok(GpuTrainer::check_precision(gpu, precision)?),
        }
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
        self.require_precision(plan.precision)?;
        Ok(match self {
            Self::Cpu => {
                let cpu = CpuTrainer::new(shape, plan.adam, plan.loss, rank.most_rows(batch), state)?;
                rank.trainer(cpu.with_precision(plan.precision)?)
            }
            Self::Gpu(gpu) => {
                let (adam, loss, precision) = (plan.adam, plan.loss, plan.precision);
                Box::new(GpuTrainer::with_precision(gpu, shape, adam, loss, batch, &state, precision)?)
            }
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
