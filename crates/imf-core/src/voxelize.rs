//! From a mesh to solid voxels, by the generalised winding number at voxel centres.
//!
//! A voxel is solid where |w| > ½ at its centre, w = Σ (signed solid angle of every triangle) / 4π: right on open,
//! self-crossing and inverted meshes (Jacobson et al. 2013). So that centres on a face have one answer the point that is asked is a hair
//! beside the centre, towards larger coordinates: lower faces are solid, upper ones are not. For a closed mesh w is a whole number, and the signed
//! crossings of a line count it exactly (`columns`). An open mesh is closed by cones over its boundary, which are
//! counted along, and whose solid angles are then taken away again (`cone`): still exact, and only the boundary's
//! edges cost solid angles, for a block of voxels at a time where these decide for all of them (`blocks`). With `conservative`, every voxel that the surface touches is solid as well (`surface`).

mod blocks;
mod columns;
mod cone;
mod surface;

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use crate::control::{Cancelled, Control};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::mesh::solid_angle;
use crate::mesh::topology::boundary_chain;
use crate::occupancy::Occupancy;
use crate::parallel;

use blocks::{PLANES, Planes};
use columns::WeightedTriangle;
use cone::BoundaryCone;

/// A voxel with a larger winding number, up to its sign, is solid.
const SOLID: f64 = 0.5;
/// A winding number between these two, up to its sign, says neither solid nor empty with any confidence: where a surface is
/// closed it is a whole number.
const UNDECIDED: (f64, f64) = (0.2, 0.8);

/// By how many pitches the point that decides for a voxel is beside its centre, to the upper side of every axis: more than rounding
/// within a million pitches of the origin, so that all centres on a face have one answer, and less along each axis, so that those on
/// slanting faces have one too. Of an infinitesimal amount it is the rule by which [`crossings`](crate::mesh::crossings) count what meets an edge.
pub(crate) const BESIDE: DVec3 = DVec3::new(1e-7, 1e-8, 1e-9);

/// The point that decides for a voxel.
fn deciding_point(grid: &Grid, voxel: [usize; 3]) -> DVec3 {
    grid.centre(voxel) + BESIDE * grid.pitch
}

/// Solid voxels, and how sure it is that they are.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelizeResult {
    /// The solid voxels.
    pub solid: Occupancy,
    /// Of the voxel centres with a winding number of at least 0.2 (those inside or nearly so), the fraction at which
    /// it is also below 0.8: 0 for a closed mesh, and near 1 where triangles face at random.
    pub undecided: f64,
}

/// Solid voxels of `mesh` on `grid`; parts of the mesh outside the grid are left out. Triangles must face outwards, or all inwards: see
/// [`Mesh::with_consistent_faces`] for files in which some are turned.
///
/// Memory beside the result: the triangles once, and one plane of counts a thread.
#[must_use]
pub fn voxelize(mesh: &Mesh, grid: &Grid, conservative: bool) -> Occupancy {
    // Without a control nothing cancels it.
    voxelize_with(mesh, grid, conservative, Control::quiet())
        .map_or_else(|Cancelled| Occupancy::empty(*grid), |voxelized| voxelized.solid)
}

/// As [`voxelize`], reporting rows of voxels along z as they are finished, with the fraction of undecided centres.
///
/// # Errors
/// The caller's [`Control`] asked to stop; it is polled between two blocks of voxels of an open mesh, between two planes of a closed one.
pub fn voxelize_with(
    mesh: &Mesh,
    grid: &Grid,
    conservative: bool,
    control: Control<'_>,
) -> Result<VoxelizeResult, Cancelled> {
    let cone = BoundaryCone::new(mesh, &boundary_chain(mesh));
    control.check()?;
    let mut triangles: Vec<WeightedTriangle> =
        mesh.all_corners().map(|corners| WeightedTriangle { corners, weight: 1 }).collect();
    triangles.extend(cone.closing_triangles());
    let by_plane = PlaneIndex::new(grid, &triangles);
    control.check()?;

    let (claimed, undecided) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let mut occupancy = Occupancy::empty(*grid);
    let [_, ny, nz] = grid.dims;
    let together = if cone.is_empty() { 1 } else { PLANES };
    parallel::for_each_chunk(
        &mut occupancy.solid,
        together * ny * nz,
        || vec![0i32; together * ny * (nz + 1)],
        |counts, index, solid| {
            let (first, planes) = (index * together, solid.len() / (ny * nz));
            for (x, counts) in (first..first + planes).zip(counts.chunks_exact_mut(ny * (nz + 1))) {
                if control.is_cancelled() {
                    return;
                }
                columns::wind_plane(grid, x, by_plane.of(x).map(|t| &triangles[t]), counts);
            }
            if cone.is_empty() {
                for (solid, closed) in solid.chunks_exact_mut(nz).zip(counts.chunks_exact(nz + 1)) {
                    solid.iter_mut().zip(closed).for_each(|(solid, &closed)| *solid = u8::from(closed != 0));
                }
            } else {
                let planes = Planes { grid, mesh, cone: &cone, first, closed: counts, control };
                let doubt = planes.fill(solid);
                claimed.fetch_add(doubt.claimed, Ordering::Relaxed);
                undecided.fetch_add(doubt.undecided, Ordering::Relaxed);
            }
            if conservative {
                for (x, plane) in (first..).zip(solid.chunks_exact_mut(ny * nz)) {
                    // The triangles that close the mesh follow its own.
                    for t in by_plane.of(x).take_while(|&t| t < mesh.triangles.len()) {
                        surface::touch_plane(grid, x, &triangles[t].corners, plane);
                    }
                }
            }
            (control.progress)((planes * ny) as u64);
        },
    );
    control.check()?;
    let undecided = undecided.into_inner() as f64 / claimed.into_inner().max(1) as f64;
    Ok(VoxelizeResult { solid: occupancy, undecided })
}

/// Voxels along a mesh's longest side by which it is seen whether it encloses a volume.
const ACROSS: f64 = 64.0;

/// Boundary edges of a mesh that does not say everywhere what is inside; `None` of a closed one, also where triangles meet without
/// sharing corners.
pub(crate) fn openings(mesh: &Mesh) -> Option<usize> {
    let boundary_edges = boundary_chain(mesh).len();
    let (lower, upper) = mesh.bounds().filter(|_| boundary_edges > 0)?;
    let grid = Grid::with_pitch(lower, upper, (upper - lower).max_element() / ACROSS, 1).ok()?;
    let voxels = voxelize_with(mesh, &grid, false, Control::quiet()).ok()?;
    (voxels.undecided > 0.0).then_some(boundary_edges)
}

/// Generalised winding number of the mesh at a point: the definition.
pub(crate) fn winding_number(mesh: &Mesh, point: DVec3) -> f64 {
    solid_angle::winding_number(mesh.all_corners(), point)
}

/// Which triangles meet which plane of voxels x = const, as one flat list with starts.
struct PlaneIndex {
    starts: Vec<usize>,
    triangles: Vec<u32>,
}

impl PlaneIndex {
    fn new(grid: &Grid, triangles: &[WeightedTriangle]) -> Self {
        let spans = triangles.iter().map(|triangle| {
            let xs = triangle.corners.map(|c| (c.x - grid.origin.x) / grid.pitch);
            let low = xs.iter().copied().fold(f64::INFINITY, f64::min).floor() - 1.0;
            let high = xs.iter().copied().fold(f64::NEG_INFINITY, f64::max).floor() + 2.0;
            let clamp = |v: f64| v.clamp(0.0, grid.dims[0] as f64) as usize;
            clamp(low)..clamp(high)
        });
        let mut starts = vec![0; grid.dims[0] + 1];
        for plane in spans.clone().flatten() {
            starts[plane + 1] += 1;
        }
        for plane in 0..grid.dims[0] {
            starts[plane + 1] += starts[plane];
        }
        let mut next = starts.clone();
        let mut list = vec![0; starts[grid.dims[0]]];
        for (triangle, span) in spans.enumerate() {
            for plane in span {
                list[next[plane]] = triangle as u32;
                next[plane] += 1;
            }
        }
        Self { starts, triangles: list }
    }

    fn of(&self, plane: usize) -> impl Iterator<Item = usize> {
        self.triangles[self.starts[plane]..self.starts[plane + 1]].iter().map(|&t| t as usize)
    }
}

#[cfg(test)]
mod soup;
#[cfg(test)]
mod tests {
    use super::*;

    /// A subdivided octahedron of radius `radius` around `centre`: closed, facing outwards.
    pub(super) fn sphere(centre: DVec3, radius: f64, levels: usize) -> Mesh {
        let mut corners = Vec::new();
        for octant in 0..8 {
            let sign = |bit: i32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let (x, y, z) = (DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2));
            corners.extend(if sign(0) * sign(1) * sign(2) > 0.0 { [x, y, z] } else { [x, z, y] });
        }
        let triangles = (0..24).step_by(3).map(|v| [v, v + 1, v + 2]).collect();
        let mut mesh = Mesh { vertices: corners, triangles }.welded();
        for _ in 0..levels {
            // Every edge is halved once.
            mesh = mesh.refined_with_origins(0.0, mesh.triangles.len()).0;
            mesh.vertices.iter_mut().for_each(|vertex| *vertex = vertex.normalize());
        }
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = centre + *vertex * radius);
        mesh
    }

    fn grid() -> Grid {
        Grid { origin: DVec3::splat(-1.25), pitch: 0.125, dims: [20, 21, 22] }
    }

    fn compare_with_definition(mesh: &Mesh, grid: &Grid) {
        let fast = voxelize(mesh, grid, false);
        let mut solid = 0;
        for index in 0..grid.len() {
            let centre = grid.centre(grid.voxel(index));
            let winding = winding_number(mesh, centre);
            // On the surface itself the winding number jumps, and either answer is right.
            let differs = |step: DVec3| (winding_number(mesh, centre + step) - winding).abs() > 0.01;
            let mut axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
            let jumps = axes.any(|axis| differs(axis * 1e-7) || differs(axis * -1e-7));
            if !jumps && (winding.abs() - 0.5).abs() > 1e-9 {
                assert_eq!(
                    fast.solid[index] == 1,
                    winding.abs() > 0.5,
                    "voxel {:?}: {winding}",
                    grid.voxel(index)
                );
            }
            solid += usize::from(fast.solid[index]);
        }
        assert!(solid > 0);
    }

    #[test]
    fn a_closed_mesh_is_its_inside_even_where_columns_meet_vertices_and_edges() {
        let mesh = sphere(DVec3::ZERO, 1.0, 2);
        // Voxel centres on the coordinate planes and axes, where the octahedron's edges and vertices are.
        let aligned = Grid { origin: DVec3::splat(-1.3125), pitch: 0.125, dims: [21, 21, 21] };
        compare_with_definition(&mesh, &aligned);
        compare_with_definition(&mesh, &grid());
    }

    #[test]
    fn an_open_mesh_keeps_the_half_space_rule() {
        let mut mesh = sphere(DVec3::new(0.03, -0.02, 0.01), 1.0, 2);
        // Two holes that do not meet, one with a jagged rim.
        mesh.triangles.retain(|t| {
            let z = t.iter().map(|&v| mesh.vertices[v as usize].z).sum::<f64>() / 3.0;
            z < 0.75 && z > -0.9
        });
        assert!(!boundary_chain(&mesh).is_empty());
        compare_with_definition(&mesh, &grid());
    }

    #[test]
    fn an_open_mesh_is_right_where_voxels_lie_on_the_plane_of_its_rim() {
        let mut mesh = sphere(DVec3::ZERO, 1.0, 2);
        mesh.triangles.retain(|t| t.iter().all(|&v| mesh.vertices[v as usize].z < 1e-9));
        let aligned = Grid { origin: DVec3::splat(-1.3125), pitch: 0.125, dims: [21, 21, 21] };
        compare_with_definition(&mesh, &aligned);
    }

    #[test]
    fn overlapping_and_inverted_shells_are_solid_throughout() {
        let mut mesh = sphere(DVec3::new(-0.3, 0.0, 0.0), 0.7, 2);
        mesh.append(&sphere(DVec3::new(0.3, 0.0, 0.0), 0.7, 2));
        compare_with_definition(&mesh, &grid());
        let outward = voxelize(&mesh, &grid(), false);
        for triangle in &mut mesh.triangles {
            triangle.swap(1, 2);
        }
        assert_eq!(voxelize(&mesh, &grid(), false), outward);
    }

    #[test]
    fn single_triangles_without_any_inside_are_empty_but_touch() {
        let vertices = [[-1.0, -1.0, 0.01], [1.0, -1.0, 0.02], [0.0, 1.0, 0.0]].map(DVec3::from_array);
        let mesh = Mesh { vertices: vertices.to_vec(), triangles: vec![[0, 1, 2]] };
        assert_eq!(voxelize(&mesh, &grid(), false).count(), 0);
        assert!(voxelize(&mesh, &grid(), true).count() > 60);
    }

    #[test]
    fn centres_on_a_face_are_solid_on_lower_faces_and_empty_on_upper_ones_however_the_face_lies() {
        use glam::DMat4;
        let grid = Grid { origin: DVec3::new(-7.85, -7.95, -3.65), pitch: 0.7, dims: [23, 24, 12] };
        let (low, high) = (grid.centre([0, 0, 3]).z, grid.centre([0, 0, 8]).z);
        let unit = Mesh::cuboid(DVec3::new(-3.1, -4.3, low), DVec3::new(4.7, 3.9, high));
        for degrees in 0..45 {
            let turned = unit.transformed(&DMat4::from_rotation_z(f64::from(degrees).to_radians()));
            // Rotation leaves the heights as they are.
            let solid = voxelize(&turned, &grid, false);
            let layer = |z: usize| (0..23 * 24).filter(|&i| solid.solid[i * 12 + z] == 1).count();
            let middle = layer(5);
            assert!(middle > 100);
            assert_eq!(
                (2..=8).map(layer).collect::<Vec<_>>(),
                [0, middle, middle, middle, middle, middle, 0]
            );
        }
    }

    #[test]
    fn conservative_covers_every_point_of_the_surface() {
        let mesh = sphere(DVec3::new(0.01, 0.02, 0.03), 1.0, 2);
        let grid = grid();
        let cover = voxelize(&mesh, &grid, true);
        for [a, b, c] in mesh.all_corners() {
            for (u, v) in [(0.0, 0.0), (0.2, 0.3), (0.5, 0.5), (0.9, 0.05), (0.0, 1.0)] {
                let voxel = grid.continuous(a + (b - a) * u + (c - a) * v).round().to_array();
                assert_eq!(cover.solid[grid.index(voxel.map(|i| i as usize))], 1);
            }
        }
        let plain = voxelize(&mesh, &grid, false);
        assert!(plain.solid.iter().zip(&cover.solid).all(|(p, c)| p <= c));
        let growth = cover.count() as f64 / plain.count() as f64;
        assert!((1.05..1.6).contains(&growth), "{growth}");
    }
}
