//! Choosing where networks run.

use anyhow::{Context, Result, ensure};
use imf_core::field::WholeField;
use imf_fields::factored::FactoredAnswers;
use imf_fields::harmonic::HarmonicAnswers;
use imf_fields::harmonic::coefficients::Precision as CoefficientPrecision;
use imf_fields::learnt::LearntField;
use imf_fields::recipe::TrainingPlan;
use imf_fields::recipe::{Precision, TrainingState};
use imf_fields::siren::EvaluationEngine;
use imf_fields::siren::SirenShape;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::stored::StoredField;
use imf_gpu::{DeviceChoice, Gpu, GpuEvaluator, GpuTrainer, GpuWhole};
use imf_train::engine::CpuTrainer;
use imf_train::training::TrainingEngine;

use crate::ranks::Rank;
use crate::session::Session;

/// How often a field is asked for values over its whole grid.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Calls {
    One,
    Many,
}

/// The CPU engine or an opened GPU.
pub enum Device {
    /// The engine on this machine's cores.
    Cpu,
    /// An adapter.
    Gpu(Gpu),
}

impl Device {
    /// Opens what `--device` names. `auto` takes a discrete or integrated GPU, else the CPU engine.
    pub fn open(name: &str, session: &Session) -> Result<Self> {
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

    /// Opens what `--device` names for a field that is to be evaluated. `auto` is the CPU but for networks of the paper's kind.
    pub(crate) fn for_field(name: &str, session: &Session, stored: &StoredField) -> Result<Self> {
        let asked = matches!(stored, StoredField::Siren(_)) || !name.eq_ignore_ascii_case("auto");
        Self::open(if asked { name } else { "cpu" }, session)
    }

    /// One line for people.
    pub(crate) fn describe(&self, session: &Session) -> String {
        match self {
            Self::Cpu => format!("CPU, {} threads", session.threads()),
            Self::Gpu(gpu) => gpu.describe(),
        }
    }

    /// Whether what it holds lies in this machine's memory.
    pub(crate) fn shares_memory(&self) -> bool {
        match self {
            Self::Cpu => true,
            Self::Gpu(gpu) => gpu.adapter().shares_memory(),
        }
    }

    /// Bytes of this machine's memory that a field's coefficients take once more when it is evaluated over its grid.
    pub(crate) fn copied_bytes(&self, stored: &StoredField, calls: Calls) -> u64 {
        let axes = match (stored, self) {
            (StoredField::Siren(_), _) => 0,
            // They are there already.
            (StoredField::Harmonic(_), Self::Cpu) => 0,
            (StoredField::Harmonic(file), Self::Gpu(_)) => file.field.axis_count(),
            (StoredField::Factored(_), Self::Cpu) if calls == Calls::One => 0,
            (StoredField::Factored(file), _) => file.field.coefficient_count(),
        };
        let axes = match self {
            Self::Cpu => axes,
            Self::Gpu(gpu) => axes.next_multiple_of(gpu.matrix_kernel().padding()),
        };
        if self.shares_memory() { 4 * (stored.scene().record.grid.len() * axes) as u64 } else { 0 }
    }

    /// Does some work with a field over its grid, and the name of what evaluates it. For many calls a factored field's network runs once
    /// at every voxel before.
    pub(crate) fn with_whole<T>(
        &self,
        session: &Session,
        stored: &StoredField,
        calls: Calls,
        work: impl FnOnce(&mut dyn WholeField, String) -> Result<T>,
    ) -> Result<T> {
        let name = self.describe(session);
        match (stored, self) {
            (StoredField::Siren(model), _) => {
                let mut engine = self.evaluator(model.shape, &model.state.parameters)?;
                let name = engine.describe();
                work(&mut LearntField::new(model.scene.record.grid, engine.as_mut()), name)
            }
            (StoredField::Harmonic(file), Self::Cpu) => work(&mut HarmonicAnswers(&file.field), name),
            (StoredField::Harmonic(file), Self::Gpu(gpu)) => {
                work(&mut GpuWhole::of_harmonic(gpu, &file.field)?, name)
            }
            (StoredField::Factored(file), Self::Cpu) if calls == Calls::One => {
                work(&mut FactoredAnswers(file.field.evaluator()), name)
            }
            (StoredField::Factored(file), Self::Cpu) => {
                let expanded = file.field.evaluator().expanded(CoefficientPrecision::F32, file.report);
                work(&mut HarmonicAnswers(&expanded), name)
            }
            (StoredField::Factored(file), Self::Gpu(gpu)) => {
                work(&mut GpuWhole::of_factored(gpu, &file.field)?, name)
            }
        }
    }

    /// Bytes of this machine's memory, or of the GPU's, that an engine takes, about.
    pub fn training_memory(&self, shape: SirenShape, batch: usize, precision: Precision) -> Result<u64> {
        Ok(match self {
            Self::Cpu => CpuTrainer::memory_bytes(shape, batch, precision),
            Self::Gpu(gpu) => GpuTrainer::memory_bytes(gpu, shape, batch)?,
        })
    }

    /// Refuses a precision that this device does not have, before anything is spent.
    pub fn require_precision(&self, precision: Precision) -> Result<()> {
        match self {
            Self::Cpu => Ok(CpuTrainer::check_precision(precision)?),
            Self::Gpu(gpu) => Ok(GpuTrainer::check_precision(gpu, precision)?),
        }
    }

    /// An engine for batches of up to `batch` samples, of which `rank` has its share.
    pub fn trainer(
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

    /// An engine that evaluates a network.
    pub fn evaluator(&self, shape: SirenShape, parameters: &[f32]) -> Result<Box<dyn EvaluationEngine>> {
        Ok(match self {
            Self::Cpu => Box::new(CpuEvaluator::new(shape, parameters)?),
            Self::Gpu(gpu) => Box::new(GpuEvaluator::new(gpu, shape, parameters)?),
        })
    }
}
