//! Words that not every control has, or that mean something else on another one.

use super::*;

const START: &str = "G21 G90 G17 T1 M6\nG43 H1 G0 X1. Y2. Z9.\n";

fn path_of(text: &str) -> Toolpath {
    read(&format!("{START}{text}\n")).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what))
}

#[test]
fn words_of_other_controls_that_move_nothing_are_read() {
    for text in [
        "G40.1",
        "G50",
        "G50 S2000",
        "G50.1",
        "G92.1",
        "G450",
        "G601",
        ":20 G1 X2. F9",
        "M19 R90.",
        "G96 S200",
        "<TOP>",
        "G1 X2. M9 N7 F3.",
    ] {
        assert!(path_of(text).remarks.is_empty(), "{text}: {:?}", path_of(text).remarks);
    }
    for text in ["G5 P10000", "G642"] {
        let path = path_of(text);
        assert!(path.remarks[0].contains("the control may leave the path at corners"), "{text}");
    }
    for text in ["$TOP.MIN%\n", ":0100\n", "%\n<TOP>\n"] {
        assert!(is_program(text, "a"), "{text}");
        assert_eq!(positions(&read(&format!("{text}{START}")).unwrap()), [[1.0, 2.0, 9.0]], "{text}");
    }
    for (unit, x) in [("G70", 25.4), ("G71", 1.0)] {
        assert_eq!(positions(&read(&format!("{unit} G90 G0 X1. Y0. Z0.\n")).unwrap()), [[x, 0.0, 0.0]]);
    }
}

#[test]
fn the_same_words_are_refused_where_they_mean_more() {
    for (text, said) in [
        ("G58 X60.", "X stands beside G58 without a motion, which shifts the zero on some controls"),
        ("G50 X5. Z5.", "X stands beside G50, which is understood as the end of scaling"),
        ("G92.1 X5.", "X stands beside G92.1, which is understood as the end of a shift"),
        ("G5 X9. I1. J2. P3. Q4.", "X stands beside G5,"),
        ("G5 I1. P3.", "I stands beside G5,"),
        ("G5", "G5 is understood with P alone"),
        ("G70 I5. L6", "L is not understood"),
        ("M98 P20", "M98 is not understood"),
        ("M21", "M21 is not understood"),
        ("G1 X2. M19 R90.", "belong to an arc"),
    ] {
        assert_refused(read(&format!("{START}{text}\n")), 3, said);
    }
    for (word, told) in [("G154 P3", "G54.1 P3"), ("G54.1 P3", "G54.1 P3")] {
        let path = read(&format!("G21 G90 {word} T1 M6\nG43 H1 G0 X1. Y2. Z9.\n")).unwrap();
        assert_eq!(
            path.remarks,
            [format!("line 2: the zero of {told} is taken to be the part's: no machine says where it lies")]
        );
    }
    assert_refused(read(&format!("{START}G54.1 X3.\n")), 3, "needs its number, P1 to P99");
    assert_refused(read(&format!("{START}G54.1 P2\n")), 3, "G54.1 P2 is another work offset");
    // With the motion in its line it is an offset.
    assert_eq!(positions(&read("G21 G90 G58 G0 X1. Y2. Z9.\n").unwrap()), [[1.0, 2.0, 9.0]]);
}

#[test]
fn the_machines_own_words_and_axes_at_zero_are_remarked_once() {
    let path = path_of("M88 P1 R2.\nG1 A0. X2. F9\nM88 M31\nC0.");
    assert_eq!(positions(&path), [[1.0, 2.0, 9.0], [2.0, 2.0, 9.0]]);
    let said = ["line 3: what M88 does", "line 4: A0 is taken to leave an axis", "line 5: what M31 does"];
    assert_eq!(path.remarks.len(), said.len(), "{:?}", path.remarks);
    assert!(
        path.remarks.iter().zip(said).all(|(remark, said)| remark.starts_with(said)),
        "{:?}",
        path.remarks
    );
    assert_refused(read(&format!("{START}G1 A0.\nA5.\n")), 4, "A5. turns a rotary axis");
}

#[test]
fn home_without_axes_is_a_place_that_is_not_known() {
    for word in ["G28", "G30", "G91 G30 X0. Y0. Z0.", "G30 X1. Y2. Z9."] {
        let path = path_of(&format!("{word}\nG90 G0 X3. Y4. Z5."));
        assert_eq!(positions(&path).last(), Some(&[3.0, 4.0, 5.0]), "{word}");
        assert_eq!(path.locations.last().unwrap().kind, MoveKind::Start, "{word}");
        assert!(path.remarks[0].contains(" goes to the machine's own place"), "{word}: {:?}", path.remarks);
    }
    assert_refused(read(&format!("{START}G28\nX5.\nG1 Y5.\n")), 5, "where Z stands is not known");
    let path = path_of("G91 G28 A0.\nG90 G1 X5. F9");
    assert_eq!(path.starts(), 1, "{:?}", path.remarks);
    let start = "G21 G90 G0 A0. C0.\nG43 H1 X0. Y0. Z9.\n";
    for (text, said) in
        [("G28", "which axes move"), ("G91 G30 Z0.", "write G53"), ("G53 G0", "which axes move")]
    {
        assert_refused(on(&trunnion(), &format!("{start}{text}\n")), 3, said);
    }
}

#[test]
fn what_a_file_holds_does_not_reach_a_terminal_as_it_is() {
    let wrong = Toolpath::parse("G21 G90\nG1 \u{1b}[31mX1.\n", LengthUnit::Mm, "a.nc").unwrap_err();
    assert!(wrong.to_string().contains("'\\u{1b}' is not understood"), "{wrong}");
}
