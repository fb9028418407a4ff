//! Motions against dense exact poses.

use glam::DVec3;

use super::tests::{bracket_scene, poses, tool, world};
use super::*;
use crate::machine::tests::{head_and_table, trunnion};
use crate::machine::{Joints, MachineMotion};
use crate::scene::Scene;
use crate::tool::Clearance;

/// The way itself, written anew: the tip along the line, the axis along the great circle.
fn between(a: &Pose, b: &Pose, time: f64) -> Pose {
    let (from, to) = (a.axis().unwrap(), b.axis().unwrap());
    let angle = from.dot(to).clamp(-1.0, 1.0).acos();
    let axis = if angle < 1e-4 {
        from.lerp(to, time)
    } else {
        (from * ((1.0 - time) * angle).sin() + to * (time * angle).sin()) / angle.sin()
    };
    Pose::along(a.position.lerp(b.position, time), axis)
}

/// In and around a scene's grid.
fn around(scene: &Scene, count: usize, seed: u64) -> Vec<Pose> {
    let grid = scene.record.grid;
    let middle = grid.origin + 0.5 * grid.size();
    let shifted = |pose: Pose| Pose { position: middle + pose.position * grid.size() / 60.0, ..pose };
    poses(count, seed, 40.0).into_iter().map(shifted).collect()
}

/// What dense poses say of a motion's result.
fn agrees(checker: &Checker, result: &MotionResult, steps: usize, pose: &dyn Fn(f64) -> Pose, reach: f64) {
    let times = (0..=steps).map(|step| step as f64 / steps as f64);
    let first = times.into_iter().find(|&time| !checker.is_free(&pose(time)));
    // The twin's own rounding of a pose.
    let slack = 1e-4;
    if let Some((last, at)) = result.last_valid {
        assert!(checker.is_free(&at) && at.position.distance(pose(last).position) < 1e-6 * reach);
        assert!(result.proven_until <= last);
    }
    assert!(first.is_none_or(|first| first >= result.proven_until - slack), "{first:?} {result:?}");
    match result.first_colliding {
        None => assert_eq!(result.last_valid.map(|(time, _)| time), Some(1.0)),
        Some(MotionCollision { time, pose, contact }) => {
            assert_eq!(checker.contact(&pose).unwrap(), Some(contact));
            assert!(!checker.is_free(&pose) && time <= 1.0);
            assert!(result.last_valid.is_none_or(|(last, _)| last < time));
            // Found no later than by the dense poses.
            assert!(first.is_none_or(|first| time <= first + slack), "{time} after {first:?}");
        }
    }
}

#[test]
fn motions_agree_with_dense_exact_checks() {
    let scene = bracket_scene([12, 36, 22]);
    let checkers = [
        (Checker::of_scene(&scene, &Clearance::default()).unwrap(), around(&scene, 600, 21)),
        (world().checker(&tool(), &Clearance::default()).unwrap(), poses(500, 22, 50.0)),
    ];
    let options = MotionOptions::default();
    for (checker, ends) in checkers {
        let (mut free, mut colliding, mut late) = (0, 0, 0);
        for (index, pair) in ends.chunks(2).enumerate() {
            let [a, mut b] = [pair[0], pair[1]];
            // Half of the motions are short, as a planner's are.
            if index % 2 == 0 {
                b = between(&a, &b, 0.1);
            }
            let result = checker.check_motion(&a, &b, &options).unwrap();
            agrees(&checker, &result, 400, &|time| between(&a, &b, time), 100.0);
            free += usize::from(result.is_free());
            colliding += usize::from(!result.is_free());
            let found = result.first_colliding.map_or(1.0, |collision| collision.time);
            late += usize::from(found - result.proven_until > 0.01);
        }
        // Most motions are proven, up to right before the collision where there is one.
        assert!(free > 30 && colliding > 100 && late * 10 < free + colliding, "{free} {colliding} {late}");
        let pairs: Vec<[Pose; 2]> = ends.as_chunks().0.to_vec();
        let all = checker.check_motions_on_all_threads(&pairs, &options);
        assert!(pairs.iter().map(|[a, b]| checker.check_motion(a, b, &options)).eq(all));
    }
}

#[test]
fn motions_that_graze_are_answered_to_the_resolution() {
    let checker = world().checker(&tool(), &Clearance::default()).unwrap();
    let ends = poses(1200, 23, 45.0);
    let (mut grazing, mut free) = (0, 0);
    let resolution = 0.05;
    let options = MotionOptions { resolution: Some(resolution) };
    // Without half the resolution all around, a tool that passes between tried poses holds nothing.
    let slim = checker.assembly().eroded(0.5 * resolution + 1e-6).unwrap();
    let slim = Checker::new(&world(), slim).unwrap();
    for pair in ends.chunks(2) {
        let [mut out, mut into] = [pair[0], pair[1]];
        if !checker.is_free(&out) || checker.is_free(&into) {
            continue;
        }
        while out.position.distance(into.position) > 1e-4 {
            let Some(middle) = out.interpolate(&into, 0.5) else { break };
            if checker.is_free(&middle) { out = middle } else { into = middle }
        }
        // From contact a little way to a side.
        for way in [DVec3::X, DVec3::NEG_Y, DVec3::new(0.3, -0.4, 0.8)] {
            let to = Pose { position: out.position + way, ..out };
            let result = checker.check_motion(&out, &to, &options).unwrap();
            grazing += usize::from(result.is_free() && !result.is_proven());
            free += usize::from(result.is_free());
            if let Some((last, _)) = result.last_valid {
                for step in 0..=300 {
                    let pose = between(&out, &to, last * f64::from(step) / 300.0);
                    assert!(slim.is_free(&pose), "{pose:?} {result:?}");
                }
            }
        }
    }
    assert!(grazing > 30 && free > 100, "{grazing} {free}");
    let far = Pose::along(DVec3::splat(300.0), DVec3::Z);
    for given in [0.0, -1.0, f64::NAN, 1e-9] {
        let options = MotionOptions { resolution: Some(given) };
        assert!(matches!(checker.check_motion(&far, &far, &options), Err(QueryError::Resolution { .. })));
    }
}

#[test]
fn motions_keep_the_clearance_that_the_checker_keeps() {
    let scene = bracket_scene([12, 36, 22]);
    let room = 1.5 * scene.record.grid.pitch;
    let kept = Clearance { holder: room, shank: room, cutter: room };
    let [bare, keeping] = [Clearance::default(), kept].map(|room| Checker::of_scene(&scene, &room).unwrap());
    let mut differ = 0;
    for pair in around(&scene, 400, 24).chunks(2) {
        let b = between(&pair[0], &pair[1], 0.2);
        let of = |checker: &Checker| checker.check_motion(&pair[0], &b, &MotionOptions::default()).unwrap();
        let (bare, offset) = (of(&bare), of(&keeping));
        // What the offset tool may do, the tool may do.
        assert!(bare.is_free() || !offset.is_free());
        differ += usize::from(bare.is_free() && !offset.is_free());
    }
    assert!(differ > 0);
}

#[test]
fn motions_without_an_answer_say_why_even_at_the_end_of_numbers() {
    let scene = bracket_scene([12, 36, 22]);
    let checker = Checker::of_scene(&scene, &Clearance::default()).unwrap();
    let check = |a: &Pose, b: &Pose| checker.check_motion(a, b, &MotionOptions::default());
    let far = Pose::along(DVec3::splat(1e4), DVec3::Z);
    assert!(check(&far, &far).unwrap().is_free());
    let turned = Pose::along(far.position + 5.0, DVec3::NEG_Z);
    assert_eq!(check(&far, &turned), Err(QueryError::Opposite));
    let inside = scene.obstacle.solid.iter().position(|&s| s == 1).unwrap();
    let grid = scene.record.grid;
    let inside = Pose::along(grid.centre(grid.voxel(inside)), DVec3::Z);
    let stands = check(&inside, &inside).unwrap();
    assert!(
        stands.last_valid.is_none() && stands.first_colliding.is_some_and(|c| c.time == 0.0),
        "{stands:?}"
    );
    // To the end of numbers, at once.
    let inside = Pose::along(grid.origin + 0.5 * grid.size(), DVec3::Z);
    let outside = Pose { position: inside.position + DVec3::new(0.0, 0.0, 400.0), ..inside };
    assert!(checker.is_free(&outside) && !checker.is_free(&inside));
    // As far as a voxel is distinguishable from the next one a way through the part is found, and one away from it is
    // free.
    let far = |distance: f64| Pose { position: inside.position + DVec3::new(0.0, 0.0, distance), ..inside };
    assert!(check(&outside, &far(1e5)).unwrap().is_free());
    assert!(check(&far(1e5), &far(-1e5)).unwrap().first_colliding.is_some());
    assert!(check(&outside, &far(1e9)).unwrap().is_free());
    for distance in [1e15, 1e20, 1e300] {
        // Only the ends are checked.
        assert_eq!(check(&outside, &far(distance)), Err(QueryError::TooFar));
        let from_within = check(&inside, &far(distance)).unwrap();
        assert!(from_within.last_valid.is_none());
        assert_eq!(from_within.first_colliding.map(|c| (c.time, c.pose)), Some((0.0, inside)));
        let into = check(&far(-distance), &inside).unwrap();
        assert_eq!(into.first_colliding.map(|c| (c.time, c.pose)), Some((1.0, inside)));
    }
}

#[test]
fn motions_of_a_machines_joints_agree_with_dense_ones() {
    let tool = tool();
    let checker = world().checker(&tool, &Clearance::default()).unwrap();
    let machines = [trunnion(), head_and_table()];
    let all = poses(160, 25, 45.0);
    let (mut free, mut colliding) = (0, 0);
    for (index, pair) in all.chunks(2).enumerate() {
        let (a, b, machine) = (pair[0], pair[1], &machines[index % 2]);
        for straight in [true, false] {
            let joints = |pose: &Pose, sign: f64| {
                let rotary = [sign * 40.0 * pose.rotation.x, 90.0 * pose.rotation.y];
                Joints { linear: machine.linear(pose.position, &rotary, tool.length()), rotary }
            };
            let motion =
                MachineMotion::new(machine, joints(&a, 1.0), joints(&b, -1.0), tool.length(), straight);
            let result = checker.check_machine_motion(&motion, &MotionOptions::default()).unwrap();
            agrees(&checker, &result, 300, &|time| motion.pose(time), 100.0);
            free += usize::from(result.is_free());
            colliding += usize::from(!result.is_free());
        }
    }
    assert!(free > 10 && colliding > 10, "{free} {colliding}");
    let machine = trunnion();
    let inches = machine.in_unit(LengthUnit::Inch);
    let stand = Joints { linear: DVec3::ZERO, rotary: [0.0; 2] };
    let motion = MachineMotion::new(&inches, stand, stand, 2.0, true);
    let refused = checker.check_machine_motion(&motion, &MotionOptions::default());
    assert!(matches!(refused, Err(QueryError::Unit { .. })));
    // An axis of another length turns the tool elsewhere than the motion's bound has it.
    for length in [1.001, 2.0] {
        let mut bent = machine.clone();
        bent.rotary[1].direction *= length;
        let turn = Joints { rotary: [0.0, 40.0], ..stand };
        let motion = MachineMotion::new(&bent, stand, turn, 50.0, true);
        let refused = checker.check_machine_motion(&motion, &MotionOptions::default()).unwrap_err();
        let text = refused.to_string();
        assert!(text.contains("'test'") && text.contains("C needs a direction of length 1"), "{text}");
    }
    // Ends that are not numbers.
    let bad = Joints { linear: DVec3::NAN, ..stand };
    let motion = MachineMotion::new(&machine, stand, bad, 50.0, true);
    let refused = checker.check_machine_motion(&motion, &MotionOptions::default());
    assert_eq!(refused, Err(QueryError::InvalidPose));
}
