//! A training of any family with everything around the loop: progress, checkpoints, interruption, the log, the finished field.
//!
//! In the output folder stand `checkpoint.safetensors` (with the optimiser's state, written every so often, at
//! Ctrl-C and at the end), `checkpoint.previous.safetensors` (the one before), `field.safetensors` (weights alone, at
//! the end), `log.jsonl`, and of siren5 `loss.png`.

mod checkpoint;
mod checkpoint_files;
mod curve;
mod data;
mod differences;
mod factored;
mod held_out;
mod log;
mod memory;
mod siren5;

pub use checkpoint::{Checkpoint, LatestCheckpoint, Progress, latest};
pub(crate) use checkpoint::{is_unfinished, to_resume};
pub(crate) use curve::loss_chart;
pub use data::Data;
pub(crate) use factored::{Distillation, FactoredStart, require_memory};
pub use log::seconds_until;
pub use memory::Footprint;
pub use siren5::{fresh_model, run, weights_crc32};
pub(crate) use siren5::{require_togetherness, resumed_model, schedule_from};

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use imf_core::field::EngineError;
use imf_core::section::SectionError;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::model::{HeldOutPoint, LossPoint};
use imf_fields::recipe::TrainingPlan;
use imf_fields::recipe::schedule::Schedule;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Observer, Outcome, Report, Start, TrainError};

use crate::exit::message;
use crate::interrupt::{self, Interruption};
use crate::output::lock_folder;
use crate::progress::Stage;
use crate::session::Session;
use checkpoint::{PREVIOUS, write_result};
use checkpoint_files::CheckpointFiles;
use held_out::HeldOutWatch;
use log::{LOG, Log, Row};

/// File name of the trained field.
pub const FIELD: &str = "field.safetensors";
/// Steps between two reports of the loss, at which Ctrl-C is polled.
pub(crate) const REPORT_EVERY: u64 = 20;
/// Points that a loss curve has at most, about.
const CURVE_POINTS: u64 = 400;

/// Settings of a training but for its steps: checkpoints, messages, held-out poses.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Seconds between checkpoints.
    pub checkpoint_every: f64,
    /// What to do after an interruption, such as "add --resume".
    pub go_on: &'static str,
    /// Where a lower learning rate is given, such as " with --rate ".
    pub slower: &'static str,
    /// Poses held out of a fresh training of siren5; a resumed one has its own.
    pub held_out: usize,
    /// Steps between two evaluations at them.
    pub held_out_every: Option<u64>,
}

/// Runs a plan on an engine from a start, with samples of its own.
type Loop<'a> = dyn FnMut(&TrainingPlan, &mut dyn TrainingEngine, Start, &mut Observer<'_>) -> Result<Outcome, TrainError>
    + 'a;

/// A training that is about to begin or to go on.
struct Training<'a, T> {
    session: &'a Session,
    out: &'a Path,
    settings: &'a Settings,
    field: T,
    plan: TrainingPlan,
    /// Samples of an epoch.
    samples: usize,
    /// Whether it goes on from a checkpoint of `out`.
    resumed: bool,
    precision: StoragePrecision,
    /// What is watched beside the loss.
    held_out: Option<HeldOutWatch>,
}

impl<T: Checkpoint> Training<'_, T> {
    /// Trains `engine`, which has the field's state, by `by` to the end of the plan; writes checkpoints and the field. Also says
    /// the mean loss of the last steps, if any was done.
    fn run(self, engine: &mut dyn TrainingEngine, by: &mut Loop<'_>) -> Result<(T, Option<f64>)> {
        let Self { session, out, settings, field, plan, samples, resumed, precision, held_out } = self;
        let writing = session.rank().is_first();
        let _lock = if writing { Some(lock_folder(out)?) } else { None };
        let progress = field.progress();
        let total = plan.total_steps(samples);
        let steps = resumed.then_some(progress.steps);
        let mut stage = session.stage("training", "steps", total);
        stage.begin_at(progress.steps);
        let log = out.join(LOG);
        if writing && !resumed && log.exists() {
            session.note(&format!("an earlier training in {} is replaced", out.display()));
        }
        let log = writing.then(|| Log::open(&log, progress.steps)).transpose()?;
        let mut run = Run {
            session,
            settings,
            plan,
            stage,
            begun: Instant::now(),
            earlier_seconds: progress.seconds,
            point_every: (total / CURVE_POINTS).max(1).next_multiple_of(plan.report_every.max(1)),
            files: CheckpointFiles::new::<T>(out, steps, settings.checkpoint_every, writing),
            held_out,
            log,
            failure: None,
            last_loss: None,
            progress,
            field,
        };
        let start = run.progress.start;
        let outcome = by(&plan, engine, start, &mut |report, engine| {
            run.observe(report, engine).unwrap_or_else(|error| {
                run.failure = Some(error);
                ControlFlow::Break(())
            })
        });
        if let Some(failure) = run.failure {
            return Err(failure);
        }
        match outcome {
            // The first sections were still being made.
            Err(TrainError::Section(SectionError::Cancelled(_))) if interrupt::requested() => {
                run.take_state(engine)?;
                run.files.write(session, &run.field).context("interrupted")?;
                return Err(run.interrupted(total));
            }
            Err(error) => {
                if error.is_divergence() {
                    run.files.drop_doubtful::<T>();
                }
                return Err(run.explain(error));
            }
            Ok(Outcome::Stopped(_)) => return Err(run.interrupted(total)),
            Ok(Outcome::Finished) => {}
        }
        run.take_state(engine)?;
        run.field.finish();
        let saved = run.files.write(session, &run.field);
        let Run { stage, field, files, progress, last_loss, .. } = run;
        let unseen = progress.held_out.as_ref().and_then(|held| held.errors.last());
        let unseen = unseen.map_or_else(String::new, |error| format!(", held-out MSE {:.2e}", error.mse));
        stage.finish(&last_loss.map_or_else(String::new, |loss| format!("loss {loss:.2e}{unseen}")));
        let field = field.result(precision);
        if !writing {
            return saved.map(|()| (field, last_loss));
        }
        if progress.start.watch.is_suspicious() {
            session.warn(&format!(
                "the loss ended far above its best: training may have diverged in its last steps; a lower learning rate is the \
                 remedy, and {PREVIOUS} in {} is of before",
                out.display()
            ));
        }
        let path = out.join(FIELD);
        match (write_result(session, out, &field), saved) {
            (Ok(()), Ok(())) => {}
            // The field is what a training is for, and the smaller of the two.
            (Ok(()), Err(error)) => {
                let (why, shown) = (message(&error), path.display());
                session.warn(&format!("{why}; {shown} is the finished field all the same"));
            }
            (Err(error), Ok(())) => {
                return Err(error.context(format!("the training is finished and saved: {}", files.kept())));
            }
            (Err(_), Err(error)) => {
                let lost = "the training is finished, and neither its field nor its last checkpoint could be written";
                return Err(error.context(lost));
            }
        }
        session.note(&format!("wrote {}", path.display()));
        interrupt::leave(
            format!("the field is finished and written; {} for its errors", settings.go_on).into(),
        );
        Ok((field, last_loss))
    }
}

/// The observer of a training.
struct Run<'a, T> {
    session: &'a Session,
    settings: &'a Settings,
    plan: TrainingPlan,
    stage: Stage,
    begun: Instant,
    earlier_seconds: f64,
    point_every: u64,
    files: CheckpointFiles,
    held_out: Option<HeldOutWatch>,
    log: Option<Log>,
    failure: Option<anyhow::Error>,
    last_loss: Option<f64>,
    progress: Progress,
    field: T,
}

impl<T: Checkpoint> Run<'_, T> {
    fn observe(&mut self, report: &Report, engine: &mut dyn TrainingEngine) -> Result<ControlFlow<()>> {
        let progress = &mut self.progress;
        let steps = report.step - progress.steps;
        progress.steps = report.step;
        progress.start = Start { cursor: report.cursor, watch: report.watch };
        progress.pending_loss.0 += report.mean_loss * steps as f64;
        progress.pending_loss.1 += steps;
        self.last_loss = Some(report.mean_loss);
        let is_last = report.step == report.total_steps;
        let point = report.step.is_multiple_of(self.point_every) || is_last;
        let loss = point.then(|| self.end_point());
        let unseen = self.measure(report, engine)?;
        if loss.is_some() || unseen.is_some() {
            let row = Row {
                step: report.step,
                epoch: report.cursor.epoch,
                loss,
                rate: report.learning_rate,
                held_out_mse: unseen.map(|error| error.mse),
                held_out_mae: unseen.map(|error| error.mae),
                samples_per_second: report.samples_per_second,
                seconds: self.seconds(),
                seconds_left: report.remaining(&self.plan).map(|left| left.as_secs_f64()),
            };
            self.log.iter_mut().for_each(|log| log.add(self.session, &row));
        }
        let last = self.progress.held_out.as_ref().and_then(|held| held.errors.last());
        let held_out = last.map_or_else(String::new, |error| format!("held-out MSE {:.2e}, ", error.mse));
        self.stage.advance_saying(
            steps,
            &format!(
                "(loss {:.2e}, {held_out}{:.0} k samples/s)",
                report.mean_loss,
                report.samples_per_second / 1e3
            ),
        );
        if !is_last && self.session.rank().stop(interrupt::requested_at_report())? {
            self.take_state(engine)?;
            self.files.write(self.session, &self.field).context("interrupted")?;
            return Ok(ControlFlow::Break(()));
        }
        // A state that may be lost must not take the place of a good one. The last step has a checkpoint of its own.
        if self.files.is_due() && !report.watch.is_suspicious() && !is_last {
            self.take_state(engine)?;
            self.files.write_or_warn(self.session, &self.field);
        }
        Ok(ControlFlow::Continue(()))
    }

    /// The mean loss since the last point becomes a point of the curve.
    fn end_point(&mut self) -> f64 {
        let (sum, steps) = std::mem::take(&mut self.progress.pending_loss);
        let loss = sum / steps.max(1) as f64;
        self.progress.losses.push(LossPoint { step: self.progress.steps, loss });
        loss
    }

    /// The error at held-out poses, where it is due.
    fn measure(&mut self, report: &Report, engine: &mut dyn TrainingEngine) -> Result<Option<HeldOutPoint>> {
        let (Some(watch), Some(record)) = (&mut self.held_out, &mut self.progress.held_out) else {
            return Ok(None);
        };
        if !watch.is_due(report.step, report.total_steps) {
            return Ok(None);
        }
        let error = watch.evaluate(report.step, &engine.state()?)?;
        record.errors.push(error);
        Ok(Some(error))
    }

    fn seconds(&self) -> f64 {
        self.earlier_seconds + self.begun.elapsed().as_secs_f64()
    }

    /// Fetches what a checkpoint holds.
    fn take_state(&mut self, engine: &mut dyn TrainingEngine) -> Result<()> {
        let state = engine.state()?;
        if !state.is_finite() {
            self.files.drop_doubtful::<T>();
            bail!(
                "the weights are no longer finite numbers at step {}: training has diverged; {}",
                self.progress.steps,
                self.way_out(true)
            );
        }
        self.progress.seconds = self.seconds();
        self.field.update(&self.progress, state);
        Ok(())
    }

    /// The message at Ctrl-C, once the checkpoint is written.
    fn interrupted(&self, total: u64) -> anyhow::Error {
        let path = self.files.last().map_or_else(String::new, |(path, _)| path.display().to_string());
        let (steps, go_on) = (self.progress.steps, self.settings.go_on);
        Interruption(format!("step {steps} of {total} is saved in {path}; {go_on} to go on")).into()
    }

    /// Adds what is left to go on from.
    fn explain(&self, error: TrainError) -> anyhow::Error {
        let device = matches!(error, TrainError::Engine(EngineError::Device(_)));
        let advice = if device { " (on another --device if this one stays lost)" } else { "" };
        let way_out = self.way_out(error.is_divergence());
        anyhow::Error::from(error).context(format!("training stopped; {way_out}{advice}"))
    }

    /// The checkpoint to go on from, and how; more slowly where training diverged.
    fn way_out(&self, diverged: bool) -> String {
        let Settings { go_on, slower, .. } = self.settings;
        let third = match self.plan.schedule {
            Schedule::Exponential { initial, .. }
            | Schedule::Cosine { initial, .. }
            | Schedule::Length { initial, .. } => initial / 3.0,
        };
        let more_slowly = if diverged { format!("{slower}{third:.1e}") } else { " to go on from it".into() };
        match self.files.last() {
            Some((path, step)) => format!(
                "the last good checkpoint is {}, of step {step}; {go_on}{more_slowly}",
                path.display()
            ),
            None if diverged => format!("no checkpoint was written yet; start again{more_slowly}"),
            None => "no checkpoint was written yet".to_owned(),
        }
    }
}
