use glam::Vec3;

use crate::learnt::GuardedField;
use crate::learnt::scenes::{harmonic, poses, scene};
use imf_core::planner::{Decision, MotionError, Passage, Pose, PoseField};
use imf_core::tool::{Clearance, Tool};

/// The way itself, written anew: the tip along the line, the axis along the great circle.
fn between(a: &Pose, b: &Pose, time: f32) -> Pose {
    let (from, to) = (a.axis(), b.axis());
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
    let field = GuardedField::new(harmonic(&scene)).unwrap();
    let ends = poses(&scene, 800, 21);
    let decide = |poses: &[Pose]| {
        let mut decisions = vec![Decision::Near; poses.len()];
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
        let dense: Vec<Pose> = (0..=STEPS).map(|i| between(&a, &b, i as f32 / STEPS as f32)).collect();
        let collides: Vec<bool> = decide(&dense).iter().map(|&d| d == Decision::Blocked).collect();
        let first = collides.iter().position(|&c| c).map(|i| i as f64 / STEPS as f64);
        // The twin's own rounding of a pose.
        let slack = 1e-4;
        match field.free_along(&a, &b).unwrap() {
            Passage::Free => {
                free += 1;
                assert_eq!(first, None, "{a:?} {b:?}");
            }
            Passage::Blocked { free_until, at, pose } => {
                blocked += 1;
                assert_eq!(decide(&[pose]), [Decision::Blocked]);
                assert!(free_until <= at && at <= 1.0);
                assert!(first.is_none_or(|first| first >= free_until - slack), "{first:?} {free_until}");
                assert!((pose.position - a.position.lerp(b.position, at as f32)).length() < 1e-3);
                // Found no later than by the dense poses.
                assert!(first.is_none_or(|first| at <= first + slack), "{at} after {first:?}");
                late += usize::from(at - free_until > 0.01);
            }
            Passage::Unknown { from, to } => {
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
    let field = GuardedField::new(harmonic(&scene)).unwrap();
    let keeping = GuardedField::keeping(harmonic(&scene), kept).unwrap();
    let ends = poses(&scene, 400, 22);
    let mut differ = 0;
    for pair in ends.chunks(2) {
        let b = between(&pair[0], &pair[1], 0.2);
        let (bare, grown) =
            (field.free_along(&pair[0], &b).unwrap(), keeping.free_along(&pair[0], &b).unwrap());
        // What the grown tool may do, the tool may do.
        assert!(grown != Passage::Free || !matches!(bare, Passage::Blocked { .. }));
        differ += usize::from(bare == Passage::Free && grown != Passage::Free);
    }
    assert!(differ > 0);
}

#[test]
fn motions_without_an_answer_say_why() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = GuardedField::new(harmonic(&scene)).unwrap();
    let far = Pose::along(Vec3::splat(1e4), Vec3::Z);
    assert_eq!(field.free_along(&far, &far), Ok(Passage::Free));
    let turned = Pose::along(far.position + 5.0, Vec3::NEG_Z);
    assert_eq!(field.free_along(&far, &turned), Err(MotionError::Opposite));
    let bad = Pose { position: Vec3::NAN, ..far };
    assert_eq!(field.free_along(&far, &bad), Err(MotionError::NoPose));
    let inside = scene.obstacle.solid.iter().position(|&s| s == 1).unwrap();
    let grid = scene.record.grid;
    let inside = Pose::along(grid.centre(grid.voxel(inside)).as_vec3(), Vec3::Z);
    let stands = field.free_along(&inside, &inside).unwrap();
    assert!(matches!(stands, Passage::Blocked { free_until: 0.0, at: 0.0, .. }), "{stands:?}");
}

#[test]
fn motions_to_the_end_of_numbers_are_answered_at_once() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = GuardedField::new(harmonic(&scene)).unwrap();
    let grid = scene.record.grid;
    let inside = Pose::along((grid.origin + 0.5 * grid.size()).as_vec3(), Vec3::Z);
    let outside = Pose { position: inside.position + Vec3::new(0.0, 0.0, 400.0), ..inside };
    let mut decisions = [Decision::Near; 2];
    field.classify(&[inside, outside], &mut decisions).unwrap();
    assert_eq!(decisions, [Decision::Blocked, Decision::Free]);
    // As far as a voxel is told from the next one a way through the part is found, and one away from it is free.
    let far = |distance: f32| Pose { position: inside.position + Vec3::new(0.0, 0.0, distance), ..inside };
    assert_eq!(field.free_along(&outside, &far(1e5)).unwrap(), Passage::Free);
    let through = field.free_along(&far(1e5), &far(-1e5)).unwrap();
    assert!(matches!(through, Passage::Blocked { .. }), "{through:?}");
    for distance in [1e9, 1e20, f32::MAX] {
        // Nothing but the ends is looked at.
        let away = field.free_along(&outside, &far(distance)).unwrap();
        assert_eq!(away, Passage::Unknown { from: 0.0, to: 1.0 });
        let from_within = field.free_along(&inside, &far(distance)).unwrap();
        assert_eq!(from_within, Passage::Blocked { free_until: 0.0, at: 0.0, pose: inside });
        let into = field.free_along(&far(-distance), &inside).unwrap();
        assert_eq!(into, Passage::Blocked { free_until: 0.0, at: 1.0, pose: inside });
    }
}
