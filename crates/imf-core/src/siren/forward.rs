//! The forward pass of a block of samples: products of panels, then bias, sine and slope while the panel's sums are
//! still in the core's cache.

use pulp::{Arch, Simd, WithSimd};

use super::lanes::{load, store};
use super::matrix::{Matrix, multiply};
use super::plan::Plan;
use super::sine::{sine, sine_cosine};
use crate::siren::INPUTS;

/// A network ready to run: its plan, its flat parameters and their transposed panels.
#[derive(Clone, Copy)]
pub(crate) struct Network<'a> {
    pub(crate) arch: Arch,
    pub(crate) plan: &'a Plan,
    pub(crate) parameters: &'a [f32],
    pub(crate) panels: &'a [f32],
}

impl Network<'_> {
    /// One hidden layer for one block: `sums [rows][stride]` becomes `sin(ω(W·a + b))` and, where asked for,
    /// `slopes [rows][stride]` its derivative `ω·cos(ω(W·a + b))` by the sum `W·a + b`.
    ///
    /// `previous [rows][stride]` are the activations before (unused by layer 0), `inputs [rows][5]` the samples.
    pub(crate) fn hidden_layer(
        &self,
        layer: usize,
        inputs: &[f32],
        previous: &[f32],
        sums: &mut [f32],
        mut slopes: Option<&mut [f32]>,
    ) {
        let plan = self.plan;
        let stride = plan.stride();
        let rows = inputs.len() / INPUTS;
        let neurons_in = plan.neurons_in(layer);
        for neurons in plan.panels() {
            let (first, columns) = (neurons.start, neurons.len());
            let panel = &self.panels[plan.panel_range(layer, &neurons)];
            if layer > 0 {
                let activations = Matrix::row_major(previous, rows, neurons_in, stride);
                let weights = Matrix::row_major(panel, neurons_in, columns, columns);
                multiply(&mut sums[first..], stride, activations, weights, false);
            }
            let pass = Activation {
                sums: &mut sums[first..],
                slopes: slopes.as_mut().map(|slopes| &mut slopes[first..]),
                stride,
                biases: &self.parameters[plan.layers[layer].biases + first..][..columns],
                inputs,
                input_weights: plan.sees_input(layer).then(|| &panel[neurons_in * columns..]),
                fresh: layer == 0,
                omega: plan.shape.omega,
            };
            self.arch.dispatch(pass);
        }
    }

    /// The output layer's sums (before the sigmoid) of a block: `last [rows][stride]` into `out [rows]`.
    pub(crate) fn logits(&self, last: &[f32], out: &mut [f32]) {
        let layer = self.plan.layers[self.plan.shape.hidden];
        let weights = &self.parameters[layer.weights..layer.biases];
        let bias = self.parameters[layer.biases];
        self.arch.dispatch(Dots { rows: last, stride: self.plan.stride(), weights, bias, out });
    }
}

/// The sigmoid, in f64: the output is one number a sample.
pub(crate) fn sigmoid(sum: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(sum)).exp())
}

/// Bias, the network's own inputs, sine and slope for one panel of one block.
struct Activation<'a> {
    /// Rows `stride` apart, from the panel's first neuron on.
    sums: &'a mut [f32],
    slopes: Option<&'a mut [f32]>,
    stride: usize,
    /// `[columns]`.
    biases: &'a [f32],
    /// `[rows][5]`.
    inputs: &'a [f32],
    /// `[5][columns]`, where the layer sees the network's inputs.
    input_weights: Option<&'a [f32]>,
    /// There is no product yet to add to.
    fresh: bool,
    omega: f32,
}

impl Activation<'_> {
    #[inline(always)]
    fn run<S: Simd, const FRESH: bool, const INPUT: bool>(self, simd: S) {
        let columns = self.biases.len();
        let omega = simd.splat_f32s(self.omega);
        let input_weights = self.input_weights.unwrap_or_default();
        let mut slopes = self.slopes;
        // A register of neurons at a time down the rows: its biases and input weights stay in registers.
        for at in (0..columns).step_by(S::F32_LANES) {
            let bias = load(simd, self.biases, at);
            let mut axes = [simd.splat_f32s(0.0); INPUTS];
            if INPUT {
                for (weights, line) in axes.iter_mut().zip(input_weights.chunks_exact(columns)) {
                    *weights = load(simd, line, at);
                }
            }
            for (row, sample) in self.inputs.chunks_exact(INPUTS).enumerate() {
                let sums = &mut self.sums[row * self.stride..][..columns];
                let mut sum = bias;
                if !FRESH {
                    sum = simd.add_f32s(load(simd, sums, at), sum);
                }
                if INPUT {
                    for (&value, &weights) in sample.iter().zip(&axes) {
                        sum = simd.mul_add_e_f32s(simd.splat_f32s(value), weights, sum);
                    }
                }
                let angle = simd.mul_f32s(omega, sum);
                if let Some(slopes) = &mut slopes {
                    let (sine, cosine) = sine_cosine(simd, angle);
                    store(simd, sums, at, sine);
                    store(
                        simd,
                        &mut slopes[row * self.stride..][..columns],
                        at,
                        simd.mul_f32s(omega, cosine),
                    );
                } else {
                    store(simd, sums, at, sine(simd, angle));
                }
            }
        }
    }
}

impl WithSimd for Activation<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.fresh, self.input_weights.is_some()) {
            (true, _) => self.run::<S, true, true>(simd),
            (false, true) => self.run::<S, false, true>(simd),
            (false, false) => self.run::<S, false, false>(simd),
        }
    }
}

/// `out[i] = rows[i]·weights + bias`.
struct Dots<'a> {
    rows: &'a [f32],
    stride: usize,
    weights: &'a [f32],
    bias: f32,
    out: &'a mut [f32],
}

impl WithSimd for Dots<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.weights.len();
        for (row, out) in self.rows.chunks(self.stride).zip(self.out) {
            let row = &row[..width];
            let mut sums = [simd.splat_f32s(0.0); 4];
            for (step, at) in (0..width).step_by(S::F32_LANES).enumerate() {
                let sum = &mut sums[step % 4];
                *sum = simd.mul_add_e_f32s(load(simd, row, at), load(simd, self.weights, at), *sum);
            }
            let total = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), simd.add_f32s(sums[2], sums[3]));
            *out = simd.reduce_sum_f32s(total) + self.bias;
        }
    }
}
