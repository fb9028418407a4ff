//! Blocks of samples through the network and back, one core a block.

use crate::engine::backward::Backward;
use imf_fields::recipe::Loss;
use imf_fields::siren::forward::Network;
use imf_fields::siren::output::Output;
use imf_fields::siren::plan::BLOCK;
use imf_fields::siren::scratch::ScratchPool;
use imf_fields::siren::stack::{Stack, TrainedEnding};

/// Most hidden layers of a network ([`imf_fields::siren::SirenShape::check`]).
const MAX_HIDDEN: usize = 64;

/// A `[hidden][samples][stride]` array as one slice for each layer, so that it can be split between samples.
pub(super) struct Layers<'a>([&'a mut [f32]; MAX_HIDDEN]);

impl<'a> Layers<'a> {
    pub(super) fn new(array: &'a mut [f32], layer_length: usize) -> Self {
        let mut layers = array.chunks_mut(layer_length);
        Self(std::array::from_fn(|_| layers.next().unwrap_or_default()))
    }

    /// The first `middle` values of every layer, and the others.
    fn split(self, middle: usize) -> (Self, Self) {
        let mut tails = Self(std::array::from_fn(|_| <&mut [f32]>::default()));
        let mut heads = self;
        for (head, tail) in heads.0.iter_mut().zip(&mut tails.0) {
            if !head.is_empty() {
                (*head, *tail) = std::mem::take(head).split_at_mut(middle);
            }
        }
        (heads, tails)
    }
}

/// The loss at the end of a network.
#[derive(Clone, Copy)]
pub(super) struct BlockLoss {
    pub(super) loss: Loss,
    /// Samples of the whole batch, which the loss is averaged over.
    pub(super) batch: f64,
    pub(super) ending: TrainedEnding,
}

impl BlockLoss {
    /// The summed loss of some samples; the output layer's sums become its δ.
    pub(super) fn take(self, outputs: &mut [f32], targets: &[f32]) -> f64 {
        let mut loss = 0.0;
        for (delta, &target) in outputs.iter_mut().zip(targets) {
            let target = f64::from(target);
            let (output, slope) = match self.ending {
                TrainedEnding::Sigmoid => Output::of_sum(f64::from(*delta)).learnt(target),
                TrainedEnding::Linear => (f64::from(*delta), 1.0),
            };
            loss += self.loss.value(output, target);
            *delta = (self.loss.slope(output, target) / self.batch * slope) as f32;
        }
        loss
    }
}

/// Takes blocks of samples through the network and back.
pub(super) struct BlockPass<'a> {
    pub(super) network: Network<'a>,
    pub(super) loss: BlockLoss,
    pub(super) scratch: &'a ScratchPool,
}

impl BlockPass<'_> {
    /// Splits the samples between blocks until one block is left.
    pub(super) fn run(
        &self,
        inputs: &[f32],
        targets: &[f32],
        activations: Layers<'_>,
        slopes: Layers<'_>,
        outputs: &mut [f32],
        partials: &mut [f32],
        losses: &mut [f64],
    ) {
        let blocks = losses.len();
        if blocks == 1 {
            losses[0] = self
                .scratch
                .with(|scratch| self.block(inputs, targets, activations, slopes, outputs, partials, scratch));
            return;
        }
        let stack = self.network.plan.stack;
        let middle = blocks / 2;
        let samples = middle * BLOCK;
        let values = samples * self.network.plan.stride();
        let inputs = inputs.split_at(samples * stack.inputs);
        let targets = targets.split_at(samples * stack.outputs);
        let outputs = outputs.split_at_mut(samples * stack.outputs);
        let activations = activations.split(values);
        let slopes = slopes.split(values);
        let partials = partials.split_at_mut(middle * self.network.plan.partial_length());
        let losses = losses.split_at_mut(middle);
        rayon::join(
            || self.run(inputs.0, targets.0, activations.0, slopes.0, outputs.0, partials.0, losses.0),
            || self.run(inputs.1, targets.1, activations.1, slopes.1, outputs.1, partials.1, losses.1),
        );
    }

    /// One block forward and backward; its summed loss.
    fn block(
        &self,
        inputs: &[f32],
        targets: &[f32],
        activations: Layers<'_>,
        slopes: Layers<'_>,
        outputs: &mut [f32],
        partial: &mut [f32],
        scratch: &mut [f32],
    ) -> f64 {
        let network = &self.network;
        let Stack { inputs: axes, hidden, .. } = network.plan.stack;
        let values = inputs.len() / axes * network.plan.stride();
        let (Layers(mut activations), Layers(mut slopes)) = (activations, slopes);
        for layer in 0..hidden {
            let (before, from) = activations.split_at_mut(layer);
            let previous = before.last().map_or(&[][..], |previous| &previous[..values]);
            network.hidden_layer(layer, inputs, previous, from[0], Some(slopes[layer]));
        }
        let last = &activations[hidden - 1][..values];
        network.outputs(last, outputs);
        let loss = self.loss.take(outputs, targets);
        let front = match self.loss.ending {
            TrainedEnding::Sigmoid => {
                Backward(network).output_backward(inputs, outputs, last, slopes[hidden - 1], partial);
                hidden - 1
            }
            TrainedEnding::Linear => {
                Backward(network).output_biases(outputs, partial);
                hidden
            }
        };
        for layer in (0..front).rev() {
            let (before, behind) = slopes.split_at_mut(layer + 1);
            let next = if layer + 1 == hidden { &*outputs } else { &behind[0][..values] };
            Backward(network).hidden_backward(layer, inputs, next, before[layer], partial, scratch);
        }
        loss
    }
}
