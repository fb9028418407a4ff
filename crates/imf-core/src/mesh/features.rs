//! Directions that a part itself suggests for its machining: normals of its large flat faces, axes of its cylinders.

use std::collections::HashMap;

use glam::DVec3;

use serde::Serialize;

use super::Mesh;
use super::groups::Groups;
use super::topology::{neighbours, sorted_edges};

/// Directions at less than this angle, in radians, are one: five hundredths of a millimetre at the end of 100 mm.
pub(crate) const SAME: f64 = 5e-4;
/// Minimum fraction of the surface for a face or cylinder to count.
const SHARE: f64 = 0.005;
/// Neighbours at less than this angle (its sine) lie in one plane, and at less than the other on one curved surface.
const COPLANAR: f64 = 2e-3;
const SMOOTH: f64 = 0.5;
/// At least this number of planes of about the same size on one curved surface are its facets.
const FACETS: usize = 8;
/// A normal this near to square to an axis belongs to its cylinder.
const SQUARE: f64 = 0.02;

/// A direction that a part suggests, and what suggests it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MachiningDirection {
    /// Unit vector from tip to holder.
    pub direction: DVec3,
    /// Area of the large flat faces whose outward normal it is, in the mesh's unit squared; 0 of none.
    pub flat_area: f64,
    /// Cylindrical surfaces whose axis it is.
    pub cylinders: usize,
}

impl Mesh {
    /// The outward normals of large flat faces, the largest first, then both ways along the axes of large
    /// cylindrical surfaces (holes, bosses, rounded walls); none twice. For a mesh whose triangles share vertices, as
    /// mesh files are read.
    #[must_use]
    pub fn machining_directions(&self) -> Vec<MachiningDirection> {
        let outward = if self.signed_volume() < 0.0 { -0.5 } else { 0.5 };
        let vectors = self.all_corners().map(|[a, b, c]| (b - a).cross(c - a) * outward);
        let vectors: Vec<DVec3> = vectors.collect();
        let enough = SHARE * vectors.iter().map(|v| v.length()).sum::<f64>();
        let mut flat = Groups::new(self.triangles.len());
        let mut curved = Groups::new(self.triangles.len());
        for (a, b, _) in neighbours(&sorted_edges(self)) {
            let (na, nb) = (vectors[a].normalize_or_zero(), vectors[b].normalize_or_zero());
            let sine = na.cross(nb).length();
            if na.dot(nb) > 0.0 && sine < SMOOTH {
                curved.join(a, b);
                if sine < COPLANAR {
                    flat.join(a, b);
                }
            }
        }
        // Area and normal of each plane, by the curved surface that it is part of.
        let mut planes: HashMap<usize, Vec<(f64, DVec3)>> = HashMap::new();
        for members in flat.members() {
            let sum: DVec3 = members.iter().map(|&t| vectors[t]).sum();
            planes.entry(curved.root(members[0])).or_default().push((sum.length(), sum.normalize_or_zero()));
        }
        let facet = |area: f64, all: &[(f64, DVec3)]| {
            all.iter().filter(|(other, _)| *other > 0.5 * area).count() >= FACETS
        };
        // Few are large enough, however many facets a curved surface has.
        let is_face = |area: f64, all: &[(f64, DVec3)]| area >= enough && area > 0.0 && !facet(area, all);
        let faces = planes.values().flat_map(|all| all.iter().filter(|(area, _)| is_face(*area, all)));
        let mut found: Vec<MachiningDirection> = Vec::new();
        let mut note = |direction: DVec3, flat_area: f64, cylinders: usize| {
            let same = |known: &&mut MachiningDirection| known.direction.distance(direction) < SAME;
            match found.iter_mut().find(same) {
                Some(known) => {
                    known.flat_area += flat_area;
                    known.cylinders += cylinders;
                }
                None => found.push(MachiningDirection { direction, flat_area, cylinders }),
            }
        };
        let place = |v: &DVec3| v.to_array().map(|c| (c * 1e6).round() as i64);
        let mut faces: Vec<(f64, DVec3)> = faces.copied().collect();
        faces.sort_by(|a, b| b.0.total_cmp(&a.0).then(place(&b.1).cmp(&place(&a.1))));
        faces.into_iter().for_each(|(area, normal)| note(normal, area, 0));
        let cylinders = curved.members().into_iter().filter_map(|members| axis(&members, &vectors, enough));
        cylinders.flat_map(|axis| [axis, -axis]).for_each(|axis| note(axis, 0.0, 1));
        // Faces of one normal are one face to a tool; the sort is stable, so that cylinders keep their order.
        found.sort_by(|a, b| b.flat_area.total_cmp(&a.flat_area));
        found
    }
}

/// The axis of a curved surface that is a cylinder, or any prism with round corners; `None` of others.
fn axis(members: &[usize], vectors: &[DVec3], enough: f64) -> Option<DVec3> {
    let area: f64 = members.iter().map(|&t| vectors[t].length()).sum();
    if area < enough {
        return None;
    }
    let largest =
        members.iter().copied().max_by(|&a, &b| vectors[a].length().total_cmp(&vectors[b].length()))?;
    let first = vectors[largest].try_normalize()?;
    let across = |&t: &usize| first.cross(vectors[t].normalize_or_zero());
    let axis = members.iter().map(across).max_by(|a, b| a.length().total_cmp(&b.length()))?;
    // A surface that hardly turns is a plane.
    let axis = (axis.length() > 0.1).then(|| axis.normalize())?;
    let square = members.iter().filter(|&&t| vectors[t].normalize_or_zero().dot(axis).abs() < SQUARE);
    let axis = axis.map(|v| if v.abs() < 1e-9 { 0.0 } else { v });
    (square.map(|&t| vectors[t].length()).sum::<f64>() > 0.98 * area).then(|| axis.normalize())
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec2};

    use super::*;
    use crate::parts::shell::{Axis, Facing, Shell, circle};

    /// A block of 20 × 30 × 10 with a through hole of 8 along z.
    fn drilled() -> Mesh {
        let outer = [DVec2::ZERO, DVec2::new(20.0, 0.0), DVec2::new(20.0, 30.0), DVec2::new(0.0, 30.0)];
        let hole = circle(DVec2::new(10.0, 15.0), 4.0, 48);
        let mut shell = Shell::default();
        shell.post(Axis::Z, &outer, [0.0, 10.0]);
        shell.hole(Axis::Z, &hole, [0.0, 10.0]);
        shell.face(Axis::Z, 0.0, Facing::Down, &outer, &[&hole]);
        shell.face(Axis::Z, 10.0, Facing::Up, &outer, &[&hole]);
        shell.into_mesh()
    }

    #[test]
    fn a_tilted_blocks_faces_and_its_holes_axis_are_found() {
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
        let mut mesh = drilled();
        mesh.vertices.iter_mut().for_each(|v| *v = turn * *v);
        let suggested = mesh.machining_directions();
        let found: Vec<DVec3> = suggested.iter().map(|s| s.direction).collect();
        let expected = [DVec3::Z, DVec3::X, DVec3::Y].map(|d| turn * d);
        assert_eq!(found.len(), 6, "{found:?}");
        for direction in expected.iter().flat_map(|&d| [d, -d]) {
            assert!(found.iter().any(|f| f.dot(direction) > 1.0 - 1e-9), "{direction} {found:?}");
        }
        // The top is the largest, and its normal is the hole's axis.
        assert!(found[0].dot(expected[0]).abs() > 1.0 - 1e-9);
        let top = 20.0 * 30.0 - 0.5 * 48.0 * 16.0 * (std::f64::consts::TAU / 48.0).sin();
        assert!((suggested[0].flat_area - top).abs() < 1e-9, "{suggested:?}");
        assert_eq!(suggested.iter().map(|s| s.cylinders).collect::<Vec<_>>(), [1, 1, 0, 0, 0, 0]);
    }

    #[test]
    fn a_cylinder_has_its_axis_and_its_ends_and_a_ball_has_none() {
        let outline = circle(DVec2::ZERO, 5.0, 64);
        let mut shell = Shell::default();
        shell.post(Axis::Y, &outline, [0.0, 40.0]);
        shell.face(Axis::Y, 0.0, Facing::Down, &outline, &[]);
        shell.face(Axis::Y, 40.0, Facing::Up, &outline, &[]);
        let found = shell.into_mesh().machining_directions();
        assert!(found.iter().map(|f| f.direction).eq([DVec3::Y, DVec3::NEG_Y]), "{found:?}");
        assert!(found.iter().all(|f| f.cylinders == 1 && f.flat_area > 0.0), "{found:?}");
        let mut ball = Shell::default();
        let ring = |i: usize| {
            let (sine, cosine) = (std::f64::consts::PI * i as f64 / 60.0).sin_cos();
            Axis::Z.place(&circle(DVec2::ZERO, sine, 120), -cosine)
        };
        (1..=60).for_each(|i| ball.band(&ring(i - 1), &ring(i)));
        assert_eq!(ball.into_mesh().machining_directions(), []);
    }
}
