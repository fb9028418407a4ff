//! Measures the CPU engine: training and evaluation in samples per second, and their share of the matrix product's
//! own peak, measured in between so that a busy machine slows both.
//!
//! `cargo run --release -p imf-bench --example engine [width [batch]]`; without arguments all of them.

use std::ops::ControlFlow;
use std::time::Instant;

use glam::DVec3;
use imf_core::grid::Grid;
use imf_fields::recipe::{AdamConfig, Loss, TrainingState};
use imf_fields::recipe::{Cursor, Length, TrainingPlan};
use imf_fields::siren::EvaluationEngine;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::matrix::{Matrix, multiply};
use imf_fields::siren::sine::{sine_cosine_in_place, sine_in_place};
use imf_fields::siren::{INPUTS, SirenShape};
use imf_train::engine::CpuTrainer;
use imf_train::samples::Samples;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Report, train};
use rayon::prelude::*;

/// Each figure is the best of this many rounds, product and engine by turns.
const ROUNDS: usize = 8;
/// Least time of one measurement.
const SECONDS: f64 = 0.25;

fn main() {
    let threads = rayon::current_num_threads();
    let wanted: Vec<usize> = std::env::args().skip(1).map(|a| a.parse().expect("a whole number")).collect();
    let keep = |place: usize, value: usize| wanted.get(place).is_none_or(|&w| w == value);
    if wanted.is_empty() {
        sine_rate();
    }
    let shape = SirenShape { width: 1, ..SirenShape::default() };
    let engine = CpuEvaluator::new(shape, &shape.initial_parameters(1)).expect("a shape in range");
    println!("imf-core {}, {}", env!("CARGO_PKG_VERSION"), engine.describe());
    let mut peak = Peak::new(threads);
    println!(
        "{:>6} {:>6} {:>12} {:>9} {:>8} {:>8}",
        "width", "batch", "samples/s", "GFLOP/s", "peak", "share"
    );
    for width in [512, 256, 192, 128].into_iter().filter(|&w| keep(0, w)) {
        let shape = SirenShape { width, ..SirenShape::default() };
        for batch in [1024, 4096, 8192].into_iter().filter(|&b| keep(1, b)) {
            let state = TrainingState::new(&shape, 1);
            let engine = CpuTrainer::new(shape, AdamConfig::default(), Loss::L1, batch, state);
            let mut engine = engine.expect("a shape in range");
            let (inputs, targets) = (ramp(batch * INPUTS), ramp(batch));
            // Forward and gradient of the weights in full; no gradient of the inputs.
            let layers = shape.layers();
            let flops = 3 * shape.forward_flops() - 2 * INPUTS * layers[0].outputs;
            report(&mut peak, width, batch, flops, || {
                engine.step(&inputs, &targets, 1e-5).expect("a batch that fits");
            });
        }
        if wanted.len() > 1 {
            continue;
        }
        whole_loop(shape);
        let mut engine = CpuEvaluator::new(shape, &shape.initial_parameters(1)).expect("a shape in range");
        let samples = 16_384;
        let (inputs, mut outputs) = (ramp(samples * INPUTS), vec![0.0; samples]);
        print!("eval ");
        report(&mut peak, width, samples, shape.forward_flops(), || {
            engine.evaluate(&inputs, &mut outputs).expect("lengths that fit");
        });
    }
}

fn report(peak: &mut Peak, width: usize, batch: usize, flops: usize, mut step: impl FnMut()) {
    let (mut best, mut top) = (0.0f64, 0.0f64);
    for _ in 0..ROUNDS {
        top = top.max(peak.measure());
        best = best.max(rate(&mut step) * batch as f64);
    }
    let gflops = best * flops as f64 * 1e-9;
    println!("{width:>6} {batch:>6} {best:>12.0} {gflops:>9.1} {top:>8.1} {:>7.1}%", 100.0 * gflops / top);
}

/// The training loop over samples in memory, batches of 1024: what gathering and reporting add to the steps.
fn whole_loop(shape: SirenShape) {
    let grid = Grid::with_dims(DVec3::ZERO, DVec3::ONE, [58, 76, 121], 0).expect("a box with volume");
    let mut samples = Samples::new(grid);
    let voxels: Vec<u32> = (0..2000).map(|i| i * 263).collect();
    for section in 0..225u16 {
        samples.push_section([f32::from(section), 90.0], &voxels, &ramp(voxels.len()));
    }
    let plan = TrainingPlan { length: Length::Epochs(1), ..TrainingPlan::default() };
    let state = TrainingState::new(&shape, 1);
    let mut engine =
        CpuTrainer::new(shape, plan.adam, plan.loss, plan.batch, state).expect("a shape in range");
    let mut best = 0.0f64;
    let mut note = |report: &Report, _: &mut dyn TrainingEngine| {
        best = best.max(report.samples_per_second);
        ControlFlow::Continue(())
    };
    train(&plan, &samples, &mut engine, Cursor::default(), &mut note).expect("a run that ends");
    println!("loop  {:>6} {:>6} {best:>12.0}", shape.width, plan.batch);
}

/// Calls per second.
fn rate(work: &mut impl FnMut()) -> f64 {
    let start = Instant::now();
    let mut calls = 0;
    while calls < 3 || start.elapsed().as_secs_f64() < SECONDS {
        work();
        calls += 1;
    }
    f64::from(calls) / start.elapsed().as_secs_f64()
}

/// Values in [−1, 1) that repeat after 1009.
fn ramp(length: usize) -> Vec<f32> {
    (0..length).map(|i| (i * 577 % 1009) as f32 / 504.5 - 1.0).collect()
}

/// A 1024×512×512 product on every core at once, all factors row-major: the fastest of gemm's layouts.
struct Peak {
    a: Vec<f32>,
    b: Vec<f32>,
    out: Vec<Vec<f32>>,
}

impl Peak {
    fn new(threads: usize) -> Self {
        Self { a: ramp(1024 * 512), b: ramp(512 * 512), out: vec![vec![0.0; 1024 * 512]; threads] }
    }

    /// GFLOP/s of all cores together.
    fn measure(&mut self) -> f64 {
        let Self { a, b, out } = self;
        let calls = rate(&mut || {
            out.par_iter_mut().for_each(|out| {
                for _ in 0..4 {
                    let a = Matrix::row_major(a, 1024, 512, 512);
                    multiply(out, 512, a, Matrix::row_major(b, 512, 512, 512), false);
                }
            });
        });
        calls * out.len() as f64 * 4.0 * 2.0 * f64::from(1024 * 512 * 512) * 1e-9
    }
}

fn sine_rate() {
    let source = ramp(8192);
    let (mut values, mut cosines) = (source.clone(), source.clone());
    for (name, arch) in [("dispatched", pulp::Arch::new()), ("scalar", pulp::Arch::Scalar)] {
        let (mut alone, mut both) = (0.0f64, 0.0f64);
        for _ in 0..ROUNDS {
            alone = alone.max(rate(&mut || sine_in_place(arch, &mut values)));
            both = both.max(rate(&mut || sine_cosine_in_place(arch, &mut values, &mut cosines)));
        }
        let nanoseconds = |calls: f64| 1e9 / calls / source.len() as f64;
        println!("{name}: sine {:.3} ns, with cosine {:.3} ns", nanoseconds(alone), nanoseconds(both));
    }
}
