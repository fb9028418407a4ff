//! `imf bench train`: samples per second of the training engine, its share of the matrix products' own peak, and
//! PyTorch by turns with it.

use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use imf_core::siren::matrix::{Matrix, multiply};
use imf_core::siren::{INPUTS, SirenShape};
use imf_core::training::run::TrainingPlan;
use imf_core::training::{Precision, TrainingEngine, TrainingState};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::machine::Machine;
use crate::arguments::bench::TrainBenchArguments;
use crate::engine::Device;
use crate::output::{prepare_folder, print, print_json, table, write_json, write_text};
use crate::session::Session;

const SCRIPT: &str = include_str!("../../../../../bench/train_torch.py");
const REQUIREMENTS: &str = "python3 -m pip install torch==2.15.0 (bench/requirements-torch.txt)";
/// Rounds of everything by turns; the best of each counts.
const ROUNDS: usize = 6;
/// Least seconds of a round.
const SECONDS: f64 = 0.5;

#[derive(Serialize)]
struct Report {
    machine: Machine,
    network: String,
    engine: String,
    rows: Vec<Row>,
    /// Version of PyTorch, or why there is none.
    torch: String,
}

#[derive(Serialize)]
struct Row {
    batch: usize,
    samples_per_second: f64,
    gflops: f64,
    /// Of a 1024×512×512 product in f32 on all cores, the best of the same rounds; on the CPU alone.
    peak_gflops: Option<f64>,
    share: Option<f64>,
    rivals: Vec<Rival>,
}

#[derive(Serialize)]
struct Rival {
    mode: &'static str,
    samples_per_second: Option<f64>,
    /// Ours over theirs.
    ratio: Option<f64>,
    failed: Option<String>,
}

pub(super) fn run(session: &Session, arguments: &TrainBenchArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let device = Device::open(&arguments.device.device, session)?;
    let shape = SirenShape { width: arguments.width, ..SirenShape::default() };
    shape.check()?;
    let plan = TrainingPlan { precision: arguments.precision.into(), ..TrainingPlan::default() };
    device.require_precision(plan.precision)?;
    let on_cpu = matches!(device, Device::Cpu);
    let mut torch = Torch::start(session, arguments, if on_cpu { "cpu" } else { "cuda" })?;
    let mut rows = Vec::new();
    let mut engine_name = String::new();
    for &batch in &arguments.batch {
        let needed = device.training_memory(shape, batch, plan.precision)?;
        session.require_memory(needed, || format!("a batch of {batch}; use a smaller --batch"))?;
        let mut engine =
            device.trainer(session.rank(), shape, &plan, batch, TrainingState::new(&shape, 1))?;
        engine_name = engine.describe();
        session.note(&format!("batch {batch}: {engine_name}"));
        rows.push(row(session, shape, batch, engine.as_mut(), on_cpu, torch.as_mut().ok())?);
    }
    let report = Report {
        machine: Machine::new(session.threads()),
        network: format!("{}×{}, {}, L1, Adam", shape.hidden, shape.width, plan.precision),
        engine: engine_name,
        rows,
        torch: torch.map_or_else(|why| why, |torch| format!("PyTorch {}", torch.version)),
    };
    write_json(&arguments.out.join("train.json"), &report)?;
    let text = markdown(&report)?;
    write_text(&arguments.out.join("train.md"), &text)?;
    if session.json { print_json(&report) } else { print(&text) }
}

fn row(
    session: &Session,
    shape: SirenShape,
    batch: usize,
    engine: &mut dyn TrainingEngine,
    on_cpu: bool,
    mut torch: Option<&mut Torch>,
) -> Result<Row> {
    // Forward and gradient of the weights in full; no gradient of the inputs.
    let flops = 3 * shape.forward_flops() - 2 * INPUTS * shape.layers()[0].outputs;
    let (inputs, targets) = (ramp(batch * INPUTS), ramp(batch));
    let mut peak = Peak::new(session.threads());
    let (mut ours, mut top) = (0.0f64, 0.0f64);
    let mut rivals =
        ["eager", "compiled"].map(|mode| Rival { mode, samples_per_second: None, ratio: None, failed: None });
    for _ in 0..ROUNDS {
        if on_cpu {
            top = top.max(peak.measure());
        }
        let (mut steps, start) = (0, Instant::now());
        while steps < 3 || start.elapsed().as_secs_f64() < SECONDS {
            engine.step(&inputs, &targets, 1e-5)?;
            steps += 1;
            if !on_cpu && steps % 16 == 0 {
                // Waits for the device, so that the clock counts work that is done.
                engine.take_mean_loss()?;
            }
        }
        engine.take_mean_loss()?;
        ours = ours.max((steps * batch) as f64 / start.elapsed().as_secs_f64());
        for rival in rivals.iter_mut().filter(|rival| rival.failed.is_none()) {
            match torch.as_mut().map(|torch| torch.measure(rival.mode, batch)).transpose()? {
                None => {}
                Some(Ok(rate)) => {
                    rival.samples_per_second = Some(rival.samples_per_second.unwrap_or(0.0).max(rate));
                }
                Some(Err(why)) => rival.failed = Some(why),
            }
        }
    }
    for rival in &mut rivals {
        rival.ratio = rival.samples_per_second.map(|theirs| ours / theirs);
    }
    let gflops = ours * flops as f64 * 1e-9;
    let peak_gflops = on_cpu.then_some(top);
    Ok(Row {
        batch,
        samples_per_second: ours,
        gflops,
        peak_gflops,
        share: peak_gflops.map(|top| gflops / top),
        rivals: rivals.into_iter().filter(|r| r.samples_per_second.is_some() || r.failed.is_some()).collect(),
    })
}

fn markdown(report: &Report) -> Result<String> {
    let mut text =
        format!("{}\n\n{} · {}\n{}\n\n", report.machine, report.network, report.engine, report.torch);
    let head = [
        "batch",
        "samples/s",
        "GFLOP/s",
        "share of the f32 peak",
        "PyTorch eager",
        "ours over it",
        "compiled",
        "ours over it",
    ];
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.0}"));
    let ratio = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.2}"));
    let rows: Vec<Vec<String>> = report
        .rows
        .iter()
        .map(|row| {
            let share = match (row.share, row.peak_gflops) {
                (Some(share), Some(peak)) => format!("{:.0} % of {peak:.0}", 100.0 * share),
                _ => "–".into(),
            };
            let mut cells = vec![
                row.batch.to_string(),
                format!("{:.0}", row.samples_per_second),
                format!("{:.0}", row.gflops),
                share,
            ];
            for mode in ["eager", "compiled"] {
                let rival = row.rivals.iter().find(|rival| rival.mode == mode);
                cells.push(number(rival.and_then(|rival| rival.samples_per_second)));
                cells.push(ratio(rival.and_then(|rival| rival.ratio)));
            }
            cells
        })
        .collect();
    text += &table(&head, &rows);
    for row in &report.rows {
        for rival in row.rivals.iter().filter(|rival| rival.failed.is_some()) {
            writeln!(
                text,
                "batch {}, {}: {}",
                row.batch,
                rival.mode,
                rival.failed.as_deref().unwrap_or_default()
            )?;
        }
    }
    Ok(text)
}

/// PyTorch in a process of its own, asked by turns.
struct Torch {
    process: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
    version: String,
    /// Holds the script while it runs.
    _folder: tempfile::TempDir,
}

#[derive(Deserialize)]
struct Answer {
    version: Option<String>,
    samples_per_second: Option<f64>,
    failed: Option<String>,
}

impl Torch {
    /// The rival, or why there is none and what would help.
    fn start(
        session: &Session,
        arguments: &TrainBenchArguments,
        device: &str,
    ) -> Result<Result<Self, String>> {
        let python = &arguments.python;
        let runs = |code: &str| {
            let found = Command::new(python).args(["-c", code]).output();
            found.is_ok_and(|output| output.status.success())
        };
        if !runs("import torch") {
            return Ok(Err(format!(
                "PyTorch was not compared: {python} has none. Install it: {REQUIREMENTS}"
            )));
        }
        if !runs(&format!("import torch; torch.zeros(1, device='{device}')")) {
            return Ok(Err(format!("PyTorch was not compared: that of {python} has no {device}")));
        }
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let script = folder.path().join("train_torch.py");
        std::fs::write(&script, SCRIPT).with_context(|| format!("cannot write {}", script.display()))?;
        let mut process = Command::new(python)
            .arg(&script)
            .args(["--threads", &session.threads().to_string(), "--width", &arguments.width.to_string()])
            .args(["--device", device])
            .args(["--precision", &Precision::from(arguments.precision).to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start {python}"))?;
        let requests = process.stdin.take().context("no pipe to PyTorch")?;
        let answers = BufReader::new(process.stdout.take().context("no pipe from PyTorch")?);
        let mut torch = Self { process, requests, answers, version: String::new(), _folder: folder };
        torch.version = torch.answer()?.version.unwrap_or_default();
        Ok(Ok(torch))
    }

    /// Samples per second of a round, or why it failed.
    fn measure(&mut self, mode: &str, batch: usize) -> Result<Result<f64, String>> {
        let request = serde_json::json!({ "mode": mode, "batch": batch, "seconds": SECONDS });
        writeln!(self.requests, "{request}").context("PyTorch's process ended")?;
        let answer = self.answer()?;
        Ok(answer.samples_per_second.ok_or_else(|| answer.failed.unwrap_or_default()))
    }

    fn answer(&mut self) -> Result<Answer> {
        let mut line = String::new();
        let read = self.answers.read_line(&mut line).context("cannot read from PyTorch's process")?;
        ensure!(read > 0, "PyTorch's process ended without an answer");
        serde_json::from_str(&line).with_context(|| format!("PyTorch's process answered '{}'", line.trim()))
    }
}

impl Drop for Torch {
    fn drop(&mut self) {
        // It may be in the middle of a round that nobody waits for.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Values in [−1, 1) that repeat after 1009.
fn ramp(length: usize) -> Vec<f32> {
    (0..length).map(|i| (i * 577 % 1009) as f32 / 504.5 - 1.0).collect()
}

/// A 1024×512×512 product on every core at once, all factors row-major: the fastest of the library's layouts.
struct Peak {
    a: Vec<f32>,
    b: Vec<f32>,
    out: Vec<Vec<f32>>,
}

impl Peak {
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
    fn measure(&mut self) -> f64 {
        let Self { a, b, out } = self;
        let [rows, inner, columns] = Self::DIMS;
        let (mut products, start) = (0, Instant::now());
        while start.elapsed().as_secs_f64() < SECONDS {
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
