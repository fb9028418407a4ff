//! Products in half precision: their gradient against the definition, their training against f32's, the same bits again,
//! and refusals.

use imf_core::field::EngineError;
use imf_fields::recipe::{Loss, Precision, TrainingState};
use imf_fields::siren::reference::{as_f64, forward, loss_and_gradient, rows};
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::{Gpu, GpuTrainer, TrainerSettings};
use imf_train::training::TrainingEngine;

use crate::devices::{every_device, number, open};

const SHAPE: SirenShape = SirenShape { width: 64, hidden: 3, skip_after: Some(1), omega: 10.0 };

/// Points spread over the box, and a smooth field of them in (0, 1).
fn samples(count: usize, first: usize) -> (Vec<f32>, Vec<f32>) {
    let steps = [0.618_034, 0.754_878, 0.569_840, 0.819_173, 0.671_044];
    let inputs: Vec<f32> = (first..first + count).flat_map(|i| steps.map(|step| number(i, step))).collect();
    let targets = inputs
        .chunks(INPUTS)
        .map(|p| 0.5 + 0.4 * (2.0 * p[0] + p[3]).sin() * (p[1] - 1.5 * p[2]).cos() * (1.0 - p[4] * p[4]))
        .collect();
    (inputs, targets)
}

fn trainer(gpu: &Gpu, precision: Precision, batch: usize) -> Result<GpuTrainer, EngineError> {
    let settings = TrainerSettings { precision, ..TrainerSettings::default() };
    GpuTrainer::new(gpu, SHAPE.stack(), &settings, batch, &TrainingState::new(&SHAPE, 3))
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_gradient_is_that_of_the_definition_within_the_rounding_of_factors() {
    let state = TrainingState::new(&SHAPE, 3);
    let parameters = as_f64(&state.parameters);
    // A batch beyond f16's smallest numbers if deltas were not scaled: 1 / 3000 times a slope of 1e-3 is 3e-7.
    for count in [50, 3000] {
        let (inputs, mut targets) = samples(count, 0);
        // Off the values: where one meets the other L1 has a corner, and rounding tips the gradient to either side.
        for (target, row) in targets.iter_mut().zip(rows::<INPUTS>(&inputs)) {
            let value = forward(&SHAPE, &parameters, &row) as f32;
            *target += if (*target - value).abs() < 0.02 { 0.05 } else { 0.0 };
        }
        let (loss, expected) =
            loss_and_gradient(&SHAPE, &parameters, &rows(&inputs), &as_f64(&targets), Loss::L1);
        for gpu in every_device() {
            let mut trainer = trainer(&gpu, Precision::F16, count + 5).unwrap();
            trainer.fill_scratch(f32::NAN).unwrap();
            let (found_loss, found) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
            let name = format!("{count} samples, {:?}", gpu.matrix_kernel());
            assert!((found_loss - loss).abs() < 1e-3 * loss, "{name}: {found_loss} and {loss}");
            // By norms: each of some ten roundings on the way is 2⁻¹² of a factor in the mean, and an angle ω·s takes them
            // ω times; 0.2 % on lavapipe. Without rounding it is 1e-6.
            let apart: f64 = found.iter().zip(&expected).map(|(&a, b)| (f64::from(a) - b).powi(2)).sum();
            let size: f64 = expected.iter().map(|b| b * b).sum();
            let relative = (apart / size).sqrt();
            println!("{name}: {relative:.1e}");
            assert!(relative < 0.01, "{name}: {relative}");
            assert!(relative > 1e-5, "{name}: {relative}, so nothing was rounded");
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_training_reaches_the_error_of_f32_and_repeats_to_the_bit() {
    const STEPS: usize = 250;
    let run = |gpu: &Gpu, precision| {
        let mut trainer = trainer(gpu, precision, 128).unwrap();
        for step in 0..STEPS {
            let (inputs, targets) = samples(128, 128 * step);
            let rate = 2e-3 * (1.0 - step as f32 / STEPS as f32);
            trainer.step(&inputs, &targets, rate).unwrap();
            if step + 50 == STEPS {
                trainer.take_mean_loss().unwrap();
            }
        }
        (trainer.take_mean_loss().unwrap(), trainer.state().unwrap().parameters)
    };
    let (plain, parameters) = run(&open(), Precision::F32);
    let mean = {
        let (_, targets) = samples(1000, 0);
        let mean = targets.iter().sum::<f32>() / 1000.0;
        f64::from(targets.iter().map(|value| (value - mean).abs()).sum::<f32>() / 1000.0)
    };
    println!("f32: {plain:.2e}, a constant {mean:.2e}");
    assert!(plain < 0.1 * mean, "{plain} where a constant has {mean}: nothing was learnt");
    for gpu in every_device() {
        let name = gpu.matrix_kernel().name();
        let (loss, found) = run(&gpu, Precision::F16);
        println!("{name}: {loss:.2e}");
        // Chance parts two trainings of so few steps by some percent.
        assert!(loss < 1.2 * plain, "{name}: {loss}, f32 {plain}");
        assert!(found != parameters, "nothing was rounded");
        assert!(run(&gpu, Precision::F16).1 == found, "{name}: not the same bits again");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn precisions_are_refused_by_name() {
    let gpu = open();
    let Err(EngineError::Device(text)) = trainer(&gpu, Precision::Bf16, 8) else { panic!("bf16 on a GPU") };
    assert!(text.contains("computed on CPUs alone"), "{text}");
    let half = trainer(&gpu, Precision::F16, 8).unwrap();
    assert!(half.describe().contains("products in f16"), "{}", half.describe());
}
