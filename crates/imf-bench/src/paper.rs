//! `imf-bench paper`: the paper's tables and figures, its values, ours and their ratio side by side.
//!
//! ```text
//! OUT/report.md, report.json, report.html    all tables; the page holds its pictures
//! OUT/figures/                               the pictures
//! OUT/cells/                                 every finished cell, keyed by what made it
//! OUT/runs/NAME-…/, OUT/datasets/            the recipes' folders, as `imf-bench recipe run` leaves them
//! ```
//!
//! Trainings are the recipes' own (`experiment`), with the changes that a scale makes (`protocol`). Whatever was
//! interrupted goes on with the same command.

mod baselines;
mod cells;
mod figures;
mod plane;
mod protocol;
mod published;
mod questions;
mod report;
mod space;
mod sweeps;
mod table;
mod time;

pub(crate) use baselines::settings as harmonic_settings;

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use imf_cli::engine::Device;
use imf_cli::job::Settings;
use imf_cli::output::{prepare_folder, print, print_json};
use imf_cli::session::Session;
use imf_fields::model::Model;
use imf_train::training::run::TrainError;
use serde::{Deserialize, Serialize};

use crate::arguments::paper::{PaperArguments, PaperPart, PaperTable};
use crate::experiment::{GO_ON, Summary, Workshop, run_or_read};
use crate::machine::Machine;
use cells::Cells;
use protocol::Protocol;
use report::Report;

/// What every table needs.
struct Bench<'a> {
    session: &'a Session,
    device: &'a Device,
    workshop: Workshop<'a>,
    cells: Cells<'a>,
    protocol: Protocol,
    parts: Vec<PaperPart>,
    out: PathBuf,
}

/// A recipe that was run.
struct Run {
    summary: Summary,
    folder: PathBuf,
}

/// What a training came to, as it is kept.
#[derive(Serialize, Deserialize)]
enum Trained {
    Finished(Box<Summary>),
    /// The loss rose for good: a finding (the paper has one too), not a failure of the report. In words, where.
    Diverged(String),
}

impl Run {
    /// The first result's model.
    fn model(&self) -> Result<Model> {
        let path = self.folder.join("model.safetensors");
        Model::read(&path).with_context(|| {
            format!("the run in {} is no longer whole: remove it and its cell", self.folder.display())
        })
    }
}

impl Bench<'_> {
    /// Runs a recipe to its end, or finds that it was; or why it has none.
    fn run(&self, name: &str, table: &toml::Table) -> Result<Result<Run, String>> {
        let folder = self.out.join("runs").join(format!("{name}-{}", self.cells.mark(table)?));
        let trained = self.cells.get(name, table, || match run_or_read(&self.workshop, table, &folder) {
            Ok(summary) => Ok(Trained::Finished(Box::new(summary))),
            Err(error) => match divergence(&error) {
                Some(what) => Ok(Trained::Diverged(what)),
                None => Err(error),
            },
        })?;
        Ok(match trained {
            Trained::Finished(summary) => Ok(Run { summary: *summary, folder }),
            Trained::Diverged(what) => Err(what),
        })
    }
}

/// In words that a training diverged; nothing where it failed otherwise.
fn divergence(error: &anyhow::Error) -> Option<String> {
    let causes = error.chain().filter_map(|cause| cause.downcast_ref::<TrainError>());
    causes.filter(|cause| cause.is_divergence()).map(ToString::to_string).next()
}

pub(crate) fn run(session: &Session, arguments: &PaperArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(session.threads());
    let device = Device::open(&arguments.device.device, session)?;
    let device_name = match &device {
        Device::Cpu => "networks on the CPU".to_owned(),
        Device::Gpu(gpu) => format!("networks on {}", gpu.describe()),
    };
    let mut parts = arguments.part.clone();
    if parts.is_empty() {
        parts = PaperPart::ALL.to_vec();
    }
    let bench = Bench {
        session,
        device: &device,
        workshop: Workshop {
            session,
            device: &device,
            settings: Settings {
                checkpoint_every: arguments.checkpoint_every,
                go_on: GO_ON,
                slower: " with a rate of ",
                held_out: 0,
                held_out_every: None,
            },
            datasets: arguments.out.join("datasets"),
        },
        cells: Cells::new(session, &arguments.out, &device_name)?,
        protocol: Protocol::new(arguments.scale),
        parts,
        out: arguments.out.clone(),
    };
    let asked = |table| arguments.only.is_empty() || arguments.only.contains(&table);
    let mut tables = Vec::new();
    if asked(PaperTable::Plane) {
        tables.push(plane::table(&bench)?);
    }
    if asked(PaperTable::Space) {
        let table = space::table(&bench)?;
        let beside = space::side_by_side(&table);
        tables.extend([table, beside]);
    }
    if asked(PaperTable::Time) {
        tables.push(time::table(&bench)?);
    }
    if asked(PaperTable::Transfer) {
        tables.push(sweeps::transfer(&bench)?);
    }
    if asked(PaperTable::Sparsity) {
        tables.push(sweeps::sparsity(&bench)?);
    }
    if asked(PaperTable::Architecture) {
        tables.push(sweeps::architecture(&bench)?);
    }
    for table in &mut tables {
        table.tried = Some(bench.protocol.tried());
    }
    machine.finish();
    let report = Report {
        machine,
        device: device_name,
        scale: arguments.scale,
        protocol: bench.protocol.statement(),
        threshold: bench.protocol.settings("single")?.evaluation.threshold,
        tables,
    };
    report.write(&arguments.out)?;
    if session.json {
        return print_json(&report);
    }
    print(&format!(
        "\n{}{} holds report.md, report.json and report.html.",
        report.summary(),
        arguments.out.display()
    ))
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
