//! Words that would be lost beside others, and tools that change without a word.

use super::*;

const START: &str = "G21 G90 G17\nG0 X0. Y0. Z9.\n";

fn said_of(text: &str) -> String {
    let wrong = read(&format!("{START}{text}\n")).unwrap_err();
    assert_eq!(wrong.line, Some(2 + text.lines().count()), "{text}");
    wrong.what
}

#[test]
fn a_dwell_swallows_no_motion() {
    for (text, letter) in [
        ("G4 P0.5 X60.", 'X'),
        ("G1 G4 P0.5 X60.", 'X'),
        ("G4 P1 G0 X60.", 'X'),
        ("G4 U60. X5.", 'X'),
        ("G1 G4 X60.", 'X'),
        ("G0 G4 U5.", 'U'),
        ("G4 F2. X60.", 'X'),
        ("G4 G28 X0.", 'X'),
        ("G4 P1 U5.", 'U'),
    ] {
        let said = format!("{letter} stands beside G4, which waits: write it in a line of its own");
        assert_eq!(said_of(text), said, "{text}");
    }
    for text in ["G4 X2.0", "G4 U2.0", "G4 P500", "G4 F2.", "G1 G4 P1"] {
        assert!(read(&format!("{START}{text}\n")).is_ok(), "{text}");
    }
}

#[test]
fn of_words_that_exclude_each_other_none_wins() {
    for (text, first, second) in [
        ("G90 G91 X3.", "90", "91"),
        ("G20 G21 X3.", "20", "21"),
        ("G17 G18", "17", "18"),
        ("G43 G49 H1", "43", "49"),
        ("G49 G43.4 H1", "49", "43.4"),
        ("G54 G55", "54", "55"),
        ("G61 G64 P.1", "61", "64"),
    ] {
        let said = format!(
            "G{second} stands beside G{first} in one line, and each ends the other: write one of them"
        );
        assert_eq!(said_of(text), said, "{text}");
    }
    assert!(read(&format!("{START}G90 G17 G21 G40 G49 G54 G80 G90 G94\n")).is_ok());
}

#[test]
fn another_length_is_another_tool() {
    let program = "G21 G90 G17\nG43 H1 G0 X-60. Y0. Z50.\nG1 Z35. F500\nM0 (CHANGE TO TOOL 2)\nG43 H2 Z50.\n";
    let wrong = read(program).unwrap_err();
    let said = "H2 is the length of another tool than H1, and nothing changes to it: write T2 M6 before";
    assert_eq!((wrong.line, wrong.what.as_str()), (Some(5), said));
    for changed in [program.replace("M0", "G0 T2 M6 X0. Y0."), program.replace("H2", "H1")] {
        assert!(read(&changed).is_ok(), "{changed}");
    }
}

#[test]
fn another_edge_is_told() {
    let program = "G21 G90 G17\nT1 M6\nD1\nG0 X-60. Y0. Z50.\nG1 Z35. F500\nD2\nG1 X60. Z34.\nD1 Z9.\n";
    let path = read(program).unwrap();
    let told: Vec<&String> = path.remarks.iter().filter(|remark| remark.contains("edge")).collect();
    assert_eq!(told.len(), 1, "{:?}", path.remarks);
    assert!(told[0].starts_with("line 7: the tool moves by its edge D2, and before by D1: "), "{}", told[0]);
    // Another tool has edges of its own, and beside G43 D is not an edge.
    for quiet in [
        program.replace("D2", "T2 M6\nD2\nG0 X0. Y0. Z50.").replace("D1 Z9.", "D2 Z9."),
        program.replace("G0 X-60.", "G43 H1 G0 X-60."),
    ] {
        let path = read(&quiet).unwrap();
        assert!(path.remarks.iter().all(|remark| !remark.contains("edge")), "{:?}", path.remarks);
    }
}

#[test]
fn behind_its_end_a_program_does_not_go_on() {
    for text in ["F500 G1 X60. Z10.", "(next) G1 X-60. Z10.", "S500 X60.", "H1 G43 Z5."] {
        let wrong = said_of(&format!("M30\n{text}"));
        assert!(wrong.contains("after the end of the program in line 3"), "{text}: {wrong}");
    }
}

#[test]
fn a_program_ends_with_its_second_percent_sign() {
    let moves = "G21 G90 G0 X1. Y1. Z9.\n";
    assert!(read(&format!("(HEAD)\n%\n{moves}%\nby: someone\n")).is_ok());
    assert_refused(read(&format!("%\n{moves}%\nG1 X0. Z0.\n")), 4, "after the end of the program in line 3");
    assert!(read(&format!("%100 (HEAD)\n{moves}")).is_ok());
    assert_refused(read(&format!("% G0 Z-5.\n{moves}")), 1, "behind '%'");
    assert_refused(read(&format!("{moves}%\nG1 X0. Z0.\n")), 3, "after the end of the program in line 2");
}

#[test]
fn what_a_program_leaves_out_is_said() {
    for (text, said) in [
        ("G21 G0 X1. Y1. Z9.\n", "line 1: the program moves without G90 or G91"),
        ("G21 G90 G57\nG0 X1. Y1. Z9.\n", "line 2: the zero of G57 is taken to be the part's"),
        ("G21 G90 T1 M6\nG43 G0 X1. Y1. Z9.\n", "line 2: no H names the tool's length"),
    ] {
        assert_eq!(
            read(text).unwrap().remarks.iter().filter(|remark| remark.starts_with(said)).count(),
            1,
            "{text}"
        );
    }
    let said = read("G21 G90 G54 T1 M6\nG43 H1 G0 X1. Y1. Z9.\n").unwrap().remarks;
    assert!(said.is_empty(), "{said:?}");
}

#[test]
fn marks_of_byte_order_are_no_words() {
    let text = "\u{feff}%\n\u{feff}G21 G90 G17\nG0 X1. Y2. Z3.\nM30\n\u{feff}%\n";
    let path = Toolpath::parse(text, LengthUnit::Mm, "joined").unwrap();
    assert_eq!(path.locations[0].pose.position.to_array(), [1.0, 2.0, 3.0]);
}

#[test]
fn a_program_that_was_cut_short_is_not_taken_for_a_whole_one() {
    let parse = |text: &str| parse(text, &LengthUnit::Mm.into());
    let start = "%\nG21 G90 G0 X1. Y1. Z99.\n";
    for cut in ["G1 Z6", "G1 Z6. ", "N5 M3", "G54"] {
        let said =
            "the file ends in the middle of a line, perhaps of a number; if it is whole, end its last line";
        assert_refused(parse(&format!("{start}{cut}")), 3, said);
    }
    // What moves nothing may end without an end of its line; between two lines a cut cannot be told.
    for (whole, ends) in [
        ("M30", true),
        ("N9 G0 Z99. M2", true),
        ("%", true),
        ("M30\n%\nby: someone", true),
        ("(LAST)", false),
        ("G1 Z9. (LAST)", false),
        ("; last", false),
        ("  ", false),
        ("G1 Z9.\n", false),
    ] {
        let path =
            parse(&format!("{start}{whole}")).unwrap_or_else(|wrong| panic!("{whole}: {}", wrong.what));
        let told = path.remarks.iter().filter(|remark| **remark == format!("line 3: {NO_END}")).count();
        assert_eq!(told, usize::from(!ends), "{whole}: {:?}", path.remarks);
    }
}
