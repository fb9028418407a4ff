//! Tools that are called, and what begins a program.

use super::super::error::tests::assert_refused;
use super::*;

fn read(text: &str) -> Result<Toolpath, Fault> {
    parse(text, &PathReading::default())
}

#[test]
fn a_tool_that_is_called_and_never_changed_to_is_told() {
    let start = "G21 G90 G54\nT1 M6\nG0 X0. Y0. Z9.\n";
    let told = |more: &str| {
        let path = read(&format!("{start}{more}M30\n")).unwrap();
        let tools: Vec<_> = path.locations.iter().map(|location| location.tool).collect();
        (
            path.remarks.iter().filter(|remark| remark.contains("is called")).cloned().collect::<Vec<_>>(),
            tools,
        )
    };
    let (remarks, tools) = told("M0\nT2\nX1.\n");
    assert!(
        remarks.len() == 1 && remarks[0].starts_with("line 5: T2 is called, and no M6 changes to it"),
        "{remarks:?}"
    );
    assert_eq!(tools, [Some(1); 2]);
    assert_eq!(told("T2\nX1.\nT3 M6\nX2.\n").0.len(), 0, "an M6 with a T of its own changes to that");
    // Called ahead, for the next change or the next run.
    for more in ["T2\nX1.\nM6\nX2.\nT1\nX3.\n", "X1.\nT2\n", "T1\nX1.\n"] {
        assert_eq!(told(more).0.len(), 0, "{more}");
    }
}

#[test]
fn the_only_tool_of_a_program_without_a_change_is_in_the_spindle() {
    let path = read("G21 G90\nT3\nG0 X0. Y0. Z9.\nG1 X5. F100\nM30\n").unwrap();
    assert!(path.locations.iter().all(|location| location.tool == Some(3)) && path.locations.len() == 2);
    assert!(path.remarks.iter().any(|remark| remark.starts_with("line 2: no M6 changes to the only tool")));
}

#[test]
fn programs_are_known_by_their_first_line() {
    for first in ["O1(TOP)", "N10(TOP)", "N10/M6", "O1001 (TOP)", "G21", "0 BEGIN PGM TOP MM"] {
        assert!(is_program(first, "path.txt"), "{first}");
    }
    for first in ["x,y,z", "GOTO/1,2,3", "0,0,0"] {
        assert!(!is_program(first, "path.txt"), "{first}");
    }
    assert_refused(read("0 BEGIN PGM TOP MM\n1 L X+0 Y+0 R0 FMAX\n"), 1, "Klartext is not read");
}
