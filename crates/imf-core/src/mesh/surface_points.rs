//! Points on a mesh's surface, so close together that little passes between them.

use glam::DVec3;

use super::Mesh;
use super::distance::squared_to_segment;
use super::topology::{EdgeUse, runs, sorted_edges};

/// Cosine of the angle between two facets beyond which their edge is sharp: 30 degrees.
pub(crate) const SMOOTH: f64 = 0.866;

/// How far points of a surface are apart, in pitches.
const SPACING: f64 = 0.5;
/// How far a face may differ from a plane to be taken for one, in the distance of points.
const FLAT: f64 = 4e-4;
/// Squares of the spacing that a surface is divided into, and steps along its edges, at most.
const MOST_POINTS: f64 = 4e6;
/// A point twice, and its share of the boxes.
const POINT_BYTES: f64 = 80.0;

/// The points of a body's surface that a cutter must not hold among voxels of a pitch, and how far they are apart.
pub(crate) fn points_at_pitch(mesh: &Mesh, pitch: f64) -> (Vec<DVec3>, f64) {
    let (spacing, _) = spacing(mesh, pitch);
    (surface_points(mesh, spacing), spacing)
}

/// Bytes of the points of a body's surface that a cutter must not hold among voxels of a pitch, while they are put in order.
#[doc(hidden)]
#[must_use]
pub fn points_memory_estimate(mesh: &Mesh, pitch: f64) -> u64 {
    (POINT_BYTES * spacing(mesh, pitch).1) as u64
}

/// Distance between points of a surface, and about how many there are.
fn spacing(mesh: &Mesh, pitch: f64) -> (f64, f64) {
    let area: f64 = mesh.all_corners().map(|corners| area_vector(corners).length()).sum();
    // Each edge is one of two triangles.
    let edges: f64 =
        mesh.all_corners().map(|[a, b, c]| 0.5 * (a.distance(b) + b.distance(c) + c.distance(a))).sum();
    let spacing = (SPACING * pitch).max((area / MOST_POINTS).sqrt()).max(edges / MOST_POINTS);
    (spacing, mesh.vertices.len() as f64 + edges / spacing + area / (spacing * spacing))
}

/// Along a triangle's normal, as long as its area.
pub(crate) fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    0.5 * (b - a).cross(c - a)
}

/// The vertices, and points on edges and facets no farther apart than `spacing`. Facets of a hollow stand inside of the
/// curve between their vertices: on them points lie behind the facet, as far as the curve may, but no farther than half the
/// spacing, and beside their edges there are none.
fn surface_points(mesh: &Mesh, spacing: f64) -> Vec<DVec3> {
    let mesh = &mesh.simplified(FLAT * spacing);
    let edges = sorted_edges(mesh);
    let facets = Facets::new(mesh, &edges, 0.5 * spacing);
    let mut used = vec![false; mesh.vertices.len()];
    mesh.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
    let vertices = mesh.vertices.iter().zip(used).filter(|(_, used)| *used);
    let mut points: Vec<DVec3> = vertices.map(|(vertex, _)| *vertex).collect();
    let mut chords = vec![[0.0; 3]; mesh.triangles.len()];
    for run in runs(&edges) {
        let ends = run[0].0;
        let [from, to] = ends.map(|vertex| mesh.vertices[vertex as usize]);
        let steps = (from.distance(to) / spacing).ceil() as usize;
        let behind = facets.behind_edge(run);
        points.extend((1..steps).map(|step| from.lerp(to, step as f64 / steps as f64) + behind));
        let widest = run.iter().map(|&(_, facet, _)| facets.sagitta[facet as usize]).fold(0.0, f64::max);
        for &(_, facet, _) in run {
            let corners = mesh.triangles[facet as usize];
            let opposite = corners.iter().position(|corner| !ends.contains(corner)).unwrap_or(0);
            chords[facet as usize][opposite] = widest;
        }
    }
    for (facet, chords) in chords.into_iter().enumerate() {
        let corners = mesh.corners(facet);
        let behind = facets.behind(facet);
        within(corners, spacing, |point| {
            // What stands inside of a curve that bounds a flat face.
            let beside = |corner: usize| {
                let edge = [corners[(corner + 1) % 3], corners[(corner + 2) % 3]];
                chords[corner] > facets.sagitta[facet]
                    && squared_to_segment(edge, point) < chords[corner] * chords[corner]
            };
            if !(0..3).any(beside) {
                points.push(point + behind);
            }
        });
    }
    points
}

/// Visits points inside a triangle, in rows along its longest edge.
fn within([a, b, c]: [DVec3; 3], spacing: f64, mut visit: impl FnMut(DVec3)) {
    let turned = [[a, b, c], [b, c, a], [c, a, b]];
    let longest = |one: &&[DVec3; 3], other: &&[DVec3; 3]| {
        one[1].distance_squared(one[2]).total_cmp(&other[1].distance_squared(other[2]))
    };
    let Some(&[apex, from, to]) = turned.iter().max_by(longest) else { return };
    let base = from.distance(to);
    let height = (from - apex).cross(to - apex).length() / base;
    let rows = (height / spacing).ceil();
    for row in 1..rows as usize {
        let down = row as f64 / rows;
        let (start, end) = (apex.lerp(from, down), apex.lerp(to, down));
        let steps = (base * down / spacing).ceil() as usize;
        (1..steps).for_each(|step| visit(start.lerp(end, step as f64 / steps as f64)));
    }
}

/// The facets' outward normals, and how far behind each a hollow lies that it stands for: the height of a circle's segment.
struct Facets {
    normals: Vec<DVec3>,
    sagitta: Vec<f64>,
}

impl Facets {
    fn new(mesh: &Mesh, edges: &[EdgeUse], most: f64) -> Self {
        let outward = if mesh.signed_volume() < 0.0 { -1.0 } else { 1.0 };
        let twice_area: Vec<DVec3> = (0..mesh.triangles.len())
            .map(|facet| mesh.corners(facet))
            .map(|corners| 2.0 * outward * area_vector(corners))
            .collect();
        let normals: Vec<DVec3> = twice_area.iter().map(|vector| vector.normalize_or_zero()).collect();
        let mut sagitta = vec![0.0_f64; normals.len()];
        for run in runs(edges) {
            let &[(ends, one, _), (_, other, _)] = run else { continue };
            let [one, other] = [one, other].map(|facet| facet as usize);
            let cosine = normals[one].dot(normals[other]);
            let [from, to] = ends.map(|vertex| mesh.vertices[vertex as usize]);
            let beyond: DVec3 = mesh.corners(other).iter().map(|corner| corner - from).sum();
            // Below a thousandth of a degree it is rounding.
            if (SMOOTH..1.0 - 1e-10).contains(&cosine) && normals[one].dot(beyond) > 0.0 {
                let width = twice_area[one].length().min(twice_area[other].length()) / from.distance(to);
                let height = (0.5 * width * (0.25 * cosine.acos()).tan()).min(most);
                for facet in [one, other] {
                    sagitta[facet] = sagitta[facet].max(height);
                }
            }
        }
        Self { normals, sagitta }
    }

    fn behind(&self, facet: usize) -> DVec3 {
        -self.sagitta[facet] * self.normals[facet]
    }

    /// Of an edge: behind both facets of a sharp one, and as far as either of a smooth one.
    fn behind_edge(&self, run: &[EdgeUse]) -> DVec3 {
        let facets = run.iter().map(|&(_, facet, _)| facet as usize);
        match run {
            [(_, one, _), (_, other, _)]
                if self.normals[*one as usize].dot(self.normals[*other as usize]) > SMOOTH =>
            {
                let by_depth = |a: &usize, b: &usize| self.sagitta[*a].total_cmp(&self.sagitta[*b]);
                facets.max_by(by_depth).map_or(DVec3::ZERO, |facet| self.behind(facet))
            }
            _ => facets.map(|facet| self.behind(facet)).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::tests::unit_cube;
    use crate::parts::shell::{circle, pocketed};

    #[test]
    fn every_place_of_a_cube_has_a_point_nearby() {
        let points = surface_points(&unit_cube(), 0.1);
        let on_face = |p: &DVec3| p.to_array().iter().any(|&c| c == 0.0 || c == 1.0);
        assert!(points.iter().all(|p| on_face(p) && p.min_element() >= 0.0 && p.max_element() <= 1.0));
        // 600 squares of the spacing.
        assert!((600..1000).contains(&points.len()), "{}", points.len());
        for place in 0..400 {
            let at = [place % 20, place / 20].map(|step| f64::from(step) / 19.0);
            for place in [DVec3::new(at[0], at[1], 0.0), DVec3::new(1.0, at[0], at[1])] {
                let nearest = points.iter().map(|p| p.distance(place)).fold(f64::INFINITY, f64::min);
                assert!(nearest < 0.1 * 0.75, "{place}: {nearest}");
            }
        }
    }

    #[test]
    fn no_point_of_a_round_hole_stands_inside_of_its_circle() {
        let centre = DVec2::new(10.0, 10.0);
        for sides in [12, 16, 48] {
            let mesh = pocketed(DVec3::splat(20.0), &circle(centre, 5.0, sides), 20.0);
            let points = surface_points(&mesh, 0.4);
            let away = |p: &DVec3| p.truncate().distance(centre);
            let least = points.iter().map(away).fold(f64::INFINITY, f64::min);
            assert!(least > 5.0 - 1e-9, "{sides}: {least}");
            // Its wall has points, no farther out than a facet lies inside.
            let sagitta = 5.0 * (1.0 - (std::f64::consts::PI / sides as f64).cos());
            let wall = points.iter().filter(|p| away(p) < 5.0 + 1.01 * sagitta && (1.0..19.0).contains(&p.z));
            assert!(wall.count() > 300, "{sides}");
        }
    }
}
