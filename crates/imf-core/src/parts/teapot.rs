//! The teapot: Newell's patches, evenly cut into triangles and laid into the paper's frame.
//!
//! The paper's grid is height × depth × length, the y, z, x of the usual OBJ file. From Newell's frame this is
//! the half turn (x, y, z) → (z, −y, x), no mirror, and the height of 58 mm fixes the pitch.
//!
//! The surface is open, as Newell left it: between lid and rim (two circles of 4·[`SEGMENTS`] edges), at both ends
//! of the handle and at both ends of the spout, whose lip turns inwards and stops (four loops of 2·[`SEGMENTS`]
//! edges). The generalised winding number fills it.

use glam::DVec3;

use super::shell::Shell;
use super::teapot_patches::{HEIGHT, Patch, patches};
use crate::mesh::Mesh;

/// Segments to a patch's edge. At sixteen the triangles stay within 0.11 mm of the surface, a ninth of the pitch
/// (measured from the vertices of 48 segments; worst at the root of the spout); at twelve it is 0.21 mm.
pub(super) const SEGMENTS: usize = 16;

/// Height of the teapot along x, in millimetres: the grid's 58 voxels.
pub(super) const HEIGHT_MM: f64 = 58.0;

/// The teapot in millimetres, standing on x = 0 with its axis at y = z = 0 and its spout towards +z.
pub(super) fn mesh() -> Mesh {
    let mut shell = Shell::default();
    for patch in patches() {
        tessellate(&mut shell, &patch);
    }
    shell.into_mesh()
}

/// Adds a patch as a grid of quadrilaterals.
fn tessellate(shell: &mut Shell, patch: &Patch) {
    let parameter = |i: usize| i as f64 / SEGMENTS as f64;
    let rows: Vec<Vec<DVec3>> = (0..=SEGMENTS)
        .map(|i| {
            let [a, b, c, d] = patch.points;
            let across = [0, 1, 2, 3].map(|j| curve([a[j], b[j], c[j], d[j]], parameter(i)));
            (0..=SEGMENTS).map(|j| in_millimetres(curve(across, parameter(j)))).collect()
        })
        .collect();
    for pair in rows.windows(2) {
        let [above, below] = [&pair[0], &pair[1]];
        if patch.outward { shell.strip(above, below) } else { shell.strip(below, above) }
    }
}

/// The point of a cubic Bézier curve by de Casteljau's construction.
fn curve([a, b, c, d]: [DVec3; 4], t: f64) -> DVec3 {
    let [ab, bc, cd] = [between(a, b, t), between(b, c, t), between(c, d, t)];
    between(between(ab, bc, t), between(bc, cd, t), t)
}

/// Linear interpolation that is exact at both ends and where the ends are equal: patches with a common edge then
/// have exactly equal points on it, and the poles are single points.
fn between(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    if t <= 0.5 { a + (b - a) * t } else { b + (a - b) * (1.0 - t) }
}

fn in_millimetres(newell: DVec3) -> DVec3 {
    DVec3::new(newell.z, -newell.y, newell.x) * (HEIGHT_MM / HEIGHT)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::parts::tests::open_edges;
    use crate::voxelize::winding_number;

    #[test]
    fn extents_are_newells() {
        let (lower, upper) = mesh().bounds().unwrap();
        let unit = HEIGHT_MM / HEIGHT;
        assert!((upper - lower - DVec3::new(3.15, 4.0, 6.434) * unit).abs().max_element() < 0.01 * unit);
        assert!((lower.x.abs()).max((upper.x - HEIGHT_MM).abs()) < 1e-12);
    }

    #[test]
    fn only_newells_openings_are_open() {
        let mesh = mesh();
        // Every patch gives two triangles a square, less one a segment on the eight edges that are poles.
        assert_eq!(mesh.triangles.len(), 32 * 2 * SEGMENTS * SEGMENTS - 8 * SEGMENTS);
        assert_eq!(open_edges(&mesh), 16 * SEGMENTS);
    }

    #[test]
    fn it_is_exactly_symmetric_about_its_plane() {
        let bits = |p: DVec3| (p + 0.0).to_array().map(f64::to_bits);
        let mesh = mesh();
        let positions: HashSet<_> = mesh.vertices.iter().map(|&p| bits(p)).collect();
        let mirror = DVec3::new(1.0, -1.0, 1.0);
        assert!(mesh.vertices.iter().all(|&p| positions.contains(&bits(p * mirror))));
    }

    #[test]
    fn every_piece_faces_outwards() {
        let mesh = mesh();
        let unit = HEIGHT_MM / HEIGHT;
        let at = |x: f64, z: f64| winding_number(&mesh, DVec3::new(z, 0.02, x) * unit);
        let body = [("belly", 0.0, 1.0), ("foot", 1.2, 0.1), ("knob", 0.0, 3.05), ("lid", 0.9, 2.46)];
        let tubes = [("grip", -2.83, 1.8), ("upper grip", -2.2, 2.13), ("spout", 2.5, 1.7)];
        for (name, x, z) in body.into_iter().chain(tubes) {
            assert!(at(x, z) > 0.5, "{name}: {}", at(x, z));
        }
        for (name, x, z) in
            [("eye of the handle", -2.3, 1.6), ("beside the knob", 0.7, 2.9), ("air", 2.9, 1.2)]
        {
            assert!(at(x, z).abs() < 0.5, "{name}: {}", at(x, z));
        }
    }

    #[test]
    fn the_volume_is_a_teapots() {
        // Below the rim the body lies between the cylinders of its smallest and largest radius; lid, handle and
        // spout add less than a fifth.
        let unit = HEIGHT_MM / HEIGHT;
        let volume = mesh().signed_volume() / unit.powi(3);
        let cylinder = |radius: f64| std::f64::consts::PI * radius * radius * 2.4;
        assert!(volume > cylinder(1.5) && volume < 1.2 * cylinder(2.0), "{volume}");
    }
}
