//! Samples of a surface by area: a point, a normal and an area each.

use std::f64::consts::PI;

use glam::DVec3;

use crate::mesh::crossings::CrossingIndex;
use crate::mesh::topology::{EdgeUse, boundary_chain, component_count, neighbours, runs, sorted_edges};
use crate::mesh::{Mesh, SMOOTH, area_vector};
use crate::occupancy::Occupancy;
use crate::parallel;

use super::places::places;

/// A small piece of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Where a tool is tried: the centroid of its triangle, or of one nearby that faces alike, in the mesh's unit.
    pub point: DVec3,
    /// Outward unit normal there.
    pub normal: DVec3,
    /// Area of its triangle, in the mesh's unit squared; its part of that where flush faces of several bodies share it.
    pub area: f64,
    /// Maximum sine of half the angle by which the mesh turns at the smooth edges of the sample's triangle: a facet
    /// approximates a curved surface, whose true normal may differ by this. 0 on a plane.
    pub bend: f64,
}

impl SurfaceSample {
    /// Whether a tool is tried at the same place.
    pub(super) fn is_tried_with(&self, other: &Self) -> bool {
        (self.point, self.normal, self.bend) == (other.point, other.normal, other.bend)
    }
}

/// A surface cut into triangles that are small enough, with a sample each. Where they are smaller than that, those nearby that face alike
/// share the place at which a tool is tried.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceSamples {
    /// Three vertices of its own for each triangle, so that values may differ from one triangle to the next.
    pub mesh: Mesh,
    /// In the order of the triangles, those of one place side by side.
    pub samples: Vec<SurfaceSample>,
    /// Area that is no surface or counts for another already, in the mesh's unit squared: inside the part or flush, where bodies of
    /// the mesh cross or touch each other.
    pub hidden_area: f64,
}

/// How far outside the surface its voxel is looked up, in pitches.
const OUTSIDE: f64 = 0.75;
/// How far a face may differ from a plane for fewer triangles to stand for it, in pitches: four times that is not seen by what follows.
const FLAT: f64 = 2e-4;
/// How far on either side of the surface crossings are counted, in pitches.
const CLOSE: f64 = 1e-3;

impl SurfaceSamples {
    /// Samples of a mesh at about `count` places, or more; `solid` holds its voxels. Triangles of one body must face alike
    /// ([`Mesh::with_consistent_faces`]).
    ///
    /// Of bodies that cross or touch each other the surface is what has the part on one side alone, and it faces the other,
    /// whichever way its triangles do; flush faces of a closed mesh share its area. Where the mesh is open, what a triangle faces is
    /// solid if its voxel is too.
    #[must_use]
    pub fn new(mesh: &Mesh, solid: &Occupancy, count: usize) -> Self {
        let area: f64 = (0..mesh.triangles.len()).map(|t| area_vector(mesh.corners(t)).length()).sum();
        // The edge of an equilateral triangle of that area.
        let edge = (area / count.max(1) as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
        let welded = mesh.simplified(FLAT * solid.grid.pitch);
        let edges = sorted_edges(&welded);
        let bends = bends(&welded, &edges);
        let (fine, origins) = welded.refined_with_origins(edge, count.saturating_mul(8));
        let outward = if fine.signed_volume() < 0.0 { -1.0 } else { 1.0 };
        let grid = &solid.grid;
        // One body alone hides none of its own surface.
        let touching = runs(&edges).any(|run| run.len() > 2);
        let several = touching || component_count(&welded) > 1;
        let crossings = several.then(|| CrossingIndex::new(welded.all_corners()));
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
            let whole = sample.area;
            let Some(crossings) = &crossings else { return Some((sample, 0.0)) };
            let around = |side: f64| {
                let beside = sample.point + sample.normal * (side * CLOSE * grid.pitch);
                crossings.winding_number(beside)
            };
            let before = around(1.0);
            if is_closed {
                let behind = around(-1.0);
                if before != 0 && behind == 0 {
                    sample.normal = -sample.normal;
                }
                // As many faces lie there as the number changes by.
                sample.area = match before != 0 && behind != 0 {
                    true => 0.0,
                    false => whole / f64::from(before.abs_diff(behind).max(1)),
                };
                return Some((sample, whole - sample.area));
            }
            let outside = grid.continuous(sample.point + sample.normal * (OUTSIDE * grid.pitch));
            let is_solid = grid.index_at(outside).is_some_and(|voxel| solid.solid[voxel] != 0);
            sample.area = if before != 0 && is_solid { 0.0 } else { whole };
            Some((sample, whole - sample.area))
        });
        // No place stands for more than a disc of its share of the area. Triangles that are halved are of about that size.
        let radius = (area / count.max(1) as f64 / PI).sqrt();
        let mut pieces = vec![0u32; welded.triangles.len()];
        origins.iter().for_each(|&origin| pieces[origin as usize] += 1);
        let mut whole = vec![None; welded.triangles.len()];
        for (&origin, found) in origins.iter().zip(&found) {
            let shown = found.filter(|(sample, _)| sample.area > 0.0 && pieces[origin as usize] == 1);
            whole[origin as usize] = shown.map(|(sample, _)| sample);
        }
        let places = places(&edges, &whole, radius);
        let mut order: Vec<usize> = (0..fine.triangles.len()).collect();
        order.sort_by_key(|&triangle| places[origins[triangle] as usize]);
        let mut all = Self { mesh: Mesh::default(), samples: Vec::new(), hidden_area: 0.0 };
        for triangle in order {
            let Some((sample, hidden)) = found[triangle] else { continue };
            all.hidden_area += hidden;
            if sample.area > 0.0 {
                let first = all.mesh.vertices.len() as u32;
                all.mesh.vertices.extend(fine.corners(triangle));
                all.mesh.triangles.push([first, first + 1, first + 2]);
                let place = whole[places[origins[triangle] as usize] as usize].unwrap_or(sample);
                all.samples.push(SurfaceSample { area: sample.area, ..place });
            }
        }
        all
    }

    /// How many samples [`SurfaceSamples::new`] makes at the most.
    #[must_use]
    pub fn most(mesh: &Mesh, count: usize) -> usize {
        count.saturating_mul(8).max(mesh.triangles.len())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::parts::shell::{Axis, Shell, circle};
    use crate::voxelize::voxelize;
    use glam::{DMat4, DVec2};

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
            let one_each = SurfaceSamples::new(&mesh, &solid, 1).samples.len();
            assert_eq!(one_each, SurfaceSamples::most(&mesh, 1));
            assert!((samples.area() - 64.0).abs() < 1e-9 && samples.hidden_area == 0.0);
            let middle = DVec3::new(2.0, 2.0, 1.0);
            for (triangle, sample) in samples.samples.iter().enumerate() {
                assert!(sample.normal.dot(sample.point - middle) > 0.0 && sample.area < 0.2);
                assert!((area_vector(samples.mesh.corners(triangle)).length() - sample.area).abs() < 1e-12);
                assert_eq!(sample.bend, 0.0);
            }
        }
    }

    /// A cylinder along z of radius 4 between 0 and 6, of this many flat sides.
    fn cylinder(sides: usize) -> (Mesh, Occupancy) {
        let mut shell = Shell::default();
        shell.prism(Axis::Z, &circle(DVec2::ZERO, 4.0, sides), [0.0, 6.0]);
        let grid = Grid { origin: DVec3::splat(-5.0), pitch: 1.0, dims: [10, 10, 12] };
        let mesh = shell.into_mesh();
        let solid = voxelize(&mesh, &grid, false);
        (mesh, solid)
    }

    #[test]
    fn flat_faces_that_were_cut_into_small_triangles_are_sampled_as_before() {
        let (mesh, solid) = cylinder(24);
        let cut = mesh.welded().refined_with_origins(0.1, 1_000_000).0;
        assert!(cut.triangles.len() > 50_000);
        let [before, after] = [mesh, cut].map(|mesh| SurfaceSamples::new(&mesh, &solid, 2000));
        assert!((before.area() - after.area()).abs() < 1e-9 * before.area());
        let bends = |of: &SurfaceSamples| {
            let area = |bent: bool| {
                of.samples.iter().filter(|s| (s.bend > 0.0) == bent).map(|s| s.area).sum::<f64>()
            };
            [area(false), area(true)]
        };
        for (before, after) in bends(&before).into_iter().zip(bends(&after)) {
            assert!(before > 90.0 && (before - after).abs() < 1e-9 * before, "{before} {after}");
        }
        let count = |of: &SurfaceSamples| of.samples.len() as f64;
        assert!((count(&after) / count(&before) - 1.0).abs() < 0.3, "{} {}", count(&before), count(&after));
    }

    #[test]
    fn of_a_finely_curved_mesh_as_many_places_are_tried_as_of_a_coarse_one() {
        let ball = |steps: usize| {
            let along = (0..=steps).map(|step| step as f64 / steps as f64 * PI);
            let outline: Vec<[f64; 2]> = along.map(|angle| [-4.0 * angle.cos(), 4.0 * angle.sin()]).collect();
            Mesh::revolved(&outline, 2 * steps)
        };
        let [coarse, fine] = [ball(12), ball(100)];
        let grid = Grid { origin: DVec3::splat(-5.0), pitch: 0.5, dims: [20; 3] };
        let solid = voxelize(&fine, &grid, false);
        let [coarse, fine] = [coarse, fine].map(|mesh| SurfaceSamples::new(&mesh, &solid, 500));
        let places = |of: &SurfaceSamples| of.samples.chunk_by(SurfaceSample::is_tried_with).count();
        assert!(places(&coarse) as f64 > 0.9 * coarse.samples.len() as f64);
        assert!(fine.samples.len() > 30_000 && (fine.area() / coarse.area() - 1.0).abs() < 0.03);
        assert!((500..2000).contains(&places(&fine)), "{}", places(&fine));
        let radius = (fine.area() / 500.0 / PI).sqrt();
        for (triangle, sample) in fine.samples.iter().enumerate() {
            let [a, b, c] = fine.mesh.corners(triangle);
            assert!(sample.point.distance((a + b + c) / 3.0) <= radius);
            assert!(sample.normal.dot(area_vector([a, b, c]).normalize()) > 0.996);
        }
        // What ends somewhere on it is not known better.
        let [of_coarse, of_fine] = [&coarse, &fine].map(|of| of.border(|at| of.samples[at].point.x < 1.9));
        assert!(of_fine > 0.5 * of_coarse && of_fine < 2.5 * of_coarse, "{of_coarse} {of_fine}");
    }

    #[test]
    fn facets_of_a_cylinder_bend_by_half_their_angle_and_its_ends_do_not() {
        let (mesh, solid) = cylinder(24);
        for sample in SurfaceSamples::new(&mesh, &solid, 2000).samples {
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
        // One face of each is inside the other; their sides are flush for one unit along x, and count once.
        let surface = 2.0 * (7.0 * 4.0 + 4.0 * 4.0 + 7.0 * 4.0);
        assert!((samples.area() - surface).abs() < 1e-9, "{}", samples.area());
        assert!((samples.hidden_area - (2.0 * 96.0 - surface)).abs() < 1e-9, "{}", samples.hidden_area);
        // Three times the same cube is one.
        let mut thrice = cube.clone();
        thrice.append(&cube);
        thrice.append(&cube);
        let samples = SurfaceSamples::new(&thrice, &voxelize(&cube, &grid, false), 2000);
        assert!((samples.area() - 96.0).abs() < 1e-9 && (samples.hidden_area - 2.0 * 96.0).abs() < 1e-9);
    }
}
