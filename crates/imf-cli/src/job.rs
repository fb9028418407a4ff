//! A training run with everything around the loop: progress, checkpoints, interruption, the finished model.
//!
//! In the output folder stand `checkpoint.safetensors` (with the optimiser's moments, written every so often, at
//! Ctrl-C and at the end), `model.safetensors` (without them, at the end) and `loss.png`.

mod checkpoint;
mod curve;
mod data;
mod plan;

pub(crate) use checkpoint::{continued, fresh_model, refuse_unfinished, resumed_model};
pub(crate) use curve::loss_chart;
pub(crate) use data::Data;
pub(crate) use plan::{plan, plan_defaults};

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use imf_core::model::{LossPoint, Model};
use imf_core::training::run::{Cursor, Outcome, Report, TrainError, TrainingPlan, train};
use imf_core::training::{EngineError, TrainingEngine};

use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::progress::Stage;
use crate::session::Session;
use checkpoint::checkpoint_path;
use plan::REPORT_EVERY;

/// Points that a loss curve keeps at most, about.
const CURVE_POINTS: u64 = 400;

/// The observer of a training.
pub(crate) type Observer<'a> = dyn FnMut(&Report, &mut dyn TrainingEngine) -> ControlFlow<()> + 'a;
/// Runs a plan on an engine from a cursor: where the samples come from is its own affair.
pub(crate) type Loop<'a> = dyn FnMut(&TrainingPlan, &mut dyn TrainingEngine, Cursor, &mut Observer<'_>) -> Result<Outcome, TrainError>
    + 'a;

/// Trains `model` to the end of its plan and writes it to `out`. `go_on` is what to do after an interruption, such as
/// "add --resume".
pub(crate) fn run(
    session: &Session,
    device: &Device,
    data: &Data,
    model: Model,
    out: &Path,
    checkpoint_every: f64,
    go_on: &'static str,
) -> Result<Model> {
    run_by(
        session,
        device,
        data.samples.len(),
        model,
        out,
        checkpoint_every,
        go_on,
        &mut |plan, engine, start, observer| train(plan, &data.samples, engine, start, observer),
    )
}

/// As [`run`], with samples from wherever `by` has them; an epoch is `samples` of them.
pub(crate) fn run_by(
    session: &Session,
    device: &Device,
    samples: usize,
    model: Model,
    out: &Path,
    checkpoint_every: f64,
    go_on: &'static str,
    by: &mut Loop<'_>,
) -> Result<Model> {
    let batch = model.record.plan.batch.min(samples.max(1));
    let needed = device.training_memory(model.shape, batch)?;
    session.require_memory(needed, || {
        format!(
            "training {} layers of {}; use a smaller --width or --batch",
            model.shape.hidden, model.shape.width
        )
    })?;
    let mut engine = device.trainer(model.shape, &model.record.plan, batch, model.state.clone())?;
    let total = model.record.plan.total_steps(samples);
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
        stage: session.stage("training", "steps", total),
        begun: Instant::now(),
        earlier_seconds: model.record.seconds,
        saved: Instant::now(),
        checkpoint_every,
        point_every: (total / CURVE_POINTS).max(REPORT_EVERY),
        pending: (0.0, 0),
        path: checkpoint_path(out),
        is_kept: model.record.steps > 0,
        go_on,
        failure: None,
        model,
    };
    run.model.record.engine = engine.describe();
    run.model.record.program = env!("CARGO_PKG_VERSION").into();
    run.stage.advance(run.model.record.steps);
    let start = run.model.record.cursor;
    let plan = run.model.record.plan;
    let outcome = by(&plan, engine.as_mut(), start, &mut |report, engine| {
        run.observe(report.cursor, report.step, report.mean_loss, report.samples_per_second, engine)
    });
    if let Some(failure) = run.failure {
        return Err(failure);
    }
    match outcome {
        Err(error) => return Err(run.explain(error)),
        Ok(Outcome::Stopped(_)) => {
            let text = format!(
                "step {} of {total} is saved in {}; {go_on} to go on",
                run.model.record.steps,
                run.path.display()
            );
            return Err(Interrupted(text).into());
        }
        Ok(Outcome::Finished) => {}
    }
    run.model.record.finished = true;
    run.end_point();
    run.save(engine.as_mut())?;
    let Run { stage, model, .. } = run;
    let last = model.record.losses.last().map_or(f64::NAN, |p| p.loss);
    stage.finish(&format!("loss {last:.2e}"));
    let model = model.without_moments();
    let path = out.join("model.safetensors");
    model.write(&path)?;
    loss_chart(&model.record).save(&out.join("loss.png"))?;
    session.note(&format!("wrote {}", path.display()));
    Ok(model)
}

/// What the observer of a run keeps between reports.
struct Run {
    stage: Stage,
    begun: Instant,
    earlier_seconds: f64,
    saved: Instant,
    checkpoint_every: f64,
    point_every: u64,
    /// Sum of step losses since the last point of the curve, and steps.
    pending: (f64, u64),
    path: PathBuf,
    /// True where the file at `path` is a checkpoint of this training.
    is_kept: bool,
    go_on: &'static str,
    failure: Option<anyhow::Error>,
    model: Model,
}

impl Run {
    fn observe(
        &mut self,
        cursor: Cursor,
        step: u64,
        mean_loss: f64,
        rate: f64,
        engine: &mut dyn TrainingEngine,
    ) -> ControlFlow<()> {
        let record = &mut self.model.record;
        let steps = step - record.steps;
        record.steps = step;
        record.cursor = cursor;
        self.pending.0 += mean_loss * steps as f64;
        self.pending.1 += steps;
        if self.pending.1 >= self.point_every {
            self.end_point();
        }
        self.stage.advance_saying(steps, &format!("(loss {mean_loss:.2e}, {:.0} k samples/s)", rate / 1e3));
        let stop = interrupt::requested();
        if stop || self.saved.elapsed().as_secs_f64() >= self.checkpoint_every {
            self.saved = Instant::now();
            if let Err(error) = self.save(engine) {
                self.failure = Some(error);
                return ControlFlow::Break(());
            }
        }
        if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// The mean loss since the last point becomes a point of the curve.
    fn end_point(&mut self) {
        let (sum, steps) = std::mem::take(&mut self.pending);
        if steps > 0 {
            let step = self.model.record.steps;
            self.model.record.losses.push(LossPoint { step, loss: sum / steps as f64 });
        }
    }

    fn save(&mut self, engine: &mut dyn TrainingEngine) -> Result<()> {
        self.model.state = engine.state()?;
        self.model.record.seconds = self.earlier_seconds + self.begun.elapsed().as_secs_f64();
        self.model.write(&self.path).context("the checkpoint before it is kept")?;
        self.is_kept = true;
        Ok(())
    }

    /// Adds what is left to go on from.
    fn explain(&self, error: TrainError) -> anyhow::Error {
        let kept = if self.is_kept {
            format!("the last checkpoint is {}; {} to go on from it", self.path.display(), self.go_on)
        } else {
            "no checkpoint was written yet".to_owned()
        };
        let device = matches!(error, TrainError::Engine(EngineError::Device(_)));
        let advice = if device { " (on another --device if this one stays lost)" } else { "" };
        anyhow::Error::from(error).context(format!("training stopped; {kept}{advice}"))
    }
}
