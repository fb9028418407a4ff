//! The obstacle as a bit array, so that one load reads hundreds of voxels.
//!
//! ```text
//! lead | plane 0: line 0 (nz voxels, zeros) line 1 … line ny−1 | gap | plane 1: … | gap
//! ```
//! Lines are `line_bits` apart, planes `plane_bits`. Enough zeros follow each line and each plane that a read at any
//! offset that matters meets the line itself or nothing. The array is held eight times, shifted by 0 to 7 bits:
//! every bit is then the first of a byte in one of the copies, and a load needs no shifting.

use super::bit_sliced::TILE_BITS;
use super::size::CircularSize;
use crate::occupancy::Occupancy;

/// Copies, one for each bit of a byte.
const COPIES: usize = 8;

/// The obstacle's bits.
pub(super) struct BitObstacle {
    pub(super) dims: [usize; 3],
    /// Bits from a line to the next.
    pub(super) line_bits: i64,
    plane_bits: i64,
    lead_bits: i64,
    copy_bytes: usize,
    /// The first ones are zero.
    pub(super) bytes: Vec<u8>,
    /// First and last solid line of each plane.
    pub(super) solid_lines: Vec<Option<[i64; 2]>>,
}

impl BitObstacle {
    /// Distances between lines and between planes and the lead in bits, and the bytes of a copy.
    fn layout(dims: [usize; 3], size: &CircularSize) -> (i64, i64, i64, usize) {
        let line = size.line_bits();
        let gap = (TILE_BITS as i64 + 2 * line + 63) / 64 * 64;
        let plane = (dims[1] as i64 * line + 63) / 64 * 64 + gap;
        let copy = (gap + dims[0] as i64 * plane) as usize / 8;
        (line, plane, gap, copy)
    }

    /// Bytes that it takes.
    pub(super) fn memory(dims: [usize; 3], size: &CircularSize) -> u64 {
        COPIES as u64 * Self::layout(dims, size).3 as u64
    }

    /// For loads of at most [`TILE_BITS`].
    pub(super) fn new(obstacle: &Occupancy, size: &CircularSize) -> Self {
        let dims = obstacle.grid.dims;
        let (line_bits, plane_bits, lead_bits, copy_bytes) = Self::layout(dims, size);
        let mut bytes = vec![0; COPIES * copy_bytes];
        let mut solid_lines = vec![None; dims[0]];
        for (row, line) in obstacle.solid.chunks_exact(dims[2]).enumerate() {
            let (x, y) = (row / dims[1], row % dims[1]);
            let start = lead_bits + x as i64 * plane_bits + y as i64 * line_bits;
            for (z, _) in line.iter().enumerate().filter(|&(_, &solid)| solid != 0) {
                let bit = start as usize + z;
                for copy in 0..COPIES {
                    let shifted = bit - copy;
                    bytes[copy * copy_bytes + shifted / 8] |= 1 << (shifted % 8);
                }
                let lines = solid_lines[x].get_or_insert([y as i64; 2]);
                lines[1] = y as i64;
            }
        }
        Self { dims, line_bits, plane_bits, lead_bits, copy_bytes, bytes, solid_lines }
    }

    /// Where an offset is read, relative to [`Self::tile_address`].
    #[inline]
    pub(super) fn offset_address(&self, [x, y, z]: [i64; 3]) -> i64 {
        let bits = x * self.plane_bits + y * self.line_bits + z;
        bits.rem_euclid(8) * self.copy_bytes as i64 + bits.div_euclid(8)
    }

    /// The byte of a tile that begins `bit` bits behind line 0 of plane x; `bit` is a multiple of 8.
    pub(super) fn tile_address(&self, x: i64, bit: i64) -> i64 {
        (self.lead_bits + x * self.plane_bits + bit) / 8
    }
}
