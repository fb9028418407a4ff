//! Parts of several bodies: what lies between them is not a surface, whichever way their triangles face.

use glam::DMat4;

use super::*;

/// Two blocks of 20 × 20 × 20 side by side along x, in one mesh with common corners.
fn side_by_side(inverted: bool, mirrored: bool) -> Mesh {
    let one = Mesh::cuboid(DVec3::ZERO, DVec3::splat(20.0));
    let other = if mirrored {
        // A mirror turns every triangle over.
        let across = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        one.transformed(&(DMat4::from_translation(DVec3::X * 40.0) * across))
    } else {
        one.transformed(&DMat4::from_translation(DVec3::X * 20.0))
    };
    let mut other = other;
    if (other.signed_volume() < 0.0) != inverted {
        other.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    let mut both = one;
    both.append(&other);
    both.welded()
}

#[test]
fn the_common_face_of_two_bodies_is_no_surface() {
    for (inverted, mirrored) in [(false, false), (false, true), (true, false), (true, true)] {
        let (mesh, _) = side_by_side(inverted, mirrored).with_consistent_faces();
        let part = Part::new(&mesh, 1.0);
        let area: f64 = part.samples.iter().map(|sample| sample.area).sum();
        // 2 · 40 · 20 + 2 · 40 · 20 + 2 · 20 · 20
        assert!((area - 4000.0).abs() < 1e-6, "{inverted} {mirrored}: {area}");
        for sample in &part.samples {
            let outside = (sample.point - DVec3::new(20.0, 10.0, 10.0)) / DVec3::new(20.0, 10.0, 10.0);
            assert!(sample.normal.dot(outside) > 0.99, "{inverted} {mirrored}: {sample:?}");
        }
        assert_eq!(part.found(&flat(3.0), "axes").reached(|_| true), 1.0, "{inverted} {mirrored}");
    }
}

#[test]
fn a_sheet_on_a_body_covers_it_though_it_is_thinner_than_a_voxel() {
    let mut mesh = Mesh::cuboid(DVec3::ZERO, DVec3::splat(20.0));
    mesh.append(&Mesh::cuboid(DVec3::Z * 20.0, DVec3::new(20.0, 20.0, 20.4)));
    let part = Part::new(&mesh.welded(), 1.0);
    let area: f64 = part.samples.iter().map(|sample| sample.area).sum();
    assert!((area - (2.0 * 400.0 + 4.0 * 20.0 * 20.4)).abs() < 1e-6, "{area}");
}
