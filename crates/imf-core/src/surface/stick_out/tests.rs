//! Against closed forms, against exact counts at every answer, and against trial.

use glam::{DMat4, DVec2};

use super::*;
use crate::mesh::Mesh;
use crate::parts::shell::{circle, pocketed, rounded_rectangle};
use crate::section::test_shapes::{line, orientations, revolved};
use crate::surface::closed_forms::Part;
use crate::tool::{Clearance, Segment, Tool};

/// Cutter of 8 and shank, set to 20, in a holder of two parts.
fn tool(cutter: Vec<Segment>, shank: f64, holder: [Segment; 2]) -> Tool {
    revolved([
        (ElementKind::Cutter, cutter),
        (ElementKind::Shank, vec![Segment::cylinder(8.0, 20.0, shank)]),
        (ElementKind::Holder(0), vec![holder[0]]),
        (ElementKind::Holder(1), vec![holder[1]]),
    ])
}

impl Part {
    fn tool(&self, tool: &Tool, clearance: &Clearance) -> StickOutTool {
        StickOutTool::new(&self.environment, &tool.offset(clearance).unwrap(), self.tolerance()).unwrap()
    }

    fn find(&self, tool: &StickOutTool, directions: &[Orientation]) -> Vec<StickOut> {
        shortest_stick_outs(tool, &self.samples, directions, Control::quiet()).unwrap()
    }
}

/// A block with a pocket of 14 × 16 and a depth of 13.
fn block() -> Mesh {
    let pocket = rounded_rectangle(DVec2::new(7.0, 4.0), DVec2::new(21.0, 20.0), 3.0, 6);
    pocketed(DVec3::new(40.0, 24.0, 22.0), &pocket, 13.0)
}

/// A block with a pocket of 18 × 18 and a depth of 14.
fn square() -> Mesh {
    let pocket = rounded_rectangle(DVec2::splat(6.0), DVec2::splat(24.0), 4.0, 8);
    pocketed(DVec3::new(30.0, 30.0, 20.0), &pocket, 14.0)
}

/// Shank and holder, set to a length, hold nothing: the definition.
fn is_free(
    part: &Part,
    tool: &Tool,
    clearance: &Clearance,
    length: f64,
    (tip, axis): (DVec3, DVec3),
) -> bool {
    let set = tool.with_stick_out(length).unwrap().offset(clearance).unwrap();
    let field = part.environment.rest_field(set.noncutting().unwrap(), clearance, part.tolerance());
    !field.meets(tip, axis, Known::default(), None)
}

#[test]
fn the_floor_of_a_pocket_takes_its_depth_and_a_narrow_nose_less() {
    let cutter = || vec![line(0.0, 8.0, 2.0, 2.0)];
    for pitch in [1.0, 0.5, 0.25] {
        let part = Part::sampled(&square(), pitch, 800);
        let wide = tool(cutter(), 2.0, [line(20.0, 24.0, 16.0, 16.0), line(24.0, 50.0, 20.0, 20.0)]);
        // Its nose of 5 goes into the pocket with room to spare in the middle.
        let nose = tool(cutter(), 2.0, [line(20.0, 24.0, 4.0, 4.0), line(24.0, 50.0, 20.0, 20.0)]);
        let clearance = Clearance::around_holder_and_shank(0.5);
        for (tool, expected) in [(&wide, 14.5), (&nose, 10.5)] {
            let found = part.find(&part.tool(tool, &clearance), &orientations("0,0"));
            let mut floor = 0;
            for (sample, found) in part.samples.iter().zip(&found) {
                let inner = (sample.point.truncate() - 15.0).abs().max_element() < 4.0;
                if inner && (sample.point.z - 6.0).abs() < 1e-6 {
                    floor += 1;
                    let length = found.length();
                    // Voxel centres lie up to half a pitch within the surface.
                    assert!(
                        length <= expected + 1e-3 && length > expected - pitch,
                        "{pitch}: {length} {expected}"
                    );
                } else if sample.normal.z > 0.9 && sample.point.z > 19.0 {
                    // On top the holder must only stay off the flutes, and keep its clearance.
                    assert!(found.length() <= 8.5, "{found:?}");
                } else if sample.normal.z < -0.9 {
                    assert_eq!(*found, StickOut::NotFaced);
                }
            }
            assert!(floor > 3, "{floor}");
        }
    }
}

#[test]
fn a_shank_thicker_than_the_hole_helps_at_no_length() {
    let hole = circle(DVec2::splat(10.0), 3.0, 48);
    let part = Part::sampled(&pocketed(DVec3::new(20.0, 20.0, 25.0), &hole, 20.0), 0.5, 1500);
    let holder = [line(20.0, 24.0, 8.0, 8.0), line(24.0, 50.0, 12.0, 12.0)];
    let deep =
        |s: &SurfaceSample| (s.point.truncate() - 10.0).length() < 0.7 && s.point.z < 6.0 && s.normal.z > 0.9;
    for (shank, reaches) in [(1.8, true), (3.5, false)] {
        let tool = tool(vec![Segment::ball_end(2.0), line(2.0, 8.0, 2.0, 2.0)], shank, holder);
        let found = part.find(&part.tool(&tool, &Clearance::default()), &orientations("0,0"));
        let of_floor = part.samples.iter().zip(&found).filter(|(s, _)| deep(s));
        let of_floor: Vec<_> = of_floor.map(|(_, found)| *found).collect();
        // In the middle, where the ball has room.
        let reached = of_floor.iter().filter(|f| f.length().is_finite()).count();
        assert!(
            of_floor.len() > 4 && reached == if reaches { of_floor.len() } else { 0 },
            "{shank}: {of_floor:?}"
        );
        assert!(reaches || of_floor.contains(&StickOut::Obstructed));
    }
}

/// Free at every answer, colliding one voxel below; a bent part with things on all sides, and holders that narrow again.
#[test]
fn every_answer_is_free_and_one_voxel_less_is_not() {
    let mesh = block().transformed(&DMat4::from_axis_angle(DVec3::new(0.3, 1.0, 0.2).normalize(), 0.4));
    let part = Part::sampled(&mesh, 0.8, 600);
    let waisted = [line(20.0, 26.0, 9.0, 5.0), line(26.0, 30.0, 12.0, 12.0)];
    let cone = [line(20.0, 32.0, 4.0, 10.0), line(32.0, 60.0, 14.0, 14.0)];
    let tools = [
        tool(vec![Segment::ball_end(2.5), line(2.5, 8.0, 2.5, 2.5)], 2.5, waisted),
        tool(vec![line(0.0, 8.0, 3.0, 3.0)], 2.0, cone),
        tool(vec![line(0.0, 8.0, 2.0, 2.0)], 3.0, cone),
    ];
    let clearances = [Clearance::default(), Clearance { holder: 0.5, shank: 1.2, cutter: 0.0 }];
    let mut moved = 0;
    for (tool, clearance) in tools.iter().flat_map(|t| clearances.iter().map(move |c| (t, c))) {
        let prepared = part.tool(tool, clearance);
        for direction in orientations("axes+fibonacci:9") {
            let axis = ToolDirection::new(&direction).axis;
            for found in part.find(&prepared, &[direction]).iter().step_by(9) {
                let StickOut::Reached { length, tip, .. } = *found else { continue };
                assert!(is_free(&part, tool, clearance, length, (tip, axis)), "{found:?}");
                let below = length - part.pitch;
                if below >= prepared.shortest() {
                    moved += 1;
                    assert!(!is_free(&part, tool, clearance, below, (tip, axis)), "{found:?}");
                }
            }
        }
    }
    assert!(moved > 100, "{moved}");
}

/// The best over many directions is the least of those one by one, and no trial in small steps finds less.
#[test]
fn the_best_direction_is_the_best_of_each_alone_and_of_trial() {
    let part = Part::sampled(&block(), 1.0, 120);
    let holder = [line(20.0, 26.0, 7.0, 5.0), line(26.0, 50.0, 9.0, 9.0)];
    let tool = tool(vec![Segment::ball_end(2.5), line(2.5, 8.0, 2.5, 2.5)], 2.5, holder);
    let clearance = Clearance::default();
    let prepared = part.tool(&tool, &clearance);
    let directions = orientations("axes+fibonacci:34");
    let together = part.find(&prepared, &directions);
    let mut least = vec![(f64::INFINITY, 0); part.samples.len()];
    let mut blocked = 0;
    for (index, &direction) in directions.iter().enumerate() {
        let alone = part.find(&prepared, &[direction]);
        let axis = ToolDirection::new(&direction).axis;
        for (sample, found) in alone.iter().enumerate() {
            if found.length() < least[sample].0 {
                least[sample] = (found.length(), index as u32);
            }
            // A ball touches in one pose alone.
            let SurfaceSample { point, normal, bend, .. } = part.samples[sample];
            let one_pose = bend == 0.0 && normal.dot(axis) > 0.05;
            if one_pose && sample % 2 == 0 && matches!(found, StickOut::Reached { .. } | StickOut::Obstructed)
            {
                let tip = point + 2.5 * (normal - axis);
                let lengths = (0..160).map(|step| 8.0 + 0.25 * f64::from(step));
                let trial = lengths.into_iter().find(|&s| is_free(&part, &tool, &clearance, s, (tip, axis)));
                // Where something stands above the holder there may be a gap that the steps miss.
                match trial {
                    Some(trial) => assert!(found.length() <= trial + 1e-6, "{found:?} {trial}"),
                    None => {
                        blocked += 1;
                        assert!(found.length() > 47.0, "{found:?}");
                    }
                }
            }
        }
    }
    for (together, (length, direction)) in together.iter().zip(least) {
        assert_eq!(together.length(), length);
        if let StickOut::Reached { direction: found, .. } = together {
            assert_eq!(*found, direction);
        }
    }
    assert!(blocked > 10, "{blocked}");
}

/// What a tool reaches as it is set takes no more than that.
#[test]
fn as_it_is_set_a_tool_reaches_no_more_than_its_stick_out_allows() {
    let part = Part::sampled(&block(), 1.0, 900);
    let directions = orientations("axes+fibonacci:20");
    let holder = [line(20.0, 26.0, 7.0, 5.0), line(26.0, 50.0, 9.0, 9.0)];
    for cutter in [vec![Segment::ball_end(2.5), line(2.5, 8.0, 2.5, 2.5)], vec![line(0.0, 8.0, 4.0, 4.0)]] {
        let assembly = tool(cutter, 2.0, holder).with_stick_out(11.0).unwrap();
        let assembly = assembly.offset(&Clearance::around_holder_and_shank(0.4)).unwrap();
        let prepared = StickOutTool::new(&part.environment, &assembly, part.tolerance()).unwrap();
        let as_set = SurfaceTool::new(&part.environment, &assembly, part.tolerance()).unwrap();
        let (mut reached, mut longer) = (0, 0);
        for &direction in &directions {
            let least = part.find(&prepared, &[direction]);
            let access = part.access(&as_set, &[direction]);
            for (found, reach) in least.iter().zip(&access.reach) {
                if reach.verdict() == Verdict::Reached {
                    reached += 1;
                    assert!(found.length() <= 11.0, "{found:?}");
                }
                longer += usize::from(found.length().is_finite() && found.length() > 11.0);
            }
        }
        assert!(reached > 1000 && longer > 100, "{reached} {longer}");
    }
}

/// Down into the pocket and along its floor: one length for all poses, as trial finds it.
#[test]
fn a_path_takes_the_length_with_which_all_its_poses_are_free() {
    let part = Part::sampled(&square(), 0.5, 100);
    let holder = [line(20.0, 26.0, 8.0, 5.0), line(26.0, 50.0, 12.0, 12.0)];
    let tool = tool(vec![line(0.0, 8.0, 2.0, 2.0)], 2.0, holder);
    let clearance = Clearance::around_holder_and_shank(0.3);
    let prepared = part.tool(&tool, &clearance);
    let down = |x: f64, z: f64| Pose::along(DVec3::new(x, 15.0, z), DVec3::Z);
    let lean = DVec3::new(0.3, 0.1, 1.0).normalize();
    let poses =
        [down(15.0, 30.0), down(15.0, 6.2), down(10.0, 6.2), Pose::along(DVec3::new(12.0, 15.0, 7.0), lean)];
    let least = |poses: &[Pose]| {
        let mut raising = StickOutSearch::new(&prepared);
        // Farther out a pose may collide that was free.
        poses.iter().chain(poses).try_fold(8.0, |length, pose| raising.from(length, pose))
    };
    let found = least(&poses).unwrap();
    let free = |length: f64| {
        let at = |pose: &Pose| (pose.position, pose.axis().unwrap());
        poses.iter().all(|pose| is_free(&part, &tool, &clearance, length, at(pose)))
    };
    let trial = (0..400).map(|step| 8.0 + 0.1 * f64::from(step)).find(|&length| free(length)).unwrap();
    assert!(free(found) && found <= trial && found > trial - 0.1 - 1e-6, "{found} {trial}");
    let alone = poses.map(|pose| least(&[pose]).unwrap());
    assert!(alone[0] == 8.0 && alone.iter().all(|&length| length <= found), "{alone:?}");
    // Into the floor, and no pose at all.
    assert_eq!(least(&[down(15.0, -12.0)]), None);
    assert_eq!(least(&[Pose::new(DVec3::NAN, glam::DQuat::IDENTITY)]), None);
}

#[test]
fn what_has_no_holder_has_no_stick_out() {
    let part = Part::sampled(&crate::mesh::tests::unit_cube(), 0.25, 12);
    let assembly = Assembly::from(Tool::paper().without_holder());
    let found = StickOutTool::new(&part.environment, &assembly, 0.05);
    assert_eq!(found.err(), Some(SurfaceError::NoHolder("paper".into())));
}
