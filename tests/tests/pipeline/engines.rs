//! Ten steps of the same plan on the f64 definition, the CPU engine and the GPU engine, on real samples.

use std::ops::ControlFlow;

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_fields::recipe::{Cursor, Length, TrainingPlan};
use imf_fields::siren::reference::{adam_step, loss_and_gradient};
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::{GpuTrainer, MatrixKernel, TrainerSettings};
use imf_train::engine::CpuTrainer;
use imf_train::samples::Samples;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Outcome, train};

use crate::scene::{adapter, bracket, orientations, samples};

const SHAPE: SirenShape = SirenShape { width: 48, hidden: 4, skip_after: Some(2), omega: 30.0 };
const BATCH: usize = 250;

/// The paper's plan, cut to ten steps: L1, weight decay, 5e-4.
fn plan() -> TrainingPlan {
    TrainingPlan {
        length: Length::Steps(10),
        batch: BATCH,
        seed: 3,
        report_every: 10,
        ..TrainingPlan::default()
    }
}

/// The definition behind the same seam as the engines, so that all are fed by the same loop.
struct Definition {
    plan: TrainingPlan,
    parameters: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    step: u64,
    losses: Vec<f64>,
}

impl TrainingEngine for Definition {
    fn describe(&self) -> String {
        "f64, as the mathematics says".into()
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let inputs: Vec<[f64; INPUTS]> =
            inputs.chunks(INPUTS).map(|row| std::array::from_fn(|i| f64::from(row[i]))).collect();
        let (loss, gradient) =
            loss_and_gradient(&SHAPE, &self.parameters, &inputs, &wide(targets), self.plan.loss);
        self.losses.push(loss);
        self.step += 1;
        let (rate, moments) = (f64::from(learning_rate), (&mut self.first, &mut self.second));
        adam_step(&self.plan.adam, rate, self.step, &mut self.parameters, &gradient, moments.0, moments.1);
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        let losses = std::mem::take(&mut self.losses);
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        Err(EngineError::Device("the definition keeps its state in f64".into()))
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.parameters = wide(parameters);
        Ok(())
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

fn ten_steps(engine: &mut dyn TrainingEngine, samples: &Samples) -> f64 {
    let mut loss = f64::NAN;
    let mut note = |report: &imf_train::training::run::Report, _: &mut dyn TrainingEngine| {
        loss = report.mean_loss;
        ControlFlow::Continue(())
    };
    assert_eq!(train(&plan(), samples, engine, Cursor::default(), &mut note).unwrap(), Outcome::Finished);
    loss
}

/// Mean loss and weights after ten steps of the definition.
fn expected(start: &TrainingState, samples: &Samples) -> (f64, Vec<f64>) {
    let zeros = vec![0.0; start.parameters.len()];
    let mut definition = Definition {
        plan: plan(),
        parameters: wide(&start.parameters),
        first: zeros.clone(),
        second: zeros,
        step: 0,
        losses: Vec::new(),
    };
    let loss = ten_steps(&mut definition, samples);
    (loss, definition.parameters)
}

/// Gradients in f32 are off by some 1e-6 of the largest one. Adam divides each weight's gradient by its own size, so a
/// weight whose gradient is a thousandth of the largest strays by a thousandth of its way, and only one whose gradient
/// is lost in rounding strays by all of it: 5e-3 in ten steps of 5e-4. Hence one bound on the whole vector, as a share
/// of the way moved, and a looser one on each weight, as a share of the longest way that Adam allows. Here CPU and
/// lavapipe are off by 1.4e-6 of the way and by 6e-8 at most; other devices add up and round otherwise.
const APART: f64 = 1e-4;
const EACH: f64 = 0.01 * 10.0 * 5e-4;
/// A mean of ten losses of about 0.3, each a mean of values that are off by some 1e-6 at most.
const LOSS: f64 = 1e-6;

fn agree(name: &str, found: (f64, &[f32]), expected: &(f64, Vec<f64>), start: &[f32]) {
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let (loss, parameters) = (found.0, wide(found.1));
    let moved = distance(&expected.1, &wide(start));
    let apart = distance(&parameters, &expected.1);
    let each = parameters.iter().zip(&expected.1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("{name}: {:.1e} of the way, {each:.1e} at most, loss {:.1e}", apart / moved, loss - expected.0);
    // Every weight goes most of its ten steps, or there was nothing to compare.
    assert!(moved > 1e-3 * (start.len() as f64).sqrt(), "{name}: moved by {moved} in all");
    assert!(apart <= APART * moved, "{name}: {apart} apart after moving by {moved}");
    assert!(each <= EACH, "{name}: a weight is off by {each}");
    assert!((loss - expected.0).abs() <= LOSS, "{name}: loss {loss}, not {}", expected.0);
}

#[test]
fn ten_steps_on_the_cpu_are_those_of_the_definition() {
    let (_, samples) = samples(&bracket(), &orientations("fibonacci:16"), 0.35);
    let start = TrainingState::new(&SHAPE, 7);
    let expected = expected(&start, &samples);
    let mut engine = CpuTrainer::new(SHAPE, plan().adam, plan().loss, BATCH, start.clone()).unwrap();
    let loss = ten_steps(&mut engine, &samples);
    agree("CPU", (loss, engine.parameters()), &expected, &start.parameters);
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn ten_steps_on_the_gpu_are_those_of_the_definition_and_of_the_cpu() {
    let (_, samples) = samples(&bracket(), &orientations("fibonacci:16"), 0.35);
    let start = TrainingState::new(&SHAPE, 7);
    let expected = expected(&start, &samples);
    let mut cpu = CpuTrainer::new(SHAPE, plan().adam, plan().loss, BATCH, start.clone()).unwrap();
    let cpu_loss = ten_steps(&mut cpu, &samples);
    let cpu = (cpu_loss, wide(cpu.parameters()));
    let settings = TrainerSettings { adam: plan().adam, loss: plan().loss, ..TrainerSettings::default() };
    for kernel in MatrixKernel::ALL {
        let gpu = adapter().with_matrix_kernel(kernel);
        let mut engine = GpuTrainer::new(&gpu, SHAPE.stack(), &settings, BATCH, &start).unwrap();
        let loss = ten_steps(&mut engine, &samples);
        let found = engine.state().unwrap().parameters;
        agree(&format!("GPU, {}", kernel.name()), (loss, &found), &expected, &start.parameters);
        agree(&format!("GPU, {}, and CPU", kernel.name()), (loss, &found), &cpu, &start.parameters);
    }
}
