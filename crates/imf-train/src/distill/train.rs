//! How a network of the point is trained to the coefficients of a harmonic field: the CPU's engine, batches of voxels, the one loop.

use std::ops::{ControlFlow, Range};

use super::output_layer::ClosedForm;
use super::voxels::Voxels;
use crate::engine::CpuTrainer;
use crate::engine::soap::Soap;
use crate::training::TrainingEngine;
use crate::training::run::{Observer, Outcome, Report, Start, TrainError, train_by};
use imf_core::control::Control;
use imf_core::field::EngineError;
use imf_fields::factored::targets::Targets;
use imf_fields::factored::{DistillSettings, FactoredShape, FactoredState};
use imf_fields::harmonic::HarmonicField;
use imf_fields::recipe::{Cursor, Loss, Optimiser, RecipeError};
use imf_fields::siren::Layer;

/// The engine of the CPU that continues from `state`, to distil `field`; it runs on the rayon pool that its steps are called in.
///
/// # Errors
/// A shape out of range, or a state that does not fit.
pub fn cpu_distiller(
    field: &HarmonicField,
    settings: &DistillSettings,
    state: &FactoredState,
) -> Result<CpuTrainer, EngineError> {
    let (stack, plan) = (settings.shape_for(field).stack(), &settings.plan);
    let (batch, state) = (settings.batch(field), state.training.clone());
    let mut engine = CpuTrainer::new(stack, plan.adam, plan.loss, batch, state)?;
    match settings.optimiser {
        Optimiser::Adam => {}
        Optimiser::Soap(config) => engine.use_soap(config)?,
    }
    Ok(engine)
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
fn steps_before(settings: &DistillSettings, voxels: usize, cursor: Cursor) -> u64 {
    cursor.epoch.saturating_mul(settings.plan.steps_per_epoch(voxels)).saturating_add(cursor.step)
}

/// Trains `engine` from `start` to the plan's end, or until the observer breaks. The engine is made for the stack of
/// [`DistillSettings::shape_for`] and batches of [`DistillSettings::batch`], with the settings' optimiser. A report's loss is a mean squared
/// error over the sphere where the plan's loss is L2.
///
/// # Errors
/// Settings or a start out of range, or a loss that is not finite or has risen for good.
pub fn train_to(
    field: &HarmonicField,
    settings: &DistillSettings,
    engine: &mut dyn TrainingEngine,
    start: Start,
    observer: &mut Observer<'_>,
) -> Result<Outcome, TrainError> {
    settings.check()?;
    let plan = &settings.plan;
    let voxels = field.grid.len();
    let targets = Targets::new(field, settings.symmetry).map_err(|error| RecipeError(error.to_string()))?;
    // A loss in units of the field: outputs are coefficients over the scale.
    let unit = match plan.loss {
        Loss::L1 | Loss::L1Small => f64::from(targets.scale),
        Loss::L2 => f64::from(targets.scale) * f64::from(targets.scale),
    };
    let mut order = Voxels::new(plan, &field.grid, settings.symmetry, start.cursor);
    let mut feed = |at: Cursor, rows: Range<usize>, inputs: &mut [f32], rows_of_targets: &mut [f32]| {
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
/// progress is one step.
///
/// # Errors
/// As [`train_to`]; `state` is untouched then.
pub fn distil(
    field: &HarmonicField,
    settings: &DistillSettings,
    state: &mut FactoredState,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    settings.check()?;
    let mut engine = cpu_distiller(field, settings, state)?;
    distil_on(field, settings, state, &mut engine, control, observer)
}

/// As [`distil`], on an engine that continues from `state`, such as a GPU's ([`train_to`]).
///
/// # Errors
/// As [`distil`].
pub fn distil_on(
    field: &HarmonicField,
    settings: &DistillSettings,
    state: &mut FactoredState,
    engine: &mut dyn TrainingEngine,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    let mut start = Start { cursor: state.cursor, watch: state.watch };
    let mut steps = steps_before(settings, field.grid.len(), start.cursor);
    let ended = train_to(field, settings, engine, start, &mut |report, _| {
        (control.progress)(report.step - steps);
        (steps, start) = (report.step, Start { cursor: report.cursor, watch: report.watch });
        observer(report);
        if control.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    *state = FactoredState { training: engine.state()?, cursor: start.cursor, watch: start.watch };
    Ok(ended)
}
