//! Toolpaths over a block of known size.

use glam::DVec3;

use super::*;
use crate::field::ExactField;
use crate::grid::Grid;
use crate::scene::{Guarantee, PathGuarantee};
use crate::section::test_shapes::{orientations, revolved};
use crate::tool::{ElementKind, Segment, ToolShape};
use crate::unit::LengthUnit;

/// What lies within a box on a grid of 1 mm.
fn solid_within(lower: DVec3, upper: DVec3) -> Occupancy {
    let grid = Grid { origin: DVec3::new(-30.0, -30.0, -5.0), pitch: 1.0, dims: [60, 60, 60] };
    let inside = |p: DVec3| p.cmpgt(lower).all() && p.cmplt(upper).all();
    Occupancy::of(grid, |voxel| inside(grid.centre(voxel)))
}

/// A block of 40×40×20 mm with its top at z = 20, with room around it.
fn block() -> Occupancy {
    solid_within(DVec3::new(-20.0, -20.0, 0.0), DVec3::new(20.0, 20.0, 20.0))
}

/// A post beside the block, as tall as the holder is high.
fn post() -> Occupancy {
    solid_within(DVec3::new(10.0, -3.0, 20.0), DVec3::new(14.0, 3.0, 54.0))
}

/// A path of numbers alone, with its columns named in a line above.
fn path(text: &str) -> Toolpath {
    let columns = text.lines().next().unwrap().split(',').count();
    let names = ["x,y,z", "x,y,z,roll", "", "x,y,z,i,j,k", "x,y,z,i,j,k,roll"][columns - 3];
    Toolpath::parse(&format!("{names}\n{text}"), LengthUnit::Mm, "path").unwrap()
}

/// A path of a tip and an axis on each line.
pub(super) fn pose_lines(poses: &[(DVec3, DVec3)]) -> String {
    let line = |(tip, axis): &(DVec3, DVec3)| {
        format!("{},{},{},{},{},{}\n", tip.x, tip.y, tip.z, axis.x, axis.y, axis.z)
    };
    format!("x,y,z,i,j,k\n{}", poses.iter().map(line).collect::<String>())
}

/// Checks a path of one tool.
pub(super) fn check_text(
    bodies: CheckBodies<'_>,
    tool: &Tool,
    text: &str,
    settings: &CheckSettings,
) -> Result<CheckReport, CheckError> {
    let path = Toolpath::parse(text, LengthUnit::Mm, "path").unwrap();
    check_toolpath(bodies, &[(None, tool)], &path, settings, Control::quiet())
}

/// None of these is free by mistake.
#[test]
fn voxels_that_are_none_and_tools_of_another_unit_are_refused() {
    let (part, text) = (block(), "x,y,z\n0,0,10\n");
    let refused = |bodies: CheckBodies<'_>, tool: &Tool| {
        let by_path = check_text(bodies, tool, text, &usual()).unwrap_err().to_string();
        let by_pose = PoseChecker::new(bodies, tool, &usual()).err().map(|error| error.to_string());
        (by_path, by_pose)
    };
    let masks = Occupancy { solid: part.solid.iter().map(|&solid| 255 * solid).collect(), ..part.clone() };
    let short = Occupancy { solid: part.solid[1..].to_vec(), ..part.clone() };
    for voxels in [&masks, &short] {
        let (by_path, by_pose) = refused(CheckBodies::of_part(voxels), &Tool::paper());
        assert!(by_path.starts_with("the voxels of the part must be a byte"), "{by_path}");
        assert_eq!(by_pose, Some(by_path));
        let path = path("0,0,10");
        let stock = check_stock(
            CheckBodies::of_part(&part),
            voxels,
            &[(None, &Tool::paper())],
            &path,
            &usual(),
            Control::quiet(),
        );
        assert!(stock.unwrap_err().to_string().contains("the stock"));
    }
    let coarse = Grid { pitch: 2.0, dims: [30; 3], ..part.grid };
    let fixtures = [("clamp".to_owned(), Occupancy::empty(coarse))];
    let (by_path, _) =
        refused(CheckBodies { fixtures: &fixtures, ..CheckBodies::of_part(&part) }, &Tool::paper());
    assert!(by_path.contains("the voxels of clamp"), "{by_path}");
    let inch = Tool::paper().in_unit(LengthUnit::Inch);
    let wrong = check_text(CheckBodies::of_part(&part), &inch, text, &usual()).unwrap_err().to_string();
    assert!(wrong.contains("is in inch, and the path in mm"), "{wrong}");
}

fn usual() -> CheckSettings {
    CheckSettings::of_pitch(1.0, LengthUnit::Mm)
}

fn check_with(
    fixture: Option<&Occupancy>,
    text: &str,
    settings: &CheckSettings,
) -> Result<CheckReport, CheckError> {
    let fixtures: Vec<_> = fixture.map(|post| ("post".to_owned(), post.clone())).into_iter().collect();
    let block = block();
    let bodies = CheckBodies { fixtures: &fixtures, ..CheckBodies::of_part(&block) };
    check_toolpath(bodies, &[(None, &Tool::paper())], &path(text), settings, Control::quiet())
}

fn check(fixture: Option<&Occupancy>, text: &str, settings: &CheckSettings) -> CheckReport {
    check_with(fixture, text, settings).unwrap()
}

#[test]
fn a_finishing_pass_that_touches_the_part_is_no_collision_at_any_pitch() {
    let settings = usual();
    assert_eq!(settings.contact, 0.05);
    assert_eq!(CheckSettings::of_pitch(1.0, LengthUnit::Inch).contact, 0.05 / 25.4);
    // On the surface, and 0.04 deep in the uppermost centres.
    for height in [20.0, 19.46] {
        let report = check(None, &format!("-15,0,{height}\n15,0,{height}\n"), &settings);
        assert_eq!(report.colliding, []);
        assert_eq!((report.locations, report.starts, report.poses), (2, 1, 121));
    }
    let strict = CheckSettings { contact: 0.0, ..settings };
    let report = check(None, "-15,0,19.46\n15,0,19.46\n", &strict);
    assert_eq!(report.colliding[0].collisions[0].element, "cutter");
}

#[test]
fn a_cutter_that_goes_too_deep_collides_as_deep_as_it_goes() {
    let report = check(None, "0.5,0.5,30\n0.5,0.5,16\n0.5,0.5,30\n", &usual());
    let lines: Vec<usize> = report.colliding.iter().map(|l| l.line).collect();
    assert_eq!(lines, [3, 4]);
    let collision = &report.colliding[0].collisions[0];
    assert_eq!((collision.element.as_str(), &collision.against), ("cutter", &HitBody::Part));
    assert_eq!((collision.position, collision.fraction), ([0.5, 0.5, 16.0], 1.0));
    // The ball's own middle is a centre's height above the part; on the axis both depths add up to the truth.
    assert!((collision.depth - 4.0).abs() < 1e-5, "{collision:?}");
    assert_eq!([collision.contact[0], collision.contact[1]], [0.5, 0.5]);
    let expected = Tool::paper().count_inside(
        &block(),
        DVec3::new(0.5, 0.5, 16.0),
        &crate::orientation::Orientation::default(),
    );
    assert_eq!(collision.voxels, expected);
    assert!((collision.volume - f64::from(collision.voxels)).abs() < 1e-12);
    // Deeper than the cutter is thick: the whole way counts.
    let report = check(None, "0.5,0.5,8\n", &usual());
    let depth = report.colliding[0].collisions[0].depth;
    assert!((depth - 12.0).abs() < 1.01, "{depth}");
}

#[test]
fn a_wall_of_two_voxels_is_not_cut_through_unseen() {
    let wall = solid_within(DVec3::new(-20.0, 4.0, 0.0), DVec3::new(20.0, 6.0, 20.0));
    let text = "x,y,z\n0,-10,10\n0,20,10\n";
    let report = check_text(CheckBodies::of_part(&wall), &Tool::paper(), text, &usual()).unwrap();
    let collision = &report.colliding[0].collisions[0];
    // Sideways it has to go by its own radius and half of the wall, 6 in all; no centre lies in the wall's middle.
    assert!((4.4..=6.0).contains(&collision.depth), "{collision:?}");
}

#[test]
fn a_holder_that_grazes_collides_however_little() {
    // Tilted over so far that the holder's edge dips into the top layer of the block.
    let tilt = 76_f64.to_radians();
    let line = |tip: f64| format!("-20,0,{tip},{},0,{}\n", tilt.sin(), tilt.cos());
    let settings = usual();
    let report = check(None, &line(24.9), &settings);
    let names: Vec<&str> = report.colliding[0].collisions.iter().map(|c| c.element.as_str()).collect();
    assert_eq!(names, ["holder 1"], "{report:?}");
    // Upright it is free.
    assert_eq!(check(None, "-20,0,24.9\n", &settings).colliding, []);
}

#[test]
fn each_stretch_is_checked_with_its_own_tool() {
    let (long, short) = (Tool::paper(), Tool::paper());
    let ToolShape::Revolved(mut elements) = short.shape.clone() else { panic!() };
    // The same holder on a cutter of 10.
    elements[0].profile[1] = Segment::cylinder(5.0, 10.0, 5.0);
    elements[1].profile[0] = Segment::cylinder(10.0, 58.0, 14.5);
    let short = Tool { name: "short".into(), shape: ToolShape::Revolved(elements), ..short };
    let block = block();
    let bodies = CheckBodies::of_part(&block);
    let run = |text: &str, tools: &[(Option<u32>, &Tool)]| {
        let path = Toolpath::parse(text, LengthUnit::Mm, "path").unwrap();
        check_toolpath(bodies, tools, &path, &usual(), Control::quiet())
    };
    let text = "LOADTL/1\nGOTO/-25.5,0,-5\nGOTO/-25.5,0,0\nLOADTL/7\nGOTO/-25.5,0,5\n";
    let both = [(Some(7), &short), (Some(1), &long)];
    let report = run(text, &both).unwrap();
    let found: Vec<_> = report.colliding.iter().map(|l| (l.line, l.tool)).collect();
    assert_eq!((found, report.starts), (vec![(5, Some(7))], 2));
    let refuse = |text: &str, tools: &[(Option<u32>, &Tool)]| run(text, tools).unwrap_err().to_string();
    let message = refuse(text, &[(None, &long)]);
    assert!(message.contains("line 5") && message.contains("from tool 1 to tool 7"), "{message}");
    assert!(refuse(&text.replace('7', "8"), &both).contains("line 5: tool 8, and the tools that are given"));
    assert!(refuse("GOTO/0,0,50\n", &both).contains("line 1: no tool by number"));
    assert!(refuse(text, &[(Some(1), &long), (Some(1), &short)]).contains("several of one number"));
    assert!(refuse(text, &[(None, &long), (Some(1), &short)]).contains("without a number"));
    // One tool of one number needs no number itself.
    run("LOADTL/1\nGOTO/-26,0,5\n", &[(None, &long)]).unwrap();
}

#[test]
fn clearance_belongs_to_its_element() {
    // The holder's face hangs 1.5 above the top centres; half of it over the block.
    let text = "-25,0,-14.0\n";
    let settings = usual();
    assert_eq!(check(None, text, &settings).colliding, []);
    let near = CheckSettings { clearance: Clearance::around_holder_and_shank(2.0), ..settings };
    let report = check(None, text, &near);
    assert_eq!(report.colliding[0].collisions[0].element, "holder 1", "{report:?}");
    // The centre is 0.5 from the holder's face, and half a pitch below the surface.
    let collision = &report.colliding[0].collisions[0];
    assert_eq!(collision.clearance, 2.0);
    assert!(
        (collision.depth_in_tool - 0.5).abs() < 1e-6 && (collision.depth - 1.0).abs() < 1e-6,
        "{collision:?}"
    );
    let cutter = CheckSettings { clearance: Clearance { cutter: 0.9, ..Clearance::default() }, ..settings };
    // The cutter's flank is 0.5 from the outermost centres: what may touch keeps no room, what may not does.
    assert_eq!(check(None, text, &cutter).colliding, []);
    let strict = CheckSettings { contact: 0.0, ..cutter };
    assert_eq!(check(None, text, &strict).colliding[0].collisions[0].element, "cutter");
}

#[test]
fn contact_with_fixtures_is_never_accepted() {
    let post = post();
    let settings = usual();
    // The cutter's flank is in the post's first layer of voxels.
    let text = "5.6,0,20.6\n";
    assert_eq!(check(None, text, &settings).colliding, []);
    let report = check(Some(&post), text, &settings);
    let found: Vec<_> =
        report.colliding[0].collisions.iter().map(|c| (c.element.as_str(), c.against.clone())).collect();
    assert_eq!(found, [("cutter", HitBody::Fixture("post".into()))], "{report:?}");
}

#[test]
fn interpolation_finds_what_lies_between_two_free_lines() {
    let settings = usual();
    // Right through the block.
    let report = check(None, "-28,0,10\n28,0,10\n", &settings);
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
    assert_eq!(check(Some(&post), swing, &settings).colliding[0].line, 3);
}

#[test]
fn what_cannot_be_checked_is_refused() {
    let refuse =
        |text: &str, settings: CheckSettings| check_with(None, text, &settings).unwrap_err().to_string();
    let settings = usual();
    assert!(refuse("0,0,0,0,0,1\n0,0,0,0,0,-1\n", settings).contains("line 3"));
    assert!(refuse("0,0,0\n1e12,0,0\n", settings).contains("line 3"));
    let step = refuse("0,0,0\n", CheckSettings { step: 0.0, ..settings });
    assert!(step.contains("step") && step.contains("above 0"), "{step}");
    assert!(refuse("0,0,0\n", CheckSettings { contact: -1.0, ..settings }).contains("contact"));
    assert!(refuse("0,0,0\n", CheckSettings { contact: 5.0, ..settings }).contains("twice the contact of 5"));
    // What is left of a radius of 5 is thinner than a voxel's diagonal.
    assert!(
        refuse("0,0,0\n", CheckSettings { contact: 4.4, ..settings }).contains("twice the contact of 4.4")
    );
    // The paper's cutter is 10 thick.
    let step = refuse("0,0,0\n", CheckSettings { step: 10.1, ..settings });
    assert!(step.contains("cutter") && step.contains("is 10 thick, and a step of 10.1"), "{step}");
    assert!(check_with(None, "0,0,50\n", &CheckSettings { step: 10.0, ..settings }).is_ok());
    let negative = Clearance { holder: f64::NAN, ..Clearance::default() };
    assert!(refuse("0,0,0\n", CheckSettings { clearance: negative, ..settings }).contains("holder"));
}

#[test]
fn stretches_that_a_pose_proves_free_hold_nothing() {
    let post = post();
    let mut obstacle = block();
    obstacle.add(&post);
    let text = "-25,0,24,0,0,1\n25,0,24,0,0.3,1\n0,0,16,0,0,1\n12,0,22,0,0,1\n-40,-40,40,1,0,0.2\n-30,0,24,1,0,1\n30,2,24,-1,0,1\n";
    for (room, contact) in [(0.0, 0.0), (1.5, 0.0), (1.5, 0.05)] {
        let clearance = Clearance { holder: room, shank: room, cutter: 0.0 };
        let settings = CheckSettings { clearance, contact, step: 0.05 };
        let report = check(Some(&post), text, &settings);
        // Every pose of every line, each counted.
        let motions = motions(&path(text), &[(None, &Tool::paper())], &settings, None).unwrap();
        let exact = ExactField::new(&obstacle, Tool::paper().with_clearance(&clearance).unwrap()).unwrap();
        for motion in motions.iter().enumerate() {
            let line = path(text).locations[motion.0].line;
            let colliding = motion.1.poses().filter(|(_, pose)| exact.collides(pose)).count() as u64;
            let found = report.colliding.iter().find(|own| own.line == line);
            let most = found.map_or(0, |own| own.collisions.iter().map(|hit| hit.poses).max().unwrap_or(0));
            let all: u64 = found.map_or(0, |own| own.collisions.iter().map(|hit| hit.poses).sum());
            if contact == 0.0 {
                assert!(most <= colliding && colliding <= all, "line {line}: {most} {colliding} {all}");
            } else {
                assert!(most <= colliding, "line {line}: {most} {colliding}");
            }
        }
        assert!(report.colliding.len() > 1);
    }
}

#[test]
fn the_mesh_itself_is_safe_between_poses_only_with_half_the_step_more() {
    // A ball-end mill of radius 1, and a part of one voxel around (½, ½, ½) that a vertex of the mesh touches at (1, 1, 1).
    let mill = vec![Segment::ball_end(1.0), Segment::cylinder(1.0, 6.0, 1.0)];
    let tool = revolved([(ElementKind::Cutter, mill)]);
    let grid = Grid { origin: DVec3::splat(-3.0), pitch: 1.0, dims: [7; 3] };
    let mut part = Occupancy::empty(grid);
    part.solid[grid.index([3; 3])] = 1;
    let (bodies, step) = (CheckBodies::of_part(&part), 1.0);
    let (out, centre, vertex) = (DVec3::ONE.normalize(), DVec3::splat(0.5), DVec3::ONE);
    let across = out.any_orthonormal_vector();
    let guarantee = |room: f64| {
        let clearance = Clearance { cutter: room, ..Clearance::default() };
        PathGuarantee::new(true, &tool, &clearance, false, 1.0, step)
    };
    // The ball's middle passes at a distance along `way`, the axis away from the voxel; true where that is free.
    let passes = |room: f64, middle: DVec3, way: DVec3| {
        let clearance = Clearance { cutter: room, ..Clearance::default() };
        let settings = CheckSettings { clearance, contact: 0.0, step };
        let line = |middle: DVec3| {
            let tip = middle - out;
            format!("{:.17},{:.17},{:.17},1,1,1\n", tip.x, tip.y, tip.z)
        };
        let text = format!("x,y,z,i,j,k\n{}{}", line(middle - way), line(middle + way));
        check_text(bodies, &tool, &text, &settings).unwrap().colliding.is_empty()
    };
    // Poses 0.5 before and after the nearest place, where the ball with its clearance just misses the centre.
    let near = (1.87_f64.powi(2) - 0.25).sqrt() + 1e-6;
    assert!(passes(0.87, centre + out * near, across * 1.5));
    assert_eq!(guarantee(0.87).at_poses, Guarantee::Mesh);
    assert!(guarantee(0.87).at_all_times != Guarantee::Mesh);
    let inside = 1.0 - (centre + out * near).distance(vertex);
    assert!((0.06..0.07).contains(&inside), "{inside}");
    // With what is needed this is not a free motion, and no motion that is free touches the vertex.
    let needed = guarantee(0.0).needed;
    assert_eq!(guarantee(needed).at_all_times, Guarantee::Mesh);
    assert!(!passes(needed, centre + out * near, across * 1.5));
    let mut free = 0;
    for (index, way) in orientations("random:200:3").iter().enumerate() {
        let far = 1.9 + (index as f64 * 0.618).fract() * 0.8;
        let (middle, way) = (centre + out * far, way.direction() * 1.3);
        if passes(needed, middle, way) {
            free += 1;
            let times = (0..=100).map(|step| middle + way * (f64::from(step) / 50.0 - 1.0));
            let nearest = times.map(|ball| ball.distance(vertex)).fold(f64::INFINITY, f64::min);
            assert!(nearest >= 1.0, "{index} {nearest}");
        }
    }
    assert!((20..190).contains(&free), "{free}");
}

#[test]
fn a_cutter_thinner_than_what_voxels_show_is_certain_to_be_seen_by_what_is_thicker_alone() {
    let part = block();
    let thin = |radius: f64| {
        let cutter = (ElementKind::Cutter, vec![Segment::cylinder(0.0, 30.0, radius)]);
        let tool = revolved([cutter, (ElementKind::Holder(0), vec![Segment::cylinder(30.0, 60.0, 10.0)])]);
        let settings = CheckSettings { contact: 0.0, ..CheckSettings::of_pitch(1.0, LengthUnit::Mm) };
        check_text(CheckBodies::of_part(&part), &tool, "x,y,z\n0,0,90\n", &settings).unwrap().sure_depth
    };
    assert!(thin(0.25) > 30.0 && thin(5.0) < 5.0, "{} {}", thin(0.25), thin(5.0));
}
