//! Products of `f32` matrices over plain slices: the one door to the `gemm` crate.
//!
//! A matrix is a slice with strides, so that a layer's weights, a block of rows or a panel of columns is a view
//! into a larger array. A product runs on the calling thread; the engines split the work themselves, in pieces that
//! do not depend on the number of threads, or by `combine_by_rows`.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::lanes::{GROUP, load, store};
use crate::parallel::*;

/// A matrix inside a slice; element (i, j) is `data[i·row_stride + j·column_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// A `rows × columns` view whose rows are contiguous and start `stride` apart.
    ///
    /// # Panics
    /// If the slice is too short for it.
    #[must_use]
    pub fn row_major(data: &'a [f32], rows: usize, columns: usize, stride: usize) -> Self {
        assert!(
            extent(rows, columns, stride) <= data.len(),
            "the slice is too short for {rows}×{columns} by {stride}"
        );
        Self { data, rows, columns, row_stride: stride, column_stride: 1 }
    }

    /// All of a slice, as many whole rows as there are, without room between them.
    #[must_use]
    pub fn dense(data: &'a [f32], columns: usize) -> Self {
        Self::row_major(data, data.len() / columns.max(1), columns, columns)
    }

    /// The same elements with rows and columns exchanged.
    #[must_use]
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Some of the rows.
    ///
    /// # Panics
    /// If there are fewer.
    #[must_use]
    pub fn rows(self, rows: Range<usize>) -> Self {
        assert!(rows.end <= self.rows, "row {} of {}", rows.end, self.rows);
        let data = self.data.get(rows.start * self.row_stride..).unwrap_or_default();
        Self { data, rows: rows.len(), ..self }
    }
}

/// Number of elements from the first to the last of a row-major view; `usize::MAX` where rows overlap or it overflows.
fn extent(rows: usize, columns: usize, stride: usize) -> usize {
    if rows == 0 || columns == 0 {
        return 0;
    }
    if rows > 1 && stride < columns {
        return usize::MAX;
    }
    (rows - 1).checked_mul(stride).and_then(|start| start.checked_add(columns)).unwrap_or(usize::MAX)
}

/// Makes `gemm` read the factor with contiguous columns where it lies instead of copying it into tiles first. The
/// engines' factors are panels that already have a tile's layout or nearly so: 4 % (forward) to 12 % (gradient) faster
/// on an AMD Zen 5 with AVX-512. The setting holds for the process, for speed alone.
pub fn prefer_unpacked() {
    gemm::set_lhs_packing_threshold_single_thread(usize::MAX);
}

/// `out = a·b`, or `out += a·b`, as [`combine`] does.
///
/// # Panics
/// If the inner dimensions differ or `out` is too short.
pub fn multiply(out: &mut [f32], stride: usize, a: Matrix<'_>, b: Matrix<'_>, accumulate: bool) {
    combine(out, stride, f32::from(u8::from(accumulate)), a, b, 1.0);
}

/// `a·b`, row-major.
///
/// # Panics
/// If the inner dimensions differ.
#[must_use]
pub fn product(a: Matrix<'_>, b: Matrix<'_>) -> Vec<f32> {
    let mut out = vec![0.0; a.rows * b.columns];
    multiply(&mut out, b.columns, a, b, false);
    out
}

/// `out = kept·out + factor·a·b`, with `out` row-major and its rows `stride` apart; elements between the rows are left
/// alone, and what was in `out` is not read where `kept` is 0. Single-threaded; the same shapes give the same bits.
///
/// # Panics
/// If the inner dimensions differ or `out` is too short.
pub fn combine(out: &mut [f32], stride: usize, kept: f32, a: Matrix<'_>, b: Matrix<'_>, factor: f32) {
    assert_eq!(a.columns, b.rows, "columns of the left factor against rows of the right one");
    assert!(
        extent(a.rows, b.columns, stride) <= out.len(),
        "the result is too short for {}×{} by {stride}",
        a.rows,
        b.columns
    );
    if a.rows == 1 && b.columns > 1 && b.column_stride == 1 {
        return Arch::new().dispatch(RowTimesMatrix {
            row: a,
            matrix: b,
            out: &mut out[..b.columns],
            kept,
            factor,
        });
    }
    #[expect(
        unsafe_code,
        reason = "gemm's only entry takes pointers; every extent is checked above and on construction"
    )]
    // SAFETY: `row_major` has checked that all elements of `a` and `b` lie inside their slices, `transposed` has the
    // same elements, the assertion above does it for `out`, rows of `out` do not overlap, and the borrow rules keep
    // `out` apart from `a` and `b`. Strides fit in `isize` because the slices do.
    unsafe {
        gemm::gemm(
            a.rows,
            b.columns,
            a.columns,
            out.as_mut_ptr(),
            1,
            stride as isize,
            kept != 0.0,
            a.data.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            kept,
            factor,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

/// One row times a matrix whose rows are contiguous, in one reading of it: `gemm` takes twice as long.
struct RowTimesMatrix<'a> {
    row: Matrix<'a>,
    matrix: Matrix<'a>,
    /// `[columns]`.
    out: &'a mut [f32],
    kept: f32,
    factor: f32,
}

impl RowTimesMatrix<'_> {
    #[inline(always)]
    fn registers<S: Simd, const N: usize>(&mut self, simd: S, first: usize) {
        let Self { row, matrix, .. } = *self;
        let mut sums = [simd.splat_f32s(0.0); N];
        for inner in 0..matrix.rows {
            let value = simd.splat_f32s(row.data[inner * row.column_stride]);
            let values = &matrix.data[inner * matrix.row_stride..][..matrix.columns];
            for (place, sum) in sums.iter_mut().enumerate() {
                *sum = simd.mul_add_e_f32s(value, load(simd, values, first + place * S::F32_LANES), *sum);
            }
        }
        let (kept, factor) = (simd.splat_f32s(self.kept), simd.splat_f32s(self.factor));
        for (place, sum) in sums.into_iter().enumerate() {
            let (at, mut value) = (first + place * S::F32_LANES, simd.mul_f32s(factor, sum));
            if self.kept != 0.0 {
                value = simd.mul_add_e_f32s(kept, load(simd, self.out, at), value);
            }
            store(simd, self.out, at, value);
        }
    }
}

impl WithSimd for RowTimesMatrix<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut at = 0;
        while at + GROUP * S::F32_LANES <= self.matrix.columns {
            self.registers::<S, GROUP>(simd, at);
            at += GROUP * S::F32_LANES;
        }
        while at < self.matrix.columns {
            self.registers::<S, 1>(simd, at);
            at += S::F32_LANES;
        }
    }
}

/// Rows of a product that one thread does; fixed, so that threads change no bit.
const ROWS: usize = 64;

/// As [`combine`], of an `out` without room between its rows, some rows a thread of the current rayon pool.
///
/// # Panics
/// As [`combine`].
pub fn combine_by_rows(out: &mut [f32], kept: f32, a: Matrix<'_>, b: Matrix<'_>, factor: f32) {
    let columns = b.columns;
    out[..a.rows * columns].par_chunks_mut(ROWS * columns).enumerate().for_each(|(part, out)| {
        let first = part * ROWS;
        combine(out, columns, kept, a.rows(first..first + out.len() / columns), b, factor);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(length: usize, seed: u32) -> Vec<f32> {
        (0..length as u32).map(|i| ((i * 37 + seed * 11) % 23) as f32 - 11.0).collect()
    }

    #[test]
    fn a_product_is_the_sum_over_the_inner_index_and_spares_what_lies_between_rows() {
        for (rows, columns, stride) in [(7, 5, 9), (1, 5, 9), (1, 150, 160), (2, 150, 160)] {
            let inner = 13;
            let (a, b) = (filled(rows * inner, 1), filled(inner * columns, 2));
            let (at, bt) = (filled(inner * rows, 1), filled(columns * inner, 2));
            for (left, right) in [
                (Matrix::dense(&a, inner), Matrix::dense(&b, columns)),
                (Matrix::dense(&at, rows).transposed(), Matrix::dense(&b, columns)),
                (Matrix::dense(&a, inner), Matrix::dense(&bt, inner).transposed()),
            ] {
                for accumulate in [false, true] {
                    let mut out = vec![0.5; rows * stride];
                    multiply(&mut out, stride, left, right, accumulate);
                    for (place, &found) in out.iter().enumerate() {
                        let (i, j) = (place / stride, place % stride);
                        let product: f32 = (0..inner)
                            .map(|k| {
                                left.data[i * left.row_stride + k * left.column_stride]
                                    * right.data
                                        [k * right.row_stride + j.min(columns - 1) * right.column_stride]
                            })
                            .sum();
                        // Small integers: exact in f32 in any order.
                        let expected = match (j < columns, accumulate) {
                            (true, true) => product + 0.5,
                            (true, false) => product,
                            (false, _) => 0.5,
                        };
                        assert_eq!(found, expected, "({i}, {j})");
                    }
                }
            }
        }
    }

    #[test]
    fn rows_and_factors_are_those_of_the_whole_product() {
        let (rows, inner, columns) = (2 * ROWS + 5, 6, 4);
        let (a, b) = (filled(inner * rows, 3), filled(inner * columns, 4));
        let (a, b) = (Matrix::dense(&a, rows).transposed(), Matrix::dense(&b, columns));
        let mut product = vec![f32::NAN; rows * columns];
        multiply(&mut product, columns, a, b, false);
        let mut some = vec![f32::NAN; 3 * columns];
        multiply(&mut some, columns, a.rows(7..10), b, false);
        assert_eq!(some, product[7 * columns..10 * columns]);
        let mut combined = vec![3.0; rows * columns];
        combine_by_rows(&mut combined, 0.5, a, b, -2.0);
        // Small integers and powers of two: exact in f32.
        let expected: Vec<f32> = product.iter().map(|p| 1.5 - 2.0 * p).collect();
        assert_eq!(combined, expected);
        combined.fill(f32::NAN);
        combine_by_rows(&mut combined, 0.0, a, b, 1.0);
        assert_eq!(combined, product);
        multiply(&mut [], columns, a.rows(rows..rows), b, false);
    }

    #[test]
    #[should_panic(expected = "too short")]
    fn a_view_past_the_end_is_refused() {
        let _ = Matrix::row_major(&[0.0; 11], 3, 4, 4);
    }

    #[test]
    #[should_panic(expected = "too short")]
    fn a_result_past_the_end_is_refused() {
        let a = [0.0; 12];
        multiply(&mut [0.0; 8], 3, Matrix::row_major(&a, 3, 4, 4), Matrix::row_major(&a, 4, 3, 3), false);
    }
}
