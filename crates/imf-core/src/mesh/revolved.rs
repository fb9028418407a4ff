//! Meshes of revolution.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Mesh;

impl Mesh {
    /// An outline (heights and radii from below) revolved about the z axis with `sides` flat faces (at least 3),
    /// closed at both ends; its triangles face outwards. Empty without an outline.
    #[must_use]
    pub fn revolved(outline: &[[f64; 2]], sides: usize) -> Self {
        let mut mesh = Self::default();
        let (Some(&[bottom, _]), Some(&[top, _])) = (outline.first(), outline.last()) else { return mesh };
        mesh.vertices.push(DVec3::new(0.0, 0.0, bottom));
        for &[height, radius] in outline {
            mesh.vertices.extend((0..sides).map(|side| {
                let angle = TAU * side as f64 / sides as f64;
                DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
            }));
        }
        let end = mesh.vertices.len() as u32;
        mesh.vertices.push(DVec3::new(0.0, 0.0, top));
        let corner = |ring: usize, side: usize| (1 + ring * sides + side % sides) as u32;
        let last = outline.len() - 1;
        for side in 0..sides {
            mesh.triangles.push([0, corner(0, side + 1), corner(0, side)]);
            mesh.triangles.push([end, corner(last, side), corner(last, side + 1)]);
            for ring in 0..last {
                let [a, b] = [corner(ring, side), corner(ring, side + 1)];
                let [c, d] = [corner(ring + 1, side), corner(ring + 1, side + 1)];
                mesh.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
        // A ring without a radius gives triangles without an area, and its vertices are one.
        let vertices = &mesh.vertices;
        mesh.triangles.retain(|t| {
            let [a, b, c] = t.map(|v| vertices[v as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        });
        mesh.welded()
    }
}
