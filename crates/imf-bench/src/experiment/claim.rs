//! Whose folder it is: what a recipe finds in its folder is its own, kept, or a reason to stop.
//!
//! `stages/NAME/settings.json` says by what a stage was trained. A folder is taken over by a changed recipe where no stage
//! that was trained there would be trained again by other settings; those of the same settings go on being finished. Reports
//! of the former recipe are put aside, so that nobody takes them for the changed one's:
//!
//! ```text
//! OUT/former/1/    recipe.toml, and what it came to: recipe.json, recipe.md, sweep.json, sweep.md, loss.png, model.safetensors
//! ```

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use imf_cli::output::{prepare_folder, write_json, write_text};
use imf_cli::session::Session;
use imf_fields::recipe::OnlineSettings;
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingPlan;
use serde::{Deserialize, Serialize};

use super::{Run, Summary};
use crate::recipe::{self, NetworkSettings, RANDOM_START, Recipe, SceneSettings, Stage};

const RECIPE: &str = "recipe.toml";
const SETTINGS: &str = "settings.json";
/// What a recipe came to, the file first that says that it came to its end.
const REPORTS: [&str; 6] =
    ["recipe.json", "sweep.json", "recipe.md", "sweep.md", "loss.png", "model.safetensors"];

/// All settings that decide what a stage comes to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StageSettings {
    network: NetworkSettings,
    /// With the stage's own part.
    scene: SceneSettings,
    resolution: f64,
    orientations: Option<String>,
    /// Without the producer's lead, which changes nothing.
    online: Option<OnlineSettings>,
    sampling: Sampling,
    /// With the rate rule applied.
    training: TrainingPlan,
    start: String,
    /// Those of the stage that it starts from.
    from: Option<Box<Self>>,
}

impl StageSettings {
    pub(super) fn of(recipe: &Recipe, stage: &Stage) -> Self {
        let part = stage.part.as_ref().unwrap_or(&recipe.scene.part).clone();
        // The start is an earlier stage, so this comes to an end.
        let earlier = recipe.stages.iter().find(|earlier| earlier.name == stage.start);
        Self {
            network: recipe.network,
            scene: SceneSettings { part, ..recipe.scene.clone() },
            resolution: stage.resolution,
            orientations: stage.orientations.clone(),
            online: stage.online.map(|online| OnlineSettings { lead: 0, ..online }),
            sampling: stage.sampling,
            training: stage.plan(),
            start: stage.start.clone(),
            from: earlier
                .filter(|_| stage.start != RANDOM_START)
                .map(|earlier| Box::new(Self::of(recipe, earlier))),
        }
    }

    fn read(folder: &Path) -> Option<Self> {
        serde_json::from_str(&fs::read_to_string(folder.join(SETTINGS)).ok()?).ok()
    }

    /// Writes down by what the stage of a folder is trained.
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(SETTINGS), self)
    }

    /// Names of the settings that are others than in `kept`.
    fn differences(&self, kept: &Self) -> Result<Vec<String>> {
        let (own, kept) = (serde_json::to_value(self)?, serde_json::to_value(kept)?);
        let Some(own) = own.as_object() else { return Ok(Vec::new()) };
        let other = own.iter().filter(|(key, value)| kept.get(key) != Some(value)).map(|(key, _)| key);
        let words = |key: &String| if key == "from" { "settings of its start".into() } else { key.clone() };
        Ok(other.map(words).collect())
    }
}

/// True where a stage's folder holds a model or a checkpoint.
pub(super) fn holds_training(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| entry.path().extension().is_some_and(|e| e == "safetensors"))
}

/// Refuses to overwrite what stages were trained to by other settings. Only reads.
pub(super) fn check(run: &Run) -> Result<()> {
    let former = former(&run.out);
    let mut others = Vec::new();
    for stage in &run.recipe.stages {
        let folder = run.stage_folder(&stage.name);
        if !holds_training(&folder) {
            continue;
        }
        // Folders of older programs have no settings beside their stages.
        let of_former = || {
            let (_, recipe) = former.as_ref()?;
            let same_name = recipe.stages.iter().find(|earlier| earlier.name == stage.name)?;
            Some(StageSettings::of(recipe, same_name))
        };
        let what = match StageSettings::read(&folder).or_else(of_former) {
            Some(kept) => StageSettings::of(&run.recipe, stage).differences(&kept)?.join(", "),
            None => "settings that are written down nowhere".into(),
        };
        if !what.is_empty() {
            others.push((format!("{} ({what})", run.named(&stage.name)), folder.display().to_string()));
        }
    }
    if others.is_empty() {
        return Ok(());
    }
    let (stages, folders): (Vec<String>, Vec<String>) = others.into_iter().unzip();
    bail!(
        "{} holds what was trained by other settings and would be overwritten: {}; choose another --out, or remove {}",
        run.out.display(),
        stages.join(", "),
        folders.join(" and ")
    )
}

/// Writes down what the folder is for from now on, and puts the reports of another recipe aside.
pub(super) fn take(session: &Session, out: &Path, table: &toml::Table) -> Result<()> {
    prepare_folder(out)?;
    let path = out.join(RECIPE);
    let text = toml::to_string(table).context("the recipe cannot be written down")?;
    let found = match fs::read_to_string(&path) {
        Ok(found) if found == text => return Ok(()),
        Ok(found) => found,
        Err(error) if error.kind() == ErrorKind::NotFound => return write_text(&path, &text),
        Err(error) => {
            let cannot = format!("cannot read {}; choose another --out, or remove it", path.display());
            return Err(error).context(cannot);
        }
    };
    let mut aside = None;
    match former(out) {
        Some((former, recipe)) => {
            keep_settings(out, &recipe)?;
            if outcome(&former) != outcome(table) {
                aside = put_aside(out, &found)?;
            }
        }
        None => aside = put_aside(out, &found)?,
    }
    write_text(&path, &text)?;
    let aside = aside.map_or_else(String::new, |folder| format!("; its report is in {}", folder.display()));
    session.note(&format!(
        "{} described another recipe, or other settings of it: finished stages with the same settings are kept{aside}",
        path.display()
    ));
    Ok(())
}

/// True where a recipe came to its end in its folder, by settings that come to the same.
pub(super) fn is_finished(run: &Run) -> bool {
    former(&run.out).is_some_and(|(former, _)| outcome(&former) == outcome(&run.table))
        && Summary::read(&run.out).is_some()
}

/// The recipe that a folder was last used for, where it can be read.
fn former(out: &Path) -> Option<(toml::Table, Recipe)> {
    let table = recipe::table(&fs::read_to_string(out.join(RECIPE)).ok()?).ok()?;
    let recipe = Recipe::from_table(table.clone()).ok()?;
    Some((table, recipe))
}

/// All that decides a recipe's results: not its name, nor what it says about itself.
fn outcome(table: &toml::Table) -> Option<serde_json::Value> {
    let mut all = Vec::new();
    for (variant, own) in recipe::runs(table).ok()? {
        let recipe = Recipe::from_table(own).ok()?;
        let stages = recipe.stages.iter().map(|stage| (&stage.name, StageSettings::of(&recipe, stage)));
        let stages: Vec<_> = stages.collect();
        all.push(serde_json::to_value((variant, stages, &recipe.evaluation)).ok()?);
    }
    Some(all.into())
}

/// Writes down by what the stages of an older program's folder were trained, before its recipe is forgotten.
fn keep_settings(out: &Path, former: &Recipe) -> Result<()> {
    for stage in &former.stages {
        let folder = out.join("stages").join(&stage.name);
        if holds_training(&folder) && StageSettings::read(&folder).is_none() {
            StageSettings::of(former, stage).write(&folder)?;
        }
    }
    Ok(())
}

/// Moves a former recipe's reports to a folder of their own, if there are any, and names it.
fn put_aside(out: &Path, recipe: &str) -> Result<Option<PathBuf>> {
    if !REPORTS.iter().any(|name| out.join(name).exists()) {
        return Ok(None);
    }
    let numbered = |number: u32| out.join("former").join(number.to_string());
    let folder = (1..).map(numbered).find(|folder| !folder.exists());
    let folder = folder.context("no number is left for another former recipe: remove some of them")?;
    prepare_folder(&folder)?;
    write_text(&folder.join(RECIPE), recipe)?;
    for name in REPORTS.into_iter().filter(|name| out.join(name).exists()) {
        fs::rename(out.join(name), folder.join(name)).with_context(|| {
            format!("cannot move {name} to {}: make it writable, or choose another --out", folder.display())
        })?;
    }
    Ok(Some(folder))
}
