//! A training run with everything around the loop: progress, checkpoints, interruption, the finished model.
//!
//! In the output folder stand `checkpoint.safetensors` (with the optimiser's moments, written every so often, at
//! Ctrl-C and at the end), `model.safetensors` (without them, at the end) and `loss.png`.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use imf_core::dataset::{self, Manifest};
use imf_core::model::{LossPoint, Model, TrainingRecord};
use imf_core::samples::Samples;
use imf_core::scene::Scene;
use imf_core::siren::SirenShape;
use imf_core::training::run::{Cursor, Length, Outcome, TrainError, TrainingPlan, train};
use imf_core::training::schedule::Schedule;
use imf_core::training::{AdamConfig, EngineError, TrainingEngine, TrainingState};

use crate::arguments::{PlanArguments, ScheduleKind};
use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::picture::{AxisScale, Chart, Series};
use crate::progress::Stage;
use crate::session::Session;

/// Points that a loss curve keeps at most, about.
const CURVE_POINTS: u64 = 400;
/// Steps between two looks at the loss and at Ctrl-C.
const REPORT_EVERY: u64 = 20;

/// A dataset in memory with what is known about it.
pub(crate) struct Data {
    pub(crate) manifest: Manifest,
    pub(crate) scene: Scene,
    pub(crate) samples: Samples,
}

impl Data {
    /// Reads a dataset's folder, if it fits the memory.
    pub(crate) fn load(session: &Session, folder: &Path) -> Result<Self> {
        let expected = Manifest::read(folder)?.shards.iter().flatten().map(|s| s.samples).sum::<u64>();
        // 8 bytes a sample, and one shard twice while it is read.
        session.require_memory(expected * 8 + (64 << 20), || {
            format!("the {expected} samples of {}; make a dataset of lower --density", folder.display())
        })?;
        let (manifest, scene, samples) = dataset::load(folder)?;
        if !scene.record.tool.is_axisymmetric()
            && manifest.orientations.orientations.iter().any(|o| o.roll != 0.0)
        {
            bail!(
                "{}: its orientations roll the tool about its own axis, which siren5's five inputs cannot express; \
                 make a dataset with directions only",
                folder.display()
            );
        }
        Ok(Self { manifest, scene, samples })
    }
}

/// The plan that arguments describe; `rate` and `epochs` stand where they are silent.
pub(crate) fn plan(arguments: &PlanArguments, rate: f32, epochs: u64) -> TrainingPlan {
    let initial = arguments.rate.unwrap_or(rate);
    TrainingPlan {
        length: match arguments.steps {
            Some(steps) => Length::Steps(steps),
            None => Length::Epochs(arguments.epochs.unwrap_or(epochs)),
        },
        batch: arguments.batch,
        schedule: match arguments.schedule {
            ScheduleKind::Exponential => Schedule::Exponential { initial, factor: 0.93 },
            ScheduleKind::Cosine => Schedule::Cosine { initial, last: initial * 0.01, warmup: 200 },
        },
        adam: AdamConfig { weight_decay: arguments.weight_decay, ..AdamConfig::default() },
        loss: arguments.loss.into(),
        seed: arguments.seed,
        report_every: REPORT_EVERY,
    }
}

/// The same schedule from another rate.
fn schedule_from(schedule: &Schedule, initial: f32) -> Schedule {
    match *schedule {
        Schedule::Exponential { factor, .. } => Schedule::Exponential { initial, factor },
        Schedule::Cosine { warmup, .. } => Schedule::Cosine { initial, last: initial * 0.01, warmup },
    }
}

/// The paper's plan, reported often enough to notice Ctrl-C.
pub(crate) fn plan_defaults() -> TrainingPlan {
    TrainingPlan { report_every: REPORT_EVERY, ..TrainingPlan::default() }
}

/// The file that a run continues from.
pub(crate) fn checkpoint_path(out: &Path) -> PathBuf {
    out.join("checkpoint.safetensors")
}

/// A model at the start of its training.
pub(crate) fn fresh_model(
    data: &Data,
    shape: SirenShape,
    plan: TrainingPlan,
    state: TrainingState,
    fine_tuned_from: Option<String>,
) -> Model {
    let record = TrainingRecord {
        program: env!("CARGO_PKG_VERSION").into(),
        plan,
        cursor: Cursor::default(),
        finished: false,
        steps: 0,
        seconds: 0.0,
        engine: String::new(),
        orientations: data.manifest.orientations.clone(),
        sampling: data.manifest.sampling,
        samples: data.samples.len() as u64,
        dataset_crc32: data.manifest.fingerprint(),
        fine_tuned_from,
        losses: Vec::new(),
    };
    Model { shape, scene: data.scene.clone(), record, state }
}

/// The checkpoint of an output folder, if it belongs to this dataset. Its plan goes on, but for a learning rate given
/// anew, which is the way out of a divergence.
pub(crate) fn resumed_model(session: &Session, out: &Path, data: &Data, rate: Option<f32>) -> Result<Model> {
    let path = checkpoint_path(out);
    let mut model = Model::read(&path).context("there is nothing to resume")?;
    if model.record.dataset_crc32 != data.manifest.fingerprint() {
        bail!(
            "{} was trained on another dataset: resume with the one that it was started on",
            path.display()
        );
    }
    if model.record.finished {
        bail!("{} is finished: there is nothing to resume", path.display());
    }
    if !model.is_resumable() {
        bail!("{} holds no optimiser state: it cannot be resumed", path.display());
    }
    let mut said = "by the plan of the checkpoint".to_owned();
    if let Some(rate) = rate {
        let plan = &mut model.record.plan;
        plan.schedule = schedule_from(&plan.schedule, rate);
        plan.check()?;
        said = format!("by the plan of the checkpoint with a learning rate from {rate:e}");
    }
    session.note(&format!(
        "resuming at epoch {}, step {} ({} steps done), {said}",
        model.record.cursor.epoch, model.record.cursor.step, model.record.steps
    ));
    Ok(model)
}

/// `fresh`, or the unfinished checkpoint of the same training in the output folder.
pub(crate) fn continued(session: &Session, out: &Path, data: &Data, fresh: Model) -> Model {
    let same = |found: &Model| {
        !found.record.finished
            && found.shape == fresh.shape
            && found.record.plan == fresh.record.plan
            && found.record.dataset_crc32 == data.manifest.fingerprint()
    };
    if Model::read(&checkpoint_path(out)).is_ok_and(|found| same(&found))
        && let Ok(model) = resumed_model(session, out, data, None)
    {
        return model;
    }
    fresh
}

/// Refuses to start over an unfinished training in the same folder.
pub(crate) fn refuse_unfinished(out: &Path) -> Result<()> {
    let path = checkpoint_path(out);
    if path.exists()
        && let Ok(model) = Model::read(&path)
        && !model.record.finished
    {
        bail!(
            "{} holds an unfinished training ({} steps done): add --resume, choose another --out, or remove it",
            path.display(),
            model.record.steps
        );
    }
    Ok(())
}

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
    let batch = model.record.plan.batch.min(data.samples.len().max(1));
    let needed = device.training_memory(model.shape, batch)?;
    session.require_memory(needed, || {
        format!(
            "training {} layers of {}; use a smaller --width or --batch",
            model.shape.hidden, model.shape.width
        )
    })?;
    let mut engine = device.trainer(model.shape, &model.record.plan, batch, model.state.clone())?;
    let total = model.record.plan.total_steps(data.samples.len());
    session.note(&format!(
        "training {}×{} ({} parameters, ω = {}) on {} samples, {} steps of {batch}; {}",
        model.shape.hidden,
        model.shape.width,
        model.shape.parameter_count(),
        model.shape.omega,
        data.samples.len(),
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
    let outcome = train(&plan, &data.samples, engine.as_mut(), start, &mut |report, engine| {
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

/// The loss curve.
pub(crate) fn loss_chart(record: &TrainingRecord) -> Chart {
    Chart {
        title: format!("Training loss, {} samples", record.samples),
        x_name: "steps".into(),
        value_name: "mean loss".into(),
        value_scale: AxisScale::Logarithmic,
        series: vec![Series {
            name: "training".into(),
            points: record.losses.iter().map(|p| (p.step as f64, p.loss)).collect(),
            markers: false,
        }],
    }
}
