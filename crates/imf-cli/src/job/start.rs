//! Where a run begins: afresh, or from the checkpoint in its output folder.

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::orientation::OrientationSet;
use imf_core::scene::SceneRecord;
use imf_fields::file::FieldFileError;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingState;
use imf_fields::recipe::divergence::Watch;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{Cursor, TrainingPlan};
use imf_fields::siren::SirenShape;

use super::checkpoint::{Latest, is_any, latest};
use super::data::Data;
use super::plan::schedule_from;
use super::{MODEL, Settings, write_result};
use crate::arguments::NetworkFamily;
use crate::arguments::train::Given;
use crate::checkpoints::nothing_to_resume;
use crate::ranks::started_together;
use crate::session::Session;

/// Refuses to train alone in the company of processes that would all do the same, and write to one folder.
pub(crate) fn require_togetherness(session: &Session) -> Result<()> {
    match started_together() {
        Some(count) if session.rank().of() == 1 => bail!(
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
    let record = TrainingRecord {
        program: env!("CARGO_PKG_VERSION").into(),
        plan,
        cursor: Cursor::default(),
        watch: Watch::default(),
        finished: false,
        steps: 0,
        seconds: 0.0,
        engine: String::new(),
        orientations: data.manifest().orientations.clone(),
        sampling: data.manifest().sampling,
        samples: data.shards.samples() as u64,
        dataset_crc32: data.manifest().fingerprint(),
        groups_per_epoch: None,
        fine_tuned_from,
        losses: Vec::new(),
        pending_loss: (0.0, 0),
        held_out: None,
    };
    Model { shape, scene: data.scene.clone(), record, state, calibration: None }
}

/// What an output folder holds to go on from, where that is asked for. Refuses to begin where a training is unfinished, and to
/// go on where there is none.
pub(crate) fn to_resume(out: &Path, resume: bool) -> Result<Option<Latest>> {
    if !resume {
        return refuse_unfinished(out).map(|()| None);
    }
    if !is_any(out) {
        return Err(nothing_to_resume(out, NetworkFamily::Siren5));
    }
    latest(out).map(Some).context("there is nothing to resume")
}

impl Latest {
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
        self.require_same(self.model.record.dataset_crc32 == data.manifest().fingerprint())
    }

    /// Refuses a training that did not start from a model of this network and part.
    pub(crate) fn require_origin(&self, start: &Model) -> Result<()> {
        let from = self.model.record.fine_tuned_from.as_ref();
        ensure!(
            self.model.shape == start.shape && from == Some(&start.scene.record.part),
            "{} was not fine-tuned from this model: give the one that it was started from, or choose another --out",
            self.path.display()
        );
        Ok(())
    }

    /// Refuses options that were given and say something else than the training that is resumed; a rate may be given anew.
    pub(crate) fn require_options(
        &self,
        given: &Given,
        shape: SirenShape,
        plan: &TrainingPlan,
        settings: &Settings,
    ) -> Result<()> {
        let (own, record) = (self.model.shape, &self.model.record);
        let held_out = record.held_out.as_ref().map_or(0, |held_out| held_out.choice.poses);
        let kind = |schedule: &Schedule| std::mem::discriminant(schedule);
        let differ = [
            ("width", shape.width != own.width),
            ("layers", shape.hidden != own.hidden),
            ("omega", shape.omega != own.omega),
            ("epochs", plan.length != record.plan.length),
            ("steps", plan.length != record.plan.length),
            ("batch", plan.batch != record.plan.batch),
            ("seed", plan.seed != record.plan.seed),
            ("loss", plan.loss != record.plan.loss),
            ("precision", plan.precision != record.plan.precision),
            ("weight_decay", plan.adam.weight_decay != record.plan.adam.weight_decay),
            ("schedule", kind(&plan.schedule) != kind(&record.plan.schedule)),
            ("held_out", record.steps > 0 && settings.held_out != held_out),
        ];
        if let Some((name, _)) = differ.into_iter().find(|&(name, differs)| differs && given.has(name)) {
            bail!(
                "--{} is not that of the training in {}, which goes on as it was begun: leave it out, or begin another in another \
                 --out",
                name.replace('_', "-"),
                self.path.display()
            );
        }
        Ok(())
    }

    fn require_same(&self, same: bool) -> Result<()> {
        ensure!(
            same,
            "{} was trained on another dataset: resume with the one that it was started on",
            self.path.display()
        );
        Ok(())
    }

    /// True where no steps are left.
    pub(crate) fn is_finished(&self) -> bool {
        self.model.record.finished
    }

    /// The model that a finished training came to: as it lies in `out`, else written there from the checkpoint.
    pub(crate) fn result(&self, session: &Session, out: &Path) -> Result<Model> {
        let found = &self.model;
        let path = out.join(MODEL);
        let said = format!(
            "{} is finished after {} steps: nothing is left to do (imf finetune trains a model further)",
            self.path.display(),
            found.record.steps
        );
        // Of these very weights, which a model of an earlier training is not.
        let same = |kept: &Model| {
            (&kept.record, kept.shape, &kept.state.parameters)
                == (&found.record, found.shape, &found.state.parameters)
        };
        if let Some(kept) = Model::read(&path).ok().filter(same) {
            session.note(&said);
            return Ok(kept);
        }
        let model = found.clone().without_moments();
        if session.rank().is_first() {
            write_result(session, out, &model)?;
        }
        session.note(&format!("{said}; wrote {}", path.display()));
        Ok(model)
    }
}

/// The checkpoint of an output folder, if it belongs to this dataset. Its plan goes on, but for a learning rate given
/// anew, which is the way out of a divergence.
pub(crate) fn resumed_model(
    session: &Session,
    found: Latest,
    data: &Data,
    rate: Option<f32>,
) -> Result<Model> {
    found.require_dataset(data)?;
    let Latest { mut model, path, damage } = found;
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
        // The same rate given once more is no way out of a divergence.
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

/// `fresh`, or the unfinished checkpoint of the same training in the output folder.
pub fn continued(session: &Session, out: &Path, data: &Data, fresh: Model) -> Model {
    let same = |found: &Model| {
        !found.record.finished
            && found.shape == fresh.shape
            && found.record.plan == fresh.record.plan
            && found.record.dataset_crc32 == data.manifest().fingerprint()
    };
    match latest(out) {
        Ok(found) if same(&found.model) => resumed_model(session, found, data, None).unwrap_or(fresh),
        _ => fresh,
    }
}

/// Refuses to start over an unfinished training in the same folder, or over one that a newer program left there.
fn refuse_unfinished(out: &Path) -> Result<()> {
    match latest(out) {
        Ok(found) if !found.model.record.finished => bail!(
            "{} holds an unfinished training ({} steps done): add --resume, choose another --out, or remove it",
            found.path.display(),
            found.model.record.steps
        ),
        Err(error) if matches!(error.downcast_ref(), Some(FieldFileError::Newer { .. })) => Err(error),
        _ => Ok(()),
    }
}
