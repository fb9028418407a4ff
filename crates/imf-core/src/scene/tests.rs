use glam::DVec3;

use super::*;
use crate::mesh::tests::unit_cube;

/// A cube of 4 mm, held by a clamp that lies on it and sticks out 6 mm to either side.
fn spec<'a>(cube: &'a Mesh, tool: &'a Tool, fixtures: &'a [Fixture<'a>]) -> SceneSpec<'a> {
    SceneSpec {
        part: "cube",
        mesh: cube,
        unit: LengthUnit::Mm,
        transform: DMat4::from_scale(DVec3::splat(4.0)),
        resolution: Resolution::Pitch(0.5),
        margin: 0,
        conservative: false,
        tool,
        fixtures,
        around: Around::Part,
    }
}

fn clamp(cube: &Mesh) -> Fixture<'_> {
    let place = DMat4::from_translation(DVec3::new(-6.0, 1.0, 4.0));
    Fixture { name: "clamp", mesh: cube, transform: place * DMat4::from_scale(DVec3::new(16.0, 2.0, 1.0)) }
}

#[test]
fn fixtures_are_apart_and_part_of_the_obstacle() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let fixtures = [clamp(&cube)];
    let narrow = spec(&cube, &tool, &fixtures);
    assert!(matches!(narrow.scene(), Err(SceneError::FixtureOutside(name)) if name == "clamp"));
    let wide = SceneSpec { around: Around::All, ..narrow };
    let scene = wide.scene().unwrap();
    assert_eq!(scene.record.grid.dims, [32, 8, 10]);
    assert_eq!((scene.obstacle.count(), scene.fixtures.count()), (512 + 256, 256));
    assert_eq!(scene.record.fixtures, ["clamp"]);
}

#[test]
fn a_fixture_on_the_grids_face_makes_the_same_scene_alone_and_among_bodies() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let fixtures = [clamp(&cube)];
    let spec = SceneSpec { around: Around::All, conservative: true, ..spec(&cube, &tool, &fixtures) };
    let alone = spec.scene().unwrap();
    let (among, bodies) = spec.scene_and_bodies(100.0).unwrap();
    assert_eq!(among, alone);
    // Nothing is solid beside the grid, whose faces the surfaces touch.
    assert_eq!(bodies.obstacle(), alone.obstacle);
}

#[test]
fn what_sticks_out_counts_as_far_as_the_tool_reaches() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let fixtures = [clamp(&cube)];
    let spec = spec(&cube, &tool, &fixtures);
    let query = spec.grid().unwrap();
    assert_eq!(query.dims, [8; 3]);
    let all = spec.bodies(&spec.obstacle_grid(&query, 100.0).unwrap()).unwrap();
    assert_eq!((all.part.count(), all.fixtures.count()), (512, 256));
    assert!(query.offset_of(&all.part.grid).is_some());
    // 2 mm of reach and two voxels of room leave 3 mm on each side.
    let near = spec.bodies(&spec.obstacle_grid(&query, 2.0).unwrap()).unwrap();
    assert_eq!(near.part.count(), 512);
    assert!((160..256).contains(&near.fixtures.count()), "{}", near.fixtures.count());
}

#[test]
fn a_scene_may_stand_among_fixtures_that_stick_out() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let fixtures = [clamp(&cube)];
    let spec = spec(&cube, &tool, &fixtures);
    let (scene, bodies) = spec.scene_and_bodies(f64::INFINITY).unwrap();
    assert_eq!((scene.record.grid.dims, bodies.fixtures.count()), ([8; 3], 256));
    assert_eq!(scene.obstacle, bodies.obstacle().on(&scene.record.grid).unwrap());
    // The clamp stands on the cube, above its grid.
    assert_eq!((scene.obstacle.count(), scene.fixtures.count()), (512, 0));
    let wide = |reach: f64| spec.wide_grid(&scene.record.grid, reach).unwrap();
    assert!(spec.fixtures_out_of(&wide(1.0)).unwrap().is_empty());
    let far = [Fixture { transform: DMat4::from_translation(DVec3::new(0.0, 90.0, 0.0)), ..clamp(&cube) }];
    let far = SceneSpec { fixtures: &far, ..spec.clone() };
    assert_eq!(far.fixtures_out_of(&far.wide_grid(&scene.record.grid, 10.0).unwrap()).unwrap(), ["clamp"]);
    let alone = SceneSpec { fixtures: &[], ..spec };
    let (scene, bodies) = alone.scene_and_bodies(100.0).unwrap();
    assert_eq!((&scene, bodies.obstacle()), (&alone.scene().unwrap(), scene.obstacle.clone()));
}

#[test]
fn a_fixture_between_the_centres_is_refused() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let plate = |z: f64| Fixture {
        name: "plate",
        mesh: &cube,
        transform: DMat4::from_translation(DVec3::new(0.5, 0.5, z))
            * DMat4::from_scale(DVec3::new(2.0, 2.0, 0.1)),
    };
    // Centres stand at 0.25 and 0.75 above every millimetre.
    let thin = [plate(1.4)];
    let thin = spec(&cube, &tool, &thin);
    assert!(matches!(thin.scene(), Err(SceneError::ThinFixture { fixture, .. }) if fixture == "plate"));
    // Its faces lie on those of voxels, which are touched from both sides.
    assert_eq!(SceneSpec { conservative: true, ..thin }.scene().unwrap().fixtures.count(), 6 * 6 * 2);
    assert_eq!(spec(&cube, &tool, &[plate(1.2)]).scene().unwrap().fixtures.count(), 4 * 4);
}

#[test]
fn records_of_older_files_have_no_fixtures() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let record = spec(&cube, &tool, &[]).scene().unwrap().record;
    let text = serde_json::to_string(&record).unwrap();
    assert!(!text.contains("fixtures") && !text.contains("clearance") && !text.contains("ungrown"));
    assert_eq!(serde_json::from_str::<SceneRecord>(&text).unwrap(), record);
}

#[test]
fn a_clearance_offsets_the_tool_and_is_written_down() {
    let (cube, tool) = (unit_cube(), Tool::paper());
    let scene = spec(&cube, &tool, &[]).scene().unwrap();
    let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.0 };
    let offset = scene.clone().with_clearance(&clearance).unwrap();
    let record = &offset.record;
    assert_eq!((record.bare_tool(), record.clearance), (&tool, clearance));
    assert_eq!(record.tool, tool.inflated(&clearance).unwrap());
    let text = serde_json::to_string(record).unwrap();
    assert_eq!(&serde_json::from_str::<SceneRecord>(&text).unwrap(), record);
    // Another clearance starts from the tool as it is; none gives the scene back.
    assert_eq!(offset.clone().with_clearance(&clearance).unwrap(), offset);
    assert_eq!(offset.with_clearance(&Clearance::default()).unwrap(), scene);
    assert!(scene.with_clearance(&Clearance { holder: f64::NAN, ..clearance }).is_err());
}
