//! Sizes: the box of voxels of a section, the circular convolution that gives it without wrapping, and the part of the
//! tool that can matter there.

use std::ops::Range;

use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::tool::{Tool, ToolVoxels};

/// A box of voxels relative to the obstacle's grid; it may start below voxel 0. Arrays over it are C-ordered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueryBox {
    /// The first voxel.
    pub lower: [i64; 3],
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
}

impl QueryBox {
    /// The box of `dims` voxels whose first stands at `offset` in the obstacle's grid, padded by `padding` on each side.
    pub(super) fn around(offset: [i64; 3], dims: [usize; 3], padding: i64) -> Self {
        Self { lower: offset.map(|o| o - padding), dims: dims.map(|d| d + 2 * padding as usize) }
    }

    /// True where every voxel of the other box is one of this.
    pub(super) fn contains(&self, other: &Self) -> bool {
        (0..3)
            .map(|a| (self.range(a), other.range(a)))
            .all(|(own, its)| its.start >= own.start && its.end <= own.end)
    }

    /// Its voxels along an axis.
    pub(super) fn range(&self, axis: usize) -> Range<i64> {
        self.lower[axis]..self.lower[axis] + self.dims[axis] as i64
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// True if there is no voxel in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.dims.contains(&0)
    }

    /// Position of a voxel in the box's C-ordered array.
    pub(super) fn index(&self, voxel: [i64; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| (voxel[axis] - self.lower[axis]) as usize);
        (x * self.dims[1] + y) * self.dims[2] + z
    }

    /// The voxel at a position of the box's C-ordered array.
    #[must_use]
    pub fn voxel(&self, index: usize) -> [i64; 3] {
        let [_, ny, nz] = self.dims;
        let local = [index / (ny * nz), index / nz % ny, index % nz];
        [0, 1, 2].map(|axis| local[axis] as i64 + self.lower[axis])
    }
}

/// Size of the circular correlation, and the tool offsets that can matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CircularSize {
    /// Points along x, y, z without which an overlap of the query box would wrap.
    pub(super) needed: [usize; 3],
    /// Points along x, y, z of a fast transform.
    pub(super) n: [usize; 3],
    /// Tool offsets outside `[first, last]` along each axis meet no obstacle from any voxel of the query box.
    pub(super) first: [i64; 3],
    pub(super) last: [i64; 3],
}

impl CircularSize {
    /// For a tool around an obstacle on this grid.
    pub(super) fn of(obstacle: &Grid, query: QueryBox, tool: &Tool) -> Self {
        let mut size = Self::new(obstacle.dims, query, tool.reach() / obstacle.pitch);
        // Voxels along z of the tool in any orientation, and two places beside the obstacle from which counts are summed.
        let voxels = (tool.span() / obstacle.pitch).min(1e9) as i64 + 1;
        let voxels = voxels.min(size.last[2] - size.first[2] + 1).max(0) as usize;
        size.n[2] = fast_length(size.n[2].max(obstacle.dims[2] + voxels + 1));
        size
    }

    /// `reach` is the tool's reach in voxels. For outputs in [q0, q1), an obstacle in [0, n) and tool offsets in
    /// [−a, b], wrapping is harmless from max(n, q1 + b, n + a − q0) points on.
    pub(super) fn new(obstacle: [usize; 3], query: QueryBox, reach: f64) -> Self {
        let reach = reach.min(1e9).ceil() as i64;
        let mut size = Self { needed: [0; 3], n: [0; 3], first: [0; 3], last: [0; 3] };
        for axis in 0..3 {
            let n = obstacle[axis] as i64;
            let Range { start: q0, end: q1 } = query.range(axis);
            // x + o must be able to meet [0, n).
            size.first[axis] = (-reach).max(1 - q1);
            size.last[axis] = reach.min(n - 1 - q0);
            let needed = n.max(q1 + size.last[axis]).max(n - size.first[axis] - q0);
            size.needed[axis] = needed as usize;
            // Each place of the circle is read once.
            size.n[axis] = fast_length((needed as usize).max(query.dims[axis]));
        }
        size
    }

    /// Bits from a line of the obstacle to the next where it is held as bits.
    pub(super) fn line_bits(&self) -> i64 {
        self.needed[2] as i64
    }
}

/// A box of voxels, read where they lie: of a whole obstacle, or of the part of a rotated tool that can matter.
pub(super) struct VoxelBox<'a> {
    solid: &'a [u8],
    /// Voxels of the array along x, y, z, and those before the box.
    all: [usize; 3],
    skip: [usize; 3],
    /// The first voxel of the box: of a tool its offset from the tip's voxel.
    pub(super) lower: [i64; 3],
    /// Voxels of the box; zero along every axis where nothing is left.
    pub(super) dims: [usize; 3],
}

impl<'a> VoxelBox<'a> {
    pub(super) fn of_obstacle(obstacle: &'a Occupancy) -> Self {
        let dims = obstacle.grid.dims;
        Self { solid: &obstacle.solid, all: dims, skip: [0; 3], lower: [0; 3], dims }
    }

    /// Without the offsets that meet no obstacle from any voxel of the query box.
    pub(super) fn of_tool(tool: &'a ToolVoxels, size: &CircularSize) -> Self {
        let upper = tool.upper();
        let lower = [0, 1, 2].map(|a| i64::from(tool.lower[a]).max(size.first[a]));
        let last = [0, 1, 2].map(|a| i64::from(upper[a]).min(size.last[a]));
        let skip = [0, 1, 2].map(|a| (lower[a] - i64::from(tool.lower[a])) as usize);
        let mut dims = [0, 1, 2].map(|a| (last[a] + 1 - lower[a]).max(0) as usize);
        if dims.contains(&0) {
            dims = [0; 3];
        }
        Self { solid: &tool.solid, all: tool.dims, skip, lower, dims }
    }

    /// The last voxel of the box.
    pub(super) fn upper(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.lower[axis] + self.dims[axis] as i64 - 1)
    }

    /// The voxels along z at (x, y) of the box.
    pub(super) fn line(&self, x: usize, y: usize) -> &'a [u8] {
        let row = (x + self.skip[0]) * self.all[1] + y + self.skip[1];
        &self.solid[row * self.all[2] + self.skip[2]..][..self.dims[2]]
    }
}

/// The smallest product of 2, 3, 5 and 7 that is at least `n`, and 2.
fn fast_length(n: usize) -> usize {
    (n.max(2)..)
        .find(|&candidate| {
            let mut rest = candidate;
            for prime in [2, 3, 5, 7] {
                while rest % prime == 0 {
                    rest /= prime;
                }
            }
            rest == 1
        })
        .unwrap_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_scene_has_the_measured_size() {
        let dims = [58, 76, 121];
        let size = CircularSize::new(dims, QueryBox::around([0; 3], dims, 0), 84.26);
        // Offsets beyond the grid itself cannot meet it: x needs 58 + 57, not 58 + 85.
        assert_eq!(size.n, [120, 160, 210]);
        assert_eq!((size.first[0], size.last[0]), (-57, 57));
    }

    #[test]
    fn lengths_are_smooth() {
        assert_eq!([1, 11, 13, 121, 206].map(fast_length), [2, 12, 14, 125, 210]);
    }
}
