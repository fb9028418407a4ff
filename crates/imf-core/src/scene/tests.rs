use std::sync::LazyLock;

use glam::DVec3;

use super::*;
use crate::control::Control;
use crate::mesh::tests::unit_cube;
use crate::parts::ReferencePart;
use crate::section::test_shapes::{cylinder, revolved};
use crate::tool::{Clearance, ElementKind, Segment};

static CUBE: LazyLock<Mesh> = LazyLock::new(unit_cube);
static TOOL: LazyLock<Tool> = LazyLock::new(Tool::paper);
static CLAMP: LazyLock<Mesh> =
    LazyLock::new(|| Mesh::cuboid(DVec3::new(-6.0, 1.0, 4.0), DVec3::new(10.0, 3.0, 5.0)));

/// A cube of 4 mm, held by a clamp that lies on it and sticks out 6 mm to either side.
fn spec<'a>(fixtures: &'a [Fixture<'a>]) -> SceneSpec<'a> {
    SceneSpec {
        part: "cube",
        transform: DMat4::from_scale(DVec3::splat(4.0)),
        resolution: Resolution::Pitch(0.5),
        allow_coarse: false,
        fixtures,
        ..SceneSpec::of_reference(ReferencePart::Bracket, &CUBE, [1; 3], &TOOL)
    }
}

fn clamp() -> Fixture<'static> {
    Fixture { name: "clamp", mesh: &CLAMP, transform: DMat4::IDENTITY }
}

#[test]
fn a_transform_with_another_last_row_is_refused() {
    let transform = DMat4::from_translation(DVec3::new(2.0, 3.0, 0.0));
    let (transposed, doubled) = (transform.transpose(), transform * 2.0);
    let of_part = SceneSpec { transform: transposed, ..spec(&[]) };
    let refusal = of_part.scene().unwrap_err().to_string();
    assert!(refusal.contains("'cube'") && refusal.ends_with("row 2 3 0 1: it is transposed"), "{refusal}");
    let fixtures = [Fixture { transform: doubled, ..clamp() }];
    let refusal = spec(&fixtures).scene().unwrap_err().to_string();
    assert!(refusal.contains("'clamp'") && refusal.ends_with("row 0 0 0 2"), "{refusal}");
}

#[test]
fn a_transform_that_changes_the_shape_is_refused() {
    let scaled = |x: f64, y: f64, z: f64| DMat4::from_scale(DVec3::new(x, y, z));
    for (transform, words) in [
        (scaled(2.0, 1.0, 1.0), "scales by 2, 1 and 1"),
        (scaled(0.0, 0.0, 0.0), "scales by 0, 0 and 0"),
        (scaled(-1.0, 1.0, 1.0), "mirrors"),
        (DMat4 { y_axis: DVec3::new(0.6, 0.8, 0.0).extend(0.0), ..DMat4::IDENTITY }, "shears"),
    ] {
        let of_part = SceneSpec { transform, ..spec(&[]) };
        let refusal = of_part.scene().unwrap_err().to_string();
        assert!(refusal.contains("'cube'") && refusal.contains(words), "{refusal}");
        let fixtures = [Fixture { transform, ..clamp() }];
        let refusal = spec(&fixtures).scene().unwrap_err().to_string();
        assert!(refusal.contains("'clamp'") && refusal.contains(words), "{refusal}");
    }
    // A turned clamp in inches.
    let inches = DMat4::from_rotation_z(0.3) * DMat4::from_scale(DVec3::splat(1.0 / 25.4));
    let fixtures = [Fixture { transform: inches, ..clamp() }];
    assert!(!matches!(spec(&fixtures).scene(), Err(SceneError::Transform { .. })));
}

#[test]
fn fixtures_are_apart_and_part_of_the_obstacle() {
    let fixtures = [clamp()];
    let narrow = spec(&fixtures);
    assert!(matches!(narrow.scene(), Err(SceneError::FixtureOutside(name)) if name == "clamp"));
    let wide = SceneSpec { around: GridExtent::All, ..narrow };
    let (scene, bodies) = wide.scene_alone().unwrap();
    assert_eq!(scene.record.grid.dims, [32, 8, 10]);
    assert_eq!((scene.obstacle.count(), bodies.all_fixtures().count()), (512 + 256, 256));
    assert_eq!(scene.record.fixtures, ["clamp"]);
}

#[test]
fn scenes_differ_in_what_a_field_depends_on() {
    let (scene, bodies) = spec(&[]).scene_alone().unwrap();
    let mut named = scene.clone();
    named.record.part = "the same cube".into();
    assert!(scene.differences(&named).is_empty());
    let mut pocket = scene.clone();
    pocket.obstacle.solid[0] = 0;
    let mut with_tool = scene.clone();
    with_tool.record.tool = cylinder(2.0, 9.0);
    let coarser = SceneSpec { resolution: Resolution::Pitch(1.0), ..spec(&[]) };
    let held = scene.clone().with_contact(&bodies, 0.5);
    let mut clamped = held.clone();
    clamped.layer = Some(Occupancy::empty(clamped.record.grid));
    for (one, other, what) in [
        (&scene, &pocket, "the part's voxels differ"),
        (&scene, &with_tool, "the tool differs"),
        (&scene, &coarser.scene_alone().unwrap().0, "the grid differs"),
        (
            &scene,
            &scene.clone().with_clearance(&Clearance::around_holder_and_shank(1.0)).unwrap(),
            "the clearance differs",
        ),
        (&scene, &held, "the contact differs"),
        (&held, &clamped, "the contact differs"),
    ] {
        assert_eq!(one.differences(other), [what]);
    }
}

#[test]
fn a_fixture_on_the_grids_face_makes_the_same_scene_alone_and_among_bodies() {
    let fixtures = [clamp()];
    let spec = SceneSpec { around: GridExtent::All, conservative: true, ..spec(&fixtures) };
    let alone = spec.scene().unwrap();
    let (among, bodies) = spec.scene_and_bodies(100.0).unwrap();
    assert_eq!(among, alone);
    // Nothing is solid beside the grid, whose faces the surfaces touch.
    assert_eq!(bodies.obstacle(), alone.obstacle);
}

#[test]
fn what_sticks_out_counts_as_far_as_the_tool_reaches() {
    let fixtures = [clamp()];
    let spec = spec(&fixtures);
    let query = spec.grid().unwrap();
    assert_eq!(query.dims, [8; 3]);
    let all = spec.bodies(&spec.obstacle_grid(&query, 100.0).unwrap()).unwrap();
    assert_eq!((all.part.count(), all.all_fixtures().count()), (512, 256));
    assert!(query.offset_of(&all.part.grid).is_some());
    // 2 mm of reach and two voxels of room leave 3 mm on each side.
    let near = spec.bodies(&spec.obstacle_grid(&query, 2.0).unwrap()).unwrap();
    assert_eq!(near.part.count(), 512);
    assert!((160..256).contains(&near.all_fixtures().count()), "{}", near.all_fixtures().count());
}

#[test]
fn a_scene_may_stand_among_fixtures_that_stick_out() {
    let fixtures = [clamp()];
    let spec = spec(&fixtures);
    let (scene, bodies) = spec.scene_and_bodies(f64::INFINITY).unwrap();
    assert_eq!((scene.record.grid.dims, bodies.all_fixtures().count()), ([8; 3], 256));
    assert_eq!(scene.obstacle, bodies.obstacle().on(&scene.record.grid).unwrap());
    // The clamp stands on the cube, above its grid.
    assert_eq!(scene.obstacle.count(), 512);
    let wide = |reach: f64| spec.wide_grid(&scene.record.grid, reach).unwrap();
    assert!(spec.fixtures_out_of(&wide(1.0)).unwrap().is_empty());
    let far = [Fixture { transform: DMat4::from_translation(DVec3::new(0.0, 90.0, 0.0)), ..clamp() }];
    let far = SceneSpec { fixtures: &far, ..spec.clone() };
    assert_eq!(far.fixtures_out_of(&far.wide_grid(&scene.record.grid, 10.0).unwrap()).unwrap(), ["clamp"]);
    let alone = SceneSpec { fixtures: &[], ..spec };
    let (scene, bodies) = alone.scene_and_bodies(100.0).unwrap();
    assert_eq!((&scene, bodies.obstacle()), (&alone.scene().unwrap(), scene.obstacle.clone()));
}

#[test]
fn a_fixture_between_the_centres_is_refused() {
    let mesh = Mesh::cuboid(DVec3::ZERO, DVec3::new(2.0, 2.0, 0.1));
    let plate = |z: f64| Fixture {
        name: "plate",
        mesh: &mesh,
        transform: DMat4::from_translation(DVec3::new(0.5, 0.5, z)),
    };
    // Centres stand at 0.25 and 0.75 above every millimetre.
    let thin = [plate(1.4)];
    let thin = spec(&thin);
    assert!(matches!(thin.scene(), Err(SceneError::ThinFixture { fixture, .. }) if fixture == "plate"));
    // Its faces lie on those of voxels, which are touched from both sides.
    let count = |spec: &SceneSpec<'_>| spec.scene_alone().unwrap().1.all_fixtures().count();
    assert_eq!(count(&SceneSpec { conservative: true, ..thin }), 6 * 6 * 2);
    assert_eq!(count(&spec(&[plate(1.2)])), 4 * 4);
}

#[test]
fn records_of_older_files_have_no_fixtures() {
    let record = spec(&[]).scene().unwrap().record;
    let text = serde_json::to_string(&record).unwrap();
    assert!(!text.contains("fixtures") && !text.contains("clearance") && !text.contains("bare_tool"));
    assert_eq!(serde_json::from_str::<SceneRecord>(&text).unwrap(), record);
}

#[test]
fn a_clearance_offsets_the_tool_and_is_written_down() {
    let scene = spec(&[]).scene().unwrap();
    let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.0 };
    let offset = scene.clone().with_clearance(&clearance).unwrap();
    let record = &offset.record;
    assert_eq!((record.bare_tool(), record.clearance), (&*TOOL, clearance));
    assert_eq!(record.tool, TOOL.with_clearance(&clearance).unwrap());
    let text = serde_json::to_string(record).unwrap();
    assert_eq!(&serde_json::from_str::<SceneRecord>(&text).unwrap(), record);
    // Another clearance starts from the tool as it is; none gives the scene back.
    assert_eq!(offset.clone().with_clearance(&clearance).unwrap(), offset);
    assert_eq!(offset.with_clearance(&Clearance::default()).unwrap(), scene);
    assert!(scene.with_clearance(&Clearance { holder: f64::NAN, ..clearance }).is_err());
}

#[test]
fn conservative_grids_hold_every_voxel_that_the_surface_touches() {
    let mesh = Mesh::cuboid(DVec3::ZERO, DVec3::new(20.0, 20.0, 2.0));
    let wall = |resolution: Resolution, margin: usize| SceneSpec {
        mesh: &mesh,
        transform: DMat4::IDENTITY,
        resolution,
        margin,
        conservative: true,
        ..spec(&[])
    };
    // Every face lies on voxels' faces, which are touched from both sides.
    for margin in 0..3 {
        let bodies = wall(Resolution::Pitch(1.0), margin);
        let scene = bodies.scene().unwrap();
        assert_eq!(scene.obstacle.count(), 22 * 22 * 4, "margin {margin}");
    }
    // So many voxels are so many: their pitch gives way.
    let dims = wall(Resolution::Dims([20, 20, 2]), 0);
    let scene = dims.scene().unwrap();
    assert_eq!((scene.record.grid.dims, scene.obstacle.count()), ([20, 20, 2], 800));
    let wider = scene.record.grid.padded([2; 3], [2; 3]).unwrap();
    assert_eq!(dims.bodies(&wider).unwrap().part.count(), 800);
}

#[test]
fn fixtures_that_overlap_the_part_are_warned_about_with_the_volume() {
    let clamp = clamp();
    let sunk = [Fixture { transform: DMat4::from_translation(DVec3::new(0.0, 0.0, -0.5)), ..clamp.clone() }];
    for conservative in [false, true] {
        let told = |fixtures: &[Fixture<'_>]| {
            let spec = SceneSpec { conservative, around: GridExtent::All, ..spec(fixtures) };
            let (_, bodies) = spec.scene_alone().unwrap();
            spec.warnings(&bodies).unwrap()
        };
        // It lies on the cube: their faces touch.
        assert_eq!(told(std::slice::from_ref(&clamp)), []);
        // Half a millimetre deep, on 4 by 2 mm.
        let overlap = SceneWarning::Overlap { fixture: "clamp".into(), volume: 4.0, unit: LengthUnit::Mm };
        assert_eq!(told(&sunk), [overlap]);
    }
}

#[test]
fn what_the_grid_cannot_resolve_is_refused_or_warned_about() {
    let scaled = |edge: f64, pitch: f64| SceneSpec {
        transform: DMat4::from_scale(DVec3::splat(edge)),
        resolution: Resolution::Pitch(pitch),
        ..spec(&[])
    };
    let coarse = scaled(80.0, 8.0);
    let refusal = coarse.scene().unwrap_err();
    let text = refusal.to_string();
    assert!(matches!(refusal, SceneError::Coarse(_)), "{text}");
    let words = ["cutter", "paper", "10 mm thick", "8 mm unseen", "at most 7.071,"];
    assert!(words.iter().all(|word| text.contains(word)), "{text}");
    let allowed = SceneSpec { allow_coarse: true, ..coarse };
    let (scene, bodies) = allowed.scene_and_bodies(10.0).unwrap();
    assert!(matches!(allowed.check_tool(&TOOL, &scene.record.grid).unwrap()[..], [SceneWarning::Coarse(_)]));
    assert_eq!(allowed.warnings(&bodies).unwrap(), []);
    assert!(scaled(80.0, 7.07).scene().is_ok());
    // A sheet of three voxels, and a part smaller than the cutter is thick.
    let thin = scaled(6.0, 2.0);
    let (scene, bodies) = thin.scene_alone().unwrap();
    assert!(matches!(thin.warnings(&bodies).unwrap()[..], [SceneWarning::Thin { voxels: 3, .. }]));
    assert!(matches!(thin.check_tool(&TOOL, &scene.record.grid).unwrap()[..], [SceneWarning::Proportion(_)]));
}

#[test]
fn a_mesh_that_does_not_say_what_is_inside_is_refused_and_one_with_a_hole_is_not() {
    let mut cube = unit_cube().refined_with_origins(0.2, 10_000).0;
    let lid = |mesh: &Mesh, t: usize| mesh.corners(t).iter().all(|corner| corner.z == 1.0);
    let kept: Vec<_> =
        (0..cube.triangles.len()).filter(|&t| !lid(&cube, t)).map(|t| cube.triangles[t]).collect();
    let open = Mesh { triangles: kept, ..cube.clone() };
    let (scene, bodies) = SceneSpec { mesh: &open, ..spec(&[]) }.scene_alone().unwrap();
    assert_eq!(scene.obstacle.count(), 512);
    assert!((0.1..0.5).contains(&bodies.undecided), "{}", bodies.undecided);
    // A fixture's openings are told by its name.
    let beside = DMat4::from_translation(DVec3::new(-6.0, 0.0, 0.0)) * DMat4::from_scale(DVec3::splat(4.0));
    let fixtures = [Fixture { mesh: &open, transform: beside, ..clamp() }];
    let held = SceneSpec { around: GridExtent::All, ..spec(&fixtures) };
    let told = held.warnings(&held.scene_alone().unwrap().1).unwrap();
    let is_open = |warning: &SceneWarning| {
        matches!(warning, SceneWarning::Open { part, boundary_edges, fraction }
            if part == "clamp" && *boundary_edges > 0 && *fraction > 0.0)
    };
    assert!(told.iter().any(is_open), "{told:?}");
    // Half of the triangles turned, as good as at random.
    let turned = |t: usize| t.wrapping_mul(2_654_435_761) >> 13 & 1 == 1;
    for (_, corners) in cube.triangles.iter_mut().enumerate().filter(|(t, _)| turned(*t)) {
        corners.swap(1, 2);
    }
    let refusal = SceneSpec { mesh: &cube, ..spec(&[]) }.scene().unwrap_err();
    assert!(
        matches!(&refusal, SceneError::Undecided { name, fraction } if name == "cube" && *fraction > 0.9),
        "{refusal}"
    );
    // Those that share corners do.
    let (repaired, _) = cube.with_consistent_faces();
    assert_eq!(SceneSpec { mesh: &repaired, ..spec(&[]) }.scene().unwrap().obstacle.count(), 512);
}

#[test]
fn voxelising_reports_its_rows_and_can_be_cancelled() {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
    let fixtures = [clamp()];
    let (rows, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    let progress = |n: u64| {
        rows.fetch_add(n, Ordering::Relaxed);
    };
    let control = Control { progress: &progress, cancelled: &stop };
    let spec = SceneSpec { around: GridExtent::All, control, ..spec(&fixtures) };
    let scene = spec.scene().unwrap();
    let [x, y, _] = scene.record.grid.dims;
    assert_eq!(rows.load(Ordering::Relaxed), (2 * x * y) as u64);
    stop.store(true, Ordering::Relaxed);
    assert!(matches!(spec.scene(), Err(SceneError::Cancelled(_))));
}

#[test]
fn a_shank_wider_than_its_cutter_by_less_than_a_voxel_is_told() {
    let tool = |shank: f64| {
        revolved([
            (ElementKind::Cutter, vec![Segment::cylinder(0.0, 20.0, 4.0)]),
            (ElementKind::Shank, vec![Segment::cylinder(20.0, 40.0, shank / 2.0)]),
            (ElementKind::Holder(0), vec![Segment::cylinder(40.0, 100.0, 15.0)]),
        ])
    };
    let told = |shank: f64, clearance: f64, pitch: f64| {
        let assembly = tool(shank).offset(&Clearance::around_holder_and_shank(clearance)).unwrap();
        match SceneWarning::of_step(&assembly, pitch) {
            Some(SceneWarning::Step { element, step, .. }) => Some((element, (1e6 * step).round() / 1e6)),
            _ => None,
        }
    };
    assert_eq!(told(9.0, 0.0, 1.0), Some((ElementKind::Shank, 0.5)));
    assert_eq!(told(8.0, 0.5, 1.0), Some((ElementKind::Shank, 0.5)));
    // As wide as the cutter, narrower, and one that voxels see.
    assert_eq!([told(8.0, 0.0, 1.0), told(7.0, 0.0, 1.0), told(9.0, 0.0, 0.5)], [None; 3]);
}

#[test]
fn coordinates_of_32_bits_far_from_the_origin_are_told_of() {
    let tool = cylinder(6.0, 20.0);
    let told = |corner: f64| {
        let mesh = Mesh::cuboid(DVec3::splat(corner), DVec3::splat(corner) + DVec3::new(41.0, 30.0, 20.0));
        let built =
            Scene::builder().part("block", mesh, LengthUnit::Mm).pitch(1.0).tool(&tool).build().unwrap();
        built
            .warnings
            .iter()
            .any(|warning| matches!(warning, SceneWarning::Rounded { rounding, .. } if *rounding == 1.0))
    };
    assert!(told(1e7));
    // Near it, and with finer coordinates.
    assert!(!told(100.0) && !told(1e7 + 0.3));
}
