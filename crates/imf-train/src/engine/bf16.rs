//! The engine's products in bfloat16: what is packed when, and where it lies.
//!
//! Only the products between hidden layers are rounded: their factors to bfloat16, the sums stay in `f32`. Bias, sine, the
//! network's own inputs, the output, the loss, the sums for biases and Adam are those of the `f32` engine.
//!
//! ```text
//! weights  [layers 1..hidden][panels][forward | backward]     packed before each step
//!          forward   strips of the panel's neurons, pairs along the layer's inputs
//!          backward  strips of the layer's inputs, pairs along the panel's neurons
//! window   [blocks][activations | δ][layers but one][P]       pairs along the samples of a block, for the gradient
//! ```
//!
//! A block's activations and slopes in `f32` live in the scratch of the core that has it, and are gone after it.

use rayon::prelude::*;

use crate::engine::BlockLoss;
use crate::engine::backward::Backward;
use imf_fields::siren::bf16_kernel::{Extent, Kernel, Product, STRIP};
use imf_fields::siren::forward::Network;
use imf_fields::siren::plan::{BLOCK, PANEL, Plan};
use imf_fields::siren::scratch::{Lines, ScratchPool};

/// Pairs of a panel's neurons.
const PANEL_PAIRS: usize = PANEL / 2;
/// Pairs of a block's samples.
const BLOCK_PAIRS: usize = BLOCK / 2;

/// Packed weights, and what a window leaves for the gradient.
pub(super) struct Pairs {
    kernel: Kernel,
    sizes: Sizes,
    weights: Lines<u32>,
    window: Lines<u32>,
    scratch: ScratchPool,
}

/// Lengths that follow from the network.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    width: usize,
    hidden: usize,
    stride: usize,
    panels: usize,
    /// Pairs along a layer's inputs.
    input_pairs: usize,
    /// The forward part of a panel's weights.
    forward: usize,
    /// A panel's weights.
    panel: usize,
    /// `P`: one layer of a block.
    layer: usize,
}

impl Sizes {
    fn new(plan: &Plan) -> Self {
        let width = plan.stack.width;
        let (panels, strips) = (width.div_ceil(PANEL), width.div_ceil(STRIP));
        let input_pairs = width.div_ceil(2).next_multiple_of(16);
        let forward = PANEL.min(width).div_ceil(STRIP) * input_pairs * STRIP;
        Self {
            width,
            hidden: plan.stack.hidden,
            stride: plan.stride(),
            panels,
            input_pairs,
            forward,
            panel: forward + strips * PANEL_PAIRS * STRIP,
            layer: strips * BLOCK_PAIRS * STRIP,
        }
    }

    /// Products between hidden layers.
    fn between(self) -> usize {
        self.hidden - 1
    }

    fn weights(self) -> usize {
        self.between() * self.panels * self.panel
    }

    fn block(self) -> usize {
        2 * self.between() * self.layer
    }

    /// Pairs of a row of activations or δ: a whole number of panels, and 16 that are nobody's: where rows lie a power of two
    /// apart, those of a tile push each other out of the cache, which makes the product three times as slow.
    fn row_pairs(self) -> usize {
        self.panels * PANEL_PAIRS + 16
    }

    /// One layer's activations, all layers' slopes, a panel of a block, a block's rows of pairs.
    fn scratch(self) -> usize {
        BLOCK * ((1 + self.hidden) * self.stride + PANEL.min(self.width) + self.row_pairs())
    }
}

impl Pairs {
    pub(super) fn new(kernel: Kernel, plan: &Plan, blocks: usize) -> Self {
        let sizes = Sizes::new(plan);
        Self {
            kernel,
            sizes,
            weights: Lines::new(sizes.weights()),
            window: Lines::new(blocks * sizes.block()),
            scratch: ScratchPool::new(sizes.scratch()),
        }
    }

    /// Bytes for a window of `blocks` blocks, for the packed weights, and for every thread.
    pub(super) fn memory_bytes(plan: &Plan, blocks: usize) -> u64 {
        let sizes = Sizes::new(plan);
        let scratch = rayon::current_num_threads() * sizes.scratch();
        4 * (sizes.weights() + blocks * sizes.block() + scratch) as u64
    }

    pub(super) fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Rounds the weights as they are now.
    pub(super) fn pack(&mut self, plan: &Plan, parameters: &[f32], panels: &[f32]) {
        let Self { kernel, sizes, .. } = *self;
        self.weights.par_chunks_mut(sizes.panel.max(1)).enumerate().for_each(|(index, packed)| {
            let (layer, first) = (1 + index / sizes.panels, index % sizes.panels * PANEL);
            let neurons = first..(first + PANEL).min(sizes.width);
            let range = plan.panel_range(layer, &neurons);
            let (forward, backward) = packed.split_at_mut(sizes.forward);
            let columns = neurons.len();
            let transposed = Extent { rows: sizes.width, columns, stride: columns };
            kernel.pack_strips(&panels[range.clone()], transposed, sizes.input_pairs, forward);
            let rows = Extent { rows: columns, columns: sizes.width, stride: plan.layers[layer].inputs };
            kernel.pack_strips(&parameters[range], rows, PANEL_PAIRS, backward);
        });
    }

    /// One window forward and backward; the loss of every block and the partial sums are left in their places, and the
    /// pairs for the gradient here.
    pub(super) fn forward_backward(
        &mut self,
        network: Network<'_>,
        loss: BlockLoss,
        inputs: &[f32],
        targets: &[f32],
        outputs: &mut [f32],
        partials: &mut [f32],
        losses: &mut [f64],
    ) {
        let Self { kernel, sizes, weights, window, scratch } = self;
        let block = Block { network, loss, kernel: *kernel, sizes: *sizes, weights };
        // A network of one hidden layer has no pairs: every block gets a slice of nothing.
        let mut pairs: [&mut [u32]; super::WINDOW / BLOCK] = Default::default();
        let mut rest = &mut window[..];
        for slot in pairs.iter_mut().take(losses.len()) {
            (*slot, rest) = std::mem::take(&mut rest).split_at_mut(sizes.block());
        }
        let axes = network.plan.stack.inputs;
        inputs
            .par_chunks(BLOCK * axes)
            .zip(targets.par_chunks(BLOCK))
            .zip(outputs.par_chunks_mut(BLOCK))
            .zip(partials.par_chunks_mut(network.plan.partial_length()))
            .zip(losses.par_iter_mut())
            .zip(pairs.par_iter_mut())
            .with_max_len(1)
            .for_each(|(((((inputs, targets), outputs), partial), loss), pairs)| {
                *loss = scratch.with(|scratch| block.run(inputs, targets, outputs, partial, pairs, scratch));
            });
    }

    /// The gradient of the weights of a panel of hidden layer `layer` (from 1 on) for their inputs that are neurons, from the
    /// first `blocks` blocks of the window: `gradient [neurons][inputs]`.
    pub(super) fn gradient(
        &self,
        layer: usize,
        neurons: std::ops::Range<usize>,
        blocks: usize,
        gradient: &mut [f32],
        inputs: usize,
        accumulate: bool,
    ) {
        let sizes = self.sizes;
        let deltas = (sizes.between() + layer - 1) * sizes.layer;
        let strip = BLOCK_PAIRS * STRIP;
        let product = Product {
            segments: blocks,
            pairs: BLOCK_PAIRS,
            left: &self.window[deltas + neurons.start / STRIP * strip..],
            left_row: 1,
            left_strip: strip,
            left_pair: STRIP,
            left_segment: sizes.block(),
            right: &self.window[(layer - 1) * sizes.layer..],
            right_strip: strip,
            right_segment: sizes.block(),
        };
        let result = Extent { rows: neurons.len(), columns: sizes.width, stride: inputs };
        self.kernel.multiply(gradient, result, product, accumulate);
    }
}

/// Takes a block of samples through the network and back.
#[derive(Clone, Copy)]
struct Block<'a> {
    network: Network<'a>,
    loss: BlockLoss,
    kernel: Kernel,
    sizes: Sizes,
    weights: &'a [u32],
}

impl Block<'_> {
    /// The block's summed loss. `pairs` are its part of the window.
    fn run(
        &self,
        inputs: &[f32],
        targets: &[f32],
        outputs: &mut [f32],
        partial: &mut [f32],
        pairs: &mut [u32],
        scratch: &mut [f32],
    ) -> f64 {
        let Self { network, sizes, .. } = *self;
        let rows = targets.len();
        let (activations, scratch) = scratch.split_at_mut(BLOCK * sizes.stride);
        let (slopes, scratch) = scratch.split_at_mut(sizes.hidden * BLOCK * sizes.stride);
        let (upstream, row_pairs) = scratch.split_at_mut(BLOCK * PANEL.min(sizes.width));
        let row_pairs: &mut [u32] = bytemuck::cast_slice_mut(row_pairs);
        let (kept_activations, kept_deltas) = pairs.split_at_mut(sizes.between() * sizes.layer);
        let slopes_of = |layer: usize| layer * BLOCK * sizes.stride..(layer + 1) * BLOCK * sizes.stride;

        network.hidden_layer(0, inputs, &[], activations, Some(&mut slopes[slopes_of(0)]));
        for layer in 1..sizes.hidden {
            self.pack(activations, rows, row_pairs, &mut kept_activations[(layer - 1) * sizes.layer..]);
            let slopes = &mut slopes[slopes_of(layer)];
            for neurons in network.plan.panels(layer) {
                let product = self.forward(layer, &neurons, row_pairs);
                let result = Extent { rows, columns: neurons.len(), stride: sizes.stride };
                self.kernel.multiply(&mut activations[neurons.start..], result, product, false);
                network.activate(layer, neurons, inputs, activations, Some(slopes));
            }
        }
        network.outputs(activations, outputs);
        let loss = self.loss.take(outputs, targets);
        let last = sizes.hidden - 1;
        Backward(&network).output_backward(
            inputs,
            outputs,
            activations,
            &mut slopes[slopes_of(last)],
            partial,
        );
        for layer in (0..last).rev() {
            let (before, behind) = slopes.split_at_mut((layer + 1) * BLOCK * sizes.stride);
            self.pack(behind, rows, row_pairs, &mut kept_deltas[layer * sizes.layer..]);
            for neurons in network.plan.panels(layer) {
                let product = self.backward(layer, &neurons, row_pairs);
                let result = Extent { rows, columns: neurons.len(), stride: neurons.len() };
                self.kernel.multiply(upstream, result, product, false);
                Backward(&network).panel_deltas(
                    layer,
                    &neurons,
                    inputs,
                    upstream,
                    &mut before[slopes_of(layer)],
                    partial,
                );
            }
        }
        loss
    }

    /// Rounds a layer's values once for the next product and once for the gradient.
    fn pack(&self, values: &[f32], rows: usize, row_pairs: &mut [u32], kept: &mut [u32]) {
        let Sizes { width, stride, .. } = self.sizes;
        let from = Extent { rows, columns: width, stride };
        self.kernel.pack_rows(values, from, self.sizes.row_pairs(), row_pairs);
        self.kernel.pack_strips(values, from, BLOCK_PAIRS, kept);
    }

    /// Activations by the weights of a panel of `layer`.
    fn forward<'p>(&self, layer: usize, neurons: &std::ops::Range<usize>, row_pairs: &'p [u32]) -> Product<'p>
    where
        Self: 'p,
    {
        let Sizes { panels, panel, input_pairs, .. } = self.sizes;
        Product {
            pairs: input_pairs,
            right: &self.weights[((layer - 1) * panels + neurons.start / PANEL) * panel..],
            right_strip: input_pairs * STRIP,
            ..self.rows(row_pairs)
        }
    }

    /// δ of the layer behind `layer` by the weights of a panel of neurons of `layer`.
    fn backward<'p>(
        &self,
        layer: usize,
        neurons: &std::ops::Range<usize>,
        row_pairs: &'p [u32],
    ) -> Product<'p>
    where
        Self: 'p,
    {
        let Sizes { panels, panel, forward, .. } = self.sizes;
        let first = layer * panels * panel + forward + neurons.start * PANEL_PAIRS;
        Product {
            segments: panels,
            pairs: PANEL_PAIRS,
            left_segment: PANEL_PAIRS,
            right: &self.weights[first..],
            right_strip: PANEL_PAIRS * STRIP,
            right_segment: panel,
            ..self.rows(row_pairs)
        }
    }

    /// A left factor of rows, and nothing on the right.
    fn rows<'p>(&self, row_pairs: &'p [u32]) -> Product<'p> {
        let row = self.sizes.row_pairs();
        Product {
            segments: 1,
            pairs: 0,
            left: row_pairs,
            left_row: row,
            left_strip: STRIP * row,
            left_pair: 1,
            left_segment: 0,
            right: &[],
            right_strip: 0,
            right_segment: 0,
        }
    }
}

#[cfg(test)]
mod tests;
