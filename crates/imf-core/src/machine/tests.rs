//! Kinematics against closed forms, plain matrices, and a search over a grid of angles.

#[cfg(unix)]
use std::path::Path;

use glam::{DMat4, DVec3};

use super::motion::Ball;
use super::*;
#[cfg(unix)]
use crate::file_error::FaultKind;
use crate::orientation::Orientation;
use crate::section::test_shapes::orientations;

pub(crate) const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

pub(crate) fn axis(
    letter: char,
    side: Side,
    direction: [f64; 3],
    centre: [f64; 3],
    range: [f64; 2],
) -> RotaryAxis {
    let direction = DVec3::from_array(direction).normalize();
    RotaryAxis { letter, side, direction, centre: DVec3::from_array(centre), range }
}

pub(crate) fn machine_of(rotary: Vec<RotaryAxis>) -> Machine {
    let machine = Machine {
        name: "test".into(),
        unit: LengthUnit::Mm,
        rotary,
        travel: [FREE; 3],
        home: DVec3::ZERO,
        preferred: None,
        offsets: BTreeMap::from([(54, DVec3::new(20.0, -30.0, -400.0))]),
        solids: Vec::new(),
    };
    assert_eq!(machine.fault(), None);
    machine
}

/// A table that tilts by A and turns by C, whose axes do not meet.
pub(crate) fn trunnion() -> Machine {
    machine_of(vec![
        axis('A', Side::Table, [1.0, 0.0, 0.0], [0.0, 5.0, -380.0], [-120.0, 120.0]),
        axis('C', Side::Table, [0.0, 0.0, 1.0], [12.0, -3.0, 0.0], FREE),
    ])
}

/// The same where the axes meet, in (0, 0, −300), and the part's zero is 50 above.
pub(crate) fn meeting_trunnion() -> Machine {
    let centre = [0.0, 0.0, -300.0];
    let rotary = vec![
        axis('A', Side::Table, [1.0, 0.0, 0.0], centre, FREE),
        axis('C', Side::Table, [0.0, 0.0, 1.0], centre, FREE),
    ];
    Machine { offsets: BTreeMap::from([(54, DVec3::new(0.0, 0.0, -250.0))]), ..machine_of(rotary) }
}

/// A head that tilts by B over a table that turns by C.
pub(crate) fn head_and_table() -> Machine {
    machine_of(vec![
        axis('B', Side::Head, [0.0, 1.0, 0.0], [0.0, 0.0, 150.0], [-110.0, 110.0]),
        axis('C', Side::Table, [0.0, 0.0, -1.0], [40.0, 10.0, 0.0], [-400.0, 400.0]),
    ])
}

/// A fork head that turns by C and tilts by A.
pub(crate) fn fork() -> Machine {
    machine_of(vec![
        axis('C', Side::Head, [0.0, 0.0, 1.0], [2.0, 0.0, 0.0], [-360.0, 360.0]),
        axis('A', Side::Head, [1.0, 0.0, 0.0], [2.0, 1.0, 180.0], [-120.0, 120.0]),
    ])
}

/// A table whose tilting axis stands at 45°.
pub(crate) fn nutating() -> Machine {
    machine_of(vec![
        axis('B', Side::Table, [0.0, 1.0, 1.0], [0.0, 0.0, -300.0], FREE),
        axis('C', Side::Table, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], FREE),
    ])
}

fn all() -> [Machine; 4] {
    [trunnion(), head_and_table(), fork(), nutating()]
}

/// By 4 by 4 matrices alone: from what hangs on the head to what stands on the table, both where they are with all axes at 0.
pub(crate) fn head_to_table(machine: &Machine, joints: &Joints, levels: (usize, usize)) -> DMat4 {
    let turns = |side: Side, level: usize| {
        let mut matrix = DMat4::IDENTITY;
        for (index, axis) in machine.rotary.iter().enumerate().filter(|(_, a)| a.side == side).take(level) {
            matrix = matrix
                * DMat4::from_translation(axis.centre)
                * DMat4::from_axis_angle(axis.direction, joints.rotary[index].to_radians())
                * DMat4::from_translation(-axis.centre);
        }
        matrix
    };
    let head = DMat4::from_translation(joints.linear) * turns(Side::Head, levels.0);
    turns(Side::Table, levels.1).inverse() * head
}

/// Where a point of the head that is at `point` with all axes at 0 is in the part's frame.
fn by_matrices(machine: &Machine, joints: &Joints, point: DVec3, levels: (usize, usize)) -> DVec3 {
    head_to_table(machine, joints, levels).transform_point3(point) - machine.part_zero()
}

fn random_joints(seed: usize) -> Joints {
    let of = |step: f64, span: f64| ((seed as f64 * step).fract() - 0.5) * span;
    Joints {
        linear: DVec3::new(of(0.618, 300.0), of(0.755, 200.0), of(0.57, 250.0)),
        rotary: [of(0.414, 220.0), of(0.303, 700.0)],
    }
}

#[test]
fn a_trunnions_tip_is_where_linuxcnc_puts_it() {
    // xyzac-trt: the table turns by A about x through (·, 5, −380), by C about z through (12, −3, ·).
    let machine = trunnion();
    for seed in 0..200 {
        let joints = random_joints(seed);
        let length = 83.0;
        let [a, c] = joints.rotary.map(f64::to_radians);
        let tip = joints.linear - DVec3::new(0.0, 0.0, length);
        let (y, z) = (tip.y - 5.0, tip.z + 380.0);
        let (y, z) = (a.cos() * y + a.sin() * z + 5.0, -a.sin() * y + a.cos() * z - 380.0);
        let (x, y) = (tip.x - 12.0, y + 3.0);
        let closed = DVec3::new(c.cos() * x + c.sin() * y + 12.0, -c.sin() * x + c.cos() * y - 3.0, z);
        let pose = machine.forward(&joints, length);
        assert!((pose.position - (closed - machine.part_zero())).length() < 1e-9, "{joints:?}");
        let along = DVec3::new(c.sin() * a.sin(), c.cos() * a.sin(), a.cos());
        assert!((pose.axis().unwrap() - along).length() < 1e-12);
    }
}

#[test]
fn forward_is_what_matrices_say_and_linear_leads_back() {
    for machine in all() {
        for seed in 0..300 {
            let joints = random_joints(seed);
            let pose = machine.forward(&joints, 60.0);
            let levels = (machine.axes_of(Side::Head), machine.axes_of(Side::Table));
            for point in [DVec3::ZERO, DVec3::new(3.0, -2.0, 5.0)] {
                let expected = by_matrices(&machine, &joints, point - DVec3::new(0.0, 0.0, 60.0), levels);
                assert!((pose.of_point(point) - expected).length() < 1e-9, "{joints:?}");
            }
            let linear = machine.linear(pose.position, &joints.rotary, 60.0);
            assert!((linear - joints.linear).length() < 1e-9);
        }
    }
}

#[test]
fn angles_give_the_direction_that_they_were_found_for() {
    let directions = orientations("random:2000:5");
    for machine in all() {
        let mut reached = 0;
        for direction in directions.iter().map(Orientation::direction) {
            for rotary in machine.inverse(direction).angles {
                reached += 1;
                let pose = machine.forward(&Joints { linear: DVec3::ZERO, rotary }, 50.0);
                assert!((pose.axis().unwrap() - direction).length() < 1e-9, "{direction} {rotary:?}");
                assert_eq!(machine.out_of_travel(&Joints { linear: DVec3::ZERO, rotary }), None);
            }
        }
        assert!(reached > 2000, "{reached}");
    }
}

/// Every local best of a grid of angles, within the ranges or ±360° of an axis without a limit.
#[test]
fn a_search_over_all_angles_finds_no_other_branch() {
    let step = 2.0;
    for machine in [trunnion(), head_and_table(), fork()] {
        let ticks = |place: usize| -> Vec<f64> {
            let [low, high] = machine.rotary[place].range.map(|v| v.clamp(-360.0, 360.0));
            (0..).map(|i| low + f64::from(i) * step).take_while(|&v| v <= high + 1e-9).collect()
        };
        let (first, second) = (ticks(0), ticks(1));
        for direction in orientations("random:12:8").iter().map(Orientation::direction) {
            let found = machine.inverse(direction).angles;
            for &a in &first {
                for &b in &second {
                    let pose = machine.forward(&Joints { linear: DVec3::ZERO, rotary: [a, b] }, 0.0);
                    if pose.axis().unwrap().angle_between(direction) > 1e-2 {
                        continue;
                    }
                    // Near the pole the turning axis does little.
                    let slope = direction.z.abs().acos().sin().max(1e-3);
                    let near = found.iter().any(|own| {
                        let tilt = machine.rotary_by_letter('C').unwrap();
                        let (turn, other) = (own[tilt] - [a, b][tilt], own[1 - tilt] - [a, b][1 - tilt]);
                        other.abs() < 1.2 && turn.abs() < 1.2 / slope
                    });
                    let edge = |place: usize, v: f64| {
                        machine.rotary[place].range.iter().any(|end| (end - v).abs() < 3.0)
                    };
                    assert!(near || edge(0, a) || edge(1, b), "{direction} {a} {b} {found:?}");
                }
            }
        }
    }
}

#[test]
fn closed_forms_branches_turns_and_the_pole() {
    let machine = trunnion();
    let found = machine.inverse(DVec3::new(0.0, 1.0, 1.0));
    assert_eq!(found.free, None);
    let both: Vec<[f64; 2]> = found.angles.iter().map(|pair| pair.map(|v| (v * 1e6).round() / 1e6)).collect();
    // A 45 with whole turns of C, and A −45 with half a turn.
    for expected in [[45.0, 0.0], [45.0, 360.0], [45.0, -360.0], [-45.0, 180.0], [-45.0, -180.0]] {
        assert!(both.contains(&expected), "{both:?}");
    }
    let prefers =
        Machine { preferred: Some(PreferredBranch { axis: 0, positive: false }), ..machine.clone() };
    assert!(prefers.inverse(DVec3::new(0.0, 1.0, 1.0)).angles[0][0] < 0.0);
    let pole = machine.inverse(DVec3::Z);
    assert_eq!((pole.free, pole.angles), (Some(1), vec![[0.0, 0.0]]));
    // What is free stays where it is.
    let upright = Pose::along(DVec3::ZERO, DVec3::Z);
    let before = Joints { linear: DVec3::ZERO, rotary: [3.0, 77.0] };
    assert_eq!(machine.joints(&upright, 10.0, Some(&before)).unwrap().rotary, [0.0, 77.0]);
    let tilted = Pose::along(DVec3::ZERO, DVec3::new(0.0, 1.0, 1.0));
    let before = Joints { linear: DVec3::ZERO, rotary: [-40.0, 170.0] };
    let joints = machine.joints(&tilted, 10.0, Some(&before)).unwrap();
    assert!((joints.rotary[0] + 45.0).abs() < 1e-9 && (joints.rotary[1] - 180.0).abs() < 1e-9, "{joints:?}");
    assert!((machine.forward(&joints, 10.0).position - tilted.position).length() < 1e-9);
    // A table that has turned eight times goes on turning.
    let before = Joints { linear: DVec3::ZERO, rotary: [44.0, 2900.0] };
    let joints = machine.joints(&tilted, 10.0, Some(&before)).unwrap();
    assert!((joints.rotary[1] - 2880.0).abs() < 1e-9, "{joints:?}");
    assert!(matches!(
        machine.joints(&Pose::along(DVec3::ZERO, DVec3::NEG_Z), 10.0, None),
        Err(NoAngles::OutOfReach(..))
    ));
    assert_eq!(machine.joints(&Pose::along(DVec3::NAN, DVec3::Z), 1.0, None), Err(NoAngles::InvalidPose));
    // One axis reaches a circle of directions, no axis one direction.
    let one = machine_of(vec![machine.rotary[0]]);
    assert_eq!(one.inverse(DVec3::new(0.0, 1.0, 0.0)).angles.len(), 1);
    assert_eq!(one.inverse(DVec3::new(0.1, 1.0, 0.0)).angles.len(), 0);
    let none = machine_of(vec![]);
    assert_eq!((none.inverse(DVec3::Z).angles.len(), none.inverse(DVec3::Y).angles.len()), (1, 0));
}

#[test]
fn nothing_moves_farther_than_is_said_on_either_kind_of_motion() {
    for machine in all() {
        for seed in 0..60 {
            let (from, to) = (random_joints(seed), random_joints(seed * 7 + 3));
            for straight in [true, false] {
                let motion = MachineMotion::new(&machine, from, to, 70.0, straight);
                let end = motion.joints(1.0);
                assert!((end.linear - to.linear).length() < 1e-9 && end.rotary == to.rotary);
                if straight {
                    let tip = |f: f64| motion.pose(f).position;
                    assert!((tip(0.3) - tip(0.0).lerp(tip(1.0), 0.3)).length() < 1e-9);
                    assert!((machine.forward(&motion.joints(0.3), 70.0).position - tip(0.3)).length() < 1e-9);
                }
                for head in 0..=machine.axes_of(Side::Head) {
                    for table in 0..=machine.axes_of(Side::Table) {
                        let ball = Ball { centre: DVec3::new(10.0, -5.0, -40.0), radius: 35.0, level: head };
                        let steps = 50;
                        let most = motion.motion_bound(&ball, table) / f64::from(steps);
                        let at = |step: i32, point: DVec3| {
                            by_matrices(
                                &machine,
                                &motion.joints(f64::from(step) / f64::from(steps)),
                                point,
                                (head, table),
                            )
                        };
                        for step in 0..steps {
                            for out in [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z, DVec3::new(0.6, 0.0, -0.8)] {
                                let point = ball.centre + out * ball.radius;
                                let moved = at(step, point).distance(at(step + 1, point));
                                assert!(
                                    moved <= most * (1.0 + 1e-9),
                                    "{head} {table} {straight} {moved} {most}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn axes_beyond_their_range_are_named() {
    let mut machine = trunnion();
    machine.travel[2] = [-500.0, 0.0];
    let joints = |z: f64, a: f64| Joints { linear: DVec3::new(0.0, 0.0, z), rotary: [a, 1e4] };
    assert_eq!(machine.out_of_travel(&joints(-10.0, 120.0)), None);
    let beyond = machine.out_of_travel(&joints(0.5, 0.0)).unwrap();
    assert_eq!((beyond.axis, beyond.value, beyond.range), ('Z', 0.5, [-500.0, 0.0]));
    assert_eq!(machine.out_of_travel(&joints(-10.0, -121.0)).unwrap().axis, 'A');
    let inches = machine.in_unit(LengthUnit::Inch);
    assert!((inches.travel[2][0] + 500.0 / 25.4).abs() < 1e-12);
    assert!((inches.part_zero() * 25.4 - machine.part_zero()).length() < 1e-9);
}

#[test]
fn a_machine_that_is_none_has_a_fault_and_ends_no_program() {
    let third = axis('B', Side::Head, [0.0, 1.0, 0.0], [0.0; 3], FREE);
    let mut turned_round = trunnion();
    turned_round.rotary[1].range = [10.0, -10.0];
    let preferred = Some(PreferredBranch { axis: 2, positive: true });
    for machine in [
        Machine { rotary: [trunnion().rotary, vec![third]].concat(), ..trunnion() },
        Machine { preferred, ..trunnion() },
        turned_round,
    ] {
        assert!(machine.fault().is_some(), "{machine:?}");
        let _ = machine.forward(&Joints::default(), 100.0);
        let _ = (machine.inverse(DVec3::Z), machine.inverse(DVec3::X));
    }
}

#[cfg(feature = "formats")]
#[test]
fn files_are_read_and_mistakes_named_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Machine::read(&path)
    };
    let rotary = "[[rotary]]\nletter = 'a'\non = 'table'\naxis = [2, 0, 0]\ncentre = [0, 0, -9]\nrange = [-120, 30]\n\
                  [[rotary]]\nletter = 'C'\non = 'table'\naxis = [0, 0, 1]\n";
    let head = "prefer = 'A-'\ntravel = { z = [-400, 0] }\n[offsets]\nG54 = [1, 2, 3]\nG55 = [4, 5, 6]\n";
    let solid = "[[solid]]\nname = 'platter'\non = 'C'\ncylinder = { base = [0, 0, -20], top = [0, 0, 0], diameter = 50 }\n\
                 [[solid]]\nname = 'nose'\non = 'head'\nbox = { lower = [-9, -9, 0], upper = [9, 9, 30] }\n";
    let machine = read(&format!("{head}{rotary}{solid}")).unwrap();
    assert_eq!((machine.rotary[0].direction, machine.rotary[0].letter), (DVec3::X, 'A'));
    assert_eq!((machine.travel[0], machine.travel[2]), (FREE, [-400.0, 0.0]));
    assert_eq!((machine.solids[0].level, machine.solids[1].side), (2, Side::Head));
    let voxels = machine.solids[0].voxels(1.0, crate::control::Control::quiet()).unwrap().solid;
    assert!((voxels.volume() / (std::f64::consts::PI * 625.0 * 20.0) - 1.0).abs() < 0.01);
    std::fs::write(
        folder.path().join("open.obj"),
        "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    let cases = [
        ("", "G54"),
        ("[offsets]\nG60 = [0, 0, 0]\n", "line 2"),
        ("[offsets]\nG54 = [0, 0, 0]\n[[rotary]]\nletter = 'A'\non = 'table'\naxis = [0, 0, 0]\n", "zero"),
        ("speed = 3\n[offsets]\nG54 = [0, 0, 0]\n", "speed"),
        ("prefer = 'B+'\n[offsets]\nG54 = [0, 0, 0]\n", "line 1: prefer"),
        ("[offsets]\nG54 = [0, 0, 0]\n[[solid]]\nname = 'x'\non = 'Q'\nmesh = 'x.stl'\n", "'Q'"),
        ("[offsets]\nG54 = [0, 0, 0]\n[[solid]]\nname = 'x'\non = 'table'\nmesh = 'none.stl'\n", "none.stl"),
        (
            "[offsets]\nG54 = [0, 0, 0]\n[[solid]]\nname = 'x'\non = 'table'\nmesh = 'open.obj'\n",
            "open mesh (3 boundary edges)",
        ),
        ("[offsets]\nG54 = [0, 0, 0]\n[[solid]]\nname = 'x'\non = 'table'\n", "one shape"),
    ];
    for (text, said) in cases {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(said), "{text}: {error}");
    }
    #[cfg(unix)]
    assert_eq!(Machine::read(Path::new("/dev/zero")).unwrap_err().fault.kind, FaultKind::TooLarge);
}
