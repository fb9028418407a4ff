//! Programs: what is followed, and where, and what is refused.

use glam::DVec3;

use super::*;
use crate::machine::tests::{machine_of, meeting_trunnion};
use crate::toolpath::MoveKind;
use crate::toolpath::error::tests::assert_refused;
use crate::unit::LengthUnit;

fn trunnion() -> Machine {
    let mut machine = meeting_trunnion();
    machine.home = DVec3::new(1.0, 2.0, 3.0);
    machine.offsets.insert(55, DVec3::new(10.0, 0.0, -250.0));
    machine
}

fn read(text: &str) -> Result<Toolpath, Fault> {
    parse(text, &LengthUnit::Mm.into()).map(without_end)
}

fn on(machine: &Machine, text: &str) -> Result<Toolpath, Fault> {
    parse(text, &PathReading { unit: LengthUnit::Mm, machine: Some(machine), lengths: &[(None, 80.0)] })
        .map(without_end)
}

/// Most texts here are pieces of a program.
fn without_end(mut path: Toolpath) -> Toolpath {
    path.remarks.retain(|remark| !remark.contains(NO_END));
    path
}

fn positions(path: &Toolpath) -> Vec<[f64; 3]> {
    path.locations.iter().map(|l| l.pose.position.map(|v| (v * 1e9).round() / 1e9).to_array()).collect()
}

#[test]
fn a_program_of_three_axes_is_followed_word_by_word() {
    let text = "%\nO1000 (POCKET, X9)\nN1 G21 G90 G17 G40 G80\nT3 M6\nN2 G54 G0 X10. Y-5. S8000 M3\nG43 H3 Z20. M8\nZ2.\nG1 Z-1. F200\n\
                X20.\nG91 Y1. Z.5\nG90 G20 X1.\nG21 G0 Z20.\nG4 X2.0\nT4\nM5\nM30\n%\nwhat stands behind it\n";
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
    let said =
        ["without a decimal point", "without G20 or G21", "without G90 or G91", "Z is taken to be the tip's"];
    assert_eq!(path.remarks.len(), said.len());
    for (remark, said) in path.remarks.iter().zip(said) {
        assert!(remark.starts_with("line 1: ") && remark.contains(said), "{remark}");
    }
    // A length that is taken up, or an edge, says what Z is.
    for takes in ["G43 H1", "D1"] {
        let path = read(&format!("G21 G90\nT1 M6\n{takes}\nG0 X5. Y5. Z9.\n")).unwrap();
        assert!(path.remarks.is_empty(), "{:?}", path.remarks);
    }
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
        ("G87 Z-3. R1.", "G87 is a cycle"),
        ("G41 D1 X3.", "G41 moves the tool beside the path"),
        ("G68 R90.", "G68 is not understood"),
        ("G10 L2 P1 X3.", "G10 is not understood"),
        ("G43.4 H1 X3.", "rotary axes turn"),
        ("G5.2 Q1", "G5.2 is not understood"),
        ("G5.1 Q2 X0. Y0. Z0.", "X stands beside G5.1"),
        ("G8", "G8 is understood with P alone"),
        ("G64 Q1", "no P says by how much"),
        ("G64 P.01 L2", "L is not understood"),
        ("M98 P2", "M98 is not understood"),
        ("G1 A30.", "A30. turns a rotary axis"),
        ("G1 U3.", "U is not understood here"),
        ("G1 E3.", "E3. is not understood"),
        ("G53 Z0.\nG1 X5.", "where Z stands is not known"),
        ("G91 G28 Z0.\nG1 X5.", "where Z stands is not known"),
        ("G55 X3.", "another work offset"),
        ("G0 G1 X3.", "second kind of motion"),
        ("X3. X4.", "X stands twice"),
        ("G1 X3. I2.", "belong to an arc"),
        ("G2 X3. Y0.", "neither a centre"),
        ("G2 X3. Y0. I1.", "begins 1 from its centre and ends 2"),
        ("G3 X0. Y0. Z-20. I5. J0. K5.", "K stands at right angles to the arc's plane"),
        ("G18 G3 X0. Z9. I5. J-1. K0.", "J stands at right angles to the arc's plane"),
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
        assert_refused(read(&format!("{start}{text}\n")), 1 + text.lines().count(), said);
    }
    // Rounded corners are told, the largest length of each.
    let path = read(&format!("{start}G64 P.01\nG1 X3. F9\nG64 P.005\nG64 P.02 Q.01\nX5.\n")).unwrap();
    let told: Vec<&String> = path.remarks.iter().filter(|remark| remark.contains("G64")).collect();
    assert!(told.len() == 2 && told[0].contains("line 2") && told[1].contains("up to 0.03"), "{told:?}");
    let two = format!("{start}M30\n%\nO2\nG0 X1. Y1. Z-20.\n");
    assert_refused(read(&two), 5, "after the end of the program in line 2");
    assert!(read("X1. Y1. Z1.\n").unwrap_err().what.contains("none of G0, G1, G2 and G3"));
    assert_refused(read("T1\nG0 X1. Y1. Z1.\nT2\nX2.\n"), 3, "write M6 after each T");
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
        assert_refused(on(&machine, text), line, said);
    }
    let numbered = PathReading { unit: LengthUnit::Mm, machine: Some(&machine), lengths: &[(Some(1), 80.0)] };
    assert_refused(parse("T2 M6\nG0 A0. C0.\n", &numbered), 2, "tool 2 is not given");
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

#[test]
fn after_the_end_of_a_tool_length_z_is_not_followed_without_a_machine() {
    let start = "G21 G90 G17 G49\nT1 M6\nG54 G0 X0. Y0.\nG43 H1 Z100.\nG1 Z31. F500\n";
    for (text, line, word) in [
        ("G0 G49 Z100.\nM30\n", 6, "G49"),
        ("G49\nX5.\nZ100.\n", 8, "G49"),
        ("G49\nG91 X5. Z1.\n", 7, "G49"),
        ("T2 M6\nG0 X0. Y0.\nZ50.\n", 8, "M6"),
        ("G49\nT2 M6\nX0. Y0. Z50.\n", 8, "M6"),
        ("G49\nD0\nZ50.\n", 8, "G49"),
    ] {
        let wrong = read(&format!("{start}{text}")).unwrap_err();
        assert_eq!(wrong.line, Some(line), "{text}");
        let cause = format!(
            "Z moves after {word} has ended the tool length: it is the spindle's place and not the tip's"
        );
        let remedy = "(write G43 H and the tool's number before, take the motion out, or give the machine)";
        assert!(wrong.what.starts_with(&cause) && wrong.what.ends_with(remedy), "{text}: {}", wrong.what);
    }
    let siemens = "G90 G17 G71\nT1 D1\nM6\nG0 X0 Y0\nZ60\nD0\nX5\n".replace("G71", "G21");
    let wrong = read(&format!("{siemens}Z100\n")).unwrap_err();
    assert_eq!(wrong.line, Some(8));
    assert!(wrong.what.contains("Z moves after D0") && wrong.what.contains("(write D and"), "{}", wrong.what);
    // A length that is in force again, one that was never used, and radii's places beside G43.
    for (text, last) in [
        (format!("{start}G49\nX5.\n"), [5.0, 0.0, 31.0]),
        (format!("{start}G49\nT2 M6\nG0 X0. Y0.\nG43 H2 Z50.\n"), [0.0, 0.0, 50.0]),
        (format!("{start}G40 D0\nZ50.\n"), [0.0, 0.0, 50.0]),
        (format!("{siemens}D2 Z70\n"), [5.0, 0.0, 70.0]),
        ("D0 G49\nT1 M6\nG0 X0. Y0. Z9.\nG49\nT2 M6\nX0. Y0. Z8.\n".to_owned(), [0.0, 0.0, 8.0]),
    ] {
        let path = read(&text).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what));
        assert_eq!(positions(&path).last(), Some(&last), "{text}");
    }
}

#[test]
fn to_the_machines_own_places_the_way_is_not_known_without_a_machine() {
    let path = read(
        "G21 G91 G28 Z0.\nG90 G8 P1\nT1 M6\nG0 X0. Y0.\nG43 H1 Z9.\nG1 Z1. F9\nG64\nG91 G28 Z0.\nG28 X0. Y0.\nG90 T2 M6\nG0 X1. Y1.\nG43 H2 Z5.\n",
    );
    let path = path.unwrap();
    assert_eq!(positions(&path), [[0.0, 0.0, 9.0], [0.0, 0.0, 1.0], [1.0, 1.0, 5.0]]);
    assert_eq!(path.starts(), 2);
    let said = |word: &str| path.remarks.iter().filter(|remark| remark.contains(word)).count();
    assert_eq!(
        (said("line 1: G28 goes to the machine's own place"), said("line 2: the control may leave")),
        (1, 1)
    );
    assert_eq!(path.remarks.len(), 2, "{:?}", path.remarks);
    // On the way the place that is said is passed.
    let path = read("G21 G90 G0 X0. Y0. Z9.\nG28 Z3.\nX2. Y2. Z4.\n").unwrap();
    assert_eq!(positions(&path), [[0.0, 0.0, 9.0], [0.0, 0.0, 3.0], [2.0, 2.0, 4.0]]);
    assert_eq!(path.locations[2].kind, MoveKind::Start);
}

#[test]
fn before_its_first_tool_a_machine_goes_home() {
    let machine = trunnion();
    let lengths = [(Some(1), 80.0)];
    let reading = PathReading { unit: LengthUnit::Mm, machine: Some(&machine), lengths: &lengths };
    let path =
        parse("G21 G91 G28 Z0.\nG28 X0. Y0. A0. C0.\nG90 T1 M6\nG0 X1. Y2.\nG43 H1 Z9.\nG53 Z0.\n", &reading)
            .unwrap();
    let lines: Vec<usize> = path.locations.iter().map(|l| l.line).collect();
    assert_eq!(lines, [5, 6]);
    let by_spindle = |path: &Toolpath| -> Vec<bool> {
        path.locations.iter().map(|l| l.machine.unwrap().by_spindle).collect()
    };
    assert_eq!(by_spindle(&path), [false, true]);
    // The same tool is given without a number, and Z is the spindle's until the program says it.
    let text =
        "G21 G91 G28 Z0.\nG28 X0. Y0. A0. C0.\nG90 T1 M6\nG0 X1. Y2.\nG43 H1 Z9.\nG53 Z0.\nX5.\nZ8.\nX6.\n";
    let path = on(&machine, text).unwrap();
    assert_eq!(path.locations[0].line, 5);
    assert_eq!(by_spindle(&path), [false, true, true, false, false]);
    let mut narrow = machine.clone();
    narrow.travel[0] = [-10.0, 10.0];
    let far =
        parse("G21 G0 G53 X-99.\nT1 M6\n", &PathReading { machine: Some(&narrow), ..reading }).unwrap_err();
    assert!(far.what.contains("X would have to be at -99"), "{}", far.what);
}

#[test]
fn z_before_the_first_of_a_programs_tool_lengths_is_refused() {
    let first = "G21 G90\nT1 M6\nG0 X0. Y0. Z50.\nG1 Z2. F9\n";
    assert!(read(&format!("{first}T2 M6\nG0 X1. Y1. Z9.\n")).is_ok(), "without any length Z is the tip's");
    assert_refused(read(&format!("{first}T2 M6\nG43 H2 Z50.\n")), 6, "in line 3 Z moved");
    // A header that lifts Z before the first tool leads nowhere.
    assert!(read("G21 G90 G0 Z100.\nT1 M6\nG0 X0. Y0.\nG43 H1 Z50.\n").is_ok());
    let home = "G21 G90 T1 M6\nG0 X0. Y0.\nG43 H1 Z50.\nG49\nG28 Z30.\n";
    assert_refused(read(home), 5, "Z moves after G49");
}

#[test]
fn a_work_offset_changes_only_before_any_coordinate() {
    for text in [
        "G21 G90\nT1 M6\nG54 G0 X-100. Y0.\nG55 G43 H1 Z10.\n",
        // A tool change forgets where the axes stand, and not where the path was.
        "G21 G90\nG54 G0 X1. Y0. Z9.\nT1 M6\nG55 X1. Y0. Z9.\n",
    ] {
        assert_refused(read(text), 4, "G55 is another work offset");
    }
    assert_eq!(positions(&read("G21 G90 G54\nG55 G0 X1. Y2. Z3.\n").unwrap()), [[1.0, 2.0, 3.0]]);
}

#[test]
fn an_axis_beyond_its_range_is_refused_though_others_are_unknown() {
    let mut mill = machine_of(Vec::new());
    mill.travel[2] = [-500.0, 0.0];
    mill.offsets.insert(54, DVec3::new(0.0, 0.0, -500.0));
    // 600 above the part's zero and the tool's 80.
    let wrong = on(&mill, "G21 G90 G17\nG43 H1 G0 Z600.\nX0. Y0. Z100.\n").unwrap_err();
    let said = "Z would have to be at 180.000 mm, and goes from -500 mm to 0 mm";
    assert!(wrong.line == Some(2) && wrong.what.starts_with(said), "{}", wrong.what);
    let path = on(&mill, "G21 G90 G17\nG43 H1 G0 Z400.\nX0. Y0.\nZ600.\n").unwrap();
    // What the path's check sees is left to it.
    assert_eq!(positions(&path), [[0.0, 0.0, 400.0], [0.0, 0.0, 600.0]]);
    let mut machine = trunnion();
    machine.rotary[0].range = [-110.0, 30.0];
    let wrong = on(&machine, "G21 G90\nG0 A-150. C0.\nA0.\nG43.4 H1 X0. Y0. Z60.\n").unwrap_err();
    let said = "A would have to be at -150.000°, and goes from -110° to 30°";
    assert!(wrong.line == Some(2) && wrong.what.starts_with(said), "{}", wrong.what);
}

#[test]
fn long_turns_as_written_are_remarked_once() {
    let mut machine = trunnion();
    let program = "G21 G90 G0 A-30. C320.\nG43.4 H1 X0. Y0. Z60.\nG1 C140. F100\nC320.\nC40.\nC350.\n";
    let path = on(&machine, program).unwrap();
    let said = "line 5: C turns by 280° as written; a control whose axis rolls over takes the short way, so check its settings";
    assert_eq!(path.remarks, [said]);
    // Steps say their own way, and an axis with ends has one way only.
    let steps = on(&machine, "G21 G90 G0 A0. C0.\nG43.4 H1 X0. Y0. Z60.\nG91 G1 C280. F100\n").unwrap();
    assert!(steps.remarks.is_empty(), "{:?}", steps.remarks);
    machine.rotary[1].range = [-400.0, 400.0];
    assert!(on(&machine, program).unwrap().remarks.is_empty());
}

#[test]
fn with_the_centre_point_kept_axes_may_be_said_one_after_another() {
    let machine = trunnion();
    for (text, line) in [
        ("G0 A0. C0.\nG43.4 H1 X0. Y-80.\nZ10.\nG1 Y-31. F400\n", 4),
        ("G0 A-90. C90.\nG43.4 H1 X0.\nY-80.\nZ10.\nG1 Y-31. F400\n", 5),
        // Angles last, and a table's turn on the way, which the tip follows.
        ("G43.4 H1 G0 X0. Y-80. Z10.\nC30.\nA0.\nG1 Y-31. F400\n", 4),
        ("G0 A0. C0.\nG43.4 H1 X0. Y-80.\nA-90.\nZ10.\nG1 Y-31. F400\n", 5),
        // The origin moves by 10 along x.
        ("G0 A0. C0.\nG55 G43.4 H1 X-10. Y-80.\nG54 Z10.\nG1 Y-31. F400\n", 4),
        ("G0 A0. C0.\nG43.4 H1 X0. Y-90.\nG91 Y10.\nG90 Z10.\nG1 Y-31. F400\n", 5),
    ] {
        let path = on(&machine, &format!("G21 G90\n{text}"))
            .unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what));
        assert_eq!(positions(&path), [[0.0, -80.0, 10.0], [0.0, -31.0, 10.0]], "{text}");
        assert_eq!(path.locations[0].line, line, "{text}");
    }
    // What was said with the centre point kept does not hold without.
    let ended = "G21 G90 G0 A-90. C0.\nG43.4 H1 X0. Y-80.\nG49\nG43.4 H1 Z10.\nG1 Y3. F9\n";
    assert_refused(on(&machine, ended), 5, "where X stands is not known");
}

#[test]
fn any_number_without_a_decimal_point_is_remarked() {
    let machine = trunnion();
    let start = "G21 G90 G0 A0. C0.\nG43 H1 X0. Y0. Z9.\n";
    for text in ["G1 A-90 F9", "G1 C5 F9", "G2 X1. I.5 J0 F9", "G2 X2. I1 F9", "G2 X2. R1 F9"] {
        let path = on(&machine, &format!("{start}{text}\n")).unwrap();
        let said = "line 3: numbers without a decimal point are taken as whole units";
        let expected: &[&str] = if text.contains("J0") { &[] } else { &[said] };
        assert_eq!(path.remarks, expected, "{text}");
    }
}

mod blocks;
mod cycles;
mod dialects;
