//! The tool's surface as triangles: for pictures, and for libraries that know nothing else.

use super::{Segment, Tool};
use crate::mesh::Mesh;

/// Pieces of an arc.
const PIECES: usize = 12;

impl Tool {
    /// The closed surface in the tool's frame and unit, triangles facing outwards. A tool of revolution gets `sides`
    /// flat faces around its axis (at least 3); a mesh tool is returned as it is.
    #[must_use]
    pub fn surface(&self, sides: usize) -> Mesh {
        if let Some(mesh) = self.mesh() {
            return mesh.clone();
        }
        let mut outline: Vec<[f64; 2]> = Vec::new();
        for segment in self.segments() {
            let (from, to) = segment.range();
            let pieces = if matches!(segment, Segment::Line { .. }) { 1 } else { PIECES };
            for piece in 0..=pieces {
                let height = from + (to - from) * piece as f64 / pieces as f64;
                outline.push([height, segment.radius(height)]);
            }
        }
        outline.dedup();
        Mesh::revolved(&outline, sides)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::topology::MeshReport;

    #[test]
    fn the_surface_has_the_tools_volume_and_faces_outwards() {
        let tool = Tool::paper();
        let mesh = tool.surface(48);
        // A polygon of 48 corners has 0.3 % less area than its circle, arcs in 12 pieces lose a little more.
        let volume = mesh.signed_volume();
        assert!(volume < tool.volume() && volume > 0.995 * tool.volume(), "{volume}");
        assert!(MeshReport::new(&mesh).closed);
        let (low, high) = mesh.bounds().unwrap();
        assert!((low.z.abs() < 1e-9) && (high.z - tool.length()).abs() < 1e-9);
    }
}
