//! Worlds and scenes that are given what they cannot take, and pools of many threads.

use std::sync::Arc;

use super::tests::{poses, tool, world_of};
use super::*;
use crate::field::Decision;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::scene::Scene;
use crate::section::test_shapes::{line, revolved};
use crate::tool::{ElementKind, Segment, SharpPoints, ToolShape};

fn block() -> Mesh {
    Mesh::cuboid(DVec3::ZERO, DVec3::splat(40.0))
}

/// The block, of which a cutter may enter so deep a layer.
fn world_with(contact: f64, pitch: f64) -> World {
    world_of(pitch, ObstacleMesh { contact, ..ObstacleMesh::new("block", block()) })
}

fn mesh_tool() -> Tool {
    let body = Mesh::cuboid(DVec3::new(-5.0, -5.0, 0.0), DVec3::new(5.0, 5.0, 60.0));
    Tool { name: "body".into(), shape: ToolShape::Mesh(body), sharp_points: SharpPoints::Tip, ..tool() }
}

/// While a thread waits for a part of what is made on all threads it may be given work that needs the same.
#[cfg(feature = "parallel")]
#[test]
fn many_threads_ask_a_new_checker_at_once() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(16).build().unwrap();
    let asked = poses(3_000, 5, 30.0);
    for _ in 0..12 {
        let checker = world_with(0.0, 1.0).checker(&tool(), &Clearance::default()).unwrap();
        let mut decisions = vec![Decision::Undecided; asked.len()];
        pool.install(|| {
            use rayon::prelude::*;
            let all: Vec<_> =
                asked.par_iter().with_max_len(1).map(|pose| checker.distance(pose).is_ok()).collect();
            assert!(all.iter().all(|&is_ok| is_ok));
            checker.clone().classify_on_all_threads(&asked, &mut decisions).unwrap();
        });
        for (pose, decision) in asked.iter().zip(&decisions) {
            assert_eq!(*decision == Decision::Free, checker.is_free(pose));
        }
    }
}

#[test]
fn a_mesh_that_names_no_cutter_stays_out_of_what_a_cutter_may_enter() {
    let world = world_with(4.0, 1.0);
    let on_top = Pose::new(DVec3::new(20.0, 20.0, 37.5), DQuat::IDENTITY);
    let checker = world.checker(&mesh_tool(), &Clearance::default()).unwrap();
    assert!(!checker.is_free(&on_top));
    // The cutter of a tool that names one may, by the depth and no more.
    let checker = world.checker(&tool(), &Clearance::default()).unwrap();
    assert!(checker.is_free(&on_top));
    assert!(!checker.is_free(&Pose { position: on_top.position - 4.0 * DVec3::Z, ..on_top }));
    let scene = Scene::builder().part("block", block(), LengthUnit::Mm).pitch(1.0);
    let refused = scene.tool(&mesh_tool()).contact(4.0).build().unwrap_err();
    assert!(matches!(refused, SceneError::NoCutter(_)), "{refused}");
}

#[test]
fn a_depth_that_is_no_length_is_refused() {
    for depth in [-5.0, f64::NAN, f64::INFINITY] {
        let scene = Scene::builder().part("block", block(), LengthUnit::Mm).pitch(1.0).tool(&tool());
        assert!(matches!(scene.contact(depth).build(), Err(SceneError::Contact(_))), "{depth}");
    }
}

#[test]
fn a_disc_between_the_centres_is_refused() {
    let saw = |thick: f64| {
        revolved([
            (ElementKind::Cutter, vec![line(0.0, thick, 30.0, 30.0)]),
            (ElementKind::Shank, vec![line(thick, 60.0, 6.0, 6.0)]),
        ])
    };
    let world = world_with(0.0, 2.0);
    let thin = world.checker(&saw(1.0), &Clearance::default()).map(|_| ()).unwrap_err().to_string();
    assert!(thin.contains("cutter") && thin.contains("a pitch of at most 1,"), "{thin}");
    assert!(thin.starts_with("at the obstacle '"), "{thin}");
    // As thick as a voxel it is seen wherever it stands along its axis.
    let checker = world.checker(&saw(2.0), &Clearance::default()).unwrap();
    for step in 0..40 {
        let at = DVec3::new(20.0, -25.0, 10.0 + 0.05 * f64::from(step));
        assert!(!checker.is_free(&Pose::new(at, DQuat::IDENTITY)), "{at}");
    }
    // A pitch is chosen that sees it.
    let scene = Scene::builder().part("block", block(), LengthUnit::Mm).tool(&saw(0.6)).build().unwrap();
    assert!(scene.scene.record.grid.pitch <= 0.6, "{:?}", scene.scene.record.grid);
}

#[test]
fn a_checker_that_follows_sees_the_layer_that_is_gone_or_new() {
    let mut world = world_with(4.0, 1.0);
    let shank = Pose::new(DVec3::new(20.0, -2.0, 20.0), DQuat::IDENTITY);
    let mut checker = world.checker(&tool(), &Clearance::default()).unwrap();
    assert!(!checker.is_free(&shank));
    let layer = world.obstacles[0].prepared.obstacle().cuttable.clone().unwrap();
    let gone: Vec<usize> = (0..layer.solid.len()).filter(|&voxel| layer.solid[voxel] == 1).collect();
    world.change(world.obstacles[0].id, &[], &gone, &mut []).unwrap();
    checker.follow(&world).unwrap();
    let anew = world.checker(&tool(), &Clearance::default()).unwrap();
    assert!(anew.is_free(&shank) && checker.is_free(&shank));
    // The same voxels, once without a layer and once with one.
    let forbidden = Arc::new(Occupancy { grid: layer.grid, solid: vec![0; layer.solid.len()] });
    let mut bare = World::builder().world;
    bare.add_voxels("a", Obstacle { forbidden: forbidden.clone(), cuttable: None }, HERE).unwrap();
    let mut layered = World::builder().world;
    layered.add_voxels("a", Obstacle { forbidden, cuttable: Some(layer) }, HERE).unwrap();
    let mut checker = bare.checker(&tool(), &Clearance::default()).unwrap();
    assert!(checker.is_free(&shank));
    checker.follow(&layered).unwrap();
    assert!(!checker.is_free(&shank));
}

#[test]
fn what_is_no_mesh_no_voxels_and_no_outline_is_refused() {
    let mut far = block();
    far.triangles[3][1] = 800;
    let mut odd = block();
    odd.vertices[2].y = f64::NAN;
    for mesh in [far, odd] {
        let refused = World::builder().pitch(1.0).obstacle(ObstacleMesh::new("m", mesh.clone())).build();
        assert!(matches!(refused, Err(WorldError::Mesh(SceneError::Unsound(_)))));
        let scene = Scene::builder().part("m", mesh, LengthUnit::Mm).pitch(1.0).tool(&tool());
        assert!(matches!(scene.build(), Err(SceneError::Unsound(_))));
    }
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] };
    let other = Arc::new(Occupancy::empty(Grid { pitch: 2.0, ..grid }));
    let full = Arc::new(Occupancy { grid, solid: vec![1; 64] });
    let wrong = [
        Obstacle::from(Arc::new(Occupancy { grid, solid: vec![255; 64] })),
        Obstacle::from(Arc::new(Occupancy { grid, solid: vec![1; 63] })),
        Obstacle { forbidden: full, cuttable: Some(other) },
    ];
    for obstacle in wrong {
        let refused = World::builder().world.add_voxels("v", obstacle, HERE);
        assert!(matches!(refused, Err(WorldError::Voxels(_))));
    }
    for wrong in [
        Grid { origin: DVec3::new(f64::NAN, 0.0, 0.0), ..grid },
        Grid { pitch: 0.0, ..grid },
        Grid { pitch: -1.0, ..grid },
    ] {
        let voxels = Arc::new(Occupancy { grid: wrong, solid: vec![1; 64] });
        let refused = World::builder().world.add_voxels("v", voxels, HERE).unwrap_err().to_string();
        assert!(refused.contains("the obstacle 'v'"), "{refused}");
    }
    let fine = ObstacleMesh { pitch: Some(1e-9), ..ObstacleMesh::new("fine", block()) };
    let refused = World::builder().obstacle(fine).build().map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("the obstacle 'fine'"), "{refused}");
    let backwards = [line(0.0, 12.0, 3.0, 3.0), line(5.0, 24.0, 3.0, 3.0)];
    let line = |from, to| Segment::cylinder(from, to, 3.0);
    let gap = vec![line(0.0, 12.0), line(12.1, 24.0)];
    for profile in [backwards.to_vec(), vec![line(12.0, 0.0)], vec![line(12.0, 24.0), line(0.0, 12.0)], gap] {
        let refused = revolved([(ElementKind::Cutter, profile)]).check().unwrap_err();
        assert!(refused.to_string().contains("does not run upwards without gaps"), "{refused}");
    }
}

#[test]
fn an_obstacle_that_is_parked_far_away_changes_nothing_for_motions() {
    let mut world = world_with(0.0, 1.0);
    let clamp = world.add(ObstacleMesh::new("clamp", block())).unwrap();
    world.place(clamp, Pose::new(DVec3::new(1e13, 0.0, 0.0), DQuat::IDENTITY)).unwrap();
    let checker = world.checker(&tool(), &Clearance::default()).unwrap();
    let at = |x: f64, z: f64| Pose::new(DVec3::new(x, 20.0, z), DQuat::IDENTITY);
    let motion = |a: Pose, b: Pose| checker.check_motion(&a, &b, &MotionOptions::default());
    let (above, through) = (motion(at(-60.0, 42.0), at(60.0, 42.0)), motion(at(-60.0, 10.0), at(60.0, 10.0)));
    assert!(above.unwrap().is_proven() && !through.unwrap().is_free());
    let there = motion(at(-60.0, 42.0), at(2e13, 42.0));
    assert!(matches!(there, Err(QueryError::TooFar)), "{there:?}");
    let wrong = MotionOptions { resolution: Some(f64::NAN) };
    let empty = World::builder().build().unwrap().checker(&tool(), &Clearance::default()).unwrap();
    assert!(empty.check_motion(&at(0.0, 0.0), &at(1.0, 0.0), &wrong).is_err());
}

#[test]
fn a_tool_below_its_tip_is_told_and_an_element_without_height_refused() {
    let below = revolved([(ElementKind::Cutter, vec![Segment::cylinder(-40.0, 0.0, 5.0)])]);
    let checker = world_with(0.0, 1.0).checker(&below, &Clearance::default()).unwrap();
    let told = checker.warnings();
    assert!(told.iter().any(|warning| matches!(warning, SceneWarning::UpsideDown(_))), "{told:?}");
    // The origin in the middle of the ball, as some programs have it.
    for (from, is_told) in [(-5.0, true), (0.0, false)] {
        let ball = revolved([(ElementKind::Cutter, vec![Segment::cylinder(from, 20.0, 5.0)])]);
        let checker = world_with(0.0, 1.0).checker(&ball, &Clearance::default()).unwrap();
        let told = checker.warnings();
        let of_tip = |warning: &SceneWarning| matches!(warning, SceneWarning::BelowTip { depth: 5.0, .. });
        assert_eq!(told.iter().any(of_tip), is_told, "{told:?}");
    }
    let cutter = || vec![Segment::cylinder(0.0, 20.0, 5.0)];
    for (shank, said) in [(vec![], "no outline"), (vec![Segment::cylinder(20.0, 20.0, 5.0)], "no height")] {
        let refused = revolved([(ElementKind::Cutter, cutter()), (ElementKind::Shank, shank)]).check();
        assert!(refused.unwrap_err().to_string().contains(said), "{said}");
    }
}
