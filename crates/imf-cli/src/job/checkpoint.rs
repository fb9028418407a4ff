//! Where a run begins: afresh, or from the checkpoint in its output folder.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use imf_core::model::{Model, TrainingRecord};
use imf_core::siren::SirenShape;
use imf_core::training::TrainingState;
use imf_core::training::run::{Cursor, TrainingPlan};

use super::data::Data;
use super::plan::schedule_from;
use crate::session::Session;

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
