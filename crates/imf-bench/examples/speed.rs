//! Measures training steps and evaluation on an adapter:
//! `cargo run --release -p imf-bench --example speed -- [DEVICE [WIDTH [BATCH]]]`, five hidden layers.

use std::time::Instant;

use imf_core::field::EngineError;
use imf_fields::recipe::{Precision, TrainingState};
use imf_fields::siren::EvaluationEngine;
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::{DeviceChoice, Gpu, GpuEvaluator, GpuTrainer, MatrixKernel, TrainerSettings};
use imf_train::training::TrainingEngine;

/// Seconds that each measurement lasts at least, and operations of a step beside those of a forward pass.
const SECONDS: f64 = 3.0;
const STEP_OVER_FORWARD: f64 = 3.0;

fn main() -> Result<(), EngineError> {
    let mut arguments = std::env::args().skip(1);
    let device = arguments.next().unwrap_or_default();
    let mut number = |default: usize| arguments.next().and_then(|text| text.parse().ok()).unwrap_or(default);
    let shape = SirenShape { width: number(512), ..SirenShape::default() };
    let batch = number(1024);
    let choice = device.parse().unwrap_or(DeviceChoice::Automatic);
    let gpu = Gpu::open(&choice)?;
    println!("imf-gpu {} on {}", env!("CARGO_PKG_VERSION"), gpu.describe());
    println!("{} hidden layers of {}, batch {batch}", shape.hidden, shape.width);
    for kernel in MatrixKernel::ALL {
        let gpu = gpu.clone().with_matrix_kernel(kernel);
        measure(&gpu, shape, batch, Precision::F32)?;
        if gpu.adapter().half {
            measure(&gpu, shape, batch, Precision::F16)?;
        }
    }
    Ok(())
}

fn measure(gpu: &Gpu, shape: SirenShape, batch: usize, precision: Precision) -> Result<(), EngineError> {
    let (inputs, targets) = (vec![0.1; INPUTS * batch], vec![0.5; batch]);
    let state = TrainingState::new(&shape, 1);
    let mut evaluator = GpuEvaluator::new(gpu, shape, &state.parameters)?;
    let settings = TrainerSettings { precision, ..TrainerSettings::default() };
    let mut trainer = GpuTrainer::new(gpu, shape.stack(), &settings, batch, &state)?;
    let steps = rate(|| {
        for _ in 0..4 {
            trainer.step(&inputs, &targets, 1e-5)?;
        }
        trainer.take_mean_loss().map(|_| ())
    })? * 4.0;
    let rows = 16 * batch;
    let (inputs, mut outputs) = (vec![0.1; INPUTS * rows], vec![0.0; rows]);
    let values = rate(|| evaluator.evaluate(&inputs, &mut outputs))? * rows as f64;
    let directions = vec![[30.0, 60.0]; 16];
    let points = vec![[0.5; 3]; batch];
    let (mut least, mut best) = (vec![0.0; batch], vec![0; batch]);
    let poses = rate(|| evaluator.minimum(&points, &directions, &mut least, &mut best))? * rows as f64;
    let giga = |samples: f64| samples * shape.forward_flops() as f64 / 1e9;
    println!(
        "{:8} {:4} {steps:8.1} steps/s ({:.0} samples/s, {:.1} GFLOP/s); evaluation {values:.0} values/s ({:.1} GFLOP/s); \
         minimum {poses:.0} poses/s",
        gpu.matrix_kernel().name(),
        precision,
        steps * batch as f64,
        giga(steps * batch as f64) * STEP_OVER_FORWARD,
        giga(values),
    );
    Ok(())
}

/// Calls of `work` in a second, after one call to warm up.
fn rate(mut work: impl FnMut() -> Result<(), EngineError>) -> Result<f64, EngineError> {
    work()?;
    let start = Instant::now();
    let mut calls = 0.0;
    while start.elapsed().as_secs_f64() < SECONDS {
        work()?;
        calls += 1.0;
    }
    Ok(calls / start.elapsed().as_secs_f64())
}
