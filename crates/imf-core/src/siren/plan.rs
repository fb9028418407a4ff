//! How the CPU engine cuts a network into pieces of work. Nothing here depends on the number of threads: that is why
//! results do not either.
//!
//! - A batch is cut into *windows*, whose activations stay in the last-level cache, and a window into *blocks* of
//!   [`BLOCK`] samples that pass through the whole network on one core.
//! - A hidden layer's neurons are cut into *panels*. A panel's weights are kept twice: as rows of `W` in the flat
//!   parameters, and transposed, `[inputs][neurons of the panel]`, for the forward product, which is a third slower on
//!   a transposed view. The transposed panel has the same offset and length in its own array as the rows have in the
//!   parameters.
//! - The five inputs of the network, in the first layer and behind the skip, never become columns of a product:
//!   they are added where bias and sine are computed.
//!
//! What a block adds up over its samples for the gradient is one *partial*:
//!
//! ```text
//! | biases [hidden][width] | first layer's weights [5][width] | skip's weights [5][width], if any | output weights [width] | output bias |
//! ```

use std::ops::Range;

use crate::siren::{INPUTS, Layer, SirenShape};

/// Samples that one core takes through the network at a time: at width 512 a layer's values are 256 KiB, a quarter of
/// the level-2 cache; 64 lose 5 % in the products, 256 gain 2 % but halve the number of pieces.
pub(crate) const BLOCK: usize = 128;

/// Neurons of a panel; the last one of a layer may have fewer. Products of 64 columns are as fast as of 128 and spread
/// over more cores.
const PANEL: usize = 64;

/// Samples of a window, a whole number of blocks: at width 512 its activations and slopes are 21 MiB. Windows of 2048
/// and 4096 samples cost small networks 5 and 8 %, because their values leave the cache before they are used again.
pub(crate) const WINDOW: usize = 8 * BLOCK;

/// One piece of the update: a contiguous range of the flat parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Piece {
    /// The layer, hidden layers first.
    pub(crate) layer: usize,
    /// What of it.
    pub(crate) part: Part,
    /// Where it stands in the flat parameters.
    pub(crate) range: Range<usize>,
}

/// What a piece of the update holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Weights of one panel of neurons of a hidden layer.
    Panel(Range<usize>),
    /// All biases of a hidden layer.
    Biases,
    /// Weights and bias of the output layer.
    Output,
}

/// A network cut into pieces.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) shape: SirenShape,
    pub(crate) layers: Vec<Layer>,
    /// Pieces of the update in the order of the flat parameters, which they tile.
    pub(crate) pieces: Vec<Piece>,
}

impl Plan {
    pub(crate) fn new(shape: SirenShape) -> Self {
        let layers = shape.layers();
        let mut plan = Self { shape, layers, pieces: Vec::new() };
        for (index, layer) in plan.layers.iter().enumerate() {
            let end = layer.biases + layer.outputs;
            if index == shape.hidden {
                plan.pieces.push(Piece { layer: index, part: Part::Output, range: layer.weights..end });
                continue;
            }
            for neurons in plan.panels() {
                let range = plan.panel_range(index, &neurons);
                plan.pieces.push(Piece { layer: index, part: Part::Panel(neurons), range });
            }
            plan.pieces.push(Piece { layer: index, part: Part::Biases, range: layer.biases..end });
        }
        plan
    }

    /// The panels of a hidden layer, as ranges of neurons.
    pub(crate) fn panels(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let width = self.shape.width;
        (0..width).step_by(PANEL).map(move |first| first..(first + PANEL).min(width))
    }

    /// Neurons of the widest panel.
    pub(crate) fn widest_panel(&self) -> usize {
        PANEL.min(self.shape.width)
    }

    /// Where a panel's rows stand in the flat parameters and, transposed, in the array of panels.
    pub(crate) fn panel_range(&self, layer: usize, neurons: &Range<usize>) -> Range<usize> {
        let Layer { inputs, weights, .. } = self.layers[layer];
        weights + neurons.start * inputs..weights + neurons.end * inputs
    }

    /// Distance of two samples' rows in arrays of activations and slopes. Rows 2 KiB or a multiple apart compete for
    /// few sets of the cache: 16 values more make the gradient's products 3 % faster.
    pub(crate) fn stride(&self) -> usize {
        let width = self.shape.width;
        if width.is_multiple_of(256) { width + 16 } else { width }
    }

    /// Inputs of a hidden layer that are neurons of the one before.
    pub(crate) fn neurons_in(&self, layer: usize) -> usize {
        if layer == 0 { 0 } else { self.shape.width }
    }

    /// True where the five inputs of the network are inputs of this hidden layer.
    pub(crate) fn sees_input(&self, layer: usize) -> bool {
        layer == 0 || self.layers[layer].skip
    }

    /// A hidden layer's bias sums in a partial.
    pub(crate) fn partial_biases(&self, layer: usize) -> usize {
        layer * self.shape.width
    }

    /// The sums `[5][width]` for the weights of the network's inputs in a partial.
    pub(crate) fn partial_inputs(&self, layer: usize) -> usize {
        (self.shape.hidden + if layer == 0 { 0 } else { INPUTS }) * self.shape.width
    }

    /// The output layer's sums in a partial, weights then bias.
    pub(crate) fn partial_output(&self) -> usize {
        let skips = self.layers.iter().filter(|layer| layer.skip).count();
        (self.shape.hidden + INPUTS * (1 + skips)) * self.shape.width
    }

    /// Length of a partial.
    pub(crate) fn partial_length(&self) -> usize {
        self.partial_output() + self.shape.width + 1
    }
}

/// `out [columns][rows] = source [rows][columns]`, tile by tile so that both stay in cache: 2 % of a step at width 512.
pub(crate) fn transpose(source: &[f32], rows: usize, columns: usize, out: &mut [f32]) {
    const TILE: usize = 16;
    for first_column in (0..columns).step_by(TILE) {
        for first_row in (0..rows).step_by(TILE) {
            let row_end = (first_row + TILE).min(rows);
            for column in first_column..(first_column + TILE).min(columns) {
                let line = &mut out[column * rows..][first_row..row_end];
                for (value, row) in line.iter_mut().zip(first_row..) {
                    *value = source[row * columns + column];
                }
            }
        }
    }
}

/// Transposes every panel of the network.
pub(crate) fn transpose_all(plan: &Plan, parameters: &[f32], panels: &mut [f32]) {
    for piece in &plan.pieces {
        if let Part::Panel(neurons) = &piece.part {
            let inputs = plan.layers[piece.layer].inputs;
            transpose(
                &parameters[piece.range.clone()],
                neurons.len(),
                inputs,
                &mut panels[piece.range.clone()],
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_tile_the_parameters_in_order() {
        for width in [1, 37, 64, 130, 512] {
            let shape = SirenShape { width, ..SirenShape::default() };
            let plan = Plan::new(shape);
            let mut end = 0;
            for piece in &plan.pieces {
                assert_eq!(piece.range.start, end, "width {width}");
                end = piece.range.end;
            }
            assert_eq!(end, shape.parameter_count());
        }
    }

    #[test]
    fn transposing_exchanges_rows_and_columns() {
        let (rows, columns) = (19, 35);
        let source: Vec<f32> = (0..rows * columns).map(|i| i as f32).collect();
        let mut out = vec![-1.0; source.len()];
        transpose(&source, rows, columns, &mut out);
        for (place, &value) in out.iter().enumerate() {
            assert_eq!(value, source[place % rows * columns + place / rows]);
        }
    }
}
