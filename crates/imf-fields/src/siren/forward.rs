//! The forward pass of a block of samples: products of panels, then bias, sine and slope while the panel's sums are
//! still in the core's cache.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::lanes::{GROUP, load, store};
use super::matrix::{Matrix, multiply};
use super::plan::Plan;
use super::sine::{sine, sine_cosine};
use super::split::{Left, SplitWeights};
use super::stack::Ending;

/// A network ready to run: its plan, its flat parameters and their transposed panels.
#[derive(Clone, Copy)]
pub struct Network<'a> {
    /// The instruction set.
    pub arch: Arch,
    /// The network in pieces.
    pub plan: &'a Plan,
    /// The flat parameters.
    pub parameters: &'a [f32],
    /// The weights transposed, panel by panel.
    pub panels: &'a [f32],
    /// The weights for products by tiles.
    pub(crate) split: Option<&'a SplitWeights>,
}

impl<'a> Network<'a> {
    /// With products in `f32`.
    #[must_use]
    pub fn new(arch: Arch, plan: &'a Plan, parameters: &'a [f32], panels: &'a [f32]) -> Self {
        Self { arch, plan, parameters, panels, split: None }
    }

    /// One hidden layer for one block: `sums [rows][stride]` becomes `sin(ω(W·a + b))` and, if wanted,
    /// `slopes [rows][stride]` its derivative `ω·cos(ω(W·a + b))` by the sum `W·a + b`.
    ///
    /// `previous [rows][stride]` are the activations before (unused by layer 0), `inputs [rows][inputs]` the samples.
    pub fn hidden_layer(
        &self,
        layer: usize,
        inputs: &[f32],
        previous: &[f32],
        sums: &mut [f32],
        mut slopes: Option<&mut [f32]>,
    ) {
        let plan = self.plan;
        let stride = plan.stride();
        let rows = inputs.len() / plan.stack.inputs;
        let neurons_in = plan.neurons_in(layer);
        let multiplied = layer > 0 && self.multiply_split(layer, previous, rows, sums, stride, false);
        for neurons in plan.panels(layer) {
            if layer > 0 && !multiplied {
                let panel = &self.panels[plan.panel_range(layer, &neurons)];
                let activations = Matrix::row_major(previous, rows, neurons_in, stride);
                let weights = Matrix::row_major(panel, neurons_in, neurons.len(), neurons.len());
                multiply(&mut sums[neurons.start..], stride, activations, weights, false);
            }
            self.activate(layer, neurons, inputs, sums, slopes.as_deref_mut());
        }
    }

    /// A layer's products by tiles; false, and nothing is done, where there are none.
    fn multiply_split(
        &self,
        layer: usize,
        previous: &[f32],
        rows: usize,
        sums: &mut [f32],
        stride: usize,
        accumulate: bool,
    ) -> bool {
        let Some((split, factor)) = self.split.and_then(|split| Some((split, split.forward(layer)?))) else {
            return false;
        };
        let left = Left { values: previous, factors: None, rows, stride: self.plan.stride() };
        split.scratch.with(|scratch| factor.multiply((sums, stride), left, accumulate, scratch));
        true
    }

    /// From the sums of a panel's products (of layer 0: from nothing) to its activations and slopes, as
    /// [`Self::hidden_layer`].
    pub fn activate(
        &self,
        layer: usize,
        neurons: Range<usize>,
        inputs: &[f32],
        sums: &mut [f32],
        slopes: Option<&mut [f32]>,
    ) {
        let plan = self.plan;
        let (first, columns) = (neurons.start, neurons.len());
        let panel = &self.panels[plan.panel_range(layer, &neurons)];
        let pass = Activation {
            sums: &mut sums[first..],
            slopes: slopes.map(|slopes| &mut slopes[first..]),
            stride: plan.stride(),
            biases: &self.parameters[plan.layers[layer].biases + first..][..columns],
            inputs,
            axes: plan.stack.inputs,
            input_weights: plan.sees_input(layer).then(|| &panel[plan.neurons_in(layer) * columns..]),
            fresh: layer == 0,
            omega: plan.stack.omega,
        };
        self.arch.dispatch(pass);
    }

    /// All hidden layers of a block without their slopes, by turns in two buffers `[rows][stride]`; the last one's
    /// activations are returned.
    pub(crate) fn hidden_layers<'b>(
        &self,
        inputs: &[f32],
        mut previous: &'b mut [f32],
        mut next: &'b mut [f32],
    ) -> &'b [f32] {
        let values = inputs.len() / self.plan.stack.inputs * self.plan.stride();
        for layer in 0..self.plan.stack.hidden {
            self.hidden_layer(layer, inputs, &previous[..values], next, None);
            std::mem::swap(&mut previous, &mut next);
        }
        &previous[..values]
    }

    /// The output layer's sums of a block, or its last sines where there is none: `last [rows][stride]` into
    /// `out [rows][outputs]`.
    pub fn outputs(&self, last: &[f32], out: &mut [f32]) {
        let Plan { stack, .. } = *self.plan;
        if stack.ending == Ending::Sines {
            for (out, last) in out.chunks_exact_mut(stack.width).zip(last.chunks_exact(self.plan.stride())) {
                out.copy_from_slice(&last[..stack.width]);
            }
            return;
        }
        let layer = self.plan.layers[stack.hidden];
        let biases = &self.parameters[layer.biases..][..stack.outputs];
        if stack.ending == Ending::Sigmoid {
            let weights = &self.parameters[layer.weights..layer.biases];
            self.arch.dispatch(Dots {
                rows: last,
                stride: self.plan.stride(),
                weights,
                bias: biases[0],
                out,
            });
            return;
        }
        let rows = out.len() / stack.outputs;
        out.chunks_exact_mut(stack.outputs).for_each(|row| row.copy_from_slice(biases));
        if self.multiply_split(stack.hidden, last, rows, out, stack.outputs, true) {
            return;
        }
        let last = Matrix::row_major(last, rows, stack.width, self.plan.stride());
        for neurons in self.plan.panels(stack.hidden) {
            let (first, columns) = (neurons.start, neurons.len());
            let panel = &self.panels[self.plan.panel_range(stack.hidden, &neurons)];
            let weights = Matrix::row_major(panel, stack.width, columns, columns);
            multiply(&mut out[first..], stack.outputs, last, weights, true);
        }
    }
}

/// Bias, the network's own inputs, sine and slope for one panel of one block.
struct Activation<'a> {
    /// Rows `stride` apart, from the panel's first neuron on.
    sums: &'a mut [f32],
    slopes: Option<&'a mut [f32]>,
    stride: usize,
    /// `[columns]`.
    biases: &'a [f32],
    /// `[rows][axes]`.
    inputs: &'a [f32],
    /// Inputs of the network.
    axes: usize,
    /// `[axes][columns]`, where the layer sees the network's inputs.
    input_weights: Option<&'a [f32]>,
    /// There is no product yet to add to.
    fresh: bool,
    omega: f32,
}

impl Activation<'_> {
    #[inline(always)]
    fn run<S: Simd, const FRESH: bool, const INPUT: bool, const AXES: usize>(mut self, simd: S) {
        let group = GROUP * S::F32_LANES;
        let whole = self.biases.len() / group * group;
        for at in (0..whole).step_by(group) {
            self.columns::<S, FRESH, INPUT, AXES, GROUP>(simd, at);
        }
        for at in (whole..self.biases.len()).step_by(S::F32_LANES) {
            self.columns::<S, FRESH, INPUT, AXES, 1>(simd, at);
        }
    }

    /// `N` registers of neurons from `first` on, down the rows: their biases and input weights stay in registers.
    #[inline(always)]
    fn columns<S: Simd, const FRESH: bool, const INPUT: bool, const AXES: usize, const N: usize>(
        &mut self,
        simd: S,
        first: usize,
    ) {
        let columns = self.biases.len();
        let omega = simd.splat_f32s(self.omega);
        let input_weights = self.input_weights.unwrap_or_default();
        let at: [usize; N] = std::array::from_fn(|place| first + place * S::F32_LANES);
        let biases = at.map(|at| load(simd, self.biases, at));
        let mut axes = [[simd.splat_f32s(0.0); N]; AXES];
        if INPUT {
            for (weights, line) in axes.iter_mut().zip(input_weights.chunks_exact(columns)) {
                *weights = at.map(|at| load(simd, line, at));
            }
        }
        for (row, sample) in self.inputs.chunks_exact(AXES).enumerate() {
            let sums = &mut self.sums[row * self.stride..][..columns];
            let mut angles = biases;
            if !FRESH {
                for (sum, &at) in angles.iter_mut().zip(&at) {
                    *sum = simd.add_f32s(load(simd, sums, at), *sum);
                }
            }
            if INPUT {
                for (&value, weights) in sample.iter().zip(&axes) {
                    let value = simd.splat_f32s(value);
                    for (sum, &weights) in angles.iter_mut().zip(weights) {
                        *sum = simd.mul_add_e_f32s(value, weights, *sum);
                    }
                }
            }
            let angles = angles.map(|sum| simd.mul_f32s(omega, sum));
            if let Some(slopes) = &mut self.slopes {
                let slopes = &mut slopes[row * self.stride..][..columns];
                for (&angle, &at) in angles.iter().zip(&at) {
                    let (sine, cosine) = sine_cosine(simd, angle);
                    store(simd, sums, at, sine);
                    store(simd, slopes, at, simd.mul_f32s(omega, cosine));
                }
            } else {
                for (&angle, &at) in angles.iter().zip(&at) {
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
        match (self.axes, self.fresh, self.input_weights.is_some()) {
            (5, true, _) => self.run::<S, true, true, 5>(simd),
            (5, false, true) => self.run::<S, false, true, 5>(simd),
            (5, false, false) => self.run::<S, false, false, 5>(simd),
            (3, true, _) => self.run::<S, true, true, 3>(simd),
            (3, false, true) => self.run::<S, false, true, 3>(simd),
            (3, false, false) => self.run::<S, false, false, 3>(simd),
            (axes, ..) => unreachable!("kernels are made for 3 and 5 inputs, not {axes}"),
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
