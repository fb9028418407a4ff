//! Samples of a surface by area: a point, a normal and an area each.

use glam::DVec3;

use crate::mesh::topology::{EdgeUse, boundary_chain, component_count, neighbours, runs, sorted_edges};
use crate::mesh::{Mesh, SMOOTH, area_vector};
use crate::occupancy::Occupancy;
use crate::parallel;

/// A small piece of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Centroid of its triangle, in the mesh's unit.
    pub point: DVec3,
    /// Outward unit normal.
    pub normal: DVec3,
    /// Area of its triangle, in the mesh's unit squared.
    pub area: f64,
    /// Maximum sine of half the angle by which the mesh turns at the smooth edges of the sample's triangle: a facet
    /// approximates a curved surface, whose true normal may differ by this. 0 on a plane.
    pub bend: f64,
}

/// A surface cut into triangles of about the same size, with a sample in the middle of each.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceSamples {
    /// Three vertices of its own for each triangle, so that values may differ from one triangle to the next.
    pub mesh: Mesh,
    /// In the order of the triangles.
    pub samples: Vec<SurfaceSample>,
    /// Area that lies inside the part, in the mesh's unit squared, where bodies of the mesh cross or touch each
    /// other. It has no samples.
    pub hidden_area: f64,
}

/// How far outside the surface its voxel is looked up, in pitches.
const OUTSIDE: f64 = 0.75;
/// How far on either side of the surface crossings are counted, in pitches.
const CLOSE: f64 = 1e-3;

impl SurfaceSamples {
    /// About `count` samples of a mesh, or more; `solid` holds its voxels.
    ///
    /// Of bodies that cross or touch each other the surface is what has the part on one side alone, and it faces the other,
    /// whichever way its triangles do. Where the mesh is open, what a triangle faces is solid if its voxel is too.
    #[must_use]
    pub fn new(mesh: &Mesh, solid: &Occupancy, count: usize) -> Self {
        let area: f64 = (0..mesh.triangles.len()).map(|t| area_vector(mesh.corners(t)).length()).sum();
        // The edge of an equilateral triangle of that area.
        let edge = (area / count.max(1) as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
        let welded = mesh.welded();
        let edges = sorted_edges(&welded);
        let bends = bends(&welded, &edges);
        let (fine, origins) = welded.refined_with_origins(edge, count.saturating_mul(8));
        let outward = if fine.signed_volume() < 0.0 { -1.0 } else { 1.0 };
        let grid = &solid.grid;
        // One body alone hides none of its own surface.
        let touching = runs(&edges).any(|run| run.len() > 2);
        let several = touching || component_count(&welded) > 1;
        let crossings = several.then(|| Crossings::new(&welded, grid.pitch));
        let is_closed = several && boundary_chain(&welded).is_empty();
        let found = parallel::map(fine.triangles.len(), |triangle| {
            let corners = fine.corners(triangle);
            let vector = area_vector(corners) * outward;
            let mut sample = SurfaceSample {
                point: (corners[0] + corners[1] + corners[2]) / 3.0,
                normal: vector.try_normalize()?,
                area: vector.length(),
                bend: bends[origins[triangle] as usize],
            };
            let Some(crossings) = &crossings else { return Some((sample, false)) };
            let is_inside = |side: f64| {
                crossings.winding(&welded, sample.point + sample.normal * (side * CLOSE * grid.pitch)) != 0
            };
            let before = is_inside(1.0);
            if is_closed {
                let behind = is_inside(-1.0);
                if before && !behind {
                    sample.normal = -sample.normal;
                }
                return Some((sample, before && behind));
            }
            let outside = grid.continuous(sample.point + sample.normal * (OUTSIDE * grid.pitch));
            let is_solid = grid.index_at(outside).is_some_and(|voxel| solid.solid[voxel] != 0);
            Some((sample, before && is_solid))
        });
        let mut all = Self { mesh: Mesh::default(), samples: Vec::new(), hidden_area: 0.0 };
        for (triangle, found) in found.into_iter().enumerate() {
            match found {
                Some((sample, true)) => all.hidden_area += sample.area,
                Some((sample, false)) => {
                    let first = all.mesh.vertices.len() as u32;
                    all.mesh.vertices.extend(fine.corners(triangle));
                    all.mesh.triangles.push([first, first + 1, first + 2]);
                    all.samples.push(sample);
                }
                None => {}
            }
        }
        all
    }

    /// Area of all samples.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.samples.iter().map(|sample| sample.area).sum()
    }

    /// Fraction of that area for whose samples, by their number, something holds.
    #[must_use]
    pub fn fraction(&self, holds: impl Fn(usize) -> bool) -> f64 {
        let held = self.samples.iter().enumerate().filter(|(index, _)| holds(*index));
        // A sum of nothing is −0.
        (held.map(|(_, sample)| sample.area).sum::<f64>() + 0.0) / self.area()
    }
}

/// By triangle, [`SurfaceSample::bend`].
fn bends(mesh: &Mesh, edges: &[EdgeUse]) -> Vec<f64> {
    let normals: Vec<DVec3> =
        (0..mesh.triangles.len()).map(|t| area_vector(mesh.corners(t)).normalize_or_zero()).collect();
    let mut bends = vec![0.0_f64; mesh.triangles.len()];
    // An edge of more than two triangles bends nothing.
    for (one, other, _) in neighbours(edges) {
        let cosine = normals[one].dot(normals[other]);
        // Below a thousandth of a degree it is rounding.
        if (SMOOTH..1.0 - 1e-10).contains(&cosine) {
            let half = (0.5 * (1.0 - cosine)).sqrt();
            for triangle in [one, other] {
                bends[triangle] = bends[triangle].max(half);
            }
        }
    }
    bends
}

/// The triangles above each cell of a lattice in x and y: winding numbers of a closed mesh by counting the crossings of a
/// line along z.
struct Crossings {
    lower: DVec3,
    cell: f64,
    dims: [usize; 2],
    triangles: Vec<Vec<u32>>,
}

impl Crossings {
    fn new(mesh: &Mesh, pitch: f64) -> Self {
        let (lower, upper) = mesh.bounds().unwrap_or_default();
        let cell = pitch.max((upper - lower).max_element() / 1000.0);
        let dims = [0, 1].map(|axis| ((upper - lower)[axis] / cell) as usize + 1);
        let mut triangles = vec![Vec::new(); dims[0] * dims[1]];
        let cell_at = |at: f64, axis: usize| (at.max(0.0) as usize).min(dims[axis] - 1);
        for triangle in 0..mesh.triangles.len() {
            let corners = mesh.corners(triangle).map(|c| (c - lower) / cell);
            let [a, b, c] = corners;
            for column in cell_at(a.min(b).min(c).x, 0)..=cell_at(a.max(b).max(c).x, 0) {
                let [low, high] = within_strip(corners, [column as f64 - SLACK, column as f64 + 1.0 + SLACK]);
                for row in cell_at(low - SLACK, 1)..=cell_at(high + SLACK, 1) {
                    triangles[column * dims[1] + row].push(triangle as u32);
                }
            }
        }
        Self { lower, cell, dims, triangles }
    }

    /// Signed crossings of the surface above a point.
    fn winding(&self, mesh: &Mesh, point: DVec3) -> i32 {
        let at = (point - self.lower) / self.cell;
        if at.x < 0.0 || at.y < 0.0 || at.x >= self.dims[0] as f64 || at.y >= self.dims[1] as f64 {
            return 0;
        }
        let above = self.triangles[at.x as usize * self.dims[1] + at.y as usize].iter();
        above.map(|&triangle| crossing(mesh.corners(triangle as usize), point)).sum()
    }
}

/// Rounding in a cell's bounds, in cells.
const SLACK: f64 = 1e-6;

/// The range of y of a triangle between two values of x; slivers lie in few cells, though their box holds many.
fn within_strip(corners: [DVec3; 3], [from, to]: [f64; 2]) -> [f64; 2] {
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (a, b) = (corners[a], corners[b]);
        if a.x.max(b.x) < from || a.x.min(b.x) > to {
            continue;
        }
        for (end, other) in [(a, b), (b, a)] {
            let held = end.x.clamp(from, to);
            let part = if held == end.x { 0.0 } else { (held - end.x) / (other.x - end.x) };
            let y = end.y + part * (other.y - end.y);
            (low, high) = (low.min(y), high.max(y));
        }
    }
    [low, high]
}

/// ±1 where a triangle lies above a point, by the side that it turns to it. An edge on the line belongs to one of its two
/// triangles, as edges are read in one sense of rotation with ends that count once.
fn crossing(corners: [DVec3; 3], point: DVec3) -> i32 {
    let relative = corners.map(|c| c - point);
    let side = |a: DVec3, b: DVec3| {
        // The same bits whichever triangle reads the edge.
        let (first, last, sign) = if (a.x, a.y) < (b.x, b.y) { (a, b, 1.0) } else { (b, a, -1.0) };
        sign * (first.x * last.y - first.y * last.x)
    };
    let mut turns = 0;
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (a, b) = (relative[a], relative[b]);
        match (a.y <= 0.0, b.y <= 0.0) {
            (true, false) if side(a, b) > 0.0 => turns += 1,
            (false, true) if side(a, b) < 0.0 => turns -= 1,
            _ => {}
        }
    }
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    // Height of the plane over the point.
    let height = normal.dot(relative[0]) / normal.z;
    if turns != 0 && height > 0.0 { turns } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::parts::shell::{Axis, Shell, circle};
    use crate::voxelize::voxelize;
    use glam::{DMat4, DQuat, DVec2};

    #[test]
    fn samples_divide_the_area_and_face_outward_even_from_a_mesh_that_is_inside_out() {
        let cube = unit_cube().transformed(&DMat4::from_scale(DVec3::new(4.0, 4.0, 2.0)));
        let mut inverted = cube.clone();
        inverted.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let grid = Grid { origin: DVec3::splat(-1.0), pitch: 0.5, dims: [12, 12, 8] };
        let solid = voxelize(&cube, &grid, false);
        for mesh in [cube, inverted] {
            let samples = SurfaceSamples::new(&mesh, &solid, 500);
            assert!((500..4000).contains(&samples.samples.len()));
            assert!((samples.area() - 64.0).abs() < 1e-9 && samples.hidden_area == 0.0);
            let middle = DVec3::new(2.0, 2.0, 1.0);
            for (triangle, sample) in samples.samples.iter().enumerate() {
                assert!(sample.normal.dot(sample.point - middle) > 0.0 && sample.area < 0.2);
                assert!((area_vector(samples.mesh.corners(triangle)).length() - sample.area).abs() < 1e-12);
                assert_eq!(sample.bend, 0.0);
            }
        }
    }

    #[test]
    fn crossings_are_those_of_all_triangles_and_slivers_lie_in_few_cells() {
        let mut shell = Shell::default();
        shell.prism(Axis::Z, &circle(DVec2::ZERO, 10.0, 200), [0.0, 6.0]);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
        let mesh = shell.into_mesh().transformed(&DMat4::from_quat(turn));
        let crossings = Crossings::new(&mesh, 0.05);
        let listed: usize = crossings.triangles.iter().map(Vec::len).sum();
        assert!(listed < 20 * crossings.triangles.len(), "{listed}");
        let (mut inside, all) = (0, 4000);
        for place in 0..all {
            let part = |step: f64| 24.0 * (f64::from(place) * step).fract() - 12.0;
            let point = DVec3::new(part(0.618), part(0.755), part(0.57));
            let corners = (0..mesh.triangles.len()).map(|triangle| mesh.corners(triangle));
            let winding = crossings.winding(&mesh, point);
            assert_eq!(winding, corners.map(|corners| crossing(corners, point)).sum::<i32>(), "{point}");
            inside += winding.abs();
        }
        assert!((300..all / 2).contains(&inside), "{inside}");
    }

    #[test]
    fn facets_of_a_cylinder_bend_by_half_their_angle_and_its_ends_do_not() {
        let mut shell = Shell::default();
        shell.prism(Axis::Z, &circle(DVec2::ZERO, 4.0, 24), [0.0, 6.0]);
        let grid = Grid { origin: DVec3::splat(-5.0), pitch: 1.0, dims: [10, 10, 12] };
        let mesh = shell.into_mesh();
        let samples = SurfaceSamples::new(&mesh, &voxelize(&mesh, &grid, false), 2000);
        for sample in samples.samples {
            let expected = if sample.normal.z.abs() < 0.5 { 7.5_f64.to_radians().sin() } else { 0.0 };
            assert!((sample.bend - expected).abs() < 1e-9, "{sample:?}");
        }
    }

    #[test]
    fn what_lies_inside_another_body_of_the_mesh_is_not_surface() {
        let cube = unit_cube().transformed(&DMat4::from_scale(DVec3::splat(4.0)));
        let mut both = cube.clone();
        both.append(&cube.transformed(&DMat4::from_translation(DVec3::new(3.0, 0.0, 0.0))));
        let grid = Grid { origin: DVec3::splat(-1.0), pitch: 0.5, dims: [18, 12, 12] };
        let samples = SurfaceSamples::new(&both, &voxelize(&both, &grid, false), 2000);
        // One face of each is inside the other; their sides coincide for one unit along x, and no side of them is inside.
        assert!((samples.hidden_area - 32.0).abs() < 1e-9, "{}", samples.hidden_area);
        assert!((samples.area() - (2.0 * 96.0 - 32.0)).abs() < 1e-9);
    }
}
