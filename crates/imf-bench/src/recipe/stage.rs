//! One stage of a recipe: its sections and its training, which goes on where it was interrupted.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use imf_cli::commands::dataset::interruption;
use imf_cli::engine::Device;
use imf_cli::job::{self, Data, Footprint, LatestCheckpoint};
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::scene::Scene;
use imf_fields::file::FieldFileError;
use imf_fields::model::Model;
use imf_fields::recipe::{Cursor, TrainingState};
use imf_fields::siren::SirenShape;
use imf_train::dataset::generate;

use super::definition::Stage;

/// Where and how the work is done.
pub(crate) struct Runner<'a> {
    pub(crate) session: &'a Session,
    pub(crate) device: &'a Device,
    pub(crate) checkpoint_every: f64,
    /// Poses at which the error is watched.
    pub(crate) held_out: usize,
    /// Datasets of all stages and variants.
    pub(crate) datasets: PathBuf,
}

/// What a network begins with: its weights, and what they are to be remembered by.
pub(crate) type Start = (TrainingState, Option<String>);

impl Runner<'_> {
    /// Trains a stage in its folder to the end, from where it stands. Its sections are of `coarse`, its network of `full`.
    pub(crate) fn train(
        &self,
        stage: &Stage,
        shape: SirenShape,
        [full, coarse]: [&Scene; 2],
        start: Start,
        folder: &Path,
    ) -> Result<Model> {
        prepare_folder(folder)?;
        let data = self.dataset(stage, full, coarse)?;
        let fresh = job::fresh_model(&data, shape, stage.plan(), start.0, start.1);
        let mut model = self.found(folder, fresh)?;
        if !model.record.finished {
            let settings = job::Settings {
                checkpoint_every: self.checkpoint_every,
                go_on: super::GO_ON,
                slower: " in another folder, with a training.schedule.initial of ",
                held_out: self.held_out,
                held_out_every: None,
            };
            model = job::run(self.session, self.device, &data, model, folder, &settings)?;
        }
        model.record.seconds = job::seconds_until(folder, model.record.steps);
        Ok(model)
    }

    /// The training of `fresh` as its folder holds it: finished, at its checkpoint, or not begun.
    ///
    /// # Errors
    /// A model or a checkpoint of another training, which this one would overwrite, or one of a newer program.
    fn found(&self, folder: &Path, fresh: Model) -> Result<Model> {
        let finished = Model::read(&folder.join(job::FIELD)).map_err(anyhow::Error::from);
        let finished = finished.map(|model| (model, None));
        let checkpoint = job::latest(folder).map(|LatestCheckpoint { model, damage, .. }| (model, damage));
        for found in [finished, checkpoint] {
            let (model, damage) = match found {
                Ok(found) => found,
                Err(error) if matches!(error.downcast_ref(), Some(FieldFileError::Newer { .. })) => {
                    return Err(error);
                }
                // Damaged files are neither resumed nor retained.
                Err(_) => continue,
            };
            let different = differences(&model, &fresh);
            ensure!(
                different.is_empty(),
                "{0} holds another training ({1} differ), which would be overwritten: choose another --out, or remove {0}",
                folder.display(),
                different.join(", ")
            );
            let Cursor { epoch, step, .. } = model.record.cursor;
            if model.record.finished {
                self.session.note(&format!("finished already: {} steps", model.record.steps));
            } else if model.is_resumable() {
                damage.iter().for_each(|damage| self.session.warn(damage));
                let steps = model.record.steps;
                self.session.note(&format!("going on at epoch {epoch}, step {step} ({steps} steps done)"));
            } else {
                continue;
            }
            return Ok(model);
        }
        Ok(fresh)
    }

    /// The stage's dataset, made or finished where need be. Its samples speak of the full grid's points.
    fn dataset(&self, stage: &Stage, full: &Scene, coarse: &Scene) -> Result<Data> {
        let session = self.session;
        let set = stage.directions()?;
        let key = serde_json::to_vec(&(&coarse.record, &set.orientations, &stage.sampling))?;
        let name = coarse.record.part.replace(|c: char| !c.is_ascii_alphanumeric() && c != '-', "_");
        let folder = self.datasets.join(format!("{name}-{:08x}", crc32fast::hash(&key)));
        prepare_folder(&folder)?;
        let progress = session.stage("sampling", "sections", set.len() as u64);
        let advance = |n| progress.advance(n);
        let made = generate(&folder, coarse, &set, &stage.sampling, session.control(&advance))
            .map_err(|error| interruption(error, &folder))?;
        progress.finish(&format!("{} samples, {} shards made, {} kept", made.samples, made.made, made.kept));
        let mut data = Data::open(&folder)?;
        data.shards.frame = full.record.grid;
        // The network stands for the full grid whatever the resolution of the sections it learns from.
        data.scene = full.clone();
        Ok(data)
    }

    /// Refuses a stage that would not fit into memory. Samples in files may be read in groups, so memory for them is
    /// checked when they are there.
    pub(super) fn require_memory(
        &self,
        stage: &Stage,
        shape: SirenShape,
        [full, coarse]: [&Scene; 2],
    ) -> Result<()> {
        let each = stage.sampling.count(coarse.record.grid.len());
        let plan = stage.plan();
        let batch = plan.batch.min((stage.directions()?.len() * each).max(1));
        let (session, record) = (self.session, &full.record);
        Footprint::new(session, self.device, shape, &plan, record, batch, self.held_out)?
            .require(session)
            .context(
                "--width and --batch are network.width and training.batch in a recipe, to be changed with --set",
            )
    }
}

/// In what another training differs.
fn differences(found: &Model, fresh: &Model) -> Vec<&'static str> {
    let (own, other) = (&fresh.record, &found.record);
    let all = [
        ("network", fresh.shape != found.shape),
        ("part, grid or tool", fresh.scene.record != found.scene.record),
        ("training", own.plan != other.plan),
        ("sampling", own.sampling != other.sampling),
        ("samples", own.dataset_crc32 != other.dataset_crc32),
        ("weights that it starts from", own.fine_tuned_from != other.fine_tuned_from),
    ];
    all.into_iter().filter_map(|(name, differs)| differs.then_some(name)).collect()
}
