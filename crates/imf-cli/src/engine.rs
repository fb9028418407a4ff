//! Choosing where networks run.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use imf_core::field::{Decision, FieldError, GridField, values_on_all_threads};
use imf_core::pose::Pose;
use imf_fields::factored::{DistillSettings, FactoredState};
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::HarmonicField;
use imf_fields::recipe::{Precision, TrainingPlan, TrainingState};
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::{EvaluationEngine, SirenShape};
use imf_gpu::{DeviceChoice, Gpu, GpuEvaluator, GpuField, GpuTrainer, TrainerSettings};
use imf_train::distill::cpu_distiller;
use imf_train::engine::CpuTrainer;
use imf_train::training::TrainingEngine;
use rayon::prelude::*;

use crate::ranks::Rank;
use crate::session::Session;

/// How many evaluations over the whole grid follow.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Workload {
    /// A section, or a minimum.
    One,
    /// One after the other.
    Many,
}

/// Poses that a thread decides at a time.
const DECIDED_AT_ONCE: usize = 256;

/// A field, and where it is evaluated.
pub struct DeviceField {
    /// The field.
    pub field: Box<dyn GridField>,
    /// Display name of the device.
    pub by: String,
    on_gpu: bool,
}

impl DeviceField {
    /// Values of poses, on all threads or on the GPU.
    pub fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        match self.on_gpu {
            true => self.field.values(poses, values),
            false => values_on_all_threads(&*self.field, poses, values),
        }
    }

    /// Decisions of poses, likewise.
    pub(crate) fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        if self.on_gpu {
            return self.field.classify(poses, decisions);
        }
        let chunks = poses.par_chunks(DECIDED_AT_ONCE).zip(decisions.par_chunks_mut(DECIDED_AT_ONCE));
        chunks.try_for_each(|(poses, decisions)| self.field.classify(poses, decisions))
    }
}

/// Reads a saved field, which takes its file's size twice meanwhile.
pub(crate) fn read_field(session: &Session, path: &Path) -> Result<FieldFile> {
    let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    session.require_memory(2 * bytes, || format!("the field in {}", path.display()))?;
    Ok(FieldFile::read(path)?)
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
        let alone = session.rank().size == 1;
        if name.eq_ignore_ascii_case("cpu") || (!alone && name.eq_ignore_ascii_case("auto")) {
            return Ok(Self::Cpu);
        }
        ensure!(alone, "--mpi trains on CPUs alone: add --device cpu");
        let Ok(choice) = name.parse::<DeviceChoice>();
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
    pub(crate) fn for_field(name: &str, session: &Session, saved: &FieldFile) -> Result<Self> {
        let asked = matches!(saved, FieldFile::Siren(_)) || !name.eq_ignore_ascii_case("auto");
        Self::open(if asked { name } else { "cpu" }, session)
    }

    /// An engine that distils a field from a state.
    pub fn distiller(
        &self,
        teacher: &HarmonicField,
        settings: &DistillSettings,
        state: &FactoredState,
    ) -> Result<Box<dyn TrainingEngine>> {
        Ok(match self {
            Self::Cpu => Box::new(cpu_distiller(teacher, settings, state)?),
            Self::Gpu(gpu) => {
                let DistillSettings { plan, optimiser, .. } = *settings;
                let precision = Precision::F32;
                let learning = TrainerSettings { adam: plan.adam, loss: plan.loss, optimiser, precision };
                let (stack, batch) = (settings.shape_for(teacher).stack(), settings.batch(teacher));
                Box::new(GpuTrainer::new(gpu, stack, &learning, batch, &state.training)?)
            }
        })
    }

    /// Human-readable, one line.
    pub(crate) fn describe(&self, session: &Session) -> String {
        match self {
            Self::Cpu => format!("CPU, {} threads", session.threads()),
            Self::Gpu(gpu) => gpu.describe(),
        }
    }

    /// Bytes of this machine's memory that a field's coefficients take once more when it is evaluated over its grid.
    pub(crate) fn copied_bytes(&self, saved: &FieldFile, calls: Workload) -> u64 {
        let coefficients = saved.coefficient_count();
        let coefficients = match self {
            // A harmonic field has them in memory, and one call does not need a factored field's.
            Self::Cpu if matches!(saved, FieldFile::Harmonic(_)) || calls == Workload::One => 0,
            Self::Cpu => coefficients,
            Self::Gpu(gpu) if !gpu.adapter().shares_memory() => 0,
            Self::Gpu(gpu) => coefficients.next_multiple_of(gpu.matrix_kernel().padding()),
        };
        4 * (saved.scene().record.grid.len() * coefficients) as u64
    }

    /// A field on this device. For many calls over the whole grid a factored field's network runs once at every voxel, now on the
    /// CPU, at the first call on a GPU.
    pub fn field(&self, session: &Session, file: &FieldFile, calls: Workload) -> Result<DeviceField> {
        let by = match (file, self) {
            (FieldFile::Siren(model), Self::Cpu) => {
                CpuEvaluator::new(model.shape, &model.state.parameters)?.describe()
            }
            _ => self.describe(session),
        };
        let on_gpu = matches!(self, Self::Gpu(_));
        let field: Box<dyn GridField> = match self {
            Self::Gpu(gpu) => Box::new(GpuField::new(gpu, file.clone())?),
            Self::Cpu if calls == Workload::Many => Box::new(Field::new(file.clone())?.expanded()),
            Self::Cpu => Box::new(Field::new(file.clone())?),
        };
        Ok(DeviceField { field, by, on_gpu })
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
                let (stack, rows) = (shape.stack(), rank.most_rows(batch));
                let cpu = CpuTrainer::new(stack, plan.adam, plan.loss, rows, state)?;
                rank.trainer(cpu.with_precision(plan.precision)?)
            }
            Self::Gpu(gpu) => {
                let (adam, loss, precision) = (plan.adam, plan.loss, plan.precision);
                let settings = TrainerSettings { adam, loss, precision, ..TrainerSettings::default() };
                Box::new(GpuTrainer::new(gpu, shape.stack(), &settings, batch, &state)?)
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
