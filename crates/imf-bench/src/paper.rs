//! `imf-bench paper`: the paper's tables and figures, its values, ours and their ratio side by side.
//!
//! ```text
//! OUT/report.md, report.json, report.html    all tables; the page holds its pictures
//! OUT/figures/                               the pictures
//! OUT/cells/                                 every finished cell, keyed by what made it
//! OUT/runs/NAME-…/, OUT/datasets/            the recipes' folders, as `imf-bench recipe run` leaves them
//! ```
//!
//! Trainings are the recipes' own (`recipe`), with the changes that a scale makes (`protocol`). Whatever was
//! interrupted goes on with the same command. The cells alone are enough for the tables: what a machine has finished, another goes
//! on from; pictures of networks and their times need the run's folder.

mod baselines;
mod figures;
mod parts;
mod plane;
mod protocol;
mod published;
mod report;
mod sweeps;
mod table;
mod time;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use clap::{Args, ValueEnum};
use imf_cli::arguments::DeviceArguments;
use imf_cli::engine::Device;
use imf_cli::output::{prepare_folder, print, print_json};
use imf_cli::session::Session;
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_fields::model::Model;
use imf_fields::recipe::Precision;
use imf_train::engine::CpuTrainer;
use imf_train::training::run::TrainError;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::cells::{Cell, Cells, device_name};
use crate::measurement::Machine;
use crate::recipe::{RunSummary, Runner, SceneSettings, Scenes, Source};
use protocol::Protocol;
pub(crate) use protocol::in_precision;
use report::Report;
use table::Table;

/// The paper's tables and figures, its values, ours and their ratio side by side
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench paper --scale tiny --out paper-tiny\n  \
                        imf-bench paper --scale reduced --only 3d,time --part teapot --out paper-teapot\n\n\
                        Writes report.md, report.json and report.html (one file, pictures inside). Whatever was \
                        interrupted goes on with the same command: trainings from their checkpoints, all else from the \
                        finished cells in OUT/cells, from which another machine with the same kind of device may go on.")]
pub(crate) struct PaperArguments {
    /// How much of the paper's protocol
    #[arg(long, value_enum, default_value = "tiny")]
    scale: PaperScale,
    /// Only these tables; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "TABLE")]
    only: Vec<PaperTable>,
    /// Only these parts of the tables 3d and time (teapot, bracket, screw-gear); several with commas
    #[arg(long, value_delimiter = ',', value_name = "PART")]
    part: Vec<ReferencePart>,
    /// Only what is finished in OUT/cells: train and measure nothing, and say what is missing
    #[arg(long)]
    finished: bool,
    /// Folder to write to
    #[arg(long, default_value = "imf-paper", value_name = "DIR")]
    out: PathBuf,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = imf_cli::arguments::parse_seconds)]
    checkpoint_every: f64,
    #[command(flatten)]
    device: DeviceArguments,
}

/// How much of the paper's protocol is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
enum PaperScale {
    /// The paper's protocol itself: some 6 hours on 2 cores with AMX, 14 with AVX2
    Full,
    /// Half the resolution, narrower, fewer epochs: within 2 hours on 2 cores
    Reduced,
    /// A quarter of the resolution and a few thousand steps: within 5 minutes on 2 cores
    Tiny,
}

/// A table of the paper.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaperTable {
    /// One rotation in the plane: the network and interpolations
    #[value(name = "2d")]
    Plane,
    /// Three parts, two recipes, and baselines
    #[value(name = "3d")]
    Space,
    /// Training, evaluation, exact sections; memory
    Time,
    /// From a part to a changed part
    Transfer,
    /// How many samples are enough
    Sparsity,
    /// How large a network is enough
    Architecture,
}

/// What every table needs.
struct Bench<'a> {
    session: &'a Session,
    device: &'a Device,
    runner: Runner<'a>,
    cells: Cells<'a>,
    protocol: Protocol,
    parts: Vec<ReferencePart>,
    out: PathBuf,
    /// Nothing is made that is not there.
    finished: bool,
}

/// A recipe that was run.
struct Run {
    summary: RunSummary,
    /// The machine that finished it, and the products' precision.
    made_on: String,
    folder: PathBuf,
}

/// What became of a recipe.
enum Training {
    Finished(Run),
    /// In words, where.
    Diverged(String),
    /// Not run yet.
    Missing,
}

/// The result of a training, as it is saved.
#[derive(Serialize, Deserialize)]
pub(crate) enum TrainingResult {
    Finished(Box<RunSummary>),
    /// The loss rose for good: a finding (the paper has one too), not a failure of the report. In words, where.
    Diverged(String),
}

impl Run {
    /// The first result's model, where the run's folder is here.
    fn model(&self) -> Result<Option<Model>> {
        let path = self.folder.join("model.safetensors");
        if !path.exists() {
            return Ok(None);
        }
        let broken = || format!("remove the run in {} and its cell", self.folder.display());
        Model::read(&path).map(Some).with_context(broken)
    }
}

impl Bench<'_> {
    /// A finished piece of work, made where it is missing and may be made.
    fn cell<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        key: &impl Serialize,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Option<Cell<T>>> {
        if self.finished { self.cells.find(name, key) } else { self.cells.get(name, key, make).map(Some) }
    }

    /// Runs a recipe without variants to its end, or finds that it was, in whatever precision.
    fn run(&self, name: &str, source: &Source) -> Result<Training> {
        let folder = |here: &Source| -> Result<PathBuf> {
            Ok(self.out.join("runs").join(format!("{name}-{}", self.cells.mark(here)?)))
        };
        let make = || {
            let here = in_precision(source, self.protocol.precision)?;
            trained(&self.runner, &here, &folder(&here)?)
        };
        let Some(cell) = self.cell(name, source, make)? else { return Ok(Training::Missing) };
        Ok(match cell.value {
            TrainingResult::Finished(summary) => {
                let precision = summary.stages.first().map(|stage| stage.precision).unwrap_or_default();
                let made_on = format!("{}, {precision}", cell.made_on);
                let folder = folder(&in_precision(source, precision)?)?;
                Training::Finished(Run { summary: *summary, made_on, folder })
            }
            TrainingResult::Diverged(what) => Training::Diverged(format!("{what} (on {})", cell.made_on)),
        })
    }

    /// A scene at its full resolution.
    fn scene(&self, settings: &SceneSettings) -> Result<Scene> {
        Scenes::default().get(self.session, settings, None, 1.0)
    }
}

/// A part, marked where it is ours in the style of the paper's.
fn part_label(part: ReferencePart) -> String {
    format!("{part}{}", if part == ReferencePart::Teapot { "" } else { " (ours)" })
}

/// Runs a recipe without variants to its end, or to its divergence.
pub(crate) fn trained(runner: &Runner<'_>, source: &Source, folder: &Path) -> Result<TrainingResult> {
    match runner.run(source, folder) {
        Ok(mut summary) => Ok(TrainingResult::Finished(Box::new(summary.runs.remove(0)))),
        Err(error) => divergence(&error).map(TrainingResult::Diverged).ok_or(error),
    }
}

/// What the paper's network learns in there: in bfloat16 where it can.
pub(crate) fn precision_on(device: &Device) -> Precision {
    let halves = matches!(device, Device::Cpu) && CpuTrainer::check_precision(Precision::Bf16).is_ok();
    if halves { Precision::Bf16 } else { Precision::F32 }
}

/// In words that a training diverged; nothing where it failed otherwise.
fn divergence(error: &anyhow::Error) -> Option<String> {
    let causes = error.chain().filter_map(|cause| cause.downcast_ref::<TrainError>());
    causes.filter(|cause| cause.is_divergence()).map(ToString::to_string).next()
}

pub(crate) fn run(session: &Session, arguments: &PaperArguments) -> Result<()> {
    let all = [ReferencePart::Teapot, ReferencePart::Bracket, ReferencePart::ScrewGear];
    if let Some(other) = arguments.part.iter().find(|part| !all.contains(part)) {
        bail!("{other} is not one of the paper's parts: teapot, bracket, screw-gear");
    }
    let parts = all.into_iter().filter(|part| arguments.part.is_empty() || arguments.part.contains(part));
    let out = &arguments.out;
    ensure!(!arguments.finished || out.join("cells").is_dir(), "nothing is finished in {}", out.display());
    prepare_folder(out)?;
    let mut machine = Machine::new(session.threads());
    let device = Device::open(&arguments.device.device, session)?;
    let bench = Bench {
        session,
        device: &device,
        runner: Runner {
            session,
            device: &device,
            checkpoint_every: arguments.checkpoint_every,
            held_out: 0,
            datasets: out.join("datasets"),
        },
        cells: Cells::new(session, &device, out)?,
        protocol: Protocol::new(arguments.scale, precision_on(&device))?,
        parts: parts.collect(),
        out: out.clone(),
        finished: arguments.finished,
    };
    let mut tables = Vec::new();
    type Maker = fn(&Bench<'_>) -> Result<Table>;
    let makers: [(PaperTable, Maker); 6] = [
        (PaperTable::Plane, plane::table),
        (PaperTable::Space, parts::table),
        (PaperTable::Time, time::table),
        (PaperTable::Transfer, sweeps::transfer),
        (PaperTable::Sparsity, sweeps::sparsity),
        (PaperTable::Architecture, sweeps::architecture),
    ];
    for (which, make) in makers {
        if arguments.only.is_empty() || arguments.only.contains(&which) {
            tables.push(make(&bench)?);
            if which == PaperTable::Space {
                let others = parts::others(&bench)?;
                let families = parts::families(&tables[tables.len() - 1], &others);
                tables.extend([families, others]);
            }
        }
    }
    machine.finish();
    ensure!(
        !arguments.finished || bench.cells.any_found(),
        "no cell in {} is of this scale and of such a device: nothing was written",
        out.join("cells").display()
    );
    let report = Report {
        machine,
        device: device_name(&device),
        scale: arguments.scale,
        protocol: bench.protocol.statement(),
        tried: bench.protocol.tried.clone(),
        tables,
    };
    report.write(out)?;
    if session.json {
        return print_json(&report);
    }
    print(&format!("\n{}{} holds report.md, report.json and report.html.", report.summary(), out.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_training_that_diverged_is_a_finding_and_other_failures_are_not() {
        let rose = TrainError::NotFinite { loss: f64::NAN, after: 20, step: 40, learning_rate: 1.0 };
        let explained = anyhow::Error::from(rose).context("training stopped");
        assert!(divergence(&explained).is_some_and(|what| what.contains("between steps 20 and 40")));
        assert_eq!(divergence(&anyhow::Error::from(TrainError::NoSamples)), None);
        assert_eq!(divergence(&anyhow::anyhow!("disk full")), None);
    }
}
