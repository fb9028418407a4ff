//! Triangle meshes: what they hold, what can be said about them, and the rigid set-up transform.

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

pub(crate) mod distance;
mod face_orientation;
mod features;
pub(crate) mod groups;
pub mod read;
mod refine;
mod revolved;
pub(crate) mod solid_angle;
mod stability;
pub mod topology;
pub(crate) mod weld;
#[cfg(feature = "formats")]
pub mod write;

pub use face_orientation::FaceRepair;
pub use features::MachiningDirection;
pub(crate) use features::SAME;

/// A triangle mesh in its own unit. Vertices may be shared or repeated; orientation may be any.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Vertex positions.
    pub vertices: Vec<DVec3>,
    /// Triangles as indices into `vertices`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The box between two corners, its triangles facing outwards.
    #[must_use]
    pub fn cuboid(lower: DVec3, upper: DVec3) -> Self {
        let corner = |i: usize| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 0 { low } else { high };
            DVec3::new(pick(0, lower.x, upper.x), pick(1, lower.y, upper.y), pick(2, lower.z, upper.z))
        };
        let sides: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self {
            vertices: (0..8).map(corner).collect(),
            triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    /// True where every triangle's vertices are there, and finite.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let is_sound = |&vertex: &u32| self.vertices.get(vertex as usize).is_some_and(|at| at.is_finite());
        self.triangles.iter().flatten().all(is_sound)
    }

    /// The lower and upper corner of the box around the vertices that triangles use; `None` without triangles.
    #[must_use]
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut corners = self.triangles.iter().flatten().map(|&v| self.vertices[v as usize]);
        let first = corners.next()?;
        Some(corners.fold((first, first), |(lower, upper), p| (lower.min(p), upper.max(p))))
    }

    /// The three corners of a triangle.
    ///
    /// # Panics
    /// If the triangle or one of its vertices does not exist.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// The three corners of every triangle.
    pub(crate) fn all_corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        (0..self.triangles.len()).map(|triangle| self.corners(triangle))
    }

    /// Signed volume by the divergence theorem: positive for a closed mesh whose triangles face outwards.
    #[must_use]
    pub fn signed_volume(&self) -> f64 {
        // Relative to the box's centre, so that an open mesh far from the origin does not drown in cancellation.
        let centre = self.bounds().map_or(DVec3::ZERO, |(lower, upper)| (lower + upper) * 0.5);
        let cones = self.all_corners().map(|corners| corners.map(|p| p - centre));
        cones.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    /// The mesh moved by an affine transform; a mirroring one turns the triangles so that they still face outwards.
    #[must_use]
    pub fn transformed(&self, transform: &DMat4) -> Self {
        let mirrored = transform.determinant() < 0.0;
        let turned = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        Self {
            vertices: self.vertices.iter().map(|&p| transform.transform_point3(p)).collect(),
            triangles: self.triangles.iter().map(turned).collect(),
        }
    }

    /// Number of vertices that triangles use.
    pub(crate) fn used_vertices(&self) -> usize {
        let mut used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        used.into_iter().filter(|used| *used).count()
    }

    /// Appends another mesh.
    pub fn append(&mut self, other: &Self) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The cube [0, 1]³, triangles outwards.
    pub(crate) fn unit_cube() -> Mesh {
        Mesh::cuboid(DVec3::ZERO, DVec3::ONE)
    }

    #[test]
    fn volume_is_signed_and_survives_mirroring() {
        let cube = unit_cube();
        assert!((cube.signed_volume() - 1.0).abs() < 1e-15);
        let mirror = DMat4::from_scale(DVec3::new(-2.0, 1.0, 1.0));
        assert!((cube.transformed(&mirror).signed_volume() - 2.0).abs() < 1e-15);
    }
}
