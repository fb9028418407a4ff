//! Closing an open mesh by cones over its boundary, and taking their solid angles away again.
//!
//! The boundary is a chain of directed edges without ends. Cones from an apex over all its edges have the same
//! boundary, so mesh − cones is closed: its winding number is a whole number that crossings count, and
//! `w(mesh) = w(mesh − cones) + Σ solid angle(apex, a, b)/4π`.

use glam::DVec3;

use super::columns::WeightedTriangle;
use super::winding_number;
use crate::mesh::Mesh;
use crate::mesh::distance::{squared_to_segment, squared_to_triangle};
use crate::mesh::solid_angle::half_angle;

/// Cones over the boundary of a mesh; empty for a closed one.
pub(super) struct BoundaryCone {
    apex: DVec3,
    edges: Vec<(DVec3, DVec3, i32)>,
}

impl BoundaryCone {
    /// `chain` lists directed boundary edges with their multiplicity.
    pub(super) fn new(mesh: &Mesh, chain: &[([u32; 2], i32)]) -> Self {
        let edges: Vec<_> = chain
            .iter()
            .map(|&([a, b], times)| (mesh.vertices[a as usize], mesh.vertices[b as usize], times))
            .collect();
        let middle = edges.iter().map(|&(a, b, _)| (a + b) * 0.5).sum::<DVec3>() / edges.len().max(1) as f64;
        let (lower, upper) = mesh.bounds().unwrap_or_default();
        // Off every plane of symmetry, on which voxel centres like to lie.
        let offset = DVec3::new(0.017_320_5, 0.022_360_6, -0.026_457_5) * (upper - lower).length();
        Self { apex: middle + offset, edges }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The triangles that close the mesh: the cones turned round.
    pub(super) fn closing_triangles(&self) -> impl Iterator<Item = WeightedTriangle> {
        self.edges.iter().map(|&(a, b, times)| WeightedTriangle { corners: [self.apex, b, a], weight: times })
    }

    /// The winding number's part that is not counted, at the middle of a ball, and by how much at most it is another elsewhere in the ball.
    /// `None` where the ball may meet a cone, on which that part jumps.
    ///
    /// Away from the cones it changes as the magnetic field of a current along the boundary has it (Biot and Savart): by no more than
    /// the sum of length / 4π distance² over the edges.
    pub(super) fn open_part(&self, middle: DVec3, radius: f64, mesh: &Mesh) -> Option<(f64, f64)> {
        let mut gradient = 0.0;
        for &(a, b, times) in &self.edges {
            if squared_to_triangle([self.apex, a, b], middle) <= radius * radius {
                return None;
            }
            let near = (squared_to_segment([a, b], middle).sqrt() - radius).max(0.0);
            gradient += f64::from(times) * a.distance(b) / (4.0 * std::f64::consts::PI * near * near);
        }
        let change = gradient * radius;
        (change < 0.5).then(|| (self.open_winding(0, middle, mesh), change))
    }

    /// Winding number of the open mesh at `point`, from that of the closed one.
    ///
    /// The half angles are summed as a product of complex numbers whose turns are counted, which spares an arc
    /// tangent for each edge. Where the point lies on a cone within rounding, the two halves may disagree on its
    /// side: there the definition decides.
    pub(super) fn open_winding(&self, closed: i32, point: DVec3, mesh: &Mesh) -> f64 {
        let apex = self.apex - point;
        let (mut sine, mut cosine, mut turns) = (0.0f64, 1.0f64, 0i32);
        for &(a, b, times) in &self.edges {
            let (s, c) = half_angle([apex, a - point, b - point]);
            if c <= 0.0 && s.abs() <= -c * 1e-9 {
                return winding_number(mesh, point);
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
        // Half angles: a whole turn of the product is a winding of one.
        let half_turns = sine.atan2(cosine) / (2.0 * std::f64::consts::PI);
        f64::from(closed) + half_turns + f64::from(turns)
    }
}
