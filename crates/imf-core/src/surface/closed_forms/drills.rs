//! Tools that cut along their axis alone: what they machine is a hole of their own.

use super::*;
use crate::parts::shell::{Axis, Facing, Shell, rectangle};

fn height_of_point(radius: f64) -> f64 {
    radius / 59.0_f64.to_radians().tan()
}

/// Two lips of 118 degrees on a radius, 30 long, and a holder far above.
fn drill(radius: f64) -> Tool {
    let point = height_of_point(radius);
    let outline = vec![line(0.0, point, 0.0, radius), line(point, 30.0, radius, radius)];
    Tool { plunge_only: true, ..tool(outline, radius) }
}

/// A block of 40 × 30 × 20 with a blind hole from above, whose cone has its tip at this height.
fn drilled(centre: DVec2, radius: f64, tip: f64) -> Mesh {
    let rim = tip + height_of_point(radius);
    let (outer, hole) = (rectangle([0.0, 40.0], [0.0, 30.0]), circle(centre, radius, 48));
    let mut shell = Shell::default();
    shell.post(Axis::Z, &outer, [0.0, 20.0]);
    shell.face(Axis::Z, 0.0, Facing::Down, &outer, &[]);
    shell.face(Axis::Z, 20.0, Facing::Up, &outer, &[&hole]);
    shell.hole(Axis::Z, &hole, [rim, 20.0]);
    shell.band(&Axis::Z.place(&hole, rim), &vec![centre.extend(tip); hole.len()]);
    shell.into_mesh()
}

#[test]
fn a_drill_machines_the_wall_of_its_hole_and_nothing_else() {
    let centre = DVec2::new(15.0, 12.0);
    let wall =
        |s: &SurfaceSample| (s.point.truncate() - centre).length() < 4.3 && is_wall(s) && s.point.z < 20.0;
    for pitch in PITCHES {
        let through = pocketed(DVec3::new(40.0, 30.0, 20.0), &circle(centre, 4.0, 48), 20.0);
        let part = Part::new(&through, pitch);
        let found = part.found(&drill(4.0), AXES);
        assert!(found.reached(wall) > 0.99 - 0.03 * pitch, "{pitch}: {}", found.reached(wall));
        assert_eq!(found.reached(|s| !wall(s)), 0.0, "{pitch}");
        // As a mill it would reach the block's sides.
        let mill = Tool { plunge_only: false, ..drill(4.0) };
        assert!(part.found(&mill, AXES).reached(|s| !wall(s)) > 0.5, "{pitch}");
        // Of another radius, as far as voxels tell them apart, it machines nothing.
        let thinner = part.found(&drill(3.0), AXES).reached(|_| true);
        assert!(thinner == 0.0 || pitch > 1.0, "{pitch}: {thinner}");
    }
    // Blind, with the drill's own point as its floor.
    let floor =
        |s: &SurfaceSample| (s.point.truncate() - centre).length() < 3.9 && (0.5..19.5).contains(&s.point.z);
    for pitch in PITCHES {
        let part = Part::new(&drilled(centre, 4.0, 6.0), pitch);
        let found = part.found(&drill(4.0), DOWN);
        assert!(found.reached(floor) > 0.99 - 0.03 * pitch, "{pitch}: {}", found.reached(floor));
    }
    // Tilted with the hole, it reaches the floor, and no flat face: nothing at all from straight above.
    for (pitch, degrees) in [(1.0, 10.0), (1.0, 27.0), (0.5, 20.0), (0.25, 29.0)] {
        let place = glam::DMat4::from_rotation_y(f64::to_radians(degrees));
        let part = Part::new(&drilled(centre, 4.0, 6.0).transformed(&place), pitch);
        let within = |s: &SurfaceSample| {
            let point = place.inverse().transform_point3(s.point);
            floor(&SurfaceSample { point, ..*s })
        };
        let found = part.found(&drill(4.0), &format!("0,{degrees}"));
        assert!(found.reached(within) > 0.99 - 0.03 * pitch, "{pitch}: {}", found.reached(within));
        let on_face = |s: &SurfaceSample| s.normal.dot(place.z_axis.truncate()).abs() > 0.9;
        assert_eq!(found.reached(on_face), 0.0, "{pitch} {degrees}");
        for tool in [drill(4.0), Tool { plunge_only: true, ..ball(4.0) }] {
            let found = part.found(&tool, DOWN);
            assert_eq!(found.reached(on_face), 0.0, "{pitch} {degrees}");
            // The wall of the hole within a voxel of its mouth.
            assert!(found.reached(|_| true) < 0.005, "{pitch} {degrees}");
        }
    }
    // In a slot as wide as the drill the wall stands on two sides alone.
    let slot = rounded_rectangle(DVec2::new(8.0, 8.0), DVec2::new(32.0, 16.0), 4.0, 12);
    for pitch in [1.0, 0.5] {
        let part = Part::new(&pocketed(DVec3::new(40.0, 30.0, 20.0), &slot, 20.0), pitch);
        assert_eq!(part.found(&drill(4.0), AXES).reached(|_| true), 0.0, "{pitch}");
    }
}
