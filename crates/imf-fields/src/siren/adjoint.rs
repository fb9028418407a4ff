//! Derivatives by a network's inputs, backwards, for a block of samples: twice the products of the values, whatever the number of
//! inputs, where tangents beside a sample ([`super::tangent`]) take one each.

use pulp::Arch;

use super::forward::Network;
use super::matrix::{Matrix, multiply};
use imf_core::vectorised::vectorised;

/// Working memory of a thread; nothing is allocated once it has its size.
#[derive(Default)]
pub(crate) struct AdjointScratch {
    /// `[layer][row][stride]`.
    slopes: Vec<f32>,
    /// `[row][stride]`.
    layers: [Vec<f32>; 2],
    /// `[row][input]`.
    by_inputs: Vec<f32>,
}

impl Network<'_> {
    /// Derivatives by a block's inputs, `[row][input]` as they are. `weigh` gets the last hidden layer's activations, `[row][stride]`, and
    /// leaves there the derivatives by them.
    pub(crate) fn by_inputs<'s>(
        &self,
        inputs: &[f32],
        scratch: &'s mut AdjointScratch,
        weigh: impl FnOnce(&mut [f32]),
    ) -> &'s [f32] {
        let (plan, stride) = (self.plan, self.plan.stride());
        let (axes, width) = (plan.stack.inputs, plan.stack.width);
        let rows = inputs.len() / axes;
        let AdjointScratch { slopes, layers: [here, other], by_inputs } = scratch;
        slopes.resize(plan.stack.hidden * rows * stride, 0.0);
        here.resize(rows * stride, 0.0);
        other.resize(rows * stride, 0.0);
        let (mut here, mut other) = (&mut here[..], &mut other[..]);
        for (layer, slopes) in slopes.chunks_exact_mut(rows * stride).enumerate() {
            self.hidden_layer(layer, inputs, here, other, Some(slopes));
            std::mem::swap(&mut here, &mut other);
        }
        weigh(here);
        by_inputs.clear();
        by_inputs.resize(inputs.len(), 0.0);
        for (layer, slopes) in slopes.chunks_exact(rows * stride).enumerate().rev() {
            scale(self.arch, here, slopes);
            let shape = &plan.layers[layer];
            let weights = &self.parameters[shape.weights..shape.biases];
            if plan.sees_input(layer) {
                let by_sums = Matrix::row_major(here, rows, width, stride);
                let of_inputs = &weights[plan.neurons_in(layer)..];
                let of_inputs = Matrix::row_major(of_inputs, width, axes, shape.inputs);
                multiply(by_inputs, axes, by_sums, of_inputs, true);
            }
            if layer > 0 {
                self.products_backwards(layer, (here, rows, stride), other);
                std::mem::swap(&mut here, &mut other);
            }
        }
        by_inputs
    }

    /// From derivatives by a layer's sums, given as rows with a stride, to those by the neurons before it,
    /// `[row][stride]` into `out`.
    pub(crate) fn products_backwards(
        &self,
        layer: usize,
        (by_sums, rows, stride): (&[f32], usize, usize),
        out: &mut [f32],
    ) {
        let split = self.split;
        let factor = split.and_then(|split| split.backward(layer, self.plan, self.parameters));
        if let Some((split, factor)) = split.zip(factor) {
            return split.scratch.with(|scratch| {
                factor.multiply(out, self.plan.stride(), (by_sums, rows, stride), false, scratch);
            });
        }
        let shape = &self.plan.layers[layer];
        let weights = &self.parameters[shape.weights..shape.biases];
        let weights = Matrix::row_major(weights, shape.outputs, self.plan.neurons_in(layer), shape.inputs);
        let by_sums = Matrix::row_major(by_sums, rows, shape.outputs, stride);
        multiply(out, self.plan.stride(), by_sums, weights, false);
    }
}

/// `values *= factors`.
fn scale(arch: Arch, values: &mut [f32], factors: &[f32]) {
    vectorised!(arch, {
        for (value, factor) in values.iter_mut().zip(factors) {
            *value *= factor;
        }
    });
}
