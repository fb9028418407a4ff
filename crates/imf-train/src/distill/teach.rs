//! Teaching g: batches of voxels, their coefficients as targets, the house's training loop.

use std::ops::Range;

use super::course::{Told, Voxels};
use super::engine::cpu_engine;
use super::last_layer::Solving;
use super::start_of;
use crate::training::TrainingEngine;
use crate::training::run::{Outcome, Report, Start, TrainError, train_by};
use imf_core::control::Control;
use imf_fields::factored::targets::Targets;
use imf_fields::factored::{DistillSettings, FactoredState};
use imf_fields::harmonic::HarmonicField;
use imf_fields::recipe::{Cursor, Loss, RecipeError};

/// Teaches the network of `state` the coefficients of `teacher` up to the plan's end, or until `control` asks to stop,
/// which is looked at wherever the observer is told something; `state` then is where teaching goes on, to the same bits.
/// One unit of progress is one step. The report's loss is the mean squared error over the sphere where the loss is L2.
///
/// # Errors
/// Settings or a state out of range, or a loss that is not finite or has risen for good; `state` is untouched then.
pub fn teach(
    teacher: &HarmonicField,
    settings: &DistillSettings,
    state: &mut FactoredState,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    settings.check()?;
    let shape = settings.shape(settings.outputs(teacher));
    let mut trainer = cpu_engine(shape, &settings.plan, settings.optimiser, settings.batch(teacher), state)?;
    let (outcome, Start { cursor, watch }) =
        run(teacher, settings, start_of(state), &mut trainer, control, observer)?;
    *state = FactoredState { training: trainer.state()?, cursor, watch };
    Ok(outcome)
}

/// As [`teach`], on an engine that continues from `state`, such as a GPU's: made for the stack of
/// [`DistillSettings::shape`] and batches of [`DistillSettings::batch`], with the settings' optimiser.
///
/// # Errors
/// As [`teach`].
pub fn teach_on(
    teacher: &HarmonicField,
    settings: &DistillSettings,
    state: &mut FactoredState,
    engine: &mut dyn TrainingEngine,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<Outcome, TrainError> {
    settings.check()?;
    let (outcome, Start { cursor, watch }) =
        run(teacher, settings, start_of(state), engine, control, observer)?;
    *state = FactoredState { training: engine.state()?, cursor, watch };
    Ok(outcome)
}

/// Teaches on any engine from `start` on; says how it ended, and where.
fn run(
    teacher: &HarmonicField,
    settings: &DistillSettings,
    start: Start,
    engine: &mut dyn TrainingEngine,
    control: Control<'_>,
    observer: &mut dyn FnMut(&Report),
) -> Result<(Outcome, Start), TrainError> {
    let DistillSettings { plan, online, .. } = settings;
    if online.is_some() {
        let what = "settings of a teaching by sections, and a harmonic field teaches";
        return Err(RecipeError(what.into()).into());
    }
    let voxels = teacher.grid.len();
    let targets = Targets::new(teacher, settings.symmetry).map_err(|error| RecipeError(error.to_string()))?;
    // A loss in units of the field: outputs are coefficients over the scale.
    let unit = match plan.loss {
        Loss::L1 => f64::from(targets.scale),
        Loss::L2 => f64::from(targets.scale) * f64::from(targets.scale),
    };
    let mut order = Voxels::new(plan, &teacher.grid, settings.symmetry, start.cursor);
    let mut feed =
        |at: Cursor, _: u64, rows: Range<usize>, inputs: &mut [f32], rows_of_targets: &mut [f32]| {
            order.fill(at, &rows, inputs, rows_of_targets, |scratch, voxel, out| {
                targets.read(voxel, scratch, out);
            });
            Ok(())
        };
    let mut told = Told::new(plan, voxels, start, control, observer);
    let mut engine = Solving::new(engine, teacher, &targets, settings, told.steps);
    let outcome = train_by(plan, voxels, &mut feed, &mut engine, start, &mut |report, _| {
        told.hear(&Report { mean_loss: report.mean_loss * unit, ..*report })
    })?;
    Ok((outcome, told.start))
}
