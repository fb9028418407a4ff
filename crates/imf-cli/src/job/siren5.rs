//! Trainings of siren5: on the samples of a dataset, or of whatever else a loop has; afresh, or from the checkpoint in the
//! output folder.

use std::path::Path;
use std::time::Duration;

use anyhow::{Result, bail, ensure};
use imf_core::orientation::OrientationSet;
use imf_core::scene::SceneRecord;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::model::Model;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{Sampling, TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;
use imf_train::training::run::train;
use imf_train::training::streamed::train_streamed;

use super::checkpoint::LatestCheckpoint;
use super::data::{Data, Source};
use super::held_out::{HeldOutWatch, record, steps_between};
use super::memory::Footprint;
use super::{Settings, Training};
use crate::arguments::train::Siren5Training;
use crate::engine::Device;
use crate::interrupt;
use crate::output::lock_folder;
use crate::ranks::started_together;
use crate::session::Session;

/// Trains `model` to the end of its plan and writes it to `out`.
pub fn run(
    session: &Session,
    device: &Device,
    data: &Data,
    mut model: Model,
    out: &Path,
    settings: &Settings,
) -> Result<Model> {
    let (rank, plan, samples) = (session.rank(), model.record.plan, data.shards.samples());
    let batch = plan.batch.min(samples.max(1));
    let resumed = model.record.steps > 0;
    let held_out = match &model.record.held_out {
        _ if !resumed => settings.held_out,
        held_out => held_out.as_ref().map_or(0, |held_out| held_out.choice.poses),
    };
    let scene = &model.scene.record;
    let footprint = Footprint::new(session, device, model.shape, &plan, scene, batch, held_out)?;
    let source = data.source(session, &footprint, &mut model)?;
    let total = plan.total_steps(samples);
    if !resumed {
        model.record.held_out = record(settings.held_out, settings.held_out_every, plan.seed, total);
    }
    // After this no rank reads what the first may write.
    rank.agree("training", fingerprint(&model)?)?;
    let _lock = if rank.is_first() { Some(lock_folder(out)?) } else { None };
    let held_out = if rank.is_first() { HeldOutWatch::new(session, &model)? } else { None };
    let mut engine = device.trainer(rank, model.shape, &plan, batch, model.state.clone())?;
    let _keeping = interrupt::stop_cleanly();
    let SirenShape { hidden, width, omega, .. } = model.shape;
    let (parameters, by) = (model.shape.parameter_count(), engine.describe());
    session.note(&format!(
        "training {hidden}×{width} ({parameters} parameters, ω = {omega}) on {samples} samples, {total} steps of {batch}; {by}"
    ));
    model.record.engine = by;
    model.record.program = env!("CARGO_PKG_VERSION").into();
    let precision = StoragePrecision::F32;
    let training =
        Training { session, out, settings, field: model, plan, samples, resumed, precision, held_out };
    let mut waited = Duration::ZERO;
    let (model, _) = training.run(engine.as_mut(), &mut |plan, engine, start, observer| match &source {
        Source::Memory(samples) => train(plan, samples, engine, start, observer),
        Source::Groups(groups) => {
            let (outcome, seconds) = train_streamed(plan, &data.shards, *groups, engine, start, observer)?;
            waited = seconds;
            Ok(outcome)
        }
    })?;
    if matches!(source, Source::Groups(_)) {
        session.note(&format!("training waited {:.1} s for shards", waited.as_secs_f64()));
    }
    Ok(model)
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

/// Refuses to train alone in the company of processes that would all do the same, and write to one folder.
pub(crate) fn require_togetherness(session: &Session) -> Result<()> {
    match started_together() {
        Some(count) if session.rank().size == 1 => bail!(
            "{count} processes were started together, and each would train by itself: add --mpi (in a build with the feature mpi) to share the work, or start one"
        ),
        _ => Ok(()),
    }
}

/// A model at the start of its training.
pub fn fresh_model(
    data: &Data,
    shape: SirenShape,
    plan: TrainingPlan,
    state: TrainingState,
    fine_tuned_from: Option<String>,
) -> Model {
    let samples = data.shards.samples() as u64;
    data.shards.manifest.fresh_model(data.scene.clone(), samples, shape, plan, state, fine_tuned_from)
}

/// Of weights that a training begins with, to know them again.
pub fn weights_crc32(weights: &[f32]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    weights.iter().for_each(|weight| hasher.update(&weight.to_le_bytes()));
    hasher.finalize()
}

impl LatestCheckpoint<Model> {
    /// Refuses a checkpoint that was not trained on these samples; nothing of them need be there.
    pub(crate) fn require_samples(
        &self,
        scene: &SceneRecord,
        set: &OrientationSet,
        sampling: &Sampling,
    ) -> Result<()> {
        let record = &self.model.record;
        let same =
            self.model.scene.record == *scene && record.orientations == *set && record.sampling == *sampling;
        self.require_same(same)
    }

    /// Refuses a checkpoint of another dataset.
    pub(crate) fn require_dataset(&self, data: &Data) -> Result<()> {
        self.require_same(self.model.record.dataset_crc32 == data.shards.manifest.fingerprint())
    }

    fn require_same(&self, same: bool) -> Result<()> {
        ensure!(
            same,
            "{} was trained on another dataset: resume with the one that it was started on",
            self.path.display()
        );
        Ok(())
    }

    /// Refuses a training that did not start from this model.
    pub(crate) fn require_origin(&self, start: &Model) -> Result<()> {
        let from = self.model.record.fine_tuned_from.as_ref();
        ensure!(
            self.model.shape == start.shape
                && from == Some(&start.scene.record.part)
                && self.model.record.fine_tuned_weights == Some(weights_crc32(&start.state.parameters)),
            "{} was not fine-tuned from this model: give the one that it was started from, or choose another --out",
            self.path.display()
        );
        Ok(())
    }

    /// Refuses options that were given and say something else than the training that is resumed; a rate may be given anew.
    pub(crate) fn require_options(&self, shape: SirenShape, training: &Siren5Training<'_>) -> Result<()> {
        let (own, record, plan) = (self.model.shape, &self.model.record, &training.plan);
        let held_out = record.held_out.as_ref().map_or(0, |held_out| held_out.choice.poses);
        let every_differs =
            |every: u64| record.held_out.as_ref().is_some_and(|own| own.every != steps_between(every));
        let kind = |schedule: &Schedule| std::mem::discriminant(schedule);
        let differ = [
            ("network", shape != own),
            ("epochs", plan.length != record.plan.length),
            ("steps", plan.length != record.plan.length),
            ("batch", plan.batch != record.plan.batch),
            ("seed", plan.seed != record.plan.seed),
            ("loss", plan.loss != record.plan.loss),
            ("precision", plan.precision != record.plan.precision),
            ("weight_decay", plan.adam.weight_decay != record.plan.adam.weight_decay),
            ("schedule", kind(&plan.schedule) != kind(&record.plan.schedule)),
            ("held_out", record.steps > 0 && training.held_out() != held_out),
            ("held_out_every", training.set.held_out_every.is_some_and(every_differs)),
        ];
        if let Some(option) = training.first_other(&differ) {
            bail!(
                "{option} is not that of the training in {}, which goes on as it was begun: leave it out, or begin another in another \
                 --out",
                self.path.display()
            );
        }
        Ok(())
    }
}

/// The checkpoint of an output folder, if it belongs to this dataset. Its plan goes on, but for a learning rate given
/// anew, which is the way out of a divergence.
pub(crate) fn resumed_model(
    session: &Session,
    found: LatestCheckpoint,
    data: &Data,
    rate: Option<f32>,
) -> Result<Model> {
    found.require_dataset(data)?;
    let LatestCheckpoint { mut model, path, damage } = found;
    // Of the weights as they were.
    model.calibration = None;
    if !model.is_resumable() {
        bail!("{} holds no optimiser state: it cannot be resumed", path.display());
    }
    if let Some(damage) = damage {
        session.warn(&damage);
    }
    let mut said = "by the plan of the checkpoint".to_owned();
    if let Some(rate) = rate {
        let plan = &mut model.record.plan;
        let schedule = schedule_from(&plan.schedule, rate);
        // The same rate given once more is not a way out of a divergence.
        if schedule != plan.schedule {
            plan.schedule = schedule;
            plan.check()?;
            model.record.watch = model.record.watch.patient();
        }
        said = format!("by the plan of the checkpoint with a learning rate from {rate:e}");
    }
    session.note(&format!(
        "resuming at epoch {}, step {} ({} steps done), {said}",
        model.record.cursor.epoch, model.record.cursor.step, model.record.steps
    ));
    Ok(model)
}

/// The same schedule from another rate.
pub(crate) fn schedule_from(schedule: &Schedule, initial: f32) -> Schedule {
    match *schedule {
        Schedule::Exponential { factor, warmup, .. } => Schedule::Exponential { initial, factor, warmup },
        Schedule::Cosine { warmup, .. } => {
            Schedule::Cosine { initial, last: initial * Schedule::COSINE_ENDS_AT, warmup }
        }
        Schedule::Length { steps, power, shorter, warmup, .. } => {
            Schedule::Length { initial, steps, power, shorter, warmup }
        }
    }
}
