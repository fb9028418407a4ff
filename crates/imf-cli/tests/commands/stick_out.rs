//! The least stick-out, and a crib of tools, held against the surface as `imf access` finds it for each tool as it is.

use serde_json::Value;

use crate::access::{arguments, crib_arguments, mill, workshop};
use crate::binary::finish;
use crate::shapes::cuboid;

fn share(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// The walls are 20 high, and both holders are 16 wide: the foot of a wall takes its height.
#[test]
fn the_foot_of_a_wall_takes_its_height() {
    let folder = workshop();
    let run = "--tool short.toml --tool long.toml --orientations 0,0 --stickout";
    let text = folder.imf(&arguments(run)).done().stdout;
    assert!(text.contains("stick-out of short (tool 0) (set to 6.0 mm, shortest 6.0)"), "{text}");
    let summary = folder.read_json("out/summary.json");
    let rows = summary["stick_outs"].as_array().unwrap();
    let [short, long] = &rows[..] else { panic!("{rows:?}") };
    let lengths = |row: &Value| ["given", "shortest"].map(|name| share(&row[name]));
    assert_eq!((lengths(short), lengths(long)), ([6.0; 2], [18.0; 2]));
    let most = share(&short["largest"]["length"]);
    // From the middle of the lowest triangle.
    assert!(most < 20.001 && most > 19.8, "{most}");
    assert!(share(&short["largest"]["point"][2]) < 0.5, "{short}");
    assert_eq!(short["largest"]["direction"], serde_json::json!([0.0, 0.0, 1.0]));
    assert!((share(&long["largest"]["length"]) - most).abs() < 1e-6, "{long}");
    assert_eq!(long["margin"], 0.0);
    // As they are set they need no more than that where they reach, and the table says so.
    for (row, tool) in rows.iter().zip(summary["tools"].as_array().unwrap()) {
        let table = row["needed_at_most"].as_array().unwrap();
        let as_set = table.iter().find(|line| line[0] == row["given"]).unwrap();
        assert!((share(&as_set[1]) - share(&tool["surface_reached"])).abs() < 0.01, "{row} {tool}");
        assert!(table.is_sorted_by_key(|line| share(&line[1])), "{row}");
    }
    let ply = String::from_utf8_lossy(&folder.bytes("out/surface.ply")).into_owned();
    assert!(ply.contains("property float stick_out_tool_1\n"), "no stick-out by triangle");

    // No farther than the tool is long, and a tool without a holder has none.
    let fixed = mill("fixed", 6.0)
        .replace("[cutter]", "stick_out = 7.0\n[shank]\ndiameter = 3.0\nlength = 3.0\n[cutter]");
    folder.write("fixed.toml", fixed);
    let row = &folder.json(&arguments("--tool fixed.toml --orientations 0,0 --stickout"))["stick_outs"][0];
    assert_eq!((share(&row["longest"]), share(&row["shortest"])), (9.0, 6.0));
    let beyond = share(&row["beyond_the_tool"]);
    assert!(
        beyond > 0.01
            && (beyond + share(&row["at_some_length"]) - share(&short["at_some_length"])).abs() < 0.01
    );
    folder.write("bare.toml", "[cutter]\nshape = 'flat'\ndiameter = 3\nlength = 9\n");
    folder.refuse(&arguments("--tool bare.toml --stickout"), &["'bare' has no holder"]);
}

#[test]
fn a_crib_says_of_each_tool_what_the_tool_alone_does() {
    let folder = workshop();
    folder.write("crib/short.toml", mill("short", 6.0));
    folder.write("crib/long.toml", mill("long", 18.0));
    folder.write("crib/thick.toml", mill("thick", 18.0).replace("3.0", "9.0"));
    folder.write("crib/thin.toml", mill("thin", 6.0).replace("3.0", "0.5"));
    let holder = r#"{"unit": "millimeters", "segments": [{"height": 20, "lower-diameter": 16, "upper-diameter": 16}]}"#;
    let entry = |kind: &str, name: &str| {
        format!(
            r#"{{"type": "{kind}", "description": "{name}", "unit": "millimeters", "holder": {holder},
                "geometry": {{"DC": 6, "LCF": 12, "LB": 25, "OAL": 50, "SFDM": 6}}}}"#
        )
    };
    let library =
        [entry("flat end mill", "from a library"), entry("lollipop mill", "lollipop"), entry("holder", "h")];
    folder.write("crib/library.json", format!(r#"{{"data": [{}]}}"#, library.join(",")));
    folder.write("crib/broken.toml", "name = 'broken'\n[cutter]\nshape = 'cube'\n");
    let crib = crib_arguments("--tool crib --orientations fibonacci:30");
    let summary = folder.json(&crib);
    let names: Vec<&str> =
        summary["tools"].as_array().unwrap().iter().map(|t| t["tool"].as_str().unwrap()).collect();
    assert_eq!(names, ["from a library", "long", "short", "thick"]);
    let undecided = summary["undecided"].to_string();
    assert!(undecided.contains("lollipop") && undecided.contains("unseen"), "{undecided}");
    assert!(undecided.contains("broken.toml") && undecided.contains("line 3: "), "{undecided}");
    for file in ["broken.toml", "library.json"] {
        assert_eq!(undecided.matches(file).count(), 1, "{undecided}");
    }
    let alone = crib_arguments("--tool crib/broken.toml --orientations fibonacci:30");
    folder.imf(&alone).refused(&["broken.toml, line 3"]);
    assert_eq!(folder.text("out/crib.csv").lines().count(), 5);
    let ply = String::from_utf8_lossy(&folder.bytes("out/surface.ply")).into_owned();
    assert!(ply.contains("property float most_rigid\n") && ply.contains("property float chosen\n"));
    for tool in summary["tools"].as_array().unwrap() {
        let file = match tool["tool"].as_str().unwrap() {
            "from a library" => "crib/library.json#from a library".to_owned(),
            name => format!("crib/{name}.toml"),
        };
        // The name has blanks.
        let mut command = folder.command(&arguments("--orientations fibonacci:30 --json"));
        let alone = finish("access --tool", command.args(["--tool", &file])).done().json();
        for name in ["reached", "obstructed", "gouged", "not_faced"] {
            assert!((share(&tool[name]) - share(&alone["surface"][name])).abs() < 1e-12, "{name}: {tool}");
        }
    }
    // Nothing else gets to the floor of the slot, and what it leaves is not for the thick one either.
    let fewest: Vec<String> = serde_json::from_value(summary["fewest"].clone()).unwrap();
    assert!(fewest.contains(&"long".to_owned()) && summary["proven"] == true, "{fewest:?}");
    let parts = ["reached", "obstructed", "gouged", "not_faced"].map(|name| share(&summary[name]));
    assert!((parts.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{parts:?}");
    assert!((share(&summary["reached_by_the_fewest"]) - parts[0]).abs() < 1e-9);
    let rigid: f64 = summary["tools"].as_array().unwrap().iter().map(|tool| share(&tool["most_rigid"])).sum();
    assert!((rigid - parts[0]).abs() < 1e-9, "{rigid}");
    let text = folder.imf(&crib).done().stdout;
    assert!(text.contains("the fewest tools") && text.contains("not decided: 3"), "{text}");

    folder.write("none/readme.txt", "");
    folder.refuse(&crib_arguments("--tool none"), &["none holds no tool"]);
    folder.refuse(&crib_arguments("--tool absent.toml"), &["absent.toml"]);
}

#[test]
fn a_crib_says_of_its_tools_what_access_does() {
    let folder = workshop();
    let bare = |name: &str, length: f64| {
        format!("name = '{name}'\n[cutter]\nshape = 'flat'\ndiameter = 3\nlength = {length}\n")
    };
    folder.write("bare.toml", bare("bare", 40.0));
    folder.write("crib/a.toml", mill("same", 40.0));
    folder.write("crib/b.toml", mill("same", 18.0));
    folder.write("crib/c.toml", mill("same (2)", 6.0));
    let crib = crib_arguments("--tool crib --tool bare.toml --orientations axes");
    let run = folder.imf(&crib).done();
    assert!(run.stderr.contains("bare has no holder: what holds it is not seen"), "{}", run.stderr);
    assert!(run.stdout.contains(" no holder             –"), "{}", run.stdout);
    let tools = folder.read_json("out/summary.json")["tools"].clone();
    let of = |name: &str| tools.as_array().unwrap().iter().map(|tool| tool[name].clone()).collect::<Vec<_>>();
    assert_eq!(of("tool"), ["same", "same (2)", "same (2) (2)", "bare"]);
    assert_eq!(of("file"), ["crib/a.toml", "crib/b.toml", "crib/c.toml", "bare.toml"]);
    assert_eq!((&of("stick_out")[3], &of("rigidity")[3]), (&Value::Null, &Value::Null));
    // A neck is what bends.
    folder.write("neck.toml", mill("neck", 18.0) + "[shank]\ndiameter = 2.9\nlength = 15.0\n");
    let row = &folder.json(&crib_arguments("--tool neck.toml --orientations axes"))["tools"][0];
    assert!((share(&row["rigidity"]) - 2.9 / 33.0).abs() < 1e-9, "{row}");
    // More of them are counted.
    (0..5).for_each(|index| folder.write(&format!("many/{index}.toml"), bare(&index.to_string(), 9.0)));
    let run = folder.imf(&crib_arguments("--tool many --orientations axes")).done();
    assert!(
        run.stderr.contains("5 of 5 tools have no holder, such as 0: what holds them is not seen"),
        "{}",
        run.stderr
    );
    // The unit that is assumed of a part hardly fits to any tool.
    folder.write("tiny.obj", cuboid([0, 0, 0], [2, 2, 2], 0));
    let tiny = "crib tiny.obj --tool crib --out out";
    folder.refuse(tiny, &["does not say its unit", "--unit"]);
}

#[test]
fn of_tools_that_do_as_well_the_most_rigid_is_chosen_in_whatever_order_they_are_given() {
    let folder = workshop();
    folder.write("stiff.toml", mill("stiff", 18.0));
    folder.write("weak.toml", mill("weak", 40.0));
    for tools in ["--tool weak.toml --tool stiff.toml", "--tool stiff.toml --tool weak.toml"] {
        let found = folder.json(&crib_arguments(&format!("{tools} --orientations axes")));
        let chosen = found["tools"].as_array().unwrap().iter().filter(|tool| !tool["chosen"].is_null());
        let names: Vec<&str> = chosen.map(|tool| tool["tool"].as_str().unwrap()).collect();
        assert_eq!(names, ["stiff"], "{found}");
    }
}

/// The slot is 20 deep: a holder of 16 that goes along it on its floor stays above the walls.
#[test]
fn a_path_has_one_least_stick_out_and_the_line_that_decides_it() {
    let folder = workshop();
    let summary = folder.json(&arguments("--tool short.toml --orientations 0,0"));
    // Places that are obstructed take the walls' height, and the answer says so.
    let patches = summary["unreached"].as_array().unwrap();
    let obstructed = patches.iter().find(|patch| patch["why"] == "something is in the way").unwrap();
    // With the reserve of an edge between points that are half a pitch apart, to a tenth.
    let length = share(&obstructed["stick_out"]["length"]) - 0.72;
    assert!(length > 19.0 && length < 20.101, "{obstructed}");
    let helps = obstructed["would_help"].as_str().unwrap();
    assert!(helps.contains("instead of 6.0 frees"), "{helps}");
    let hit = &obstructed["hits"][0];
    assert!(hit["body"] == "part" && share(&hit["depth"]) > 0.0 && share(&hit["volume"]) >= 0.0, "{hit}");

    let [x, y, z] = [0, 1, 2].map(|axis| share(&obstructed["middle"][axis]));
    // The tip stands beside the wall, clear of it, and goes up.
    let normal = [0, 1].map(|axis| share(&obstructed["normal"][axis]));
    let [x, y] = [x + 3.5 * normal[0], y + 3.5 * normal[1]];
    let path = format!("x,y,z\n{x},{y},60\n{x},{y},{}\n{x},{y},40\n", z.max(1.0) + 1.0);
    folder.write("path.csv", &path);
    let check = |tool: &str| {
        folder.imf(&format!("check part.obj path.csv --pitch 2 --unit mm --stickout --tool {tool}"))
    };
    let run = check("short.toml");
    run.says(&[
        "stick-out of short (set to 6.0 mm, shortest 6.0): the whole path takes ",
        ", decided by line 3; as it is set: ",
    ]);
    folder.write("bare.toml", "[cutter]\nshape = 'flat'\ndiameter = 3\nlength = 9\n");
    check("bare.toml").bad_input(&["'bare' has no holder"]);
}

#[test]
fn what_is_in_the_way_is_said_alike_in_whatever_order_the_tools_are_given() {
    let folder = workshop();
    let of = |first: &str, second: &str| {
        let run = format!("--tool {first}.toml --tool {second}.toml --orientations 0,0");
        let found = folder.json(&arguments(&run));
        let rows = found["surface"]["obstructed_by"].as_array().unwrap().clone();
        let patches = found["unreached"].as_array().unwrap().clone();
        // The number behind a name is its place; what no direction faces has none.
        let mut named = rows.iter().chain(&patches).filter_map(|row| row["tool"].as_str());
        assert!(named.all(|tool| tool.starts_with("long (tool ")), "{rows:?} {patches:?}");
        rows.iter().map(|row| (row["element"].clone(), row["fraction"].clone())).collect::<Vec<_>>()
    };
    let rows = of("short", "long");
    assert!(!rows.is_empty() && rows == of("long", "short"), "{rows:?}");
}
