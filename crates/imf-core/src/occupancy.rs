//! Which voxels are solid: one byte a voxel while computing, one bit a voxel on disk.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::grid::Grid;

/// The solid voxels of an obstacle: 1 where solid, 0 where empty, C-ordered like every array of its grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Occupancy {
    /// The grid the voxels stand in.
    pub grid: Grid,
    /// One byte a voxel, `grid.len()` of them, each 0 or 1.
    pub solid: Vec<u8>,
}

/// Packed bits that do not fit their grid.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{found} bytes of packed voxels, but a grid of {dims:?} needs {expected}")]
pub struct PackedLengthError {
    /// Bytes found.
    pub found: usize,
    /// Bytes expected.
    pub expected: usize,
    /// The grid's dimensions.
    pub dims: [usize; 3],
}

impl Occupancy {
    /// An empty obstacle.
    #[must_use]
    pub fn empty(grid: Grid) -> Self {
        Self { grid, solid: vec![0; grid.len()] }
    }

    /// Number of solid voxels.
    #[must_use]
    pub fn count(&self) -> usize {
        self.solid.iter().map(|&s| usize::from(s)).sum()
    }

    /// Volume of the solid voxels in world units cubed.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.count() as f64 * self.grid.voxel_volume()
    }

    /// Eight voxels a byte, the first voxel in the lowest bit; the last byte is padded with zeros.
    #[must_use]
    pub fn packed(&self) -> Vec<u8> {
        self.solid
            .chunks(8)
            .map(|chunk| chunk.iter().enumerate().fold(0, |byte, (bit, &s)| byte | (s << bit)))
            .collect()
    }

    /// The inverse of [`Occupancy::packed`].
    ///
    /// # Errors
    /// A number of bytes that does not fit the grid.
    pub fn from_packed(grid: Grid, packed: &[u8]) -> Result<Self, PackedLengthError> {
        let expected = grid.len().div_ceil(8);
        if packed.len() != expected {
            return Err(PackedLengthError { found: packed.len(), expected, dims: grid.dims });
        }
        let solid = (0..grid.len()).map(|i| (packed[i / 8] >> (i % 8)) & 1).collect();
        Ok(Self { grid, solid })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn packing_is_undone_by_unpacking_at_a_size_that_is_no_multiple_of_eight() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 5, 7] };
        let solid = (0..grid.len()).map(|i| u8::from(i * i % 5 < 2)).collect();
        let occupancy = Occupancy { grid, solid };
        let packed = occupancy.packed();
        assert_eq!(packed.len(), 14);
        assert_eq!(Occupancy::from_packed(grid, &packed).unwrap(), occupancy);
        assert_eq!(Occupancy::from_packed(grid, &packed[1..]).unwrap_err().expected, 14);
    }
}
