//! Derivatives by a network's inputs, backwards, for a block of samples: twice the products of the values, whatever the number of
//! inputs, where tangents beside a sample ([`super::tangent`]) take one each.

use pulp::{Simd, WithSimd};

use super::forward::Network;
use super::lanes::load;
use super::matrix::{Matrix, multiply};
use super::scratch::Lines;
use super::split::Left;
use imf_core::vectorised::vectorised;

/// Working memory of a thread; nothing is allocated once it has its size.
#[derive(Default)]
pub(crate) struct AdjointScratch {
    /// `[layer][row][stride]`.
    slopes: Lines<f32>,
    /// `[row][stride]`.
    layers: [Lines<f32>; 2],
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
        let rows = inputs.len() / plan.stack.inputs;
        let AdjointScratch { slopes, layers: [here, other], by_inputs } = scratch;
        let values = rows * stride;
        slopes.resize_to_at_least(plan.stack.hidden * values);
        here.resize_to_at_least(values);
        other.resize_to_at_least(values);
        let slopes = &mut slopes[..plan.stack.hidden * values];
        let (mut here, mut other) = (&mut here[..values], &mut other[..values]);
        for (layer, slopes) in slopes.chunks_exact_mut(values).enumerate() {
            self.hidden_layer(layer, inputs, here, other, Some(slopes));
            std::mem::swap(&mut here, &mut other);
        }
        weigh(here);
        by_inputs.clear();
        by_inputs.resize(inputs.len(), 0.0);
        for (layer, slopes) in slopes.chunks_exact(values).enumerate().rev() {
            if plan.sees_input(layer) {
                self.add_by_inputs(layer, here, slopes, by_inputs);
            }
            if layer > 0 {
                self.products_backwards(layer, (here, rows, stride), Some(slopes), other);
                std::mem::swap(&mut here, &mut other);
            }
        }
        by_inputs
    }

    /// Adds what a layer that sees the network's inputs has by them, of derivatives by its activations.
    fn add_by_inputs(&self, layer: usize, by_activations: &[f32], slopes: &[f32], by_inputs: &mut [f32]) {
        let (network, plan) = (self, self.plan);
        let pass = ByInputs { network, layer, by_activations, slopes, by_inputs };
        match plan.stack.inputs {
            3 => self.arch.dispatch(Axes::<3>(pass)),
            5 => self.arch.dispatch(Axes::<5>(pass)),
            axes => unreachable!("kernels are made for 3 and 5 inputs, not {axes}"),
        }
    }

    /// From derivatives by a layer's sums, or by its activations where there are slopes, as rows with a stride, to those by the neurons
    /// before it, `[row][stride]` into `out`. What is given is working memory.
    pub(crate) fn products_backwards(
        &self,
        layer: usize,
        (given, rows, stride): (&mut [f32], usize, usize),
        slopes: Option<&[f32]>,
        out: &mut [f32],
    ) {
        let split = self.split;
        let factor = split.and_then(|split| split.backward(layer, self.plan, self.parameters));
        if let Some((split, factor)) = split.zip(factor) {
            let left = Left { values: given, factors: slopes, rows, stride };
            let out = (out, self.plan.stride());
            return split.scratch.with(|scratch| factor.multiply(out, left, false, scratch));
        }
        if let Some(slopes) = slopes {
            vectorised!(self.arch, given.iter_mut().zip(slopes).for_each(|(value, slope)| *value *= slope));
        }
        let shape = &self.plan.layers[layer];
        let weights = &self.parameters[shape.weights..shape.biases];
        let weights = Matrix::row_major(weights, shape.outputs, self.plan.neurons_in(layer), shape.inputs);
        let by_sums = Matrix::row_major(given, rows, shape.outputs, stride);
        multiply(out, self.plan.stride(), by_sums, weights, false);
    }
}

/// `by_inputs [row][axis] += Σ by_activations · slopes · weights`, over a layer's neurons.
struct ByInputs<'a> {
    network: &'a Network<'a>,
    layer: usize,
    /// `[row][stride]`.
    by_activations: &'a [f32],
    slopes: &'a [f32],
    by_inputs: &'a mut [f32],
}

/// Of this many inputs, whose sums stay in registers.
struct Axes<'a, const N: usize>(ByInputs<'a>);

impl<const N: usize> WithSimd for Axes<'_, N> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ByInputs { network, layer, by_activations, slopes, by_inputs } = self.0;
        let (plan, stride) = (network.plan, network.plan.stride());
        let rows = by_activations.chunks_exact(stride).zip(slopes.chunks_exact(stride));
        for ((row, slopes), by_inputs) in rows.zip(by_inputs.as_chunks_mut::<N>().0) {
            let mut sums = [simd.splat_f32s(0.0); N];
            for neurons in plan.panels(layer) {
                let (first, columns) = (neurons.start, neurons.len());
                let weights =
                    &network.panels[plan.panel_range(layer, &neurons)][plan.neurons_in(layer) * columns..];
                let (row, slopes) = (&row[first..][..columns], &slopes[first..][..columns]);
                for at in (0..columns).step_by(S::F32_LANES) {
                    let by_sum = simd.mul_f32s(load(simd, row, at), load(simd, slopes, at));
                    for (sum, weights) in sums.iter_mut().zip(weights.chunks_exact(columns)) {
                        *sum = simd.mul_add_e_f32s(by_sum, load(simd, weights, at), *sum);
                    }
                }
            }
            for (by_input, sum) in by_inputs.iter_mut().zip(sums) {
                *by_input += simd.reduce_sum_f32s(sum);
            }
        }
    }
}
