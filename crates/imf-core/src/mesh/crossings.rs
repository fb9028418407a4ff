//! Where vertical lines cross triangles, and winding numbers of a closed surface by counting signed crossings.
//!
//! A line may meet an edge or a vertex exactly. Every test is made as if it stood at (x + ε, y + ε²) for an infinitesimal ε: each
//! shared edge then has the line on one definite side, so exactly one of two neighbouring triangles is crossed. The signs come from an
//! exact predicate.

use glam::{DVec2, DVec3};
use robust::{Coord, orient2d};

/// Twice the area of a triangle seen from above, positive where its corners go counter-clockwise.
pub(crate) fn seen_from_above([a, b, c]: [DVec3; 3]) -> f64 {
    orient2d(coord(a), coord(b), coord(c))
}

/// Height at which the vertical line through `point` crosses the triangle, if it does.
pub(crate) fn crossing_height(corners: &[DVec3; 3], counter_clockwise: bool, point: DVec3) -> Option<f64> {
    let mut weights = [0.0; 3];
    for side in 0..3 {
        let (from, to) = (corners[(side + 1) % 3], corners[(side + 2) % 3]);
        let (area, left) = side_of(from, to, point);
        if left != counter_clockwise {
            return None;
        }
        weights[side] = area;
    }
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 {
        return Some((corners[0].z + corners[1].z + corners[2].z) / 3.0);
    }
    Some((weights[0] * corners[0].z + weights[1] * corners[1].z + weights[2] * corners[2].z) / sum)
}

/// Twice the signed area of (from, to, point), and whether the perturbed point is to the left of the edge.
fn side_of(from: DVec3, to: DVec3, point: DVec3) -> (f64, bool) {
    let area = orient2d(coord(from), coord(to), coord(point));
    let left = if area != 0.0 {
        area > 0.0
    } else if to.y != from.y {
        to.y < from.y
    } else {
        to.x > from.x
    };
    (area, left)
}

fn coord(p: DVec3) -> Coord<f64> {
    Coord { x: p.x, y: p.y }
}

/// Triangles by the squares of the plane that they lie above, each with the sign of its facing.
pub(crate) struct CrossingIndex {
    triangles: Vec<([DVec3; 3], i32)>,
    lower: DVec3,
    /// Squares per unit of length along x and y, and their number along each.
    per_unit: DVec2,
    side: usize,
    /// By square.
    above: Vec<Vec<u32>>,
}

/// Triangles to a square, on average, where all are of one size.
const PER_SQUARE: usize = 2;
/// Squares that a triangle covers, at most and on average.
const MOST_SQUARES: usize = 16;
/// Rounding in a square's bounds, in squares.
const SLACK: f64 = 1e-6;

impl CrossingIndex {
    pub(crate) fn new(triangles: impl Iterator<Item = [DVec3; 3]>) -> Self {
        let triangles: Vec<([DVec3; 3], i32)> = triangles
            .filter_map(|corners| match seen_from_above(corners) {
                0.0 => None,
                area => Some((corners, if area > 0.0 { 1 } else { -1 })),
            })
            .collect();
        let corners = || triangles.iter().flat_map(|(corners, _)| corners);
        let lower = corners().fold(DVec3::INFINITY, |lower, &corner| lower.min(corner));
        let upper = corners().fold(DVec3::NEG_INFINITY, |upper, &corner| upper.max(corner));
        let mut index = Self { triangles, lower, per_unit: DVec2::ZERO, side: 0, above: Vec::new() };
        let count = index.triangles.len();
        let mut side = ((count / PER_SQUARE) as f64).sqrt().ceil().max(1.0) as usize;
        // Long triangles lie above many squares, so that larger ones are taken.
        loop {
            index.side = side;
            index.per_unit = side as f64 / (upper - lower).truncate().max(DVec2::splat(f64::MIN_POSITIVE));
            let all: usize = index.triangles.iter().map(|(corners, _)| index.squares(corners).count()).sum();
            if side == 1 || all <= MOST_SQUARES * count {
                break;
            }
            side /= 2;
        }
        let mut above = vec![Vec::new(); side * side];
        for (number, (corners, _)) in index.triangles.iter().enumerate() {
            index.squares(corners).for_each(|square: usize| above[square].push(number as u32));
        }
        Self { above, ..index }
    }

    /// The squares that a triangle may lie above; those of a sliver are few, though its box holds many.
    fn squares(&self, corners: &[DVec3; 3]) -> impl Iterator<Item = usize> {
        let (corners, side) = (corners.map(|corner| self.in_squares(corner)), self.side);
        let [a, b, c] = corners.map(|corner| corner.x);
        (nearest(a.min(b).min(c), side)..=nearest(a.max(b).max(c), side)).flat_map(move |column| {
            let [low, high] = within_strip(corners, [column as f64 - SLACK, column as f64 + 1.0 + SLACK]);
            (nearest(low - SLACK, side)..=nearest(high + SLACK, side)).map(move |row| column * side + row)
        })
    }

    fn in_squares(&self, point: DVec3) -> DVec2 {
        (point - self.lower).truncate() * self.per_unit
    }

    /// The winding number of a closed surface around a point.
    pub(crate) fn winding_number(&self, point: DVec3) -> i32 {
        let [x, y] = self.in_squares(point).to_array().map(|at| nearest(at, self.side));
        let around = self.above[x * self.side + y].iter().map(|&number| &self.triangles[number as usize]);
        let crossed = around.filter(|(corners, sign)| {
            crossing_height(corners, *sign > 0, point).is_some_and(|height| height > point.z)
        });
        crossed.map(|(_, sign)| sign).sum()
    }
}

/// Which of `side` squares in a row holds a place.
fn nearest(at: f64, side: usize) -> usize {
    (at.max(0.0) as usize).min(side - 1)
}

/// The range of y of a triangle between two values of x.
fn within_strip(corners: [DVec2; 3], [from, to]: [f64; 2]) -> [f64; 2] {
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

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use glam::{DMat4, DQuat};

    use super::super::solid_angle::winding_number;
    use super::*;
    use crate::parts::ReferencePart;
    use crate::parts::shell::{Axis, Shell, circle};

    #[test]
    fn crossings_count_what_solid_angles_sum_to() {
        let mut mesh = ReferencePart::ScrewGear.mesh();
        let (lower, upper) = mesh.bounds().unwrap();
        // A second body, in which half of it lies.
        mesh.append(&crate::mesh::Mesh::cuboid(lower - 1.0, 0.5 * (lower + upper)));
        let index = CrossingIndex::new(mesh.all_corners());
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut seen = [0; 3];
        for place in 0..400 {
            // Some on lines through vertices.
            let mut point =
                lower + (upper - lower) * DVec3::from_array([(); 3].map(|()| random.random_range(-0.2..1.2)));
            if place % 4 == 0 {
                point = mesh.vertices[place % mesh.vertices.len()].with_z(point.z);
            }
            let counted = index.winding_number(point);
            assert!((winding_number(mesh.all_corners(), point) - f64::from(counted)).abs() < 1e-6, "{point}");
            seen[counted as usize] += 1;
        }
        assert!(seen.iter().all(|&times| times > 9), "{seen:?}");
    }

    #[test]
    fn slivers_lie_above_few_squares_each() {
        let mut shell = Shell::default();
        shell.prism(Axis::Z, &circle(DVec2::ZERO, 10.0, 200), [0.0, 6.0]);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
        let mesh = shell.into_mesh().transformed(&DMat4::from_quat(turn));
        let index = CrossingIndex::new(mesh.all_corners());
        let listed: usize = index.above.iter().map(Vec::len).sum();
        // So few that the squares are as small as they may be.
        let (side, count) = (index.side, index.triangles.len());
        assert!(side == 20 && listed < 12 * count, "{listed} of {count} in {side}");
        let (mut inside, all) = (0, 4000);
        for place in 0..all {
            let part = |step: f64| 24.0 * (f64::from(place) * step).fract() - 12.0;
            let point = DVec3::new(part(0.618), part(0.755), part(0.57));
            let counted = index.winding_number(point);
            assert!((winding_number(mesh.all_corners(), point) - f64::from(counted)).abs() < 1e-6, "{point}");
            inside += counted.abs();
        }
        assert!((300..all / 2).contains(&inside), "{inside}");
    }
}
