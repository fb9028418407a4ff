//! What can be known before the first training begins: that every part and tool is there, that nothing in the folder would
//! be overwritten, and that the memory suffices for every stage of every variant.

use anyhow::{Context as _, Result, bail};
use imf_cli::job::Footprint;
use imf_core::orientation::OrientationSet;
use imf_core::scene::Scene;

use super::kept::{Found, Training};
use super::scenes::Scenes;
use super::stage::{Workshop, online_memory};
use super::{Run, claim, results};
use crate::recipe::Stage;

/// Checks runs that are to come; their scenes are kept for them.
///
/// # Errors
/// Whatever would end one of them later, naming variant and stage.
pub(super) fn check<'r>(workshop: &Workshop<'_>, runs: impl Iterator<Item = &'r Run>) -> Result<Scenes> {
    let runs: Vec<&Run> = runs.collect();
    // What needs no scene is known at once.
    runs.iter().try_for_each(|run| claim::check(run))?;
    let mut scenes = Scenes::default();
    for run in runs {
        for stage in &run.recipe.stages {
            check_stage(workshop, run, stage, &mut scenes).with_context(|| run.named(&stage.name))?;
        }
    }
    Ok(scenes)
}

fn check_stage(workshop: &Workshop<'_>, run: &Run, stage: &Stage, scenes: &mut Scenes) -> Result<()> {
    let session = workshop.session;
    let settings = &run.recipe.scene;
    let full = scenes.full(session, settings, stage)?;
    let coarse = scenes.of_sections(session, settings, stage)?;
    let (shape, plan) = (run.recipe.network.shape(), stage.plan());
    let (samples, beside) = samples(&coarse, stage)?;
    let scene = &full.record;
    let training = Training { shape, scene, plan: &plan, sampling: &stage.sampling, samples_and_start: None };
    let held_out = match training.find(&run.stage_folder(&stage.name))? {
        Found::Finished(_) => None,
        Found::Checkpoint(found) => Some(found.model.record.held_out.map_or(0, |held| held.choice.poses)),
        Found::Nothing => Some(workshop.settings.held_out),
    };
    if let Some(held_out) = held_out {
        require_memory(workshop, &training, samples, held_out, beside)?;
    }
    if run.recipe.results().any(|result| result.name == stage.name) {
        results::require_memory(session, scene)?;
    }
    Ok(())
}

/// The samples of an epoch, and the bytes of those that are not read from files.
fn samples(coarse: &Scene, stage: &Stage) -> Result<(usize, u64)> {
    let voxels = coarse.record.grid.len();
    if let Some(online) = &stage.online {
        if !coarse.record.bare_tool().with_tip_only().is_axisymmetric() {
            bail!("an online stage needs a tool that is the same all around its axis");
        }
        return Ok((
            online.pool * stage.sampling.count(voxels),
            online_memory(&coarse.record, stage, online),
        ));
    }
    let set = directions(stage)?;
    Ok((set.len() * stage.sampling.count(voxels), 0))
}

/// The directions of a stage with a fixed set.
pub(super) fn directions(stage: &Stage) -> Result<OrientationSet> {
    let spec = stage.orientations.as_deref().context("a stage without orientations")?;
    let set = OrientationSet::parse(spec)?;
    if set.orientations.iter().any(|o| o.roll != 0.0) {
        bail!("'{spec}' rolls the tool about its own axis, which siren5's five inputs cannot express");
    }
    Ok(set)
}

/// Refuses a training that would not fit. Samples in files may be read in groups, so they are asked for when they are there.
fn require_memory(
    workshop: &Workshop<'_>,
    training: &Training<'_>,
    samples: usize,
    held_out: usize,
    beside: u64,
) -> Result<()> {
    let Training { shape, scene, plan, .. } = training;
    let batch = plan.batch.min(samples.max(1));
    let (session, device) = (workshop.session, workshop.device);
    let footprint = Footprint::new(session, device, *shape, plan, scene, batch, held_out)?;
    footprint.require(session, beside).context(
        "--width and --batch are network.width and training.batch in a recipe, to be changed with --set",
    )
}
