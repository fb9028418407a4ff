//! Where a field around a part is read for the points of its surface.
//!
//! A vertex is read half a pitch outward along its normal, at the nearest empty voxel centre of the eight around that
//! point: the solid voxels beside them belong to the part's inside, where every tool collides, and would blur into
//! anything interpolated. Where all eight are solid (a gap thinner than a voxel) the nearest is read, which says so.

use glam::DVec3;

use crate::mesh::Mesh;
use crate::occupancy::Occupancy;

/// Unit normals at the vertices: the mean of the triangles around, weighted by area; zero where there is none. For a
/// mesh that is inside out they are turned, so that they point outward all the same.
///
/// Vertices have to be shared ([`Mesh::welded`]) for their normals to be smooth.
#[must_use]
pub fn vertex_normals(mesh: &Mesh) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; mesh.vertices.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(triangle);
        let normal = (b - a).cross(c - a);
        corners.iter().for_each(|&corner| normals[corner as usize] += normal);
    }
    let outward = if mesh.signed_volume() < 0.0 { -1.0 } else { 1.0 };
    normals.iter().map(|normal| normal.normalize_or_zero() * outward).collect()
}

/// For every vertex of `mesh` (in the world) the index of the voxel at which fields on the obstacle's grid are read;
/// `None` where the grid ends before the point.
///
/// # Panics
/// If there are not as many normals as vertices.
#[must_use]
pub fn surface_voxels(mesh: &Mesh, normals: &[DVec3], obstacle: &Occupancy) -> Vec<Option<usize>> {
    assert_eq!(normals.len(), mesh.vertices.len(), "one normal for each vertex");
    let grid = &obstacle.grid;
    let read = |(&vertex, &normal): (&DVec3, &DVec3)| {
        let at = grid.continuous(vertex + normal * (0.5 * grid.pitch));
        let low = at.floor();
        // Solid after empty, then near before far, then in order.
        let mut best: Option<(u8, f64, usize)> = None;
        for corner in 0..8 {
            let voxel = low
                + DVec3::new(f64::from(corner >> 2 & 1), f64::from(corner >> 1 & 1), f64::from(corner & 1));
            let inside = (0..3).all(|axis| voxel[axis] >= 0.0 && voxel[axis] < grid.dims[axis] as f64);
            if !inside {
                continue;
            }
            let index = grid.index(voxel.to_array().map(|v| v as usize));
            let candidate = (obstacle.solid[index], (voxel - at).length_squared(), index);
            if best.is_none_or(|b| (candidate.0, candidate.1) < (b.0, b.1)) {
                best = Some(candidate);
            }
        }
        best.map(|(_, _, index)| index)
    };
    mesh.vertices.iter().zip(normals).map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::voxelize::voxelize;
    use glam::DMat4;

    #[test]
    fn a_boxes_surface_is_read_in_the_empty_voxels_around_it() {
        let mesh = unit_cube().transformed(&DMat4::from_scale(DVec3::splat(4.0))).refined(1.0, 1_000_000);
        let normals = vertex_normals(&mesh);
        let grid = Grid { origin: DVec3::splat(-1.0), pitch: 1.0, dims: [6; 3] };
        let solid = voxelize(&mesh, &grid, false);
        let voxels = surface_voxels(&mesh, &normals, &solid);
        for ((vertex, normal), voxel) in mesh.vertices.iter().zip(&normals).zip(&voxels) {
            let voxel = voxel.unwrap();
            assert_eq!(solid.solid[voxel], 0);
            let outward = grid.centre(grid.voxel(voxel)) - *vertex;
            assert!(outward.length() < 1.0 && outward.dot(*normal) > 0.0, "{vertex} {outward}");
        }
        // A grid that ends at the part has nothing half a pitch outside; a thin gap reads as the solid beside it.
        let at = mesh.vertices.iter().position(|v| *v == DVec3::new(2.0, 2.0, 4.0)).unwrap();
        let tight = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] };
        assert_eq!(surface_voxels(&mesh, &normals, &voxelize(&mesh, &tight, false))[at], None);
        let full = Occupancy { grid, solid: vec![1; grid.len()] };
        assert_eq!(full.solid[surface_voxels(&mesh, &normals, &full)[at].unwrap()], 1);
    }

    #[test]
    fn normals_point_outward_even_from_a_mesh_that_is_inside_out() {
        let cube = unit_cube();
        let mut inverted = cube.clone();
        inverted.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let middle = DVec3::splat(0.5);
        for mesh in [cube, inverted] {
            let normals = vertex_normals(&mesh);
            assert!(mesh.vertices.iter().zip(&normals).all(|(v, n)| (*v - middle).dot(*n) > 0.5));
        }
    }
}
