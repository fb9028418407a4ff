//! Statements: what is followed, and where, and what is refused.

use glam::DVec3;

use super::*;
use crate::check::{CheckBodies, CheckSettings, check_stock};
use crate::control::Control;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::tool::Tool;
use crate::toolpath::error::tests::assert_refused;

#[test]
fn positions_axes_units_and_tools_are_read() {
    let text = "PARTNO BRACKET 5X / REV 2\n$$ a comment, GOTO/9,9,9\nUNITS/INCHES\nMULTAX/ON\nLOADTL/4,LENGTH,80\n\
                MSYS/0.0000,0.0000,0.0000,1.0000000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000\n\
                fedrat/20.,IPM\nFROM/0.,0.,1.\nRAPID\nGOTO / 1., 2.,$\n .5, 0., 0.6, 0.8 $$ tilted\nGOTO/1,2,3\n\
                GODLTA/0,0,-1\nTLAXIS/1,0,0\nGOTO/0,0,0\nFINI\n";
    let path = parse(text, LengthUnit::Mm).unwrap().locations;
    let lines: Vec<usize> = path.iter().map(|l| l.line).collect();
    assert_eq!(lines, [8, 10, 12, 13, 15]);
    let (position, axis) = (|i: usize| path[i].pose.position, |i: usize| path[i].pose.axis().unwrap());
    assert_eq!(position(0), DVec3::new(0.0, 0.0, 25.4));
    assert!((axis(1) - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-15);
    assert_eq!(axis(2), axis(1));
    assert!((position(3).z - 50.8).abs() < 1e-12);
    assert_eq!(axis(4), DVec3::X);
    assert_eq!((path[0].kind, path[1].kind, path[4].tool), (MoveKind::Start, MoveKind::Rapid, Some(4)));
}

#[test]
fn tools_are_known_by_number_alone() {
    let of = |text: &str| parse(text, LengthUnit::Mm).map(|path| path.locations.last().unwrap().tool);
    assert_eq!(of("LOAD/TOOL,62,ADJUST,62\nSELECT/TOOL,3\nGOTO/1,2,3\n").unwrap(), Some(62));
    let first = "TOOL PATH/A,TOOL,D10\nTLDATA/MILL,10\nGOTO/1,2,3\n";
    // The same description again, and another one with its number before or after.
    assert_eq!(of(&format!("{first}TOOL PATH/B,TOOL,D10\nTLDATA/MILL,10\nGOTO/1,2,4\n")).unwrap(), None);
    for change in ["TLDATA/MILL,6\nLOADTL/2\n", "LOADTL/2\nTLDATA/MILL,6\n"] {
        assert_eq!(of(&format!("{first}{change}GOTO/1,2,4\n")).unwrap(), Some(2));
    }
    let lower = "tool path/a,tool,d10\nGOTO/1,2,3\ntool path/b,tool,d6\nGOTO/1,2,4\n";
    assert_refused(of(lower), 3, "TOOL PATH describes another tool");
    let upper = format!("{first}TOOL PATH/B,TOOL,D6\nGOTO/1,2,4\n");
    assert_refused(of(&upper), 4, "TOOL PATH describes another tool");
}

#[test]
fn cutters_are_read_in_the_files_unit_and_belong_to_the_tool_that_follows() {
    let text =
        "UNITS/INCH\nLOADTL/1\nCUTTER/.5,.125\nGOTO/1,2,3\nTLDATA/MILL,.25,0,3,0,0\nLOADTL/2\nGOTO/1,2,3\n";
    let cutters = |text: &str| -> Vec<_> {
        let path = parse(text, LengthUnit::Mm).unwrap();
        path.cutters.iter().map(|c| (c.line, c.tool, c.diameter, c.corner_radius)).collect()
    };
    assert_eq!(cutters(text), [(3, Some(1), 12.7, Some(3.175)), (5, Some(2), 6.35, Some(0.0))]);
    // In lower case, and in the unit that stands behind it.
    let text = "CUTTER/.5,.125\nLOADTL/1\nunits/inch\nGOTO/1,2,3\ntldata/mill,.25,0\nload/tool,2\nunits/inch\nGOTO/1,2,3\n";
    assert_eq!(cutters(text), [(1, Some(1), 12.7, Some(3.175)), (5, Some(2), 6.35, Some(0.0))]);
    assert_refused(parse("CUTTER/BALL\nGOTO/1,2,3\n", LengthUnit::Mm), 1, "'BALL' is not a number");
}

#[test]
fn what_is_not_followed_is_refused_with_its_line() {
    let cases = [
        ("GOTO/1,2,3\nGOTO/1,2\n", 2, "3 or 6"),
        ("\nGOTO/1,2,x\n", 2, "'x'"),
        ("GODLTA/1,2,3\n", 1, "before any"),
        ("UNITS/FURLONG\n", 1, "furlong"),
        ("GOTO/1,2,3,0,0,0\n", 1, "zero"),
        ("GOTO/1,2,3\nCYCLE/DRILL,9,1\n", 2, "CYCLE moves"),
        ("CIRCLE/0,0,0,0,0,1,5\n", 1, "GOTO/ lines"),
        ("CYCLE/OFF\nFIXTUR/2\n", 2, "'FIXTUR' is not understood"),
        ("INSERT/G54\n", 1, "'INSERT' is not understood"),
        ("GOTO/1,2,3\nTRANS/0,0,50\n", 2, "TRANS/0,0,50 changes where"),
        ("ROTATE/AAXIS,90\n", 1, "changes where"),
        ("ROTABL/90\n", 1, "changes where"),
        ("TRANS/0,0,-50\n", 1, "coordinate system"),
        ("MSYS/0,0,-50,1,0,0,0,1,0\n", 1, "changes where"),
        ("ORIGIN/1,0,0\n", 1, "changes where"),
        ("COPY/1,TRANSL,5,0,0,3\n", 1, "changes where"),
        ("TRACUT/1\n", 1, "changes where"),
        ("CUTCOM/LEFT\n", 1, "changes where"),
        ("MODE/INCR\n", 1, "changes where"),
        ("LOADTL/BALL6\n", 1, "does not say the tool's number"),
        ("AUXFUN/8\nAUXFUN/6\n", 2, "changes the tool"),
        ("FEDRAT/20,MMPM\nFEDRAT/RAPID\n", 2, "FEDRAT/RAPID is not understood: write RAPID"),
        ("AUXFUN/21\n", 1, "AUXFUN/21 is not understood and might move the machine"),
        ("AUXFUN/ 8,NEXT\nAUXFUN/98,NEXT\n", 2, "AUXFUN/98,NEXT is not understood"),
        ("AUXFUN/PALLET\n", 1, "AUXFUN/PALLET is not understood"),
        (
            "OPSKIP/OFF\nOPSKIP/ON\n",
            2,
            "the lines after OPSKIP/ON are skipped or not by a switch of the machine",
        ),
        ("MULTAX/4\n", 1, "MULTAX/4 is not understood"),
    ];
    for (text, line, what) in cases {
        assert_refused(parse(text, LengthUnit::Mm), line, what);
    }
    let idle = "TRANS/0,0,0\nORIGIN/0.,0.,0.\nCUTCOM/OFF\nTRACUT/NOMORE\nCYCLE/OFF\nMODE/MILL\nGOTO/1,2,3\n";
    assert_eq!(parse(idle, LengthUnit::Mm).unwrap().locations.len(), 1);
}

#[test]
fn without_multax_the_tool_stands_upright() {
    let text = "MULTAX/ON\nGOTO/1,2,3,-1,0,0\nGOTO/1,2,4\nMULTAX/OFF\nGOTO/1,2,5\nGOTO/1,2,6,0,0,2\nMULTAX\nGOTO/1,2,7,0,1,0\n";
    let path = parse(text, LengthUnit::Mm).unwrap().locations;
    let axes: Vec<DVec3> = path.iter().map(|l| l.pose.axis().unwrap()).collect();
    assert_eq!(axes, [DVec3::NEG_X, DVec3::NEG_X, DVec3::Z, DVec3::Z, DVec3::Y]);
    for (turns, word) in
        [("GOTO/1,2,3,0,.6,.8", "GOTO"), ("FROM/1,2,3,0,0,-1", "FROM"), ("TLAXIS/1,0,0", "TLAXIS")]
    {
        let wrong = parse(&format!("MULTAX/OFF\nGOTO/1,2,3\n{turns}\n"), LengthUnit::Mm).unwrap_err();
        assert_eq!(wrong.line, Some(3), "{turns}");
        assert!(wrong.what.starts_with(&format!("{word} turns the tool to (")), "{}", wrong.what);
        assert!(wrong.what.ends_with("after MULTAX/OFF, where it stands along +z: write MULTAX/ON before"));
    }
}

#[test]
fn where_the_tool_is_said_to_be_is_no_cut() {
    let text = "UNITS/MM\nRAPID\nGOTO/-60,0,35\nFROM/60,0,35\nRAPID\nGOTO/-60,0,35\nGOTO/-60,0,36\n";
    let path = Toolpath::parse(text, LengthUnit::Mm, "a").unwrap();
    let kinds: Vec<MoveKind> = path.locations.iter().map(|l| l.kind).collect();
    assert_eq!(kinds, [MoveKind::Start, MoveKind::Start, MoveKind::Rapid, MoveKind::Feed]);
    // It takes nothing of a stock that lies between there and where the tool was.
    let grid = Grid { origin: DVec3::new(-20.0, -20.0, 20.0), pitch: 1.0, dims: [40, 40, 20] };
    let stock = Occupancy { grid, solid: vec![1; grid.len()] };
    let part = Occupancy::empty(grid);
    let bodies = CheckBodies::of_part(&part);
    let settings = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
    let tools = [(None, &Tool::paper())];
    let left = |text: &str| {
        let path = Toolpath::parse(text, LengthUnit::Mm, "a").unwrap();
        check_stock(bodies, &stock, &tools, &path, &settings, Control::quiet()).unwrap().remaining
    };
    assert_eq!(left("RAPID\nGOTO/-60,0,35\nFROM/60,0,35\n").solid, stock.solid);
    assert_ne!(left("RAPID\nGOTO/-60,0,35\nGOTO/60,0,35\n").solid, stock.solid);
}

#[test]
fn texts_and_comments_swallow_no_motion() {
    for text in ["PPRINT COST IN US$", "$$ COST IN US$", "$$-> COST / US$"] {
        let path = parse(&format!("UNITS/MM\n{text}\nGOTO/1,2,3\nFINI\n"), LengthUnit::Mm).unwrap();
        assert_eq!(path.locations.iter().map(|l| l.line).collect::<Vec<_>>(), [3], "{text}");
        assert_eq!(path.remarks, Vec::<String>::new());
    }
    let creo = |x: &str| {
        let system =
            format!("$$-> CSYS / 1.0, 0.0, 0.0, {x},  $\n 0.0, 1.0, 0.0, 0.0,  $\n 0.0, 0.0, 1.0, 0.0\n");
        parse(&format!("UNITS / MM\n{system}GOTO / 1, 2, 3\nFINI\n{system}"), LengthUnit::Mm).unwrap()
    };
    assert_eq!(creo("0.0000").remarks, Vec::<String>::new());
    let moved = creo("100.0000");
    assert_eq!(moved.locations[0].pose.position, DVec3::new(1.0, 2.0, 3.0));
    let said = "line 2: the file states a coordinate system moved by (100, 0, 0): its coordinates are taken as they stand";
    assert!(moved.remarks.len() == 1 && moved.remarks[0].starts_with(said), "{:?}", moved.remarks);
}

#[test]
fn a_unit_that_is_not_said_is_remarked_once() {
    let path = parse("LOADTL/1\nGOTO/1,2,3\nGOTO/1,2,4\nFINI\n", LengthUnit::Inch).unwrap();
    assert_eq!(path.remarks, ["line 2: the file moves without UNITS/: its unit is taken to be inch"]);
}

#[test]
fn locations_before_the_first_tool_call_are_its_tools() {
    let catia = "UNITS/MM\nRAPID\nGOTO/0,0,100\nCUTTER/10,5,0,5,0,$\n 0,100\nLOADTL/1\nGOTO/0,0,40\nLOADTL/2\nGOTO/0,0,50\nFINI\n";
    let path = parse(catia, LengthUnit::Mm).unwrap();
    assert_eq!(path.locations.iter().map(|l| l.tool).collect::<Vec<_>>(), [Some(1), Some(1), Some(2)]);
    assert_eq!(path.cutters.iter().map(|c| (c.line, c.tool)).collect::<Vec<_>>(), [(4, Some(1))]);
    let said =
        "line 3: the tool of the locations before the first tool call is taken to be the one called there, 1";
    assert_eq!(path.remarks, [said]);
    // What was described as another tool stays another one.
    let other =
        parse("UNITS/MM\nCUTTER/6\nGOTO/0,0,9\nCUTTER/10\nLOADTL/1\nGOTO/0,0,9\nFINI\n", LengthUnit::Mm)
            .unwrap();
    assert_eq!(other.locations.iter().map(|l| l.tool).collect::<Vec<_>>(), [None, Some(1)]);
    assert!(other.remarks.is_empty(), "{:?}", other.remarks);
}

#[test]
fn a_file_that_was_cut_short_is_not_taken_for_a_whole_one() {
    let start = "UNITS/MM\nGOTO/0,0,99\n";
    for cut in ["GOTO/0,0,9", "SPINDL/OF"] {
        assert_refused(
            parse(&format!("{start}{cut}"), LengthUnit::Mm),
            3,
            "the file ends in the middle of a line",
        );
    }
    for (whole, ends) in [("FINI", true), ("END-OF-PATH", true), ("$$ last", false), ("GOTO/0,0,9\n", false)]
    {
        let path = parse(&format!("{start}{whole}"), LengthUnit::Mm).unwrap();
        let told =
            path.remarks.iter().any(|remark| remark.starts_with("line 3: the file stops here without FINI"));
        assert_eq!(told, !ends, "{whole}: {:?}", path.remarks);
    }
}

#[test]
fn what_follows_the_end_of_a_program_is_refused_unless_it_is_text() {
    let program = "UNITS/INCHES\nGOTO/-2,0,2\nFINI\n";
    for more in ["PPRINT the end\n", "FINI\n", "END\n", "$$ text\n"] {
        assert!(parse(&format!("{program}{more}"), LengthUnit::Mm).is_ok(), "{more}");
    }
    let fault = parse(&format!("{program}PARTNO B\nGOTO/-50,0,25\nFINI\n"), LengthUnit::Mm).unwrap_err();
    assert!(fault.line == Some(5) && fault.what.contains("a file of its own"), "{fault:?}");
    assert!(parse("UNITS/MM\nGOTO/0,0,9\nEND-OF-PATH\nGOTO/0,0,8\nFINI\n", LengthUnit::Mm).is_ok());
}
