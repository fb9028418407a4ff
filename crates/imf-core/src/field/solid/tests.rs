//! The fast paths against the definitions.

use std::sync::Arc;

use super::*;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::parts::ReferencePart;
use crate::scene::{Scene, SceneSpec};
use crate::section::test_shapes::{arc, archs, line, number, orientations, revolved};
use crate::tool::{Clearance, ElementKind, ToolShape, ToolVoxels};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// A part at half the paper's resolution; the tool is full-sized for half of them, to reach out of the grid.
pub(super) fn half(part: ReferencePart, tool: &Tool) -> Scene {
    let mesh = part.mesh();
    let spec = SceneSpec::of_reference(part, &mesh, part.dims().map(|n| n.div_ceil(2)), tool);
    spec.scene().unwrap()
}

pub(super) fn field_of(scene: &Scene) -> SolidField {
    SolidField::of_tool(Arc::new(scene.obstacle.clone()), &scene.record.tool)
}

/// Bull-nose cutter with a corner, tapered flank, shank, holder with a cone that narrows.
pub(crate) fn awkward() -> Tool {
    let elements = [
        (
            ElementKind::Cutter,
            vec![arc(0.0, 1.6, 2.0, 2.0, 2.0), line(1.6, 20.0, 3.959_591_794_226_542, 7.0)],
        ),
        (ElementKind::Shank, vec![line(20.0, 34.0, 3.0, 3.0)]),
        (ElementKind::Holder(0), vec![line(34.0, 44.0, 16.0, 9.0)]),
        (ElementKind::Holder(1), vec![line(44.0, 70.0, 2.0, 18.0)]),
    ];
    Tool { name: "awkward".into(), ..revolved(elements) }
}

/// A pose in the grid's box; some on voxel centres, some along the grid's axes or nearly so, some outside.
fn pose(grid: &Grid, random: &mut ChaCha8Rng, index: usize) -> Pose {
    let mut unit = DVec3::new(number(random), number(random), number(random));
    if index.is_multiple_of(17) {
        unit = unit * 3.0 - 1.0;
    }
    let mut position = grid.origin + unit * grid.size();
    if index.is_multiple_of(5) {
        let voxel = grid.continuous(position).round();
        position = grid.origin + (voxel + 0.5) * grid.pitch;
    }
    let (theta, phi) = (360.0 * number(random), (2.0 * number(random) - 1.0).acos().to_degrees());
    let orientation = match index % 11 {
        0 => Orientation::new(90.0 * (theta / 90.0).floor(), 90.0 * (phi / 90.0).round()),
        1 => Orientation::new(theta, [0.0, 1e-7, 0.01, 1.5, 90.0, 90.0 + 1e-6, 179.3, 180.0][index / 11 % 8]),
        2 => Orientation::new(45.0 * (theta / 45.0).floor(), 45.0 * (phi / 45.0).round()),
        _ => Orientation::new(theta, phi),
    };
    Pose::oriented(position, &orientation)
}

/// The `index`-th pose of a seed.
pub(super) fn random_pose(grid: &Grid, seed: usize, index: usize) -> Pose {
    pose(grid, &mut ChaCha8Rng::seed_from_u64((seed * 1_000_000 + index) as u64), index)
}

/// So many poses of every part with two tools, on all threads.
fn at_random_poses(poses: usize, check: impl Fn(&Scene, &SolidField, &Pose, std::fmt::Arguments<'_>) + Sync) {
    for (seed, part) in ReferencePart::ALL.into_iter().enumerate() {
        for tool in [Tool::paper(), awkward()] {
            let scene = half(part, &tool);
            let field = field_of(&scene);
            (0..poses).into_par_iter().for_each(|index| {
                let pose = random_pose(&scene.record.grid, seed, index);
                check(&scene, &field, &pose, format_args!("{part} {} {index} {pose:?}", tool.name));
            });
        }
    }
}

#[test]
fn counts_and_decisions_are_the_definitions_at_random_poses() {
    at_random_poses(1500, |scene, field, pose, case| {
        let tool = &scene.record.tool;
        let expected = tool.count_inside(&scene.obstacle, pose.position, &pose.orientation());
        assert_eq!(field.count(pose), Some(expected), "{case}");
        assert_eq!(field.collides(pose), expected > 0, "{case}");
    });
}

#[test]
fn decisions_are_never_wrong_at_many_poses() {
    at_random_poses(60_000, |_, field, pose, case| {
        assert_eq!(field.collides(pose), field.count(pose).unwrap() > 0, "{case}");
    });
}

#[test]
fn the_deepest_centre_is_that_of_all_in_the_tool() {
    at_random_poses(1500, |scene, field, pose, case| {
        let tool = &scene.record.tool;
        let ToolShape::Revolved(elements) = &tool.shape else { unreachable!() };
        let mut deepest = f64::NEG_INFINITY;
        for element in elements {
            element.visit_inside(&scene.obstacle, pose, |_, height, radius| {
                deepest = deepest.max(element.depth(height, radius, true));
            });
        }
        let found = field.deepest(tool, pose).map_or(f64::NEG_INFINITY, |inside| inside.depth);
        assert!(found == deepest || (found - deepest).abs() < 1e-6, "{found} {deepest} {case}");
    });
}

#[test]
fn the_normaliser_is_the_rotated_tools_count() {
    for tool in [Tool::paper(), awkward()] {
        let scene = half(ReferencePart::Bracket, &tool);
        let field = field_of(&scene);
        (0..300).into_par_iter().for_each(|index| {
            let pose = random_pose(&scene.record.grid, 0, index);
            let orientation = pose.orientation();
            let expected = ToolVoxels::new(&tool, &orientation, scene.record.grid.pitch).unwrap().count;
            assert_eq!(field.normaliser(pose.rotation).unwrap(), expected, "{} {orientation:?}", tool.name);
        });
    }
}

#[test]
fn elements_sum_to_the_whole_and_offset_ones_are_counted_by_their_outline() {
    let tool = awkward();
    let scene = half(ReferencePart::Teapot, &tool);
    let offset = tool.offset_elements(&Clearance { holder: 2.0, shank: 1.0, cutter: 0.7 }).unwrap();
    let field = field_of(&scene);
    let offset_field = SolidField::of_elements(Arc::new(scene.obstacle.clone()), &offset).unwrap();
    (0..600).into_par_iter().for_each(|index| {
        let pose = random_pose(&scene.record.grid, 0, index);
        let (mut counts, mut offset_counts) = ([0; 4], [0; 4]);
        field.element_counts(&pose, &mut counts);
        assert_eq!(Some(counts.iter().sum::<u32>()), field.count(&pose));
        offset_field.element_counts(&pose, &mut offset_counts);
        for (element, (count, offset_count)) in offset.iter().zip(counts.iter().zip(&offset_counts)) {
            let alone = Tool { shape: ToolShape::Revolved(vec![element.clone()]), ..tool.clone() };
            let expected = alone.count_inside(&scene.obstacle, pose.position, &pose.orientation());
            assert_eq!(*offset_count, expected, "{:?} {pose:?}", element.kind);
            assert!(offset_count >= count);
        }
        assert_eq!(offset_field.collides(&pose), offset_counts.iter().any(|&c| c > 0), "{pose:?}");
    });
}

#[test]
fn bounding_spheres_hold_their_pieces_and_balls_are_bounded_by_themselves() {
    let ball = |from, to, centre, radius| {
        revolved([(ElementKind::Cutter, vec![arc(from, to, centre, 0.0, radius)])])
    };
    // A whole ball, half of one, the slice of one between its quarters, and a dome as flat as a lens.
    let tools = [
        ball(0.0, 16.0, 8.0, 8.0),
        ball(0.0, 8.0, 8.0, 8.0),
        ball(4.0, 12.0, 8.0, 8.0),
        ball(0.0, 1.0, 60.0, 60.0),
    ];
    for tool in [Tool::paper(), awkward()].iter().chain(&tools) {
        let ToolShape::Revolved(elements) = &tool.shape else { unreachable!() };
        let bodies = bodies_of(elements, 1.0).unwrap();
        let tree = SphereTree::new(&bodies);
        for index in [0.0, 5.0, 40.0, 1e9].into_iter().flat_map(|slender| tree.level(tree.roots(), slender)) {
            let (piece, bound) = (tree.piece(index), tree.piece(index).bound);
            for part in &bodies[piece.body].parts {
                let (low, high) = part.segment.range();
                for step in 0..=40 {
                    let height = piece.from + (piece.to - piece.from) * f64::from(step) / 40.0;
                    let away = (height - bound.middle).hypot(part.segment.radius(height.clamp(low, high)));
                    let holds = away <= bound.radius || !(low..=high).contains(&height);
                    assert!(holds, "{}: {piece:?} at {height}", tool.name);
                }
            }
        }
        let radii = tree.level(tree.roots(), 0.0).into_iter().map(|index| tree.piece(index).bound.radius);
        let smallest = radii.fold(f64::INFINITY, f64::min);
        match &elements[0].profile[0] {
            Segment::Arc { arc_radius, .. } if *arc_radius == 8.0 => assert_eq!(smallest, 8.0 + 1e-4),
            // The dome's pieces are as wide as itself, not as its ball.
            _ => assert!(smallest < 12.0, "{smallest}"),
        }
    }
}

#[test]
fn the_clearance_is_a_lower_bound() {
    let tool = Tool::paper();
    let scene = half(ReferencePart::Bracket, &tool);
    let field = field_of(&scene);
    let mut free = 0;
    for index in 0..2000 {
        let pose = random_pose(&scene.record.grid, 0, index);
        let bound = field.clearance_up_to(&pose, f64::INFINITY).unwrap();
        if bound > 0.0 {
            free += 1;
            // Offset by what it is said to have free, the tool still holds nothing.
            let all = Clearance { holder: bound, shank: bound, cutter: bound };
            let offset = tool.offset_elements(&all).unwrap();
            let field = SolidField::of_elements(Arc::new(scene.obstacle.clone()), &offset).unwrap();
            assert_eq!(field.count(&pose), Some(0), "{bound} {pose:?}");
        }
    }
    assert!(free > 200, "{free}");
}

#[test]
fn every_instruction_set_counts_the_same() {
    let tool = awkward();
    let scene = half(ReferencePart::ScrewGear, &tool);
    let field = field_of(&scene);
    for arch in archs() {
        let other = SolidField { arch, ..field_of(&scene) };
        for index in 0..400 {
            let pose = random_pose(&scene.record.grid, 0, index);
            assert_eq!(other.count(&pose), field.count(&pose), "{pose:?}");
            assert_eq!(other.normaliser(pose.rotation), field.normaliser(pose.rotation));
            assert_eq!(other.collides(&pose), field.collides(&pose), "{pose:?}");
        }
    }
}

#[test]
fn colliding_is_a_count_above_zero_where_flat_ends_pass_by_voxel_centres() {
    let part = ReferencePart::Bracket;
    let scene = SceneSpec::of_reference(part, &part.mesh(), part.dims(), &Tool::paper()).scene().unwrap();
    let field = field_of(&scene);
    let (Grid { origin, pitch, dims }, set) = (scene.record.grid, "0,0;0,180;0,90;90,90;180,90;270,90");
    let mut colliding = 0;
    for orientation in orientations(set) {
        for along in -90..180 {
            for (across, beside) in [(0, 0), (3, 5), (17, 40), (24, 80), (40, 71)] {
                // The tip on voxel centres along the axis, so that the holder's flat end meets centres.
                let axis = orientation.direction().abs();
                let at = match axis.to_array().map(|part| part > 0.5) {
                    [.., true] => [across, beside, along],
                    [_, true, _] => [across, along, beside],
                    _ => [along, across, beside],
                };
                let position = origin + pitch * (DVec3::from_array(at.map(f64::from)) + 0.5);
                let pose = Pose::oriented(position, &orientation);
                assert_eq!(field.collides(&pose), field.count(&pose).unwrap() > 0, "{pose:?} of {dims:?}");
                colliding += usize::from(field.collides(&pose));
            }
        }
    }
    assert!(colliding > 1000, "{colliding}");
}

#[test]
fn centres_on_flat_ends_count_alike_however_a_direction_is_given() {
    // Flat ends at whole heights, between which directions of whole numbers have centres right on them.
    let (radii, ends) = ([2, 5], [0, 6, 11]);
    let body = |kind, at: usize| {
        let [from, to, radius] = [ends[at], ends[at + 1], radii[at]].map(f64::from);
        (kind, vec![line(from, to, radius, radius)])
    };
    let tool = revolved([body(ElementKind::Cutter, 0), body(ElementKind::Holder(0), 1)]);
    let reach = 13;
    let grid = Grid { origin: DVec3::splat(-0.5), pitch: 1.0, dims: [2 * reach as usize + 1; 3] };
    let full = Arc::new(Occupancy { grid, solid: vec![1; grid.len()] });
    let field = SolidField::of_tool(full, &tool);
    let tip = DVec3::splat(reach as f64);
    let axes: [[i64; 3]; 8] =
        [[1, 0, 1], [0, 1, 1], [1, 1, 0], [-1, 1, 0], [1, 1, 1], [1, 2, 2], [4, -3, 0], [0, 3, -4]];
    for axis in axes {
        // By whole numbers alone: how far along the axis and how far from it, times its length.
        let dot = |a: [i64; 3], b: [i64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<i64>();
        let length = dot(axis, axis);
        let is_inside = |point: &[i64; 3]| {
            let along = dot(axis, *point);
            let is_above = |height: i64| along >= 0 && along * along >= length * height * height;
            let body = (0..2).find(|&body| is_above(ends[body].into()) && !is_above(ends[body + 1].into()));
            body.is_some_and(|body| {
                let radius = i64::from(radii[body]);
                length * dot(*point, *point) - along * along <= length * radius * radius
            })
        };
        let of_box = (0..grid.len()).map(|index| grid.voxel(index).map(|v| v as i64 - reach));
        let expected = of_box.filter(is_inside).count() as u32;
        let direction = DVec3::from_array(axis.map(|v| v as f64)).normalize();
        let orientation = Orientation::from_direction(direction).unwrap();
        assert_eq!(ToolVoxels::new(&tool, &orientation, 1.0).unwrap().count, expected, "{axis:?}");
        let turned = Pose::new(tip, DQuat::from_rotation_arc(DVec3::Z, direction));
        for pose in [Pose::along(tip, direction), Pose::oriented(tip, &orientation), turned] {
            assert_eq!(field.count(&pose), Some(expected), "{axis:?} {pose:?}");
        }
    }
}
