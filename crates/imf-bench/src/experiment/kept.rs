//! What a stage's folder holds of a training, and whether it is of the same training.

use std::path::Path;

use anyhow::{Result, bail};
use imf_cli::job::{self, Latest};
use imf_cli::session::Session;
use imf_core::scene::SceneRecord;
use imf_fields::model::{Model, ModelError};
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingPlan;
use imf_fields::siren::SirenShape;

/// What a training is known by.
pub(super) struct Training<'a> {
    pub(super) shape: SirenShape,
    pub(super) scene: &'a SceneRecord,
    pub(super) plan: &'a TrainingPlan,
    pub(super) sampling: &'a Sampling,
    /// Its samples' checksum and what it starts from, which are known only when its turn comes.
    pub(super) samples_and_start: Option<(u32, Option<&'a str>)>,
}

/// Where a stage stands.
pub(super) enum Standing {
    Finished(Box<Model>),
    At(Box<Model>),
}

/// What there is to go on from.
pub(super) enum Found {
    Finished(Box<Model>),
    Checkpoint(Box<Latest>),
    Nothing,
}

impl<'a> Training<'a> {
    /// That of a model.
    fn of(model: &'a Model) -> Self {
        let record = &model.record;
        Self {
            shape: model.shape,
            scene: &model.scene.record,
            plan: &record.plan,
            sampling: &record.sampling,
            samples_and_start: Some((record.dataset_crc32, record.fine_tuned_from.as_deref())),
        }
    }

    /// In what another training differs; in nothing where it is the same, as far as both are known.
    fn differences(&self, other: &Self) -> Vec<&'static str> {
        let own_ends = self.samples_and_start.or(other.samples_and_start);
        let other_ends = other.samples_and_start.or(own_ends);
        let samples = |ends: Option<(u32, Option<&'a str>)>| ends.map(|(samples, _)| samples);
        let start = |ends: Option<(u32, Option<&'a str>)>| ends.and_then(|(_, start)| start);
        [
            ("network", self.shape != other.shape),
            ("part, grid or tool", self.scene != other.scene),
            ("training", self.plan != other.plan),
            ("sampling", self.sampling != other.sampling),
            ("samples", samples(own_ends) != samples(other_ends)),
            ("weights that it starts from", start(own_ends) != start(other_ends)),
        ]
        .into_iter()
        .filter_map(|(name, differs)| differs.then_some(name))
        .collect()
    }

    /// What a folder holds of this training: its model where it is finished, else its last checkpoint.
    ///
    /// # Errors
    /// Only a model or a checkpoint of another training, which this one would overwrite, or one of a newer program.
    pub(super) fn find(&self, folder: &Path) -> Result<Found> {
        let differences = |found: &Model| self.differences(&Training::of(found));
        let mut other = None;
        match Model::read(&folder.join(job::FIELD)) {
            Ok(model) => match differences(&model).as_slice() {
                [] if model.record.finished => return Ok(Found::Finished(Box::new(model))),
                [] => {}
                differing => other = Some(differing.join(", ")),
            },
            Err(error @ ModelError::Newer { .. }) => return Err(error.into()),
            // Damaged files are nothing to go on from, nor anything to keep.
            Err(_) => {}
        }
        match job::latest::<Model>(folder) {
            Ok(found) => match differences(&found.model).as_slice() {
                [] if found.model.is_resumable() => return Ok(Found::Checkpoint(Box::new(found))),
                [] => {}
                differing => other = Some(differing.join(", ")),
            },
            Err(error) if matches!(error.downcast_ref(), Some(ModelError::Newer { .. })) => {
                return Err(error);
            }
            // Damaged files are nothing to go on from, nor anything to keep.
            Err(_) => {}
        }
        if let Some(what) = other {
            bail!(
                "{0} holds another training ({what} differ), which would be overwritten: choose another --out, or remove {0}",
                folder.display()
            );
        }
        Ok(Found::Nothing)
    }
}

/// The stage's finished model, its checkpoint, or `fresh`, whichever belongs to the same training and is farthest.
///
/// # Errors
/// As [`Training::find`].
pub(super) fn standing(session: &Session, folder: &Path, fresh: Model) -> Result<Standing> {
    match Training::of(&fresh).find(folder)? {
        Found::Finished(model) => {
            session.note(&format!("finished already: {} steps", model.record.steps));
            Ok(Standing::Finished(model))
        }
        Found::Checkpoint(found) => {
            let Latest { model, damage, .. } = *found;
            damage.iter().for_each(|damage| session.warn(damage));
            session.note(&format!(
                "going on at epoch {}, step {} ({} steps done)",
                model.record.cursor.epoch, model.record.cursor.step, model.record.steps
            ));
            Ok(Standing::At(Box::new(model)))
        }
        Found::Nothing => Ok(Standing::At(Box::new(fresh))),
    }
}
