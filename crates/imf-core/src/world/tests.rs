//! Worlds against counts by the definition.

use glam::DMat4;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::field::Decision;
use crate::mesh::Mesh;
use crate::parts::ReferencePart;
use crate::scene::Scene;
use crate::section::test_shapes::{line, number, orientations, revolved};
use crate::tool::{ElementKind, ToolShape};

/// A cutter, a wider shank and a holder.
pub(super) fn tool() -> Tool {
    revolved([
        (ElementKind::Cutter, vec![line(0.0, 12.0, 3.0, 3.0)]),
        (ElementKind::Shank, vec![line(12.0, 24.0, 4.0, 4.0)]),
        (ElementKind::Holder(0), vec![line(24.0, 50.0, 10.0, 14.0)]),
    ])
}

/// Poses around the origin.
pub(super) fn poses(count: usize, seed: u64, spread: f64) -> Vec<Pose> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let set = orientations(&format!("random:{count}:{seed}"));
    let pose = |orientation| {
        let at = DVec3::new(number(&mut random), number(&mut random), number(&mut random)) - 0.5;
        Pose::oriented(2.0 * spread * at, orientation)
    };
    set.iter().map(pose).collect()
}

pub(super) fn bracket_scene(dims: [usize; 3]) -> Scene {
    let builder = Scene::builder().reference(ReferencePart::Bracket).dims(dims);
    builder.allow_coarse(true).build().unwrap().scene
}

/// An L of two boxes.
fn bracket() -> Mesh {
    let mut mesh = Mesh::cuboid(DVec3::ZERO, DVec3::new(30.0, 20.0, 8.0));
    mesh.append(&Mesh::cuboid(DVec3::new(0.0, 0.0, 7.0), DVec3::new(8.0, 20.0, 30.0)));
    mesh
}

fn places() -> [Pose; 3] {
    let turn = |axis: DVec3, angle: f64| DQuat::from_axis_angle(axis.normalize(), angle);
    [
        HERE,
        Pose::new(DVec3::new(-25.0, 5.0, 12.0), turn(DVec3::new(1.0, 2.0, -0.5), 1.1)),
        Pose::new(DVec3::new(15.0, -30.0, -9.0), turn(DVec3::Z, -0.4)),
    ]
}

/// Three obstacles, two of them turned, one of another pitch.
pub(super) fn world() -> World {
    let [a, b, c] = places();
    let builder =
        World::builder().pitch(1.0).obstacle(ObstacleMesh { at: a, ..ObstacleMesh::new("a", bracket()) });
    let coarse = ObstacleMesh {
        at: b,
        pitch: Some(1.5),
        conservative: Some(true),
        ..ObstacleMesh::new("b", bracket())
    };
    let inches = Mesh::cuboid(DVec3::ZERO, DVec3::splat(1.0));
    let inch = ObstacleMesh { at: c, scale: 25.4, ..ObstacleMesh::new("c", inches) };
    builder.obstacle(coarse).obstacle(inch).build().unwrap()
}

/// One obstacle, in voxels of a pitch.
pub(super) fn world_of(pitch: f64, obstacle: ObstacleMesh) -> World {
    World::builder().pitch(pitch).obstacle(obstacle).build().unwrap()
}

/// Solid centres in the tool, one obstacle after another, by the definition, in the obstacle's frame by matrices.
fn counted(world: &World, tool: &Tool, pose: &Pose) -> Vec<u32> {
    let count = |standing: &PlacedObstacle| {
        let back = DMat4::from_rotation_translation(standing.at.rotation, standing.at.position).inverse();
        let turned = DQuat::from_mat4(&back) * pose.rotation;
        let local = Pose::new(back.transform_point3(pose.position), turned);
        tool.count_inside(&standing.prepared.obstacle().whole(), local.position, &local.orientation())
    };
    world.obstacles.iter().map(count).collect()
}

#[test]
fn poses_among_placed_obstacles_are_decided_as_counted() {
    let (world, tool) = (world(), tool());
    let checker = world.checker(&tool, &Clearance::default()).unwrap();
    // The tool is examined once for each pitch.
    assert_eq!(*checker.tool.resolved.lock().unwrap(), [1.0, 1.5]);
    let all = poses(2500, 1, 50.0);
    let mut decisions = vec![Decision::Undecided; all.len()];
    checker.classify(&all, &mut decisions).unwrap();
    let mut again = vec![Decision::Undecided; all.len()];
    checker.clone().classify_on_all_threads(&all, &mut again).unwrap();
    assert_eq!(decisions, again);
    let (mut free, mut hit) = (0, [0; 3]);
    for (pose, decision) in all.iter().zip(decisions) {
        let counts = counted(&world, &tool, pose);
        let is_free = counts.iter().all(|&count| count == 0);
        let decided = (decision == Decision::Free, checker.is_free(pose));
        assert_eq!(decided, (is_free, is_free), "{pose:?} {counts:?}");
        let contact = checker.contact(pose).unwrap();
        assert_eq!(contact.is_none(), is_free);
        free += usize::from(is_free);
        if let Some(Contact { obstacle, element, point, depth }) = contact {
            hit[obstacle.0 as usize] += 1;
            assert!(counts[obstacle.0 as usize] > 0);
            // Its point lies in that element.
            let held = tool.element_at(pose, point.unwrap());
            assert!(held == element || held.is_none(), "{held:?} {element:?}");
            assert!(depth >= 0.0);
        }
    }
    assert!(free > 500 && hit.iter().all(|&hit| hit > 100), "{free} {hit:?}");
}

#[test]
fn a_moved_obstacle_is_the_moved_mesh_up_to_voxels() {
    let tool = tool();
    let at = places()[1];
    let moved = bracket().transformed(&DMat4::from_rotation_translation(at.rotation, at.position));
    let of = |mesh: Mesh| world_of(0.8, ObstacleMesh::new("it", mesh));
    let mut turned = of(bracket());
    let id = turned.obstacles().next().unwrap().0;
    // A voxel's centre is solid as the mesh says, and the surface at most half a diagonal from a centre either way.
    let both = 3f64.sqrt() * 0.8;
    let room = Clearance { holder: both, shank: both, cutter: both };
    let mut checkers = [Clearance::default(), room].map(|room| turned.checker(&tool, &room).unwrap());
    turned.place(id, at).unwrap();
    checkers.iter_mut().for_each(|checker| checker.follow(&turned).unwrap());
    let meshed = of(moved);
    let [bare, wide] = [Clearance::default(), room].map(|room| meshed.checker(&tool, &room).unwrap());
    let (mut free, mut differ) = (0, 0);
    for pose in poses(4000, 3, 60.0) {
        let [one, other] = [checkers[0].is_free(&pose), bare.is_free(&pose)];
        assert!(one || !wide.is_free(&pose), "{pose:?}");
        assert!(other || !checkers[1].is_free(&pose), "{pose:?}");
        free += usize::from(one);
        differ += usize::from(one != other);
    }
    assert!(free > 1000 && differ < 100, "{free} {differ}");
}

#[test]
fn a_checker_follows_what_is_moved_added_and_removed() {
    let (mut world, tool) = (world(), tool());
    let none = Clearance::default();
    let mut checker = world.checker(&tool, &none).unwrap();
    let all = poses(700, 4, 45.0);
    let ids: Vec<ObstacleId> = world.obstacles().map(|(id, ..)| id).collect();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for step in 0..6 {
        match step {
            3 => world.remove(ids[1]).unwrap(),
            4 => {
                let more = ObstacleMesh { contact: 0.0, ..ObstacleMesh::new("more", bracket()) };
                assert!(!ids.contains(&world.add(more).unwrap()));
            }
            _ => {
                let turn = DQuat::from_axis_angle(DVec3::Y, 6.0 * number(&mut random));
                let at = 20.0 * DVec3::splat(number(&mut random));
                world.place(ids[(step % 3) & 2], Pose::new(at, turn * 3.0)).unwrap();
            }
        }
        checker.follow(&world).unwrap();
        let anew = world.checker(&tool, &none).unwrap();
        for pose in &all {
            assert_eq!(checker.is_free(pose), anew.is_free(pose), "{pose:?} {step}");
        }
    }
    assert!(matches!(world.remove(ids[1]), Err(WorldError::Unknown(id)) if id == ids[1]));
    assert!(matches!(world.place(ids[1], HERE), Err(WorldError::Unknown(_))));
    assert!(matches!(world.place(ids[0], Pose::new(DVec3::NAN, DQuat::IDENTITY)), Err(WorldError::Place(_))));
    let metres = World::builder().unit(LengthUnit::M).build().unwrap();
    assert!(matches!(checker.follow(&metres), Err(WorldError::Unit { .. })));
}

#[test]
fn what_is_no_obstacle_is_refused_and_what_is_no_pose_is_never_free() {
    let add =
        |mesh: ObstacleMesh| World::builder().pitch(1.0).obstacle(mesh).build().err().unwrap().to_string();
    let of = |mesh: Mesh| ObstacleMesh::new("shelf", mesh);
    // One face: it does not say what is inside.
    let mut sheet = Mesh::cuboid(DVec3::ZERO, DVec3::splat(10.0));
    sheet.triangles.truncate(2);
    assert!(add(of(sheet)).contains("cannot be told apart"));
    assert!(add(of(Mesh::default())).contains("no triangle"));
    // Two plates between the centres.
    let mut plates = Mesh::cuboid(DVec3::ZERO, DVec3::new(9.0, 9.0, 0.1));
    plates.append(&Mesh::cuboid(DVec3::new(0.0, 0.0, 3.9), DVec3::new(9.0, 9.0, 4.0)));
    assert!(add(of(plates)).contains("overlooked"));
    let block = || Mesh::cuboid(DVec3::ZERO, DVec3::splat(10.0));
    assert!(add(ObstacleMesh { scale: 0.0, ..of(block()) }).contains("scaled"));
    assert!(add(ObstacleMesh { contact: -1.0, ..of(block()) }).contains("deep"));
    assert!(add(ObstacleMesh { pitch: Some(f64::NAN), ..of(block()) }).contains("pitch"));
    assert!(add(ObstacleMesh { scale: 1e6, ..of(block()) }).contains("mm"));
    let without = World::builder().obstacle(of(block())).build().err().unwrap();
    assert!(matches!(without, WorldError::NoPitch(_)));
    let coarse = world_of(5.0, of(block()));
    let refused = coarse.checker(&tool(), &Clearance::default()).err().unwrap().to_string();
    assert!(refused.contains("unseen") && refused.contains("shelf"), "{refused}");
    for world in [world(), World::builder().build().unwrap()] {
        let checker = world.checker(&tool(), &Clearance::default()).unwrap();
        let far = Pose::along(DVec3::splat(1e4), DVec3::Z);
        assert!(checker.is_free(&far));
        for bad in [
            Pose { position: DVec3::new(f64::NAN, 0.0, 0.0), ..far },
            Pose { position: DVec3::new(0.0, f64::INFINITY, 0.0), ..far },
            Pose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..far },
            Pose { rotation: DQuat::NAN, ..far },
        ] {
            assert!(!checker.is_free(&bad), "{bad:?}");
            assert_eq!(checker.contact(&bad), Err(QueryError::InvalidPose));
            let motion = checker.check_motion(&bad, &far, &MotionOptions::default());
            assert_eq!(motion, Err(QueryError::InvalidPose));
        }
    }
}

#[test]
fn the_cutter_may_enter_as_deep_as_an_obstacle_allows() {
    let block = Mesh::cuboid(DVec3::ZERO, DVec3::new(40.0, 40.0, 20.0));
    let world = world_of(1.0, ObstacleMesh { contact: 2.0, ..ObstacleMesh::new("block", block) });
    let checker = world.checker(&tool(), &Clearance::default()).unwrap();
    let at = |z: f64| Pose::along(DVec3::new(20.0, 20.0, z), DVec3::Z);
    assert!(checker.is_free(&at(18.0)) && !checker.is_free(&at(17.0)));
    // Shank and holder may not.
    let shank = checker.contact(&at(20.0 - 12.6)).unwrap().unwrap();
    assert!(shank.element == Some(ElementKind::Cutter) || shank.element == Some(ElementKind::Shank));
    let beside = Pose::along(DVec3::new(20.0, -3.2, -16.0), DVec3::Z);
    let hit = checker.contact(&beside).unwrap().unwrap();
    assert_eq!(hit.element, Some(ElementKind::Holder(0)));
    assert!(!checker.is_free(&Pose { position: beside.position + DVec3::Z * 5.0, ..beside }));
}

#[test]
fn a_scenes_checker_counts_its_part_and_its_tool() {
    let scene = bracket_scene([12, 36, 22]);
    let room = Clearance::around_holder_and_shank(2.0);
    let checker = Checker::of_scene(&scene, &room).unwrap();
    let assembly = scene.record.bare_tool().offset(&room).unwrap();
    let grid = scene.record.grid;
    for pose in poses(800, 6, 80.0) {
        let pose = Pose { position: pose.position + grid.origin + 0.5 * grid.size(), ..pose };
        let count = assembly.whole().count_inside(&scene.obstacle, pose.position, &pose.orientation());
        assert_eq!(checker.is_free(&pose), count == 0, "{pose:?}");
    }
}

#[test]
fn warnings_say_what_is_to_be_known_of_meshes() {
    let mut open = Mesh::cuboid(DVec3::ZERO, DVec3::splat(20.0));
    open.triangles.truncate(10);
    let world = world_of(1.0, ObstacleMesh::new("lidless", open));
    let warnings = world.warnings();
    assert!(warnings.iter().any(|w| w.to_string().contains("lidless is open")), "{warnings:?}");
    let thin = Mesh::cuboid(DVec3::ZERO, DVec3::new(20.0, 20.0, 2.0));
    let thin = world_of(1.0, ObstacleMesh::new("plate", thin));
    assert!(thin.warnings().iter().any(|w| matches!(w, SceneWarning::Thin { .. })));
}

#[test]
fn checkers_tell_of_tools_that_are_not_at_their_tip() {
    let block = || ObstacleMesh::new("block", Mesh::cuboid(DVec3::ZERO, DVec3::splat(20.0)));
    let mut world = World::builder().pitch(1.0).build().unwrap();
    let head = Mesh::cuboid(DVec3::new(48.0, -2.0, 100.0), DVec3::new(52.0, 2.0, 109.0));
    let head = Tool { shape: ToolShape::Mesh(head), ..Tool::paper() };
    let [mut paper, mut off] =
        [&Tool::paper(), &head].map(|tool| world.checker(tool, &Clearance::default()).unwrap());
    assert!(off.warnings().is_empty(), "there is nothing to be hit");
    world.add(block()).unwrap();
    world.add(ObstacleMesh { pitch: Some(2.0), ..block() }).unwrap();
    [&mut paper, &mut off].into_iter().for_each(|checker| checker.follow(&world).unwrap());
    assert!(paper.warnings().is_empty());
    let away = 48.0_f64.hypot(100.0);
    assert!(
        matches!(&off.warnings()[..], [SceneWarning::TipOff { distance, .. }] if (distance - away).abs() < 1e-9),
        "{:?}",
        off.warnings()
    );
}
