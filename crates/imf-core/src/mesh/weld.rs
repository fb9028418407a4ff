//! Sharing vertices that coincide, so that indices carry the topology.

use std::collections::HashMap;

use glam::DVec3;

use super::Mesh;
use crate::file_error::{Fault, FaultKind};

/// The most triangles that a mesh may have.
const MAX_TRIANGLES: usize = 1 << 31;

/// Collects triangles given by positions, sharing vertices that are exactly equal.
///
/// Vertices are numbered in the order of their first use. Zero and minus zero are equal.
#[derive(Default)]
pub(crate) struct Welder {
    mesh: Mesh,
    known: HashMap<[u64; 3], u32>,
}

impl Welder {
    /// Adds a triangle; refuses one too many, or whose vertices cannot be numbered in 32 bits any more.
    pub(crate) fn push(&mut self, corners: [DVec3; 3]) -> Result<(), Fault> {
        check_count(self.mesh.triangles.len() + 1)?;
        let mut triangle = [0; 3];
        for (slot, corner) in triangle.iter_mut().zip(corners) {
            // Adding zero turns minus zero into zero.
            let corner = corner + 0.0;
            let next = u32::try_from(self.mesh.vertices.len()).map_err(|_| too_large())?;
            *slot = *self.known.entry(corner.to_array().map(f64::to_bits)).or_insert(next);
            if *slot == next {
                self.mesh.vertices.push(corner);
            }
        }
        self.mesh.triangles.push(triangle);
        Ok(())
    }

    /// Adds a polygon as a fan of triangles; fewer than three corners are nothing.
    pub(crate) fn push_fan(&mut self, corners: &[DVec3]) -> Result<(), Fault> {
        corners.windows(2).skip(1).try_for_each(|pair| self.push([corners[0], pair[0], pair[1]]))
    }

    pub(crate) fn finish(self) -> Mesh {
        self.mesh
    }
}

fn too_large() -> Fault {
    let cause = "it has more than 2^31 triangles; reduce the mesh (MeshLab, Blender) and export it again";
    Fault::new(FaultKind::TooLarge, cause)
}

fn check_count(triangles: usize) -> Result<(), Fault> {
    if triangles > MAX_TRIANGLES { Err(too_large()) } else { Ok(()) }
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

    #[test]
    fn no_mesh_has_more_triangles_than_can_be_indexed() {
        assert_eq!(check_count(MAX_TRIANGLES + 1), Err(too_large()));
        assert_eq!(check_count(MAX_TRIANGLES), Ok(()));
    }
}
