//! How far a point is from triangles.

use glam::DVec3;

use super::Mesh;

/// Distance from a point to the nearest triangle of a mesh.
pub(crate) fn distance_to_mesh(mesh: &Mesh, point: DVec3) -> f64 {
    let squared = mesh.all_corners().map(|corners| squared_to_triangle(corners, point));
    squared.fold(f64::INFINITY, f64::min).sqrt()
}

/// Squared distance from a point to a triangle.
pub(crate) fn squared_to_triangle([a, b, c]: [DVec3; 3], point: DVec3) -> f64 {
    let normal = (b - a).cross(c - a);
    // Inside of all three edges, seen along the normal.
    let inside =
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| normal.cross(*to - *from).dot(point - *from) >= 0.0);
    if inside && normal.length_squared() > 0.0 {
        return (point - a).dot(normal).powi(2) / normal.length_squared();
    }
    let edge = |from: DVec3, to: DVec3| squared_to_segment([from, to], point);
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

/// Squared distance from a point to a straight line between two others.
pub(crate) fn squared_to_segment([from, to]: [DVec3; 2], point: DVec3) -> f64 {
    let way = to - from;
    let foot = if way.length_squared() > 0.0 { (point - from).dot(way) / way.length_squared() } else { 0.0 };
    point.distance_squared(from + way * foot.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::unit_cube;

    #[test]
    fn distances_to_a_cube_are_those_of_its_faces_edges_and_corners() {
        let cube = unit_cube();
        for (point, expected) in [
            (DVec3::splat(0.5), 0.5),
            (DVec3::new(0.2, 0.5, 0.6), 0.2),
            (DVec3::new(2.0, 0.5, 0.5), 1.0),
            (DVec3::new(4.0, 5.0, 0.5), 5.0),
            (DVec3::new(3.0, 3.0, 2.0), 3.0),
        ] {
            assert!((distance_to_mesh(&cube, point) - expected).abs() < 1e-12, "{point}");
        }
    }
}
