//! The CPU engine against the f64 definition, and its guarantee that threads change nothing.

use crate::engine::*;
use crate::fixtures::{as_f64, assert_gradient, on_threads, rows};
use crate::training::TrainingEngine as _;
use imf_fields::siren::lanes::archs;
use imf_fields::siren::output::{Output, move_to_the_foot};
use imf_fields::siren::{EvaluationEngine, INPUTS, reference};

/// Samples without pattern; `count` of them, from a generator of their own.
pub(super) fn batch(count: usize, seed: u64) -> (Vec<f32>, Vec<f32>) {
    let shape = SirenShape { width: count.max(8), hidden: 1, skip_after: None, omega: 1.0 };
    // Starting weights are a ready source of seeded uniform numbers: layer 0 has five a neuron, in ±1/5.
    let numbers = shape.initial_parameters(seed);
    let inputs = numbers[..count * INPUTS].iter().map(|v| v * 5.0).collect();
    let targets = numbers[count * INPUTS..][..count].iter().map(|v| (v * 2.0).sin().abs()).collect();
    (inputs, targets)
}

pub(super) fn engine(shape: SirenShape, loss: Loss, max_batch: usize, seed: u64) -> CpuTrainer {
    let state = TrainingState::new(&shape, seed);
    CpuTrainer::new(shape.stack(), AdamConfig::default(), loss, max_batch, state).unwrap()
}

/// Loss and gradient by the definition.
pub(super) fn defined(
    shape: &SirenShape,
    weights: &[f64],
    (inputs, targets): (&[f32], &[f32]),
    loss: Loss,
) -> (f64, Vec<f64>) {
    reference::loss_and_gradient(shape, weights, &rows(inputs), &as_f64(targets), loss)
}

pub(super) fn shape(width: usize, hidden: usize, skip_after: Option<usize>) -> SirenShape {
    SirenShape { width, hidden, skip_after, omega: 30.0 }
}

/// A gradient's rounding error: sums of up to 517 terms and five layers that each multiply by ω·w ~ √6 lose about 100
/// units in the last place, 1e-5 of the largest gradient; single gradients are smaller than the largest, hence the scale.
const GRADIENT_TOLERANCE: f64 = 2e-5;

#[test]
fn the_gradient_is_the_definitions() {
    for (shape, count, at_foot) in [
        (shape(37, 5, Some(2)), 77, false),
        (shape(37, 5, Some(2)), 77, true),
        (shape(16, 4, None), 128, false),
        (shape(70, 3, Some(1)), 300, true),
        (shape(9, 1, Some(1)), 5, false),
        (shape(1, 2, Some(1)), 1, false),
        (shape(300, 3, Some(2)), 130, false),
    ] {
        let losses = [Loss::L1, Loss::L2, Loss::L1Small];
        for (arch, loss) in archs().into_iter().flat_map(|arch| losses.map(|loss| (arch, loss))) {
            let mut engine = engine(shape, loss, count + 60, 5);
            engine.arch = arch;
            let (inputs, mut targets) = batch(count, 9);
            if at_foot {
                move_to_the_foot(&mut engine.state.parameters);
                targets.iter_mut().step_by(3).for_each(|target| *target = 0.0);
            }
            let weights = as_f64(engine.parameters());
            let clamped = |sample: &[f64; INPUTS]| reference::forward(&shape, &weights, sample) == 0.0;
            let clamped = rows(&inputs).iter().filter(|sample| clamped(sample)).count();
            let expected = if at_foot { 1..count } else { 0..1 };
            assert!(expected.contains(&clamped), "{clamped} of {count}");
            let (value, gradient) = defined(&shape, &weights, (&inputs, &targets), loss);
            engine.gradient.fill(f32::NAN);
            let (_, found) = engine.gradient(&inputs, &targets, count).unwrap();
            assert_gradient(found, &gradient, GRADIENT_TOLERANCE, &format!("{shape:?} {loss:?}"));
            engine.step(&inputs, &targets, 1e-4).unwrap();
            let found = engine.take_mean_loss().unwrap();
            assert!((found - value).abs() <= 1e-5, "{shape:?} {loss:?}: loss {found}, not {value}");
        }
    }
}

/// Adam divides a gradient by its own size, so a weight whose gradient is near rounding error may move by a whole
/// learning rate in either direction. All but a few weights must agree far better than one step; none may be further
/// off than two steps of 1e-4, and the networks must agree where it counts, in their values.
#[test]
fn ten_steps_stay_with_the_definition() {
    let shape = shape(37, 5, Some(2));
    let rate = f64::from(1e-4f32);
    let mut engine = engine(shape, Loss::L1, 128, 3);
    let mut weights = as_f64(engine.parameters());
    let mut moments = [0; 2].map(|_| vec![0.0; weights.len()]);
    for step in 1..=10u64 {
        let (inputs, targets) = batch(if step % 3 == 0 { 50 } else { 77 }, 100 + step);
        let (_, gradient) = defined(&shape, &weights, (&inputs, &targets), Loss::L1);
        let [first, second] = &mut moments;
        reference::adam_step(&AdamConfig::default(), rate, step, &mut weights, &gradient, first, second);
        engine.step(&inputs, &targets, rate as f32).unwrap();
    }
    let pairs = engine.parameters().iter().zip(&weights);
    let errors: Vec<f64> = pairs.map(|(&found, expected)| (f64::from(found) - expected).abs()).collect();
    let largest = errors.iter().copied().fold(0.0, f64::max);
    let loose = errors.iter().filter(|&&error| error > 0.01 * rate).count();
    assert!(largest <= 2.0 * rate, "a weight is {largest} off");
    let all = errors.len();
    assert!(loose * 200 <= all, "{loose} of {all} weights are off by more than 1 % of a step");
    assert_eq!(engine.state().unwrap().step, 10);
    let (probes, _) = batch(40, 77);
    let mut outputs = vec![f32::NAN; 40];
    CpuEvaluator::new(shape, engine.parameters()).unwrap().evaluate(&probes, &mut outputs).unwrap();
    for (probe, &found) in rows(&probes).iter().zip(&outputs) {
        let expected = reference::forward(&shape, &weights, probe);
        assert!((f64::from(found) - expected).abs() <= 1e-5, "{found}, not {expected}");
    }
}

#[test]
fn threads_and_room_for_larger_batches_change_no_bit() {
    // More samples than a window holds, a width that is not a multiple of a panel, a ragged last block.
    let shape = shape(330, 3, Some(2));
    let count = WINDOW + 333;
    let (inputs, targets) = batch(count, 1);
    let train = |threads: usize, max_batch: usize| {
        on_threads(threads, || {
            let mut engine = engine(shape, Loss::L1, max_batch, 2);
            for count in [count, 77, 128] {
                engine.step(&inputs[..count * INPUTS], &targets[..count], 1e-4).unwrap();
            }
            (engine.take_mean_loss().unwrap().to_bits(), engine.state().unwrap())
        })
    };
    let one = train(1, count);
    for (threads, max_batch) in [(2, count), (3, count), (2, 4 * count)] {
        assert!(train(threads, max_batch) == one, "{threads} threads, room for {max_batch}");
    }
}

#[test]
fn windows_add_up_to_the_batch() {
    let shape = shape(400, 2, Some(1));
    let count = WINDOW + 200;
    let (inputs, targets) = batch(count, 4);
    let mut engine = engine(shape, Loss::L2, count, 6);
    let weights = as_f64(engine.parameters());
    let (_, found) = engine.gradient(&inputs, &targets, count).unwrap();
    let (_, gradient) = defined(&shape, &weights, (&inputs, &targets), Loss::L2);
    assert_gradient(found, &gradient, GRADIENT_TOLERANCE, "windows");
}

/// Gradients that Adam takes at once are elsewhere than those that the caller wants.
#[test]
fn a_step_is_the_gradient_and_its_update_to_the_bit() {
    let shape = shape(130, 3, Some(2));
    let count = WINDOW + 333;
    let (inputs, targets) = batch(count, 1);
    for soap in [false, true] {
        let [at_once, apart] = [true, false].map(|at_once| {
            let mut engine = engine(shape, Loss::L1, count, 2);
            if soap {
                engine.use_soap(SoapConfig::default()).unwrap();
            }
            for count in [count, 77, WINDOW] {
                let (inputs, targets) = (&inputs[..count * INPUTS], &targets[..count]);
                if at_once {
                    engine.step(inputs, targets, 1e-4).unwrap();
                } else {
                    engine.gradient(inputs, targets, count).unwrap();
                    engine.update(1e-4);
                }
            }
            engine.state().unwrap()
        });
        assert!(at_once == apart, "soap: {soap}");
        assert!(at_once.parameters != TrainingState::new(&shape, 2).parameters);
    }
}

#[test]
fn the_mean_loss_is_over_steps_and_starts_again() {
    let shape = shape(8, 2, None);
    let mut engine = engine(shape, Loss::L1, 16, 1);
    assert_eq!(engine.take_mean_loss().unwrap(), 0.0);
    let (inputs, targets) = batch(16, 3);
    engine.step(&inputs, &targets, 0.0).unwrap();
    let once = engine.take_mean_loss().unwrap();
    engine.step(&inputs, &targets, 0.0).unwrap();
    engine.step(&inputs, &targets, 0.0).unwrap();
    assert_eq!(engine.take_mean_loss().unwrap(), once);
    assert_eq!(engine.take_mean_loss().unwrap(), 0.0);
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let shape = shape(8, 2, None);
    let mut engine = engine(shape, Loss::L1, 16, 1);
    let refused = |result: Result<(), EngineError>, words: &str| match result {
        Err(EngineError::Shape(message)) => assert!(message.contains(words), "{message}"),
        other => panic!("{other:?} instead of a refusal with {words:?}"),
    };
    refused(engine.step(&[], &[], 0.1), "0 samples");
    refused(engine.step(&[0.0; 85], &[0.0; 17], 0.1), "17 samples");
    refused(engine.step(&[0.0; 14], &[0.0; 3], 0.1), "14 inputs");
    let mut state = TrainingState::new(&shape, 1);
    state.first_moment.pop();
    let short = CpuTrainer::new(shape.stack(), AdamConfig::default(), Loss::L1, 4, state);
    refused(short.map(|_| ()), "parameters");
    let wide = SirenShape { width: 0, ..shape };
    refused(CpuEvaluator::new(wide, &[]).map(|_| ()), "hidden layers");
    let mut evaluator = CpuEvaluator::new(shape, engine.parameters()).unwrap();
    refused(evaluator.evaluate(&[0.0; 9], &mut [0.0; 2]), "9 inputs");
    refused(evaluator.set_parameters(&[0.0; 9]), "parameters");
    refused(evaluator.minimum(&[[0.0; 3]], &[], &mut [0.0], &mut [0]), "0 directions");
    refused(evaluator.minimum(&[[0.0; 3]], &[[0.0; 2]], &mut [], &mut [0]), "room for 0");
}

/// Ten times the rounding of a forward pass: values lie in [0, 1] and the sums behind them have about 1e-6.
const VALUE_TOLERANCE: f64 = 1e-5;

#[test]
fn evaluation_is_the_definitions_forward_pass() {
    for (shape, count) in [(shape(37, 5, Some(2)), 300), (shape(130, 2, None), 128), (shape(3, 1, None), 1)] {
        let weights = shape.initial_parameters(8);
        let mut evaluator = CpuEvaluator::new(shape, &vec![0.0; weights.len()]).unwrap();
        evaluator.set_parameters(&weights).unwrap();
        let (inputs, _) = batch(count, 2);
        let mut outputs = vec![f32::NAN; count];
        evaluator.evaluate(&inputs, &mut outputs).unwrap();
        for (sample, &found) in rows(&inputs).iter().zip(&outputs) {
            let expected = reference::forward(&shape, &as_f64(&weights), sample);
            let error = (f64::from(found) - expected).abs();
            assert!(error <= VALUE_TOLERANCE, "{shape:?}: {found}, not {expected}");
        }
    }
}

#[test]
fn the_minimum_is_the_first_least_value() {
    let shape = shape(20, 3, Some(1));
    let mut evaluator = CpuEvaluator::new(shape, &shape.initial_parameters(4)).unwrap();
    let points: Vec<[f32; 3]> =
        (0..700).map(|i| std::array::from_fn(|a| (i * (a + 3) % 101) as f32 / 101.0)).collect();
    // Every direction twice, so that each least value has a tie.
    let once: Vec<[f32; 2]> = (0..45).map(|i| [(i * 8) as f32, (i * 29 % 180) as f32]).collect();
    let directions: Vec<[f32; 2]> = once.iter().chain(&once).copied().collect();
    let (mut least, mut best) = (vec![f32::NAN; 700], vec![u32::MAX; 700]);
    evaluator.minimum(&points, &directions, &mut least, &mut best).unwrap();
    for (point, (&least, &best)) in points.iter().zip(least.iter().zip(&best)) {
        let inputs: Vec<f32> =
            once.iter().flat_map(|&[theta, phi]| imf_fields::siren::features(*point, theta, phi)).collect();
        let mut values = vec![f32::NAN; once.len()];
        evaluator.evaluate(&inputs, &mut values).unwrap();
        let lowest = values.iter().copied().fold(f32::INFINITY, f32::min);
        // The same pose in another block may differ in its last bits.
        assert!((least - lowest).abs() <= 1e-6, "{least}, not {lowest}");
        assert!((best as usize) < once.len() && values[best as usize] <= lowest + 1e-6, "direction {best}");
    }
    evaluator.set_parameters(&vec![0.0; shape.parameter_count()]).unwrap();
    let constant = Output::of_sum(0.0).value() as f32;
    evaluator.minimum(&points, &directions, &mut least, &mut best).unwrap();
    assert!(best.iter().all(|&direction| direction == 0) && least.iter().all(|&value| value == constant));
}
