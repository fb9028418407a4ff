//! The backward pass of a block of samples: from the loss's slope to every layer's `δ = ∂loss/∂(W·a + b)`, which
//! replaces the slopes that the forward pass left, and to the block's partial sums (see `plan.rs`).

use std::ops::Range;

use pulp::{Simd, WithSimd};

use imf_fields::siren::forward::Network;
use imf_fields::siren::lanes::{GROUP, load, store};
use imf_fields::siren::matrix::{Matrix, multiply};

#[derive(Clone, Copy)]
pub(crate) struct Backward<'a>(pub(crate) &'a Network<'a>);

impl Backward<'_> {
    /// δ of the last hidden layer and the output layer's sums, before a sigmoid. `output_deltas [rows]` is δ of the output; `slopes` are
    /// the layer's, `last` its activations, both `[rows][stride]`.
    pub(crate) fn output_backward(
        &self,
        inputs: &[f32],
        output_deltas: &[f32],
        last: &[f32],
        slopes: &mut [f32],
        partial: &mut [f32],
    ) {
        let plan = self.0.plan;
        let width = plan.stack.width;
        let output = plan.layers[plan.stack.hidden];
        let (sums, bias) = partial[plan.partial_output()..].split_at_mut(width);
        bias[0] = output_deltas.iter().sum();
        self.0.arch.dispatch(WeightedRows { rows: last, stride: plan.stride(), scales: output_deltas, sums });
        let weights = &self.0.parameters[output.weights..output.biases];
        let upstream = Upstream::Outer { scales: output_deltas, weights };
        self.deltas(plan.stack.hidden - 1, 0, width, inputs, upstream, slopes, partial);
    }

    /// The bias sums of a linear output from its `deltas [rows][outputs]`.
    pub(crate) fn output_biases(&self, deltas: &[f32], partial: &mut [f32]) {
        let outputs = self.0.plan.stack.outputs;
        let sums = &mut partial[self.0.plan.partial_output()..][..outputs];
        sums.fill(0.0);
        for row in deltas.chunks_exact(outputs) {
            sums.iter_mut().zip(row).for_each(|(sum, delta)| *sum += delta);
        }
    }

    /// δ of hidden layer `layer` from δ of the one behind it, `next [rows]` with [`imf_fields::siren::plan::Plan::row_stride`]. `scratch` holds one panel of
    /// all rows.
    pub(crate) fn hidden_backward(
        &self,
        layer: usize,
        inputs: &[f32],
        next: &[f32],
        slopes: &mut [f32],
        partial: &mut [f32],
        scratch: &mut [f32],
    ) {
        let plan = self.0.plan;
        let rows = inputs.len() / plan.stack.inputs;
        let behind = plan.layers[layer + 1];
        let next = Matrix::row_major(next, rows, behind.outputs, plan.row_stride(layer + 1));
        for neurons in plan.panels(layer) {
            let (first, columns) = (neurons.start, neurons.len());
            let weights = &self.0.parameters[behind.weights + first..behind.biases];
            let weights = Matrix::row_major(weights, behind.outputs, columns, behind.inputs);
            multiply(scratch, columns, next, weights, false);
            self.panel_deltas(layer, &neurons, inputs, scratch, slopes, partial);
        }
    }

    /// δ of a panel of a hidden layer from `upstream [rows][neurons]`, the panel's part of δ·W of the layer behind.
    pub(crate) fn panel_deltas(
        &self,
        layer: usize,
        neurons: &Range<usize>,
        inputs: &[f32],
        upstream: &[f32],
        slopes: &mut [f32],
        partial: &mut [f32],
    ) {
        let upstream = Upstream::Rows(upstream);
        self.deltas(layer, neurons.start, neurons.len(), inputs, upstream, slopes, partial);
    }

    fn deltas(
        &self,
        layer: usize,
        first: usize,
        columns: usize,
        inputs: &[f32],
        upstream: Upstream<'_>,
        slopes: &mut [f32],
        partial: &mut [f32],
    ) {
        let plan = self.0.plan;
        let width = plan.stack.width;
        // Biases stand before the sums of the input weights in a partial.
        let (biases, rest) = partial.split_at_mut(plan.stack.hidden * width);
        let offset = plan.partial_inputs(layer) - plan.stack.hidden * width;
        let pass = Deltas {
            upstream,
            slopes: &mut slopes[first..],
            stride: plan.stride(),
            width,
            inputs,
            axes: plan.stack.inputs,
            biases: &mut biases[plan.partial_biases(layer) + first..][..columns],
            input_sums: plan.sees_input(layer).then(|| &mut rest[offset + first..]),
        };
        self.0.arch.dispatch(pass);
    }
}

/// `∂loss/∂a` of a panel of neurons.
enum Upstream<'a> {
    /// `[rows][columns]`, as a product leaves it.
    Rows(&'a [f32]),
    /// `scales[i]·weights[j]`: behind the last hidden layer is one neuron.
    Outer { scales: &'a [f32], weights: &'a [f32] },
}

/// `slopes ← slopes·upstream`; its sums over the block, alone and weighted by the samples' inputs, replace what was there.
struct Deltas<'a> {
    upstream: Upstream<'a>,
    /// Rows `stride` apart, from the panel's first neuron on.
    slopes: &'a mut [f32],
    stride: usize,
    /// Distance of two axes in `input_sums`.
    width: usize,
    /// `[rows][axes]`.
    inputs: &'a [f32],
    /// Inputs of the network.
    axes: usize,
    /// `[columns]`.
    biases: &'a mut [f32],
    /// `axes` rows `width` apart, from the panel's first neuron on.
    input_sums: Option<&'a mut [f32]>,
}

impl Deltas<'_> {
    #[inline(always)]
    fn run<S: Simd, const INPUT: bool, const AXES: usize>(mut self, simd: S) {
        let group = GROUP * S::F32_LANES;
        let whole = self.biases.len() / group * group;
        for at in (0..whole).step_by(group) {
            self.columns::<S, INPUT, AXES, GROUP>(simd, at);
        }
        for at in (whole..self.biases.len()).step_by(S::F32_LANES) {
            self.columns::<S, INPUT, AXES, 1>(simd, at);
        }
    }

    /// `N` registers of neurons from `first` on, down the rows: their sums stay in registers.
    #[inline(always)]
    fn columns<S: Simd, const INPUT: bool, const AXES: usize, const N: usize>(
        &mut self,
        simd: S,
        first: usize,
    ) {
        let columns = self.biases.len();
        let at: [usize; N] = std::array::from_fn(|place| first + place * S::F32_LANES);
        let mut biases = [simd.splat_f32s(0.0); N];
        let mut axes = [[simd.splat_f32s(0.0); N]; AXES];
        for (row, sample) in self.inputs.chunks_exact(AXES).enumerate() {
            let factors = match &self.upstream {
                Upstream::Rows(rows) => {
                    let row = &rows[row * columns..][..columns];
                    at.map(|at| load(simd, row, at))
                }
                Upstream::Outer { scales, weights } => {
                    let scale = simd.splat_f32s(scales[row]);
                    at.map(|at| simd.mul_f32s(scale, load(simd, weights, at)))
                }
            };
            let slopes = &mut self.slopes[row * self.stride..][..columns];
            let mut deltas = factors;
            for (delta, &at) in deltas.iter_mut().zip(&at) {
                *delta = simd.mul_f32s(load(simd, slopes, at), *delta);
                store(simd, slopes, at, *delta);
            }
            for (bias, &delta) in biases.iter_mut().zip(&deltas) {
                *bias = simd.add_f32s(*bias, delta);
            }
            if INPUT {
                for (sums, &value) in axes.iter_mut().zip(sample) {
                    let value = simd.splat_f32s(value);
                    for (sum, &delta) in sums.iter_mut().zip(&deltas) {
                        *sum = simd.mul_add_e_f32s(value, delta, *sum);
                    }
                }
            }
        }
        for (&bias, &at) in biases.iter().zip(&at) {
            store(simd, self.biases, at, bias);
        }
        if INPUT {
            let input_sums = self.input_sums.as_deref_mut().unwrap_or_default();
            for (axis, sums) in axes.iter().enumerate() {
                let line = &mut input_sums[axis * self.width..][..columns];
                for (&sum, &at) in sums.iter().zip(&at) {
                    store(simd, line, at, sum);
                }
            }
        }
    }
}

impl WithSimd for Deltas<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.axes, self.input_sums.is_some()) {
            (5, true) => self.run::<S, true, 5>(simd),
            (5, false) => self.run::<S, false, 5>(simd),
            (3, true) => self.run::<S, true, 3>(simd),
            (3, false) => self.run::<S, false, 3>(simd),
            (axes, _) => unreachable!("kernels are made for 3 and 5 inputs, not {axes}"),
        }
    }
}

/// `sums[j] = Σ_i scales[i]·rows[i][j]`.
struct WeightedRows<'a> {
    rows: &'a [f32],
    stride: usize,
    scales: &'a [f32],
    sums: &'a mut [f32],
}

impl WithSimd for WeightedRows<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.sums.len();
        for at in (0..width).step_by(S::F32_LANES) {
            let mut sum = simd.splat_f32s(0.0);
            for (row, &scale) in self.rows.chunks(self.stride).zip(self.scales) {
                sum = simd.mul_add_e_f32s(simd.splat_f32s(scale), load(simd, &row[..width], at), sum);
            }
            store(simd, self.sums, at, sum);
        }
    }
}
