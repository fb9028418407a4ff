//! A planner's decisions against exact counts.

use glam::{DQuat, DVec3};

use crate::field::Planner;
use crate::field::scenes::{harmonic, poses, scene};
use crate::field::tests::{ROUNDING, values};
use imf_core::field::{Best, Decision, PoseField};
use imf_core::pose::Pose;
use imf_core::tool::Tool;

#[test]
fn planners_say_free_where_the_true_tool_is_free_and_nowhere_else() {
    for clearance in [0.0, 1.5] {
        let scene = scene(&Tool::paper(), clearance);
        let planner = Planner::new(harmonic(&scene)).unwrap();
        let keeping = Planner::with_clearance(harmonic(&scene), scene.record.clearance).unwrap();
        let asked = poses(&scene, 4000, 11);
        let (mut decisions, mut kept) = (vec![Decision::Undecided; 4000], vec![Decision::Undecided; 4000]);
        planner.classify(&asked, &mut decisions).unwrap();
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
        planner.best(&points, &rotations, &mut best).unwrap();
        let model = &planner.model;
        for (&point, best) in points.iter().zip(&best) {
            let all: Vec<Pose> = rotations.iter().map(|&r| Pose::new(point, r)).collect();
            let mut decided = vec![Decision::Undecided; all.len()];
            planner.classify(&all, &mut decided).unwrap();
            let free = decided.contains(&Decision::Free);
            assert_eq!(best.decision == Decision::Free, free);
            let of = values(model, &all);
            let least = of.iter().zip(&decided).filter(|(_, d)| !free || **d == Decision::Free);
            let least = least.map(|(v, _)| *v).fold(f32::INFINITY, f32::min);
            assert!((best.value - least).abs() < ROUNDING);
        }
    }
}
