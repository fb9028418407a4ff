//! `imf-bench rates`: the learning rate that the paper's network bears, over width and ω: what its default rate follows from.
//!
//! Each network learns the teapot's 225 sections at a quarter of its resolution from rates around
//! [`SirenShape::rate`], by a cosine; the table has the error at random directions. A training that diverges is a finding.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use imf_cli::arguments::DeviceArguments;
use imf_cli::engine::Device;
use imf_cli::output::{OutputFolder, lock_folder, prepare_folder};
use imf_cli::session::Session;
use imf_fields::siren::SirenShape;
use serde::Serialize;

use crate::cells::{Cells, device_name};
use crate::document::Document;
use crate::measurement::Machine;
use crate::paper::{TrainingResult, in_precision, precision_on, trained};
use crate::recipe::{RANDOM, Runner, Source, built_in};

/// The learning rate that the paper's network bears, over width and ω
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench rates --width 64,256 --omega 10 --out rates\n\n\
                        Writes rates.md and rates.json. Whatever was interrupted goes on with the same command. About half an \
                        hour on 2 cores.")]
pub(crate) struct RatesArguments {
    /// Neurons of every hidden layer; several with commas
    #[arg(long, value_delimiter = ',', default_value = "64,128,256,512,1024", value_name = "N")]
    width: Vec<usize>,
    /// Frequency factors inside every sine; several with commas
    #[arg(long, value_delimiter = ',', default_value = "1,3,10,30", value_name = "ω")]
    omega: Vec<f32>,
    /// Steps of each training
    #[arg(long, default_value_t = 1000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Folder to write to
    #[arg(long, default_value = "imf-rates", value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    device: DeviceArguments,
}

/// Rates over the default one.
const FACTORS: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

#[derive(Serialize)]
struct Report {
    machine: Machine,
    device: String,
    steps: u64,
    networks: Vec<Network>,
}

/// One network from several rates.
#[derive(Serialize)]
struct Network {
    width: usize,
    omega: f32,
    /// The default one.
    rate: f32,
    /// Mean squared error at random directions by factor of the rate; nothing where training diverged.
    mse: Vec<Option<f64>>,
}

pub(crate) fn run(session: &Session, arguments: &RatesArguments) -> Result<()> {
    let out = &arguments.out;
    OutputFolder::check(out)?;
    prepare_folder(out)?;
    let _lock = lock_folder(out)?;
    let mut machine = Machine::new(session.threads());
    let device = Device::open(&arguments.device.device, session)?;
    let cells = Cells::new(session, &device, out)?;
    let runner = Runner {
        session,
        device: &device,
        checkpoint_every: 60.0,
        held_out: 0,
        datasets: out.join("datasets"),
    };
    let mut networks = Vec::new();
    for &width in &arguments.width {
        for &omega in &arguments.omega {
            let shape = SirenShape { width, omega, ..SirenShape::default() };
            let mut mse = Vec::new();
            for factor in FACTORS {
                let source = in_precision(&training(shape, factor, arguments.steps)?, precision_on(&device))?;
                let name = format!("{width}-{omega}-{factor}").replace('.', "_");
                let folder = out.join("runs").join(format!("{name}-{}", cells.mark(&source)?));
                let outcome = cells.get(&name, &source, || trained(&runner, &source, &folder))?;
                mse.push(match outcome.value {
                    TrainingResult::Finished(run) => {
                        let mut answers = run.results.iter().flat_map(|result| &result.answers);
                        answers.find(|answer| answer.name.ends_with(RANDOM)).map(|answer| answer.errors.mse)
                    }
                    TrainingResult::Diverged(_) => None,
                });
            }
            networks.push(Network { width, omega, rate: shape.rate(), mse });
        }
    }
    machine.finish();
    let report = Report { machine, device: device_name(&device), steps: arguments.steps, networks };
    report.document().write(out, "rates", &report)?.show(session, &report)
}

/// The training of a network from a multiple of its default rate.
fn training(shape: SirenShape, factor: f32, steps: u64) -> Result<Source> {
    let mut source = Source::parse(built_in("single")?)?;
    source.set("scene.scale", 0.25)?;
    source.set("network.width", shape.width as i64)?;
    source.set("network.omega", f64::from(shape.omega))?;
    source.assign("evaluation.imf=[\"grid:2\"]")?;
    let rate = shape.rate() * factor;
    source.assign(&format!(
        "stage.*.training={{length={{steps={steps}}},schedule={{kind=\"cosine\",initial={rate:e},warmup=200}}}}"
    ))?;
    Ok(source)
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("Learning rates of the paper's network");
        document.paragraph(format!("{} · {}", self.machine, self.device));
        document.paragraph(format!(
            "MSE at 64 random directions after {} steps of 1,024 samples; the teapot at a quarter of its resolution, 225 \
             sections, five hidden layers; rates fall by a cosine.",
            self.steps
        ));
        let factors = FACTORS.map(|factor| format!("× {factor}"));
        let head: Vec<String> =
            ["width", "ω", "default rate"].into_iter().map(String::from).chain(factors).collect();
        let rows = self.networks.iter().map(|network| {
            let Network { width, omega, rate, mse } = network;
            let errors =
                mse.iter().map(|mse| mse.map_or_else(|| "diverged".into(), |mse| format!("{mse:.2e}")));
            [width.to_string(), omega.to_string(), format!("{rate:.1e}")].into_iter().chain(errors).collect()
        });
        document.table(&head, rows.collect());
        document
    }
}
