//! Evaluation and the minimum over directions on the adapter against the f64 definition and a plain loop.

use imf_fields::siren::output::{Output, move_to_the_foot};
use imf_fields::siren::reference::{as_f64, forward, rows};
use imf_fields::siren::{EvaluationEngine, INPUTS, SirenShape, features};
use imf_gpu::{Gpu, GpuEvaluator, GpuLimits, MatrixKernel};

use crate::devices::{every_device, open};
use crate::tolerances::NETWORK;

const SHAPE: SirenShape = SirenShape { width: 37, hidden: 5, skip_after: Some(2), omega: 30.0 };
/// Room for the weights; one workgroup is 64 rows at a time, so everything goes in parts.
const SMALL: GpuLimits = GpuLimits { storage_binding: 40_000, buffer: 1 << 30, workgroups: 1 };

fn points(count: usize) -> Vec<[f32; 3]> {
    let part = |i: usize, step: f32| (i as f32 * step).fract();
    (0..count).map(|i| [part(i, 0.618_034), part(i, 0.754_878), part(i, 0.569_840)]).collect()
}

fn directions(count: usize) -> Vec<[f32; 2]> {
    (0..count).map(|i| [(i as f32 * 137.5) % 360.0, 180.0 * i as f32 / count as f32]).collect()
}

fn inputs(points: &[[f32; 3]], [theta, phi]: [f32; 2]) -> Vec<f32> {
    points.iter().flat_map(|&point| features(point, theta, phi)).collect()
}

fn devices() -> Vec<Gpu> {
    let mut devices = every_device().to_vec();
    devices.push(open().with_matrix_kernel(MatrixKernel::Register).with_limits(SMALL));
    devices
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn values_agree_with_the_definition() {
    for (width, hidden, skip_after, at_foot) in [
        (37, 5, Some(2), false),
        (37, 5, Some(2), true),
        (64, 3, None, false),
        (1, 1, None, false),
        (20, 3, Some(1), false),
    ] {
        let shape = SirenShape { width, hidden, skip_after, omega: 30.0 };
        let mut parameters = shape.initial_parameters(3);
        if at_foot {
            move_to_the_foot(&mut parameters);
        }
        let exact = as_f64(&parameters);
        for gpu in devices() {
            let mut evaluator = GpuEvaluator::new(&gpu, shape, &parameters).unwrap();
            for count in [0, 1, 77, 500] {
                let inputs = inputs(&points(count), [200.0, 33.0]);
                let mut outputs = vec![f32::NAN; count];
                evaluator.fill_scratch(f32::NAN);
                evaluator.evaluate(&inputs, &mut outputs).unwrap();
                for (row, &output) in rows::<INPUTS>(&inputs).into_iter().zip(&outputs) {
                    let error = (f64::from(output) - forward(&shape, &exact, &row)).abs();
                    assert!(error <= NETWORK, "{hidden} × {width}, {count} rows: off by {error}");
                }
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_minimum_is_that_of_the_values() {
    let parameters = SHAPE.initial_parameters(4);
    for gpu in devices() {
        let mut evaluator = GpuEvaluator::new(&gpu, SHAPE, &parameters).unwrap();
        for (n, m) in [(1, 1), (7, 50), (130, 9), (64, 64)] {
            let (points, directions) = (points(n), directions(m));
            let mut expected = vec![(f32::INFINITY, u32::MAX); n];
            for (index, &direction) in directions.iter().enumerate() {
                let mut values = vec![f32::NAN; n];
                evaluator.evaluate(&inputs(&points, direction), &mut values).unwrap();
                for (least, &value) in expected.iter_mut().zip(&values) {
                    if value < least.0 {
                        *least = (value, index as u32);
                    }
                }
            }
            let (mut least, mut best) = (vec![f32::NAN; n], vec![u32::MAX; n]);
            evaluator.fill_scratch(f32::NAN);
            evaluator.minimum(&points, &directions, &mut least, &mut best).unwrap();
            let found: Vec<(f32, u32)> = least.into_iter().zip(best).collect();
            // The same kernels with the same inputs: the same bits.
            assert_eq!(found, expected, "{n} points, {m} directions, {:?}", gpu.limits());
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn of_equal_values_the_first_direction_is_kept() {
    let mut parameters = SHAPE.initial_parameters(4);
    for gpu in devices() {
        let (points, mut repeated) = (points(70), directions(5));
        repeated.extend(directions(5));
        repeated.extend(directions(5));
        let (mut least, mut best) = (vec![f32::NAN; 70], vec![u32::MAX; 70]);
        let mut evaluator = GpuEvaluator::new(&gpu, SHAPE, &parameters).unwrap();
        evaluator.minimum(&points, &repeated, &mut least, &mut best).unwrap();
        assert!(best.iter().all(|&index| index < 5), "{best:?}");

        // A network that is constant: every direction ties.
        parameters.fill(0.0);
        let mut evaluator = GpuEvaluator::new(&gpu, SHAPE, &parameters).unwrap();
        evaluator.minimum(&points, &directions(100), &mut least, &mut best).unwrap();
        let middle = Output::of_sum(0.0).value() as f32;
        assert!(best.iter().all(|&index| index == 0), "{best:?}");
        assert!(least.iter().all(|&value| value == least[0] && (value - middle).abs() < 1e-6), "{least:?}");
        parameters = SHAPE.initial_parameters(4);
    }
}
