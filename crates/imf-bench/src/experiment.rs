//! `imf-bench recipe`: trainings of one or several stages, described by a file, each run by one command.
//!
//! ```text
//! OUT/recipe.toml              what is run, recipe and changes together: run it again with `imf-bench recipe run`
//! OUT/datasets/NAME-…/         one for each different set of sections
//! OUT/stages/NAME/             settings, checkpoint, model, log; for results the report with its pictures
//! OUT/model.safetensors        the first result
//! OUT/recipe.md, recipe.json   stages, results; loss.png
//! OUT/former/N/                the same of a recipe that was changed since
//! OUT/VARIANT/…                a sweep has all of this for each variant, and sweep.md, sweep.json, loss.png for all
//! ```
//!
//! Whatever stage was interrupted, the same command goes on: datasets keep their shards, finished stages are known by
//! their settings and by the weights that they started from, an unfinished one continues from its checkpoint. So does a
//! changed recipe in the same folder, as long as no stage would be overwritten by one of other settings (`claim`). What can
//! be known before the first training begins is (`ready`).

mod claim;
mod kept;
mod ready;
mod results;
mod scenes;
mod stage;
mod summary;
mod sweep;
mod tally;

use std::path::{Path, PathBuf};
use std::time::Instant;

pub(crate) use results::{Outcome, interruption};
pub(crate) use scenes::Scenes;
pub(crate) use stage::Workshop;
pub(crate) use summary::Summary;

use anyhow::{Context as _, Result, bail};
use imf_cli::engine::Device;
use imf_cli::job::Settings;
use imf_cli::output::{OutputFolder, print, print_json};
use imf_cli::progress::show_seconds;
use imf_cli::session::Session;
use serde_json::json;

use crate::arguments::recipe::{RecipeArguments, RecipeCommand, RunArguments};
use crate::recipe::{self, BUILT_IN, Recipe, built_in};

/// What to do after an interruption.
pub(crate) const GO_ON: &str = "run the same command again";

pub(crate) fn run(session: &Session, arguments: &RecipeArguments) -> Result<()> {
    match &arguments.command {
        RecipeCommand::List => list(session),
        RecipeCommand::Show(arguments) => print(built_in(&arguments.name)?.text),
        RecipeCommand::Run(arguments) => run_recipe(session, arguments),
    }
}

fn list(session: &Session) -> Result<()> {
    let recipes = BUILT_IN.iter().map(|p| Recipe::parse(p.text)).collect::<Result<Vec<_>, _>>()?;
    if session.json {
        let all: Vec<_> = recipes.iter().map(|r| json!({"name": r.name, "about": r.about})).collect();
        return print_json(&all);
    }
    let lines: Vec<String> = recipes.iter().map(|r| format!("{:<13} {}", r.name, r.about)).collect();
    print(&lines.join("\n"))
}

fn run_recipe(session: &Session, arguments: &RunArguments) -> Result<()> {
    let begun = Instant::now();
    let table = table(arguments)?;
    let runs = recipe::runs(&table)?;
    let runs = runs.into_iter().map(|(variant, own)| Run::new(variant, own, &arguments.out));
    let runs = runs.collect::<Result<Vec<_>>>()?;
    OutputFolder::check(&arguments.out)?;
    let _claim = imf_cli::output::claim(&arguments.out)?;
    let device = Device::open(&arguments.device.device, session)?;
    let workshop = Workshop {
        session,
        device: &device,
        settings: Settings {
            checkpoint_every: arguments.checkpoint_every,
            go_on: GO_ON,
            slower: " with another --out and --set stage.*.training.schedule.initial=",
            held_out: arguments.held_out,
            held_out_every: None,
        },
        datasets: arguments.out.join("datasets"),
    };
    // The only run of its folder is gone through again, variants that came to their end are read.
    let is_read = |run: &Run| run.variant.is_some() && claim::is_finished(run);
    let mut scenes = ready::check(&workshop, runs.iter().filter(|run| !is_read(run)))?;
    if let [run @ Run { variant: None, .. }] = runs.as_slice() {
        claim::take(session, &run.out, &run.table)?;
        let summary = run_once(&workshop, run, &mut scenes)?;
        if session.json {
            return print_json(&summary);
        }
        return print(&format!(
            "\n{}\n{} holds model.safetensors, recipe.md, loss.png and the stages; {} in all.",
            summary.text(),
            arguments.out.display(),
            show_seconds(begun.elapsed().as_secs_f64())
        ));
    }
    sweep::run(&workshop, &table, &runs, &mut scenes, &arguments.out)
}

/// The recipe's table with the changes that the command line asks for.
fn table(arguments: &RunArguments) -> Result<toml::Table> {
    let name = &arguments.recipe;
    let path = Path::new(name);
    // A file of that name wins over a built-in recipe, as with parts.
    let text = if path.is_file() {
        std::fs::read_to_string(path).with_context(|| format!("cannot read the recipe {name}"))?
    } else if name.contains(['/', '\\', '.']) {
        bail!("there is no recipe file {name}; the built-in ones are listed by: imf-bench recipe list");
    } else {
        built_in(name)?.text.to_owned()
    };
    let mut table = recipe::table(&text).with_context(|| format!("the recipe {name}"))?;
    if let Some(part) = &arguments.part {
        recipe::set(&mut table, "scene.part", part.as_str().into())?;
    }
    if let Some(tool) = &arguments.tool {
        recipe::set(&mut table, "scene.tool", tool.as_str().into())?;
    }
    if let Some(scale) = arguments.scale {
        recipe::set(&mut table, "scene.scale", scale.into())?;
    }
    for text in &arguments.set {
        let (path, value) = recipe::assignment(text)?;
        recipe::set(&mut table, &path, value)?;
    }
    let recipe = Recipe::from_table(table.clone()).with_context(|| format!("the recipe {name}"))?;
    if arguments.part.is_some() && recipe.stages.iter().all(|stage| stage.part.is_some()) {
        bail!("every stage of {name} names its own part: change it with --set stage.NAME.part=…");
    }
    Ok(table)
}

/// A recipe without variants, and the folder that it is run in.
pub(crate) struct Run {
    /// Of a sweep.
    variant: Option<String>,
    table: toml::Table,
    recipe: Recipe,
    out: PathBuf,
}

impl Run {
    /// A recipe run in `out`, or a variant of it in a folder there.
    fn new(variant: Option<String>, table: toml::Table, out: &Path) -> Result<Self> {
        let recipe = Recipe::from_table(table.clone())?;
        let out = variant.as_ref().map_or_else(|| out.to_owned(), |variant| out.join(variant));
        Ok(Self { variant, table, recipe, out })
    }

    fn stage_folder(&self, stage: &str) -> PathBuf {
        self.out.join("stages").join(stage)
    }

    /// A stage in words.
    fn named(&self, stage: &str) -> String {
        self.variant.as_ref().map_or_else(String::new, |variant| format!("variant {variant}, "))
            + &format!("stage {stage}")
    }
}

/// Runs a recipe without variants in a folder of its own; one that came to its end there is only read.
pub(crate) fn run_or_read(workshop: &Workshop<'_>, table: &toml::Table, out: &Path) -> Result<Summary> {
    let run = Run::new(None, table.clone(), out)?;
    let mut scenes = ready::check(workshop, Some(&run).into_iter().filter(|run| !claim::is_finished(run)))?;
    go_on_or_read(workshop, &run, &mut scenes)
}

/// As [`run_or_read`], of a run that was checked.
fn go_on_or_read(workshop: &Workshop<'_>, run: &Run, scenes: &mut Scenes) -> Result<Summary> {
    claim::take(workshop.session, &run.out, &run.table)?;
    let Some(mut summary) = Summary::read(&run.out) else { return run_once(workshop, run, scenes) };
    workshop.session.note("finished already");
    if summary.retitle(&run.recipe) {
        summary.write(&run.out)?;
    }
    Ok(summary)
}

/// Runs one recipe without variants: its stages, its results, its report.
fn run_once(workshop: &Workshop<'_>, run: &Run, scenes: &mut Scenes) -> Result<Summary> {
    let (recipe, out) = (&run.recipe, &run.out);
    let mut finished = Vec::new();
    for stage in &recipe.stages {
        let done = workshop.run(run, stage, scenes, &finished)?;
        finished.push(done);
    }
    let results = results::evaluate(workshop, recipe, &finished, out)?;
    let summary = Summary::new(recipe, &finished, results);
    summary.write(out)?;
    Ok(summary)
}
