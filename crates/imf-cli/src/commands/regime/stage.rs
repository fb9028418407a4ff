//! One stage of a regime: its sections, its training, and how it is known again.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use imf_core::dataset::generate;
use imf_core::model::{Model, TrainingRecord};
use imf_core::orientation::OrientationSet;
use imf_core::regime::{RANDOM_START, Regime, Stage};
use imf_core::scene::Scene;
use imf_core::section::SectionPlan;
use imf_core::training::TrainingState;
use imf_core::training::online::{OnlineSections, OnlineSettings, Waits, train_online};
use imf_core::training::run::Cursor;

use super::scenes::Scenes;
use crate::commands::dataset::interruption;
use crate::engine::Device;
use crate::interrupt;
use crate::job::{self, Data};
use crate::output::{prepare_folder, write_json};
use crate::session::Session;

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
    pub(super) waits: Option<Waits>,
    pub(super) folder: PathBuf,
}

impl Workshop<'_> {
    /// Runs a stage to its end, from where it stands.
    pub(super) fn run(
        &self,
        regime: &Regime,
        stage: &Stage,
        scenes: &mut Scenes<'_>,
        finished: &[Finished],
        out: &Path,
    ) -> Result<Finished> {
        let session = self.session;
        session.note(&format!("stage {}:", stage.name));
        let full = scenes.full(session, stage)?;
        let coarse = scenes.of_sections(session, stage)?;
        let shape = regime.network.shape();
        let (state, from) = self.start(regime, stage, finished)?;
        let folder = out.join("stages").join(&stage.name);
        prepare_folder(&folder)?;
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
            let waits_path = folder.join("waits.json");
            let (sections, bytes) = self.online(&full, &coarse, stage, settings)?;
            let samples = sections.pool_samples();
            let plan = stage.plan();
            let record = TrainingRecord {
                program: env!("CARGO_PKG_VERSION").into(),
                plan,
                cursor: Cursor::default(),
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
            ) {
                Standing::Finished(model) => {
                    return Ok(done(*model, read_waits(&waits_path), folder));
                }
                Standing::At(model) => model,
            };
            let mut waits = None;
            let model = job::run_by(
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
            )?;
            if let Some(waits) = &waits {
                write_json(&waits_path, waits)?;
                session.note(&format!(
                    "{} sections while training: the trainer waited {:.1} s for them (and {:.1} s for the first pool), \
                     the producer {:.1} s for the trainer",
                    waits.sections, waits.trainer, waits.filling, waits.producer
                ));
            }
            return Ok(done(model, waits, folder));
        }
        let data = self.dataset(&full, &coarse, stage)?;
        let fresh = job::fresh_model(&data, shape, stage.plan(), state, from);
        let model = match standing(session, &folder, fresh) {
            Standing::Finished(model) => *model,
            Standing::At(model) => job::run(session, self.device, &data, *model, &folder, &self.settings)?,
        };
        Ok(done(model, None, folder))
    }

    /// Starting weights, and what to remember of them.
    fn start(
        &self,
        regime: &Regime,
        stage: &Stage,
        finished: &[Finished],
    ) -> Result<(TrainingState, Option<String>)> {
        if stage.start == RANDOM_START {
            return Ok((TrainingState::new(&regime.network.shape(), regime.network.seed), None));
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
        let spec = stage.orientations.as_deref().context("a stage without orientations")?;
        let set = OrientationSet::parse(spec)?;
        if set.orientations.iter().any(|o| o.roll != 0.0) {
            bail!("'{spec}' rolls the tool about its own axis, which siren5's five inputs cannot express");
        }
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
        let grid = coarse.record.grid;
        let pool = OnlineSections::memory_estimate(&grid, &stage.sampling, &settings);
        let bytes = pool + SectionPlan::memory_estimate(&grid, &coarse.record.tool, 1);
        self.session.require_memory(bytes, || {
            "the pool of sections; choose a smaller online.pool or sampling.density".into()
        })?;
        if !coarse.record.bare_tool().with_tip_only().is_axisymmetric() {
            bail!("an online stage needs a tool that is the same all around its axis");
        }
        let plan = SectionPlan::of_scene(coarse)?;
        let sections = OnlineSections { plan, frame: full.record.grid, sampling: stage.sampling, settings };
        Ok((sections, bytes))
    }
}

/// A checksum of all that decides an online stage's samples.
fn fingerprint(sections: &OnlineSections) -> Result<u32> {
    // How far the producer may be ahead changes nothing.
    let settings = OnlineSettings { lead: 0, ..sections.settings };
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&sections.plan.obstacle().packed());
    let tool = sections.plan.tool();
    hasher.update(&serde_json::to_vec(&(sections.plan.grid(), tool, sections.sampling, settings))?);
    Ok(hasher.finalize())
}

/// Where a stage stands.
enum Standing {
    Finished(Box<Model>),
    At(Box<Model>),
}

/// The stage's finished model, its checkpoint, or `fresh`, whichever belongs to the same training and is farthest.
fn standing(session: &Session, folder: &Path, fresh: Model) -> Standing {
    let same = |found: &Model| {
        let (found, record) = ((found.shape, &found.scene.record, &found.record), &fresh.record);
        found.0 == fresh.shape
            && *found.1 == fresh.scene.record
            && found.2.plan == record.plan
            && found.2.dataset_crc32 == record.dataset_crc32
            && found.2.sampling == record.sampling
            && found.2.fine_tuned_from == record.fine_tuned_from
    };
    let read = |name: &str| Model::read(&folder.join(name)).ok().filter(same);
    if let Some(model) = read(job::MODEL).filter(|model| model.record.finished) {
        session.note(&format!("finished already: {} steps", model.record.steps));
        return Standing::Finished(Box::new(model));
    }
    match job::latest(folder).ok().filter(|found| same(&found.model) && found.model.is_resumable()) {
        Some(job::Latest { model, damage, .. }) => {
            damage.iter().for_each(|damage| session.warn(damage));
            session.note(&format!(
                "going on at epoch {}, step {} ({} steps done)",
                model.record.cursor.epoch, model.record.cursor.step, model.record.steps
            ));
            Standing::At(Box::new(model))
        }
        None => Standing::At(Box::new(fresh)),
    }
}

fn read_waits(path: &Path) -> Option<Waits> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}
