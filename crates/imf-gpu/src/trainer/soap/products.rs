//! Products of SOAP's, of all matrices together.

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::kernel::{Bound, Kernel, uniform};
use crate::shader::Shader;
use crate::uniforms::Product;

/// A factor as it stands, or its transpose.
#[derive(Clone, Copy)]
pub(super) enum Factor<'a> {
    Plain(&'a wgpu::Buffer),
    Transposed(&'a wgpu::Buffer),
}

impl<'a> Factor<'a> {
    fn buffer(self) -> &'a wgpu::Buffer {
        let (Self::Plain(buffer) | Self::Transposed(buffer)) = self;
        buffer
    }

    fn transposed(self) -> u32 {
        u32::from(matches!(self, Self::Transposed(_)))
    }
}

/// The kernel, and how many matrices there are.
pub(super) struct Products<'a> {
    gpu: &'a Gpu,
    kernel: Kernel,
    count: usize,
}

impl<'a> Products<'a> {
    pub(super) fn new(gpu: &'a Gpu, count: usize) -> Result<Self, EngineError> {
        Ok(Self { gpu, kernel: Kernel::new(gpu, Shader::SoapProduct)?, count })
    }

    /// `to ← left·right`, of `[rows, columns, inner]`.
    pub(super) fn of(
        &self,
        size: [usize; 3],
        factors: [Factor<'_>; 2],
        to: &wgpu::Buffer,
    ) -> Result<BoundProduct, EngineError> {
        self.added(size, factors, to, [0.0, 1.0])
    }

    /// `to ← kept·to + share·left·right`.
    pub(super) fn added(
        &self,
        [rows, columns, inner]: [usize; 3],
        [left, right]: [Factor<'_>; 2],
        to: &wgpu::Buffer,
        [kept, share]: [f32; 2],
    ) -> Result<BoundProduct, EngineError> {
        let block = Product {
            rows: rows as u32,
            columns: columns as u32,
            inner: inner as u32,
            left_transposed: left.transposed(),
            right_transposed: right.transposed(),
            kept,
            share,
        };
        let block = uniform(self.gpu, "product of SOAP", &block)?;
        let kernel = self.kernel.bind(self.gpu, &[&block, left.buffer(), right.buffer(), to]);
        Ok(BoundProduct { kernel, rows, columns, count: self.count })
    }

    /// `to ← left·(middle·right)` of matrices `[rows, columns]` between square ones, by way of `half`.
    pub(super) fn between(
        &self,
        [rows, columns]: [usize; 2],
        [left, middle, right]: [Factor<'_>; 3],
        half: &wgpu::Buffer,
        to: &wgpu::Buffer,
    ) -> Result<[BoundProduct; 2], EngineError> {
        Ok([
            self.of([rows, columns, columns], [middle, right], half)?,
            self.of([rows, columns, rows], [left, Factor::Plain(half)], to)?,
        ])
    }
}

/// A product with its buffers.
#[derive(Debug)]
pub(super) struct BoundProduct {
    kernel: Bound,
    rows: usize,
    columns: usize,
    count: usize,
}

impl BoundProduct {
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.kernel.product(pass, self.rows, self.columns, self.count);
    }
}
