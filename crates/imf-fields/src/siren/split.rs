//! Products of `f32` factors by AMX: each factor as the sum of two bfloat16, its rounded value and what rounding leaves.
//!
//! ```text
//! a·b ≈ a₁·b₁ + a₂·b₁ + a₁·b₂       a₁ = bf16(a), a₂ = bf16(a − a₁)
//! ```
//!
//! What is left out, a₂·b₂ and the rounding of the rests, is some 2⁻¹⁷ of a product. Three products of tiles take a third of the time
//! of one in `f32` on such CPUs.

use std::sync::OnceLock;

use super::bf16_kernel::{Extent, Kernel, STRIP, SplitProduct};
use super::plan::Plan;
use super::scratch::Lines;
use super::transpose::transpose;
use half::bf16;
use imf_core::workspaces::Workspaces;

/// Fewer samples are sooner multiplied in `f32`, as tiles take 32 at once. It is a call's samples that count: the last
/// of one that is cut into several, as a field cuts at 256, may be multiplied so, and differ by the error of tiles.
const FEWEST: usize = 12;

/// The number of points of a call over a whole grid, of which a block may be small.
pub(crate) const GRID: usize = usize::MAX;

/// Products by tiles, where a call has enough samples.
pub(crate) fn where_many<T>(split: Option<&T>, asked: usize) -> Option<&T> {
    split.filter(|_| asked >= FEWEST)
}

/// Pairs between rows that are nobody's: rows a power of two apart push each other out of the cache.
const APART: usize = 16;

/// A left factor: rows `stride` apart.
pub(crate) struct Left<'a> {
    pub(crate) values: &'a [f32],
    /// What each value is multiplied with first, laid out alike.
    pub(crate) factors: Option<&'a [f32]>,
    pub(crate) rows: usize,
    pub(crate) stride: usize,
}

/// A right factor, laid out for many products.
pub(crate) struct SplitFactor {
    kernel: Kernel,
    rows: usize,
    columns: usize,
    /// Of its inner index.
    pairs: usize,
    /// Strips of the rounded values, and of the rests.
    halves: [Lines<u32>; 2],
}

/// A left factor as a thread needs it: `[half][row][pairs and APART more]`.
pub(crate) type SplitScratch = Lines<u32>;

impl SplitFactor {
    /// Of `values [rows][columns]`, rows `stride` apart; `None` on a CPU without tiles.
    pub(crate) fn new(values: &[f32], rows: usize, columns: usize, stride: usize) -> Option<Self> {
        Self::by(Kernel::tiles()?, values, Extent { rows, columns, stride })
    }

    fn by(kernel: Kernel, values: &[f32], from: Extent) -> Option<Self> {
        let Extent { rows, columns, .. } = from;
        if rows == 0 || columns == 0 {
            return None;
        }
        let pairs = rows.div_ceil(2).next_multiple_of(16);
        let mut halves = [(); 2].map(|()| Lines::new(columns.div_ceil(STRIP) * pairs * STRIP));
        kernel.pack_strips(values, from, pairs, &mut halves[0]);
        let rests: Vec<f32> = values.iter().map(|&value| value - bf16::from_f32(value).to_f32()).collect();
        kernel.pack_strips(&rests, from, pairs, &mut halves[1]);
        Some(Self { kernel, rows, columns, pairs, halves })
    }

    /// `out = left·self`, or `out += left·self`, of `left [rows][inner]`; `out [rows][columns]`, its rows `out_stride` apart, and what
    /// lies between them is left alone.
    pub(crate) fn multiply(
        &self,
        (out, out_stride): (&mut [f32], usize),
        Left { values, factors, rows, stride }: Left<'_>,
        accumulate: bool,
        scratch: &mut SplitScratch,
    ) {
        let from = Extent { rows, columns: self.rows, stride };
        let left_row = self.pairs + APART;
        let half = rows.next_multiple_of(STRIP) * left_row;
        scratch.resize_to_at_least(2 * half);
        let (rounded, rests) = scratch[..2 * half].split_at_mut(half);
        self.kernel.pack_rows_and_rests((values, factors), from, left_row, [rounded, rests]);

        let result = Extent { rows, columns: self.columns, stride: out_stride };
        let (left, right) = ([&*rounded, rests], self.halves.each_ref().map(|half| &**half));
        let product = SplitProduct { pairs: self.pairs, left, left_row, right };
        self.kernel.multiply_split(out, result, product, accumulate);
    }
}

/// A matrix from both sides, on a CPU with tiles.
pub(crate) struct SplitBoth {
    /// Of `values [rows][columns]`: a right factor with `rows` as its inner index.
    pub(crate) forward: SplitFactor,
    /// Of the transposed matrix.
    pub(crate) transposed: SplitFactor,
    scratch: Workspaces<SplitScratch>,
}

impl SplitBoth {
    pub(crate) fn new(values: &[f32], rows: usize, columns: usize) -> Option<Self> {
        let forward = SplitFactor::new(values, rows, columns, columns)?;
        let mut turned = vec![0.0; values.len()];
        transpose(values, rows, columns, &mut turned);
        let transposed = SplitFactor::new(&turned, columns, rows, rows)?;
        Some(Self { forward, transposed, scratch: Workspaces::default() })
    }

    /// `out = left·side`, or `out += left·side`, of `left [rows][inner]`; of both the distance of two rows.
    pub(crate) fn multiply(
        &self,
        side: impl Fn(&Self) -> &SplitFactor,
        (values, rows, stride): (&[f32], usize, usize),
        out: (&mut [f32], usize),
        accumulate: bool,
    ) {
        let left = Left { values, factors: None, rows, stride };
        self.scratch.with(|scratch| side(self).multiply(out, left, accumulate, scratch));
    }
}

/// The weights between a network's layers, on a CPU with tiles.
pub(crate) struct SplitWeights {
    /// By layer; `None` of the first, and behind a sigmoid.
    forward: Vec<Option<SplitFactor>>,
    backward: OnceLock<Vec<Option<SplitFactor>>>,
    pub(crate) scratch: Workspaces<SplitScratch>,
}

impl SplitWeights {
    pub(crate) fn new(plan: &Plan, parameters: &[f32]) -> Option<Self> {
        Kernel::tiles()?;
        let mut transposed = Vec::new();
        let forward = (0..plan.layers.len()).map(|layer| {
            let (neurons_in, shape) = (plan.neurons_in(layer), plan.layers[layer]);
            if neurons_in == 0 || shape.outputs == 1 {
                return None;
            }
            let weights = &parameters[shape.weights..shape.biases];
            transposed.resize(weights.len(), 0.0);
            transpose(weights, shape.outputs, shape.inputs, &mut transposed);
            SplitFactor::new(&transposed, neurons_in, shape.outputs, shape.outputs)
        });
        let forward = forward.collect();
        Some(Self { forward, backward: OnceLock::new(), scratch: Workspaces::default() })
    }

    /// Of a layer's inputs that are neurons, to its neurons.
    pub(crate) fn forward(&self, layer: usize) -> Option<&SplitFactor> {
        self.forward[layer].as_ref()
    }

    /// Of a layer's neurons, to its inputs that are neurons.
    pub(crate) fn backward(&self, layer: usize, plan: &Plan, parameters: &[f32]) -> Option<&SplitFactor> {
        let made = self.backward.get_or_init(|| {
            let of = |layer: usize| {
                let (neurons_in, shape) = (plan.neurons_in(layer), plan.layers[layer]);
                let weights = &parameters[shape.weights..shape.biases];
                SplitFactor::new(weights, shape.outputs, neurons_in, shape.inputs)
            };
            (0..plan.layers.len()).map(of).collect()
        });
        made[layer].as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(length: usize, seed: u32) -> Vec<f32> {
        (0..length as u32).map(|i| ((i * 37 + seed * 11) % 97) as f32 * 0.0217 - 1.03).collect()
    }

    #[test]
    fn products_of_two_halves_are_those_of_f32() {
        // What this CPU has, and the definition.
        let kernels = || Kernel::all().chain([Kernel::Twin]);
        for (rows, inner, columns) in [(64, 256, 289), (12, 5, 3), (33, 70, 130), (33, 1100, 40)] {
            let (stride, out_stride) = (inner + 3, columns + 2);
            let (left, right) = (filled(rows * stride, 1), filled(inner * columns, 2));
            let factors = filled(rows * stride, 3);
            let from = Extent { rows: inner, columns, stride: columns };
            for (kernel, accumulate) in kernels().flat_map(|kernel| [(kernel, false), (kernel, true)]) {
                // One way of either is enough.
                let with_factors = accumulate;
                let factor = SplitFactor::by(kernel, &right, from).unwrap();
                let mut out = vec![0.5; rows * out_stride];
                let mut scratch = SplitScratch::default();
                // Once for its memory, in which rows that nobody has may be anything.
                let given =
                    |rows| Left { values: &left, factors: with_factors.then_some(&factors), rows, stride };
                factor.multiply((&mut [0.0; 2000], out_stride), given(1), false, &mut scratch);
                scratch.fill(0x7fc0_7fc0);
                factor.multiply((&mut out, out_stride), given(rows), accumulate, &mut scratch);
                let value =
                    |at: usize| f64::from(left[at]) * if with_factors { f64::from(factors[at]) } else { 1.0 };
                for (place, &found) in out.iter().enumerate() {
                    let (i, j) = (place / out_stride, place % out_stride);
                    if j >= columns {
                        assert_eq!(found, 0.5);
                        continue;
                    }
                    let products =
                        (0..inner).map(|k| value(i * stride + k) * f64::from(right[k * columns + j]));
                    let (sum, size) = products
                        .fold((0.0, 0.0), |(sum, size), product| (sum + product, size + product.abs()));
                    let sum = sum + if accumulate { 0.5 } else { 0.0 };
                    assert!((f64::from(found) - sum).abs() < 2e-5 * (size + 0.5), "{i} {j}: {found} {sum}");
                }
            }
        }
    }
}
