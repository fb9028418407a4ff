//! Toolpaths over a block of known size.

use super::*;
use crate::field::ExactField;
use crate::grid::Grid;
use crate::scene::Bodies;
use crate::unit::LengthUnit;

/// What lies within a box on a grid of 1 mm.
fn solid_within(lower: DVec3, upper: DVec3) -> Occupancy {
    let grid = Grid { origin: DVec3::new(-30.0, -30.0, -5.0), pitch: 1.0, dims: [60, 60, 60] };
    let inside = |p: DVec3| p.cmpgt(lower).all() && p.cmplt(upper).all();
    let solid = |index| u8::from(inside(grid.centre(grid.voxel(index))));
    Occupancy { grid, solid: (0..grid.len()).map(solid).collect() }
}

/// A block of 40×40×20 mm with its top at z = 20, with room around it.
fn block() -> Occupancy {
    solid_within(DVec3::new(-20.0, -20.0, 0.0), DVec3::new(20.0, 20.0, 20.0))
}

/// A post beside the block, as tall as the holder is high.
fn post() -> Occupancy {
    solid_within(DVec3::new(10.0, -3.0, 20.0), DVec3::new(14.0, 3.0, 54.0))
}

fn path(text: &str) -> Toolpath {
    Toolpath::parse(text, LengthUnit::Mm, "path").unwrap()
}

fn check_with(
    fixtures: Option<&Occupancy>,
    text: &str,
    settings: &CheckSettings,
    is_free: impl Fn(&Pose) -> bool + Sync,
) -> Result<CheckReport, CheckError> {
    let (tool, path) = (Tool::paper(), path(text));
    check_toolpath(&block(), fixtures, &tool, &path, settings, is_free, Control::quiet())
}

fn check(fixtures: Option<&Occupancy>, text: &str, settings: &CheckSettings) -> CheckReport {
    check_with(fixtures, text, settings, |_| false).unwrap()
}

#[test]
fn a_finishing_pass_that_touches_the_part_is_no_collision() {
    let settings = CheckSettings::of_pitch(1.0);
    // Half a voxel below the top, as rounding of the part to voxels may have it.
    let report = check(None, "-15,0,19.4\n15,0,19.4\n", &settings);
    assert_eq!(report.colliding, []);
    assert_eq!((report.locations, report.poses), (2, 121));
    let strict = CheckSettings { contact: 0.0, ..settings };
    let report = check(None, "-15,0,19.4\n15,0,19.4\n", &strict);
    assert_eq!(report.colliding[0].collisions[0].element, "cutter");
}

#[test]
fn a_cutter_that_goes_too_deep_collides() {
    let report = check(None, "0,0,30\n0,0,16\n0,0,30\n", &CheckSettings::of_pitch(1.0));
    let lines: Vec<usize> = report.colliding.iter().map(|l| l.line).collect();
    assert_eq!(lines, [2, 3]);
    let collision = &report.colliding[0].collisions[0];
    assert_eq!((collision.element.as_str(), collision.against), ("cutter", Against::Part));
    assert_eq!(collision.position, [0.0, 0.0, 16.0]);
    assert!((collision.volume - f64::from(collision.voxels)).abs() < 1e-12);
    // The ball at 16 reaches 4 deep; only what lies below 18.5 counts, and none of it at 18.5.
    let expected = Tool::paper().count_inside(
        &deeper_than(&block(), 1.0),
        DVec3::new(0.0, 0.0, 16.0),
        &crate::orientation::Orientation::default(),
    );
    assert_eq!(collision.voxels, expected);
}

#[test]
fn a_holder_that_grazes_collides_however_little() {
    // Tilted over so far that the holder's edge dips into the top layer of the block.
    let tilt = 76_f64.to_radians();
    let line = |tip: f64| format!("-20,0,{tip},{},0,{}\n", tilt.sin(), tilt.cos());
    let settings = CheckSettings::of_pitch(1.0);
    let report = check(None, &line(24.9), &settings);
    let names: Vec<&str> = report.colliding[0].collisions.iter().map(|c| c.element.as_str()).collect();
    assert_eq!(names, ["holder 1"], "{report:?}");
    // Upright it is free.
    assert_eq!(check(None, "-20,0,24.9\n", &settings).colliding, []);
}

#[test]
fn clearance_belongs_to_its_element() {
    // The holder's face hangs 1.5 above the top centres; half of it over the block.
    let text = "-25,0,-14.0\n";
    let settings = CheckSettings::of_pitch(1.0);
    assert_eq!(check(None, text, &settings).colliding, []);
    let near = CheckSettings { clearance: Clearance::around_holder_and_shank(2.0), ..settings };
    let report = check(None, text, &near);
    assert_eq!(report.colliding[0].collisions[0].element, "holder 1", "{report:?}");
    let cutter = CheckSettings { clearance: Clearance { cutter: 0.9, ..Clearance::default() }, ..settings };
    // The cutter's flank is 0.5 from the outermost centres, and contact lets it have the outer two layers.
    assert_eq!(check(None, text, &cutter).colliding, []);
}

#[test]
fn contact_with_fixtures_is_never_accepted() {
    let post = post();
    let settings = CheckSettings::of_pitch(1.0);
    // The cutter's flank is in the post's first layer of voxels.
    let text = "5.6,0,20.6\n";
    assert_eq!(check(None, text, &settings).colliding, []);
    let report = check(Some(&post), text, &settings);
    let found: Vec<_> =
        report.colliding[0].collisions.iter().map(|c| (c.element.as_str(), c.against)).collect();
    assert_eq!(found, [("cutter", Against::Fixtures)], "{report:?}");
}

#[test]
fn interpolation_finds_what_lies_between_two_free_lines() {
    let settings = CheckSettings::of_pitch(1.0);
    // Right through the block.
    let report = check(None, "# start\n-28,0,10\n28,0,10\n", &settings);
    assert_eq!(report.colliding.len(), 1);
    assert_eq!(report.colliding[0].line, 3);
    assert!(report.colliding[0].poses > 200);
    // The tip stays, the holder swings through a post.
    let post = post();
    let swing = "0,0,25,-1,0,1\n0,0,25,1,0.0,0.05\n";
    let ends = ["0,0,25,-1,0,1\n", "0,0,25,1,0,0.05\n"];
    for end in ends {
        assert_eq!(
            check(Some(&post), end, &settings).colliding.len(),
            usize::from(end.starts_with("0,0,25,1"))
        );
    }
    assert_eq!(check(Some(&post), swing, &settings).colliding[0].line, 2);
}

#[test]
fn what_cannot_be_checked_is_refused() {
    let refuse = |text: &str, settings: CheckSettings| {
        check_with(None, text, &settings, |_| false).unwrap_err().to_string()
    };
    let settings = CheckSettings::of_pitch(1.0);
    assert!(refuse("0,0,0,0,0,1\n0,0,0,0,0,-1\n", settings).contains("line 2"));
    assert!(refuse("0,0,0\n1e12,0,0\n", settings).contains("line 2"));
    assert!(refuse("0,0,0\n", CheckSettings { tolerance: 0.0, ..settings }).contains("tolerance"));
    assert!(refuse("0,0,0\n", CheckSettings { contact: -1.0, ..settings }).contains("contact"));
    let negative = Clearance { holder: f64::NAN, ..Clearance::default() };
    assert!(refuse("0,0,0\n", CheckSettings { clearance: negative, ..settings }).contains("holder"));
}

#[test]
fn depth_is_counted_from_the_surface() {
    let block = block();
    let shell = |contact: f64| block.count() - deeper_than(&block, contact).count();
    assert_eq!(shell(0.0), 0);
    assert_eq!(shell(0.5), 40 * 40 * 20 - 38 * 38 * 18);
    assert_eq!(shell(1.0), 40 * 40 * 20 - 38 * 38 * 18);
    assert_eq!(shell(1.5), 40 * 40 * 20 - 36 * 36 * 16);
}

#[test]
fn what_a_proof_knows_free_changes_no_line_of_the_report() {
    let post = post();
    let obstacle = Bodies { part: block(), fixtures: post.clone(), undecided: 0.0 }.obstacle();
    let text = "-25,0,24,0,0,1\n25,0,24,0,0.3,1\n0,0,16,0,0,1\n12,0,22,0,0,1\n-40,-40,40,1,0,0.2\n";
    for room in [0.0, 1.5] {
        let clearance = Clearance { holder: room, shank: room, cutter: 0.0 };
        let settings = CheckSettings { clearance, ..CheckSettings::of_pitch(1.0) };
        let plain = check(Some(&post), text, &settings);
        assert!(plain.colliding.len() > 1);
        let exact = ExactField::new(&obstacle, Tool::paper().inflated(&clearance).unwrap());
        let known = std::sync::atomic::AtomicU64::new(0);
        let is_free = |pose: &Pose| {
            let free = !exact.collides(pose);
            known.fetch_add(u64::from(free), std::sync::atomic::Ordering::Relaxed);
            free
        };
        assert_eq!(check_with(Some(&post), text, &settings, is_free).unwrap(), plain);
        let known = known.into_inner();
        assert!(known > 0 && known < plain.poses, "{known} of {}", plain.poses);
    }
}
