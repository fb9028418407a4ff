//! Distances against every voxel, closed forms, and translations that were tried.

use glam::{DVec2, DVec3};

use super::tests::{poses, tool, world};
use super::*;
use crate::mesh::Mesh;
use crate::orientation::{Orientation, OrientationSet};
use crate::section::test_shapes::cylinder;
use crate::tool::{Element, Segment, ToolShape};

/// From a point to a convex body of straight outline, by the four sides of its half section.
fn to_element(element: &Element, height: f64, radius: f64) -> f64 {
    let [Segment::Line { from, to, radius_from, radius_to }] = element.profile[..] else { unreachable!() };
    let point = DVec2::new(height, radius);
    let corners = [(from, 0.0), (from, radius_from), (to, radius_to), (to, 0.0)].map(DVec2::from);
    let inside = (from..=to).contains(&height)
        && radius <= radius_from + (radius_to - radius_from) * (height - from) / (to - from);
    let side = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        let along = ((point - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        point.distance(a + (b - a) * along)
    };
    if inside { 0.0 } else { (0..3).map(side).fold(f64::INFINITY, f64::min) }
}

/// The least over every solid voxel and every element.
fn every_voxel(world: &World, tool: &Tool, pose: &Pose) -> f64 {
    let ToolShape::Revolved(elements) = &tool.shape else { unreachable!() };
    let axis = pose.axis().unwrap();
    let mut least = f64::INFINITY;
    for standing in &world.obstacles {
        let solid = &standing.prepared.obstacle().forbidden;
        for index in (0..solid.solid.len()).filter(|&index| solid.solid[index] == 1) {
            let centre =
                standing.at.position + standing.at.rotation * solid.grid.centre(solid.grid.voxel(index));
            let offset = centre - pose.position;
            let height = offset.dot(axis);
            let radius = (offset - axis * height).length();
            least = elements.iter().map(|e| to_element(e, height, radius)).fold(least, f64::min);
        }
    }
    least
}

#[test]
fn distances_of_free_tools_are_those_of_trying_every_voxel() {
    let (world, tool) = (world(), tool());
    let checker = world.checker(&tool, &Clearance::default()).unwrap();
    let (mut near, mut hit) = (0, [0; 3]);
    for pose in poses(500, 31, 60.0).into_iter().filter(|pose| checker.is_free(pose)) {
        let Distance { lower, upper, obstacle, element, tool_point, obstacle_point } =
            checker.distance(&pose).unwrap().unwrap();
        let expected = every_voxel(&world, &tool, &pose);
        assert_eq!(lower, upper);
        assert!((lower - expected).abs() < 1e-6, "{pose:?}: {lower}, {expected}");
        assert!((tool_point.distance(obstacle_point) - lower).abs() < 1e-6);
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
    let meshed = Tool { shape: ToolShape::Mesh(Mesh::cuboid(DVec3::ZERO, DVec3::splat(9.0))), ..tool };
    let meshed = world.checker(&meshed, &Clearance::default()).unwrap();
    assert_eq!(meshed.distance(&far), Err(QueryError::Mesh));
}

#[test]
fn distances_of_a_cylinder_from_a_box_are_closed_forms() {
    // The outermost centres lie half a voxel inside the faces: the box of centres.
    let block = Mesh::cuboid(DVec3::splat(-0.25), DVec3::new(20.25, 30.25, 10.25));
    let world = World::builder().pitch(0.5).obstacle(ObstacleMesh::new("block", block)).build().unwrap();
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
    is(
        at(-3.0 - 2.0 / 2f64.sqrt(), -3.0 - 2.0 / 2f64.sqrt(), 10.0 + 6.0, DVec3::Z),
        (18.0 + 36.0_f64).sqrt(),
    );
    is(at(-5.0, 15.0, 17.0, DVec3::X), 5.0);
}

#[test]
fn depths_lie_between_a_bound_and_a_translation_that_frees() {
    let (world, tool) = (world(), tool());
    let checker = world.checker(&tool, &Clearance::default()).unwrap();
    let ways = OrientationSet::parse("fibonacci:40").unwrap().orientations;
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
    let world = World::builder().pitch(1.0).obstacle(ObstacleMesh::new("slab", slab)).build().unwrap();
    let checker = world.checker(&cylinder(6.0, 30.0), &Clearance::default()).unwrap();
    for depth in [0.3, 1.7, 5.0, 9.2] {
        let found = checker.distance(&Pose::along(DVec3::new(0.2, 0.1, -depth), DVec3::Z)).unwrap().unwrap();
        assert!(found.lower <= -depth && found.lower > -depth - 0.05, "{depth} {found:?}");
        assert!(found.upper >= -depth && found.upper <= 0.0, "{depth} {found:?}");
    }
}
