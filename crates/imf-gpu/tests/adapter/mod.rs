//! The adapter of the tests: any, software included. Tests that need one fail without one, unless `IMF_NO_GPU_TESTS=1`
//! was set when they were built; then the runner reports them as ignored.

use imf_gpu::{DeviceChoice, Gpu};

/// Opens the machine's adapter.
pub(crate) fn open() -> Gpu {
    Gpu::open(&DeviceChoice::Any).unwrap_or_else(|error| {
        panic!("{error}.\nTo leave these tests out on purpose: IMF_NO_GPU_TESTS=1 cargo test")
    })
}
