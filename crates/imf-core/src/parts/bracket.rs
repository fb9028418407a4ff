//! The bracket, which a topology optimisation left of a box, and the box.
//!
//! The box has what is given: four holes for bolts with counterbores, through which the bolts' heads are reached from
//! above, and a bore for a pin along x. Around the bolts, under their heads, and around both ends of the pin the
//! material stays; between, the optimisation of the example `simp` of `imf-bench` leaves 15 % of the box: the
//! material that carries pulls of the pin along x, y and z to the bolts. Its surface is stored (`bracket.obj`), and so the
//! same on every machine.
//!
//! Sizes are in millimetres.

use glam::DVec2;

use super::shell::{Axis, Facing, Shell, circle, rectangle};
use crate::mesh::Mesh;
use crate::mesh::read::MeshFile;

/// Extents of both shapes.
pub const SIZE: [f64; 3] = [49.0, 147.0, 87.0];

/// The bolts' axes: every x with every y.
pub const BOLTS: [[f64; 2]; 2] = [[12.5, 36.5], [13.0, 134.0]];
/// Of the bolts' holes.
pub const BOLT_RADIUS: f64 = 5.5;
/// The bolts' heads sink into counterbores down to this height.
pub const COUNTERBORE_FLOOR: f64 = 7.0;
/// Of the counterbores.
pub const COUNTERBORE_RADIUS: f64 = 9.0;
/// Around a bolt the material stays up to this radius.
pub const SEAT_RADIUS: f64 = 14.0;
/// Around a bolt the material stays up to this height.
pub const SEAT_HEIGHT: f64 = 10.0;

/// Centre (y, z) of the pin bore.
pub const PIN: DVec2 = DVec2::new(73.5, 71.0);
/// Of the pin bore.
pub const PIN_RADIUS: f64 = 11.0;
/// Around the pin the material stays up to this radius.
pub const LUG_RADIUS: f64 = 17.0;
/// How far from both ends of the pin bore the material around it stays.
pub const LUG: f64 = 13.0;

/// Segments to a full circle: at the largest radius, 11 mm, chords stay within 0.03 mm of the arc.
const CIRCLE: usize = 48;

/// The surface that the example `simp` of `imf-bench` made.
const STORED: &[u8] = include_bytes!("bracket.obj");

/// The bracket: closed, one piece, facing outwards.
///
/// # Panics
/// Never: the file is part of the program, and the tests read it.
#[must_use]
pub(super) fn mesh() -> Mesh {
    MeshFile::from_bytes(STORED, "bracket.obj").expect("the stored bracket is a mesh").mesh
}

/// The bracket's design domain: closed, one shell, facing outwards.
#[must_use]
pub(super) fn design_domain() -> Mesh {
    let mut shell = Shell::default();
    let [x, y, z] = SIZE.map(|size| [0.0, size]);
    let (bolts, heads, pin) =
        (bolts(BOLT_RADIUS), bolts(COUNTERBORE_RADIUS), circle(PIN, PIN_RADIUS, CIRCLE));
    shell.face(Axis::Z, z[0], Facing::Down, &rectangle(x, y), &slices(&bolts));
    shell.face(Axis::Z, z[1], Facing::Up, &rectangle(x, y), &slices(&heads));
    shell.face(Axis::Y, y[0], Facing::Down, &rectangle(z, x), &[]);
    shell.face(Axis::Y, y[1], Facing::Up, &rectangle(z, x), &[]);
    shell.face(Axis::X, x[0], Facing::Down, &rectangle(y, z), &[&pin]);
    shell.face(Axis::X, x[1], Facing::Up, &rectangle(y, z), &[&pin]);
    shell.hole(Axis::X, &pin, x);
    for (bolt, head) in bolts.iter().zip(&heads) {
        shell.hole(Axis::Z, bolt, [z[0], COUNTERBORE_FLOOR]);
        shell.face(Axis::Z, COUNTERBORE_FLOOR, Facing::Up, head, &[bolt]);
        shell.hole(Axis::Z, head, [COUNTERBORE_FLOOR, z[1]]);
    }
    shell.into_mesh()
}

fn bolts(radius: f64) -> Vec<Vec<DVec2>> {
    let [xs, ys] = BOLTS;
    ys.iter().flat_map(|&y| xs.map(|x| circle(DVec2::new(x, y), radius, CIRCLE))).collect()
}

fn slices(loops: &[Vec<DVec2>]) -> Vec<&[DVec2]> {
    loops.iter().map(Vec::as_slice).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::topology::MeshReport;
    use crate::parts::shell::area;
    use crate::voxelize::winding_number;

    #[test]
    fn extents_are_exact() {
        for mesh in [mesh(), design_domain()] {
            let (lower, upper) = mesh.bounds().unwrap();
            assert!(lower.abs().max_element() < 1e-12, "{lower}");
            assert!((upper - DVec3::from_array(SIZE)).abs().max_element() < 1e-12, "{upper}");
        }
    }

    #[test]
    fn the_stored_surface_is_the_one_that_was_made() {
        assert_eq!(
            crc32fast::hash(STORED),
            0x7749_ea2a,
            "bracket.obj changed: make the figures that name it again"
        );
        let report = MeshReport::new(&mesh());
        assert!(report.closed && report.signed_volume > 0.0, "{report:?}");
        assert_eq!((report.components, report.degenerate_triangles), (1, 0));
    }

    #[test]
    fn the_bracket_has_the_intended_fraction_of_its_domain() {
        let fraction = mesh().signed_volume() / design_domain().signed_volume();
        // So much of the elements; the surface cuts edges off and rounds.
        assert!((fraction - 0.15).abs() < 0.02, "{fraction}");
    }

    #[test]
    fn the_design_domains_volume_is_the_sum_of_areas_times_heights() {
        let areas = |loops: &[Vec<DVec2>]| loops.iter().map(|l| area(l)).sum::<f64>();
        let expected = SIZE.iter().product::<f64>()
            - COUNTERBORE_FLOOR * areas(&bolts(BOLT_RADIUS))
            - (SIZE[2] - COUNTERBORE_FLOOR) * areas(&bolts(COUNTERBORE_RADIUS))
            - SIZE[0] * area(&circle(PIN, PIN_RADIUS, CIRCLE));
        let volume = design_domain().signed_volume();
        assert!((volume - expected).abs() < 1e-9 * expected, "{volume} against {expected}");
    }

    /// Points around an axis, at a distance from a circle about it.
    fn around(centre: DVec2, radius: f64) -> impl Iterator<Item = DVec2> {
        (0..12).map(move |i| centre + radius * DVec2::from_angle(0.1 + f64::from(i) * 30f64.to_radians()))
    }

    #[test]
    fn bores_are_open_and_ringed() {
        let mesh = mesh();
        let solid = |p: DVec3| winding_number(&mesh, p) > 0.5;
        for bolt in BOLTS[0].into_iter().flat_map(|x| BOLTS[1].map(|y| DVec2::new(x, y))) {
            for (radius, height, is_solid) in [
                (BOLT_RADIUS - 0.5, 3.5, false),
                (BOLT_RADIUS + 0.5, 3.5, true),
                (COUNTERBORE_RADIUS - 0.5, 8.5, false),
                (COUNTERBORE_RADIUS + 0.5, 8.5, true),
                (COUNTERBORE_RADIUS - 0.5, 40.0, false),
            ] {
                for p in around(bolt, radius) {
                    assert_eq!(solid(p.extend(height)), is_solid, "{p} at {height}");
                }
            }
        }
        for x in [3.0, SIZE[0] - 3.0] {
            for (radius, is_solid) in [(PIN_RADIUS - 0.5, false), (PIN_RADIUS + 0.5, true)] {
                for p in around(PIN, radius) {
                    assert_eq!(solid(DVec3::new(x, p.x, p.y)), is_solid, "{p} at {x}");
                }
            }
        }
        assert!(around(PIN, PIN_RADIUS - 0.5).all(|p| !solid(DVec3::new(SIZE[0] / 2.0, p.x, p.y))));
    }

    #[test]
    fn it_is_its_own_mirror_image_across_x_and_y() {
        let mesh = mesh();
        let known: std::collections::HashSet<[i64; 3]> =
            mesh.vertices.iter().map(|p| (*p * 1000.0).round().as_i64vec3().to_array()).collect();
        for p in &mesh.vertices {
            let [x, y, z] = (*p * 1000.0).round().as_i64vec3().to_array();
            for mirrored in [[49_000 - x, y, z], [x, 147_000 - y, z]] {
                // Each half is rounded for itself.
                let near =
                    (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| [a, b, c])));
                let found = near
                    .into_iter()
                    .any(|d| known.contains(&[mirrored[0] + d[0], mirrored[1] + d[1], mirrored[2] + d[2]]));
                assert!(found, "{p} has no image");
            }
        }
    }
}
