//! `imf-bench recipe`: trainings of one or several stages, described by a file, each run by one command.
//!
//! ```text
//! OUT/recipe.toml               what is run, recipe and changes together: run it again with `imf-bench recipe run`
//! OUT/datasets/NAME-…/          one for each different set of sections
//! OUT/stages/NAME/              checkpoint, model, log; for results the report with its pictures
//! OUT/model.safetensors         the first result
//! OUT/VARIANT/…                 a sweep has stages and model for each variant
//! OUT/cells/                    what the results are worth, keyed by what they were made of
//! OUT/recipe.md, recipe.json    stages and results of all variants; loss.png
//! ```
//!
//! A folder is of one recipe: another one, or the same with changes, is refused. Whatever was interrupted, the same
//! command goes on: datasets keep their shards, finished stages are known by their settings and by the weights that
//! they started from, an unfinished one continues from its checkpoint. What can be known before the first training
//! begins is checked there.

mod definition;
mod evaluation_sets;
mod scenes;
mod source;
mod stage;
mod summary;
#[cfg(test)]
mod tests;

pub(crate) use definition::{Recipe, SceneSettings, Stage};
pub(crate) use evaluation_sets::{Answer, EvaluationSets, RANDOM};
pub(crate) use scenes::Scenes;
pub(crate) use source::{Source, built_in};
pub(crate) use stage::Runner;
pub(crate) use summary::{Outcome, RunSummary, Summary};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clap::{Args, Subcommand};
use imf_cli::arguments::DeviceArguments;
use imf_cli::engine::Device;
use imf_cli::job::weights_crc32;
use imf_cli::output::{OutputFolder, lock_folder, prepare_folder, print, print_json, write_text};
use imf_cli::progress::show_seconds;
use imf_cli::session::Session;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::section::SectionPlan;
use imf_fields::model::Model;
use imf_fields::recipe::TrainingState;
use serde_json::json;

use crate::cells::Cells;
use source::BUILT_IN;

/// Train by a recipe: a built-in one or a file that says scene, network, stages and sweep
#[derive(Args)]
pub(crate) struct RecipeArguments {
    #[command(subcommand)]
    command: RecipeCommand,
}

#[derive(Subcommand)]
enum RecipeCommand {
    /// List the built-in recipes
    #[command(after_help = "Example:\n  imf-bench recipe list")]
    List,
    Show(ShowArguments),
    Run(RunArguments),
}

/// Print a built-in recipe's file, to read or to change
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf-bench recipe show single > mine.toml\n  imf-bench recipe run mine.toml --out mine"
)]
struct ShowArguments {
    /// Name of the recipe
    name: String,
}

/// Run a recipe: datasets, every stage, evaluation, report and loss curve in one folder; continues what was interrupted
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench recipe run single --part teapot --out single\n  \
                        imf-bench recipe run multi --scale 0.5 --set network.width=128 --set 'stage.*.training.batch=512' \
                        --out trial\n  imf-bench recipe run mine.toml --out mine\n\n\
                        Writes recipe.toml (what was run), datasets, stages, model.safetensors, recipe.md, recipe.json \
                        and loss.png. After Ctrl-C or a crash the same command goes on, to the same weights. Another recipe, or \
                        a changed one, needs another folder.")]
struct RunArguments {
    /// A built-in recipe (imf-bench recipe list) or a file
    recipe: String,
    /// Part: a mesh file or a built-in part; sets scene.part
    #[arg(long, value_name = "PART")]
    part: Option<String>,
    /// Tool file, or paper; sets scene.tool
    #[arg(long, value_name = "TOOL")]
    tool: Option<String>,
    /// Voxels along each axis relative to the recipe's, such as 0.5; sets scene.scale
    #[arg(long, value_name = "FACTOR")]
    scale: Option<f64>,
    /// Change a value, such as network.width=128 or stage.*.training.length.epochs=5; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = imf_cli::arguments::parse_seconds)]
    checkpoint_every: f64,
    /// Poses at random orientations that training never sees, to watch the error of every stage at; 0 for none
    #[arg(long, default_value_t = 16_384, value_name = "N")]
    held_out: usize,
    #[command(flatten)]
    device: DeviceArguments,
}

/// What to do after an interruption.
pub(crate) const GO_ON: &str = "run the same command again";

pub(crate) fn run(session: &Session, arguments: &RecipeArguments) -> Result<()> {
    match &arguments.command {
        RecipeCommand::List => list(session),
        RecipeCommand::Show(arguments) => print(built_in(&arguments.name)?),
        RecipeCommand::Run(arguments) => run_recipe(session, arguments),
    }
}

fn list(session: &Session) -> Result<()> {
    let recipes =
        BUILT_IN.iter().map(|(_, text)| Source::parse(text)?.recipe()).collect::<Result<Vec<_>>>()?;
    if session.json {
        let all: Vec<_> = recipes.iter().map(|r| json!({"name": r.name, "about": r.about})).collect();
        return print_json(&all);
    }
    let lines: Vec<String> = recipes.iter().map(|r| format!("{:<13} {}", r.name, r.about)).collect();
    print(&lines.join("\n"))
}

fn run_recipe(session: &Session, arguments: &RunArguments) -> Result<()> {
    let begun = Instant::now();
    let source = changed(arguments).with_context(|| format!("the recipe {}", arguments.recipe))?;
    OutputFolder::check(&arguments.out)?;
    let _lock = lock_folder(&arguments.out)?;
    let device = Device::open(&arguments.device.device, session)?;
    let runner = Runner {
        session,
        device: &device,
        checkpoint_every: arguments.checkpoint_every,
        held_out: arguments.held_out,
        datasets: arguments.out.join("datasets"),
    };
    let summary = runner.run(&source, &arguments.out)?;
    if session.json {
        return print_json(&summary);
    }
    print(&format!(
        "\n{}\n{} holds recipe.md, loss.png, stages and models; {} in all.",
        summary.document().columns(),
        arguments.out.display(),
        show_seconds(begun.elapsed().as_secs_f64())
    ))
}

/// The recipe with the changes that the command line asks for.
fn changed(arguments: &RunArguments) -> Result<Source> {
    let mut source = Source::open(&arguments.recipe)?;
    let mut changes = Vec::new();
    for (path, value) in [("scene.part", &arguments.part), ("scene.tool", &arguments.tool)] {
        if let Some(value) = value {
            source.set(path, value.as_str())?;
            changes.push(format!("{path}={value}"));
        }
    }
    if let Some(scale) = arguments.scale {
        source.set("scene.scale", scale)?;
        changes.push(format!("scene.scale={scale}"));
    }
    arguments.set.iter().try_for_each(|text| source.assign(text))?;
    changes.extend(arguments.set.iter().cloned());
    let says_itself = changes.iter().any(|change| change.starts_with("about="));
    if !changes.is_empty() && !says_itself {
        // What it is about was said of the recipe as it was.
        let about = source.recipe()?.about;
        source.set("about", format!("{about} (changed: {})", changes.join(" ")))?;
    }
    ensure!(
        arguments.part.is_none() || source.recipe()?.stages.iter().any(|stage| stage.part.is_none()),
        "every stage names its own part: change it with --set stage.NAME.part=…"
    );
    Ok(source)
}

impl Runner<'_> {
    /// Runs a recipe with all its variants in a folder of its own, or goes on with it there.
    pub(crate) fn run(&self, source: &Source, out: &Path) -> Result<Summary> {
        let (recipe, text) = (source.recipe()?, source.text()?);
        let mut runs = Vec::new();
        for (variant, source) in source.variants()? {
            let folder = if variant.is_empty() { out.to_owned() } else { out.join(&variant) };
            runs.push((variant, source.recipe()?, folder));
        }
        let file = require_own(out, &text)?;
        let mut scenes = Scenes::default();
        for (variant, recipe, _) in &runs {
            for stage in &recipe.stages {
                let of = if variant.is_empty() { String::new() } else { format!("variant {variant}, ") };
                let named = || format!("{of}stage {}", stage.name);
                self.check(recipe, stage, &mut scenes).with_context(named)?;
            }
        }
        prepare_folder(out)?;
        write_text(&file, &text)?;
        let cells = Cells::new(self.session, self.device, out)?;
        let runs = runs.iter().map(|(variant, recipe, folder)| {
            if !variant.is_empty() {
                self.session.note(&format!("variant {variant}:"));
            }
            self.run_variant(variant, recipe, folder, &cells, &mut scenes)
        });
        let summary = Summary::new(&recipe, runs.collect::<Result<_>>()?);
        summary.write(out)?;
        Ok(summary)
    }

    /// Makes a stage's scenes, and refuses what would end it later.
    fn check(&self, recipe: &Recipe, stage: &Stage, scenes: &mut Scenes) -> Result<()> {
        let [full, coarse] = self.scenes(recipe, stage, scenes)?;
        self.require_memory(stage, recipe.network.shape(), [&full, &coarse])?;
        if recipe.results().any(|result| result.name == stage.name) {
            self.require_memory_of_report(&full.record)?;
        }
        Ok(())
    }

    /// The scene that a stage's network is of, and the one that its sections are of.
    fn scenes(&self, recipe: &Recipe, stage: &Stage, scenes: &mut Scenes) -> Result<[Scene; 2]> {
        let part = stage.part.as_deref();
        let mut get = |resolution| scenes.get(self.session, &recipe.scene, part, resolution);
        Ok([get(1.0)?, get(stage.resolution)?])
    }

    /// The stages of a variant, and the errors of its results.
    fn run_variant(
        &self,
        variant: &str,
        recipe: &Recipe,
        folder: &Path,
        cells: &Cells<'_>,
        scenes: &mut Scenes,
    ) -> Result<RunSummary> {
        let (shape, seed) = (recipe.network.shape(), recipe.network.seed);
        let mut summary = RunSummary::new(variant);
        let mut models: BTreeMap<&str, Model> = BTreeMap::new();
        for stage in &recipe.stages {
            self.session.note(&format!("stage {}:", stage.name));
            let [full, coarse] = self.scenes(recipe, stage, scenes)?;
            let start = match models.get(stage.start.as_str()) {
                None => (TrainingState::new(&shape, seed), None),
                Some(earlier) => {
                    let parameters = earlier.state.parameters.clone();
                    // The checksum lets a stage that started from other weights be noticed.
                    let (part, mark) = (&earlier.scene.record.part, weights_crc32(&parameters));
                    let from = format!("{part} (stage {}, {mark:08x})", stage.start);
                    (TrainingState::from_parameters(parameters), Some(from))
                }
            };
            let trained = self.train(stage, shape, [&full, &coarse], start, &stage_folder(folder, stage))?;
            summary.add(stage, coarse.record.grid.dims, &trained);
            models.insert(&stage.name, trained);
        }
        for stage in recipe.results() {
            let evaluation_sets = EvaluationSets::of_result(recipe, stage)?;
            let model = &models[stage.name.as_str()];
            if summary.results.is_empty() {
                model.write(&folder.join("model.safetensors"))?;
            }
            self.require_memory_of_report(&model.scene.record)?;
            let key =
                (&recipe.evaluation, shape, &model.scene.record, weights_crc32(&model.state.parameters));
            let name = summary::name(variant, &stage.name).replace(", ", "-");
            let answers = cells.get(&name, &key, || {
                evaluation_sets.report(self.session, self.device, model, &stage_folder(folder, stage))
            })?;
            let parameters = shape.parameter_count();
            summary.results.push(Outcome { stage: stage.name.clone(), parameters, answers: answers.value });
        }
        Ok(summary)
    }

    /// Refuses the comparison of a scene's exact field with a learnt one where it would not fit.
    fn require_memory_of_report(&self, record: &SceneRecord) -> Result<()> {
        let threads = self.session.threads();
        let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, threads)
            + 40 * record.grid.len() as u64 * threads as u64;
        self.session
            .require_memory(needed, || "the exact field beside the learnt one; use fewer --threads".into())
    }
}

fn stage_folder(folder: &Path, stage: &Stage) -> PathBuf {
    folder.join("stages").join(&stage.name)
}

/// Refuses a folder of another recipe; gives the file that says whose it is.
fn require_own(out: &Path, text: &str) -> Result<PathBuf> {
    let file = out.join("recipe.toml");
    if !file.exists() {
        return Ok(file);
    }
    let found = std::fs::read_to_string(&file)
        .with_context(|| format!("cannot read {}; choose another --out", file.display()))?;
    // What it is about names every change beside its own: it is shown where nothing else differs.
    let differing = || found.lines().zip(text.lines()).filter(|(there, here)| there != here);
    let own = differing().find(|(there, _)| !there.starts_with("about = "));
    let (there, here) = own.or_else(|| differing().next()).unwrap_or_default();
    ensure!(
        found == text,
        "{} is the folder of another recipe ({there} there, {here} here): choose another --out, or remove it",
        out.display()
    );
    Ok(file)
}
