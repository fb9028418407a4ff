//! Meshes of revolution: the tool for libraries that know nothing else, and a sphere.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::tool::{Segment, Tool, ToolShape};

/// Corners of a tool's ring.
const FACETS: usize = 48;
/// Pieces of an arc.
const PIECES: usize = 12;

/// A tool of revolution with its faces turned outwards; a mesh tool is what it is.
pub(crate) fn tool_mesh(tool: &Tool) -> Mesh {
    let elements = match &tool.shape {
        ToolShape::Mesh(mesh) => return mesh.clone(),
        ToolShape::Revolved(elements) => elements,
    };
    // The outline from the axis to the axis: heights and radii.
    let mut outline: Vec<[f64; 2]> = Vec::new();
    for segment in elements.iter().flat_map(|element| &element.profile) {
        let (from, to) = segment.range();
        let pieces = if matches!(segment, Segment::Line { .. }) { 1 } else { PIECES };
        for piece in 0..=pieces {
            let height = from + (to - from) * piece as f64 / pieces as f64;
            outline.push([height, segment.radius(height)]);
        }
    }
    outline.dedup();
    revolved(&outline, FACETS)
}

/// The unit sphere with 40 meridians and 17 bands: 1,280 triangles with shared vertices.
pub(crate) fn sphere() -> Mesh {
    let outline: Vec<[f64; 2]> = (0..=17)
        .map(|band| {
            let height = -(PI * f64::from(band) / 17.0).cos();
            [height, (1.0 - height * height).sqrt()]
        })
        .collect();
    revolved(&outline, 40).welded()
}

/// The outline, heights and radii from below, around z, closed at both ends.
fn revolved(outline: &[[f64; 2]], facets: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let (Some(&[bottom, _]), Some(&[top, _])) = (outline.first(), outline.last()) else { return mesh };
    mesh.vertices.push(DVec3::new(0.0, 0.0, bottom));
    for &[height, radius] in outline {
        mesh.vertices.extend((0..facets).map(|facet| {
            let angle = TAU * facet as f64 / facets as f64;
            DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
        }));
    }
    let end = mesh.vertices.len() as u32;
    mesh.vertices.push(DVec3::new(0.0, 0.0, top));
    let corner = |ring: usize, facet: usize| (1 + ring * facets + facet % facets) as u32;
    let last = outline.len() - 1;
    for facet in 0..facets {
        mesh.triangles.push([0, corner(0, facet + 1), corner(0, facet)]);
        mesh.triangles.push([end, corner(last, facet), corner(last, facet + 1)]);
        for ring in 0..last {
            let [a, b] = [corner(ring, facet), corner(ring, facet + 1)];
            let [c, d] = [corner(ring + 1, facet), corner(ring + 1, facet + 1)];
            mesh.triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    // A ring without a radius gives triangles without an area.
    let vertices = &mesh.vertices;
    mesh.triangles.retain(|t| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        (b - a).cross(c - a).length_squared() > 0.0
    });
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_has_the_tools_volume_and_faces_outwards() {
        let tool = Tool::paper();
        let mesh = tool_mesh(&tool);
        // A polygon of 48 corners has 0.3 % less area than its circle, arcs in 12 pieces lose a little more.
        let volume = mesh.signed_volume();
        assert!(volume < tool.volume() && volume > 0.995 * tool.volume(), "{volume}");
        let (low, high) = mesh.bounds().unwrap();
        assert!((low.z.abs() < 1e-9) && (high.z - tool.length()).abs() < 1e-9);
    }

    #[test]
    fn the_sphere_is_closed_round_and_faces_outwards() {
        let mesh = sphere();
        assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (1280, 642));
        assert!((mesh.signed_volume() / (4.0 / 3.0 * PI) - 1.0).abs() < 0.02);
    }
}
