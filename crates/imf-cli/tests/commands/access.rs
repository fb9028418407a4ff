//! `imf access`: all that it writes, held against its own summary, and what it refuses.

use serde_json::Value;

use crate::binary::Workdir;
use crate::shapes::cuboid;

/// A block of 20 mm on the floor with a slot of 4 mm, 12 mm deep, along y: three boxes.
fn slotted() -> String {
    let boxes = [([-10, 0], [10, 8]), ([-10, 8], [-2, 20]), ([2, 8], [10, 20])];
    let mut text = String::new();
    for (index, ([x0, z0], [x1, z1])) in boxes.into_iter().enumerate() {
        text += &cuboid([x0, -10, z0], [x1, 10, z1], 8 * index);
    }
    text
}

pub(crate) fn mill(name: &str, length: f64) -> String {
    format!(
        "name = \"{name}\"\n[cutter]\nshape = \"flat\"\ndiameter = 3.0\nlength = {length}\n[[holder]]\ndiameter = 16.0\n\
         length = 20.0\n"
    )
}

/// The slotted block, two tools and a clamp, in a fresh folder.
pub(crate) fn workshop() -> Workdir {
    let folder = Workdir::new();
    folder.write("part.obj", slotted());
    folder.write("clamp.obj", cuboid([0, 0, 0], [6, 6, 12], 0));
    folder.write("short.toml", mill("short", 6.0));
    folder.write("long.toml", mill("long", 18.0));
    folder
}

const RUN: &str = "access part.obj --pitch 2 --out out";

pub(crate) fn arguments(more: &str) -> String {
    format!("{RUN} {more}")
}

/// The same of `imf crib`.
pub(crate) fn crib_arguments(more: &str) -> String {
    arguments(more).replace("access ", "crib ")
}

fn voxels(value: &Value) -> usize {
    value["voxels"].as_u64().unwrap() as usize
}

#[test]
fn every_output_is_there_and_agrees_with_the_summary() {
    let folder = workshop();
    let summary = folder.json(&arguments(
        "--tool short.toml --tool long.toml --fixture clamp.obj@translate:10,-3,0 --stock box:2 \
         --orientations fibonacci:14 --map 0,0,10 --map-step 45",
    ));
    assert_eq!(summary, folder.read_json("out/summary.json"));
    let mut files: Vec<String> =
        summary["files"].as_array().unwrap().iter().map(|f| f.as_str().unwrap().to_owned()).collect();
    files.sort();
    assert_eq!(files, folder.names("out"));
    for name in ["imf.vti", "surface.ply", "removable.vti", "map_tool_1.png", "slices.png"] {
        assert!(files.iter().any(|file| file == name), "{name}: {files:?}");
    }
    let imf = folder.npy::<f32>("out/imf.npy");
    let solid = folder.npy::<u8>("out/solid.npy");
    let dims: Vec<usize> = serde_json::from_value(summary["dims"].clone()).unwrap();
    assert_eq!(imf.shape(), dims);
    let empty = |predicate: &dyn Fn(f32) -> bool| {
        imf.iter().zip(&solid).filter(|&(&v, &s)| s == 0 && predicate(v)).count()
    };
    assert_eq!(voxels(&summary["accessible"]), empty(&|v| v == 0.0));
    assert_eq!(voxels(&summary["inaccessible"]), empty(&|v| v > 0.0));
    assert_eq!(voxels(&summary["solid"]), solid.iter().filter(|&&s| s != 0).count());
    assert!(solid.iter().any(|&s| s == 2), "the clamp");
    assert_eq!(summary["accessible"]["volume"], 8.0 * voxels(&summary["accessible"]) as f64);
    assert_eq!(summary["fixtures"], serde_json::json!(["clamp.obj"]));
    assert_eq!(folder.text("out/orientations.csv").lines().count(), 15);
    // The long tool gets into the slot, the short one's holder does not.
    let reached = [0, 1].map(|tool| voxels(&summary["tools"][tool]["accessible"]));
    assert!(reached[0] < reached[1], "{reached:?}");
    let stock = &summary["stock"];
    assert_eq!(voxels(&stock["to_remove"]), voxels(&stock["removable"]) + voxels(&stock["stays"]));
    let classes = folder.npy::<u8>("out/removable.npy");
    for (what, class) in [("out_of_reach", 1), ("removable", 2), ("undecided", 4)] {
        assert_eq!(voxels(&stock[what]), classes.iter().filter(|&&c| c == class).count(), "{what}");
    }
    assert_eq!(voxels(&stock["stays"]), voxels(&stock["undecided"]) + voxels(&stock["out_of_reach"]));
}

#[test]
fn unreached_space_is_split_by_elements_that_sum_to_the_measure() {
    let folder = workshop();
    let tools = "--tool short.toml --tool long.toml --orientations fibonacci:14";
    let text = folder.imf(&arguments(tools)).done().stdout;
    assert!(text.contains("the cutter hits") && text.contains("the holder 1 hits"), "{text}");
    let summary = folder.read_json("out/summary.json");
    let solid = folder.npy::<u8>("out/solid.npy");
    for tool in 0..2 {
        let imf = folder.npy::<f32>(&format!("out/imf_tool_{tool}.npy"));
        let parts =
            ["cutter", "holder_1"].map(|name| folder.npy::<f32>(&format!("out/imf_{name}_tool_{tool}.npy")));
        for (index, &whole) in imf.indexed_iter() {
            // Three numbers, each rounded to f32 once.
            let sum = f64::from(parts[0][index]) + f64::from(parts[1][index]);
            assert!((sum - f64::from(whole)).abs() <= f64::from(f32::EPSILON) * sum, "{index:?}");
        }
        let rows = summary["tools"][tool]["blocked_by"].as_array().unwrap();
        assert_eq!(rows.len(), 2);
        for (row, name, own, other) in [(0, "cutter", 0, 1), (1, "holder 1", 1, 0)] {
            let outside = || (0..solid.len()).filter(|&v| solid.as_slice().unwrap()[v] == 0);
            let at = |part: usize, v: usize| parts[part].as_slice().unwrap()[v] > 0.0;
            assert_eq!(rows[row]["element"], name);
            assert_eq!(voxels(&rows[row]["hits"]), outside().filter(|&v| at(own, v)).count());
            let alone = outside().filter(|&v| at(own, v) && !at(other, v)).count();
            assert_eq!(voxels(&rows[row]["alone"]), alone);
            assert_eq!(rows[row]["alone"]["volume"], 8.0 * alone as f64);
        }
        // A longer tool mends what the holder alone blocks.
        assert!(tool == 1 || voxels(&rows[1]["alone"]) > 0);
    }
    assert_eq!(summary["blocked_by"].as_array().unwrap().len(), 2);
    // Below a threshold as well what is solid is neither accessible nor inaccessible.
    let imf = folder.npy::<f32>("out/imf.npy");
    let summary = folder.json(&arguments(&format!("{tools} --tau 0.1")));
    for (what, below) in [("accessible", true), ("inaccessible", false)] {
        let expected = imf.iter().zip(&solid).filter(|&(&v, &s)| s == 0 && (v <= 0.1) == below).count();
        assert_eq!(voxels(&summary[what]), expected, "{what}");
    }
    assert!(imf.iter().zip(&solid).any(|(&v, &s)| s != 0 && v <= 0.1), "a threshold that says nothing");
}

#[test]
fn clearance_takes_space_contact_gives_some_and_both_are_said() {
    let folder = workshop();
    let run = |more: &str| {
        let long = arguments("--tool long.toml --orientations fibonacci:14 --margin 3");
        folder.json(&format!("{long} {more}"))
    };
    let plain = run("");
    let roomy = run("--clearance 2 --clearance-cutter 1.8");
    let touching = run("--contact 2");
    let accessible = [&roomy, &plain, &touching].map(|summary| voxels(&summary["accessible"]));
    assert!(accessible.is_sorted() && accessible[0] < accessible[1], "{accessible:?}");
    assert!(accessible[1] < accessible[2], "{accessible:?}");
    assert_eq!(roomy["clearance"], serde_json::json!({ "holder": 2.0, "shank": 2.0, "cutter": 1.8 }));
    assert_eq!((&plain["contact"], &touching["contact"]), (&Value::Null, &2.0.into()));
    let guarantee = |summary: &Value| summary["guarantee"].as_str().unwrap().to_owned();
    // Promises about the mesh itself need conservative voxels, and a clearance of half a voxel's diagonal.
    let run = |more: &str| run(&format!("--conservative {more}"));
    let roomy = run("--clearance 2 --clearance-cutter 1.8");
    assert!(guarantee(&roomy).contains("the whole tool keeps off the mesh itself"));
    assert!(guarantee(&run("")).contains("also needs a clearance"));
    let with_both = run("--clearance 2 --contact 2");
    assert!(guarantee(&with_both).contains("holder and shank keep off the mesh itself"));
}

#[test]
fn by_default_it_looks_along_the_axes_and_what_the_part_suggests() {
    let folder = workshop();
    let turned = "--tool long.toml --transform rotate:0,1,0:30 --pitch 2";
    let summary = folder.json(&format!("access part.obj --out out {turned}"));
    assert_eq!(summary["orientations"], "axes+normals+fibonacci:225");
    // The set-up column by column: x is turned down, z towards +x.
    let turn = [2, 8].map(|at| summary["transform"][at].as_f64().unwrap());
    assert!((turn[0] + 0.5).abs() < 1e-9 && (turn[1] - 0.5).abs() < 1e-9, "{turn:?}");
    let suggested = summary["suggested_by_the_part"].as_array().unwrap();
    let slot = suggested.iter().find(|row| {
        let component = |axis: usize| row["direction"][axis].as_f64().unwrap();
        (component(0) - 0.5).abs() < 1e-9 && (component(2) - 0.75f64.sqrt()).abs() < 1e-9
    });
    // The tops of the slot's walls and its floor, and of each box the lid that the next one stands on.
    assert!(slot.is_some_and(|row| row["flat_area"].as_f64().unwrap() > 300.0), "{suggested:?}");
    // Its length lies along the world's y.
    assert_eq!((suggested.len(), &summary["orientation_count"]), (6, &(6 + 4 + 225).into()));
    let summary = folder.json(&format!("field part.obj --imf --out imf {turned}"));
    assert_eq!(summary["orientations"]["count"], 6 + 4 + 225);
    assert_eq!(summary["orientations"]["suggested_by_the_part"].as_array().unwrap().len(), 6);
    let dataset = "dataset part.obj --orientations axes+normals --out data";
    folder.refuse_input(&format!("{dataset} {turned}"), &["'normals'", "no surface is known"]);
}

/// About the axis of a round tool, too.
#[test]
fn a_direction_that_is_named_again_counts_once() {
    let folder = workshop();
    let counts = |set: &str| {
        folder.imf(&arguments(&format!("--tool long.toml --orientations {set}"))).done();
        (folder.npy::<u32>("out/free_orientations.npy"), folder.bytes("out/surface.ply"))
    };
    assert!(counts("0,0;90,0;0,0;30,40") == counts("0,0;30,40"));
}

#[test]
fn machine_limits_leave_only_what_the_axes_reach() {
    let folder = workshop();
    // Tilts from the upright that each limit allows.
    for (limits, least, most) in
        [("cone:0,0,1:40", 0.0, 40.0), ("ac:-30:50:-360:360", 0.0, 50.0), ("bc:20:70:-360:360", 20.0, 70.0)]
    {
        let more = format!("--tool long.toml --orientations fibonacci:60 --limits {limits}");
        let summary = folder.json(&arguments(&more));
        let list = folder.text("out/orientations.csv");
        let tilts: Vec<f64> =
            list.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
        assert_eq!(summary["orientation_count"], tilts.len());
        assert!((3..60).contains(&tilts.len()), "{limits}: {tilts:?}");
        assert!(tilts.iter().all(|tilt| (least - 1e-9..=most + 1e-9).contains(tilt)), "{limits}: {tilts:?}");
    }
    // A cone that is open adds no direction to those asked for, and one that holds none of them is refused.
    let within =
        |set: &str| arguments(&format!("--tool long.toml --limits cone:0,0,1:10 --orientations {set}"));
    assert_eq!(folder.json(&within("0,5"))["orientation_count"], 1);
    folder.refuse_input(&within("0,90"), &["none of its 1 orientations is within cone:0,0,1:10"]);
    let sets = "--tool long.toml --orientations ac:0:40:0:270:3:4";
    assert_eq!(folder.json(&arguments(sets))["orientation_count"], 12);
}

#[test]
fn bad_input_is_refused_with_a_remedy() {
    let folder = workshop();
    folder.write("part.toml", "name = \"solid\"\nmesh = \"clamp.obj\"\n");
    let quick = "--tool long.toml --orientations 0,0";
    let refuse = |more: &str, expected: &[&str]| {
        folder.refuse(&arguments(&format!("{quick} {more}")), expected);
    };
    let none = arguments(&format!("{quick} --limits ac:60:90:0:360"));
    folder.refuse_input(&none, &["none of its 1 orientations", "ac:60:90:0:360"]);
    refuse("--fixture vice.obj", &["vice.obj", "no mesh file"]);
    refuse("--stock bar.obj", &["bar.obj"]);
    refuse("--setups --fixture clamp.obj", &["belongs to one set-up", "--limits"]);
    refuse("--tool absent.toml", &["absent.toml"]);
    refuse("--memory 1KiB", &["larger --pitch"]);
    // First what most of it is for.
    let many = arguments("--tool long.toml --orientations fibonacci:1000000 --memory 1KiB");
    folder.refuse(&many, &["use fewer --orientations or"]);
}

#[test]
fn places_that_no_asked_direction_reaches_are_decided_over_all() {
    let folder = workshop();
    let run = |directions: &str, more: &str| {
        let own = format!("--tool long.toml --orientations {directions} --certify {more}");
        folder.json(&arguments(&own))
    };
    let found = run("0,0", "");
    let any = &found["any_direction"];
    let parts = ["from_another", "from_none", "open"].map(|part| voxels(&any[part]));
    assert_eq!(parts.iter().sum::<usize>(), voxels(&found["inaccessible"]), "{any}");
    // From above alone the sides are left, and the floor of the block is reached from nowhere but below.
    assert!(parts[0] > 0 && parts[2] * 50 <= parts[0] + parts[1], "{parts:?}");
    // Many directions find no place that is proven to be out of reach.
    let many = run("fibonacci:2000", "");
    let left = ["from_another", "from_none", "open"].map(|part| voxels(&many["any_direction"][part]));
    assert!(left[1] == parts[1] && left[0] <= parts[0], "{left:?} {parts:?}");
    let classes = folder.npy::<u8>("out/any_direction.npy");
    let of = |class: u8| classes.iter().filter(|&&own| own == class).count();
    assert_eq!([of(2), of(3), of(4)], left);
    let examples = folder.text("out/any_direction.csv");
    assert_eq!(examples.lines().count(), 1 + left[0]);
    // Of a second tool what the first one cannot is asked: no less is reached.
    let both = run("0,0", "--tool short.toml");
    assert!(voxels(&both["any_direction"]["from_none"]) <= parts[1], "{both}");
    folder.write("sharp.toml", mill("sharp", 18.0).replacen('\n', "\nsharp_points = \"boundary\"\n", 1));
    let sharp = arguments("--tool sharp.toml --orientations 0,0 --certify");
    folder.imf(&sharp).refused(&["only sharp point"]);
}

#[test]
fn a_face_mill_meets_a_wall_beside_the_part_that_is_farther_than_it_is_long_and_cuts_nothing_with_its_back() {
    let folder = Workdir::new();
    folder.write("slab.obj", cuboid([0, 0, 0], [30, 30, 10], 0));
    folder.write("wall.obj", cuboid([101, -100, -20], [120, 130, 60], 0));
    let mill = "name = \"face mill\"\n[cutter]\nshape = \"flat\"\ndiameter = 80.0\nlength = 20.0\n[[holder]]\n\
                diameter = 30.0\nlength = 10.0\n";
    folder.write("face.toml", mill);
    folder.write("back.toml", mill.replace("[[holder]]", "back_cutting = true\n[[holder]]"));
    let surface = |tool: &str| {
        let run = "access slab.obj --unit mm --pitch 2 --orientations 0,0 --out out";
        folder.json(&format!("{run} --tool {tool} --fixture wall.obj"))["surface"].clone()
    };
    // Of 3,000 mm² the side towards the wall is 300, and the underside 900.
    let near = |found: &Value, expected: f64| {
        assert!((found.as_f64().unwrap() - expected).abs() < 0.004, "{found} for {expected}");
    };
    let face = surface("face.toml");
    near(&face["obstructed"], 0.1);
    near(&face["not_faced"], 0.3);
    near(&face["reached"], 0.6);
    near(&surface("back.toml")["not_faced"], 0.0);
}

#[test]
fn a_stock_that_does_not_hold_the_part_is_told() {
    let folder = workshop();
    folder.write("stock.obj", cuboid([-10, -10, 0], [10, 10, 20], 0));
    folder.write("low.obj", cuboid([-10, -10, 0], [10, 10, 16], 0));
    let of = |stock: &str| {
        let more = format!("--tool long.toml --orientations 0,0 --removable --stock {stock}");
        folder.imf(&arguments(&more)).done().stderr
    };
    let told = "of the part lies outside the stock";
    assert!(!of("stock.obj").contains(told) && !of("box:2").contains(told));
    // Of 880 voxels the upper two layers, with the slot in them.
    let (low, aside) = (of("low.obj"), of("stock.obj@translate:100,0,0"));
    assert!(low.contains("18.2 % of the part lies outside the stock 'low.obj'"), "{low}");
    assert!(aside.contains("100.0 % of the part lies outside the stock 'stock.obj'"), "{aside}");
}

#[test]
fn nothing_gets_into_a_cavity() {
    let folder = Workdir::new();
    // A block of 60 with a hollow of 40, whose faces point into it.
    let hollow = cuboid([10, 10, 10], [50, 50, 50], 8);
    let inwards = hollow.lines().map(|line| match line.strip_prefix("f ") {
        Some(face) => format!("f {}\n", face.split(' ').rev().collect::<Vec<_>>().join(" ")),
        None => format!("{line}\n"),
    });
    folder.write("void.obj", cuboid([0; 3], [60; 3], 0) + &inwards.collect::<String>());
    folder.write("powder.obj", cuboid([10; 3], [50; 3], 0));
    folder.write(
        "short.toml",
        "unit = \"mm\"\nstick_out = 10.0\ncutter = { shape = \"ball\", diameter = 6.0, length = 6.0 }\nshank = { diameter = 6.0 }\n\
         holder = [{ diameter = 10.0, length = 10.0 }]\n",
    );
    let access = "access void.obj --unit mm --pitch 2 --tool short.toml --orientations axes --removable --stock powder.obj --json --out void";
    let found = folder.imf(access).done();
    found.warns(&["close off cavities of 64000.0 mm³", "no tool gets in"]);
    found.warns(&["the stock 'powder.obj' stands beside the part, as supports do"]);
    let found = found.json();
    // All of the outside, and nothing else.
    let share = 6.0 * 3600.0 / (6.0 * 3600.0 + 6.0 * 1600.0);
    let reached = found["surface"]["reached"].as_f64().unwrap();
    assert!((reached - share).abs() < 1e-6, "{reached}");
    let lost = &found["unreached"][0];
    assert!(lost["would_help"].as_str().unwrap().contains("close it off on all sides"), "{lost}");
    assert_eq!(found["stock"]["removable"]["voxels"], 0, "{}", found["stock"]);
}

#[test]
fn what_voxels_resolve_is_said_once_in_every_answer_about_the_surface() {
    let folder = workshop();
    let said = "walls are known by points of the surfaces";
    let one = "--tool long.toml --orientations axes";
    for line in [arguments(&format!("{one} --setups")), crib_arguments(one)] {
        let run = folder.imf(&line).done();
        assert_eq!(run.stdout.matches(said).count(), 1, "{}", run.stdout);
        assert!(run.stdout.contains("exact for voxel centres; no guarantee about the mesh itself"));
        let summary = folder.read_json("out/summary.json");
        assert!(summary["resolved"].as_str().unwrap().starts_with(said), "{summary}");
    }
    // Directions that are not listed are counted, and the surface's figures do not know of contact.
    let run = folder.imf(&arguments("--tool long.toml --orientations axes --contact 0.1")).done();
    run.says(&["\n  and 1 more\n", "τ and contact are for the space and the stock below"]);
}
