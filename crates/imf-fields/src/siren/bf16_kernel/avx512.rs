//! The kernels with AVX-512 BF16. Shapes and lengths are checked by the callers in the parent module.

use std::arch::x86_64::{
    __m512, __m512bh, __m512i, __mmask16, _mm512_castsi512_ps, _mm512_castsi512_si256, _mm512_cvtepu16_epi32,
    _mm512_cvtne2ps_pbh, _mm512_dpbf16_ps, _mm512_extracti64x4_epi64, _mm512_loadu_si512,
    _mm512_mask_storeu_ps, _mm512_maskz_loadu_epi32, _mm512_maskz_loadu_ps, _mm512_mul_ps,
    _mm512_permutex2var_epi16, _mm512_set1_epi32, _mm512_setzero_ps, _mm512_slli_epi32, _mm512_storeu_si512,
    _mm512_sub_ps,
};

use crate::siren::bf16_kernel::{Extent, Product, STRIP};

/// Lanes of a register.
const LANES: usize = 16;
/// Rows of a tile of sums: with two registers a row 16 sums, enough to hide the latency of the instruction, and the rows
/// of a tile are a whole part of a block of samples and of a strip.
const ROWS: usize = 8;

/// That this CPU has the instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Proof(());

impl Proof {
    pub(super) fn find() -> Option<Self> {
        let found = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512bf16");
        found.then_some(Self(()))
    }

    #[expect(unsafe_code, reason = "instructions that the CPU was asked for")]
    pub(super) fn pack_rows(self, values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        // SAFETY: `self` exists where the CPU has the features.
        unsafe { pack_rows(values, from, pairs, out) }
    }

    #[expect(unsafe_code, reason = "instructions that the CPU was asked for")]
    pub(super) fn pack_rows_and_rests(
        self,
        values: (&[f32], Option<&[f32]>),
        from: Extent,
        pairs: usize,
        out: [&mut [u32]; 2],
    ) {
        // SAFETY: `self` exists where the CPU has the features.
        unsafe { pack_rows_and_rests(values, from, pairs, out) }
    }

    #[expect(unsafe_code, reason = "instructions that the CPU was asked for")]
    pub(super) fn pack_strips(self, values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
        // SAFETY: `self` exists where the CPU has the features.
        unsafe { pack_strips(values, from, pairs, out) }
    }

    /// The sums of a strip of columns, `ROWS` rows at a time.
    pub(super) fn multiply(self, out: &mut [f32], result: Extent, product: Product<'_>, accumulate: bool) {
        for first_column in (0..result.columns).step_by(STRIP) {
            let columns = STRIP.min(result.columns - first_column);
            for first_row in (0..result.rows).step_by(ROWS) {
                let tile = Tile {
                    product: Product {
                        left: &product.left[product.left_start(first_row)..],
                        right: &product.right[first_column / STRIP * product.right_strip..],
                        ..product
                    },
                    out: &mut out[first_row * result.stride + first_column..],
                    stride: result.stride,
                    masks: [mask(columns), mask(columns.saturating_sub(LANES))],
                    accumulate,
                };
                #[expect(
                    unsafe_code,
                    reason = "a measured hot loop, over pointers that were checked in `Kernel::multiply`"
                )]
                // SAFETY: `self` exists where the CPU has the features. `Kernel::multiply` has checked that the left
                // factor has all pairs of `result.rows` rows, the right one whole strips for all columns, and the
                // result `rows` rows of `columns`; the tile's rows lie in one strip, since ROWS divides STRIP.
                unsafe {
                    match result.rows - first_row {
                        1 => tile.run::<1>(),
                        2 => tile.run::<2>(),
                        3 => tile.run::<3>(),
                        4 => tile.run::<4>(),
                        5 => tile.run::<5>(),
                        6 => tile.run::<6>(),
                        7 => tile.run::<7>(),
                        _ => tile.run::<ROWS>(),
                    }
                }
            }
        }
    }
}

/// The first `lanes` of a register, at most all.
fn mask(lanes: usize) -> __mmask16 {
    ((1u32 << lanes.min(LANES)) - 1) as __mmask16
}

/// A few rows by one strip of the result; all slices begin at its first element.
struct Tile<'a> {
    product: Product<'a>,
    out: &'a mut [f32],
    stride: usize,
    /// Columns that there are.
    masks: [__mmask16; 2],
    accumulate: bool,
}

impl Tile<'_> {
    /// # Safety
    /// The CPU has the features; the factors have the pairs of `N` rows and a strip, `out` has `N` rows of the masked
    /// columns.
    #[expect(unsafe_code, reason = "a measured hot loop: twice the speed of the f32 products")]
    #[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
    unsafe fn run<const N: usize>(self) {
        let Self { product, out, stride, masks, accumulate } = self;
        let out = out.as_mut_ptr();
        let mut sums = [[_mm512_setzero_ps(); 2]; N];
        // SAFETY: as the function's; masked lanes are not touched.
        unsafe {
            if accumulate {
                for (row, sums) in sums.iter_mut().enumerate() {
                    for (half, sum) in sums.iter_mut().enumerate() {
                        let from = out.wrapping_add(row * stride + half * LANES);
                        *sum = _mm512_maskz_loadu_ps(masks[half], from);
                    }
                }
            }
            // Wrapping arithmetic on pointers: a debug build would check every step of the innermost loop.
            let rows: [usize; N] = std::array::from_fn(|row| row.wrapping_mul(product.left_row));
            let (mut left_start, mut right_start) = (product.left.as_ptr(), product.right.as_ptr());
            for _ in 0..product.segments {
                let (mut left, mut right) = (left_start, right_start);
                for _ in 0..product.pairs {
                    let columns = [load_pairs(right), load_pairs(right.wrapping_add(LANES))];
                    for (sums, &row) in sums.iter_mut().zip(&rows) {
                        let pair = as_pairs(_mm512_set1_epi32(
                            left.wrapping_add(row).cast::<i32>().read_unaligned(),
                        ));
                        for (sum, columns) in sums.iter_mut().zip(columns) {
                            *sum = _mm512_dpbf16_ps(*sum, columns, pair);
                        }
                    }
                    left = left.wrapping_add(product.left_pair);
                    right = right.wrapping_add(STRIP);
                }
                left_start = left_start.wrapping_add(product.left_segment);
                right_start = right_start.wrapping_add(product.right_segment);
            }
            for (row, sums) in sums.iter().enumerate() {
                for (half, sum) in sums.iter().enumerate() {
                    let to = out.wrapping_add(row * stride + half * LANES);
                    _mm512_mask_storeu_ps(to, masks[half], *sum);
                }
            }
        }
    }
}

/// # Safety
/// Sixteen pairs to read.
#[expect(unsafe_code, reason = "a load through a pointer")]
#[target_feature(enable = "avx512f,avx512bf16")]
unsafe fn load_pairs(from: *const u32) -> __m512bh {
    // SAFETY: the function's. With a mask of ones it is the same instruction, without a debug build's checks.
    as_pairs(unsafe { _mm512_maskz_loadu_epi32(__mmask16::MAX, from.cast()) })
}

#[expect(unsafe_code, reason = "no intrinsic has this reinterpretation")]
#[target_feature(enable = "avx512f")]
fn as_pairs(register: __m512i) -> __m512bh {
    // SAFETY: 512 bits each, and all bits are values.
    unsafe { std::mem::transmute::<__m512i, __m512bh>(register) }
}

/// 32 values of a row from `at` on; 0 past its end.
#[expect(unsafe_code, reason = "masked loads take a pointer")]
#[target_feature(enable = "avx512f")]
fn load(row: &[f32], at: usize) -> [__m512; 2] {
    let left = row.len().saturating_sub(at);
    let from = row.as_ptr().wrapping_add(at);
    // SAFETY: the masks leave out what lies past the row's end.
    unsafe {
        [
            _mm512_maskz_loadu_ps(mask(left), from),
            _mm512_maskz_loadu_ps(mask(left.saturating_sub(LANES)), from.wrapping_add(LANES)),
        ]
    }
}

/// 32 values as pairs.
#[expect(unsafe_code, reason = "no intrinsic has this reinterpretation")]
#[target_feature(enable = "avx512f,avx512bf16")]
fn round([low, high]: [__m512; 2]) -> __m512i {
    let pairs = _mm512_cvtne2ps_pbh(high, low);
    // SAFETY: 512 bits each, and all bits are values.
    unsafe { std::mem::transmute::<__m512bh, __m512i>(pairs) }
}

/// 32 values of a row from `at` on, rounded; 0 past its end.
#[target_feature(enable = "avx512f,avx512bf16")]
fn rounded(row: &[f32], at: usize) -> __m512i {
    round(load(row, at))
}

#[expect(unsafe_code, reason = "a store through a pointer")]
#[target_feature(enable = "avx512f")]
fn store(out: &mut [u32], at: usize, register: __m512i) {
    let out = &mut out[at..at + LANES];
    // SAFETY: sixteen values to write.
    unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), register) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn pack_rows(values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
    for (row, out) in out.chunks_exact_mut(pairs).take(from.rows).enumerate() {
        let row = &values[row * from.stride..][..from.columns];
        for at in (0..pairs).step_by(LANES) {
            store(out, at, rounded(row, 2 * at));
        }
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn pack_rows_and_rests<'v>(
    (values, factors): (&'v [f32], Option<&'v [f32]>),
    from: Extent,
    pairs: usize,
    [out, rests]: [&mut [u32]; 2],
) {
    let out = out.chunks_exact_mut(pairs).zip(rests.chunks_exact_mut(pairs)).take(from.rows);
    for (row, (out, rests)) in out.enumerate() {
        let of_row = |values: &'v [f32]| &values[row * from.stride..][..from.columns];
        let (row, factors) = (of_row(values), factors.map(of_row));
        for at in (0..pairs).step_by(LANES) {
            let [mut low, mut high] = load(row, 2 * at);
            if let Some(factors) = factors {
                let [first, second] = load(factors, 2 * at);
                (low, high) = (_mm512_mul_ps(low, first), _mm512_mul_ps(high, second));
            }
            let pairs = round([low, high]);
            store(out, at, pairs);
            // The upper half of an `f32` is its bfloat16.
            let halves = [_mm512_castsi512_si256(pairs), _mm512_extracti64x4_epi64::<1>(pairs)];
            let [first, second] =
                halves.map(|half| _mm512_castsi512_ps(_mm512_slli_epi32::<16>(_mm512_cvtepu16_epi32(half))));
            store(rests, at, round([_mm512_sub_ps(low, first), _mm512_sub_ps(high, second)]));
        }
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn pack_strips(values: &[f32], from: Extent, pairs: usize, out: &mut [u32]) {
    let (low, high) = interleave();
    let row = |row: usize| -> &[f32] {
        if row < from.rows { &values[row * from.stride..][..from.columns] } else { &[] }
    };
    for k in 0..pairs {
        let (first, second) = (row(2 * k), row(2 * k + 1));
        for (strip, at) in (0..from.columns).step_by(STRIP).enumerate() {
            let (first, second) = (rounded(first, at), rounded(second, at));
            let place = (strip * pairs + k) * STRIP;
            store(out, place, _mm512_permutex2var_epi16(first, low, second));
            store(out, place + LANES, _mm512_permutex2var_epi16(first, high, second));
        }
    }
}

/// Which of two registers' 16-bit lanes follow each other where both are taken by turns: from their first half, and from
/// their second.
#[expect(unsafe_code, reason = "a load through a pointer")]
#[target_feature(enable = "avx512f")]
fn interleave() -> (__m512i, __m512i) {
    let places = |half: u16| -> [u16; 32] {
        std::array::from_fn(|lane| half * 16 + lane as u16 / 2 + (lane as u16 % 2) * 32)
    };
    let (low, high) = (places(0), places(1));
    // SAFETY: both arrays have 64 bytes.
    unsafe { (_mm512_loadu_si512(low.as_ptr().cast()), _mm512_loadu_si512(high.as_ptr().cast())) }
}
