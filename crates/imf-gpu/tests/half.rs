//! Products in half precision, by every way that the adapter offers: their gradient against the definition, their
//! training against f32's, the same bits again, and refusals.

mod adapter;

use imf_core::field::EngineError;
use imf_fields::recipe::{AdamConfig, Loss, Precision, TrainingState};
use imf_fields::siren::reference::loss_and_gradient;
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::shader::Factors;
use imf_gpu::{Gpu, GpuTrainer, MatrixKernel, TrainerSettings};
use imf_train::training::TrainingEngine;

const SHAPE: SirenShape = SirenShape { width: 64, hidden: 3, skip_after: Some(1), omega: 10.0 };

/// Devices opened for half precision with the factors that they are to use. Matrix units are among them only where
/// the adapter has some: Mesa's lavapipe from 25.2 on has, the one of Debian 12 has not.
fn ways() -> Vec<(Gpu, Factors)> {
    let gpu = adapter::open();
    let mut ways: Vec<(Gpu, Factors)> = Vec::new();
    for kernel in MatrixKernel::ALL {
        let gpu = gpu
            .clone()
            .with_matrix_kernel(kernel)
            .for_half(Some(Factors::Half))
            .expect("an adapter with f16");
        ways.push((gpu, Factors::Half));
    }
    if let Some(units @ Factors::Fragments(_)) = gpu.adapter().half {
        ways.push((gpu.with_matrix_kernel(MatrixKernel::Tiled).for_half(None).expect("matrix units"), units));
    }
    println!("{:?}", ways.iter().map(|(gpu, way)| (gpu.matrix_kernel(), way)).collect::<Vec<_>>());
    ways
}

/// Points spread over the box, and a smooth field of them in (0, 1).
fn samples(count: usize, first: usize) -> (Vec<f32>, Vec<f32>) {
    // Multiples of the fractional parts of irrational numbers, modulo 1, fill the box evenly.
    let steps = [0.618_034, 0.754_878, 0.569_840, 0.819_173, 0.671_044];
    let inputs: Vec<f32> = (first..first + count)
        .flat_map(|i| steps.map(|step: f64| ((i as f64 * step).fract() * 2.0 - 1.0) as f32))
        .collect();
    let targets = inputs
        .chunks(INPUTS)
        .map(|p| 0.5 + 0.4 * (2.0 * p[0] + p[3]).sin() * (p[1] - 1.5 * p[2]).cos() * (1.0 - p[4] * p[4]))
        .collect();
    (inputs, targets)
}

fn trainer(gpu: &Gpu, factors: Factors, batch: usize) -> GpuTrainer {
    let state = TrainingState::new(&SHAPE, 3);
    let settings = TrainerSettings { factors, ..TrainerSettings::default() };
    GpuTrainer::of_stack(gpu, SHAPE.stack(), &settings, batch, &state).expect("a trainer")
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_gradient_is_that_of_the_definition_within_the_rounding_of_factors() {
    let state = TrainingState::new(&SHAPE, 3);
    let wide: Vec<f64> = state.parameters.iter().map(|&value| f64::from(value)).collect();
    // A batch beyond f16's smallest numbers if deltas were not scaled: 1 / 3000 times a slope of 1e-3 is 3e-7.
    for count in [50, 3000] {
        let (inputs, targets) = samples(count, 0);
        let rows: Vec<[f64; INPUTS]> =
            inputs.chunks(INPUTS).map(|row| std::array::from_fn(|i| f64::from(row[i]))).collect();
        let exact: Vec<f64> = targets.iter().map(|&value| f64::from(value)).collect();
        let (loss, expected) = loss_and_gradient(&SHAPE, &wide, &rows, &exact, Loss::L1);
        for (gpu, factors) in ways() {
            let mut trainer = trainer(&gpu, factors, count + 5);
            trainer.fill_scratch(f32::NAN).unwrap();
            let (found_loss, found) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
            let name = format!("{} samples, {:?}, {}", count, gpu.matrix_kernel(), factors.name());
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
    let run = |gpu: &Gpu, factors| {
        let mut trainer = trainer(gpu, factors, 128);
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
    let (plain, parameters) = run(&adapter::open(), Factors::Single);
    let mean = {
        let (_, targets) = samples(1000, 0);
        let mean = targets.iter().sum::<f32>() / 1000.0;
        f64::from(targets.iter().map(|value| (value - mean).abs()).sum::<f32>() / 1000.0)
    };
    println!("f32: {plain:.2e}, a constant {mean:.2e}");
    assert!(plain < 0.1 * mean, "{plain} where a constant has {mean}: nothing was learnt");
    for (gpu, factors) in ways() {
        let (loss, found) = run(&gpu, factors);
        println!("{:?}, {}: {loss:.2e}", gpu.matrix_kernel(), factors.name());
        // Chance parts two trainings of so few steps by some percent.
        assert!(loss < 1.2 * plain, "{}: {loss}, f32 {plain}", factors.name());
        assert!(found != parameters, "nothing was rounded");
        assert!(run(&gpu, factors).1 == found, "{}: not the same bits again", factors.name());
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn precisions_are_refused_by_name_and_unopened_devices_too() {
    let gpu = adapter::open();
    let state = TrainingState::new(&SHAPE, 3);
    let make = |precision| {
        let adam = AdamConfig::default();
        GpuTrainer::with_precision(&gpu, SHAPE, adam, Loss::L1, 8, &state, precision)
    };
    let Err(EngineError::Device(text)) = make(Precision::Bf16) else { panic!("bf16 on a GPU") };
    assert!(text.contains("computed on CPUs alone"), "{text}");
    // What a user's f16 is: opened anew, proven, and said.
    let trainer = make(Precision::F16).unwrap();
    assert!(trainer.describe().contains("products in f16"), "{}", trainer.describe());
    let settings = TrainerSettings { factors: Factors::Half, ..TrainerSettings::default() };
    let unopened = GpuTrainer::of_stack(&gpu, SHAPE.stack(), &settings, 8, &state);
    let Err(EngineError::Device(text)) = unopened else { panic!("the device was not opened for f16") };
    assert!(text.contains("not opened"), "{text}");
}
