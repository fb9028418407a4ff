//! What a network of the point is trained to, and its training: batches of voxels, their coefficients or exact values as
//! targets, the one loop.

use std::ops::{ControlFlow, Range};

use super::output_layer::ClosedForm;
use super::sections::SectionSource;
use super::voxels::Voxels;
use crate::engine::CpuTrainer;
use crate::engine::soap::Soap;
use crate::training::TrainingEngine;
use crate::training::run::{Observer, Outcome, Report, Start, TrainError, train_by};
use imf_core::control::Control;
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::section::SectionError;
use imf_fields::factored::targets::Targets;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredShape, FactoredState};
use imf_fields::harmonic::HarmonicField;
use imf_fields::recipe::{Cursor, Loss, Optimiser, RecipeError};
use imf_fields::siren::{Layer, ShapeError};

/// What a network of the point is trained to.
#[derive(Clone, Copy)]
pub enum Target<'a> {
    /// The coefficients of a harmonic field.
    Coefficients(&'a HarmonicField),
    /// Exact sections as they come.
    Sections(&'a SectionSource<'a>),
}

impl<'a> From<&'a HarmonicField> for Target<'a> {
    fn from(field: &'a HarmonicField) -> Self {
        Self::Coefficients(field)
    }
}

impl<'a> From<&'a SectionSource<'a>> for Target<'a> {
    fn from(source: &'a SectionSource<'a>) -> Self {
        Self::Sections(source)
    }
}

impl Target<'_> {
    /// The grid whose voxels a training sees, each once an epoch.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        match self {
            Self::Coefficients(field) => &field.grid,
            Self::Sections(source) => source.grid(),
        }
    }

    /// The network that learns it.
    #[must_use]
    pub fn shape(&self, settings: &DistillSettings) -> FactoredShape {
        settings.shape(match self {
            Self::Coefficients(field) => settings.outputs(field),
            Self::Sections(source) => source.component_count(),
        })
    }

    /// Voxels of a step.
    #[must_use]
    pub fn batch(&self, settings: &DistillSettings) -> usize {
        settings.plan.batch.min(self.grid().len())
    }

    /// The field of a network's weights.
    ///
    /// # Errors
    /// Weights that do not fit.
    pub fn field(
        &self,
        settings: &DistillSettings,
        parameters: Vec<f32>,
    ) -> Result<FactoredField, ShapeError> {
        match self {
            Self::Coefficients(field) => FactoredField::new(field, self.shape(settings), parameters),
            Self::Sections(source) => source.field(self.shape(settings), parameters),
        }
    }

    /// The engine of the CPU that continues from `state`; it runs on the rayon pool that its steps are called in.
    ///
    /// # Errors
    /// A shape out of range, or a state that does not fit.
    pub fn engine(
        &self,
        settings: &DistillSettings,
        state: &FactoredState,
    ) -> Result<CpuTrainer, EngineError> {
        let (stack, plan) = (self.shape(settings).stack(), &settings.plan);
        let (batch, state) = (self.batch(settings), state.training.clone());
        let mut engine = CpuTrainer::new(stack, plan.adam, plan.loss, batch, state)?;
        match settings.optimiser {
            Optimiser::Adam => {}
            Optimiser::Soap(config) => engine.use_soap(config)?,
        }
        Ok(engine)
    }

    /// Trains `engine` from `start` to the plan's end, or until the observer breaks. The engine is made for the stack of
    /// [`Self::shape`] and batches of [`Self::batch`], with the settings' optimiser. A report's loss is a mean squared error where
    /// the plan's loss is L2: over the sphere, or at the sections of the pool before each step. While a pool of sections fills
    /// before the first step, `stop` is polled between two of them.
    ///
    /// # Errors
    /// Settings or a start out of range, a section that failed or was given up, or a loss that is not finite or has risen for
    /// good.
    pub fn train(
        &self,
        settings: &DistillSettings,
        engine: &mut dyn TrainingEngine,
        start: Start,
        stop: &dyn Fn() -> bool,
        observer: &mut Observer<'_>,
    ) -> Result<Outcome, TrainError> {
        settings.check()?;
        match self {
            Self::Coefficients(field) => train_to_coefficients(field, settings, engine, start, observer),
            Self::Sections(source) => source.train(settings, engine, start, stop, observer),
        }
    }
}

/// Bytes that an optimiser takes beside weights and moments: working memory, and its state in the engine, in the last
/// stop's copy and in its file.
#[must_use]
pub fn optimiser_bytes(optimiser: Optimiser, shape: FactoredShape) -> u64 {
    let of_matrix = |layer: Layer| {
        let working = match optimiser {
            Optimiser::Adam => 0,
            Optimiser::Soap(_) => Soap::bytes(layer.outputs, layer.inputs),
        };
        working + 2 * 4 * optimiser.state_count(layer.outputs, layer.inputs) as u64
    };
    shape.between().map(of_matrix).sum()
}

/// Steps of the plan over `voxels` voxels before a cursor.
pub(super) fn steps_before(settings: &DistillSettings, voxels: usize, cursor: Cursor) -> u64 {
    cursor.epoch.saturating_mul(settings.plan.steps_per_epoch(voxels)).saturating_add(cursor.step)
}

fn train_to_coefficients(
    field: &HarmonicField,
    settings: &DistillSettings,
    engine: &mut dyn TrainingEngine,
    start: Start,
    observer: &mut Observer<'_>,
) -> Result<Outcome, TrainError> {
    let DistillSettings { plan, online, .. } = settings;
    if online.is_some() {
        let what = "settings of a training by sections, and a harmonic field is distilled";
        return Err(RecipeError(what.into()).into());
    }
    let voxels = field.grid.len();
    let targets = Targets::new(field, settings.symmetry).map_err(|error| RecipeError(error.to_string()))?;
    // A loss in units of the field: outputs are coefficients over the scale.
    let unit = match plan.loss {
        Loss::L1 | Loss::L1Small => f64::from(targets.scale),
        Loss::L2 => f64::from(targets.scale) * f64::from(targets.scale),
    };
    let mut order = Voxels::new(plan, &field.grid, settings.symmetry, start.cursor);
    let mut feed =
        |at: Cursor, _: u64, rows: Range<usize>, inputs: &mut [f32], rows_of_targets: &mut [f32]| {
            order.fill(at, &rows, inputs, rows_of_targets, |scratch, voxel, out| {
                targets.read(voxel, scratch, out);
            });
            Ok(())
        };
    let mut output_layer = ClosedForm::new(field, &targets, settings);
    let mut settle = |done: u64, engine: &mut dyn TrainingEngine| output_layer.solve_after(done, engine);
    train_by(plan, voxels, &mut feed, &mut settle, engine, start, &mut |report, engine| {
        observer(&Report { mean_loss: report.mean_loss * unit, ..*report }, engine)
    })
}

/// Trains the network of `state` on the CPU up to the plan's end, or until `control` asks to stop, which is polled
/// wherever the observer gets a report; `state` then is where training goes on, to the same bits. One unit of
/// progress is one step; while a pool of sections fills, progress gets 0 between two of them, and `control` is polled
/// as well.
///
/// # Errors
/// As [`Target::train`]; `state` is untouched then.
pub fn distil<'a>(
    target: impl Into<Target<'a>>,
    settings: &DistillSettings,
    state: &mut FactoredState,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    let target = target.into();
    settings.check()?;
    let mut engine = target.engine(settings, state)?;
    distil_on(target, settings, state, &mut engine, control, observer)
}

/// As [`distil`], on an engine that continues from `state`, such as a GPU's ([`Target::train`]).
///
/// # Errors
/// As [`distil`].
pub fn distil_on<'a>(
    target: impl Into<Target<'a>>,
    settings: &DistillSettings,
    state: &mut FactoredState,
    engine: &mut dyn TrainingEngine,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    let target = target.into();
    let mut start = Start { cursor: state.cursor, watch: state.watch };
    let begun = start;
    let mut steps = steps_before(settings, target.grid().len(), start.cursor);
    let stop = || {
        (control.progress)(0);
        control.is_cancelled()
    };
    let trained = target.train(settings, engine, begun, &stop, &mut |report, _| {
        (control.progress)(report.step - steps);
        (steps, start) = (report.step, Start { cursor: report.cursor, watch: report.watch });
        observer(report);
        if control.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let ended = match trained {
        // No step was taken.
        Err(TrainError::Section(SectionError::Cancelled(_))) if control.is_cancelled() => {
            Outcome::Stopped(begun.cursor)
        }
        ended => ended?,
    };
    *state = FactoredState { training: engine.state()?, cursor: start.cursor, watch: start.watch };
    Ok(ended)
}
