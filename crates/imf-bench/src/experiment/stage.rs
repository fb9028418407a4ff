//! One stage of a recipe: its sections and its training.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use imf_cli::commands::dataset::interruption;
use imf_cli::engine::Device;
use imf_cli::interrupt;
use imf_cli::job::{self, Data};
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::section::{At, SectionPlan};
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::Cursor;
use imf_fields::recipe::OnlineSettings;
use imf_fields::recipe::TrainingState;
use imf_fields::recipe::divergence::Watch;
use imf_train::dataset::generate;
use imf_train::training::online::{OnlineSections, train_online};

use super::Run;
use super::claim::StageSettings;
use super::kept::{Standing, standing};
use super::ready::directions;
use super::scenes::Scenes;
use super::tally::Tally;
use crate::recipe::{RANDOM_START, Recipe, Stage};

/// Where the work is done.
pub(crate) struct Workshop<'a> {
    pub(crate) session: &'a Session,
    pub(crate) device: &'a Device,
    /// What happens beside the steps.
    pub(crate) settings: job::Settings,
    /// Datasets of all stages and variants.
    pub(crate) datasets: PathBuf,
}

/// A finished stage.
pub(super) struct Finished {
    pub(super) name: String,
    pub(super) start: String,
    pub(super) model: Model,
    /// Voxels that its sections were made of.
    pub(super) section_dims: [usize; 3],
    /// Who waited for whom, of an online stage.
    pub(super) waits: Option<Tally>,
    pub(super) folder: PathBuf,
}

impl Workshop<'_> {
    /// Runs a stage to its end, from where it stands.
    pub(super) fn run(
        &self,
        run: &Run,
        stage: &Stage,
        scenes: &mut Scenes,
        finished: &[Finished],
    ) -> Result<Finished> {
        let session = self.session;
        let recipe = &run.recipe;
        session.note(&format!("stage {}:", stage.name));
        let full = scenes.full(session, &recipe.scene, stage)?;
        let coarse = scenes.of_sections(session, &recipe.scene, stage)?;
        let shape = recipe.network.shape();
        let (state, from) = self.start(recipe, stage, finished)?;
        let folder = run.stage_folder(&stage.name);
        prepare_folder(&folder)?;
        StageSettings::of(recipe, stage).write(&folder)?;
        let section_dims = coarse.record.grid.dims;
        let done = |model, waits, folder| Finished {
            name: stage.name.clone(),
            start: stage.start.clone(),
            model,
            section_dims,
            waits,
            folder,
        };
        if let Some(settings) = stage.online {
            let (sections, bytes) = self.online(&full, &coarse, stage, settings)?;
            let samples = sections.pool_samples();
            let plan = stage.plan();
            let record = TrainingRecord {
                program: env!("CARGO_PKG_VERSION").into(),
                plan,
                cursor: Cursor::default(),
                watch: Watch::default(),
                finished: false,
                steps: 0,
                seconds: 0.0,
                engine: String::new(),
                orientations: settings.pool_at(plan.total_steps(samples).saturating_sub(1)),
                sampling: stage.sampling,
                samples: samples as u64,
                dataset_crc32: fingerprint(&sections)?,
                groups_per_epoch: None,
                fine_tuned_from: from,
                losses: Vec::new(),
                pending_loss: (0.0, 0),
                held_out: None,
            };
            let model = match standing(
                session,
                &folder,
                Model { shape, scene: full, record, state, calibration: None },
            )? {
                Standing::Finished(model) => {
                    return Ok(done(*model, Tally::read(&folder), folder));
                }
                Standing::At(model) => model,
            };
            let mut tally = Tally::begin(&folder, model.record.steps)?;
            let mut waits = None;
            let trained = job::run_by(
                session,
                self.device,
                job::Epoch { samples, bytes },
                *model,
                &folder,
                &self.settings,
                &mut |plan, engine, start, observer| {
                    let (outcome, waited) =
                        train_online(plan, &sections, engine, start, interrupt::flag(), observer)?;
                    waits = Some(waited);
                    Ok(outcome)
                },
            );
            // An interrupted run is counted as well; what ended it is said before a file that cannot be written.
            let counted = waits.map_or(Ok(()), |waits| tally.end(&folder, &waits));
            let model = trained?;
            counted?;
            session.note(&tally.said());
            return Ok(done(model, Some(tally), folder));
        }
        let data = self.dataset(&full, &coarse, stage)?;
        let fresh = job::fresh_model(&data, shape, stage.plan(), state, from);
        let model = match standing(session, &folder, fresh)? {
            Standing::Finished(model) => *model,
            Standing::At(model) => job::run(session, self.device, &data, *model, &folder, &self.settings)?,
        };
        Ok(done(model, None, folder))
    }

    /// Starting weights, and what to remember of them.
    fn start(
        &self,
        recipe: &Recipe,
        stage: &Stage,
        finished: &[Finished],
    ) -> Result<(TrainingState, Option<String>)> {
        if stage.start == RANDOM_START {
            return Ok((TrainingState::new(&recipe.network.shape(), recipe.network.seed), None));
        }
        let earlier = finished.iter().find(|done| done.name == stage.start);
        let earlier = earlier.with_context(|| format!("stage {} was not run", stage.start))?;
        let parameters = earlier.model.state.parameters.clone();
        let mut hasher = crc32fast::Hasher::new();
        parameters.iter().for_each(|p| hasher.update(&p.to_le_bytes()));
        // The checksum lets a stage that started from other weights be noticed.
        let from =
            format!("{} (stage {}, {:08x})", earlier.model.scene.record.part, stage.start, hasher.finalize());
        Ok((TrainingState::from_parameters(parameters), Some(from)))
    }

    /// The stage's dataset, made or finished where need be. Its samples speak of the full grid's points.
    fn dataset(&self, full: &Scene, coarse: &Scene, stage: &Stage) -> Result<Data> {
        let session = self.session;
        let set = directions(stage)?;
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

    /// Where an online stage's sections come from, and the bytes that they take.
    fn online(
        &self,
        full: &Scene,
        coarse: &Scene,
        stage: &Stage,
        settings: OnlineSettings,
    ) -> Result<(OnlineSections, u64)> {
        let bytes = online_memory(&coarse.record, stage, &settings);
        self.session.require_memory(bytes, || {
            "the pool of sections; choose a smaller online.pool or sampling.density".into()
        })?;
        let plan = SectionPlan::of_scene(coarse, At::Tip)?;
        let sections = OnlineSections { plan, frame: full.record.grid, sampling: stage.sampling, settings };
        Ok((sections, bytes))
    }
}

/// Bytes of an online stage's pool, and of who fills it.
pub(super) fn online_memory(scene: &SceneRecord, stage: &Stage, settings: &OnlineSettings) -> u64 {
    OnlineSections::memory_estimate(&scene.grid, &stage.sampling, settings)
        + SectionPlan::memory_estimate(&scene.grid, &scene.tool, 1)
}

/// A checksum of all that decides an online stage's samples.
fn fingerprint(sections: &OnlineSections) -> Result<u32> {
    // How far the producer may be ahead changes nothing.
    let settings = OnlineSettings { lead: 0, ..sections.settings };
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&sections.plan.obstacle().forbidden.packed());
    let tool = sections.plan.tool();
    hasher.update(&serde_json::to_vec(&(sections.plan.grid(), tool, sections.sampling, settings))?);
    Ok(hasher.finalize())
}
