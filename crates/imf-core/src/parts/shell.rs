//! A surface built from flat faces with holes and from walls between loops.
//!
//! A loop is made once, in the plane, and placed wherever a face or a wall needs it. Corners at exactly equal
//! positions become one vertex, so faces and walls that share a loop close without a seam, and no tolerance
//! decides what belongs together.

use earcut::{Earcut, refine};
use glam::{DVec2, DVec3};

use crate::mesh::Mesh;
use crate::mesh::weld::Welder;

/// The world axis that a plane of loops is perpendicular to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Planes at constant x; a loop's coordinates are (y, z).
    X,
    /// Planes at constant y; a loop's coordinates are (z, x).
    Y,
    /// Planes at constant z; a loop's coordinates are (x, y).
    Z,
}

/// The side of its plane that a flat face faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facing {
    /// Towards smaller coordinates on the axis.
    Down,
    /// Towards larger coordinates on the axis.
    Up,
}

impl Axis {
    /// The point of the plane at `height` with the plane's coordinates `p`.
    pub fn point(self, p: DVec2, height: f64) -> DVec3 {
        match self {
            Self::X => DVec3::new(height, p.x, p.y),
            Self::Y => DVec3::new(p.y, height, p.x),
            Self::Z => DVec3::new(p.x, p.y, height),
        }
    }

    /// A loop of the plane at `height`.
    pub fn place(self, outline: &[DVec2], height: f64) -> Vec<DVec3> {
        outline.iter().map(|&p| self.point(p, height)).collect()
    }
}

/// A mesh under construction, whose equal positions are one vertex.
#[derive(Default)]
pub struct Shell {
    welder: Welder,
}

impl Shell {
    /// The finished mesh.
    pub fn into_mesh(self) -> Mesh {
        self.welder.finish()
    }

    /// Adds a triangle, counter-clockwise seen from outside; one with two equal corners is dropped.
    fn triangle(&mut self, a: DVec3, b: DVec3, c: DVec3) {
        if a != b && b != c && c != a {
            // The parts have far fewer triangles than can be indexed.
            let _ = self.welder.push([a, b, c]);
        }
    }

    /// Adds the quadrilateral `a b c d`, counter-clockwise seen from outside, cut along its shorter diagonal.
    fn quad(&mut self, a: DVec3, b: DVec3, c: DVec3, d: DVec3) {
        if a.distance_squared(c) < b.distance_squared(d) {
            self.triangle(a, b, c);
            self.triangle(a, c, d);
        } else {
            self.triangle(a, b, d);
            self.triangle(b, c, d);
        }
    }

    /// Adds a flat face: the loop `outer` less the loops `holes`, all of any sense, in the plane at `height`.
    pub fn face(&mut self, axis: Axis, height: f64, facing: Facing, outer: &[DVec2], holes: &[&[DVec2]]) {
        let mut corners = outer.to_vec();
        let mut starts = Vec::with_capacity(holes.len());
        for hole in holes {
            starts.push(corners.len());
            corners.extend_from_slice(hole);
        }
        let plane: Vec<[f64; 2]> = corners.iter().map(DVec2::to_array).collect();
        let mut triangles = Vec::new();
        Earcut::new().earcut(plane.iter().copied(), &starts, &mut triangles);
        // Ears are slivers; Delaunay's flips make of them what a reader of the mesh expects.
        refine(&mut triangles, &plane);
        for t in triangles.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| corners[i]);
            let counter_clockwise = (b - a).perp_dot(c - a) > 0.0;
            let [b, c] = if counter_clockwise == (facing == Facing::Up) { [b, c] } else { [c, b] };
            self.triangle(axis.point(a, height), axis.point(b, height), axis.point(c, height));
        }
    }

    /// Adds the strip between two lines of equal length, which faces the reader who sees `from` run to the
    /// right below `to`.
    ///
    /// # Panics
    /// If the lines differ in length.
    pub fn strip(&mut self, from: &[DVec3], to: &[DVec3]) {
        assert_eq!(from.len(), to.len(), "a strip runs between lines of equal length");
        for i in 1..from.len() {
            self.quad(from[i - 1], from[i], to[i], to[i - 1]);
        }
    }

    /// Adds the closed strip between two loops: [`Shell::strip`] and the piece from the last corners to the
    /// first.
    ///
    /// # Panics
    /// If the loops are empty or differ in length.
    pub fn band(&mut self, from: &[DVec3], to: &[DVec3]) {
        self.strip(from, to);
        let last = from.len() - 1;
        self.quad(from[last], from[0], to[0], to[last]);
    }

    /// Adds the outside of the body that a counter-clockwise loop sweeps between two heights, without its ends.
    pub fn post(&mut self, axis: Axis, outline: &[DVec2], heights: [f64; 2]) {
        self.band(&axis.place(outline, heights[0]), &axis.place(outline, heights[1]));
    }

    /// Adds the whole surface of the body that a counter-clockwise loop sweeps between two heights.
    pub fn prism(&mut self, axis: Axis, outline: &[DVec2], heights: [f64; 2]) {
        self.post(axis, outline, heights);
        self.face(axis, heights[0], Facing::Down, outline, &[]);
        self.face(axis, heights[1], Facing::Up, outline, &[]);
    }

    /// Adds the inside of the hole that a counter-clockwise loop sweeps between two heights, without its ends.
    pub fn hole(&mut self, axis: Axis, outline: &[DVec2], heights: [f64; 2]) {
        self.band(&axis.place(outline, heights[1]), &axis.place(outline, heights[0]));
    }
}

/// A rectangle over two ranges of the plane's coordinates, counter-clockwise.
pub fn rectangle(u: [f64; 2], v: [f64; 2]) -> [DVec2; 4] {
    [[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]].map(DVec2::from_array)
}

/// A whole circle, counter-clockwise.
pub fn circle(centre: DVec2, radius: f64, segments: usize) -> Vec<DVec2> {
    let step = 360.0 / segments as f64;
    (0..segments).map(|i| centre + radius * DVec2::from_angle((i as f64 * step).to_radians())).collect()
}

/// A box from the origin to `size`, with the loop `pocket` cut into its top as deep as `depth`, or right through.
#[cfg(test)]
pub fn pocketed(size: DVec3, pocket: &[DVec2], depth: f64) -> Mesh {
    let outer = rectangle([0.0, size.x], [0.0, size.y]);
    let floor = size.z - depth;
    let mut shell = Shell::default();
    shell.post(Axis::Z, &outer, [0.0, size.z]);
    shell.face(Axis::Z, size.z, Facing::Up, &outer, &[pocket]);
    shell.hole(Axis::Z, pocket, [floor, size.z]);
    if floor > 0.0 {
        shell.face(Axis::Z, 0.0, Facing::Down, &outer, &[]);
        shell.face(Axis::Z, floor, Facing::Up, pocket, &[]);
    } else {
        shell.face(Axis::Z, 0.0, Facing::Down, &outer, &[pocket]);
    }
    shell.into_mesh()
}

/// A rectangle with round corners, counter-clockwise: `segments` to a quarter circle.
pub fn rounded_rectangle(lower: DVec2, upper: DVec2, radius: f64, segments: usize) -> Vec<DVec2> {
    let (low, high) = (lower + radius, upper - radius);
    let centres = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
    let quarter = |(i, centre): (usize, DVec2)| {
        let angle = move |step: usize| 180.0 + 90.0 * (i as f64 + step as f64 / segments as f64);
        (0..=segments).map(move |step| centre + radius * DVec2::from_angle(angle(step).to_radians()))
    };
    centres.into_iter().enumerate().flat_map(quarter).collect()
}

/// Area of a loop by the shoelace formula: positive for a counter-clockwise one.
#[cfg(test)]
pub fn area(outline: &[DVec2]) -> f64 {
    (0..outline.len()).map(|i| outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::tests::open_edges;

    #[test]
    fn a_tube_closes_along_every_axis() {
        let outer = rectangle([0.0, 30.0], [0.0, 20.0]);
        let inner = circle(DVec2::new(11.0, 9.0), 6.0, 17);
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            let mut shell = Shell::default();
            shell.post(axis, &outer, [2.0, 9.0]);
            shell.hole(axis, &inner, [2.0, 9.0]);
            shell.face(axis, 2.0, Facing::Down, &outer, &[&inner]);
            shell.face(axis, 9.0, Facing::Up, &outer, &[&inner]);
            let mesh = shell.into_mesh();
            assert_eq!(open_edges(&mesh), 0, "{axis:?}");
            let expected = (area(&outer) - area(&inner)) * 7.0;
            assert!((mesh.signed_volume() - expected).abs() < 1e-9 * expected, "{axis:?}");
            let (lower, upper) = mesh.bounds().unwrap();
            assert!((lower - axis.point(DVec2::ZERO, 2.0)).length() < 1e-12, "{axis:?}: {lower}");
            assert!((upper - axis.point(DVec2::new(30.0, 20.0), 9.0)).length() < 1e-12, "{axis:?}: {upper}");
        }
    }

    #[test]
    fn polygons_of_circles_have_the_areas_of_geometry() {
        let polygon = 0.5 * 24.0 * (std::f64::consts::TAU / 24.0).sin() * 9.0;
        assert!((area(&circle(DVec2::new(5.0, -2.0), 3.0, 24)) - polygon).abs() < 1e-12);
    }
}
