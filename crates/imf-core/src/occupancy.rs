//! Which voxels are solid: one byte a voxel while computing, one bit a voxel on disk; and their surface.

use std::collections::HashMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::grid::Grid;
use crate::mesh::Mesh;

/// The solid voxels of an obstacle: 1 where solid, 0 where empty, C-ordered like every array of its grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Occupancy {
    /// The grid the voxels stand in.
    pub grid: Grid,
    /// One byte a voxel, `grid.len()` of them, each 0 or 1.
    pub solid: Vec<u8>,
}

impl Occupancy {
    /// An empty obstacle.
    #[must_use]
    pub fn empty(grid: Grid) -> Self {
        Self { grid, solid: vec![0; grid.len()] }
    }

    /// The voxels of a grid of which it is said that they are solid.
    pub(crate) fn of(grid: Grid, is_solid: impl Fn([usize; 3]) -> bool) -> Self {
        let solid = (0..grid.len()).map(|index| u8::from(is_solid(grid.voxel(index)))).collect();
        Self { grid, solid }
    }

    /// True where there is a byte for each voxel, 0 or 1.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.solid.len() == self.grid.len() && self.solid.iter().all(|&solid| solid <= 1)
    }

    /// Number of solid voxels.
    #[must_use]
    pub fn count(&self) -> usize {
        self.solid.iter().map(|&s| usize::from(s)).sum()
    }

    /// The indices of the solid voxels.
    pub(crate) fn solids(&self) -> impl Iterator<Item = usize> {
        (0..self.solid.len()).filter(|&index| self.solid[index] == 1)
    }

    /// The centres of the solid voxels.
    #[cfg(test)]
    pub(crate) fn centres(&self) -> impl Iterator<Item = DVec3> {
        self.solids().map(|index| self.grid.centre(self.grid.voxel(index)))
    }

    /// Whether a solid voxel has an empty neighbour across a face; what no voxel stands beyond is empty.
    pub(crate) fn is_exposed(&self, index: usize) -> bool {
        let (voxel, dims) = (self.grid.voxel(index), self.grid.dims);
        let is_empty = |index: usize| self.solid[index] == 0;
        [dims[1] * dims[2], dims[2], 1].into_iter().enumerate().any(|(axis, stride)| {
            let at = voxel[axis];
            at == 0 || at + 1 == dims[axis] || is_empty(index - stride) || is_empty(index + stride)
        })
    }

    /// Volume of the solid voxels in world units cubed.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.count() as f64 * self.grid.voxel_volume()
    }

    /// The same voxels on another grid of the same voxels: what lies outside it is left out, what it adds is empty.
    /// `None` where the grids' voxels do not coincide.
    #[must_use]
    pub fn on(&self, grid: &Grid) -> Option<Self> {
        self.grid.offset_of(grid)?;
        let mut moved = Self::empty(*grid);
        moved.add(self);
        Some(moved)
    }

    /// The same voxels on the smallest grid that holds the solid ones; on one empty voxel where none is.
    pub(crate) fn cropped(self) -> Self {
        let (low, high) = self.extent().unwrap_or_default();
        let origin = self.grid.origin + DVec3::from_array(low.map(|v| v as f64)) * self.grid.pitch;
        let dims = [0, 1, 2].map(|axis| high[axis] - low[axis] + 1);
        if dims == self.grid.dims {
            return self;
        }
        // The grids' voxels coincide.
        self.on(&Grid { origin, dims, ..self.grid }).unwrap_or(self)
    }

    /// Adds the solid voxels of another occupancy whose grid has the same voxels; those outside this grid are left
    /// out. Does nothing where the grids' voxels do not coincide.
    pub fn add(&mut self, other: &Self) {
        let grid = self.grid;
        let Some(offset) = other.grid.offset_of(&grid) else { return };
        // The range of this grid's voxels that lie on the other one.
        let range = |axis: usize| {
            let clamp = |v: i64| v.clamp(0, grid.dims[axis] as i64) as usize;
            clamp(-offset[axis])..clamp(other.grid.dims[axis] as i64 - offset[axis])
        };
        let there = |axis: usize, v: usize| (v as i64 + offset[axis]) as usize;
        let line = range(2);
        if line.is_empty() {
            return;
        }
        for (x, y) in range(0).flat_map(|x| range(1).map(move |y| (x, y))) {
            let from = other.grid.index([there(0, x), there(1, y), there(2, line.start)]);
            let to = grid.index([x, y, line.start]);
            let (own, more) = (&mut self.solid[to..][..line.len()], &other.solid[from..]);
            own.iter_mut().zip(more).for_each(|(own, more)| *own |= more);
        }
    }

    /// Lowest and highest solid voxel along each axis; `None` where nothing is solid.
    #[must_use]
    pub fn extent(&self) -> Option<([usize; 3], [usize; 3])> {
        let [_, ny, nz] = self.grid.dims;
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (row, line) in self.solid.chunks_exact(nz).enumerate() {
            let Some(first) = line.iter().position(|&s| s != 0) else { continue };
            let last = line.iter().rposition(|&s| s != 0).unwrap_or(first);
            for (axis, range) in [[row / ny; 2], [row % ny; 2], [first, last]].into_iter().enumerate() {
                low[axis] = low[axis].min(range[0]);
                high[axis] = high[axis].max(range[1]);
            }
        }
        (low[0] != usize::MAX).then_some((low, high))
    }

    /// Two triangles for every face between a solid and an empty voxel, facing outwards and sharing corners: the
    /// closed surface of exactly these voxels. Where solids touch along an edge alone, four faces meet in it.
    #[must_use]
    pub fn faces(&self) -> Mesh {
        let [nx, ny, nz] = self.grid.dims;
        let mut mesh = Mesh::default();
        let mut known: HashMap<usize, u32> = HashMap::new();
        let mut corner = |at: [usize; 3], mesh: &mut Mesh| {
            *known.entry((at[0] * (ny + 1) + at[1]) * (nz + 1) + at[2]).or_insert_with(|| {
                let place = DVec3::from_array(at.map(|v| v as f64));
                mesh.vertices.push(self.grid.origin + place * self.grid.pitch);
                (mesh.vertices.len() - 1) as u32
            })
        };
        for index in self.solids() {
            let voxel = self.grid.voxel(index);
            let strides = [ny * nz, nz, 1];
            for (axis, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
                let last = if side == 0 { 0 } else { [nx, ny, nz][axis] - 1 };
                let next = || if side == 0 { index - strides[axis] } else { index + strides[axis] };
                if voxel[axis] != last && self.solid[next()] == 1 {
                    continue;
                }
                // Around the face, against the clock as seen from outside: the other two axes in turn.
                let (one, other) = ((axis + 1) % 3, (axis + 2) % 3);
                let ways = if side == 1 {
                    [[0, 0], [1, 0], [1, 1], [0, 1]]
                } else {
                    [[0, 0], [0, 1], [1, 1], [1, 0]]
                };
                let [a, b, c, d] = ways.map(|[u, v]| {
                    let mut at = voxel;
                    at[axis] += side;
                    at[one] += u;
                    at[other] += v;
                    corner(at, &mut mesh)
                });
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    /// Eight voxels a byte, the first voxel in the lowest bit; the last byte is padded with zeros.
    #[must_use]
    pub fn packed(&self) -> Vec<u8> {
        let byte = |chunk: &[u8]| chunk.iter().enumerate().fold(0_u8, |byte, (bit, &s)| byte | (s << bit));
        self.solid.chunks(8).map(byte).collect()
    }

    /// The inverse of [`Occupancy::packed`]; `None` for a number of bytes that does not fit the grid.
    pub(crate) fn from_packed(grid: Grid, packed: &[u8]) -> Option<Self> {
        let solid = || (0..grid.len()).map(|i| (packed[i / 8] >> (i % 8)) & 1).collect();
        (packed.len() == grid.len().div_ceil(8)).then(|| Self { grid, solid: solid() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::scattered;
    use crate::voxelize::voxelize;

    #[test]
    fn voxels_keep_their_places_on_another_grid() {
        let grid = Grid { origin: DVec3::new(0.5, 0.0, -2.0), pitch: 0.5, dims: [4, 5, 6] };
        let occupancy = Occupancy::of(grid, |voxel| grid.index(voxel).pow(2) % 7 < 3);
        for (before, after) in [([1, 2, 0], [0, 1, 3]), ([-2, 1, -1], [2, -3, 0]), ([-4, 0, 0], [9, 0, 0])] {
            let other = grid.padded(before, after).unwrap();
            let moved = occupancy.on(&other).unwrap();
            for index in 0..other.len() {
                let voxel = other.voxel(index);
                let old = [0, 1, 2].map(|a| voxel[a] as i64 - before[a]);
                let inside = (0..3).all(|a| (0..grid.dims[a] as i64).contains(&old[a]));
                let expected = if inside { occupancy.solid[grid.index(old.map(|v| v as usize))] } else { 0 };
                assert_eq!(moved.solid[index], expected, "{voxel:?}");
            }
            // Beside voxels that the grid has already, some of them at the same places.
            let own = Occupancy::of(other, |voxel| other.index(voxel).is_multiple_of(3));
            let mut both = own.clone();
            both.add(&occupancy);
            let either = own.solid.iter().zip(&moved.solid).map(|(own, more)| own | more);
            assert!(both.solid.iter().copied().eq(either));
            both.add(&Occupancy { grid: Grid { pitch: 0.4, ..other }, solid: vec![1; other.len()] });
            assert!(both.solid.iter().zip(&own.solid).zip(&moved.solid).all(|((b, o), m)| *b == o | m));
        }
        assert!(occupancy.on(&Grid { pitch: 0.4, ..grid }).is_none());
        let mut one = Occupancy::empty(grid);
        assert_eq!(one.extent(), None);
        one.solid[grid.index([1, 2, 3])] = 1;
        assert_eq!(one.extent(), Some(([1, 2, 3], [1, 2, 3])));
        assert_eq!(one.clone().cropped().solid, [1]);
        assert_eq!(one.clone().cropped().on(&grid), Some(one.clone()));
        assert_eq!(Occupancy::empty(grid).cropped().solid, [0]);
        let mut both = occupancy.clone();
        both.add(&one);
        let new = usize::from(occupancy.solid[grid.index([1, 2, 3])] == 0);
        assert_eq!(both.count(), occupancy.count() + new);
    }

    #[test]
    fn packing_is_undone_by_unpacking_at_a_size_that_is_no_multiple_of_eight() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 5, 7] };
        let occupancy = Occupancy::of(grid, |voxel| grid.index(voxel).pow(2) % 5 < 2);
        let packed = occupancy.packed();
        assert_eq!(packed.len(), 14);
        assert_eq!(Occupancy::from_packed(grid, &packed).unwrap(), occupancy);
        assert_eq!(Occupancy::from_packed(grid, &packed[1..]), None);
    }

    #[test]
    fn faces_enclose_the_voxels_and_nothing_else() {
        let grid = Grid { origin: DVec3::new(1.0, -2.0, 0.5), pitch: 0.5, dims: [7, 6, 5] };
        let steps = Occupancy::of(grid, |[x, _, z]| x < 4 || z == 2);
        for solid in [steps, scattered([6, 7, 8], 2), scattered([5, 5, 5], 4)] {
            let mesh = solid.faces();
            let volume = solid.count() as f64 * solid.grid.voxel_volume();
            assert!((mesh.signed_volume() - volume).abs() < 1e-9 * volume);
            assert_eq!(voxelize(&mesh, &solid.grid, false), solid);
            let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
            for [a, b, c] in &mesh.triangles {
                for [from, to] in [[a, b], [b, c], [c, a]] {
                    *edges.entry([*from.min(to), *from.max(to)]).or_default() +=
                        if from < to { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|&balance| balance == 0));
        }
        assert_eq!(Occupancy::empty(grid).faces(), Mesh::default());
    }
}
