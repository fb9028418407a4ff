//! Where a run begins: afresh, or from the checkpoint in its output folder.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use imf_core::model::{Model, ModelError, TrainingRecord};
use imf_core::siren::SirenShape;
use imf_core::training::TrainingState;
use imf_core::training::run::{Cursor, TrainingPlan};

use super::checkpoint::{Latest, latest};
use super::data::Data;
use super::plan::schedule_from;
use crate::ranks::started_together;
use crate::session::Session;

/// Refuses to train alone in the company of processes that would all do the same, and write to one folder.
pub(crate) fn require_togetherness(session: &Session) -> Result<()> {
    match started_together() {
        Some(count) if session.rank().of() == 1 => bail!(
            "{count} processes were started together, and each would train by itself: add --mpi (in a build with the              feature mpi) to share the work, or start one"
        ),
        _ => Ok(()),
    }
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

/// The checkpoint of an output folder, if it belongs to this dataset. Its plan goes on, but for a learning rate given
/// anew, which is the way out of a divergence.
pub(crate) fn resumed_model(session: &Session, out: &Path, data: &Data, rate: Option<f32>) -> Result<Model> {
    let Latest { mut model, path, damage } = latest(out).context("there is nothing to resume")?;
    // Of the weights as they were.
    model.calibration = None;
    if model.record.dataset_crc32 != data.manifest().fingerprint() {
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
    if let Some(damage) = damage {
        session.warn(&damage);
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
            && found.record.dataset_crc32 == data.manifest().fingerprint()
    };
    if latest(out).is_ok_and(|found| same(&found.model))
        && let Ok(model) = resumed_model(session, out, data, None)
    {
        return model;
    }
    fresh
}

/// Refuses to start over an unfinished training in the same folder, or over one that a newer program left there.
pub(crate) fn refuse_unfinished(out: &Path) -> Result<()> {
    match latest(out) {
        Ok(found) if !found.model.record.finished => bail!(
            "{} holds an unfinished training ({} steps done): add --resume, choose another --out, or remove it",
            found.path.display(),
            found.model.record.steps
        ),
        Err(error) if matches!(error.downcast_ref(), Some(ModelError::Newer { .. })) => Err(error),
        _ => Ok(()),
    }
}
