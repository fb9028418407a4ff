//! Derivatives by a network's inputs, backwards, for a block of samples: twice the products of the values, whatever the number of
//! inputs, where tangents beside a sample ([`super::tangent`]) take one each.

use pulp::Arch;

use super::forward::Network;
use super::matrix::{Matrix, multiply};
use imf_core::vectorised::vectorised;

impl Network<'_> {
    /// All hidden layers of a block with their slopes, `[layer][rows][stride]`, by turns in two buffers `[rows][stride]`; the last
    /// one's activations are returned, and the buffer that is free.
    pub(crate) fn hidden_layers_with_slopes<'b>(
        &self,
        inputs: &[f32],
        slopes: &mut [f32],
        mut previous: &'b mut [f32],
        mut next: &'b mut [f32],
    ) -> [&'b mut [f32]; 2] {
        let values = inputs.len() / self.plan.stack.inputs * self.plan.stride();
        for (layer, slopes) in slopes.chunks_exact_mut(values).take(self.plan.stack.hidden).enumerate() {
            self.hidden_layer(layer, inputs, &previous[..values], next, Some(slopes));
            std::mem::swap(&mut previous, &mut next);
        }
        [&mut previous[..values], next]
    }

    /// From the derivatives by the last hidden layer's activations, `delta [rows][stride]`, those by the inputs into `out`
    /// `[rows][inputs]`; `delta` and `other` are overwritten.
    pub(crate) fn back_to_inputs<'b>(
        &self,
        slopes: &[f32],
        mut delta: &'b mut [f32],
        mut other: &'b mut [f32],
        out: &mut [f32],
    ) {
        let (plan, stride) = (self.plan, self.plan.stride());
        let (axes, width) = (plan.stack.inputs, plan.stack.width);
        let rows = out.len() / axes;
        out.fill(0.0);
        for layer in (0..plan.stack.hidden).rev() {
            let slopes = &slopes[layer * rows * stride..][..rows * stride];
            scale(self.arch, delta, slopes);
            let shape = &plan.layers[layer];
            let weights = &self.parameters[shape.weights..shape.biases];
            let by_sums = Matrix::row_major(delta, rows, width, stride);
            let from = |first: usize, columns: usize| {
                Matrix::row_major(&weights[first..], width, columns, shape.inputs)
            };
            if plan.sees_input(layer) {
                multiply(out, axes, by_sums, from(plan.neurons_in(layer), axes), true);
            }
            if layer > 0 {
                multiply(other, stride, by_sums, from(0, width), false);
                std::mem::swap(&mut delta, &mut other);
            }
        }
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
