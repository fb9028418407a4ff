//! `imf-bench train`: samples per second of the training engine, the device's peak in f32 and the fraction reached,
//! and PyTorch, by turns.

mod torch;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;
use imf_cli::arguments::DeviceArguments;
use imf_cli::arguments::numbers::{named, parse_count};
use imf_cli::engine::Device;
use imf_cli::interrupt::{self, Interruption};
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_fields::recipe::TrainingPlan;
use imf_fields::recipe::{Precision, TrainingState};
use imf_fields::siren::matrix::{Matrix, multiply};
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::Peak;
use imf_train::training::TrainingEngine;
use rayon::prelude::*;
use serde::Serialize;

use crate::document::Document;
use crate::measurement::Machine;
use torch::Torch;

/// Training steps against the matrix products' own peak and against PyTorch, by turns in one run
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench train --python venv/bin/python --out bench-train\n\n\
                        Writes train.json and train.md. About half a minute without PyTorch.")]
pub(crate) struct TrainArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// Samples in a step; several with commas
    #[arg(long, value_delimiter = ',', default_value = "1024,8192", value_name = "N", value_parser = parse_count)]
    batch: Vec<usize>,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 512, value_name = "N")]
    width: usize,
    /// What products of layers are computed in, PyTorch's too (bf16 and f16: by its autocast)
    #[arg(long, default_value = "f32", value_parser = named::<Precision>(&["f32", "bf16", "f16"]))]
    precision: Precision,
    /// Python with PyTorch
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    python: String,
    #[command(flatten)]
    device: DeviceArguments,
}

/// Which steps are measured.
pub(crate) struct Steps<'a> {
    /// Neurons of every hidden layer.
    pub(crate) width: usize,
    pub(crate) precision: Precision,
    /// Samples of a step, one measurement each.
    pub(crate) batches: &'a [usize],
    /// Python with PyTorch, which is compared.
    pub(crate) python: &'a str,
    pub(crate) rounds: Rounds,
}

/// Ways of PyTorch.
const MODES: [&str; 2] = ["eager", "compiled"];

/// Everything is measured in alternation; the best of each counts.
#[derive(Clone, Copy)]
pub(crate) struct Rounds {
    pub(crate) count: usize,
    /// Of a round, at least.
    pub(crate) seconds: f64,
}

impl Default for Rounds {
    fn default() -> Self {
        Self { count: 6, seconds: 0.5 }
    }
}

/// What was measured.
#[derive(Serialize)]
pub(crate) struct Report {
    machine: Machine,
    network: String,
    engine: String,
    pub(crate) rows: Vec<Row>,
    /// What ended the measurement before its last batch.
    pub(crate) failed: Option<String>,
    /// Version of PyTorch, or why there is none.
    torch: String,
}

#[derive(Serialize)]
pub(crate) struct Row {
    batch: usize,
    samples_per_second: f64,
    gflops: f64,
    /// In f32, the best of the same rounds: on CPUs of a 1024×512×512 product on all cores, on GPUs of multiply-adds alone.
    peak_gflops: f64,
    share: f64,
    rivals: Vec<Rival>,
}

#[derive(Serialize)]
struct Rival {
    mode: &'static str,
    samples_per_second: Option<f64>,
    failed: Option<String>,
}

pub(crate) fn run(session: &Session, arguments: &TrainArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let device = Device::open(&arguments.device.device, session)?;
    let steps = Steps {
        width: arguments.width,
        precision: arguments.precision,
        batches: &arguments.batch,
        python: &arguments.python,
        rounds: Rounds::default(),
    };
    let report = measured(session, &device, &steps)?;
    let mut document = Document::new("Training steps");
    document.paragraph(report.machine.to_string());
    report.describe(&mut document);
    let mut kept = "nothing was measured".to_owned();
    if !report.rows.is_empty() {
        document.write(&arguments.out, "train", &report)?;
        kept = format!("what was measured is in {}", arguments.out.display());
    }
    match &report.failed {
        None => document.show(session, &report),
        Some(_) if interrupt::requested() => Err(Interruption(kept).into()),
        Some(why) => bail!("{why}; {kept}"),
    }
}

/// Measures the paper's network on a device, up to the first batch that fails or is not waited for.
pub(crate) fn measured(session: &Session, device: &Device, of: &Steps<'_>) -> Result<Report> {
    let shape = SirenShape { width: of.width, ..SirenShape::paper() };
    shape.check()?;
    let plan = TrainingPlan { precision: of.precision, ..TrainingPlan::default() };
    device.require_precision(plan.precision)?;
    let mut machine = Machine::new(session.threads());
    let mut ceiling = match device {
        Device::Cpu => Ceiling::Cpu(Product::new(session.threads())),
        Device::Gpu(gpu) => Ceiling::Gpu(Box::new(Peak::new(gpu)?)),
    };
    let mut torch = match device {
        Device::Gpu(gpu) if gpu.adapter().is_software() => {
            Err("PyTorch was not compared: this is a software device.".into())
        }
        _ => Torch::start(session, of, ceiling.torch_device())
            .unwrap_or_else(|error| Err(format!("PyTorch was not compared: {error:#}"))),
    };
    let (mut rows, mut failed) = (Vec::new(), None);
    let mut engine_name = String::new();
    for &batch in of.batches {
        let mut measured = || {
            let of_batch = (4 * (INPUTS as u64 + 1)).saturating_mul(batch as u64);
            let needed = device.training_memory(shape, batch, plan.precision)?.saturating_add(of_batch);
            session.require_memory(needed, || format!("a batch of {batch}; take a smaller one"))?;
            let mut engine =
                device.trainer(session.rank(), shape, &plan, batch, TrainingState::new(&shape, 1))?;
            engine_name = engine.describe();
            session.note(&format!("batch {batch}: {engine_name}"));
            row(shape, batch, engine.as_mut(), &mut ceiling, &mut torch, of.rounds)
        };
        match measured() {
            Ok(row) => rows.push(row),
            Err(error) => {
                failed = Some(format!("batch {batch}: {error:#}"));
                break;
            }
        }
    }
    machine.finish();
    Ok(Report {
        machine,
        network: format!("{}×{}, {}, L1, Adam", shape.hidden, shape.width, plan.precision),
        engine: engine_name,
        rows,
        failed,
        torch: torch.map_or_else(|why| why, |torch| torch.describe().to_owned()),
    })
}

fn row(
    shape: SirenShape,
    batch: usize,
    engine: &mut dyn TrainingEngine,
    ceiling: &mut Ceiling,
    torch: &mut Result<Torch, String>,
    rounds: Rounds,
) -> Result<Row> {
    // Forward and gradient of the weights in full; no gradient of the inputs.
    let flops = 3 * shape.forward_flops() - 2 * INPUTS * shape.layers()[0].outputs;
    let (inputs, targets) = (ramp(batch * INPUTS), ramp(batch));
    let (mut ours, mut top) = (0.0f64, 0.0f64);
    let mut rivals = MODES.map(|mode| Rival { mode, samples_per_second: None, failed: None });
    for _ in 0..rounds.count {
        if interrupt::requested() {
            bail!("interrupted");
        }
        top = top.max(ceiling.measure(rounds.seconds)?);
        let (mut steps, start) = (0, Instant::now());
        while steps < 3 || start.elapsed().as_secs_f64() < rounds.seconds {
            engine.step(&inputs, &targets, 1e-5)?;
            steps += 1;
            if ceiling.is_gpu() && steps % 16 == 0 {
                // Waits for the device, so that the clock counts work that is done.
                engine.take_mean_loss()?;
            }
        }
        engine.take_mean_loss()?;
        ours = ours.max((steps * batch) as f64 / start.elapsed().as_secs_f64());
        for rival in rivals.iter_mut().filter(|rival| rival.failed.is_none()) {
            let Ok(process) = torch else { break };
            match process.measure(rival.mode, batch, rounds.seconds) {
                Ok(Ok(rate)) => {
                    rival.samples_per_second = Some(rival.samples_per_second.unwrap_or(0.0).max(rate));
                }
                Ok(Err(why)) => rival.failed = Some(why),
                Err(error) => {
                    rival.failed = Some(format!("{error:#}"));
                    // It does not come back.
                    *torch = Err(format!("{}: {error:#}", process.describe()));
                }
            }
        }
    }
    let gflops = ours * flops as f64 * 1e-9;
    Ok(Row {
        batch,
        samples_per_second: ours,
        gflops,
        peak_gflops: top,
        share: gflops / top,
        rivals: rivals.into_iter().filter(|r| r.samples_per_second.is_some() || r.failed.is_some()).collect(),
    })
}

impl Report {
    /// What is measured and what was found.
    pub(crate) fn describe(&self, document: &mut Document) {
        document.paragraph(format!("{} · {}\n{}", self.network, self.engine, self.torch));
        let head = [
            "batch",
            "samples/s",
            "GFLOP/s",
            "fraction of the f32 peak",
            "PyTorch eager",
            "ours over it",
            "compiled",
            "ours over it",
        ];
        let number = |value: Option<f64>, decimals: usize| {
            value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
        };
        let mut failures = Vec::new();
        let rows = self.rows.iter().map(|row| {
            let mut cells = vec![
                row.batch.to_string(),
                format!("{:.0}", row.samples_per_second),
                format!("{:.0}", row.gflops),
                format!("{:.0} % of {:.0}", 100.0 * row.share, row.peak_gflops),
            ];
            for mode in MODES {
                let rival = row.rivals.iter().find(|rival| rival.mode == mode);
                let theirs = rival.and_then(|rival| rival.samples_per_second);
                cells.push(number(theirs, 0));
                cells.push(number(theirs.map(|theirs| row.samples_per_second / theirs), 2));
                if let Some(why) = rival.and_then(|rival| rival.failed.as_ref()) {
                    failures.push(format!("batch {}, {mode}: {why}", row.batch));
                }
            }
            cells
        });
        document.table(&head, rows.collect());
        failures.iter().chain(&self.failed).for_each(|why| document.paragraph(why));
    }
}

/// Values in [−1, 1) that repeat after 1009.
fn ramp(length: usize) -> Vec<f32> {
    (0..length).map(|i| (i * 577 % 1009) as f32 / 504.5 - 1.0).collect()
}

/// What the same device does at most.
enum Ceiling {
    Cpu(Product),
    Gpu(Box<Peak>),
}

impl Ceiling {
    /// GFLOP/s.
    fn measure(&mut self, seconds: f64) -> Result<f64> {
        Ok(match self {
            Self::Cpu(product) => product.measure(seconds),
            Self::Gpu(peak) => peak.measure(seconds)? * 1e-9,
        })
    }

    fn is_gpu(&self) -> bool {
        matches!(self, Self::Gpu(_))
    }

    /// What PyTorch calls such a device.
    fn torch_device(&self) -> &'static str {
        if self.is_gpu() { "cuda" } else { "cpu" }
    }
}

/// A 1024×512×512 product on every core at once, all factors row-major: the fastest of the library's layouts.
struct Product {
    a: Vec<f32>,
    b: Vec<f32>,
    out: Vec<Vec<f32>>,
}

impl Product {
    const DIMS: [usize; 3] = [1024, 512, 512];

    fn new(threads: usize) -> Self {
        let [rows, inner, columns] = Self::DIMS;
        Self {
            a: ramp(rows * inner),
            b: ramp(inner * columns),
            out: vec![vec![0.0; rows * columns]; threads],
        }
    }

    /// GFLOP/s of all cores together.
    fn measure(&mut self, seconds: f64) -> f64 {
        let Self { a, b, out } = self;
        let [rows, inner, columns] = Self::DIMS;
        let (mut products, start) = (0, Instant::now());
        while start.elapsed().as_secs_f64() < seconds {
            out.par_iter_mut().for_each(|out| {
                for _ in 0..4 {
                    let a = Matrix::row_major(a, rows, inner, inner);
                    multiply(out, columns, a, Matrix::row_major(b, inner, columns, columns), false);
                }
            });
            products += 4 * out.len();
        }
        products as f64 * 2.0 * (rows * inner * columns) as f64 * 1e-9 / start.elapsed().as_secs_f64()
    }
}
