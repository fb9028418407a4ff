//! Machines that cannot be checked.

use super::*;
use crate::mesh::Mesh;
use crate::scene::SceneError;

#[test]
fn a_solids_mesh_that_voxels_do_not_show_is_refused() {
    let with = |mesh: Mesh, side| {
        let mut machine = machines()[0].clone();
        machine.solids.push(MachineSolid {
            name: "guard".into(),
            side,
            level: 0,
            shape: SolidShape::Mesh(mesh),
        });
        MachineBodies::new(machine, 1.0, Control::quiet()).map(|_| ())
    };
    let cuboid =
        |size: [f64; 3]| Mesh::cuboid(DVec3::splat(0.3), DVec3::splat(0.3) + DVec3::from_array(size));
    // An angle of sheet.
    let mut sheet = cuboid([0.15, 30.0, 30.0]);
    sheet.append(&cuboid([30.0, 0.15, 30.0]));
    let mut open = cuboid([30.0, 30.0, 30.0]);
    open.triangles.truncate(6);
    for side in [Side::Table, Side::Head] {
        assert!(
            matches!(with(sheet.clone(), side), Err(CheckError::LostSolid { area, .. }) if area > 3_000.0)
        );
        assert!(matches!(with(open.clone(), side), Err(CheckError::Solid(SceneError::Undecided { .. }))));
        assert!(with(cuboid([30.0, 30.0, 2.0]), side).is_ok());
    }
}

#[test]
fn no_stick_out_is_found_where_the_tip_moves_with_the_length() {
    let obstacle = Arc::new(part());
    let machine = machines()[1].clone();
    let least = |locations: Vec<Location>| {
        let path = Toolpath { locations, ..Toolpath::default() };
        let tools = [(None, &tool())];
        shortest_stick_outs(&obstacle, &[], &tools, &path, &strict(0.25), Some(&machine), Control::quiet())
    };
    let found = |b: f64, straight: bool| {
        let joints = Joints { linear: DVec3::new(0.0, 0.0, 200.0), rotary: [b, 30.0] };
        let locations = vec![location(&machine, 7, joints, MoveKind::Start, straight)];
        least(locations)
    };
    let moves = |found| matches!(found, Err(CheckError::Line { line: 7, fault: LineFault::TipMoves }));
    assert!(moves(found(40.0, false)));
    assert!(found(40.0, true).is_ok() && found(0.0, false).is_ok());
    // By the machine's own coordinates the tip moves with the length too: these motions are left out.
    let spindle = |mut own: Location| {
        own.machine = own.machine.map(|point| MachinePoint { by_spindle: true, ..point });
        own
    };
    let at = |line: usize, z: f64, kind| {
        let joints = Joints { linear: DVec3::new(0.0, 0.0, z), rotary: [0.0; 2] };
        location(&machine, line, joints, kind, false)
    };
    let locations = vec![
        at(1, 40.0, MoveKind::Start),
        at(2, 45.0, MoveKind::Feed),
        spindle(at(3, -10.0, MoveKind::Rapid)),
        at(4, 45.0, MoveKind::Rapid),
        at(5, 46.0, MoveKind::Feed),
    ];
    assert_eq!(least(locations).unwrap()[0].left_out, 2);
}
