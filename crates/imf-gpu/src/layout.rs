//! The padded layout of the parameters on the device, and the way from and to the flat one.
//!
//! Every dimension is rounded up to the matrix kernel's padding P; the columns of a layer with the skip are the padded
//! activations, then the padded inputs, so that both blocks stay aligned:
//!
//! ```text
//! | W₀ [out₀'][in₀'] | b₀ [out₀'] | W₁ [out₁'][in₁'] | b₁ [out₁'] | …
//! in₀' = ⌈inputs⌉;  in_skip' = ⌈width⌉ + ⌈inputs⌉;  other in' = ⌈width⌉;  out' = ⌈width⌉, at the end ⌈outputs⌉;  ⌈n⌉ = n rounded up to P
//! ```
//!
//! Why the zeros alter nothing: a neuron of padding has no weights and no bias, so it is sin(0) = 0 and adds nothing
//! forwards. Its weights to the next layer are 0, so its delta is 0, so are the gradients of its weights; weights from
//! it have gradient Δ·0. Adam leaves a parameter alone whose value, moments and gradient are 0. Rows of padding have a delta of
//! 0 from the start. `tests/gpu/training.rs` fills all scratch memory with NaN first and finds the same bits.

use imf_fields::siren::Layer;
use imf_fields::siren::stack::Stack;

/// One layer in the padded layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PaddedLayer {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) weights: usize,
    pub(crate) biases: usize,
    /// Column of the signal where the network's inputs start, for the layers that take them.
    pub(crate) input_block: Option<usize>,
}

/// A network's parameters in both layouts.
#[derive(Clone, Debug)]
pub(crate) struct PaddedLayout {
    pub(crate) stack: Stack,
    pub(crate) padding: usize,
    pub(crate) layers: Vec<PaddedLayer>,
    /// Parameters, padding included.
    pub(crate) parameters: usize,
    plain: Vec<Layer>,
}

impl PaddedLayout {
    pub(crate) fn new(stack: Stack, padding: usize) -> Self {
        let plain = stack.layers();
        let width = stack.width.next_multiple_of(padding);
        let mut parameters = 0;
        let layers = plain
            .iter()
            .enumerate()
            .map(|(index, layer)| {
                let input_block = match index {
                    0 => Some(0),
                    _ => layer.skip.then_some(width),
                };
                let inputs =
                    input_block.map_or(width, |offset| offset + stack.inputs.next_multiple_of(padding));
                let outputs = layer.outputs.next_multiple_of(padding);
                let weights = parameters;
                let biases = weights + inputs * outputs;
                parameters = biases + outputs;
                PaddedLayer { inputs, outputs, weights, biases, input_block }
            })
            .collect();
        Self { stack, padding, layers, parameters, plain }
    }

    /// Columns that the network's inputs take in a signal.
    pub(crate) fn input_columns(&self) -> usize {
        self.stack.inputs.next_multiple_of(self.padding)
    }

    /// Those of [`Stack::between`].
    pub(crate) fn between(&self) -> &[PaddedLayer] {
        &self.layers[self.stack.between()]
    }

    /// The same without padding.
    pub(crate) fn learnt_between(&self) -> &[Layer] {
        &self.plain[self.stack.between()]
    }

    /// Flat parameters into the padded layout, zeros in the padding.
    pub(crate) fn pad(&self, flat: &[f32]) -> Vec<f32> {
        let mut padded = vec![0.0; self.parameters];
        self.for_each(|at, to| padded[to] = flat[at]);
        padded
    }

    /// Padded parameters into the flat layout.
    pub(crate) fn unpad(&self, padded: &[f32]) -> Vec<f32> {
        let mut flat = vec![0.0; self.stack.parameter_count()];
        self.for_each(|to, at| flat[to] = padded[at]);
        flat
    }

    /// Calls `pair(flat index, padded index)` for every parameter.
    fn for_each(&self, mut pair: impl FnMut(usize, usize)) {
        for (plain, padded) in self.plain.iter().zip(&self.layers) {
            for row in 0..plain.outputs {
                for column in 0..plain.inputs {
                    let to = match padded.input_block {
                        Some(offset) if plain.skip && column >= self.stack.width => {
                            offset + column - self.stack.width
                        }
                        _ => column,
                    };
                    pair(
                        plain.weights + row * plain.inputs + column,
                        padded.weights + row * padded.inputs + to,
                    );
                }
                pair(plain.biases + row, padded.biases + row);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use imf_fields::siren::SirenShape;

    use super::*;

    #[test]
    fn padding_and_back_is_the_identity_and_the_rest_is_zero() {
        for (width, padding) in [(37, 8), (64, 8), (37, 64), (1, 64)] {
            let shape = SirenShape { width, hidden: 4, skip_after: Some(2), omega: 30.0 };
            let layout = PaddedLayout::new(shape.stack(), padding);
            let flat: Vec<f32> = (1..=shape.parameter_count()).map(|value| value as f32).collect();
            let padded = layout.pad(&flat);
            assert_eq!(layout.unpad(&padded), flat);
            assert_eq!(padded.iter().filter(|&&value| value != 0.0).count(), flat.len());
        }
    }

    #[test]
    fn every_dimension_is_a_multiple_of_the_padding() {
        let shape = SirenShape { width: 37, hidden: 3, skip_after: Some(1), omega: 30.0 };
        let layout = PaddedLayout::new(shape.stack(), 8);
        assert_eq!(layout.layers[1].inputs, 48);
        assert_eq!(layout.layers[1].input_block, Some(40));
        for layer in &layout.layers {
            assert!([layer.inputs, layer.outputs, layer.weights, layer.biases].iter().all(|n| n % 8 == 0));
        }
    }
}
