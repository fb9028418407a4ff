//! Drilling cycles, against the motions that they stand for.

use super::*;

const START: &str = "G21 G90 G17 T1 M6\nG0 X0. Y0.\nG43 H1 Z50.\n";

/// The same places and kinds of motion, whatever lines they come from.
#[track_caller]
fn assert_same(cycles: &str, motions: &str) {
    let ways = |text: &str| -> Vec<([f64; 3], MoveKind)> {
        let path = read(&format!("{START}{text}")).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what));
        positions(&path).into_iter().zip(path.locations.iter().map(|l| l.kind)).collect()
    };
    assert_eq!(ways(cycles), ways(motions), "{cycles}");
}

#[test]
fn holes_are_their_motions() {
    let first = "G0 X5. Y6.\nZ2.\nG1 Z-9. F50\n";
    assert_same(
        "G98 G81 X5. Y6. Z-9. R2. F50\nX7.\nG80\nG0 Z60.\n",
        &format!("{first}Z2.\nG0 Z50.\nX7.\nZ2.\nG1 Z-9.\nZ2.\nG0 Z50.\nZ60.\n"),
    );
    // To R between the holes; another depth; and a cycle that pecks after one that does not.
    assert_same(
        "G99 G73 X5. Y6. Z-9. R2. Q1. F50\nX7. Z-4.\nG98 Y8.\nG83 Y9. Z-5. R3. Q2. P100\nG0 X0.\n",
        &format!(
            "{first}Z2.\nG0 X7.\nG1 Z-4.\nZ2.\nG0 Y8.\nG1 Z-4.\nZ2.\nG0 Z50.\nY9.\nZ3.\nG1 Z-5.\nZ3.\nG0 Z50.\nX0.\n"
        ),
    );
    // Where the tool stands, and none.
    for word in ["G84", "G85", "G89 P1."] {
        assert_same(&format!("G98 {word} Z-9. R2.\n"), "G0 Z2.\nG1 Z-9.\nZ2.\nG0 Z50.\n");
        assert_same(&format!("G99 {word} Z-9. R2.\n"), "G0 Z2.\nG1 Z-9.\nZ2.\n");
    }
    assert_same("G98 G81 Z-9. R2. L0\nX5. Y6.\nG80\n", &format!("{first}Z2.\nG0 Z50.\n"));
    // By steps, as often as it says.
    assert_same("G91 G98 G82 X5. Y1. R-48. Z-11. L2\n", &{
        let hole = |x: f64, y: f64| format!("G0 X{x:.1} Y{y:.1}\nZ2.\nG1 Z-9.\nZ2.\nG0 Z50.\n");
        hole(5.0, 1.0) + &hole(10.0, 2.0)
    });
    assert_same("G98 G81 X5. Y6. Z-9. R2. L3\n", &format!("{first}Z2.\nG0 Z50.\n"));
}

#[test]
fn on_a_machine_holes_go_along_z_of_the_program() {
    let machine = trunnion();
    let start = "G21 G90 G0 A0. C0.\nG43 H1 X0. Y0. Z50.\n";
    let [cycle, motions] = ["G98 G81 X5. A-90. Z20. R30.\n", "X5. A-90.\nZ30.\nG1 Z20. F9\nZ30.\nG0 Z50.\n"]
        .map(|text| positions(&on(&machine, &format!("{start}{text}")).unwrap()));
    assert_eq!(cycle, motions);
    let kept = "G21 G90 G0 A0. C0.\nG43.4 H1 X0. Y0. Z50.\nG98 G81 X5. Z20. R30.\n";
    assert_refused(on(&machine, kept), 3, "G81 while the tool's centre point is kept");
}

#[test]
fn what_controls_do_otherwise_is_refused_or_said() {
    for (text, said) in [
        ("G81 X5. Z-9.", "G81 needs Z and R"),
        ("G81 X5. R2.", "G81 needs Z and R"),
        ("G98 G81 X5. Z-9. R2.\nG83 X6. Q1.", "G83 needs Z and R"),
        ("G81 X5. Z-9. R60.", "R lies above the tool"),
        ("G81 X5. Z9. R2.", "Z of G81 lies above its R"),
        ("G18 G81 X5. Z-9. R2.", "write G17 before"),
        ("G0 G81 X5. Z-9. R2.", "G81 is a second kind of motion"),
        ("G98 G99 G81 X5. Z-9. R2.", "each ends the other"),
        ("G81 X5. Z-9. R2. L0", "differs from control to control"),
        ("G91 G83 X5. Z-9. R-2. Q1. K2.", "differs from control to control"),
        ("G91 G99 G81 X5. Z-9. R-2.\nX5.", "what R and Z are steps from"),
        ("G91 G98 G81 X5. Z-9. R-2.\nX5. Z-3.", "what R and Z are steps from"),
        ("G81 X5. Z-9. R2. U1.", "U is not understood"),
        ("G76 X5. Z-9. R2. Q1.", "G76 is a cycle"),
        ("G98 G81 X5. Z-9. R2.\nG80\nX6.", "none of G0, G1, G2 and G3"),
        ("G98 G81 X5. Z-9. R2.\nT2 M6\nX6.", "none of G0, G1, G2 and G3"),
        ("T2 M6\nG81 X5. Y5. Z-9. R2.", "G81 begins where Z is not known"),
    ] {
        assert_refused(read(&format!("{START}{text}\n")), 3 + text.lines().count(), said);
    }
    let remarks = read(&format!("{START}G81 X5. Z-9. R2. F9\nG80\nM30\n")).unwrap().remarks;
    assert_eq!(remarks, ["line 4: a cycle without G98 or G99 is taken to end where it began (G98)"]);
}
