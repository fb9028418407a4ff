//! How the CPU engine cuts a network into pieces of work. Nothing here depends on the number of threads: that is why
//! results do not either.
//!
//! - A batch is cut into *windows*, whose activations stay in the last-level cache, and a window into *blocks* of
//!   [`BLOCK`] samples that pass through the whole network on one core.
//! - A hidden layer's neurons are cut into *panels*. A panel's weights are held twice: as rows of `W` in the flat
//!   parameters, and transposed, `[inputs][neurons of the panel]`, for the forward product, which is a third slower on
//!   a transposed view. The transposed panel has the same offset and length in its own array as the rows have in the
//!   parameters.
//! - The few inputs of the network, in the first layer and behind the skip, never become columns of a product:
//!   they are added where bias and sine are computed.
//! - A linear output layer is cut into panels as a hidden one; the one neuron of a sigmoid is a piece of its own.
//!
//! What a block adds up over its samples for the gradient is one *partial*:
//!
//! ```text
//! | biases [hidden][width] | first layer's weights [inputs][width] | skip's weights [inputs][width], if any | the end |
//! the end of a sigmoid: | output weights [width] | output bias |      of a linear output: | output biases [outputs] |
//! ```

use std::ops::Range;

use super::stack::{Ending, Stack};
use super::transpose::transpose;
use crate::siren::Layer;

/// Samples that one core takes through the network at a time: at width 512 a layer's values are 256 KiB, a quarter of
/// the level-2 cache; 64 lose 5 % in the products, 256 gain 2 % but halve the number of pieces.
pub const BLOCK: usize = 128;

/// Neurons of a panel; the last one of a layer may have fewer. Products of 64 columns are as fast as of 128 and spread
/// over more cores.
pub const PANEL: usize = 64;

/// Samples of a window, a whole number of blocks: at width 512 its activations and slopes are 21 MiB. Windows of 2048
/// and 4096 samples cost small networks 5 and 8 %, because their values leave the cache before they are used again.
pub const WINDOW: usize = 8 * BLOCK;

/// One piece of the update: a contiguous range of the flat parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// The layer, hidden layers first.
    pub layer: usize,
    /// Which part of it.
    pub part: Part,
    /// Where it stands in the flat parameters.
    pub range: Range<usize>,
}

/// What a piece of the update holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// Weights of one panel of neurons of a hidden layer or a linear output.
    Panel(Range<usize>),
    /// All biases of such a layer.
    Biases,
    /// Weights and bias of the one neuron behind a sigmoid.
    Output,
}

/// A network cut into pieces.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The network that is cut.
    pub stack: Stack,
    /// Its layers.
    pub layers: Vec<Layer>,
    /// Pieces of the update in the order of the flat parameters, which they tile.
    pub pieces: Vec<Piece>,
}

impl Plan {
    /// Cuts a network.
    #[must_use]
    pub fn new(stack: Stack) -> Self {
        let layers = stack.layers();
        let mut plan = Self { stack, layers, pieces: Vec::new() };
        for (index, layer) in plan.layers.iter().enumerate() {
            let end = layer.biases + layer.outputs;
            if index == stack.hidden && stack.ending == Ending::Sigmoid {
                plan.pieces.push(Piece { layer: index, part: Part::Output, range: layer.weights..end });
                continue;
            }
            for neurons in plan.panels(index) {
                let range = plan.panel_range(index, &neurons);
                plan.pieces.push(Piece { layer: index, part: Part::Panel(neurons), range });
            }
            plan.pieces.push(Piece { layer: index, part: Part::Biases, range: layer.biases..end });
        }
        plan
    }

    /// The panels of a layer, as ranges of neurons.
    pub fn panels(&self, layer: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let width = self.layers[layer].outputs;
        (0..width).step_by(PANEL).map(move |first| first..(first + PANEL).min(width))
    }

    /// Neurons of the widest panel.
    pub fn widest_panel(&self) -> usize {
        PANEL.min(self.stack.width.max(self.stack.outputs))
    }

    /// Parameters of the longest piece.
    pub fn longest_piece(&self) -> usize {
        self.pieces.iter().map(|piece| piece.range.len()).max().unwrap_or_default()
    }

    /// Where a panel's rows stand in the flat parameters and, transposed, in the array of panels.
    pub fn panel_range(&self, layer: usize, neurons: &Range<usize>) -> Range<usize> {
        let Layer { inputs, weights, .. } = self.layers[layer];
        weights + neurons.start * inputs..weights + neurons.end * inputs
    }

    /// Distance of two samples' rows in arrays of a hidden layer's activations and slopes. Rows 2 KiB or a multiple apart compete for
    /// few sets of the cache: 16 values more make the gradient's products 3 % faster.
    pub fn stride(&self) -> usize {
        let width = self.stack.width;
        if width.is_multiple_of(256) { width + 16 } else { width }
    }

    /// Distance of two samples' rows in the arrays of a layer's values and δ, the output layer's among them.
    pub fn row_stride(&self, layer: usize) -> usize {
        if layer == self.stack.hidden { self.stack.outputs } else { self.stride() }
    }

    /// Inputs of a layer that are neurons of the one before.
    pub fn neurons_in(&self, layer: usize) -> usize {
        if layer == 0 { 0 } else { self.stack.width }
    }

    /// True where the inputs of the network are inputs of this hidden layer.
    pub fn sees_input(&self, layer: usize) -> bool {
        layer == 0 || self.layers[layer].skip
    }

    /// The bias sums of a hidden layer or a linear output in a partial.
    pub fn partial_biases(&self, layer: usize) -> usize {
        if layer == self.stack.hidden { self.partial_output() } else { layer * self.stack.width }
    }

    /// The sums `[inputs][width]` for the weights of the network's inputs in a partial.
    pub fn partial_inputs(&self, layer: usize) -> usize {
        (self.stack.hidden + if layer == 0 { 0 } else { self.stack.inputs }) * self.stack.width
    }

    /// The output layer's sums in a partial: weights then bias of a sigmoid, biases of a linear output.
    pub fn partial_output(&self) -> usize {
        let skips = self.layers.iter().filter(|layer| layer.skip).count();
        (self.stack.hidden + self.stack.inputs * (1 + skips)) * self.stack.width
    }

    /// Length of a partial.
    pub fn partial_length(&self) -> usize {
        self.partial_output()
            + match self.stack.ending {
                Ending::Sigmoid => self.stack.width + 1,
                Ending::Linear => self.stack.outputs,
                Ending::Sines => 0,
            }
    }
}

/// Transposes every panel of the network.
pub fn transpose_all(plan: &Plan, parameters: &[f32], panels: &mut [f32]) {
    for piece in &plan.pieces {
        if let Part::Panel(neurons) = &piece.part {
            let (inputs, range) = (plan.layers[piece.layer].inputs, piece.range.clone());
            transpose(&parameters[range.clone()], neurons.len(), inputs, &mut panels[range]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::siren::SirenShape;

    #[test]
    fn pieces_tile_the_parameters_in_order() {
        let skips = [None, Some(1), Some(2), Some(3), Some(4), Some(9)];
        for (width, skip_after) in
            [1, 7, 37, 64, 130, 512].into_iter().flat_map(|w| skips.map(|skip| (w, skip)))
        {
            let sigmoid = SirenShape { width, skip_after, ..SirenShape::paper() }.stack();
            let linear = Stack { inputs: 3, outputs: 99, ending: Ending::Linear, ..sigmoid };
            let sines = Stack { outputs: width, ending: Ending::Sines, ..linear };
            for stack in [sigmoid, linear, sines] {
                let plan = Plan::new(stack);
                let mut end = 0;
                for piece in &plan.pieces {
                    assert_eq!(piece.range.start, end, "width {width}, {skip_after:?}");
                    end = piece.range.end;
                }
                assert_eq!(end, stack.parameter_count());
                for layer in &plan.layers {
                    assert_eq!(layer.biases, layer.weights + layer.inputs * layer.outputs);
                }
            }
        }
    }
}
