//! Products of bfloat16 matrices with sums in `f32`, for CPUs that have an instruction for them.
//!
//! A bfloat16 is the upper half of an `f32`, rounded to the nearest, ties to even. AVX-512 BF16 adds 32 products to 16 sums,
//! on AMD's CPUs at the pace of an `f32` instruction that adds 16, on Intel's at a quarter of it; those have AMX, which adds
//! 8,192 to 256 sums. Both want *pairs*: a `u32` holds two values that follow each other along the inner index, the first in
//! the low half. AMX is fast where factors begin at a cache line. What an inner length lacks to a multiple of 16 pairs is zeros.
//!
//! ```text
//! rows    [rows][pairs]                        pairs along a row
//! strips  [⌈columns/32⌉][pairs][32 columns]    pairs along a column; columns past the end are 0
//! ```
//!
//! A left factor may have either layout, a right one has strips, so that a kernel reads both front to back. The inner index
//! may be cut into *segments* that lie apart, such as blocks of samples or panels of weights.
//!
//! The definition is `Kernel::Twin`, plain `f32` products of the rounded values.

#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod tiles;

use half::bf16;

/// Columns of a strip: two registers of sums.
pub const STRIP: usize = 32;

/// Pairs of a strip that the sums of a tile run over before they are written: 32 KiB, so that a strip stays in the
/// level-1 cache for all rows.
const CHUNK: usize = 256;

/// What computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// `tdpbf16ps`.
    #[cfg(target_arch = "x86_64")]
    Tiles(tiles::Proof),
    /// `vdpbf16ps`.
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Proof),
    /// The definition.
    Twin,
}

impl Kernel {
    /// The fastest kernel of this CPU, if it has one.
    pub fn of_this_machine() -> Option<Self> {
        Self::all().next()
    }

    /// AMX, where this CPU has it.
    pub(crate) fn tiles() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        return tiles::Proof::find().map(Self::Tiles);
        #[cfg(not(target_arch = "x86_64"))]
        None
    }

    /// All kernels of this CPU, the fastest first.
    pub fn all() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let all = [tiles::Proof::find().map(Self::Tiles), avx512::Proof::find().map(Self::Avx512)];
        #[cfg(not(target_arch = "x86_64"))]
        let all: [Option<Self>; 0] = [];
        all.into_iter().flatten()
    }

    /// Its instructions.
    pub fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles(_) => "AMX",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512 BF16",
            Self::Twin => "their definition",
        }
    }

    /// Rounds `values [rows][columns]`, rows `stride` apart, into rows of `pairs` pairs each, zeros behind the columns.
    /// `pairs` is a multiple of 16.
    pub fn pack_rows(self, values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        assert!(from.rows > 0 && from.columns > 0 && pairs.is_multiple_of(16) && 2 * pairs >= from.columns);
        assert!(from.length() <= values.len() && from.rows * pairs <= out.len(), "rows do not fit");
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles(proof) => proof.avx512().pack_rows(values, from, pairs, out),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(proof) => proof.pack_rows(values, from, pairs, out),
            Self::Twin => twin::pack_rows(values, from, pairs, out),
        }
    }

    /// [`Self::pack_rows`] of values, times factors laid out alike where there are any, and the same of what rounding leaves of each.
    pub(crate) fn pack_rows_and_rests(
        self,
        (values, factors): (&[f32], Option<&[f32]>),
        from: Extent,
        pairs: usize,
        [out, rests]: [&mut [u32]; 2],
    ) {
        assert!(from.rows > 0 && from.columns > 0 && pairs.is_multiple_of(16) && 2 * pairs >= from.columns);
        let given = factors.map_or(values.len(), |factors| factors.len().min(values.len()));
        let length = out.len().min(rests.len());
        assert!(from.length() <= given && from.rows * pairs <= length, "rows do not fit");
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles(proof) => {
                proof.avx512().pack_rows_and_rests((values, factors), from, pairs, [out, rests]);
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(proof) => proof.pack_rows_and_rests((values, factors), from, pairs, [out, rests]),
            Self::Twin => {
                let times =
                    |(at, &value): (usize, &f32)| factors.map_or(value, |factors| value * factors[at]);
                let values: Vec<f32> = values[..from.length()].iter().enumerate().map(times).collect();
                twin::pack_rows(&values, from, pairs, out);
                let left = |&value: &f32| value - bf16::from_f32(value).to_f32();
                let left: Vec<f32> = values.iter().map(left).collect();
                twin::pack_rows(&left, from, pairs, rests);
            }
        }
    }

    /// Rounds `values [rows][columns]`, rows `stride` apart, into strips of `pairs` pairs: pair `k` of a column has the
    /// values of rows `2k` and `2k + 1`, zeros behind the rows.
    pub fn pack_strips(self, values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        assert!(from.rows > 0 && from.columns > 0 && 2 * pairs >= from.rows);
        let strips = from.columns.div_ceil(STRIP);
        assert!(from.length() <= values.len() && strips * pairs * STRIP <= out.len(), "strips do not fit");
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles(proof) => proof.avx512().pack_strips(values, from, pairs, out),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(proof) => proof.pack_strips(values, from, pairs, out),
            Self::Twin => twin::pack_strips(values, from, pairs, out),
        }
    }

    /// [`Self::multiply`] of factors that are sums of two each, without the product of their rests.
    ///
    /// # Panics
    /// Where a factor or the result is too short.
    pub(crate) fn multiply_split(
        self,
        out: &mut [f32],
        result: Extent,
        product: SplitProduct<'_>,
        accumulate: bool,
    ) {
        let SplitProduct { pairs, left, left_row, right } = product;
        let rows = result.rows.next_multiple_of(STRIP);
        assert!(result.rows > 0 && result.columns > 0 && pairs > 0 && pairs.is_multiple_of(16));
        assert!(result.columns <= result.stride || result.rows == 1, "rows of the result overlap");
        assert!(result.length() <= out.len(), "the result is too short");
        assert!(
            pairs <= left_row && left.iter().all(|half| rows * left_row <= half.len()),
            "the left factor"
        );
        let strips = result.columns.div_ceil(STRIP) * pairs * STRIP;
        assert!(right.iter().all(|half| strips <= half.len()), "the right factor is too short");
        #[cfg(target_arch = "x86_64")]
        if let Self::Tiles(proof) = self {
            return proof.multiply_split(out, result, product, accumulate);
        }
        for (part, [left, right]) in [[0, 0], [1, 0], [0, 1]].into_iter().enumerate() {
            let product = Product {
                segments: 1,
                pairs,
                left: product.left[left],
                left_row,
                left_strip: STRIP * left_row,
                left_pair: 1,
                left_segment: 0,
                right: product.right[right],
                right_strip: pairs * STRIP,
                right_segment: 0,
            };
            self.multiply(out, result, product, accumulate || part > 0);
        }
    }

    /// `out = left·right`, or `out += left·right`: `out [rows][columns]` with its rows `stride` apart. What lies between
    /// the rows is left alone. The same shapes give the same bits by the same kernel.
    ///
    /// # Panics
    /// Where a factor or the result is too short.
    pub fn multiply(self, out: &mut [f32], result: Extent, product: Product<'_>, accumulate: bool) {
        assert!(result.rows > 0 && result.columns > 0 && product.pairs > 0 && product.segments > 0);
        assert!(product.pairs.is_multiple_of(16), "a segment of {} pairs", product.pairs);
        assert!(result.columns <= result.stride || result.rows == 1, "rows of the result overlap");
        assert!(result.length() <= out.len(), "the result is too short");
        assert!(product.left_length(result.rows) <= product.left.len(), "the left factor is too short");
        assert!(product.right_length(result.columns) <= product.right.len(), "the right factor is too short");
        let at_once = (CHUNK / product.pairs).max(1);
        for first in (0..product.segments).step_by(at_once) {
            let part = Product {
                segments: at_once.min(product.segments - first),
                left: &product.left[first * product.left_segment..],
                right: &product.right[first * product.right_segment..],
                ..product
            };
            match self {
                #[cfg(target_arch = "x86_64")]
                Self::Tiles(proof) => proof.multiply(out, result, part, accumulate || first > 0),
                #[cfg(target_arch = "x86_64")]
                Self::Avx512(proof) => proof.multiply(out, result, part, accumulate || first > 0),
                Self::Twin => twin::multiply(out, result, part, accumulate || first > 0),
            }
        }
    }
}

/// A row-major matrix inside a slice.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// How many.
    pub rows: usize,
    /// How many.
    pub columns: usize,
    /// Distance of two rows.
    pub stride: usize,
}

impl Extent {
    /// From the first value to the last.
    fn length(self) -> usize {
        (self.rows - 1) * self.stride + self.columns
    }
}

/// The factors of a product. In segment `s`, pair `k`:
///
/// - of row `i`: `left[i/32·left_strip + i%32·left_row + s·left_segment + k·left_pair]`
/// - of column `j`: `right[j/32·right_strip + s·right_segment + k·32 + j%32]`
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "all of them are in the formulae above")]
pub struct Product<'a> {
    pub segments: usize,
    /// Of a segment: a multiple of 16.
    pub pairs: usize,
    pub left: &'a [u32],
    pub left_row: usize,
    pub left_strip: usize,
    pub left_pair: usize,
    pub left_segment: usize,
    pub right: &'a [u32],
    pub right_strip: usize,
    pub right_segment: usize,
}

/// The factors of a product whose values are sums of two bfloat16 each: rounded values, and what rounding leaves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplitProduct<'a> {
    /// A multiple of 16.
    pub(crate) pairs: usize,
    /// Rows of pairs, as many as fill strips; those past the result's may have anything.
    pub(crate) left: [&'a [u32]; 2],
    /// Distance of two rows.
    pub(crate) left_row: usize,
    /// Strips.
    pub(crate) right: [&'a [u32]; 2],
}

impl Product<'_> {
    /// Where row `i` begins.
    fn left_start(&self, row: usize) -> usize {
        row / STRIP * self.left_strip + row % STRIP * self.left_row
    }

    fn left_length(&self, rows: usize) -> usize {
        // The last row of the last whole strip, and the last of all.
        let whole = if rows >= STRIP { self.left_start(rows / STRIP * STRIP - 1) } else { 0 };
        let last = whole.max(self.left_start(rows - 1));
        last + (self.segments - 1) * self.left_segment + (self.pairs - 1) * self.left_pair + 1
    }

    fn right_length(&self, columns: usize) -> usize {
        (columns - 1) / STRIP * self.right_strip
            + (self.segments - 1) * self.right_segment
            + self.pairs * STRIP
    }
}

/// The definition: rounding value by value, products and sums in `f32`.
mod twin {
    use super::{Extent, Product, STRIP};
    use half::bf16;

    fn pair(first: f32, second: f32) -> u32 {
        let bits = |value: f32| u32::from(bf16::from_f32(value).to_bits());
        bits(first) | bits(second) << 16
    }

    pub(super) fn pack_rows(values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        for (row, out) in out.chunks_exact_mut(pairs).take(from.rows).enumerate() {
            let row = &values[row * from.stride..][..from.columns];
            let value = |at: usize| row.get(at).copied().unwrap_or(0.0);
            (0..pairs).for_each(|k| out[k] = pair(value(2 * k), value(2 * k + 1)));
        }
    }

    pub(super) fn pack_strips(values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        let value = |row: usize, column: usize| {
            if row < from.rows && column < from.columns { values[row * from.stride + column] } else { 0.0 }
        };
        for (strip, out) in out.chunks_exact_mut(pairs * STRIP).take(from.columns.div_ceil(STRIP)).enumerate()
        {
            for (place, out) in out.iter_mut().enumerate() {
                let (k, column) = (place / STRIP, strip * STRIP + place % STRIP);
                *out = pair(value(2 * k, column), value(2 * k + 1, column));
            }
        }
    }

    pub(super) fn multiply(out: &mut [f32], result: Extent, product: Product<'_>, accumulate: bool) {
        let halves =
            |pair: u32| [pair as u16, (pair >> 16) as u16].map(|bits| bf16::from_bits(bits).to_f32());
        for i in 0..result.rows {
            for j in 0..result.columns {
                let out = &mut out[i * result.stride + j];
                let mut sum = if accumulate { *out } else { 0.0 };
                for segment in 0..product.segments {
                    for k in 0..product.pairs {
                        let left = product.left_start(i) + segment * product.left_segment;
                        let right = j / STRIP * product.right_strip + segment * product.right_segment;
                        let left = halves(product.left[left + k * product.left_pair]);
                        let right = halves(product.right[right + k * STRIP + j % STRIP]);
                        sum += left[0] * right[0];
                        sum += left[1] * right[1];
                    }
                }
                *out = sum;
            }
        }
    }
}

#[cfg(test)]
mod tests;
