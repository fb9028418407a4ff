//! Random poses of a tool between scattered voxels, against a check that tries every centre and walks along every outline.

use glam::DVec3;

use super::tests::{check_text, pose_lines};
use super::*;
use crate::field::ExactField;
use crate::grid::Grid;
use crate::mesh::tests::unit_cube;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::section::test_shapes::{arc, holds, line, orientations, revolved, walk};
use crate::tool::{ElementKind, ToolShape};

/// A slab with a groove, thin walls on it, and loose voxels.
fn part() -> Occupancy {
    let grid = Grid { origin: DVec3::new(1.0, -2.0, 0.5), pitch: 0.7, dims: [26, 24, 22] };
    Occupancy::of(grid, |[x, y, z]| {
        let slab = z < 7 && !(9..14).contains(&x);
        let wall = (15..17).contains(&y) && z < 13;
        let loose = z > 14 && grid.index([x, y, z]).wrapping_mul(2_654_435_761) >> 9 & 63 == 0;
        slab || wall || loose
    })
}

fn tool() -> Tool {
    revolved([
        (ElementKind::Cutter, vec![arc(0.0, 1.0, 1.0, 0.8, 1.0), line(1.0, 5.0, 1.8, 2.2)]),
        (ElementKind::Shank, vec![line(5.0, 8.0, 1.5, 1.5)]),
        (ElementKind::Holder(0), vec![line(8.0, 12.0, 4.0, 3.0)]),
    ])
}

/// From every solid centre to the nearest empty one, less half a pitch.
fn below_surface(part: &Occupancy) -> Vec<f64> {
    let grid = &part.grid;
    let empty: Vec<DVec3> = (0..grid.len())
        .filter(|&i| part.solid[i] == 0)
        .map(|i| DVec3::from_array(grid.voxel(i).map(|v| v as f64)))
        .collect();
    (0..grid.len())
        .map(|index| {
            let voxel = grid.voxel(index);
            let at = DVec3::from_array(voxel.map(|v| v as f64));
            let face = (0..3)
                .map(|a| (voxel[a] + 1).min(grid.dims[a] - voxel[a]) as f64)
                .fold(f64::INFINITY, f64::min);
            let nearest = empty.iter().map(|e| e.distance(at)).fold(face, f64::min);
            (nearest - 0.5) * grid.pitch
        })
        .collect()
}

#[test]
fn elements_and_depths_are_those_of_trying_every_centre() {
    let (part, tool) = (part(), tool());
    let grid = part.grid;
    let (bodies, below) = (CheckBodies::of_part(&part), below_surface(&part));
    let ToolShape::Revolved(elements) = &tool.shape else { panic!() };
    let settings = CheckSettings { contact: 0.3, ..CheckSettings::of_pitch(grid.pitch, LengthUnit::Mm) };
    let (mut hits, mut spared) = ([0; 3], 0);
    for (index, orientation) in orientations("random:60:9").iter().enumerate() {
        let place = |step: f64| (index as f64 * step).fract() * 1.2 - 0.1;
        let tip = grid.origin + grid.size() * DVec3::new(place(0.618), place(0.755), place(0.57));
        let axis = orientation.direction();
        let report = check_text(bodies, &tool, &pose_lines(&[(tip, axis)]), &settings).unwrap();
        let found = report.colliding.first().map_or(&[][..], |line| &line.collisions);
        for (which, element) in elements.iter().enumerate() {
            let (mut voxels, mut nearly, mut touched, mut deepest, mut depth) = (0, 0, 0, 0.0_f64, 0.0_f64);
            for voxel in part.solids() {
                let offset = grid.centre(grid.voxel(voxel)) - tip;
                let height = offset.dot(axis);
                let radius = (offset - axis * height).length();
                if holds(&element.profile, height, radius) {
                    // The cutter narrows to the shank, and so has a shoulder of its own.
                    let own = walk(&element.profile, true, height, radius);
                    deepest = deepest.max(own);
                    if own <= settings.contact - 0.01 {
                        touched += 1;
                        continue;
                    }
                    nearly += u32::from(own <= settings.contact + 0.01);
                    voxels += 1;
                    depth = depth.max(own + below[voxel]);
                }
            }
            let name = element.kind.to_string();
            let collision = found.iter().find(|c| c.element == name);
            // The walk is right to a hundredth.
            if (deepest - settings.contact).abs() < 0.01 {
                continue;
            }
            let expected = deepest > settings.contact;
            assert_eq!(collision.is_some(), expected, "{name} {tip} {axis} {voxels} {deepest}");
            spared += usize::from(touched > 0 && !expected);
            if let Some(collision) = collision {
                hits[which] += 1;
                assert!((voxels - nearly..=voxels).contains(&collision.voxels), "{name} {tip} {axis}");
                assert!((collision.depth - depth).abs() < 0.01, "{name} {depth} {collision:?}");
            }
        }
    }
    assert!(hits.iter().all(|&n| n > 8) && spared > 0, "{hits:?} {spared}");
}

#[test]
fn no_shorter_translation_parts_tool_and_part_where_the_part_is_one_piece() {
    // A block with room around it; depths are known to half a pitch.
    let grid = Grid { origin: DVec3::ZERO, pitch: 0.5, dims: [40; 3] };
    let part = Occupancy::of(grid, |voxel| voxel.iter().all(|v| (10..30).contains(v)));
    let (bodies, tool) = (CheckBodies::of_part(&part), tool());
    let exact = ExactField::new(&part, &tool).unwrap();
    let ways = orientations("fibonacci:60");
    let strict = CheckSettings { contact: 0.0, ..CheckSettings::of_pitch(0.5, LengthUnit::Mm) };
    for (index, orientation) in orientations("random:40:2").iter().enumerate() {
        let place = |step: f64| (index as f64 * step).fract();
        let tip = grid.size() * DVec3::new(place(0.618), place(0.755), place(0.57));
        let axis = orientation.direction();
        let report = check_text(bodies, &tool, &pose_lines(&[(tip, axis)]), &strict).unwrap();
        let Some((_, worst)) = report.worst().first().copied() else { continue };
        for way in &ways {
            let moved = tip + way.direction() * (worst.depth - 0.5 * grid.pitch - 0.87 * grid.pitch).max(0.0);
            assert!(exact.collides(&Pose::along(moved, axis)), "{worst:?}");
        }
    }
}

/// A bar to one side of its axis.
fn angled_head() -> Tool {
    let place = glam::DMat4::from_translation(DVec3::new(-0.6, -0.7, -0.2));
    let mesh = unit_cube().transformed(&(place * glam::DMat4::from_scale(DVec3::new(7.0, 1.4, 4.0))));
    Tool { shape: ToolShape::Mesh(mesh), name: "head".into(), ..Tool::paper() }
}

#[test]
fn rolls_count_for_tools_that_are_not_round_as_in_the_exact_field() {
    let (part, tool) = (part(), angled_head());
    let exact = ExactField::new(&part, &tool).unwrap();
    let settings = CheckSettings::of_pitch(part.grid.pitch, LengthUnit::Mm);
    let run = |text: &str| check_text(CheckBodies::of_part(&part), &tool, text, &settings);
    let mut counts = Vec::new();
    for (axis, theta, phi) in [("0,0,1", 0.0, 0.0), ("0,1,0", 90.0, 90.0), ("-1,0,1", 180.0, 45.0)] {
        for roll in [0.0, 90.0, 180.0, 270.0] {
            let pose = Pose::oriented(DVec3::new(9.3, 8.1, 6.2), &Orientation { theta, phi, roll });
            let expected = exact.count(&pose).unwrap();
            for text in [
                format!("x,y,z,i,j,k,roll\n9.3,8.1,6.2,{axis},{roll}\n"),
                format!("x,y,z,theta,phi,roll\n9.3,8.1,6.2,{theta},{phi},{roll}\n"),
            ] {
                let report = run(&text).unwrap();
                let found = report.worst().first().map_or(0, |(_, c)| c.voxels);
                assert_eq!(found, expected, "{text}");
            }
            counts.push(expected);
        }
    }
    assert!(counts[..4].iter().any(|c| *c != counts[0]), "{counts:?}");
    assert!(run("x,y,z\n9,8,6\n").unwrap_err().to_string().contains("line 2: the tool 'head' is not round"));
    let over = "x,y,z,roll\n9,8,30,0\n9,8,31,180\n";
    assert!(
        run(over).unwrap_err().to_string().contains("line 3: the tool rolls about its axis by half a turn")
    );
}

#[test]
fn a_motion_over_the_pole_does_not_turn_a_head_about_its_own_axis() {
    let tool = angled_head();
    let part = Occupancy::empty(Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] });
    let settings = CheckSettings { step: 0.01, ..CheckSettings::of_pitch(1.0, LengthUnit::Mm) };
    let run = |text: &str| check_text(CheckBodies::of_part(&part), &tool, text, &settings).unwrap().poses;
    // θ jumps from 180° to 0°; the roll that goes with it leaves the head as it is.
    let tilt = 0.04_f64 * tool.reach() / settings.step;
    let poses = run("x,y,z,i,j,k,roll\n0,0,9,-.02,0,1,180\n0,0,9,.02,0,1,0\n") as f64;
    assert!((poses - 1.0 - tilt).abs() < 0.02 * tilt + 1.0, "{poses} {tilt}");
    // Its farthest point from the axis goes along with a roll.
    let poses = run("x,y,z,roll\n0,0,9,0\n0,0,9,90\n") as f64;
    let around = std::f64::consts::FRAC_PI_2 * 6.4_f64.hypot(0.7) / settings.step;
    assert!((poses - 1.0 - around).abs() <= 1.0, "{poses} {around}");
}
