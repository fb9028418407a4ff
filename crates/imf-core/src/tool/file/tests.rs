//! Tool files: what is read, and what is refused in which words.

use crate::tool::file::*;
use crate::tool::{ElementKind, Segment};

fn read(text: &str) -> Result<Tool, FileError> {
    Tool::parse(text, Path::new("tool.toml"))
}

const BALL: &str = "[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 35\n";

#[test]
fn the_papers_tool_can_be_written_down() {
    let tool = read(&format!("{BALL}[[holder]]\ndiameter = 29\nlength = 48\n")).unwrap();
    assert_eq!(tool.shape, Tool::paper().shape);
}

#[test]
fn stick_out_hides_what_is_in_the_holder() {
    let text = format!("stick_out = 30\n{BALL}[[holder]]\ndiameter = 29\nlength = 48\n");
    let tool = read(&text).unwrap();
    assert_eq!(tool.length(), 78.0);
    assert_eq!(tool.elements()[0].profile[1].range(), (5.0, 30.0));
    let text =
        format!("stick_out = 50\n{BALL}[shank]\ndiameter = 8\n[[holder]]\ndiameter = 29\nlength = 40\n");
    let tool = read(&text).unwrap();
    let shank = &tool.elements()[1];
    assert_eq!((shank.kind, shank.profile[0].range()), (ElementKind::Shank, (35.0, 50.0)));
}

#[test]
fn every_cutter_shape_is_smooth_where_arc_meets_flank() {
    for shape in [
        "'bull'\ncorner_radius = 2",
        "'tapered'\nhalf_angle = 8",
        "'tapered'\nhalf_angle = 8\ncorner_radius = 1",
    ] {
        let tool = read(&format!("[cutter]\nshape = {shape}\ndiameter = 10\nlength = 30\n")).unwrap();
        let [arc, line] = tool.elements()[0].profile[..] else { panic!() };
        let joint = arc.range().1;
        assert!((arc.radius(joint) - line.radius(joint)).abs() < 1e-12);
        let slope = |s: Segment, side: f64| (s.radius(joint + side * 1e-6) - s.radius(joint)) / (side * 1e-6);
        assert!((slope(arc, -1.0) - slope(line, 1.0)).abs() < 1e-5, "{shape}");
    }
    // A cone with a sharp corner has no arc.
    let cone = "[cutter]\nshape = 'tapered'\nhalf_angle = 45\ncorner_radius = 0\ndiameter = 1\nlength = 3\n";
    let tool = read(cone).unwrap();
    let [Segment::Line { radius_from, radius_to, .. }] = tool.elements()[0].profile[..] else { panic!() };
    assert!(radius_from == 0.5 && (radius_to - 3.5).abs() < 1e-12);
    let flat = read("[cutter]\nshape = 'flat'\ndiameter = 10\nlength = 30\n").unwrap();
    assert!((flat.volume() - 25.0 * std::f64::consts::PI * 30.0).abs() < 1e-9);
}

#[test]
fn a_lollipop_is_a_ball_down_to_its_shank() {
    let text = "[cutter]\nshape = \"lollipop\"\ndiameter = 10.0\n\n[shank]\ndiameter = 6.0\nlength = 20.0\n";
    let tool = read(text).unwrap();
    let outline = |height: f64| {
        tool.elements()
            .iter()
            .find(|e| e.profile[0].range().0 <= height && height < e.profile[0].range().1)
            .map(|e| e.profile[0].radius(height))
    };
    let found = [0.0, 5.0, 8.9, 9.1, 28.9].map(|height| outline(height).unwrap());
    let expected = [0.0, 5.0, (25.0_f64 - 3.9 * 3.9).sqrt(), 3.0, 3.0];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
    for (from, to, cause) in [
        ("10.0", "6.0", "thinner than its ball"),
        ("10.0\n", "10.0\nlength = 9.0\n", "remove cutter.length"),
        ("lollipop", "flat", "needs cutter.length"),
    ] {
        let error = read(&text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(cause) && error.contains("line "), "{error}");
    }
}

#[test]
fn a_drill_has_a_point_and_cuts_along_its_axis_alone() {
    let text = "[cutter]\nshape = \"drill\"\ndiameter = 6.0\npoint_angle = 118.0\nlength = 40.0\n";
    let tool = read(text).unwrap();
    assert!(tool.plunge_only);
    let [Segment::Line { to, radius_from, radius_to, .. }, flank] = tool.elements()[0].profile[..] else {
        panic!()
    };
    assert!((to * 59f64.to_radians().tan() - 3.0).abs() < 1e-12);
    assert!(radius_from == 0.0 && (radius_to - 3.0).abs() < 1e-12);
    assert_eq!(flank, Segment::cylinder(to, 40.0, 3.0));
    assert!(!read(&format!("{text}plunge_only = false\n")).unwrap().plunge_only);
    let flat = read(&text.replace("118", "180")).unwrap();
    assert_eq!(flat.elements()[0].profile, [Segment::cylinder(0.0, 40.0, 3.0)]);
    for (from, to, cause) in [
        ("point_angle = 118.0\n", "", "needs cutter.point_angle"),
        ("118", "200", "from 1 to 180"),
        ("40", "1", "shorter than the drill's point"),
        ("drill", "flat", "belongs to shape = \"drill\""),
    ] {
        let error = read(&text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(cause) && error.contains("line "), "{error}");
    }
}

#[test]
fn a_mesh_says_which_of_its_vertices_cut() {
    let folder = tempfile::tempdir().unwrap();
    let corners = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    std::fs::write(folder.path().join("head.obj"), corners).unwrap();
    let read = |within: &str| {
        let path = folder.path().join("tool.toml");
        std::fs::write(&path, format!("mesh = 'head.obj'\nsharp_points = {{ within = {within} }}")).unwrap();
        Tool::read(&path)
    };
    let SharpPoints::Points(points) = read("10").unwrap().sharp_points else { panic!() };
    assert_eq!(points.len(), 3);
    for wrong in ["0.5", "-1.0", "nan"] {
        let Fault { line, cause, .. } = read(wrong).unwrap_err().fault;
        assert!(line == Some(2) && cause.contains("within"), "{wrong}: {cause}");
    }
    // A face the other way round, and corners of each face's own: repaired.
    let whole = read("10").unwrap().volume();
    let turned = corners.replace("f 1 3 2", "f 1 2 3");
    let apart = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nv 0 1 0\nv 1 -1 0\nv 0 0 30\nv -1 -1 0\nv 1 -1 0\nv 0 0 30\nv 0 1 0\nv -1 -1 0\n\
                 v 0 0 30\nf 1 3 2\nf 7 8 9\nf 5 4 6\nf 10 11 12\n";
    for repaired in [&turned, apart] {
        std::fs::write(folder.path().join("head.obj"), repaired).unwrap();
        assert!((read("10").unwrap().volume() - whole).abs() < 1e-9);
    }
    // Without its bottom it says nowhere for certain what is inside.
    std::fs::write(folder.path().join("head.obj"), corners.replace("f 1 3 2\n", "")).unwrap();
    let Fault { kind, cause, .. } = read("10").unwrap_err().fault;
    assert!(kind == FaultKind::Malformed && cause.contains("open (3 boundary edges)"), "{cause}");
    assert!(cause.contains("one closed solid"), "{cause}");
}

#[test]
fn mistakes_name_their_line_and_key() {
    let cases = [
        ("[cutter]\nshape = 'ball'\ndiameter = -1\nlength = 35\n", 3, "cutter.diameter"),
        ("[cutter]\nshape = 'cube'\ndiameter = 1\nlength = 35\n", 2, "cube"),
        ("name = 'x'\n", 1, "[cutter]"),
        ("[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 35\ncolour = 3\n", 5, "colour"),
        ("[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 2\n", 4, "cutter.length"),
        ("[cutter]\nshape = 'bull'\ndiameter = 10\nlength = 20\ncorner_radius = 6\n", 5, "corner_radius"),
        ("stick_out = 90\n[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n", 1, "stick_out"),
        (
            "stick_out = 10\n[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n[shank]\ndiameter = 10\n[[holder]]\ndiameter = 29\n\
             length = 48\n",
            1,
            "stick_out",
        ),
        (
            "[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n[shank]\ndiameter = 10\n[[holder]]\ndiameter = 29\nlength = 48\n",
            6,
            "how long the [shank] is",
        ),
        ("sharp_points = 'all'\n[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n", 1, "sharp_points"),
        ("[cutter\n", 1, ""),
    ];
    for (text, line, key) in cases {
        let Fault { line: found, cause, .. } = read(text).unwrap_err().fault;
        assert_eq!(found, Some(line), "{text}: {cause}");
        assert!(cause.contains(key), "{text}: {cause}");
    }
    let missing = Tool::read(Path::new("no/such/tool.toml")).unwrap_err();
    assert_eq!(missing.fault.kind, FaultKind::Missing);
    #[cfg(unix)]
    {
        let endless = Tool::read(Path::new("/dev/zero")).unwrap_err();
        assert_eq!(endless.fault.kind, FaultKind::TooLarge, "{endless}");
    }
}
