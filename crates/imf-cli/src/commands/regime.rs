//! `imf regime`: trainings of one or several stages, described by a file, each run by one command.
//!
//! ```text
//! OUT/regime.toml              what is run, presets and changes together: run it again with `imf regime run`
//! OUT/datasets/NAME-…/         one for each different set of sections
//! OUT/stages/NAME/             checkpoint, model, and for results the report with its pictures
//! OUT/model.safetensors        the first result
//! OUT/regime.md, regime.json   stages, results; loss.png
//! OUT/VARIANT/…                a sweep has all of this for each variant, and sweep.md, sweep.json, loss.png for all
//! ```
//!
//! Whatever stage was interrupted, the same command goes on: datasets keep their shards, finished stages are known by
//! their settings and by the weights that they started from, an unfinished one continues from its checkpoint.

mod results;
mod scenes;
mod stage;
mod summary;
mod sweep;

use std::path::Path;
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
use crate::output::{prepare_folder, print, print_json, write_text};
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
    prepare_folder(&arguments.out)?;
    claim(&arguments.out, &table)?;
    let device = Device::open(&arguments.device.device, session)?;
    let workshop = Workshop {
        session,
        device: &device,
        settings: Settings {
            checkpoint_every: arguments.checkpoint_every,
            go_on: GO_ON,
            held_out: arguments.held_out,
            held_out_every: None,
            log: None,
            tensorboard: false,
        },
        datasets: arguments.out.join("datasets"),
    };
    if let [(None, table)] = runs.as_slice() {
        let summary = run_once(&workshop, table, &arguments.out)?;
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
    sweep::run(&workshop, &table, &runs, &arguments.out)
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

/// Writes down what the folder is for, or finds that it is for the same.
fn claim(out: &Path, table: &toml::Table) -> Result<()> {
    let path = out.join("regime.toml");
    let text = toml::to_string(table).context("the regime cannot be written down")?;
    match std::fs::read_to_string(&path) {
        Ok(found) if found == text => Ok(()),
        Ok(_) => bail!(
            "{} describes another regime, or other settings of it: choose another --out, or remove the folder",
            path.display()
        ),
        Err(_) => write_text(&path, &text),
    }
}

/// Runs a regime without variants in a folder of its own; one that came to its end there is only read.
pub(crate) fn run_or_read(workshop: &Workshop<'_>, table: &toml::Table, out: &Path) -> Result<Summary> {
    prepare_folder(out)?;
    claim(out, table)?;
    match Summary::read(out) {
        Some(summary) => {
            workshop.session.note("finished already");
            Ok(summary)
        }
        None => run_once(workshop, table, out),
    }
}

/// Runs one regime without variants: its stages, its results, its report.
fn run_once(workshop: &Workshop<'_>, table: &toml::Table, out: &Path) -> Result<Summary> {
    let regime = Regime::from_table(table.clone())?;
    let mut scenes = Scenes::new(&regime.scene);
    let mut finished = Vec::new();
    for stage in &regime.stages {
        let done = workshop.run(&regime, stage, &mut scenes, &finished, out)?;
        finished.push(done);
    }
    let results = results::evaluate(workshop, &regime, &finished, out)?;
    let summary = Summary::new(&regime, &finished, results);
    summary.write(out, &finished)?;
    Ok(summary)
}
