//! Decisions and motions of verified fields, against exact counts.

use glam::{DQuat, DVec3};

use crate::field::VerifiedField;
use crate::field::scenes::{harmonic, poses, scene};
use crate::field::tests::{ROUNDING, values};
use imf_core::field::{Best, Decision, PoseField};
use imf_core::motion::{MotionError, MotionResult};
use imf_core::pose::Pose;
use imf_core::tool::{Clearance, Tool};

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

#[test]
fn motions_agree_with_dense_exact_checks() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = VerifiedField::new(harmonic(&scene)).unwrap();
    let ends = poses(&scene, 800, 21);
    let decide = |poses: &[Pose]| {
        let mut decisions = vec![Decision::Undecided; poses.len()];
        field.classify(poses, &mut decisions).unwrap();
        decisions
    };
    let (mut free, mut blocked, mut unknown, mut late) = (0, 0, 0, 0);
    for pair in ends.chunks(2) {
        let [a, mut b] = [pair[0], pair[1]];
        // Half of the motions are short, as a planner's are.
        if free % 2 == 0 {
            b = between(&a, &b, 0.1);
        }
        const STEPS: usize = 400;
        let dense: Vec<Pose> = (0..=STEPS).map(|i| between(&a, &b, i as f64 / STEPS as f64)).collect();
        let collides: Vec<bool> = decide(&dense).iter().map(|&d| d == Decision::Colliding).collect();
        let first = collides.iter().position(|&c| c).map(|i| i as f64 / STEPS as f64);
        // The twin's own rounding of a pose.
        let slack = 1e-4;
        match field.check_motion(&a, &b).unwrap() {
            MotionResult::Free => {
                free += 1;
                assert_eq!(first, None, "{a:?} {b:?}");
            }
            MotionResult::Colliding { free_until, at, pose } => {
                blocked += 1;
                assert_eq!(decide(&[pose]), [Decision::Colliding]);
                assert!(free_until <= at && at <= 1.0);
                assert!(first.is_none_or(|first| first >= free_until - slack), "{first:?} {free_until}");
                assert!((pose.position - a.position.lerp(b.position, at)).length() < 1e-3);
                // Found no later than by the dense poses.
                assert!(first.is_none_or(|first| at <= first + slack), "{at} after {first:?}");
                late += usize::from(at - free_until > 0.01);
            }
            MotionResult::Undecided { from, to } => {
                unknown += 1;
                assert!(0.0 <= from && from < to && to <= 1.0);
                assert!(first.is_none_or(|first| first >= from - slack), "{first:?} {from}");
            }
        }
    }
    // Most motions are decided, and most collisions come right after what is proven free.
    assert!(free > 40 && blocked > 100 && unknown * 20 < free + blocked, "{free} {blocked} {unknown}");
    assert!(late * 10 < blocked, "{late} of {blocked}");
}

#[test]
fn motions_keep_the_clearance_that_the_field_keeps() {
    let scene = scene(&Tool::paper(), 0.0);
    let room = 1.5 * scene.record.grid.pitch;
    let kept = Clearance { holder: room, shank: room, cutter: room };
    let field = VerifiedField::new(harmonic(&scene)).unwrap();
    let keeping = VerifiedField::with_clearance(harmonic(&scene), kept).unwrap();
    let ends = poses(&scene, 400, 22);
    let mut differ = 0;
    for pair in ends.chunks(2) {
        let b = between(&pair[0], &pair[1], 0.2);
        let (bare, offset) =
            (field.check_motion(&pair[0], &b).unwrap(), keeping.check_motion(&pair[0], &b).unwrap());
        // What the offset tool may do, the tool may do.
        assert!(offset != MotionResult::Free || !matches!(bare, MotionResult::Colliding { .. }));
        differ += usize::from(bare == MotionResult::Free && offset != MotionResult::Free);
    }
    assert!(differ > 0);
}

#[test]
fn motions_without_an_answer_say_why() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = VerifiedField::new(harmonic(&scene)).unwrap();
    let far = Pose::along(DVec3::splat(1e4), DVec3::Z);
    assert_eq!(field.check_motion(&far, &far), Ok(MotionResult::Free));
    let turned = Pose::along(far.position + 5.0, DVec3::NEG_Z);
    assert_eq!(field.check_motion(&far, &turned), Err(MotionError::Opposite));
    let bad = Pose { position: DVec3::NAN, ..far };
    assert_eq!(field.check_motion(&far, &bad), Err(MotionError::InvalidPose));
    let inside = scene.obstacle.solid.iter().position(|&s| s == 1).unwrap();
    let grid = scene.record.grid;
    let inside = Pose::along(grid.centre(grid.voxel(inside)), DVec3::Z);
    let stands = field.check_motion(&inside, &inside).unwrap();
    assert!(matches!(stands, MotionResult::Colliding { free_until: 0.0, at: 0.0, .. }), "{stands:?}");
}

#[test]
fn motions_to_the_end_of_numbers_are_answered_at_once() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = VerifiedField::new(harmonic(&scene)).unwrap();
    let grid = scene.record.grid;
    let inside = Pose::along(grid.origin + 0.5 * grid.size(), DVec3::Z);
    let outside = Pose { position: inside.position + DVec3::new(0.0, 0.0, 400.0), ..inside };
    let mut decisions = [Decision::Undecided; 2];
    field.classify(&[inside, outside], &mut decisions).unwrap();
    assert_eq!(decisions, [Decision::Colliding, Decision::Free]);
    // As far as a voxel is told from the next one a way through the part is found, and one away from it is free.
    let far = |distance: f64| Pose { position: inside.position + DVec3::new(0.0, 0.0, distance), ..inside };
    assert_eq!(field.check_motion(&outside, &far(1e5)).unwrap(), MotionResult::Free);
    let through = field.check_motion(&far(1e5), &far(-1e5)).unwrap();
    assert!(matches!(through, MotionResult::Colliding { .. }), "{through:?}");
    assert_eq!(field.check_motion(&outside, &far(1e9)).unwrap(), MotionResult::Free);
    for distance in [1e15, 1e20, 1e300] {
        // Nothing but the ends is looked at.
        let away = field.check_motion(&outside, &far(distance)).unwrap();
        assert_eq!(away, MotionResult::Undecided { from: 0.0, to: 1.0 });
        let from_within = field.check_motion(&inside, &far(distance)).unwrap();
        assert_eq!(from_within, MotionResult::Colliding { free_until: 0.0, at: 0.0, pose: inside });
        let into = field.check_motion(&far(-distance), &inside).unwrap();
        assert_eq!(into, MotionResult::Colliding { free_until: 0.0, at: 1.0, pose: inside });
    }
}

#[test]
fn verified_fields_say_free_where_the_true_tool_is_free_and_nowhere_else() {
    for clearance in [0.0, 1.5] {
        let scene = scene(&Tool::paper(), clearance);
        let verified = VerifiedField::new(harmonic(&scene)).unwrap();
        let keeping = VerifiedField::with_clearance(harmonic(&scene), scene.record.clearance).unwrap();
        let asked = poses(&scene, 4000, 11);
        let (mut decisions, mut kept) = (vec![Decision::Undecided; 4000], vec![Decision::Undecided; 4000]);
        verified.classify(&asked, &mut decisions).unwrap();
        keeping.classify(&asked, &mut kept).unwrap();
        let mut between = 0;
        for ((pose, decision), kept) in asked.iter().zip(&decisions).zip(&kept) {
            // The definition.
            let (position, orientation) = (pose.position, pose.orientation());
            let count = |tool: &Tool| tool.count_inside(&scene.obstacle, position, &orientation);
            assert_eq!(*decision == Decision::Free, count(scene.record.bare_tool()) == 0, "{pose:?}");
            assert_eq!(*kept == Decision::Free, count(&scene.record.tool) == 0, "{pose:?}");
            between += usize::from(decision != kept);
        }
        assert_eq!(between > 0, clearance > 0.0);
        // The best of those that are free, where any is.
        let points: Vec<DVec3> = asked.iter().take(50).map(|p| p.position).collect();
        let rotations: Vec<DQuat> = asked.iter().skip(100).take(60).map(|p| p.rotation).collect();
        let mut best = vec![Best::NONE; points.len()];
        verified.best(&points, &rotations, &mut best).unwrap();
        let model = verified.model();
        for (&point, best) in points.iter().zip(&best) {
            let all: Vec<Pose> = rotations.iter().map(|&r| Pose::new(point, r)).collect();
            let mut decided = vec![Decision::Undecided; all.len()];
            verified.classify(&all, &mut decided).unwrap();
            let free = decided.contains(&Decision::Free);
            assert_eq!(best.decision == Decision::Free, free);
            let of = values(model, &all);
            let least = of.iter().zip(&decided).filter(|(_, d)| !free || **d == Decision::Free);
            let least = least.map(|(v, _)| *v).fold(f32::INFINITY, f32::min);
            assert!((best.value - least).abs() < ROUNDING);
        }
    }
}
