//! The adapter of the tests: any, software included. Tests that need one fail without one, unless `IMF_NO_GPU_TESTS=1`
//! was set when they were built; then the runner reports them as ignored. And numbers that look random.

use imf_gpu::{DeviceChoice, Gpu, MatrixKernel};

/// Opens the machine's adapter.
pub(crate) fn open() -> Gpu {
    Gpu::open(&DeviceChoice::Any).unwrap_or_else(|error| {
        panic!("{error}.\nTo leave these tests out on purpose: IMF_NO_GPU_TESTS=1 cargo test")
    })
}

/// With every way to multiply matrices.
pub(crate) fn every_device() -> [Gpu; MatrixKernel::ALL.len()] {
    let gpu = open();
    MatrixKernel::ALL.map(|kernel| gpu.clone().with_matrix_kernel(kernel))
}

/// Multiples of an irrational number, modulo 1, in [−1, 1]: they fill the interval evenly.
pub(crate) fn numbers(count: usize, step: f64) -> Vec<f32> {
    (0..count).map(|place| number(place, step)).collect()
}

/// One of them.
pub(crate) fn number(place: usize, step: f64) -> f32 {
    ((place as f64 * step).fract() * 2.0 - 1.0) as f32
}

/// The largest difference; NaN where there is one.
pub(crate) fn apart(a: &[f32], b: &[f32]) -> f32 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |most, apart| if apart > most || apart.is_nan() { apart } else { most })
}

/// The largest |found − expected| in units of atol + rtol·scale, scale being the largest |expected|.
pub(crate) fn worst(found: &[f32], expected: &[f64], absolute: f64, relative: f64) -> f64 {
    assert_eq!(found.len(), expected.len());
    let scale = expected.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let error = |(&found, expected): (&f32, &f64)| (f64::from(found) - expected).abs();
    let errors = found.iter().zip(expected).map(error);
    errors.fold(0.0, |most, error| if error > most || error.is_nan() { error } else { most })
        / (absolute + relative * scale)
}
