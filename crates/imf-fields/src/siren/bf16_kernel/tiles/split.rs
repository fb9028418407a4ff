//! Products of factors that are sums of two, by tiles.

use std::arch::asm;

use super::{BYTES, Proof, SQUARE, TILE, TileConfiguration, in_squares};
use crate::siren::bf16_kernel::{Extent, STRIP, SplitProduct};

impl Proof {
    /// The three products of a square one after the other: of eight tiles each is loaded once, and rounded ones are used twice.
    pub(in crate::siren::bf16_kernel) fn multiply_split(
        self,
        out: &mut [f32],
        result: Extent,
        product: SplitProduct<'_>,
        accumulate: bool,
    ) {
        let tiles = TileConfiguration::new(self);
        let SplitProduct { pairs, left, left_row, right } = product;
        for first_row in (0..result.rows).step_by(SQUARE) {
            let rows = SQUARE.min(result.rows - first_row);
            let left = left.map(|half| &half[first_row * left_row..][..SQUARE * left_row]);
            for first_column in (0..result.columns).step_by(STRIP) {
                let right = right.map(|half| &half[first_column * pairs..][..pairs * STRIP]);
                let columns = STRIP.min(result.columns - first_column);
                let square = Extent { rows, columns, stride: result.stride };
                let out = &mut out[first_row * result.stride + first_column..];
                in_squares(out, square, accumulate, |out, stride| {
                    run_split(&tiles, out, stride, SplitProduct { pairs, left, left_row, right }, accumulate);
                });
            }
        }
    }
}

/// As [`super::run`], of the three products of factors that are sums of two.
fn run_split(
    _: &TileConfiguration,
    out: &mut [f32],
    stride: usize,
    product: SplitProduct<'_>,
    accumulate: bool,
) {
    let SplitProduct { pairs, left, left_row, right } = product;
    assert!(pairs > 0 && pairs.is_multiple_of(TILE) && pairs <= left_row, "tiles of rows");
    assert!(
        left.iter().all(|half| (SQUARE - 1) * left_row + pairs <= half.len()),
        "the left factor of a square"
    );
    assert!(right.iter().all(|half| pairs * STRIP <= half.len()), "the right factor of a square");
    assert!((SQUARE - 1) * stride + SQUARE <= out.len(), "a square of sums");
    let settings = SplitSettings {
        out: out.as_mut_ptr(),
        out_stride: stride * BYTES,
        accumulate: usize::from(accumulate),
        // Wrapping: addresses, of which the difference may be negative.
        left_rests: (left[1].as_ptr() as usize).wrapping_sub(left[0].as_ptr() as usize),
    };
    #[expect(unsafe_code, reason = "no stable intrinsics, as above")]
    // SAFETY: as of `run`. The rests have the layout and the length of the rounded values, `left_rests` bytes on.
    unsafe {
        asm!(
            load_sums!(),
            // x and z go along the left factor's two tiles, v and w along those of its rests.
            "mov {x}, {left}",
            "mov {z}, {left_row}",
            "shl {z}, 4",
            "add {z}, {x}",
            "mov {v}, {x}",
            "add {v}, [{s} + 24]",
            "mov {w}, {z}",
            "add {w}, [{s} + 24]",
            "mov {y}, 128",
            "4:",
            "tileloadd tmm4, [{x} + {left_row}*1]",
            "tileloadd tmm6, [{rest} + {y}*1]",
            "tileloadd tmm5, [{z} + {left_row}*1]",
            "tileloadd tmm7, [{rest} + {y}*1 + 64]",
            multiply!(),
            "tileloadd tmm6, [{right} + {y}*1]",
            "tileloadd tmm7, [{right} + {y}*1 + 64]",
            multiply!(),
            "tileloadd tmm4, [{v} + {left_row}*1]",
            "tileloadd tmm5, [{w} + {left_row}*1]",
            multiply!(),
            "add {x}, 64",
            "add {z}, 64",
            "add {v}, 64",
            "add {w}, 64",
            "add {right}, 2048",
            "add {rest}, 2048",
            "dec {n}",
            "jnz 4b",
            store_sums!(),
            s = in(reg) &raw const settings,
            left = in(reg) left[0].as_ptr(),
            left_row = in(reg) left_row * BYTES,
            right = inout(reg) right[0].as_ptr() => _,
            rest = inout(reg) right[1].as_ptr() => _,
            n = inout(reg) pairs / TILE => _,
            x = out(reg) _,
            y = out(reg) _,
            z = out(reg) _,
            v = out(reg) _,
            w = out(reg) _,
            out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
            out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
            options(nostack),
        );
    }
}

/// As [`super::Settings`], which begins alike.
#[repr(C)]
struct SplitSettings {
    out: *mut f32,
    out_stride: usize,
    accumulate: usize,
    /// From a left value to its rest, in bytes.
    left_rests: usize,
}
