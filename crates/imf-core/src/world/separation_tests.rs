//! Distances against every voxel, closed forms, and translations that were tried.

use glam::DVec3;

use super::adversary_truth::Case;
use super::tests::{poses, tool, world, world_of};
use super::*;
use crate::mesh::Mesh;
use crate::orientation::Orientation;
use crate::section::test_shapes::{arc, cylinder, orientations, revolved};
use crate::tool::{ElementKind, ToolShape};

#[test]
fn distances_of_free_tools_are_those_of_trying_every_voxel() {
    let (world, tool) = (world(), tool());
    let checker = world.checker(&tool, &Clearance::default()).unwrap();
    let case = Case::new("three obstacles".into(), checker.clone());
    let all: Vec<_> = case.solids.iter().map(|solid| solid.centres.clone()).collect();
    // The checker, from which the case has them, left none out.
    let solid = |standing: &PlacedObstacle| standing.prepared.obstacle().forbidden.count();
    assert!(all.iter().map(Vec::len).eq(world.obstacles.iter().map(solid)));
    let ToolShape::Revolved(elements) = &tool.shape else { panic!() };
    let whole: Vec<_> = elements.iter().flat_map(|element| element.profile.clone()).collect();
    assert!(case.solids.iter().all(|solid| solid.profile == whole));
    let (mut near, mut hit) = (0, [0; 3]);
    for pose in poses(500, 31, 60.0).into_iter().filter(|pose| checker.is_free(pose)) {
        let found = checker.distance(&pose).unwrap().unwrap();
        assert!(case.is_distance(&all, &pose, &found, f64::INFINITY), "{pose:?}: {found:?}");
        let Distance { lower, obstacle, element, tool_point, obstacle_point, .. } = found;
        // Its point is a solid centre of the obstacle that it names, where that stands.
        let PlacedObstacle { at, prepared, .. } = &world.obstacles[obstacle.0 as usize];
        let solid = &prepared.obstacle().forbidden;
        let centre = solid.grid.continuous(at.rotation.inverse() * (obstacle_point - at.position));
        assert!(centre.distance(centre.round()) < 1e-6, "{pose:?}: {centre}");
        assert_eq!(solid.solid[solid.grid.index(centre.round().to_array().map(|v| v as usize))], 1);
        hit[obstacle.0 as usize] += 1;
        near += usize::from(lower < 2.0);
        // A hair into the element from its surface is in the element.
        let inside = tool_point + (tool_point - obstacle_point).normalize() * 1e-6;
        assert!(tool.element_at(&pose, inside).is_none_or(|found| found == element), "{pose:?}");
    }
    assert!(near > 10 && hit.iter().all(|&hit| hit > 20), "{near} {hit:?}");
    let none = World::builder().build().unwrap().checker(&tool, &Clearance::default()).unwrap();
    let far = Pose::along(DVec3::splat(1e3), DVec3::Z);
    assert_eq!(none.distance(&far), Ok(None));
    assert_eq!(checker.distance(&Pose { position: DVec3::NAN, ..far }), Err(QueryError::InvalidPose));
    assert_eq!(checker.distance(&Pose { position: DVec3::splat(1e200), ..far }), Err(QueryError::TooFar));
    let meshed = Tool { shape: ToolShape::Mesh(Mesh::cuboid(DVec3::ZERO, DVec3::splat(9.0))), ..tool };
    let meshed = world.checker(&meshed, &Clearance::default()).unwrap();
    assert_eq!(meshed.distance(&far), Err(QueryError::Mesh));
    let lens = revolved([(ElementKind::Cutter, vec![arc(0.0, 4.0, 2.0, -1.0, 3.0)])]);
    let lens = world.checker(&lens, &Clearance::default()).unwrap();
    assert_eq!(lens.distance(&far), Err(QueryError::Outline));
}

#[test]
fn distances_of_a_cylinder_from_a_box_are_closed_forms() {
    // The outermost centres lie half a voxel inside the faces: the box of centres.
    let block = Mesh::cuboid(DVec3::splat(-0.25), DVec3::new(20.25, 30.25, 10.25));
    let world = world_of(0.5, ObstacleMesh::new("block", block));
    let checker = world.checker(&cylinder(2.0, 30.0), &Clearance::default()).unwrap();
    let at = |x: f64, y: f64, z: f64, axis: DVec3| {
        let found = checker.distance(&Pose::along(DVec3::new(x, y, z), axis)).unwrap().unwrap();
        (found.lower, found.upper)
    };
    let is = |(lower, upper): (f64, f64), expected: f64| {
        assert!(lower == upper && (lower - expected).abs() < 1e-9, "{lower} {upper} {expected}");
    };
    // Above a face, beside it, off its edge, off its corner, and lying above it.
    is(at(10.0, 15.0, 13.0, DVec3::Z), 3.0);
    is(at(-7.0, 15.0, 5.0, DVec3::Z), 5.0);
    is(at(-5.0, 15.0, 14.0, DVec3::Z), 5.0);
    let off = -3.0 - 2.0 / 2f64.sqrt();
    is(at(off, off, 10.0 + 6.0, DVec3::Z), (18.0 + 36.0_f64).sqrt());
    is(at(-5.0, 15.0, 17.0, DVec3::X), 5.0);
}

#[test]
fn depths_lie_between_a_bound_and_a_translation_that_frees() {
    let (world, tool) = (world(), tool());
    let checker = world.checker(&tool, &Clearance::default()).unwrap();
    let ways = orientations("fibonacci:40");
    let ways: Vec<DVec3> = ways.iter().map(Orientation::direction).collect();
    let mut colliding = 0;
    for pose in poses(300, 32, 40.0).into_iter().filter(|pose| !checker.is_free(pose)) {
        let found = checker.distance(&pose).unwrap().unwrap();
        assert!(found.lower <= found.upper && found.upper <= 0.0 && found.lower > -300.0, "{found:?}");
        colliding += 1;
        for way in &ways {
            let moved = Pose { position: pose.position - *way * (found.upper * 0.999), ..pose };
            assert!(!checker.is_free(&moved), "{found:?}");
        }
    }
    assert!(colliding > 60, "{colliding}");
    // A flat end so deep in a slab comes out by that depth.
    let slab = Mesh::cuboid(DVec3::new(-50.5, -50.5, -20.5), DVec3::new(50.5, 50.5, 0.5));
    let world = world_of(1.0, ObstacleMesh::new("slab", slab));
    let checker = world.checker(&cylinder(6.0, 30.0), &Clearance::default()).unwrap();
    for depth in [0.3, 1.7, 5.0, 9.2] {
        let found = checker.distance(&Pose::along(DVec3::new(0.2, 0.1, -depth), DVec3::Z)).unwrap().unwrap();
        assert!(found.lower <= -depth && found.lower > -depth - 0.05, "{depth} {found:?}");
        assert!(found.upper >= -depth && found.upper <= 0.0, "{depth} {found:?}");
    }
}
