//! The adapter of the tests with every way to multiply matrices.

use imf_gpu::{Gpu, MatrixKernel};

use crate::adapter;

pub(crate) fn every_device() -> [Gpu; MatrixKernel::ALL.len()] {
    let gpu = adapter::open();
    MatrixKernel::ALL.map(|kernel| gpu.clone().with_matrix_kernel(kernel))
}
