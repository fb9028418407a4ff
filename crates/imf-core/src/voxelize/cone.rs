//! Closing an open mesh by cones over its boundary, and taking their solid angles away again.
//!
//! The boundary is a chain of directed edges without ends, and so is each of its connected pieces. Cones over the edges of a
//! piece, from an apex near it, have the same boundary as it has, so mesh − cones is closed: its winding number is a whole
//! number that crossings count, and `w(mesh) = w(mesh − cones) + Σ solid angle(apex, a, b)/4π`.

use std::collections::BTreeMap;
use std::ops::{AddAssign, Range};

use glam::DVec3;

use super::columns::WeightedTriangle;
use super::winding_number;
use crate::mesh::Mesh;
use crate::mesh::distance::{squared_to_segment, squared_to_triangle};
use crate::mesh::groups::Groups;
use crate::mesh::solid_angle::half_angle;

/// Cones over the boundary of a mesh; empty for a closed one.
pub(super) struct BoundaryCone {
    edges: Vec<Edge>,
    pieces: Vec<Piece>,
}

/// An edge of the boundary.
struct Edge {
    a: DVec3,
    b: DVec3,
    /// How often the boundary has it.
    times: i32,
}

/// A connected piece of the boundary, and its apex. It lies in a ball around that.
struct Piece {
    edges: Range<usize>,
    apex: DVec3,
    radius: f64,
    /// Of all edges, as often as they count.
    length: f64,
    /// The cone lies between two planes across this unit vector, at these distances from the apex.
    normal: DVec3,
    between: [f64; 2],
}

/// What a winding number has beside its whole part, as a plane through its values in a ball: `constant + gradient · point`, off by at most
/// `error`.
#[derive(Clone, Copy, Default)]
pub(super) struct OpenPart {
    constant: f64,
    pub(super) gradient: DVec3,
    pub(super) error: f64,
}

impl OpenPart {
    pub(super) fn at(&self, point: DVec3) -> f64 {
        self.constant + self.gradient.dot(point)
    }
}

impl AddAssign for OpenPart {
    fn add_assign(&mut self, other: Self) {
        self.constant += other.constant;
        self.gradient += other.gradient;
        self.error += other.error;
    }
}

const FOUR_PI: f64 = 4.0 * std::f64::consts::PI;

impl BoundaryCone {
    /// `chain` lists directed boundary edges with their multiplicity.
    pub(super) fn new(mesh: &Mesh, chain: &[([u32; 2], i32)]) -> Self {
        let mut groups = Groups::new(if chain.is_empty() { 0 } else { mesh.vertices.len() });
        chain.iter().for_each(|&([a, b], _)| groups.join(a as usize, b as usize));
        let mut by_piece: BTreeMap<usize, Vec<Edge>> = BTreeMap::new();
        for &([a, b], times) in chain {
            let (a, b, piece) = (a as usize, b as usize, groups.root(a as usize));
            let edge = Edge { a: mesh.vertices[a], b: mesh.vertices[b], times };
            by_piece.entry(piece).or_default().push(edge);
        }
        let mut cone = Self { edges: Vec::new(), pieces: Vec::new() };
        for edges in by_piece.into_values() {
            let middle = edges.iter().map(|edge| (edge.a + edge.b) * 0.5).sum::<DVec3>() / edges.len() as f64;
            let farthest = |from: DVec3| edges.iter().map(|edge| edge.a.distance(from)).fold(0.0, f64::max);
            // Off every plane of symmetry, on which voxel centres like to lie.
            let apex = middle + DVec3::new(0.034_641, 0.044_721_2, -0.052_915) * farthest(middle);
            let area: DVec3 = edges.iter().map(|edge| (edge.a - apex).cross(edge.b - apex)).sum();
            let normal = area.normalize_or(DVec3::Z);
            let heights = edges.iter().flat_map(|edge| [edge.a, edge.b]).map(|end| normal.dot(end - apex));
            let between =
                heights.fold([0.0f64; 2], |[low, high], height| [low.min(height), high.max(height)]);
            cone.pieces.push(Piece {
                normal,
                between,
                edges: cone.edges.len()..cone.edges.len() + edges.len(),
                apex,
                radius: farthest(apex),
                length: edges.iter().map(|edge| f64::from(edge.times) * edge.a.distance(edge.b)).sum(),
            });
            cone.edges.extend(edges);
        }
        cone
    }

    pub(super) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The number of connected pieces.
    pub(super) fn pieces(&self) -> usize {
        self.pieces.len()
    }

    /// The triangles that close the mesh: the cones turned round.
    pub(super) fn closing_triangles(&self) -> impl Iterator<Item = WeightedTriangle> {
        self.pieces.iter().flat_map(|piece| {
            self.edges[piece.edges.clone()]
                .iter()
                .map(|&Edge { a, b, times }| WeightedTriangle { corners: [piece.apex, b, a], weight: times })
        })
    }

    /// What a piece adds in a ball. `None` where the ball may meet its cone, on which that jumps.
    ///
    /// Away from the cone it changes as the magnetic field of a current along the piece has it (Biot and Savart), and that field by no
    /// more than the sum of 2 · length / 4π distance³ over the edges.
    pub(super) fn open_part(&self, piece: usize, middle: DVec3, radius: f64) -> Option<OpenPart> {
        let piece = &self.pieces[piece];
        let edges = &self.edges[piece.edges.clone()];
        let away = middle.distance(piece.apex) - piece.radius - radius;
        // Far away one distance serves all edges.
        let bend = if away > piece.radius {
            2.0 * piece.length / away.powi(3)
        } else {
            let height = piece.normal.dot(middle - piece.apex);
            // Rounding takes nothing that touches.
            let reach = radius * (1.0 + 1e-9);
            let is_level = height + reach >= piece.between[0] && height - reach <= piece.between[1];
            let mut bend = 0.0;
            for &Edge { a, b, times } in edges {
                if is_level && squared_to_triangle([piece.apex, a, b], middle) <= reach * reach {
                    return None;
                }
                let near = squared_to_segment([a, b], middle).sqrt() - radius;
                bend += f64::from(times) * 2.0 * a.distance(b) / near.max(0.0).powi(3);
            }
            bend
        };
        let mut gradient = DVec3::ZERO;
        for &Edge { a, b, times } in edges {
            let (from, to) = (a - middle, b - middle);
            let (la, lb) = (from.length(), to.length());
            gradient +=
                f64::from(times) * from.cross(to) * ((la + lb) / (la * lb * (la * lb + from.dot(to))));
        }
        let gradient = gradient / FOUR_PI;
        let constant = self.open_winding([piece], middle)? - gradient.dot(middle);
        Some(OpenPart { constant, gradient, error: 0.5 * bend * radius * radius / FOUR_PI })
    }

    /// The sum of some pieces' solid angles at `point`, a sphere's as 1. `None` where it lies on a cone within rounding, and the two
    /// halves may disagree on its side.
    ///
    /// The half angles are summed as a product of complex numbers whose turns are counted, which spares an arc
    /// tangent for each edge.
    fn open_winding<'a>(&'a self, pieces: impl IntoIterator<Item = &'a Piece>, point: DVec3) -> Option<f64> {
        let (mut sine, mut cosine, mut turns) = (0.0f64, 1.0f64, 0i32);
        for piece in pieces {
            let apex = piece.apex - point;
            for &Edge { a, b, times } in &self.edges[piece.edges.clone()] {
                let (s, c) = half_angle([apex, a - point, b - point]);
                if c <= 0.0 && s.abs() <= -c * 1e-9 {
                    return None;
                }
                // Unit length keeps the product in range whatever the number of edges.
                let scale = 1.0 / (s * s + c * c).sqrt();
                let (s, c) = (s * scale, c * scale);
                for _ in 0..times {
                    let (next_sine, next_cosine) = (sine * c + cosine * s, cosine * c - sine * s);
                    if sine > 0.0 && s > 0.0 && next_sine <= 0.0 {
                        turns += 1;
                    } else if sine <= 0.0 && s < 0.0 && next_sine > 0.0 {
                        turns -= 1;
                    }
                    (sine, cosine) = (next_sine, next_cosine);
                }
            }
        }
        // Half angles: a whole turn of the product is a winding of one.
        Some(sine.atan2(cosine) / (2.0 * std::f64::consts::PI) + f64::from(turns))
    }

    /// As [`Self::open_winding`] of these pieces, by number.
    pub(super) fn open_winding_of(&self, pieces: &[u32], point: DVec3) -> Option<f64> {
        self.open_winding(pieces.iter().map(|&piece| &self.pieces[piece as usize]), point)
    }

    /// Winding number of the open mesh at `point`, from that of the closed one; where the point lies on a cone by the definition.
    pub(super) fn winding(&self, closed: i32, point: DVec3, mesh: &Mesh) -> f64 {
        let open = self.open_winding(&self.pieces, point);
        open.map_or_else(|| winding_number(mesh, point), |open| f64::from(closed) + open)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::topology::boundary_chain;
    use crate::voxelize::tests::sphere;

    #[test]
    fn the_plane_of_a_piece_bounds_it_all_over_a_ball() {
        let mut mesh = sphere(DVec3::new(0.03, -0.02, 0.01), 1.0, 2);
        mesh.triangles.retain(|t| t.iter().all(|&v| mesh.vertices[v as usize].z.abs() < 0.8));
        let cone = BoundaryCone::new(&mesh, &boundary_chain(&mesh));
        assert_eq!(cone.pieces(), 2);
        let mut asked = 0;
        for (at, radius) in
            [(DVec3::ZERO, 0.1), (DVec3::new(0.2, 0.1, 1.2), 0.15), (DVec3::new(3.0, 1.0, -2.0), 0.8)]
        {
            for piece in 0..2 {
                let part = cone.open_part(piece, at, radius).unwrap();
                for step in [DVec3::X, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.6, -0.8, 0.0)] {
                    let point = at + radius * step;
                    let exact = cone.open_winding_of(&[piece as u32], point).unwrap();
                    let off = (exact - part.at(point)).abs();
                    assert!(off <= part.error, "{at}, piece {piece}: {off} of {}", part.error);
                    // A constant may be off by more.
                    asked += usize::from((exact - part.at(at)).abs() > part.error);
                }
            }
        }
        assert!(asked > 0);
        // On the rim, and on the lid of it.
        let rim = &cone.edges[cone.pieces[0].edges.start];
        assert!(cone.open_part(0, rim.a, 0.01).is_none());
        assert!(cone.open_part(0, (cone.pieces[0].apex + rim.a + rim.b) / 3.0, 0.01).is_none());
    }
}
