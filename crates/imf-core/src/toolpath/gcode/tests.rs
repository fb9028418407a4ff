//! Programs: what is followed, and where, and what is refused.

use glam::DVec3;

use super::*;
use crate::machine::tests::meeting_trunnion;
use crate::unit::LengthUnit;

fn trunnion() -> Machine {
    let mut machine = meeting_trunnion();
    machine.home = DVec3::new(1.0, 2.0, 3.0);
    machine.offsets.insert(55, DVec3::new(10.0, 0.0, -250.0));
    machine
}

fn read(text: &str) -> Result<Toolpath, LineError> {
    parse(text, &LengthUnit::Mm.into())
}

fn on(machine: &Machine, text: &str) -> Result<Toolpath, LineError> {
    parse(text, &PathReading { unit: LengthUnit::Mm, machine: Some(machine), lengths: &[(None, 80.0)] })
}

fn positions(path: &Toolpath) -> Vec<[f64; 3]> {
    path.locations.iter().map(|l| l.pose.position.map(|v| (v * 1e9).round() / 1e9).to_array()).collect()
}

#[test]
fn a_program_of_three_axes_is_followed_word_by_word() {
    let text = "%\nO1000 (POCKET, X9)\nN1 G21 G90 G17 G40 G80\nT3 M6\nN2 G54 G0 X10. Y-5. S8000 M3\nG43 H3 Z20. M8\nZ2.\nG1 Z-1. F200\n\
                X20.\nG91 Y1. Z.5\nG90 G20 X1.\nG21 G0 Z20.\nG4 X2.0\nT4\nM5\nM30\nX999.\n%\n";
    let path = read(text).unwrap();
    let expected = [
        [10.0, -5.0, 20.0],
        [10.0, -5.0, 2.0],
        [10.0, -5.0, -1.0],
        [20.0, -5.0, -1.0],
        [20.0, -4.0, -0.5],
        [25.4, -4.0, -0.5],
        [25.4, -4.0, 20.0],
    ];
    assert_eq!(positions(&path), expected);
    let kinds: Vec<MoveKind> = path.locations.iter().map(|l| l.kind).collect();
    assert_eq!(kinds[..3], [MoveKind::Start, MoveKind::Rapid, MoveKind::Feed]);
    assert_eq!((path.locations[0].line, path.locations[0].tool), (6, Some(3)));
    assert!(path.locations.iter().all(|l| l.pose.axis() == Some(DVec3::Z) && l.machine.is_none()));
    assert!(path.remarks.is_empty(), "{:?}", path.remarks);
    let inches = parse("G20\nG0 X1. Y0. Z2.\n", &LengthUnit::Mm.into()).unwrap();
    assert!((inches.locations[0].pose.position - DVec3::new(25.4, 0.0, 50.8)).length() < 1e-12);
}

#[test]
fn a_tool_change_begins_anew_and_what_is_taken_for_granted_is_said() {
    let path = read("G0 X1 Y2 Z30\nT1 M6\nG0 X5. Y5.\nZ9.\nT1 M6\nX6. Y6. Z9.\n").unwrap();
    let kinds: Vec<MoveKind> = path.locations.iter().map(|l| l.kind).collect();
    assert_eq!(kinds, [MoveKind::Start; 3]);
    assert_eq!(positions(&path)[1], [5.0, 5.0, 9.0]);
    for (remark, said) in path.remarks.iter().zip(["without a decimal point", "without G20 or G21"]) {
        assert!(remark.starts_with("line 1: ") && remark.contains(said), "{remark}");
    }
    assert_eq!(path.remarks.len(), 2);
    let path = read("G21 G90 G0 X1. Y2. Z3.\nZ4.\nX3. Y3.\n").unwrap();
    assert!(path.remarks[0].starts_with("line 3: G0 is followed straight"), "{:?}", path.remarks);
}

#[test]
fn arcs_end_where_they_say_in_each_plane() {
    let path =
        read("G21 G90 G0 X0. Y0. Z0.\nG2 X10. Y10. I10. F100\nG1 X0. Y0.\nG18 G3 X10. Z10. R10.\n").unwrap();
    let at_line = |line: usize| path.locations.iter().filter(move |l| l.line == line);
    assert!(at_line(2).count() > 50);
    assert!(
        at_line(2)
            .all(|l| (l.pose.position.truncate().distance(glam::DVec2::new(10.0, 0.0)) - 10.0).abs() < 1e-9)
    );
    assert_eq!(at_line(2).next_back().unwrap().pose.position, DVec3::new(10.0, 10.0, 0.0));
    // G18: from z to x, so that G3 by its short way goes about (10, ·, 0) or (0, ·, 10).
    let middle = at_line(4).nth(at_line(4).count() / 2).unwrap().pose.position;
    let centre = if middle.x > middle.z { DVec3::new(0.0, 0.0, 10.0) } else { DVec3::new(10.0, 0.0, 0.0) };
    assert!((middle.distance(centre) - 10.0).abs() < 1e-9, "{middle}");
    // Counter-clockwise as seen from +y: z × x = y, so it bends like x^… below the diagonal's left.
    let (start, end) = (DVec3::ZERO, DVec3::new(10.0, 0.0, 10.0));
    assert!((end - start).cross(middle - start).dot(DVec3::Y) < 0.0, "{middle}");
}

#[test]
fn what_is_not_followed_is_refused_with_line_and_word() {
    let start = "G21 G90 G0 X0. Y0. Z9.\n";
    let cases = [
        ("G81 Z-3. R1.", "G81 is a cycle"),
        ("G41 D1 X3.", "G41 moves the tool beside the path"),
        ("G68 R90.", "G68 is not understood"),
        ("G10 L2 P1 X3.", "G10 is not understood"),
        ("G43.4 H1 X3.", "rotary axes turn"),
        ("G5.1 Q1", "G5.1 is not understood"),
        ("G64", "no P says by how much"),
        ("G64 P.01 L2", "L is not understood"),
        ("M98 P2", "M98 is not understood"),
        ("G1 A30.", "A30. turns a rotary axis"),
        ("G1 U3.", "U is not understood here"),
        ("G1 E3.", "E3. is not understood"),
        ("G53 Z0.", "no machine is given"),
        ("G28 Z0.", "no machine is given"),
        ("G55 X3.", "another work offset"),
        ("G0 G1 X3.", "second kind of motion"),
        ("X3. X4.", "X stands twice"),
        ("G1 X3. I2.", "belong to an arc"),
        ("G2 X3. Y0.", "neither a centre"),
        ("G2 X3. Y0. I1.", "begins 1 from its centre and ends 2"),
        ("M6", "no T says"),
        ("T2 M6 H2", "neither G43"),
        ("G43 X#5", "'X#5'"),
        ("G2.5 X1.", "G2.5 is not understood"),
        ("T2 M6\nG1 X3. Y3.", "where Z stands is not known"),
        ("T2 M6\nG91 Z3.", "Z is a step"),
        ("T2 M6\nG43 H3 Z3.", "H3 is the length of another tool"),
        ("G4 X1. Z3.", "Z stands beside G4"),
    ];
    for (text, said) in cases {
        let wrong = read(&format!("{start}{text}\n")).unwrap_err();
        assert!(wrong.what.contains(said), "{text}: {}", wrong.what);
        assert_eq!(wrong.line, 1 + text.lines().count(), "{text}");
    }
    // Rounded corners are told, the largest length of each.
    let path = read(&format!("{start}G64 P.01\nG1 X3. F9\nG64 P.005\nG64 P.02 Q.01\nX5.\n")).unwrap();
    let told: Vec<&String> = path.remarks.iter().filter(|remark| remark.contains("G64")).collect();
    assert!(told.len() == 2 && told[0].contains("line 2") && told[1].contains("up to 0.03"), "{told:?}");
    assert!(read("X1. Y1. Z1.\n").unwrap_err().what.contains("none of G0, G1, G2 and G3"));
    let wrong = read("T1\nG0 X1. Y1. Z1.\n").unwrap_err();
    assert_eq!((wrong.line, wrong.what.as_str()), (1, "T1 calls a tool, and no M6 changes to it"));
}

#[test]
fn with_the_centre_point_kept_coordinates_are_the_parts() {
    let machine = trunnion();
    let path =
        on(&machine, "G21 G90 G0 A0. C0.\nG43.4 H1 X1. Y2. Z3.\nG1 X4. A-90. C90. F9\nG55 X4.\n").unwrap();
    assert_eq!(positions(&path), [[1.0, 2.0, 3.0], [4.0, 2.0, 3.0], [14.0, 2.0, 3.0]]);
    let last = path.locations[1];
    let point = last.machine.unwrap();
    assert!(point.tip_goes_straight && last.rolled);
    // The table turns by −90° about x: the tool lies along −y there, and along x by the part that C turns by 90° before.
    assert!(
        (last.pose.axis().unwrap() - DVec3::new(-1.0, 0.0, 0.0)).length() < 1e-12,
        "{}",
        last.pose.axis().unwrap()
    );
    assert!((machine.forward(&point.joints, 80.0).position - last.pose.position).length() < 1e-9);
}

#[test]
fn by_plain_axes_coordinates_are_the_machines() {
    let machine = trunnion();
    let path = on(&machine, "G21 G90 G0 A0. C0.\nG43 H1 X5. Y0. Z10.\nA-90.\nG55 G1 X0. Z60. F9\n").unwrap();
    let found = positions(&path);
    assert_eq!(found[0], [5.0, 0.0, 10.0]);
    // 60 above the axis, and the table turned away below: as seen from the part the tip comes round by 90°.
    assert_eq!(found[1], [5.0, -60.0, -50.0]);
    assert_eq!(found[2], [10.0, -110.0, -50.0]);
    assert!(path.locations.iter().all(|l| !l.machine.unwrap().tip_goes_straight));
    // Machine coordinates and the reference point, and what stays where it is.
    let path =
        on(&machine, "G21 G90 G0 A0. C0.\nG53 G0 X0. Y0. Z0.\nG91 G28 Z0.\nG90 G43 H1 Z20.\n").unwrap();
    let linear: Vec<DVec3> = path.locations.iter().map(|l| l.machine.unwrap().joints.linear).collect();
    assert_eq!(linear, [DVec3::ZERO, DVec3::new(0.0, 0.0, 3.0), DVec3::new(0.0, 0.0, -150.0)]);
    assert_eq!(path.locations.iter().filter(|l| l.kind == MoveKind::Start).count(), 1);
}

#[test]
fn a_machine_is_told_what_is_not_known() {
    let machine = trunnion();
    for (text, line, said) in [
        ("G0 X0. Y0. Z0.\n", 1, "no tool length is in force"),
        ("G43 H1 G0 X0. Y0. Z9.\nG1 X1. F9\n", 2, "where A stands is not known"),
        ("G0 B3.\n", 1, "B3. turns an axis that the machine 'test' has not"),
        ("G56 G0 X1.\n", 1, "G56 is another work offset"),
        ("G0 A0. C0.\nG43.4 H1 X0. Y0. Z9.\nG28 Z0.\n", 3, "G49 before"),
        ("G0 A0. C0.\nG43.4 H1 X0. Y0. Z9.\nT2 M6\n", 3, "G49 before"),
        ("G0 A0. C0.\nG43 H1 X0. Y0. Z9.\nG2 X1. I.5 A3.\n", 3, "an arc with a rotary axis"),
    ] {
        let wrong = on(&machine, text).unwrap_err();
        assert_eq!(wrong.line, line, "{text}");
        assert!(wrong.what.contains(said), "{text}: {}", wrong.what);
    }
    let numbered = PathReading { unit: LengthUnit::Mm, machine: Some(&machine), lengths: &[(Some(1), 80.0)] };
    let wrong = parse("T2 M6\nG0 A0. C0.\n", &numbered).unwrap_err();
    assert!(wrong.line == 2 && wrong.what.contains("tool 2 is not given"), "{}", wrong.what);
}

#[test]
fn programs_are_known_by_name_or_first_word() {
    for (text, name) in [
        ("X1 Y2\n", "a.nc"),
        ("%\nX1\n", "a"),
        ("(PART)\n", "a.txt"),
        ("N10G0X1\n", "a"),
        ("; by\nG21\n", "a"),
    ] {
        assert!(is_program(text, name), "{text}");
    }
    for text in
        ["x,y,z\n1,2,3\n", "GOTO/1,2,3\n", "PARTNO A\nGOTO/1,2,3\n", "# made\nx y z\n", "$$ x\nLOADTL/1\n"]
    {
        assert!(!is_program(text, "path.csv"), "{text}");
    }
}
