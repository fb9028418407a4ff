//! Batches against single decisions, which are counts' twins.

use glam::{DQuat, DVec3};

use super::tests::{awkward, field_of, half, random_pose};
use super::*;
use std::sync::Arc;

use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::parts::ReferencePart;
use crate::section::test_shapes::{arc, archs, line, revolved};
use crate::tool::{Clearance, ElementKind};

/// Batches decide as single poses do; how many are free.
fn agree(field: &SolidField, poses: &[Pose]) -> usize {
    let mut colliding = vec![false; poses.len()];
    field.collide_all(poses, &mut colliding);
    for (pose, colliding) in poses.iter().zip(&colliding) {
        assert_eq!(*colliding, field.collides(pose), "{pose:?}");
    }
    colliding.iter().filter(|colliding| !**colliding).count()
}

#[test]
fn batches_decide_as_single_poses_do() {
    for (seed, part) in ReferencePart::ALL.into_iter().enumerate() {
        for tool in [Tool::paper(), awkward()] {
            let scene = half(part, &tool);
            let field = field_of(&scene);
            let poses: Vec<Pose> =
                (0..30_011).map(|index| random_pose(&scene.record.grid, seed + 7, index)).collect();
            let free = agree(&field, &poses);
            assert!(free > 1000 && free < 29_000, "{free}");
        }
    }
}

#[test]
fn slender_tools_and_slices_of_balls_are_decided_as_they_are_counted() {
    let tools = [
        // More bounding spheres than bits.
        vec![line(0.0, 300.0, 0.8, 0.8)],
        // A slice of a ball, and a cap under a shank as wide that is not a ball's flank.
        vec![arc(4.0, 12.0, 8.0, 0.0, 8.0)],
        vec![arc(0.0, 6.0, 10.0, 0.0, 10.0), line(6.0, 30.0, 9.0, 9.0)],
        // A dome as flat as a lens on a cone.
        vec![arc(0.0, 1.0, 60.0, 0.0, 60.0), line(1.0, 12.0, 10.9, 3.0)],
    ];
    for profile in tools {
        let tool = revolved([(ElementKind::Cutter, profile)]);
        let scene = half(ReferencePart::Bracket, &Tool::paper());
        let field = SolidField::of_tool(Arc::new(scene.obstacle.clone()), &tool);
        let poses: Vec<Pose> = (0..4000).map(|index| random_pose(&scene.record.grid, 9, index)).collect();
        let free = agree(&field, &poses);
        assert!(free > 200 && free < 3800, "{free}");
        for pose in &poses {
            let count = field.count(pose).unwrap();
            assert_eq!(field.collides(pose), count > 0, "{:?} {pose:?}", tool.shape);
            // What has room is not reached.
            assert!(
                count == 0 || field.clearance_up_to(pose, f64::INFINITY).unwrap() <= 0.0,
                "{:?} {pose:?}",
                tool.shape
            );
        }
    }
}

#[test]
fn batches_of_odd_poses_and_tools_decide_as_single_ones() {
    let tool = Tool::paper();
    let scene = half(ReferencePart::Teapot, &tool);
    let room = Clearance { holder: 3.0, shank: 2.0, cutter: 1.0 };
    let wide = tool.with_clearance(&room).unwrap();
    let grid = scene.record.grid;
    let mut poses: Vec<Pose> = (0..700).map(|index| random_pose(&grid, 3, index)).collect();
    for (index, pose) in poses.iter_mut().enumerate() {
        match index % 9 {
            0 => pose.rotation *= 3.0,
            1 => pose.position += DVec3::X * 1e9,
            2 => pose.position.y = f64::NAN,
            3 => pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
            4 => pose.position.z = f64::NEG_INFINITY,
            5 => pose.rotation.x = f64::NAN,
            _ => {}
        }
    }
    for arch in archs() {
        for tool in [&tool, &wide] {
            let field = SolidField { arch, ..SolidField::of_tool(Arc::new(scene.obstacle.clone()), tool) };
            agree(&field, &poses);
            // What collides already stays so, and is not checked.
            let mut colliding = vec![true; poses.len()];
            field.collide_all(&poses, &mut colliding);
            assert!(colliding.iter().all(|colliding| *colliding));
        }
    }
    // Nothing solid, and a voxel so fine that bytes count whole ones.
    let empty = SolidField::of_tool(Arc::new(Occupancy::empty(grid)), &tool);
    agree(&empty, &poses);
    let fine = Grid { origin: DVec3::ZERO, pitch: 0.12, dims: [40, 30, 50] };
    let solid = Occupancy::of(fine, |voxel| fine.index(voxel).is_multiple_of(37));
    let field = SolidField::of_tool(Arc::new(solid), &tool);
    let poses: Vec<Pose> = (0..3000)
        .map(|index| {
            let pose = random_pose(&grid, 5, index);
            Pose { position: 0.9 * (pose.position - grid.origin), ..pose }
        })
        .collect();
    agree(&field, &poses);
}

#[test]
fn a_centre_within_the_slack_of_a_cones_tip_is_counted_and_decided_as_the_predicate_says() {
    let tool = revolved([(ElementKind::Cutter, vec![line(0.0, 0.6, 0.0, 0.6), line(0.6, 3.6, 0.6, 0.6)])]);
    let grid = Grid { origin: DVec3::ZERO, pitch: 0.3, dims: [9, 9, 9] };
    let solid = Occupancy::of(grid, |voxel| voxel.iter().sum::<usize>() == 12);
    let field = SolidField::of_tool(Arc::new(solid), &tool);
    // The lines of voxels pass 3e-5 of a voxel from the tip, flatter than the cone.
    let steep = DQuat::from_xyzw(
        -0.17550625350188145,
        -0.9259958163365746,
        -6.598574826391994e-18,
        0.3342593351110698,
    );
    let pose = Pose {
        position: DVec3::new(1.6499953837413686, 0.7499921476917026, 1.6500026578068918),
        rotation: steep,
    };
    assert_eq!(tool.count_inside(field.voxels().occupancy(), pose.position, &pose.orientation()), 1);
    let mut colliding = [false; 16];
    field.collide_all(&[pose; 16], &mut colliding);
    assert_eq!((field.count(&pose), field.collides(&pose), colliding), (Some(1), true, [true; 16]));
}
