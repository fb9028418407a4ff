//! Training on the adapter against the f64 definition: gradient, update, ten steps; sizes that are not a multiple of a
//! tile; the same bits again.

use imf_fields::recipe::{AdamConfig, Loss, TrainingState};
use imf_fields::siren::output::move_to_the_foot;
use imf_fields::siren::reference::{adam_step, as_f64, forward, loss_and_gradient, rows};
use imf_fields::siren::{INPUTS, SirenShape};
use imf_gpu::{Gpu, GpuLimits, GpuTrainer, MatrixKernel, TrainerSettings};
use imf_train::training::TrainingEngine;

use crate::devices::{every_device, open, worst};
use crate::tolerances::GRADIENT;

const SHAPE: SirenShape = SirenShape { width: 37, hidden: 4, skip_after: Some(2), omega: 30.0 };
const BATCH: usize = 77;
const ADAM: AdamConfig = AdamConfig { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 1e-3 };

/// Numbers in [−1, 1) that look random, the same everywhere.
fn noise(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_769) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// Inputs `[count][5]` and targets in [0, 1).
fn batch(count: usize, seed: u32) -> (Vec<f32>, Vec<f32>) {
    let targets = noise(count, seed + 1000).into_iter().map(|value| 0.5 + 0.5 * value).collect();
    (noise(INPUTS * count, seed), targets)
}

fn trainer(gpu: &Gpu, shape: SirenShape, loss: Loss, max_batch: usize, state: &TrainingState) -> GpuTrainer {
    let settings = TrainerSettings { adam: ADAM, loss, ..TrainerSettings::default() };
    GpuTrainer::new(gpu, shape.stack(), &settings, max_batch, state).unwrap()
}

/// A state in the middle of training: moments that are not zero.
fn state(shape: &SirenShape) -> TrainingState {
    let parameters = shape.initial_parameters(5);
    let first_moment = noise(parameters.len(), 6).into_iter().map(|value| 1e-3 * value).collect();
    let second_moment = noise(parameters.len(), 7).into_iter().map(|value| 1e-5 * (value + 1.0)).collect();
    TrainingState { first_moment, second_moment, step: 3, ..TrainingState::from_parameters(parameters) }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn loss_and_gradient_agree_with_the_definition() {
    for gpu in every_device() {
        for loss in [Loss::L1, Loss::L2, Loss::L1Small] {
            for (width, hidden, skip_after, count, at_foot) in [
                (37, 4, Some(2), 77, false),
                (37, 4, Some(2), 77, true),
                (64, 2, None, 64, false),
                (8, 1, None, 1, false),
                (5, 3, Some(1), 300, false),
            ] {
                let shape = SirenShape { width, hidden, skip_after, omega: 30.0 };
                let (inputs, mut targets) = batch(count, 11);
                let mut state = state(&shape);
                if at_foot {
                    move_to_the_foot(&mut state.parameters);
                    targets.iter_mut().step_by(3).for_each(|target| *target = 0.0);
                    let clamped = |row: &[_; INPUTS]| forward(&shape, &as_f64(&state.parameters), row) == 0.0;
                    let clamped = rows::<INPUTS>(&inputs).iter().filter(|row| clamped(row)).count();
                    assert!(0 < clamped && clamped < count, "{clamped} of {count}");
                }
                let (parameters, exact) = (as_f64(&state.parameters), as_f64(&targets));
                let (expected_loss, expected) =
                    loss_and_gradient(&shape, &parameters, &rows(&inputs), &exact, loss);
                // Room for more samples than there are: the rows behind must not matter.
                let mut trainer = trainer(&gpu, shape, loss, count + 13, &state);
                trainer.fill_scratch(f32::NAN).unwrap();
                let (found_loss, found) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
                let case =
                    format!("{loss:?}, {hidden} × {width}, batch {count}, {}", gpu.matrix_kernel().name());
                assert!((found_loss - expected_loss).abs() < 1e-6, "{case}: {found_loss} {expected_loss}");
                let error = worst(&found, &expected, 1e-9, GRADIENT);
                assert!(error <= 1.0, "{case}: gradient off by {error} tolerances");
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn an_update_agrees_with_the_definition() {
    let gpu = open();
    let before = state(&SHAPE);
    let (inputs, targets) = batch(BATCH, 12);
    let mut trainer = trainer(&gpu, SHAPE, Loss::L1, BATCH, &before);
    let (_, gradient) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
    trainer.step(&inputs, &targets, 1e-2).unwrap();
    let after = trainer.state().unwrap();
    assert_eq!(after.step, before.step + 1);

    let mut parameters = as_f64(&before.parameters);
    let (mut first, mut second) = (as_f64(&before.first_moment), as_f64(&before.second_moment));
    adam_step(&ADAM, 1e-2, after.step, &mut parameters, &as_f64(&gradient), &mut first, &mut second);
    // The device's own gradient went in, so a few roundings of f32 (6e-8 each) and the division and root, which WGSL
    // allows 2.5 ulp each, are all that remains: 8e-8 on lavapipe.
    for (name, found, expected) in [
        ("parameters", &after.parameters, &parameters),
        ("first moments", &after.first_moment, &first),
        ("second moments", &after.second_moment, &second),
    ] {
        let error = worst(found, expected, 1e-12, 1e-6);
        assert!(error <= 1.0, "{name} off by {error} tolerances");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn ten_steps_agree_with_the_definition() {
    for gpu in every_device() {
        let start = TrainingState::new(&SHAPE, 21);
        let mut trainer = trainer(&gpu, SHAPE, Loss::L2, BATCH, &start);
        let mut parameters = as_f64(&start.parameters);
        let mut first = vec![0.0; parameters.len()];
        let mut second = first.clone();
        let mut mean = 0.0;
        for step in 1..=10 {
            // Batches of two sizes: what a larger one leaves behind must not matter.
            let count = if step % 3 == 0 { 21 } else { BATCH };
            let (inputs, targets) = batch(count, 30 + step);
            trainer.step(&inputs, &targets, 1e-4).unwrap();
            let (loss, gradient) =
                loss_and_gradient(&SHAPE, &parameters, &rows(&inputs), &as_f64(&targets), Loss::L2);
            mean += loss / 10.0;
            adam_step(&ADAM, 1e-4, u64::from(step), &mut parameters, &gradient, &mut first, &mut second);
        }
        let found = trainer.state().unwrap();
        // Adam divides by the gradient's size, so a weight whose gradient is near zero strays by a part of its ten steps of
        // 1e-4; all others keep to their own rounding. Lavapipe is off by 6e-8, and by 7e-6 of the way moved.
        let error = worst(&found.parameters, &parameters, 1e-6, 1e-6);
        assert!(error <= 1.0, "parameters off by {error} tolerances");
        let distance = |from: &[f32]| {
            let squares = parameters.iter().zip(from).map(|(a, &b)| (a - f64::from(b)).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let (moved, apart) = (distance(&start.parameters), distance(&found.parameters));
        assert!(apart < 1e-4 * moved, "{apart} apart, {moved} moved");
        let loss = trainer.take_mean_loss().unwrap();
        assert!((loss - mean).abs() < 1e-6 * mean, "{loss} {mean}");
        assert_eq!(trainer.take_mean_loss().unwrap(), 0.0);
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_same_seed_gives_the_same_bits_whatever_scratch_held_and_wherever_it_resumed() {
    let gpu = open();
    let run = |sentinel: Option<f32>, max_batch: usize, resume: bool| {
        let make = |state: &TrainingState| trainer(&gpu, SHAPE, Loss::L1, max_batch, state);
        let mut trainer = make(&TrainingState::new(&SHAPE, 9));
        for step in 0..6 {
            if let Some(value) = sentinel {
                trainer.fill_scratch(value).unwrap();
            }
            if resume && step == 3 {
                trainer = make(&trainer.state().unwrap());
            }
            let (inputs, targets) = batch(if step == 4 { 300 } else { BATCH }, step);
            trainer.step(&inputs, &targets, 1e-3).unwrap();
        }
        let state = trainer.state().unwrap();
        [state.parameters, state.first_moment, state.second_moment]
            .map(|values| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>())
    };
    let expected = run(None, 300, false);
    assert_eq!(run(None, 300, false), expected, "the same again");
    assert_eq!(run(Some(f32::NAN), 300, false), expected, "scratch full of NaN");
    assert_eq!(run(None, 1000, false), expected, "room for larger batches");
    assert_eq!(run(None, 300, true), expected, "resumed from its state");
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_batch_in_parts_has_the_gradient_of_the_whole() {
    let whole = open().with_matrix_kernel(MatrixKernel::Register);
    // 37 neurons and 5 inputs are padded to 48 columns of 4 bytes: 120 rows at a time, less than the batch. The
    // 5928 parameters fit once, so there is one partial gradient. Loops over parameters stride over one workgroup.
    let limits = GpuLimits { storage_binding: 24_000, buffer: 1 << 30, workgroups: 2 };
    let parts = whole.clone().with_limits(limits);
    let (inputs, targets) = batch(300, 40);
    let gradient = |gpu: &Gpu| {
        let mut trainer = trainer(gpu, SHAPE, Loss::L2, 300, &TrainingState::new(&SHAPE, 2));
        trainer.fill_scratch(f32::NAN).unwrap();
        trainer.loss_and_gradient(&inputs, &targets).unwrap()
    };
    let shape_bytes = GpuTrainer::memory_bytes(&parts, SHAPE, 300).unwrap();
    assert!(shape_bytes < GpuTrainer::memory_bytes(&whole, SHAPE, 300).unwrap());
    let (expected, found) = (gradient(&whole), gradient(&parts));
    // The same sums in another order.
    assert!((found.0 - expected.0).abs() < 1e-6);
    assert!(worst(&found.1, &as_f64(&expected.1), 1e-9, 1e-6) <= 1.0);
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn losses_are_gathered_over_more_steps_than_there_are_slots() {
    let shape = SirenShape { width: 4, hidden: 1, skip_after: None, omega: 1.0 };
    let mut trainer = trainer(&open(), shape, Loss::L2, 1, &TrainingState::new(&shape, 2));
    // With rate 0 nothing moves, so every step has the same loss, and so has their mean.
    let (inputs, targets) = batch(1, 50);
    trainer.step(&inputs, &targets, 0.0).unwrap();
    let once = trainer.take_mean_loss().unwrap();
    for _ in 0..4100 {
        trainer.step(&inputs, &targets, 0.0).unwrap();
    }
    assert!(once > 0.0);
    assert!((trainer.take_mean_loss().unwrap() - once).abs() < 1e-12);
}
