//! The matrices between hidden layers, where another optimiser than Adam steps them: what they fit in, where they lie
//! among the parameters.

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::kernel::{Bound, uniform};
use crate::layout::PaddedLayout;
use crate::shader::{LINEAR_GROUP, MATRIX_GROUPS};
use crate::uniforms::{Between, MatrixPlace};

/// How many matrices lie between hidden layers, and what they fit in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Matrices {
    pub(super) count: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
}

impl Matrices {
    /// Those of a network; none where there is one hidden layer.
    pub(super) fn of(layout: &PaddedLayout) -> Option<Self> {
        let between = layout.between();
        let rows = between.first()?.outputs;
        let columns = between.iter().map(|layer| layer.inputs).max()?;
        Some(Self { count: between.len(), rows, columns })
    }

    /// Writes into `table` where each stands, and by how much a step is longer than the learning rate, by the inputs that it
    /// learns from; returns what the kernels know of them all, moments of which a step leaves the share `kept`.
    pub(super) fn upload(
        &self,
        gpu: &Gpu,
        layout: &PaddedLayout,
        table: &wgpu::Buffer,
        kept: f32,
        length: impl Fn(usize) -> f32,
    ) -> Result<wgpu::Buffer, EngineError> {
        let both = layout.between().iter().zip(layout.learnt_between());
        let places: Vec<MatrixPlace> = both
            .map(|(layer, learnt)| MatrixPlace {
                weights: layer.weights as u32,
                columns: layer.inputs as u32,
                length: length(learnt.inputs),
            })
            .collect();
        gpu.queue().write_buffer(table, 0, bytemuck::cast_slice(&places));
        let (rows, columns) = (self.rows as u32, self.columns as u32);
        uniform(gpu, "matrices", &Between { rows, columns, kept, one_minus_kept: 1.0 - kept })
    }

    /// A kernel that goes over the numbers of all matrices.
    pub(super) fn each(&self, pass: &mut wgpu::ComputePass<'_>, kernel: &Bound) {
        kernel.sliced(pass, (MATRIX_GROUPS * LINEAR_GROUP) as usize, self.count);
    }
}
