//! The obstacle as bits on the device, and where they lie.
//!
//! ```text
//! lead | plane 0: line 0 (nz voxels, zeros) line 1 … line ny−1, lines of zeros | plane 1: … | tail
//! ```
//! Lines are `line` bits apart, planes `plane`. Enough zeros follow every line and every plane that a read at any
//! offset of the tool meets the line itself or nothing; so nothing needs to be compared while counting.

use imf_core::field::EngineError;
use imf_core::occupancy::Occupancy;
use imf_core::section::device::{BoundaryOffsets, DifferenceLimits};

use crate::shader::COUNT_PLACES;

/// Distances in bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BitLayout {
    pub(super) lead: u32,
    pub(super) plane: u32,
    pub(super) line: u32,
    pub(super) words: usize,
}

impl BitLayout {
    /// # Errors
    /// More bits than addresses of 32 bits reach.
    pub(super) fn new(space: &DifferenceLimits) -> Result<Self, EngineError> {
        let line = space.spacing[2].next_multiple_of(32) as u64;
        let plane = space.spacing[1] as u64 * line;
        // A line more than a plane: a line above the first one is read from its zeros behind.
        let lead = plane + line;
        // The last tile of a line reads beyond it.
        let tail = line + 2 * u64::from(COUNT_PLACES);
        let bits = lead + space.obstacle[0] as u64 * plane + tail;
        if bits > u64::from(u32::MAX) {
            return Err(EngineError::Device(format!(
                "the obstacle with the tool's reach around it takes {} MiB as bits, and the GPU's kernels address 512. \
                 Take a larger pitch, or count on the CPU",
                bits >> 23
            )));
        }
        let words = bits.div_ceil(32) as usize;
        Ok(Self { lead: lead as u32, plane: plane as u32, line: line as u32, words })
    }

    /// The obstacle.
    pub(super) fn bits(&self, obstacle: &Occupancy) -> Vec<u32> {
        let [_, ny, nz] = obstacle.grid.dims;
        let mut words = vec![0; self.words];
        for (row, line) in obstacle.solid.chunks_exact(nz).enumerate() {
            let start = self.lead as usize + row / ny * self.plane as usize + row % ny * self.line as usize;
            for (z, _) in line.iter().enumerate().filter(|&(_, &solid)| solid != 0) {
                words[(start + z) / 32] |= 1 << ((start + z) % 32);
            }
        }
        words
    }

    /// Distances in bits from a voxel to those of its run-length differences; they wrap.
    pub(super) fn distances(&self, ends: &BoundaryOffsets) -> Vec<u32> {
        let [plane, line] = [i64::from(self.plane), i64::from(self.line)];
        ends.offsets.iter().map(|&[x, y, z]| (x * plane + y * line + z) as u32).collect()
    }
}
