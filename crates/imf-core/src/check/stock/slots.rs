//! Slots, pockets and plunges whose result is known: what goes, what rubs and what collides.

use std::f64::consts::PI;
use std::fmt::Write;

use glam::{DVec2, DVec3};

use super::super::{CheckBodies, CheckError, CheckSettings, HitBody, check_toolpath};
use super::*;
use crate::grid::Grid;
use crate::section::test_shapes::{line, revolved};
use crate::tool::{Clearance, ElementKind};
use crate::toolpath::MoveKind;
use crate::unit::LengthUnit;

/// Flutes of 4 mm, a shank up to 14, a holder above.
fn end_mill(radius: f64, shank: f64) -> Tool {
    revolved([
        (ElementKind::Cutter, vec![line(0.0, 4.0, radius, radius)]),
        (ElementKind::Shank, vec![line(4.0, 14.0, shank, shank)]),
        (ElementKind::Holder(0), vec![line(14.0, 24.0, 9.0, 9.0)]),
    ])
}

/// 60 × 40 × 20 mm, its top at z = 0.
fn block(pitch: f64) -> Occupancy {
    let dims = [60.0, 40.0, 20.0].map(|side: f64| (side / pitch).round() as usize);
    let grid = Grid { origin: DVec3::new(-30.0, -20.0, -20.0), pitch, dims };
    Occupancy { grid, solid: vec![1; grid.len()] }
}

fn usual(pitch: f64) -> CheckSettings {
    CheckSettings::of_pitch(pitch, LengthUnit::Mm)
}

/// G-code, without a part.
fn cut_with(tool: &Tool, program: &str, stock: &Occupancy, settings: &CheckSettings) -> StockReport {
    let path = Toolpath::parse(program, LengthUnit::Mm, "path.nc").unwrap();
    cut(tool, &path, stock, settings)
}

fn cut(tool: &Tool, path: &Toolpath, stock: &Occupancy, settings: &CheckSettings) -> StockReport {
    let part = Occupancy::empty(stock.grid);
    let bodies = CheckBodies::of_part(&part);
    check_stock(bodies, stock, &[(None, tool)], path, settings, Control::quiet()).unwrap()
}

/// `(line, element, depth)` of all collisions.
fn hits(report: &StockReport) -> Vec<(usize, &str, f64)> {
    let all =
        report.colliding.iter().flat_map(|line| line.collisions.iter().map(move |hit| (line.line, hit)));
    all.map(|(line, hit)| {
        assert_eq!(hit.against, HitBody::Stock);
        (line, hit.element.as_str(), hit.depth)
    })
    .collect()
}

/// A slot 9 mm deep in three layers, each with its own ends; every layer goes there and back, turned by an angle.
fn slot_in_layers(degrees: f64) -> String {
    let mut program = String::from("G21 G90\n");
    let (sine, cosine) = degrees.to_radians().sin_cos();
    for (layer, depth) in [3.0, 6.0, 9.0].into_iter().enumerate() {
        let out = 0.13 * layer as f64;
        let at = |way: f64| format!("X{:.5} Y{:.5}", way * cosine + 0.3, way * sine - 0.1);
        let (one, other) = (at(-14.0 + out), at(13.7 - 1.7 * out));
        let _ = writeln!(program, "G0 {one} Z5.\nG1 Z-{depth:.1} F100\n{other}\n{one}\nG0 Z5.");
    }
    program
}

#[test]
fn a_shank_as_wide_as_the_cutter_runs_free_in_its_slot_and_a_wider_one_does_not() {
    for pitch in [1.0, 0.4] {
        let (stock, settings) = (block(pitch), usual(pitch));
        for degrees in [0.0, 90.0, 27.0, 61.3] {
            let program = slot_in_layers(degrees);
            let report = cut_with(&end_mill(3.0, 3.0), &program, &stock, &settings);
            assert_eq!(hits(&report), [], "{pitch} {degrees}");
            // Thinner ones as well.
            let report = cut_with(&end_mill(3.0, 2.9), &program, &stock, &settings);
            assert_eq!(hits(&report), [], "{pitch} {degrees}");
            // One pitch wider, and half of one: from the second layer on, at its plunge, 2 mm deep.
            for wider in [pitch, 0.5 * pitch] {
                let report = cut_with(&end_mill(3.0, 3.0 + wider), &program, &stock, &settings);
                let (line, element, depth) = hits(&report)[0];
                assert_eq!((line, element), (8, "shank"), "{pitch} {degrees} {wider}");
                assert!(depth <= wider + 0.5 * pitch, "{depth} {wider}");
            }
        }
    }
}

#[test]
fn a_cone_as_wide_as_its_shank_drills_its_hole_and_leaves_no_ring() {
    let height = 3.0 / 59f64.to_radians().tan();
    let drill = revolved([
        (ElementKind::Cutter, vec![line(0.0, height, 0.0, 3.0)]),
        (ElementKind::Shank, vec![line(height, 40.0, 3.0, 3.0)]),
    ]);
    let program = "G0 X0.3 Y-0.1 Z5.\nG1 Z-10. F100\nG0 Z5.\nG0 Z-9.\nG1 Z-15.\nG0 Z5.\n";
    for pitch in [1.0, 0.7, 0.5] {
        let stock = block(pitch);
        let report = cut_with(&drill, program, &stock, &usual(pitch));
        assert_eq!(hits(&report), [], "{pitch}");
        // Of the centres in the hole none lies farther than this from its wall.
        let taken = report.voxels - report.remaining.count() as u64;
        let hole = |radius: f64| {
            let held = stock.centres().filter(|centre| {
                let away = (centre.truncate() - DVec2::new(0.3, -0.1)).length();
                away <= radius && centre.z >= -15.0 + away * height / 3.0
            });
            held.count() as u64
        };
        let range = hole(3.0 - tool::RING * pitch)..=hole(3.0);
        assert!(range.contains(&taken), "{pitch}: {taken} of {range:?}");
    }
}

#[test]
fn a_tilted_shank_as_wide_as_the_cutter_runs_free_in_its_slot() {
    let (stock, settings) = (block(0.5), usual(0.5));
    for axis in [DVec3::new(0.5, 0.0, 0.9), DVec3::new(0.2, -0.5, 0.9), DVec3::new(-0.1, 0.6, 0.7)] {
        let axis = axis.normalize();
        let mut text = String::from("x,y,z,i,j,k\n");
        // Layers along the tool's axis, whose flutes reach out of the stock on the uphill side as well.
        for (layer, deep) in [2.0, 4.0, 6.0].into_iter().enumerate() {
            for way in [-10.0 - 0.17 * f64::from(layer as u8), 11.3] {
                let tip = DVec3::new(way, 1.0, 0.0) - axis * deep;
                let above = tip + axis * 30.0;
                let pose = |p: DVec3| {
                    format!("{:.9},{:.9},{:.9},{:.9},{:.9},{:.9}\n", p.x, p.y, p.z, axis.x, axis.y, axis.z)
                };
                let first = if way < 0.0 { above } else { tip };
                let last = if way < 0.0 { tip } else { above };
                text += &(pose(first) + &pose(last));
            }
        }
        let path = Toolpath::parse(&text, LengthUnit::Mm, "path").unwrap();
        // A holder so narrow that only the shank matters.
        let slim = |shank: f64| {
            revolved([
                (ElementKind::Cutter, vec![line(0.0, 4.0, 2.0, 2.0)]),
                (ElementKind::Shank, vec![line(4.0, 30.0, shank, shank)]),
            ])
        };
        let report = cut(&slim(2.0), &path, &stock, &settings);
        assert_eq!(hits(&report), [], "{axis}");
        assert!(!hits(&cut(&slim(2.5), &path, &stock, &settings)).is_empty());
    }
}

#[test]
fn a_slot_deeper_than_the_flutes_is_told_at_its_line_as_deep_as_the_shank_is_in() {
    for (pitch, depth) in [(1.0, 6.0), (0.5, 6.0), (0.5, 4.5)] {
        let program = format!("G21 G90\nG0 X-40. Y0.5 Z-{depth}\nG1 X-34.\nX0. F200\nG0 Z10.\n");
        for shank in [3.0, 2.0] {
            let report = cut_with(&end_mill(3.0, shank), &program, &block(pitch), &usual(pitch));
            let found = hits(&report);
            assert_eq!((found[0].0, found[0].1), (4, "shank"), "{found:?}");
            assert!((found[0].2 - (depth - 4.0)).abs() < 1e-6, "{found:?}");
            // What the flutes left is still there when the tool is pulled out.
            assert!(found.iter().all(|hit| hit.0 >= 4));
        }
    }
}

#[test]
fn a_holder_that_dips_into_the_stock_is_told_and_one_above_it_is_not() {
    let tool = end_mill(3.0, 3.0);
    // Layer by layer down to where the holder's face stands 0.3 above the top, then 0.7 below it.
    let mut program = String::from("G21 G90\nG0 X0. Y0. Z3.\n");
    for depth in [3.5, 7.0, 10.5, 13.7, 14.7] {
        let _ = writeln!(program, "G1 Z-{depth} F100\nX9.\nX0.");
    }
    let report = cut_with(&tool, &program, &block(1.0), &usual(1.0));
    let found = hits(&report);
    assert_eq!((found[0].0, found[0].1), (15, "holder 1"), "{found:?}");
    assert!((found[0].2 - 0.7).abs() < 1e-6, "{found:?}");
    let clearance = Clearance { holder: 1.0, ..Clearance::default() };
    let report = cut_with(&tool, &program, &block(1.0), &CheckSettings { clearance, ..usual(1.0) });
    assert_eq!(hits(&report)[0].0, 12);
}

#[test]
fn removed_volumes_are_the_closed_forms() {
    let mut errors = Vec::new();
    for pitch in [1.0, 0.5] {
        let stock = block(pitch);
        let report = cut_with(&end_mill(3.0, 3.0), &slot_in_layers(27.0), &stock, &usual(pitch));
        let volume = report.removed.iter().map(|line| line.voxels).sum::<u64>() as f64 * pitch.powi(3);
        // The layers' ends lie within 0.8 mm of each other.
        let length = [27.7, 27.7 - 2.7 * 0.13, 27.7 - 2.7 * 0.26];
        let expected: f64 = length.iter().map(|length| 3.0 * (6.0 * length + 9.0 * PI)).sum();
        errors.push((volume / expected - 1.0).abs());
        assert_eq!(
            report.voxels,
            report.remaining.count() as u64 + report.removed.iter().map(|l| l.voxels).sum::<u64>()
        );
        // Each voxel knows its line.
        for line in &report.removed {
            let own = report.removed_by.iter().filter(|&&by| by as usize == line.line).count() as u64;
            assert_eq!(own, line.voxels);
        }
        // Rapids in the air and ways back take nothing.
        let idle: Vec<usize> = report.removed.iter().filter(|l| l.voxels == 0).map(|l| l.line).collect();
        assert_eq!(idle, [2, 5, 6, 7, 10, 11, 12, 15, 16]);
    }
    // Slots of 6 and of 12 voxels.
    assert!(errors[0] < 0.04 && errors[1] < 0.01, "{errors:?}");
}

#[test]
fn a_rapid_through_stock_is_told_however_it_is_chopped_and_one_out_of_a_cut_is_not() {
    let tool = end_mill(3.0, 3.0);
    for pitch in [1.0, 0.25] {
        let (stock, settings) = (block(pitch), usual(pitch));
        let cut = |program: &str| cut_with(&tool, program, &stock, &settings);
        let report =
            cut("G21 G90\nG0 X0. Y0. Z10.\nG0 Z-2.\nG1 X8. F100\nG0 Z10.\nG0 X0.\nG0 Z-1.5\nG0 Z10.\n");
        let found = hits(&report);
        assert_eq!(found.iter().map(|hit| (hit.0, hit.1)).collect::<Vec<_>>(), [(3, "cutter")]);
        assert!((found[0].2 - 2.0).abs() < 1e-6, "{found:?}");
        let volume = report.removed[1].voxels as f64 * pitch.powi(3);
        // A disc of 6 voxels holds 32 centres.
        assert!((volume / (18.0 * PI) - 1.0).abs() < 0.15 * pitch, "{volume}");
        // In steps far below what is accepted.
        let mut chopped = String::from("G21 G90\nG0 X0. Y0. Z1.\n");
        (1..=60).for_each(|step| {
            let _ = writeln!(chopped, "G0 Z{:.2}", 1.0 - 0.05 * f64::from(step));
        });
        let found = hits(&cut(&chopped)).first().map(|hit| hit.0).unwrap();
        let deep = 0.05 * f64::from(found as u32 - 2) - 1.0;
        assert!(deep > 0.0 && deep < 0.05 + 1.3 * pitch, "{found}");
        // With feeds between that move nothing.
        let fed = chopped.replacen("G0 X0.", "F100 G0 X0.", 1).replace("G0 Z-", "G1 X0.\nG0 Z-");
        assert!(!hits(&cut(&fed)).is_empty());
    }
}

#[test]
fn a_path_that_begins_in_the_stock_came_there_somehow() {
    let path = Toolpath::parse("x,y,z\n0,0,-3\n9,0,-3\n", LengthUnit::Mm, "path").unwrap();
    let report = cut(&end_mill(3.0, 3.0), &path, &block(1.0), &usual(1.0));
    let first = &report.colliding[0];
    assert_eq!((report.colliding.len(), first.line, first.kind), (1, 2, MoveKind::Start));
    assert_eq!(first.collisions[0].element, "cutter");
}

#[test]
fn the_part_is_no_stock_and_what_is_cut_of_it_is_told() {
    // The part is what lies below z = −3.
    let stock = block(1.0);
    let mut part = stock.clone();
    (0..part.grid.len()).filter(|&v| part.grid.voxel(v)[2] >= 17).for_each(|v| part.solid[v] = 0);
    let bodies = CheckBodies::of_part(&part);
    let program = "G21 G90\nG0 X-40. Y0. Z-6.\nG1 X0. F100\n";
    let path = Toolpath::parse(program, LengthUnit::Mm, "path.nc").unwrap();
    let tool = end_mill(3.0, 3.0);
    let run = |fixtures: &[(String, Occupancy)], stock: &Occupancy| {
        let bodies = CheckBodies { fixtures, ..bodies };
        check_stock(bodies, stock, &[(None, &tool)], &path, &usual(1.0), Control::quiet())
    };
    let report = run(&[], &stock).unwrap();
    // The shank is 2 mm in the stock, and the cutter 3 mm in the part.
    assert_eq!(hits(&report).iter().map(|hit| hit.1).collect::<Vec<_>>(), ["shank"]);
    let cut = report.removed[1];
    assert!(cut.of_part * 4 == cut.voxels * 3, "{cut:?}");
    let left = report.left_beside(&part);
    assert_eq!(left.voxels, report.remaining.count() as u64 - (part.count() as u64 - cut.of_part));
    assert_eq!((left.farthest, left.place[2]), (Some(3.0), -0.5));
    // What is in a fixture too is not cut, and is there when the fixture is gone.
    let all = stock.count() as u64;
    let report = run(&[("vise".into(), stock.clone())], &stock).unwrap();
    assert!(report.removed.iter().all(|line| line.voxels == 0) && report.colliding.is_empty());
    assert_eq!((report.voxels, report.remaining), (all, stock.clone()));
    assert_eq!(report.held, [("vise".to_owned(), all)]);
    let mut strip = stock.clone();
    (0..strip.grid.len())
        .filter(|&v| strip.grid.voxel(v)[1].abs_diff(20) > 1)
        .for_each(|v| strip.solid[v] = 0);
    let fixtures = [("beside".into(), Occupancy::empty(stock.grid)), ("jaw".into(), strip.clone())];
    let with_jaw = run(&fixtures, &stock).unwrap();
    let without = run(&[], &stock).unwrap();
    assert_eq!(with_jaw.held, [("jaw".to_owned(), strip.count() as u64)]);
    let remaining = |report: &StockReport| report.remaining.solid.clone();
    let either =
        remaining(&without).iter().zip(&strip.solid).map(|(left, jaw)| left | jaw).collect::<Vec<_>>();
    assert!(remaining(&with_jaw) == either && remaining(&without) != either);
    assert!(with_jaw.overlaps(LengthUnit::Mm)[0].starts_with("the fixture jaw overlaps the stock by "));
    let off = Grid { origin: stock.grid.origin + 0.5, ..stock.grid };
    assert!(matches!(run(&[], &Occupancy::empty(off)), Err(CheckError::StockGrid)));
}

/// Walls and floor run through the centres of voxels, of which those on the lower faces of the part are solid.
#[test]
fn a_slot_whose_walls_run_through_centres_is_cut_out_of_the_stock_and_nothing_of_the_part() {
    let stock = block(1.0);
    // 9 mm wide along y, from z = −8.5 on.
    let in_slot = |[x, _, z]: [usize; 3]| (25..34).contains(&x) && z >= 12;
    let part = Occupancy::of(stock.grid, |voxel| !in_slot(voxel));
    let wall = stock.grid.centre([34, 0, 0]).x;
    let program = |z: f64| format!("G21 G90\nG0 X{} Y-30. Z5.\nG0 Z{z}\nG1 Y30. F100\n", wall - 4.5);
    let tool = revolved([(ElementKind::Cutter, vec![line(0.0, 30.0, 4.5, 4.5)])]);
    let bodies = CheckBodies::of_part(&part);
    let run = |z: f64| {
        let path = Toolpath::parse(&program(z), LengthUnit::Mm, "path.nc").unwrap();
        let report = check_stock(bodies, &stock, &[(None, &tool)], &path, &usual(1.0), Control::quiet());
        let checked = check_toolpath(bodies, &[(None, &tool)], &path, &usual(1.0), Control::quiet());
        (report.unwrap(), checked.unwrap())
    };
    let (report, checked) = run(-7.5);
    assert!(checked.colliding.is_empty(), "{checked:?}");
    let cut = report.removed.last().unwrap();
    assert_eq!((cut.voxels, cut.of_part), (9 * 40 * 8, 0));
    // 0.1 mm below the centres of its floor, which are named, and counted, without those of the walls.
    let (report, checked) = run(-8.6);
    let hit = &checked.colliding[0].collisions[0];
    assert!((hit.depth - 0.6).abs() < 1e-6 && (hit.contact[2] + 8.5).abs() < 1e-9, "{hit:?}");
    assert!(hit.voxels <= 9 * 9, "{hit:?}");
    let cut = report.removed.last().unwrap();
    assert_eq!((cut.voxels, cut.of_part), (9 * 40 * 8 + 8 * 40, 8 * 40));
}

#[test]
fn a_drill_that_is_moved_aside_in_the_stock_collides_and_one_that_plunges_cuts() {
    let (stock, settings) = (block(0.5), usual(0.5));
    let drill = Tool { plunge_only: true, ..end_mill(3.0, 3.0) };
    let program = "G21 G90\nG0 X0. Y0. Z5.\nG1 Z-3. F100\nZ2.\nX10.\nZ-3.\nX14.\nG0 Z5.\n";
    let report = cut_with(&drill, program, &stock, &settings);
    // Deepest where it has gone farther than its own width.
    let [(7, "cutter", depth)] = hits(&report)[..] else { panic!("{:?}", hits(&report)) };
    assert!((2.0..=3.0).contains(&depth), "{depth}");
    assert!(hits(&cut_with(&end_mill(3.0, 3.0), program, &stock, &settings)).is_empty());
    // In however many steps: along an arc, and by tenths.
    let steps = (1..40).map(|step| format!("X{:.1}\n", 0.1 * f64::from(step))).collect::<String>();
    for (aside, line) in [("G2 X0. Y0. I2. J0.\n".to_owned(), 4), (steps, 5)] {
        let report =
            cut_with(&drill, &format!("G21 G90\nG0 X0. Y0. Z5.\nG1 Z-3. F100\n{aside}"), &stock, &settings);
        let told = hits(&report);
        let [(first, "cutter", _), ..] = told[..] else { panic!("{told:?}") };
        assert!((line..line + 4).contains(&first), "{told:?}");
    }
    // Its tip stays where it is, and its axis tilts.
    let path = "x,y,z,i,j,k\n0,0,5,0,0,1\n0,0,-3,0,0,1\n0,0,-3,0.5,0,1\n";
    let path = Toolpath::parse(path, LengthUnit::Mm, "path.csv").unwrap();
    assert!(matches!(hits(&cut(&drill, &path, &stock, &settings))[..], [(4, "cutter", _), ..]));
}

#[test]
fn a_cutter_that_does_not_cut_with_its_back_collides_where_it_is_fed_back_into_stock() {
    let (stock, settings) = (block(0.5), usual(0.5));
    let disc = revolved([
        (ElementKind::Cutter, vec![line(0.0, 3.0, 5.0, 5.0)]),
        (ElementKind::Shank, vec![line(3.0, 30.0, 2.0, 2.0)]),
    ]);
    // From the side, below the top; straight up through what stands above it, and down again.
    let program = "G21 G90\nG0 X-40. Y0. Z-8.\nG1 X0. F100\nZ-4.\nZ-8.\n";
    let of_cutter = |tool: &Tool| -> Vec<usize> {
        let report = cut_with(tool, program, &stock, &settings);
        hits(&report).iter().filter(|hit| hit.1 == "cutter").map(|hit| hit.0).collect()
    };
    assert_eq!(of_cutter(&disc), [4]);
    assert!(of_cutter(&Tool { back_cutting: true, ..disc }).is_empty());
}

#[test]
fn a_hole_of_a_cycle_is_a_feed_and_its_way_down_to_r_a_rapid() {
    let tool = end_mill(3.0, 3.0);
    let drilled = |level: f64| {
        let program = format!("G21 G90 G17 G0 X10. Y0. Z5.\nG98 G81 X0. Y0. Z-9. R{level:.1} F9\nG80\nM30\n");
        cut_with(&tool, &program, &block(0.5), &usual(0.5))
    };
    let report = drilled(2.0);
    assert!(report.colliding.is_empty(), "{:?}", hits(&report));
    let [.., hole] = report.removed.as_slice() else { panic!("{:?}", report.removed) };
    let volume = hole.voxels as f64 / 8.0;
    assert_eq!((hole.line, hole.kind), (2, MoveKind::Feed));
    assert!((volume / (PI * 81.0) - 1.0).abs() < 0.05, "{volume}");
    let report = drilled(-4.0);
    assert_eq!(
        report.colliding.iter().map(|line| (line.line, line.kind)).collect::<Vec<_>>(),
        [(2, MoveKind::Rapid)]
    );
}
