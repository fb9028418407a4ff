//! Training in bfloat16 against the same training by the twin's products, and against the definition.

use crate::engine::tests::{batch, defined, engine, shape};
use crate::engine::{CpuTrainer, WINDOW};
use crate::fixtures::{as_f64, on_threads, rows};
use crate::training::TrainingEngine;
use imf_core::field::EngineError;
use imf_fields::recipe::{AdamConfig, Loss, Precision, TrainingState};
use imf_fields::siren::bf16_kernel::Kernel;
use imf_fields::siren::stack::{Ending, Stack};
use imf_fields::siren::{INPUTS, SirenShape, reference};

/// |a − b| / |b|.
fn apart(a: &[f32], b: &[f64]) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let difference = square(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - b));
    difference / square(&mut b.iter().copied())
}

/// Samples of a starting network's, with targets off its values: where one meets the other L1 has a corner, and rounding tips the
/// gradient to either side.
fn off_the_corner(shape: SirenShape, count: usize) -> (Vec<f32>, Vec<f32>) {
    let (inputs, mut targets) = batch(count, 9);
    let weights = as_f64(&TrainingState::new(&shape, 5).parameters);
    for (target, sample) in targets.iter_mut().zip(rows(&inputs)) {
        let value = reference::forward(&shape, &weights, &sample) as f32;
        *target += if (*target - value).abs() < 0.02 { 0.05 } else { 0.0 };
    }
    (inputs, targets)
}

/// A step's gradient by a kernel; of room for more than the batch.
fn gradient(kernel: Kernel, shape: SirenShape, count: usize, omega: f32) -> (Vec<f32>, f64) {
    let shape = SirenShape { omega, ..shape };
    let mut engine = engine(shape, Loss::L1, count + 60, 5).with_kernel(kernel).unwrap();
    let (inputs, targets) = off_the_corner(shape, count);
    engine.gradient.fill(f32::NAN);
    let gradient = engine.gradient(&inputs, &targets, count).unwrap().1.to_vec();
    engine.step(&inputs, &targets, 1e-4).unwrap();
    (gradient, engine.take_mean_loss().unwrap())
}

/// How far bfloat16 takes a gradient from the definition's: every factor is off by 2⁻⁹ at most, a sum of independent errors by
/// about as much, and each of up to five layers, there and back, adds its own.
const ROUNDED: f64 = 2e-2;
/// Kernel and twin differ by the rounding of `f32` sums, which now and then tips a bfloat16 to its neighbour.
const KERNEL: f64 = 2e-4;

#[test]
fn the_gradient_is_the_twins_and_near_the_definitions() {
    for (shape, count) in [
        (shape(37, 5, Some(2)), 77),
        (shape(16, 4, None), 128),
        (shape(70, 3, Some(1)), 300),
        (shape(9, 1, Some(1)), 5),
        (shape(1, 2, Some(1)), 1),
        (shape(130, 3, Some(2)), WINDOW + 131),
    ] {
        let omega = 10.0;
        let (twin, twin_loss) = gradient(Kernel::Twin, shape, count, omega);
        let rated = SirenShape { omega, ..shape };
        let (inputs, targets) = off_the_corner(rated, count);
        let weights = as_f64(&TrainingState::new(&rated, 5).parameters);
        let (loss, expected) = defined(&rated, &weights, (&inputs, &targets), Loss::L1);
        let rounded = apart(&twin, &expected);
        println!("{shape:?}: {rounded:.1e} from the definition, loss {:.1e}", twin_loss - loss);
        assert!(rounded <= ROUNDED, "{shape:?}: {rounded}");
        assert!((twin_loss - loss).abs() <= 1e-3, "{shape:?}: loss {twin_loss}, not {loss}");
        // Where there is a product between layers it is rounded, or this tests nothing.
        assert!(shape.hidden == 1 || rounded > 1e-5, "{shape:?}: {rounded}");
        for kernel in Kernel::all().chain([Kernel::Twin]) {
            let (found, found_loss) = gradient(kernel, shape, count, omega);
            let by_kernel = apart(&found, &as_f64(&twin));
            println!("  {by_kernel:.1e} between {} and twin", kernel.name());
            assert!(by_kernel <= KERNEL, "{shape:?}: {by_kernel}");
            assert!((found_loss - twin_loss).abs() <= 1e-5, "{shape:?}: {found_loss}, not {twin_loss}");
        }
    }
}

#[test]
fn threads_change_no_bit_and_steps_without_update_are_the_same() {
    let kernel = Kernel::of_this_machine().unwrap_or(Kernel::Twin);
    let shape = shape(130, 3, Some(2));
    let count = WINDOW + 333;
    let (inputs, targets) = batch(count, 1);
    let train = |threads: usize, max_batch: usize, apart: bool| {
        on_threads(threads, || {
            let mut engine = engine(shape, Loss::L1, max_batch, 2).with_kernel(kernel).unwrap();
            for count in [count, 77, 128] {
                let (inputs, targets) = (&inputs[..count * INPUTS], &targets[..count]);
                if apart {
                    engine.gradient(inputs, targets, count).unwrap();
                    engine.update(1e-4);
                } else {
                    engine.step(inputs, targets, 1e-4).unwrap();
                }
            }
            engine.state().unwrap()
        })
    };
    let one = train(1, count, false);
    assert!(one.parameters != TrainingState::new(&shape, 2).parameters);
    for (threads, max_batch, apart) in [(2, count, false), (3, 4 * count, false), (2, count, true)] {
        assert!(train(threads, max_batch, apart) == one, "{threads} threads, room for {max_batch}, {apart}");
    }
}

#[test]
fn training_comes_down_as_in_f32() {
    let shape = SirenShape { omega: 10.0, ..shape(64, 3, Some(1)) };
    let (inputs, targets) = batch(512, 3);
    let train = |mut engine: CpuTrainer| {
        (0..300).for_each(|_| engine.step(&inputs, &targets, 1e-3).unwrap());
        engine.take_mean_loss().unwrap();
        engine.step(&inputs, &targets, 0.0).unwrap();
        engine.take_mean_loss().unwrap()
    };
    let f32_loss = train(engine(shape, Loss::L1, 512, 1));
    let kernel = Kernel::of_this_machine().unwrap_or(Kernel::Twin);
    let bf16_loss = train(engine(shape, Loss::L1, 512, 1).with_kernel(kernel).unwrap());
    println!("f32 {f32_loss:.2e}, bf16 {bf16_loss:.2e}");
    // From 0.3 or so. Rounding errors of 2⁻⁹ bound how exactly 512 values can be learnt by heart.
    assert!(f32_loss < 0.03 && bf16_loss < 1.5 * f32_loss + 2e-3, "{f32_loss} and {bf16_loss}");
}

#[test]
fn where_it_cannot_be_it_is_refused() {
    let paper = shape(8, 2, None).stack();
    let linear = Stack { outputs: 3, ending: Ending::Linear, ..paper };
    let state = TrainingState::from_parameters(vec![0.0; linear.parameter_count()]);
    let engine = CpuTrainer::new(linear, AdamConfig::default(), Loss::L2, 4, state).unwrap();
    assert!(
        matches!(engine.with_kernel(Kernel::Twin), Err(EngineError::Shape(why)) if why.contains("bfloat16"))
    );
    let result = CpuTrainer::check_precision(Precision::Bf16);
    match (Kernel::of_this_machine(), result) {
        (Some(_), Ok(())) => {}
        (None, Err(EngineError::Device(why))) => assert!(why.contains("f32"), "{why}"),
        (kernel, result) => panic!("{kernel:?} and {result:?}"),
    }
}
