//! `imf check`: what it says, and the exit code it leaves.

use serde_json::Value;

use crate::binary::{Finished, Workdir};

/// A block of 20 mm on the floor, its middle over the origin.
pub(crate) const BLOCK: &str = "v -10 -10 0\nv 10 -10 0\nv 10 10 0\nv -10 10 0\nv -10 -10 20\nv 10 -10 20\nv 10 10 20\n\
                     v -10 10 20\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// Checks a toolpath over the block.
fn check(name: &str, toolpath: &str, more: &str) -> Finished {
    check_at("1", name, toolpath, more)
}

fn check_at(pitch: &str, name: &str, toolpath: &str, more: &str) -> Finished {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write(name, toolpath);
    let tool = if more.contains("--tool") { "" } else { "--tool paper" };
    folder.imf(&format!("check block.obj {name} --pitch {pitch} --margin 2 {tool} {more}"))
}

#[test]
fn a_finishing_pass_is_free_and_says_what_was_accepted() {
    // Where the uppermost centres are 0.04 deep in the ball, the top is 0.54 deep; where the top is 0.04 deep in it nothing collides.
    check("pass.cl", "GOTO/-12,0,19.46,0,0,1\nGOTO/12,0,19.46\n", "").exits(3);
    let run = check("pass.cl", "GOTO/-12,0,19.96,0,0,1\nGOTO/12,0,19.96\n", "").done();
    assert!(run.stdout.starts_with("no collision: 2 lines"), "{}", run.stdout);
    let sure = "a cutter deeper than 0.1881 mm in the part's surface; other overlaps deeper than 0.7048 mm";
    run.says(&["accepted: up to 0.05 mm deep: the part in the cutter", sure]);
    // At twice the pitch the same length is accepted.
    check_at("2", "deep.csv", "x,y,z\n0,0,17\n", "").exits(3).says(&["up to 0.05 mm deep: the part"]);
    let path = "x,y,z\n-12,0,20\n12,0,20\n";
    check("pass.csv", path, "--conservative").done().says(&["up to 0.05 mm deep"]);
    // What is hit is told with what its depths are.
    for (options, told) in [("--conservative", true), ("", false)] {
        let said = check("deep.csv", "x,y,z,i,j,k\n0,0,10,0,-0.00001,1\n", options).exits(3).stdout;
        assert!(said.contains("the axis 0.0000,0.0000,1.0000"), "{said}");
        assert_eq!(
            said.contains("conservative voxels, whose centres lie up to 0.866 mm outside"),
            told,
            "{said}"
        );
    }
}

#[test]
fn a_collision_names_its_line_element_depth_and_place_and_leaves_3() {
    // Beside the block, then in under the holder.
    let toolpath = "x,y,z,i,j,k\n0,0,40,0,0,1\n0,0,41,0,0,1\n-17,0,-20,0,0,1\n";
    let run = check("dive.csv", toolpath, "--clearance 1").exits(3);
    run.says(&["line 4: holder 1 with its clearance is 6 mm deep"]);
    let run = check("dive.csv", toolpath, "--json --quiet");
    assert_eq!((run.code, run.stderr.as_str()), (Some(3), ""));
    let answer = run.json();
    assert_eq!(answer["collides"], true);
    let line = &answer["report"]["colliding"][0];
    assert_eq!((&line["line"], &line["kind"]), (&Value::from(4), &Value::from("feed")));
    let hits = line["collisions"].as_array().unwrap();
    let holder = hits.iter().find(|hit| hit["element"] == "holder 1").unwrap();
    // Its face is 5 below the top.
    assert!((holder["depth"].as_f64().unwrap() - 5.0).abs() < 0.51, "{holder}");
    assert_eq!(holder["position"], serde_json::json!([-17.0, 0.0, -20.0]));
    // Just out of it, and nearer than is required.
    let run = check("near.csv", "x,y,z\n-17,0,-14\n", "--clearance 2");
    run.says(&["line 2: holder 1 comes within 1 mm of the part, 2 mm required"]);
}

#[test]
fn a_folder_has_a_table_a_picture_and_the_answer() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("dive.csv", "x,y,z\n0,0,40\n0,0,12\n");
    let run = |path: &str| folder.imf(&format!("check block.obj {path} --tool paper --pitch 1 --out out"));
    run("dive.csv").exits(3);
    let table = folder.text("out/collisions.csv");
    let mut lines = table.lines();
    assert!(lines.next().unwrap().starts_with("line,tool,kind,element,against,depth,"));
    assert!(lines.next().unwrap().starts_with("3,,feed,cutter,part,7.9"), "{table}");
    let summary = folder.read_json("out/summary.json");
    assert_eq!(summary["files"], serde_json::json!(["collisions.csv", "worst.png", "summary.json"]));
    let picture = image::open(folder.path("out/worst.png")).unwrap().to_rgb8();
    assert!(picture.width() > 500);
    // Overlap has the colour that it has beside a machine or stock: Viridis at two thirds.
    let overlap = [0x35_u8, 0xb7, 0x79];
    assert!(picture.pixels().any(|pixel| (0..3).all(|c| pixel[c].abs_diff(overlap[c]) < 4)));
    // In metres too.
    folder.write("metres.csv", "x,y,z\n0,0,0.04\n0,0,0.012\n");
    let metres = "check block.obj metres.csv --tool paper --scale 0.001 --unit m --pitch 0.001 --out metres";
    folder.imf(metres).exits(3);
    let fields = |table: &str| -> Vec<f64> {
        let line = table.lines().nth(1).unwrap();
        line.split(',').skip(5).map(|field| field.parse().unwrap_or(f64::NAN)).collect()
    };
    let columns: Vec<&str> = table.lines().next().unwrap().split(',').skip(5).collect();
    let [mm, m] = [&table, &folder.text("metres/collisions.csv")].map(|table| fields(table));
    for (column, power) in [("depth", 1), ("volume", 3)] {
        let at = columns.iter().position(|name| *name == column).unwrap();
        assert!((m[at] * 1e3_f64.powi(power) / mm[at] - 1.0).abs() < 1e-6, "{column}: {} {}", mm[at], m[at]);
    }
    // Nothing of it is left for a path that is free.
    folder.write("free.csv", "x,y,z\n0,0,40\n");
    run("free.csv").done();
    assert_eq!(folder.text("out/collisions.csv").lines().count(), 1);
    assert!(!folder.path("out/worst.png").exists());
}

#[test]
fn of_many_collisions_the_first_and_the_worst_are_listed_and_a_table_has_all() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    // The deepest is on line 202.
    let place = |n: u32| format!("{},0,{}\n", 0.01 * f64::from(n), if n == 200 { 15 } else { 18 });
    folder.write("low.csv", "x,y,z\n".to_owned() + &(0..300).map(place).collect::<String>());
    let asked = "check block.obj low.csv --pitch 1 --margin 2 --tool paper";
    let run = folder.imf(&format!("{asked} --out out")).exits(3);
    let (summary, table) = (folder.read_json("out/summary.json"), folder.text("out/collisions.csv"));
    let all = table.lines().count() - 1;
    assert_eq!((&summary["collisions"], &summary["lines_that_collide"]), (&all.into(), &300.into()));
    assert_eq!(summary["worst"]["line"], 202);
    let lines = summary["report"]["colliding"].as_array().unwrap();
    let listed: usize = lines.iter().map(|line| line["collisions"].as_array().unwrap().len()).sum();
    assert_eq!((listed, &lines[0]["line"]), (100, &2.into()));
    assert!(lines.iter().any(|line| line["line"] == 202), "{lines:?}");
    assert_eq!(run.stdout.lines().filter(|line| line.starts_with("line ")).count(), 100);
    let more = format!("… and {} more collisions: the first 50 and the 50 worst", all - 100);
    run.says(&["line 202: ", &more, &format!("all {all} are in out/collisions.csv"), "300 lines collide"]);
    folder.imf(asked).exits(3).says(&[&more, &format!("--out FOLDER writes all {all} to collisions.csv")]);
}

#[test]
fn a_path_beyond_the_memory_is_refused() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("long.csv", "x,y,z\n".to_owned() + &"0,0,40\n".repeat(20_000));
    let asked = "check block.obj long.csv --pitch 2 --margin 2 --tool paper";
    folder.refuse(&format!("{asked} --memory 4MiB"), &["and 4 MiB may be used", "a path of 20000 lines"]);
    folder.imf(asked).done();
}

#[test]
fn what_is_not_understood_is_refused_with_its_line() {
    let refuse = |name: &str, path: &str, more: &str, expected: &[&str]| {
        check(name, path, more).bad_input(expected);
    };
    let zero = "x,y,z,i,j,k\n0,0,40,0,0,0\n";
    refuse("path.csv", zero, "", &["path.csv, line 2: the tool axis must not be zero"]);
    refuse("path.csv", "", "", &["path.csv", "no tool location"]);
    let drill = "GOTO/0,0,30\nCYCLE/DRILL,29,100\nGOTO/0,0,21\n";
    refuse("drill.cl", drill, "", &["drill.cl, line 2", "CYCLE moves"]);
    let change = "LOADTL/1\nGOTO/0,0,30\nLOADTL/2\nGOTO/0,0,30\n";
    refuse(
        "two.cl",
        change,
        "",
        &["two.cl: line 4: the tool changes, from tool 1 to tool 2", "--tool NUMBER=FILE"],
    );
    refuse(
        "two.cl",
        change,
        "--tool 1=paper",
        &["line 4: tool 2, and the tools that are given have the numbers 1"],
    );
    refuse("path.csv", "x,y,z\n0,0,40\n", "--contact 5", &["twice the contact of 5", "--contact"]);
    refuse("path.csv", "x,y,z\n0,0,40\n", "--step 1e9", &["a step of 1000000000", "10 thick"]);
    // Cut out of 40.
    refuse("cut.cl", "GOTO/0,0,4", "", &["cut.cl, line 1: the file ends in the middle of a line"]);
    let open = check("two.cl", change, "--tool 1=paper --tool 2=paper --json").done().json();
    assert!(open["remarks"].to_string().contains("line 4: the file stops here without FINI"), "{open}");
}

#[test]
fn a_cutter_that_the_path_was_not_made_for_is_refused_and_a_number_is_said() {
    let path = |cutter: &str| format!("LOADTL/7\n{cutter}\nGOTO/0,0,40\n");
    // The paper's tool is a ball of 10 mm.
    for same in ["CUTTER/10", "CUTTER/10.0,5.0", "UNITS/INCH\nCUTTER/.3937,.19685\nUNITS/MM"] {
        let run = check("cutter.cl", &path(same), "").done();
        run.warns(&["calls its only tool 7: it is checked with 'paper'"]);
    }
    for (other, said) in [("CUTTER/12", "diameter of 12"), ("TLDATA/MILL,10,1,50", "corner radius of 1")] {
        let given = if other.contains("12") { "'paper' is 10" } else { "'paper' is 5" };
        check("cutter.cl", &path(other), "").bad_input(&["cutter.cl: line 2", said, given, "give the tool"]);
    }
}

#[test]
fn a_path_follows_the_part_or_stays_in_the_world() {
    // The part is moved away from a path in the world, and takes one of its own along.
    let moved = "--transform translate:200,0,0";
    let path = "x,y,z\n0,0,12\n";
    let answer = check("path.csv", path, &format!("{moved} --json")).exits(3).json();
    assert_eq!(
        answer["report"]["colliding"][0]["collisions"][0]["position"],
        serde_json::json!([0.0, 0.0, 12.0])
    );
    // Column by column, and whose coordinates these are.
    assert_eq!((&answer["frame"], &answer["transform"][12]), (&Value::from("part"), &Value::from(200.0)));
    let world = check("path.csv", path, &format!("{moved} --frame world")).done();
    world.says(&["coordinates are in the world's frame"]);
}

#[test]
fn what_would_be_overlooked_is_refused() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("path.csv", "x,y,z\n0,0,40\n0,0,4\n");
    folder.write("thin.toml", "name = \"thin\"\n[cutter]\nshape = \"flat\"\ndiameter = 3.0\nlength = 30.0\n");
    let thin = "check block.obj path.csv --tool thin.toml --contact 0 --pitch";
    let run = |pitch: &str| folder.imf(&format!("{thin} {pitch}"));
    run("4").refused(&["cutter", "3 mm thick", "pitch of at most 2.121,", "--pitch, or --allow-coarse"]);
    run("2").exits(3);
    // Whoever insists is answered, and told in the answer.
    let coarse = folder.imf(&format!("{thin} 4 --allow-coarse --json"));
    let answer = coarse.json();
    assert!(answer["warnings"][0].as_str().unwrap().contains("3 mm thick"), "{answer}");
    folder.write("plate.obj", BLOCK.replace("20", "0.4"));
    let held = "check block.obj path.csv --tool paper --pitch 2 --margin 4";
    folder.refuse(
        &format!("{held} --fixture plate.obj@translate:0,0,21.3"),
        &["plate.obj", "overlooked", "smaller pitch"],
    );
}

#[test]
fn fixtures_are_hit_by_the_cutter_too_and_contact_does_not_help() {
    let post = BLOCK.replace("10", "3").replace("20", "30");
    let check = |more: &str| {
        let folder = Workdir::new();
        folder.write("block.obj", BLOCK);
        folder.write("post.obj", &post);
        folder.write("path.csv", "x,y,z\n-20,0,20\n20,0,20\n");
        folder.imf(&format!("check block.obj path.csv --tool paper --pitch 1 --margin 2 {more}"))
    };
    // The post stands on the block's edge, half of it beside the block.
    let post = "--fixture post.obj@translate:10,0,0";
    check("").done();
    // It is hit where it sticks out of the grid around the block, too.
    let hit = check(&format!("{post} --contact 2 --json")).exits(3);
    let around = check(&format!("{post} --around all --contact 2 --json")).exits(3);
    assert_eq!(around.stdout, hit.stdout);
    let answer = hit.json();
    let collisions = answer["report"]["colliding"][0]["collisions"].as_array().unwrap();
    assert!(
        collisions.iter().any(|c| c["element"] == "cutter" && c["against"]["fixture"] == "post.obj"),
        "{collisions:?}"
    );
    assert!(collisions.iter().all(|c| c["against"]["fixture"] == "post.obj"), "{collisions:?}");
    assert!(answer["guarantee"].as_str().unwrap().starts_with("exact for voxel centres"));
}

#[test]
fn the_guarantee_follows_clearance_voxels_and_step() {
    let path = "x,y,z\n-12,0,24\n12,0,24\n";
    let run = check("pass.csv", path, "--conservative --clearance 1").done();
    run.says(&[
        "holder and shank keep off the mesh itself",
        "at every time, not only at the checked poses, for the clearance",
    ]);
    let all = "--conservative --contact 0 --clearance 0.87 --clearance-cutter 0.87";
    let run = check("pass.csv", path, all);
    run.says(&["the whole tool keeps off the mesh itself", "nearer by 0.125:", "at least 0.9911"]);
}

#[test]
fn a_path_that_never_comes_near_the_part_is_warned_of() {
    // In a unit that is 25.4 times too large.
    let far = check("far.csv", "x,y,z\n0,0,1016\n254,0,762\n", "").done();
    far.warns(&["warning: the tips of the whole path stay 742"]);
    // Straight over the part from far away on either side.
    let over = check("over.csv", "x,y,z\n0,0,1016\n0,0,-1016\n", "").exits(3);
    assert!(!over.stderr.contains("the whole path stay"), "{}", over.stderr);
}

#[test]
fn a_needle_is_said_to_pass_between_the_centres_and_a_pitch_of_its_own_sees_it() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("needle.toml", "[cutter]\nshape = 'tapered'\ndiameter = 0.5\nhalf_angle = 5\nlength = 25\n[shank]\ndiameter = 6\nlength = 20\n");
    folder.write("plunge.csv", "x,y,z\n0.3,0.2,40\n0.3,0.2,15\n");
    let run = |more: &str| {
        let asked = "check block.obj plunge.csv --unit mm --tool needle.toml";
        folder.imf(&format!("{asked} {more}"))
    };
    run("--pitch 1").refused(&["the slender tip of the tool", "pitch of at most 0.57"]);
    // Beside a tool that is thicker everywhere too.
    folder.write("two.csv", "x,y,z,tool\n0,0,40,1\n0,0,30,1\n0.3,0.2,40,2\n0.3,0.2,15,2\n");
    let both = "check block.obj two.csv --unit mm --pitch 1 --tool 1=paper --tool 2=needle.toml";
    folder.refuse(both, &["the slender tip of the tool"]);
    let coarse = run("--pitch 1 --allow-coarse").exits(3);
    let (_, sure) = coarse.stdout.split_once("a cutter deeper than ").unwrap();
    let sure: f64 = sure.split_whitespace().next().unwrap().parse().unwrap();
    // Between points half a voxel apart it is as wide as the circle that holds none, below its contact, from 2.07 on.
    let tilt = 5_f64.to_radians();
    let wide = (0.36 + 0.05 / tilt.cos() - 0.25 * tilt.cos()) / tilt.tan() + 0.25 * (1.0 - tilt.sin());
    assert!((sure - wide - 0.125).abs() < 1e-3, "{wide} {}", coarse.stdout);
    run("").exits(3);
}

#[test]
fn what_enters_the_surface_of_a_fixture_between_the_centres_is_told() {
    let jaw = BLOCK.replace(" 10", " 40").replace(" -10", " 20");
    let run = |more: &str| {
        let folder = Workdir::new();
        folder.write("block.obj", BLOCK);
        folder.write("jaw.obj", &jaw);
        // The jaw's side at x = 20 is 0.3 deep in the cutter, and no centre.
        folder.write("beside.csv", "x,y,z\n15.3,30,12\n");
        let asked =
            "check block.obj beside.csv --unit mm --pitch 1 --tool paper --fixture jaw.obj@unit:mm --json";
        folder.imf(&format!("{asked} {more}"))
    };
    let (told, strict) = (run("").exits(3), run("--contact 0").done());
    let hit = &told.json()["report"]["colliding"][0]["collisions"][0];
    // Half of half a voxel beside the axis the round is 0.007 shallower.
    assert!((0.29..0.300_001).contains(&hit["depth"].as_f64().unwrap()) && hit["voxels"] == 0, "{hit}");
    // Where nothing may touch, voxels alone are known, and it is said.
    let report = &strict.json()["report"];
    assert!(report["sure_overlap"].is_null() && report["sure_depth"].as_f64().unwrap() > 1.7, "{report}");
}

/// The shank is half a voxel wider a side than the cutter.
#[test]
fn a_shank_that_voxels_see_at_some_walls_alone_is_warned_of_by_every_command() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("path.csv", "x,y,z\n0,0,30\n");
    let mill = "name = \"neck\"\nunit = \"mm\"\nstick_out = 30.0\n[cutter]\nshape = \"flat\"\ndiameter = 8.0\n\
                length = 10.0\n[shank]\ndiameter = 9.0\n[[holder]]\ndiameter = 30.0\nlength = 60.0\n";
    folder.write("neck.toml", mill);
    let of_scene = "--unit mm --pitch 1 --tool neck.toml";
    for line in [
        format!("check block.obj path.csv {of_scene}"),
        format!("field block.obj {of_scene} --orientations 0,0 --out field"),
        format!("access block.obj {of_scene} --orientations 0,0 --out access"),
        format!("crib block.obj {of_scene} --orientations 0,0 --out crib"),
    ] {
        let run = folder.imf(&line).done();
        let warnings = run.stderr.matches("is 0.5 mm a side wider than the cutter").count();
        assert_eq!(warnings, 1, "`imf {line}`:\n{}", run.stderr);
    }
}

#[test]
fn what_is_not_checked_is_said_beside_the_verdict_and_in_json() {
    let program = "G21 G90 G17\nT1 M6\nG0 Z95.\nY-60.\nY60.\nX0.\n";
    check("path.nc", program, "--tool 1=paper").says(&["not checked: the motions of line 5"]);
    let found = check("path.nc", program, "--tool 1=paper --json").json();
    assert_eq!(found["unchecked_lines"], serde_json::json!([5]));
    let remarks = found["remarks"].as_array().unwrap();
    assert!(remarks.iter().any(|remark| remark.as_str().unwrap().contains("is not checked")), "{found}");
    // The part is scaled, and with it a path that says millimetres.
    let scaled = check("path.nc", program, "--tool 1=paper --transform matrix:2,0,0,0,0,2,0,0,0,0,2,0");
    scaled.warns(&["is multiplied by 2"]);
    // As it is set the tool is asked of part and fixtures alone.
    let path = "x,y,z\n0,0,25\n5,0,25\n";
    check("path.csv", path, "--stock box:5 --stickout").says(&["the stock is not considered"]);
}

/// Of a cutter a millimetre above or below the top of the block, between the centres of voxels of 4 mm.
#[test]
fn a_gouge_that_no_centre_shows_is_told_from_the_parts_own_faces() {
    for (depth, collides) in [(0.04, false), (0.3, true), (1.5, true)] {
        let path = format!("x,y,z\n-6,0,{0}\n6,0,{0}\n", 20.0 - depth);
        let found = check_at("4", "path.csv", &path, "--json --allow-coarse").json();
        assert_eq!(found["collides"], collides, "{depth}: {found}");
        let sure = found["report"]["sure_gouge"].as_f64().unwrap();
        assert!(sure < 1.0 && found["report"]["sure_depth"].as_f64().unwrap() > 7.0, "{found}");
    }
}
