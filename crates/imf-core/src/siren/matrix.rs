//! Products of `f32` matrices over plain slices: the one door to the `gemm` crate.
//!
//! A matrix is a slice with strides, so that a layer's weights, a block of rows or a panel of columns is a view
//! into a larger array. A product runs on the calling thread; the engines split the work themselves, in pieces that
//! do not depend on the number of threads.

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

/// Tells `gemm` to read the factor with contiguous columns where it lies instead of copying it into tiles first. The
/// engines' factors are panels that already have a tile's layout or nearly so: 4 % (forward) to 12 % (gradient) faster
/// on an AMD Zen 5 with AVX-512. The setting holds for the process, for speed alone.
pub fn prefer_unpacked() {
    gemm::set_lhs_packing_threshold_single_thread(usize::MAX);
}

/// `out = a·b`, or `out += a·b`, with `out` row-major and its rows `stride` apart; elements between the rows are
/// left alone. Single-threaded; the same shapes give the same bits.
///
/// # Panics
/// If the inner dimensions differ or `out` is too short.
pub fn multiply(out: &mut [f32], stride: usize, a: Matrix<'_>, b: Matrix<'_>, accumulate: bool) {
    assert_eq!(a.columns, b.rows, "columns of the left factor against rows of the right one");
    assert!(
        extent(a.rows, b.columns, stride) <= out.len(),
        "the result is too short for {}×{} by {stride}",
        a.rows,
        b.columns
    );
    #[expect(
        unsafe_code,
        reason = "gemm's only entry takes pointers; every extent is checked above and on construction"
    )]
    // SAFETY: `row_major` has checked that all elements of `a` and `b` lie inside their slices, `transposed` keeps the
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
            accumulate,
            a.data.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(length: usize, seed: u32) -> Vec<f32> {
        (0..length as u32).map(|i| ((i * 37 + seed * 11) % 23) as f32 - 11.0).collect()
    }

    #[test]
    fn a_product_is_the_sum_over_the_inner_index_and_spares_what_lies_between_rows() {
        let (rows, inner, columns, stride) = (7, 13, 5, 9);
        let (a, b) = (filled(rows * inner, 1), filled(inner * columns, 2));
        let (at, bt) = (filled(inner * rows, 1), filled(columns * inner, 2));
        for (left, right) in [
            (Matrix::row_major(&a, rows, inner, inner), Matrix::row_major(&b, inner, columns, columns)),
            (
                Matrix::row_major(&at, inner, rows, rows).transposed(),
                Matrix::row_major(&b, inner, columns, columns),
            ),
            (
                Matrix::row_major(&a, rows, inner, inner),
                Matrix::row_major(&bt, columns, inner, inner).transposed(),
            ),
        ] {
            for accumulate in [false, true] {
                let mut out = vec![0.5; rows * stride];
                multiply(&mut out, stride, left, right, accumulate);
                for (place, &found) in out.iter().enumerate() {
                    let (i, j) = (place / stride, place % stride);
                    let product: f32 = (0..inner)
                        .map(|k| {
                            left.data[i * left.row_stride + k * left.column_stride]
                                * right.data[k * right.row_stride + j.min(columns - 1) * right.column_stride]
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
