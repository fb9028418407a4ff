//! The surface of solid voxels: the faces between them and empty ones, outside the grid too.

use std::collections::HashMap;

use glam::DVec3;

use super::Occupancy;
use crate::mesh::Mesh;

impl Occupancy {
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
        for index in (0..self.grid.len()).filter(|&index| self.solid[index] == 1) {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::section::test_shapes::scattered;
    use crate::voxelize::voxelize;

    #[test]
    fn faces_enclose_the_voxels_and_nothing_else() {
        let grid = Grid { origin: DVec3::new(1.0, -2.0, 0.5), pitch: 0.5, dims: [7, 6, 5] };
        let solid = |i: usize| u8::from(grid.voxel(i)[0] < 4 || grid.voxel(i)[2] == 2);
        let steps = Occupancy { grid, solid: (0..grid.len()).map(solid).collect() };
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
