//! The kernel of this CPU against the twin. On a CPU without one these tests are of the twin alone, and say so.

use crate::siren::bf16_kernel::*;

/// The kernels that this machine has, the definition last.
fn kernels() -> Vec<Kernel> {
    let machine: Vec<_> = Kernel::all().collect();
    let names: Vec<_> = machine.iter().map(|kernel| kernel.name()).collect();
    eprintln!("kernels of this CPU: {names:?}");
    machine.into_iter().chain([Kernel::Twin]).collect()
}

/// Values of all sizes and signs without pattern; about 8 bits of mantissa too many for a bfloat16.
fn filled(length: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_761) | 1;
    let mut next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state
    };
    (0..length)
        .map(|_| {
            let (mantissa, exponent) = (next() >> 16, next() >> 28);
            (mantissa as f32 / 32_768.0 - 1.0) * 2f32.powi(exponent as i32 - 8)
        })
        .collect()
}

#[test]
fn packing_rounds_and_lays_out_as_the_twin_does() {
    let mut special = vec![0.0, -0.0, 1.0, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -3.0e38];
    // Halfway between two bfloat16 neighbours, to the even one either way; and just beside.
    for bits in [0x3f80_8000, 0x3f81_8000, 0x3f80_8001, 0x3f80_7fff, 0xbf81_8000, 0x7f7f_8000] {
        special.push(f32::from_bits(bits));
    }
    for (rows, columns, stride) in
        [(1, 1, 1), (2, 32, 32), (5, 37, 40), (7, 64, 64), (64, 100, 117), (3, 15, 15)]
    {
        let from = Extent { rows, columns, stride };
        let mut values = filled(from.length(), columns as u32);
        for (value, special) in values.iter_mut().step_by(3).zip(&special) {
            *value = *special;
        }
        let row_pairs = columns.div_ceil(32) * 16 + 16;
        let strip_pairs = rows.div_ceil(2) + 3;
        let packed: Vec<_> = kernels()
            .into_iter()
            .map(|kernel| {
                let mut as_rows = vec![7; rows * row_pairs];
                kernel.pack_rows(&values, from, row_pairs, &mut as_rows);
                let mut as_strips = vec![7; columns.div_ceil(STRIP) * strip_pairs * STRIP];
                kernel.pack_strips(&values, from, strip_pairs, &mut as_strips);
                (as_rows, as_strips)
            })
            .collect();
        assert!(packed.iter().all(|p| p == &packed[0]), "{rows}×{columns}");
        // What rounding leaves, where it is finite.
        let finite: Vec<f32> = values.iter().map(|value| value.clamp(-1e38, 1e38)).collect();
        let packed_with = |kernel: Kernel, factors| {
            let mut halves = [(); 2].map(|()| vec![7; rows * row_pairs]);
            let [out, rests] = &mut halves;
            kernel.pack_rows_and_rests((&finite, factors), from, row_pairs, [out, rests]);
            halves
        };
        for factors in [None, Some(&filled(from.length(), 5)[..])] {
            let split: Vec<_> = kernels().into_iter().map(|kernel| packed_with(kernel, factors)).collect();
            assert!(split.iter().all(|s| s == &split[0]), "{rows}×{columns}, with rests");
        }
        let (as_rows, as_strips) = &packed[0];
        let low = |pair: u32| f32::from_bits(pair << 16);
        let (i, j) = (rows - 1, (columns - 1) / 2 * 2);
        let expected = bf16::from_f32(values[i * stride + j]).to_f32();
        assert_eq!(low(as_rows[i * row_pairs + j / 2]), expected);
        let j = columns - 1;
        let pair = as_strips[(j / STRIP * strip_pairs + i / 2) * STRIP + j % STRIP];
        let found = f32::from_bits(if i % 2 == 0 { pair << 16 } else { pair & 0xffff_0000 });
        assert_eq!(found, bf16::from_f32(values[i * stride + j]).to_f32());
    }
}

/// Both sum the same exact products of 8-bit mantissas in `f32`, in another order and with a rounding more or less:
/// within a unit in the last place of the sum of sizes for each of the few dozen additions that do not cancel.
const SUM_TOLERANCE: f64 = 64.0 * f32::EPSILON as f64;

#[test]
fn products_are_the_twins_whatever_the_shape_and_the_layout() {
    for (rows, columns, inner, segments) in [
        (1usize, 1usize, 1usize, 1usize),
        (8, 32, 64, 1),
        (13, 37, 70, 3),
        (40, 100, 33, 2),
        (128, 64, 512, 1),
        (64, 33, 128, 9),
    ] {
        let pairs = inner.div_ceil(2).next_multiple_of(16);
        let (left, right) = (filled(segments * rows * inner, 1), filled(segments * inner * columns, 2));
        let left_strips = rows.div_ceil(STRIP);
        let right_strips = columns.div_ceil(STRIP);
        let stride = columns + 5;
        let result = Extent { rows, columns, stride };
        for transposed in [false, true] {
            // [segment][row][inner], or for strips [segment][inner][row].
            let mut results = Vec::new();
            for kernel in kernels() {
                let mut packed_left = vec![0; segments * pairs * left_strips * STRIP];
                let mut packed_right = vec![0; segments * pairs * right_strips * STRIP];
                let (left_segment, right_segment) =
                    (pairs * left_strips * STRIP, pairs * right_strips * STRIP);
                for segment in 0..segments {
                    let values = &left[segment * rows * inner..];
                    let out = &mut packed_left[segment * left_segment..];
                    if transposed {
                        let from = Extent { rows: inner, columns: rows, stride: rows };
                        kernel.pack_strips(values, from, pairs, out);
                    } else {
                        kernel.pack_rows(values, Extent { rows, columns: inner, stride: inner }, pairs, out);
                    }
                    let from = Extent { rows: inner, columns, stride: columns };
                    let out = &mut packed_right[segment * right_segment..];
                    kernel.pack_strips(&right[segment * inner * columns..], from, pairs, out);
                }
                let product = Product {
                    segments,
                    pairs,
                    left: &packed_left,
                    left_row: if transposed { 1 } else { pairs },
                    left_strip: STRIP * pairs,
                    left_pair: if transposed { STRIP } else { 1 },
                    left_segment,
                    right: &packed_right,
                    right_strip: pairs * STRIP,
                    right_segment,
                };
                for accumulate in [false, true] {
                    let mut out = vec![0.5; rows * stride];
                    kernel.multiply(&mut out, result, product, accumulate);
                    results.push(out);
                }
            }
            let round = |value: f32| bf16::from_f32(value).to_f64();
            for (index, found) in results.iter().enumerate() {
                let start = if index % 2 == 1 { 0.5 } else { 0.0 };
                for (place, &found) in found.iter().enumerate() {
                    let (i, j) = (place / stride, place % stride);
                    if j >= columns {
                        assert_eq!(found, 0.5, "between the rows");
                        continue;
                    }
                    let terms = (0..segments * inner).map(|at| {
                        let (segment, k) = (at / inner, at % inner);
                        let within = if transposed { k * rows + i } else { i * inner + k };
                        let (a, b) = (left[segment * rows * inner + within], right[at * columns + j]);
                        round(a) * round(b)
                    });
                    let (sum, size) =
                        terms.fold((start, start), |(sum, size), term| (sum + term, size + term.abs()));
                    assert!(
                        (f64::from(found) - sum).abs() <= SUM_TOLERANCE * size,
                        "{rows}×{columns}×{inner}, {segments} segments, {transposed}: ({i}, {j}) {found}, not {sum}"
                    );
                }
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    for kernel in kernels() {
        let refused = |left: usize, right: usize, out: usize| {
            let (left, right, mut out) = (vec![0; left], vec![0; right], vec![0.0; out]);
            let product = Product {
                segments: 2,
                pairs: 16,
                left: &left,
                left_row: 16,
                left_strip: 512,
                left_pair: 1,
                left_segment: 9 * 16,
                right: &right,
                right_strip: 512,
                right_segment: 1024,
            };
            let result = Extent { rows: 9, columns: 33, stride: 40 };
            let call = std::panic::AssertUnwindSafe(|| kernel.multiply(&mut out, result, product, false));
            std::panic::catch_unwind(call).is_err()
        };
        let (left, right, out) = (2 * 9 * 16, 2048, 8 * 40 + 33);
        assert!(!refused(left, right, out));
        assert!(
            refused(left - 1, right, out) && refused(left, right - 1, out) && refused(left, right, out - 1)
        );
    }
}
