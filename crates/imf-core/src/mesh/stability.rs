//! Whether a part stands by itself on a plane, and on how much of its surface.

use glam::{DVec2, DVec3};

use super::Mesh;

/// Vertices this near to the lowest one stand on the plane too, as a fraction of the part's size.
const LEVEL: f64 = 1e-6;

impl Mesh {
    /// True where the part, filled evenly, stands by itself with the unit vector `down` pointing to the floor: its centre of mass
    /// lies above the inside of the convex hull of the vertices that touch the floor.
    #[must_use]
    pub fn is_stable_on(&self, down: DVec3) -> bool {
        let (u, v) = down.any_orthonormal_pair();
        let flat = |p: DVec3| DVec2::new(p.dot(u), p.dot(v));
        let (floor, level) = self.floor(down);
        let corners = self.triangles.iter().flatten().map(|&index| self.vertices[index as usize]);
        let touching = corners.filter(|p| p.dot(down) >= floor - level).map(flat).collect();
        let hull = hull(touching);
        let centre = flat(self.centre_of_mass());
        hull.len() > 2
            && (0..hull.len()).all(|at| {
                let (a, b) = (hull[at], hull[(at + 1) % hull.len()]);
                (b - a).perp_dot(centre - a) > level * (b - a).length()
            })
    }

    /// Area of the surface that lies on the floor, with the unit vector `down` pointing to it, in the mesh's unit squared.
    #[must_use]
    pub fn floor_area(&self, down: DVec3) -> f64 {
        let (floor, level) = self.floor(down);
        let lying = self.all_corners().filter(|corners| corners.iter().all(|p| p.dot(down) >= floor - level));
        // A sum of nothing is −0.
        lying.map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum::<f64>() + 0.0
    }

    /// How far the floor lies along `down`, and how much higher still touches it.
    pub(crate) fn floor(&self, down: DVec3) -> (f64, f64) {
        let corners = self.triangles.iter().flatten().map(|&index| self.vertices[index as usize]);
        let floor = corners.map(|p| p.dot(down)).fold(f64::NEG_INFINITY, f64::max);
        (floor, LEVEL * self.bounds().map_or(0.0, |(lower, upper)| (upper - lower).length()))
    }

    /// The centre of the enclosed volume; that of the vertices' box where no volume is enclosed.
    fn centre_of_mass(&self) -> DVec3 {
        let middle = self.bounds().map_or(DVec3::ZERO, |(lower, upper)| (lower + upper) * 0.5);
        let (mut volume, mut moment) = (0.0, DVec3::ZERO);
        for corners in self.all_corners() {
            let [a, b, c] = corners.map(|p| p - middle);
            let part = a.dot(b.cross(c));
            volume += part;
            moment += (a + b + c) * (0.25 * part);
        }
        if volume == 0.0 { middle } else { middle + moment / volume }
    }
}

/// The convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp_dot(point - b) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut chain = half(&mut points.iter().copied());
    chain.extend(half(&mut points.iter().rev().copied()));
    chain
}

#[cfg(test)]
mod tests {
    use glam::DMat4;

    use super::*;
    use crate::mesh::tests::unit_cube;

    #[test]
    fn a_cube_stands_on_its_faces_alone() {
        let cube = unit_cube();
        for down in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z] {
            assert!(cube.is_stable_on(down), "{down}");
            assert_eq!(cube.floor_area(down), 1.0, "{down}");
        }
        for down in [DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 1.0), DVec3::new(0.1, 0.0, 1.0)] {
            assert!(!cube.is_stable_on(down.normalize()), "{down}");
            assert_eq!(cube.floor_area(down.normalize()), 0.0, "{down}");
        }
    }

    /// A tower that leans by its height per height stands while less than half of its foot, and falls beyond.
    #[test]
    fn a_leaning_tower_falls_where_its_centre_leaves_its_foot() {
        let leaning = |by: f64| {
            let mut shear = DMat4::IDENTITY;
            shear.z_axis.x = by;
            unit_cube().transformed(&shear)
        };
        assert!(leaning(0.99).is_stable_on(-DVec3::Z));
        assert!(!leaning(1.01).is_stable_on(-DVec3::Z));
    }
}
