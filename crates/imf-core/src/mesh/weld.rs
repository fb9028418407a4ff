//! Sharing vertices that coincide, so that indices carry the topology.

use std::collections::HashMap;

use glam::DVec3;

use super::Mesh;

/// Collects triangles given by positions, sharing vertices that are exactly equal.
///
/// Vertices are numbered in the order of their first use. Zero and minus zero are equal.
#[derive(Default)]
pub(super) struct Welder {
    mesh: Mesh,
    known: HashMap<[u64; 3], u32>,
}

impl Welder {
    /// Adds a triangle; `None` if its vertices cannot be numbered in 32 bits any more.
    pub(super) fn push(&mut self, corners: [DVec3; 3]) -> Option<()> {
        let mut triangle = [0; 3];
        for (slot, corner) in triangle.iter_mut().zip(corners) {
            // Adding zero turns minus zero into zero.
            let corner = corner + 0.0;
            let next = u32::try_from(self.mesh.vertices.len()).ok()?;
            *slot = *self.known.entry(corner.to_array().map(f64::to_bits)).or_insert(next);
            if *slot == next {
                self.mesh.vertices.push(corner);
            }
        }
        self.mesh.triangles.push(triangle);
        Some(())
    }

    pub(super) fn finish(self) -> Mesh {
        self.mesh
    }
}

impl Mesh {
    /// The same triangles on shared vertices: those that are exactly equal become one, those that no triangle uses
    /// are dropped, and they are numbered in the order of their first use.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    #[must_use]
    pub fn welded(&self) -> Self {
        let mut welder = Welder::default();
        for triangle in 0..self.triangles.len() {
            // No more vertices come out than went in, and those are numbered in 32 bits already.
            let _ = welder.push(self.corners(triangle));
        }
        welder.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_vertices_are_shared_and_unused_ones_dropped() {
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let vertices = vec![p(9.0, 9.0), p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(-0.0, 0.0), p(-1.0, 0.0)];
        let mesh = Mesh { vertices, triangles: vec![[1, 2, 3], [4, 3, 5]] };
        let welded = mesh.welded();
        assert_eq!(welded.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(welded.vertices, [p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(-1.0, 0.0)]);
        assert_eq!(welded.welded(), welded);
    }
}
