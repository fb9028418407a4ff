//! `imf regime`: trainings of one or several stages, described by a file, each run by one command.
//!
//! ```text
//! OUT/regime.toml              what is run, presets and changes together: run it again with `imf regime run`
//! OUT/datasets/NAME-…/         one for each different set of sections
//! OUT/stages/NAME/             settings, checkpoint, model, log; for results the report with its pictures
//! OUT/model.safetensors        the first result
//! OUT/regime.md, regime.json   stages, results; loss.png
//! OUT/former/N/                the same of a regime that was changed since
//! OUT/VARIANT/…                a sweep has all of this for each variant, and sweep.md, sweep.json, loss.png for all
//! ```
//!
//! Whatever stage was interrupted, the same command goes on: datasets keep their shards, finished stages are known by
//! their settings and by the weights that they started from, an unfinished one continues from its checkpoint. So does a
//! changed regime in the same folder, as long as no stage would be overwritten by one of other settings (`claim`). What can
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
use imf_core::regime::{self, PRESETS, Regime, preset};
use serde_json::json;

use crate::arguments::regime::{RegimeArguments, RegimeCommand, RunArguments};
use crate::engine::Device;
use crate::job::Settings;
use crate::output::{OutputFolder, print, print_json};
use crate::progress::show_seconds;
use crate::session::Session;

/// What to do after an interruption.
pub(crate) const GO_ON: &str = "run the same command again";

pub(crate) fn run(session: &Session, arguments: &RegimeArguments) -> Result<()> {
    match &arguments.command {
        RegimeCommand::List => list(session),
        RegimeCommand::Show(arguments) => print(preset(&arguments.name)?.text),
        RegimeCommand::Run(arguments) => run_regime(session, arguments),
    }
}

fn list(session: &Session) -> Result<()> {
    let regimes = PRESETS.iter().map(|p| Regime::parse(p.text)).collect::<Result<Vec<_>, _>>()?;
    if session.json {
        let all: Vec<_> = regimes.iter().map(|r| json!({"name": r.name, "about": r.about})).collect();
        return print_json(&all);
    }
    let lines: Vec<String> = regimes.iter().map(|r| format!("{:<13} {}", r.name, r.about)).collect();
    print(&lines.join("\n"))
}

fn run_regime(session: &Session, arguments: &RunArguments) -> Result<()> {
    let begun = Instant::now();
    let table = table(arguments)?;
    let runs = regime::runs(&table)?;
    let runs = runs.into_iter().map(|(variant, own)| Run::new(variant, own, &arguments.out));
    let runs = runs.collect::<Result<Vec<_>>>()?;
    OutputFolder::check(&arguments.out)?;
    let _claim = crate::output::claim(&arguments.out)?;
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
            log: None,
            tensorboard: arguments.tensorboard,
        },
        log: arguments.log,
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
            "\n{}\n{} holds model.safetensors, regime.md, loss.png and the stages; {} in all.",
            summary.text(),
            arguments.out.display(),
            show_seconds(begun.elapsed().as_secs_f64())
        ));
    }
    sweep::run(&workshop, &table, &runs, &mut scenes, &arguments.out)
}

/// The regime's table with the changes that the command line asks for.
fn table(arguments: &RunArguments) -> Result<toml::Table> {
    let name = &arguments.regime;
    let path = Path::new(name);
    // A file of that name wins over a preset, as with parts.
    let text = if path.is_file() {
        std::fs::read_to_string(path).with_context(|| format!("cannot read the regime {name}"))?
    } else if name.contains(['/', '\\', '.']) {
        bail!("there is no regime file {name}; the presets are listed by: imf regime list");
    } else {
        preset(name)?.text.to_owned()
    };
    let mut table = regime::table(&text).with_context(|| format!("the regime {name}"))?;
    if let Some(part) = &arguments.part {
        regime::set(&mut table, "scene.part", part.as_str().into())?;
    }
    if let Some(tool) = &arguments.tool {
        regime::set(&mut table, "scene.tool", tool.as_str().into())?;
    }
    if let Some(scale) = arguments.scale {
        regime::set(&mut table, "scene.scale", scale.into())?;
    }
    for text in &arguments.set {
        let (path, value) = regime::assignment(text)?;
        regime::set(&mut table, &path, value)?;
    }
    let regime = Regime::from_table(table.clone()).with_context(|| format!("the regime {name}"))?;
    if arguments.part.is_some() && regime.stages.iter().all(|stage| stage.part.is_some()) {
        bail!("every stage of {name} names its own part: change it with --set stage.NAME.part=…");
    }
    Ok(table)
}

/// A regime without variants, and the folder that it is run in.
pub(crate) struct Run {
    /// Of a sweep.
    variant: Option<String>,
    table: toml::Table,
    regime: Regime,
    out: PathBuf,
}

impl Run {
    /// A regime run in `out`, or a variant of it in a folder there.
    fn new(variant: Option<String>, table: toml::Table, out: &Path) -> Result<Self> {
        let regime = Regime::from_table(table.clone())?;
        let out = variant.as_ref().map_or_else(|| out.to_owned(), |variant| out.join(variant));
        Ok(Self { variant, table, regime, out })
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

/// Runs a regime without variants in a folder of its own; one that came to its end there is only read.
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
    if summary.retitle(&run.regime) {
        summary.write(&run.out)?;
    }
    Ok(summary)
}

/// Runs one regime without variants: its stages, its results, its report.
fn run_once(workshop: &Workshop<'_>, run: &Run, scenes: &mut Scenes) -> Result<Summary> {
    let (regime, out) = (&run.regime, &run.out);
    let mut finished = Vec::new();
    for stage in &regime.stages {
        let done = workshop.run(run, stage, scenes, &finished)?;
        finished.push(done);
    }
    let results = results::evaluate(workshop, regime, &finished, out)?;
    let summary = Summary::new(regime, &finished, results);
    summary.write(out)?;
    Ok(summary)
}
