//! The training loop: feeds batches in each epoch's order to an engine, reports, and stops where its observer says so.
//!
//! Where training stands is a [`Cursor`]: epoch and step in it. The order of the samples, the learning rate and the
//! batches follow from the plan and the cursor alone, so a run that is stopped and continued with the engine's saved
//! state has the same bits as one that was not. An epoch's last batch holds what is left and may be smaller.

use std::ops::{ControlFlow, Range};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use thiserror::Error;

use super::TrainingEngine;
use super::permutation::Permutation;
use crate::dataset::DatasetError;
use crate::samples::Samples;
use imf_core::field::EngineError;
use imf_core::section::SectionError;
use imf_fields::recipe::divergence::{Verdict, Watch};
use imf_fields::recipe::{Cursor, RecipeError, TrainingPlan};
use imf_fields::siren::INPUTS;

/// What a run goes on from, beside the engine's state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Start {
    /// Where training stands.
    pub cursor: Cursor,
    /// Watches its losses for divergence.
    pub watch: Watch,
}

impl From<Cursor> for Start {
    fn from(cursor: Cursor) -> Self {
        Self { cursor, watch: Watch::default() }
    }
}

/// What the observer gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// The next step; with the engine's state all that resuming needs.
    pub cursor: Cursor,
    /// Steps done since the beginning of the run, those before a resumption included.
    pub step: u64,
    /// Steps of the whole run.
    pub total_steps: u64,
    /// True after the last step of an epoch.
    pub epoch_end: bool,
    /// Mean of the steps' losses since the last report.
    pub mean_loss: f64,
    /// Learning rate of the last step.
    pub learning_rate: f32,
    /// Samples a second since the last report, the observer's own time left out.
    pub samples_per_second: f64,
    /// State of the losses; where they are suspicious, a new checkpoint should not replace an older one.
    pub watch: Watch,
}

impl Report {
    /// Time left at the present rate of steps; nothing where none can be known.
    #[must_use]
    pub fn remaining(&self, plan: &TrainingPlan) -> Option<Duration> {
        let samples = (self.total_steps - self.step) as f64 * plan.batch as f64;
        Duration::try_from_secs_f64(samples / self.samples_per_second).ok()
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All steps are done.
    Finished,
    /// The observer asked to stop; training continues from this cursor with the engine's state as it is.
    Stopped(Cursor),
}

/// Why a run failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrainError {
    /// There is nothing to learn from.
    #[error("there are no samples to train on")]
    NoSamples,
    /// A setting out of range.
    #[error(transparent)]
    Plan(#[from] RecipeError),
    /// A cursor that is not a place of this run.
    #[error(
        "cannot resume at epoch {epoch}, step {step}: an epoch of these samples has {steps_per_epoch} steps"
    )]
    Cursor {
        /// Epoch of the cursor.
        epoch: u64,
        /// Step of the cursor.
        step: u64,
        /// Steps of an epoch.
        steps_per_epoch: u64,
    },
    /// The loss became infinite or NaN.
    #[error(
        "the loss became {loss} between steps {after} and {step} at a learning rate of {learning_rate:e}; \
         a lower learning rate is the remedy (a third is a good first try)"
    )]
    NotFinite {
        /// The loss.
        loss: f64,
        /// The last step known to be good.
        after: u64,
        /// The step at which it was noticed.
        step: u64,
        /// Learning rate of that step.
        learning_rate: f32,
    },
    /// The loss has been far above its best for long.
    #[error(
        "the loss rose from {best:.2e} at step {best_step} to {mean:.2e} at step {step} and stayed there, at a learning \
         rate of {learning_rate:e}: training has diverged; a lower learning rate is the remedy (a third is a good \
         first try)"
    )]
    Diverged {
        /// Lowest running mean of the loss.
        best: f64,
        /// Where it was reached.
        best_step: u64,
        /// Running mean now.
        mean: f64,
        /// The step at which it was noticed.
        step: u64,
        /// Learning rate of that step.
        learning_rate: f32,
    },
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A section that training waited for failed.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// A shard of the dataset is damaged or gone.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
}

impl TrainError {
    /// True where a lower learning rate is the remedy.
    #[must_use]
    pub fn is_divergence(&self) -> bool {
        matches!(self, Self::NotFinite { .. } | Self::Diverged { .. })
    }
}

/// What happens at every report of a training; a break ends it.
pub type Observer<'a> = dyn FnMut(&Report, &mut dyn TrainingEngine) -> ControlFlow<()> + 'a;

/// Fills rows of a step's batch: its cursor, which rows (all, or those of this process), their `inputs` and `targets` as
/// [`TrainingEngine::step`] takes them. What a row holds must follow from cursor and row alone.
pub(crate) type Feed<'a> =
    dyn FnMut(Cursor, Range<usize>, &mut [f32], &mut [f32]) -> Result<(), TrainError> + 'a;

/// Trains `engine` on `samples` from `start` to the plan's end, or until the observer breaks.
///
/// The observer is called every [`TrainingPlan::report_every`] steps, at each epoch's end and after the last step. It
/// gets the engine too, so that it can save a checkpoint (`report.cursor` and `engine.state()`); losses taken by the
/// observer are missing from the next report. The engine must take batches of `plan.batch` samples.
///
/// # Errors
/// A plan or cursor out of range, no samples, a loss that is not finite or has risen for good, or an engine that failed.
pub fn train(
    plan: &TrainingPlan,
    samples: &Samples,
    engine: &mut dyn TrainingEngine,
    start: impl Into<Start>,
    observer: &mut Observer<'_>,
) -> Result<Outcome, TrainError> {
    let start = start.into();
    let epoch = start.cursor.epoch;
    let mut order = (epoch, Permutation::new(samples.len(), plan.seed, epoch));
    let mut feed = |cursor: Cursor, rows: Range<usize>, inputs: &mut [f32], targets: &mut [f32]| {
        if order.0 != cursor.epoch {
            order = (cursor.epoch, Permutation::new(samples.len(), plan.seed, cursor.epoch));
        }
        let first = cursor.step as usize * plan.batch + rows.start;
        gather(inputs, targets, |row| samples.sample(order.1.at(first + row)));
        Ok(())
    };
    train_by(plan, samples.len(), &mut feed, &mut |_, _| Ok(()), engine, start, observer)
}

/// Changes the engine before the first step, when none is done, and after every one, by the number of steps done.
pub(crate) type Settle<'a> = dyn FnMut(u64, &mut dyn TrainingEngine) -> Result<(), EngineError> + 'a;

/// As [`train`], with batches from `feed`; an epoch is `samples` samples.
///
/// # Errors
/// As [`train`], and what `feed` and `settle` report.
pub(crate) fn train_by(
    plan: &TrainingPlan,
    samples: usize,
    feed: &mut Feed<'_>,
    settle: &mut Settle<'_>,
    engine: &mut dyn TrainingEngine,
    start: impl Into<Start>,
    observer: &mut Observer<'_>,
) -> Result<Outcome, TrainError> {
    plan.check()?;
    if samples == 0 {
        return Err(TrainError::NoSamples);
    }
    let steps_per_epoch = plan.steps_per_epoch(samples);
    let total_steps = plan.total_steps(samples);
    let Start { cursor: Cursor { mut epoch, step: mut step_in_epoch }, mut watch } = start.into();
    let begun = epoch.checked_mul(steps_per_epoch).and_then(|steps| steps.checked_add(step_in_epoch));
    let Some(mut step) = begun.filter(|_| step_in_epoch < steps_per_epoch) else {
        return Err(TrainError::Cursor { epoch, step: step_in_epoch, steps_per_epoch });
    };
    let most = plan.batch.min(samples);
    let (wide, learnt) = (engine.inputs(), engine.outputs());
    let (mut inputs, mut targets) = (vec![0.0; most * wide], vec![0.0; most * learnt]);
    let mut since = ReportInterval { step, samples: 0, start: Instant::now() };
    while step < total_steps {
        let first = step_in_epoch as usize * plan.batch;
        let count = plan.batch.min(samples - first);
        let rows = engine.rows_of_batch(count);
        let (inputs, targets) = (&mut inputs[..rows.len() * wide], &mut targets[..rows.len() * learnt]);
        feed(Cursor { epoch, step: step_in_epoch }, rows, inputs, targets)?;
        let learning_rate = plan.schedule.rate(epoch, step, total_steps);
        if step == 0 {
            settle(step, engine)?;
        }
        engine.step(inputs, targets, learning_rate)?;
        since.samples += count;
        step += 1;
        settle(step, engine)?;
        step_in_epoch += 1;
        let epoch_end = step_in_epoch == steps_per_epoch;
        if epoch_end {
            (epoch, step_in_epoch) = (epoch + 1, 0);
        }
        if !(epoch_end || step.is_multiple_of(plan.report_every) || step == total_steps) {
            continue;
        }
        let mean_loss = engine.take_mean_loss()?;
        if !mean_loss.is_finite() {
            return Err(TrainError::NotFinite { loss: mean_loss, after: since.step, step, learning_rate });
        }
        if let Verdict::Diverged { best, best_step, mean } = watch.observe(step, step - since.step, mean_loss)
        {
            return Err(TrainError::Diverged { best, best_step, mean, step, learning_rate });
        }
        let cursor = Cursor { epoch, step: step_in_epoch };
        let samples_per_second = since.samples as f64 / since.start.elapsed().as_secs_f64();
        let report = Report {
            cursor,
            step,
            total_steps,
            epoch_end,
            mean_loss,
            learning_rate,
            samples_per_second,
            watch,
        };
        if observer(&report, engine).is_break() && step < total_steps {
            return Ok(Outcome::Stopped(cursor));
        }
        since = ReportInterval { step, samples: 0, start: Instant::now() };
    }
    Ok(Outcome::Finished)
}

/// What has happened since the last report.
struct ReportInterval {
    step: u64,
    samples: usize,
    start: Instant,
}

/// Samples that one thread gathers at a time: some ten microseconds.
const PART: usize = 128;

/// Fills a batch row by row, on all threads of the current pool.
pub(super) fn gather(
    inputs: &mut [f32],
    targets: &mut [f32],
    sample: impl Fn(usize) -> ([f32; INPUTS], f32) + Sync,
) {
    let inputs = inputs.par_chunks_mut(PART * INPUTS);
    let targets = targets.par_chunks_mut(PART);
    inputs.zip(targets).enumerate().for_each(|(part, (inputs, targets))| {
        for ((input, target), row) in inputs.chunks_exact_mut(INPUTS).zip(targets).zip(part * PART..) {
            let (features, value) = sample(row);
            input.copy_from_slice(&features);
            *target = value;
        }
    });
}

#[cfg(test)]
mod tests;
