//! Transposes of matrices of 32-bit values, sixteen rows by sixteen columns at a time.

use imf_core::vectorised::vectorised;
use pulp::Arch;

/// Rows and columns of a tile.
const TILE: usize = 16;

/// `out [columns][rows] = source [rows][columns]`.
///
/// # Panics
/// If a slice is too short.
pub fn transpose(source: &[f32], rows: usize, columns: usize, out: &mut [f32]) {
    let fits = rows.checked_mul(columns).is_some_and(|values| values <= source.len().min(out.len()));
    assert!(fits, "{rows}×{columns} values do not fit");
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f") {
        let (from, to) = (source.as_ptr(), out.as_mut_ptr());
        for (row, column) in tiles(rows, columns) {
            let from = from.wrapping_add(row * columns + column).cast();
            let to = to.wrapping_add(column * rows + row).cast();
            let part = [rows - row, columns - column].map(|left| left.min(TILE));
            #[expect(
                unsafe_code,
                reason = "the compiler's code varies by a factor of two with its surroundings"
            )]
            // SAFETY: the CPU has the feature; both slices have all of the tile's values that are asked for.
            unsafe {
                avx512::transpose_tile(from, columns, to, rows, part);
            }
        }
        return;
    }
    vectorised!(Arch::new(), {
        for at in tiles(rows, columns) {
            transpose_tile(source, [rows, columns], out, at);
        }
    });
}

/// First rows and columns of all tiles.
fn tiles(rows: usize, columns: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..columns).step_by(TILE).flat_map(move |column| (0..rows).step_by(TILE).map(move |row| (row, column)))
}

#[inline(always)]
fn transpose_tile(
    source: &[f32],
    [rows, columns]: [usize; 2],
    out: &mut [f32],
    (row, column): (usize, usize),
) {
    if row + TILE <= rows && column + TILE <= columns {
        let mut tile = [[0.0; TILE]; TILE];
        for (place, line) in tile.iter_mut().enumerate() {
            line.copy_from_slice(&source[(row + place) * columns + column..][..TILE]);
        }
        exchange::<1>(&mut tile);
        exchange::<2>(&mut tile);
        exchange::<4>(&mut tile);
        exchange::<8>(&mut tile);
        for (place, line) in tile.iter().enumerate() {
            out[(column + place) * rows + row..][..TILE].copy_from_slice(line);
        }
        return;
    }
    for column in column..(column + TILE).min(columns) {
        for row in row..(row + TILE).min(rows) {
            out[column * rows + row] = source[row * columns + column];
        }
    }
}

/// Exchanges the blocks off the diagonal of every block of `2 × BY` rows and columns: of all sizes, the transpose.
#[inline(always)]
fn exchange<const BY: usize>(tile: &mut [[f32; TILE]; TILE]) {
    for row in 0..TILE {
        if row & BY == 0 {
            let (upper, lower) = (tile[row], tile[row | BY]);
            tile[row] =
                std::array::from_fn(|lane| if lane & BY == 0 { upper[lane] } else { lower[lane ^ BY] });
            tile[row | BY] =
                std::array::from_fn(|lane| if lane & BY == 0 { upper[lane ^ BY] } else { lower[lane] });
        }
    }
}

/// With AVX-512.
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512 {
    use std::arch::x86_64::{
        __m512i, __mmask16, _mm512_mask_storeu_epi32, _mm512_maskz_loadu_epi32, _mm512_setzero_si512,
        _mm512_shuffle_i32x4, _mm512_unpackhi_epi32, _mm512_unpackhi_epi64, _mm512_unpacklo_epi32,
        _mm512_unpacklo_epi64,
    };

    use super::TILE;

    /// `to[j·to_row + i] = from[i·from_row + j]`, of some rows i and columns j, at most 16.
    ///
    /// # Safety
    /// The CPU has the feature; both have the rows and columns.
    #[expect(unsafe_code, reason = "loads and stores through pointers")]
    #[target_feature(enable = "avx512f")]
    pub(in crate::siren) unsafe fn transpose_tile(
        from: *const u32,
        from_row: usize,
        to: *mut u32,
        to_row: usize,
        [rows, columns]: [usize; 2],
    ) {
        let [of_rows, of_columns] = [rows, columns].map(|lanes| ((1u32 << lanes) - 1) as __mmask16);
        let row = |i: usize| from.wrapping_add(i * from_row).cast::<i32>();
        // SAFETY: as the function's.
        let rows: [__m512i; TILE] = std::array::from_fn(|i| {
            if i < rows {
                unsafe { _mm512_maskz_loadu_epi32(of_columns, row(i)) }
            } else {
                _mm512_setzero_si512()
            }
        });
        // Of four rows i + 0..4, in each 128-bit lane l: [c] has column 4·l + c of all four.
        let mut fours = [rows[0]; TILE];
        for i in (0..TILE).step_by(4) {
            let [a, b, c, d] = [rows[i], rows[i + 1], rows[i + 2], rows[i + 3]];
            let (low, high) = (_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
            let (low_2, high_2) = (_mm512_unpacklo_epi32(c, d), _mm512_unpackhi_epi32(c, d));
            fours[i] = _mm512_unpacklo_epi64(low, low_2);
            fours[i + 1] = _mm512_unpackhi_epi64(low, low_2);
            fours[i + 2] = _mm512_unpacklo_epi64(high, high_2);
            fours[i + 3] = _mm512_unpackhi_epi64(high, high_2);
        }
        for c in 0..4 {
            let [a, b, d, e] = [fours[c], fours[c + 4], fours[c + 8], fours[c + 12]];
            // Lanes 0 and 2, then 1 and 3, of two by two.
            let (even, odd) = (_mm512_shuffle_i32x4::<0x88>(a, b), _mm512_shuffle_i32x4::<0xdd>(a, b));
            let (even_2, odd_2) = (_mm512_shuffle_i32x4::<0x88>(d, e), _mm512_shuffle_i32x4::<0xdd>(d, e));
            let fours_of = [
                _mm512_shuffle_i32x4::<0x88>(even, even_2),
                _mm512_shuffle_i32x4::<0x88>(odd, odd_2),
                _mm512_shuffle_i32x4::<0xdd>(even, even_2),
                _mm512_shuffle_i32x4::<0xdd>(odd, odd_2),
            ];
            for (lane, column) in fours_of.into_iter().enumerate() {
                if 4 * lane + c < columns {
                    // SAFETY: as the function's.
                    unsafe {
                        _mm512_mask_storeu_epi32(
                            to.wrapping_add((4 * lane + c) * to_row).cast(),
                            of_rows,
                            column,
                        );
                    };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transposing_exchanges_rows_and_columns() {
        for (rows, columns) in [(19, 35), (16, 225), (225, 16), (32, 48), (1, 1)] {
            let source: Vec<f32> = (0..rows * columns).map(|i| i as f32).collect();
            let [mut out, mut by_compiler] = [(); 2].map(|()| vec![-1.0; source.len()]);
            transpose(&source, rows, columns, &mut out);
            for at in tiles(rows, columns) {
                transpose_tile(&source, [rows, columns], &mut by_compiler, at);
            }
            let expected = |place: usize| source[place % rows * columns + place / rows];
            for (place, found) in out.iter().zip(&by_compiler).enumerate() {
                assert_eq!(found, (&expected(place), &expected(place)), "{rows}×{columns}: {place}");
            }
        }
    }
}
