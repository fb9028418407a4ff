//! A training run with everything around the loop: progress, checkpoints, interruption, the finished model.
//!
//! In the output folder stand `checkpoint.safetensors` (with the optimiser's moments, written every so often, at
//! Ctrl-C and at the end), `checkpoint.previous.safetensors` (the one before), `model.safetensors` (without moments, at
//! the end) and `loss.png`.

mod checkpoint;
mod curve;
mod data;
mod held_out;
mod log;
mod memory;
mod plan;
mod start;

pub use checkpoint::{Latest, latest};
pub(crate) use curve::loss_chart;
pub use data::Data;
pub use memory::Footprint;
pub(crate) use plan::plan;
pub use plan::plan_defaults;
pub use start::{continued, fresh_model};
pub(crate) use start::{require_togetherness, resumed_model, to_resume};

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use imf_core::field::EngineError;
use imf_core::section::SectionError;
use imf_fields::model::{HeldOutPoint, LossPoint, Model};
use imf_fields::recipe::TrainingPlan;
use imf_fields::recipe::schedule::Schedule;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Outcome, Report, Start, TrainError, train};
use imf_train::training::streamed::train_streamed;

use crate::arguments::{LengthArguments, PlanArguments};
use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::output::{claim, keep_former};
use crate::progress::Stage;
use crate::session::Session;
use checkpoint::{Checkpoints, PREVIOUS};
use data::Source;
use held_out::HeldOutWatch;
use log::{Log, Row};
use plan::REPORT_EVERY;

/// What a training comes to.
pub const MODEL: &str = "model.safetensors";
/// Points that a loss curve keeps at most, about.
const CURVE_POINTS: u64 = 400;

/// What happens beside the steps of a training.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Seconds between checkpoints.
    pub checkpoint_every: f64,
    /// What to do after an interruption, such as "add --resume".
    pub go_on: &'static str,
    /// Where the learning rate is told, such as " with --rate ".
    pub slower: &'static str,
    /// Poses held out of a fresh training; a resumed one keeps those that it has.
    pub held_out: usize,
    /// Steps between two evaluations at them.
    pub held_out_every: Option<u64>,
    /// File of JSON lines.
    pub log: Option<PathBuf>,
}

impl Settings {
    /// What the arguments ask for.
    pub(crate) fn new(length: &LengthArguments, arguments: &PlanArguments) -> Self {
        Self {
            checkpoint_every: length.checkpoint_every,
            go_on: "add --resume",
            slower: " with --rate ",
            held_out: arguments.held_out,
            held_out_every: arguments.held_out_every,
            log: arguments.log.clone(),
        }
    }
}

/// The observer of a training.
pub(crate) type Observer<'a> = dyn FnMut(&Report, &mut dyn TrainingEngine) -> ControlFlow<()> + 'a;
/// Runs a plan on an engine from a cursor: where the samples come from is its own affair.
pub(crate) type Loop<'a> = dyn FnMut(&TrainingPlan, &mut dyn TrainingEngine, Start, &mut Observer<'_>) -> Result<Outcome, TrainError>
    + 'a;

/// What an epoch learns from.
#[derive(Clone, Copy, Debug)]
pub struct Epoch {
    /// Samples.
    pub samples: usize,
    /// Bytes that they take beside the training.
    pub bytes: u64,
}

/// Trains `model` to the end of its plan and writes it to `out`.
pub fn run(
    session: &Session,
    device: &Device,
    data: &Data,
    mut model: Model,
    out: &Path,
    settings: &Settings,
) -> Result<Model> {
    let samples = data.shards.samples();
    let footprint = footprint(session, device, &model, samples, settings)?;
    let source = data.source(session, &footprint, &mut model)?;
    let mut waited = Duration::ZERO;
    let by: &mut Loop<'_> = &mut |plan, engine, start, observer| match &source {
        Source::Memory(samples) => train(plan, samples, engine, start, observer),
        Source::Groups(groups) => {
            let (outcome, seconds) = train_streamed(plan, &data.shards, *groups, engine, start, observer)?;
            waited = seconds;
            Ok(outcome)
        }
    };
    let model = train_to_the_end(session, device, samples, model, out, settings, by)?;
    if matches!(source, Source::Groups(_)) {
        session.note(&format!("training waited {:.1} s for shards", waited.as_secs_f64()));
    }
    Ok(model)
}

/// As [`run`], with samples from wherever `by` has them.
pub fn run_by(
    session: &Session,
    device: &Device,
    epoch: Epoch,
    model: Model,
    out: &Path,
    settings: &Settings,
    by: &mut Loop<'_>,
) -> Result<Model> {
    let footprint = footprint(session, device, &model, epoch.samples, settings)?;
    footprint.require(session, epoch.bytes)?;
    train_to_the_end(session, device, epoch.samples, model, out, settings, by)
}

/// What the training takes beside its samples.
fn footprint(
    session: &Session,
    device: &Device,
    model: &Model,
    samples: usize,
    settings: &Settings,
) -> Result<Footprint> {
    let record = &model.record;
    let held_out = match &record.held_out {
        _ if record.steps == 0 => settings.held_out,
        held_out => held_out.as_ref().map_or(0, |held_out| held_out.choice.poses),
    };
    let batch = record.plan.batch.min(samples.max(1));
    Footprint::new(session, device, model.shape, &record.plan, &model.scene.record, batch, held_out)
}

/// Trains with an epoch of so many samples, which `by` has; memory was asked for.
fn train_to_the_end(
    session: &Session,
    device: &Device,
    samples: usize,
    mut model: Model,
    out: &Path,
    settings: &Settings,
    by: &mut Loop<'_>,
) -> Result<Model> {
    let rank = session.rank();
    let batch = model.record.plan.batch.min(samples.max(1));
    let total = model.record.plan.total_steps(samples);
    if model.record.steps == 0 {
        let seed = model.record.plan.seed;
        model.record.held_out = held_out::record(settings.held_out, settings.held_out_every, seed, total);
    }
    // After this no rank reads what the first may write.
    rank.agree("training", fingerprint(&model)?)?;
    let writing = rank.is_first();
    let _claim = if writing { Some(claim(out)?) } else { None };
    let held_out = if writing { HeldOutWatch::new(session, &model)? } else { None };
    let log = settings.log.as_deref().filter(|_| writing);
    let log = log.map(|path| Log::open(path, model.record.steps)).transpose()?;
    let mut engine = device.trainer(rank, model.shape, &model.record.plan, batch, model.state.clone())?;
    session.note(&format!(
        "training {}×{} ({} parameters, ω = {}) on {} samples, {} steps of {batch}; {}",
        model.shape.hidden,
        model.shape.width,
        model.shape.parameter_count(),
        model.shape.omega,
        samples,
        total,
        engine.describe()
    ));
    let mut run = Run {
        session,
        stage: session.stage("training", "steps", total),
        begun: Instant::now(),
        earlier_seconds: model.record.seconds,
        point_every: (total / CURVE_POINTS).max(REPORT_EVERY),
        checkpoints: Checkpoints::new(out, model.record.steps, settings.checkpoint_every, writing),
        held_out,
        log,
        go_on: settings.go_on,
        slower: settings.slower,
        failure: None,
        model,
    };
    run.model.record.engine = engine.describe();
    run.model.record.program = env!("CARGO_PKG_VERSION").into();
    run.stage.begin_at(run.model.record.steps);
    let start = Start { cursor: run.model.record.cursor, watch: run.model.record.watch };
    let plan = run.model.record.plan;
    let outcome = by(&plan, engine.as_mut(), start, &mut |report, engine| run.observe(report, engine));
    if let Some(failure) = run.failure {
        return Err(failure);
    }
    match outcome {
        Err(TrainError::Section(SectionError::Cancelled)) if interrupt::requested() => {
            let kept = run.checkpoints.kept();
            let text = format!("the first sections were still being made; {kept}; {} to go on", run.go_on);
            return Err(Interrupted(text).into());
        }
        Err(error) => {
            if error.is_divergence() {
                run.checkpoints.drop_doubtful();
            }
            return Err(run.explain(error));
        }
        Ok(Outcome::Stopped(_)) => {
            let path = run.checkpoints.last().map_or(out, |(path, _)| path).display().to_string();
            let go_on = settings.go_on;
            let steps = run.model.record.steps;
            let text = format!("step {steps} of {total} is saved in {path}; {go_on} to go on");
            return Err(Interrupted(text).into());
        }
        Ok(Outcome::Finished) => {}
    }
    run.model.record.finished = true;
    run.take_state(engine.as_mut())?;
    let kept = run.checkpoints.write(&run.model);
    let Run { stage, model, checkpoints, .. } = run;
    let last = model.record.losses.last().map_or(f64::NAN, |p| p.loss);
    let unseen = model.record.held_out.as_ref().and_then(|held| held.errors.last());
    let unseen = unseen.map_or_else(String::new, |error| format!(", held-out MSE {:.2e}", error.mse));
    stage.finish(&format!("loss {last:.2e}{unseen}"));
    let model = model.without_moments();
    if !writing {
        return kept.map(|()| model);
    }
    if model.record.watch.is_suspicious() {
        session.warn(&format!(
            "the loss ended far above its best: training may have diverged in its last steps; a lower learning rate is the \
             remedy, and {PREVIOUS} in {} is of before",
            out.display()
        ));
    }
    let path = out.join(MODEL);
    match (write_result(session, out, &model), kept) {
        (Ok(()), Ok(())) => {}
        // The model is what a training is for, and the smaller of the two.
        (Ok(()), Err(error)) => {
            session.warn(&format!("{error:#}; {} is the finished model all the same", path.display()));
        }
        (Err(error), Ok(())) => {
            return Err(error.context(format!("the training is finished and kept: {}", checkpoints.kept())));
        }
        (Err(_), Err(error)) => return Err(error),
    }
    session.note(&format!("wrote {}", path.display()));
    Ok(model)
}

/// Writes what a finished training came to: its model, without moments, and the course of its loss. The model of an earlier one
/// is kept.
fn write_result(session: &Session, out: &Path, model: &Model) -> Result<()> {
    let path = out.join(MODEL);
    keep_former(session, &path)?;
    model.write(&path)?;
    loss_chart(&model.record).save(&out.join("loss.png"))?;
    Ok(())
}

/// A checksum of all that ranks must have in common.
fn fingerprint(model: &Model) -> Result<u64> {
    let record = &model.record;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&serde_json::to_vec(&(
        model.shape,
        record.plan,
        record.cursor,
        record.steps,
        record.dataset_crc32,
        record.groups_per_epoch,
    ))?);
    let state = &model.state;
    for array in [&state.parameters, &state.first_moment, &state.second_moment] {
        array.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    }
    Ok(u64::from(hasher.finalize()))
}

/// What the observer of a run keeps between reports.
struct Run<'a> {
    session: &'a Session,
    stage: Stage,
    begun: Instant,
    earlier_seconds: f64,
    point_every: u64,
    checkpoints: Checkpoints,
    held_out: Option<HeldOutWatch>,
    log: Option<Log>,
    go_on: &'static str,
    slower: &'static str,
    failure: Option<anyhow::Error>,
    model: Model,
}

impl Run<'_> {
    fn observe(&mut self, report: &Report, engine: &mut dyn TrainingEngine) -> ControlFlow<()> {
        match self.try_observe(report, engine) {
            Ok(flow) => flow,
            Err(error) => {
                self.failure = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    fn try_observe(&mut self, report: &Report, engine: &mut dyn TrainingEngine) -> Result<ControlFlow<()>> {
        let record = &mut self.model.record;
        let steps = report.step - record.steps;
        record.steps = report.step;
        (record.cursor, record.watch) = (report.cursor, report.watch);
        record.pending_loss.0 += report.mean_loss * steps as f64;
        record.pending_loss.1 += steps;
        let is_last = report.step == report.total_steps;
        let point = record.pending_loss.1 >= self.point_every || is_last;
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
                seconds_left: report.remaining(&self.model.record.plan).map(|left| left.as_secs_f64()),
            };
            self.log.iter_mut().for_each(|log| log.add(self.session, &row));
        }
        let last = self.model.record.held_out.as_ref().and_then(|held| held.errors.last());
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
            self.checkpoints.write(&self.model).context("interrupted")?;
            return Ok(ControlFlow::Break(()));
        }
        // A state that may be lost must not take the place of a good one. The last step has a checkpoint of its own.
        if self.checkpoints.is_due() && !report.watch.is_suspicious() && !is_last {
            self.take_state(engine)?;
            self.checkpoints.write_or_warn(self.session, &self.model);
        }
        Ok(ControlFlow::Continue(()))
    }

    /// The mean loss since the last point becomes a point of the curve.
    fn end_point(&mut self) -> f64 {
        let record = &mut self.model.record;
        let (sum, steps) = std::mem::take(&mut record.pending_loss);
        let loss = sum / steps.max(1) as f64;
        record.losses.push(LossPoint { step: record.steps, loss });
        loss
    }

    /// The error at held-out poses, where it is due.
    fn measure(&mut self, report: &Report, engine: &mut dyn TrainingEngine) -> Result<Option<HeldOutPoint>> {
        let (Some(watch), Some(record)) = (&mut self.held_out, &mut self.model.record.held_out) else {
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
            self.checkpoints.drop_doubtful();
            bail!(
                "the weights are no longer finite numbers at step {}: training has diverged; {}",
                self.model.record.steps,
                self.way_out(true)
            );
        }
        self.model.state = state;
        self.model.record.seconds = self.seconds();
        Ok(())
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
        let third = match self.model.record.plan.schedule {
            Schedule::Exponential { initial, .. }
            | Schedule::Cosine { initial, .. }
            | Schedule::Length { initial, .. } => initial / 3.0,
        };
        let slower =
            if diverged { format!("{}{third:.1e}", self.slower) } else { " to go on from it".into() };
        match self.checkpoints.last() {
            Some((path, step)) => format!(
                "the last good checkpoint is {}, of step {step}; {}{slower}",
                path.display(),
                self.go_on
            ),
            None if diverged => format!("no checkpoint was written yet; start again{slower}"),
            None => "no checkpoint was written yet".to_owned(),
        }
    }
}
