//! Poses against sections, with contact and without, and what is never free.

use super::*;
use crate::parts::ReferencePart;
use crate::scene::SceneSpec;
use crate::section::sections;
use crate::section::test_shapes::{line, orientations, revolved};
use crate::tool::{ElementKind, Segment, Tool, ToolShape};

fn bracket(dims: [usize; 3], tool: &Tool) -> Scene {
    let part = ReferencePart::Bracket;
    SceneSpec { margin: 1, ..SceneSpec::of_reference(part, &part.mesh(), dims, tool) }.scene().unwrap()
}

fn at_centres(grid: &Grid, orientation: &Orientation, step: usize) -> Vec<Pose> {
    let pose = |i: usize| Pose::oriented(grid.centre(grid.voxel(i)), orientation);
    (0..grid.len()).step_by(step).map(pose).collect()
}

#[test]
fn at_voxel_centres_it_is_the_section() {
    let scene = bracket([10, 30, 18], &Tool::paper());
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let field = ExactField::new(&scene.obstacle, &scene.record.tool).unwrap();
    let set = orientations("0,0;90,90;0,180;45,45;37,61;200,100");
    let exact = sections(&plan, &set, Control::quiet()).unwrap();
    let grid = scene.record.grid;
    for (orientation, section) in set.iter().zip(&exact) {
        let poses = at_centres(&grid, orientation, 17);
        let mut values = vec![f32::NAN; poses.len()];
        field.values(&poses, &mut values).unwrap();
        for (value, section) in values.iter().zip(section.iter().step_by(17)) {
            assert_eq!(value, section, "{orientation:?}");
        }
    }
    let mut all = vec![f32::NAN; grid.len() * set.len()];
    field.sections(&set, &mut all).unwrap();
    assert_eq!(all, exact.concat());
    let units = std::sync::atomic::AtomicU64::new(0);
    let progress = |some: u64| {
        units.fetch_add(some, std::sync::atomic::Ordering::Relaxed);
    };
    let control = Control { progress: &progress, ..Control::quiet() };
    assert_eq!(field.minimum(&set, control).unwrap(), imf(&plan, &set, Control::quiet()).unwrap());
    assert_eq!(units.into_inner(), all.len() as u64);
    assert!(field.minimum(&[], Control::quiet()).is_err());
}

#[test]
fn with_contact_it_is_the_section_with_contact() {
    let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.0 };
    let (mesh, tool) = (ReferencePart::Bracket.mesh(), Tool::paper());
    // Fine enough that not all of it is the middle of a wall.
    let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [17, 51, 30], &tool);
    let spec = SceneSpec { margin: 1, ..spec };
    let scene = spec.scene().unwrap().with_clearance(&clearance).unwrap();
    let grid = scene.record.grid;
    let touching = scene.clone().with_contact(&spec.bodies(&grid).unwrap(), 2.0 * grid.pitch);
    let set = orientations("fibonacci:5");
    let found = sections(&SectionPlan::of_scene(&touching, ToolPoints::Tip).unwrap(), &set, Control::quiet())
        .unwrap();
    let field = ExactField::of_scene(&touching, &clearance).unwrap();
    for (orientation, section) in set.iter().zip(&found) {
        let poses = at_centres(&grid, orientation, 1);
        let mut values = vec![f32::NAN; poses.len()];
        field.values(&poses, &mut values).unwrap();
        assert_eq!(&values, section);
        let mut decisions = vec![Decision::Undecided; poses.len()];
        field.classify(&poses, &mut decisions).unwrap();
        for ((pose, value), decision) in poses.iter().zip(values).zip(decisions) {
            assert_eq!(decision == Decision::Colliding, value > 0.0, "{pose:?}");
            // Bounds of both solids together.
            let (clear, deep) =
                (field.clearance_bound(pose).unwrap(), field.penetration_bound(pose).unwrap());
            assert!(if value > 0.0 { clear <= 0.0 } else { deep == 0.0 }, "{pose:?}");
        }
        let mut section_again = vec![f32::NAN; grid.len()];
        field.section(orientation, &mut section_again).unwrap();
        assert_eq!(&section_again, section);
    }
    // Contact takes something away, and not everything.
    let without =
        sections(&SectionPlan::of_scene(&scene, ToolPoints::Tip).unwrap(), &set, Control::quiet()).unwrap();
    let sum = |all: &[Vec<f32>]| all.iter().flatten().sum::<f32>();
    assert!(sum(&found) < sum(&without) && sum(&found) > 0.0);
}

#[test]
fn the_noncutting_part_of_an_offset_tool_is_not_that_of_the_tool_offset() {
    // The shank stands back behind the cutter: offset by 2 it reaches below the cutter's end.
    let tool = revolved([
        (ElementKind::Cutter, vec![line(0.0, 4.0, 3.0, 3.0)]),
        (ElementKind::Shank, vec![line(4.0, 20.0, 3.0, 3.0)]),
    ]);
    let assembly = tool.offset(&Clearance { holder: 0.0, shank: 2.0, cutter: 0.0 }).unwrap();
    let lowest = |tool: &Tool| match &tool.shape {
        ToolShape::Revolved(elements) => elements[0].profile[0].range().0,
        ToolShape::Mesh(_) => unreachable!(),
    };
    assert!((lowest(assembly.noncutting().unwrap()) - 2.0).abs() < 1e-6);
    assert!(lowest(&assembly.whole().without_cutter().unwrap()) > 1.9);
    assert_eq!((assembly.tool(), assembly.clearance().shank), (&tool, 2.0));
    assert_eq!(assembly.offset_further(1.0).unwrap().clearance().shank, 3.0);
}

#[test]
fn an_invalid_pose_is_never_free() {
    let scene = bracket([10, 30, 18], &Tool::paper());
    let field = ExactField::new(&scene, Tool::paper()).unwrap();
    let far = DVec3::splat(1e4);
    let (nan, endless) = (f64::NAN, f64::INFINITY);
    let turned = |theta, phi, roll| Orientation { theta, phi, roll };
    for (position, orientation) in [
        (DVec3::new(nan, 0.0, 0.0), Orientation::default()),
        (DVec3::new(0.0, endless, 0.0), Orientation::default()),
        (far, turned(0.0, nan, 0.0)),
        (far, turned(endless, 30.0, 0.0)),
        (far, turned(0.0, 30.0, nan)),
    ] {
        let pose = Pose::oriented(position, &orientation);
        assert!(!pose.is_valid() && field.collides(&pose), "{pose:?}");
        assert!(field.count(&pose).is_none() && field.overlap(&pose).unwrap().is_nan(), "{pose:?}");
        assert!(field.clearance_bound(&pose).unwrap() <= 0.0, "{pose:?}");
        assert!(field.signed_clearance(&pose).unwrap() <= 0.0, "{pose:?}");
        let mut values = [0.0];
        field.values(&[pose], &mut values).unwrap();
        assert!(values[0].is_nan(), "{pose:?}");
        let mut decisions = [Decision::Undecided];
        field.classify(&[pose], &mut decisions).unwrap();
        assert_eq!(decisions, [Decision::Colliding]);
        let mut best = [Best { value: 0.0, orientation: 0, decision: Decision::Free }];
        field.best(&[position], &[pose.rotation], &mut best).unwrap();
        assert!(best[0].value.is_nan() && best[0].decision == Decision::Colliding, "{pose:?}");
    }
}

#[test]
fn tools_and_voxels_that_make_no_sense_are_refused() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] };
    let solid = |value: u8, count: usize| Occupancy { grid, solid: vec![value; count] };
    assert!(ExactField::new(solid(1, 64), Tool::paper()).is_ok());
    for wrong in [solid(255, 64), solid(1, 63)] {
        assert!(matches!(ExactField::new(wrong, Tool::paper()), Err(FieldError::Voxels)));
    }
    let none = revolved([(ElementKind::Cutter, vec![Segment::cylinder(0.0, 9.0, f64::NAN)])]);
    assert!(matches!(ExactField::new(solid(1, 64), none), Err(FieldError::Tool(_))));
}
