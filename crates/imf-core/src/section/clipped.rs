//! The part of a rotated tool that can matter: offsets beyond it meet no obstacle from any voxel of the query box.

use super::size::CircularSize;
use crate::tool::RotatedTool;

/// A box of a rotated tool's voxels, read where they lie.
pub(super) struct ClippedTool<'a> {
    tool: &'a RotatedTool,
    skip: [usize; 3],
    /// Offset of the first voxel of the box from the tip's voxel.
    pub(super) lower: [i64; 3],
    /// Voxels of the box; zero along every axis where nothing is left.
    pub(super) dims: [usize; 3],
}

impl<'a> ClippedTool<'a> {
    pub(super) fn new(tool: &'a RotatedTool, size: &CircularSize) -> Self {
        let upper = tool.upper();
        let lower = [0, 1, 2].map(|a| i64::from(tool.lower[a]).max(size.first[a]));
        let last = [0, 1, 2].map(|a| i64::from(upper[a]).min(size.last[a]));
        let skip = [0, 1, 2].map(|a| (lower[a] - i64::from(tool.lower[a])) as usize);
        let mut dims = [0, 1, 2].map(|a| (last[a] + 1 - lower[a]).max(0) as usize);
        if dims.contains(&0) {
            dims = [0; 3];
        }
        Self { tool, skip, lower, dims }
    }

    /// Offset of the last voxel of the box from the tip's voxel.
    pub(super) fn upper(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.lower[axis] + self.dims[axis] as i64 - 1)
    }

    /// The voxels along z at (x, y) of the box.
    pub(super) fn line(&self, x: usize, y: usize) -> &'a [u8] {
        let row = (x + self.skip[0]) * self.tool.dims[1] + y + self.skip[1];
        &self.tool.solid[row * self.tool.dims[2] + self.skip[2]..][..self.dims[2]]
    }
}
