//! The kernel with AMX tiles (`tdpbf16ps`): sixteen rows of sixteen pairs by sixteen pairs of sixteen columns at once.
//! Shapes and lengths are checked by the callers in the parent module.
//!
//! A strip of the right factor is two tiles wide as it lies. Of the left factor a tile wants rows of pairs, so that one
//! of strips is turned first; rows that there are not are zeros.

use std::arch::asm;
use std::arch::x86_64::__cpuid_count;

use crate::siren::bf16_kernel::{CHUNK, Extent, Product, STRIP, avx512};
use crate::siren::transpose::avx512::transpose_tile;

/// To the four tiles of sums, from the square that the settings begin with, or 0; leaves label 3 behind it. Overwrites x, y and z.
macro_rules! load_sums {
    () => {
        concat!(
            "mov {x}, [{s} + 0]\n",
            "mov {y}, [{s} + 8]\n",
            "mov {z}, {y}\n",
            "shl {z}, 4\n",
            "add {z}, {x}\n",
            "cmp qword ptr [{s} + 16], 0\n",
            "je 2f\n",
            "tileloadd tmm0, [{x} + {y}*1]\n",
            "tileloadd tmm1, [{x} + {y}*1 + 64]\n",
            "tileloadd tmm2, [{z} + {y}*1]\n",
            "tileloadd tmm3, [{z} + {y}*1 + 64]\n",
            "jmp 3f\n",
            "2:\n",
            "tilezero tmm0\n",
            "tilezero tmm1\n",
            "tilezero tmm2\n",
            "tilezero tmm3\n",
            "3:"
        )
    };
}

/// From the tiles of sums to the square. Overwrites x, y and z.
macro_rules! store_sums {
    () => {
        concat!(
            "mov {x}, [{s} + 0]\n",
            "mov {y}, [{s} + 8]\n",
            "mov {z}, {y}\n",
            "shl {z}, 4\n",
            "add {z}, {x}\n",
            "tilestored [{x} + {y}*1], tmm0\n",
            "tilestored [{x} + {y}*1 + 64], tmm1\n",
            "tilestored [{z} + {y}*1], tmm2\n",
            "tilestored [{z} + {y}*1 + 64], tmm3"
        )
    };
}

/// To the sums the products of two tiles of the left factor, 4 and 5, with two of the right one, 6 and 7.
macro_rules! multiply {
    () => {
        concat!(
            "tdpbf16ps tmm0, tmm4, tmm6\n",
            "tdpbf16ps tmm2, tmm5, tmm6\n",
            "tdpbf16ps tmm1, tmm4, tmm7\n",
            "tdpbf16ps tmm3, tmm5, tmm7"
        )
    };
}

// Behind the macros, which it uses.
mod split;

/// Rows of a tile, and values of 32 bits in a row.
const TILE: usize = 16;
/// Rows and columns of a square of sums: four tiles, so that each loaded one is used twice.
const SQUARE: usize = 2 * TILE;
/// What rows lie apart beyond their length, as those of a power of two push each other out of the cache.
const APART: usize = 16;

/// A row of a tile that lies across two cache lines costs a product four fifths of its speed.
#[repr(align(64))]
struct Aligned<T>(T);

/// That this CPU has the instructions, and that the system lets this process use them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Proof(avx512::Proof);

impl Proof {
    pub(super) fn find() -> Option<Self> {
        // CPUID leaf 7: AMX-BF16 is bit 22 of EDX, AMX-TILE bit 24.
        let tiles = 1 << 22 | 1 << 24;
        let avx512 = avx512::Proof::find()?;
        (__cpuid_count(7, 0).edx & tiles == tiles && allowed()).then_some(Self(avx512))
    }

    /// For packing, which tiles have no part in.
    pub(super) fn avx512(self) -> avx512::Proof {
        self.0
    }

    pub(super) fn multiply(self, out: &mut [f32], result: Extent, product: Product<'_>, accumulate: bool) {
        let tiles = TileConfiguration::new(self);
        // The rows of a square, where they are not there as a tile wants them.
        let mut turned = Aligned([0; SQUARE * (CHUNK + APART)]);
        // More than one segment are at most a CHUNK of pairs together.
        for first_pair in (0..product.pairs).step_by(CHUNK) {
            let part = Product {
                pairs: CHUNK.min(product.pairs - first_pair),
                left: &product.left[first_pair * product.left_pair..],
                right: &product.right[first_pair * STRIP..],
                ..product
            };
            for first_row in (0..result.rows).step_by(SQUARE) {
                let rows = SQUARE.min(result.rows - first_row);
                let left = &part.left[part.left_start(first_row)..];
                let mut part = Product { left, ..part };
                if rows < SQUARE || part.left_pair != 1 {
                    let row = part.segments * part.pairs + APART;
                    turn(&part, rows, row, &mut turned.0);
                    part = Product {
                        left: &turned.0,
                        left_row: row,
                        left_pair: 1,
                        left_segment: part.pairs,
                        ..part
                    };
                }
                for first_column in (0..result.columns).step_by(STRIP) {
                    let right = &part.right[first_column / STRIP * part.right_strip..];
                    let square = Extent {
                        rows,
                        columns: STRIP.min(result.columns - first_column),
                        stride: result.stride,
                    };
                    let out = &mut out[first_row * result.stride + first_column..];
                    let accumulate = accumulate || first_pair > 0;
                    in_squares(out, square, accumulate, |out, stride| {
                        run(&tiles, out, stride, Product { right, ..part }, accumulate);
                    });
                }
            }
        }
    }
}

/// Whether the system lets this process use tiles: Linux grants them on request, for all threads.
fn allowed() -> bool {
    #[cfg(target_os = "linux")]
    {
        /// `asm/prctl.h`, and the number of the state that tiles have in XCR0.
        const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
        const TILE_DATA: libc::c_long = 18;
        #[expect(unsafe_code, reason = "no safe wrapper has this call")]
        // SAFETY: the call takes two numbers and touches no memory of ours.
        unsafe {
            libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, TILE_DATA) == 0
        }
    }
    #[cfg(not(target_os = "linux"))]
    false
}

/// The first `rows` rows of the left factor, all segments behind each other in `row` pairs, and zeros up to `SQUARE` rows.
fn turn(product: &Product<'_>, rows: usize, row: usize, out: &mut [u32]) {
    for segment in 0..product.segments {
        let left = &product.left[segment * product.left_segment..];
        let first = segment * product.pairs;
        if rows == SQUARE && product.left_pair == STRIP && product.left_row == 1 {
            for (i, k) in
                (0..SQUARE).step_by(TILE).flat_map(|i| (0..product.pairs).step_by(TILE).map(move |k| (i, k)))
            {
                let from = &left[k * STRIP + i..][..(TILE - 1) * STRIP + TILE];
                let to = &mut out[i * row + first + k..][..(TILE - 1) * row + TILE];
                #[expect(unsafe_code, reason = "instructions that the CPU was asked for")]
                // SAFETY: a `Proof` exists, and with it AVX-512; both slices have TILE rows of TILE values.
                unsafe {
                    transpose_tile(from.as_ptr(), STRIP, to.as_mut_ptr(), row, [TILE; 2]);
                }
            }
            continue;
        }
        for i in 0..SQUARE {
            for k in 0..product.pairs {
                let value = if i < rows { left[i * product.left_row + k * product.left_pair] } else { 0 };
                out[i * row + first + k] = value;
            }
        }
    }
}

/// Runs `sums` with a whole square and its stride, also where the result, which begins at its first element, has but a part of it.
fn in_squares(out: &mut [f32], result: Extent, accumulate: bool, sums: impl FnOnce(&mut [f32], usize)) {
    if result.rows == SQUARE && result.columns == SQUARE {
        return sums(&mut out[..(SQUARE - 1) * result.stride + SQUARE], result.stride);
    }
    let mut whole = Aligned([0.0; SQUARE * SQUARE]);
    let whole = &mut whole.0;
    let rows = whole.chunks_exact_mut(SQUARE).zip(out.chunks_mut(result.stride)).take(result.rows);
    if accumulate {
        rows.for_each(|(whole, out)| whole[..result.columns].copy_from_slice(&out[..result.columns]));
    }
    sums(whole, SQUARE);
    let rows = whole.chunks_exact(SQUARE).zip(out.chunks_mut(result.stride)).take(result.rows);
    rows.for_each(|(whole, out)| out[..result.columns].copy_from_slice(&whole[..result.columns]));
}

/// Tiles as they are used here, until it is dropped: a fifth of a product's time where every square does it.
struct TileConfiguration;

impl TileConfiguration {
    fn new(_: Proof) -> Self {
        let first = |length: usize, value: u8| -> [u8; 16] {
            std::array::from_fn(|at| if at < length { value } else { 0 })
        };
        // `ldtilecfg`: palette 1; of eight tiles the bytes of a row, 16 bits each; their rows.
        let bytes = std::array::from_fn(|at| if at % 2 == 0 { (TILE * BYTES) as u8 } else { 0 });
        let settings = [first(1, 1), bytes, [0; 16], first(8, TILE as u8)];
        #[expect(unsafe_code, reason = "no stable intrinsic")]
        // SAFETY: a `Proof` is at hand; 64 bytes are read, and nothing but this file uses tiles.
        unsafe {
            asm!("ldtilecfg [{}]", in(reg) &raw const settings, options(nostack, readonly, preserves_flags));
        }
        Self
    }
}

impl Drop for TileConfiguration {
    fn drop(&mut self) {
        #[expect(unsafe_code, reason = "no stable intrinsic")]
        // SAFETY: it was made by a `Proof`.
        unsafe {
            asm!("tilerelease", options(nostack, nomem, preserves_flags));
        }
    }
}

/// What the loop below reads seldom, and so from memory; sums are loaded and stored by the first three.
#[repr(C)]
struct Settings {
    out: *mut f32,
    out_stride: usize,
    accumulate: usize,
    left_segment: usize,
    right_segment: usize,
    tiles: usize,
}

/// Lengths in bytes, as the instructions take them.
const BYTES: usize = size_of::<u32>();

/// Sums of a square, from `accumulate` its own or 0.
fn run(_: &TileConfiguration, out: &mut [f32], stride: usize, product: Product<'_>, accumulate: bool) {
    let tiles = product.pairs / TILE;
    let left_end =
        (SQUARE - 1) * product.left_row + (product.segments - 1) * product.left_segment + product.pairs;
    let right_end = (product.segments - 1) * product.right_segment + product.pairs * STRIP;
    assert!(tiles > 0 && product.left_pair == 1 && product.pairs.is_multiple_of(TILE), "tiles of rows");
    assert!(left_end <= product.left.len() && right_end <= product.right.len(), "factors of a square");
    assert!((SQUARE - 1) * stride + SQUARE <= out.len(), "a square of sums");
    let settings = Settings {
        out: out.as_mut_ptr(),
        out_stride: stride * BYTES,
        left_segment: product.left_segment * BYTES,
        right_segment: product.right_segment * BYTES,
        tiles,
        accumulate: usize::from(accumulate),
    };
    #[expect(
        unsafe_code,
        reason = "no stable intrinsics: thirty times the speed of AVX-512 BF16 on CPUs that have it"
    )]
    // SAFETY: a `Proof` exists, and with it the instructions and the system's leave. Reads and writes are of the lengths
    // checked above: SQUARE rows of `tiles` tiles of each segment on the left, as many rows of a strip on the right,
    // and the square of sums. Tiles are configured.
    unsafe {
        asm!(
            load_sums!(),
            // A segment: x and z go along the left factor's two tiles, y along the right one's.
            "mov {x}, {left}",
            "mov {z}, {left_row}",
            "shl {z}, 4",
            "add {z}, {x}",
            "mov {y}, {right}",
            "mov {n}, [{s} + 40]",
            "4:",
            "tileloadd tmm4, [{x} + {left_row}*1]",
            "tileloadd tmm6, [{y} + {right_row}*1]",
            "tileloadd tmm5, [{z} + {left_row}*1]",
            "tileloadd tmm7, [{y} + {right_row}*1 + 64]",
            multiply!(),
            "add {x}, 64",
            "add {z}, 64",
            "add {y}, 2048",
            "dec {n}",
            "jnz 4b",
            "add {left}, [{s} + 24]",
            "add {right}, [{s} + 32]",
            "dec {segments}",
            "jnz 3b",
            store_sums!(),
            s = in(reg) &raw const settings,
            left = inout(reg) product.left.as_ptr() => _,
            right = inout(reg) product.right.as_ptr() => _,
            segments = inout(reg) product.segments => _,
            left_row = in(reg) product.left_row * BYTES,
            right_row = in(reg) STRIP * BYTES,
            x = out(reg) _,
            y = out(reg) _,
            z = out(reg) _,
            n = out(reg) _,
            out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
            out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
            options(nostack),
        );
    }
}
