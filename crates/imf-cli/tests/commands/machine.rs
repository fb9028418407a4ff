//! `imf check` with G-code and machines, the examples that come along among them.

use serde_json::Value;

use crate::binary::{Finished, Workdir};
use crate::shapes::cuboid;

const EXAMPLES: [(&str, &str); 3] = [
    ("trunnion.toml", include_str!("../../../../docs/guide/machines/trunnion-ac.toml")),
    ("head.toml", include_str!("../../../../docs/guide/machines/head-b-table-c.toml")),
    ("vise.toml", include_str!("../../../../docs/guide/machines/tilting-vise.toml")),
];

/// A block of 60 × 60 × 30 mm, its bottom's middle in the origin, and the example machines, in a fresh folder.
fn workshop() -> Workdir {
    let folder = Workdir::new();
    folder.write("block.obj", cuboid([-30, -30, 0], [30, 30, 30], 0));
    EXAMPLES.iter().for_each(|(name, text)| folder.write(name, text));
    folder
}

fn check(path: (&str, &str), more: &str) -> Finished {
    let folder = workshop();
    folder.write(path.0, path.1);
    folder.imf(&format!("check block.obj {} --pitch 1 --tool paper {more}", path.0))
}

/// Element and body of every hit, by line.
fn hits(run: &Finished) -> Vec<(u64, String, String)> {
    let mut found = vec![];
    for line in run.json()["report"]["colliding"].as_array().unwrap() {
        for hit in line["collisions"].as_array().unwrap() {
            let body = hit["against"]["machine"].as_str().unwrap_or("part").to_owned();
            found.push((line["line"].as_u64().unwrap(), hit["element"].as_str().unwrap().to_owned(), body));
        }
    }
    found
}

#[test]
fn rapids_and_arcs_of_a_program_are_told_by_their_lines() {
    let program = "G21 G90 G0 X-50. Y0. Z40.\nX-49. Z28.\nG1 X50. F900\n";
    let run = check(("top.nc", program), "--json").exits(3);
    assert_eq!(hits(&run), [(3, "cutter".to_owned(), "part".to_owned())]);
    run.warns(&["line 2: G0 is followed straight"]);
    // An arc is one line, however many chords it has.
    let arc = check(("arc.nc", "G21 G90 G0 X0. Y-20. Z28.\nG3 X0. Y-20. I0. J20. F900\n"), "--json");
    assert_eq!(hits(&arc).iter().map(|(line, ..)| *line).collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn what_a_program_does_not_say_is_refused_with_line_and_remedy() {
    check(("part.nc", "G0 X0. Y0. Z40. A30.\n"), "").bad_input(&[
        "part.nc, line 1: A30. turns a rotary axis",
        "no machine is given",
        "--machine FILE",
    ]);
    let kept = "G21 G90 T1 M6\nG43.4 H1 X0. Y0. Z100.\n";
    check(("part.nc", kept), "").bad_input(&["part.nc, line 2", "no machine is given", "--machine FILE"]);
    let tilted = "G21 G90 T1 M6\nG0 B40. C0.\nG43 H1 X0. Y0. Z200.\n";
    check(("part.nc", tilted), "--machine head.toml --stickout")
        .bad_input(&["part.nc: line 3: the head is tilted"]);
    check(("path.csv", "x,y,z\n0,0,40\n"), "--machine none.toml")
        .refused(&["none.toml: there is no machine file"]);
}

#[test]
fn a_holder_that_meets_the_platter_is_told_by_word_and_by_column() {
    let program =
        "G21 G90 T1 M6\nG0 A0. C0.\nG43.4 H1 X0. Y0. Z100.\nG0 A-90. X0. Y-100. Z10.\nG1 Y-31. F400\n";
    let run = check(("side.nc", program), "--machine trunnion.toml --json").exits(3);
    assert_eq!(hits(&run), [(5, "holder 1".to_owned(), "platter".to_owned())]);
    let table = "x,y,z,A,C\n0,0,100,0,0\n0,-100,10,-90,0\n0,-31,10,-90,0\n";
    let run = check(("side.csv", table), "--machine trunnion.toml --json");
    assert_eq!(hits(&run), [(4, "holder 1".to_owned(), "platter".to_owned())]);
    // Without the platter it is free, and by directions the same angles are found.
    check(("side.csv", "x,y,z,i,j,k\n0,-100,10,0,-1,0\n0,-31,10,0,-1,0\n"), "").done();
    let run = check(
        ("side.csv", "x,y,z,i,j,k\n0,-100,10,0,-1,0\n0,-31,10,0,-1,0\n"),
        "--machine trunnion.toml --json",
    );
    assert_eq!(hits(&run), [(3, "holder 1".to_owned(), "platter".to_owned())]);
    run.warns(&["line 2: the file says directions"]);
}

#[test]
fn a_part_stands_on_the_machine_where_it_is_set_up() {
    let program = "G21 G90 T1 M6\nG0 A0. C0.\nG43.4 H1 X0. Y0. Z100.\nZ60.\n";
    let run = |more: &str| check(("top.nc", program), &format!("--machine trunnion.toml {more}"));
    run("").done();
    let up = "--transform translate:0,0,40";
    let found = run(&format!("{up} --json"));
    assert_eq!(hits(&found), [(4, "cutter".to_owned(), "part".to_owned())]);
    found.says(&["\"frame\": \"world\""]);
    run(&format!("{up} --frame part")).refused(&["coordinates of G54"]);
    // Ten lower its foot is in the platter.
    let low = run("--transform translate:0,0,-10");
    low.warns(&["warning: the part stands 10 mm deep in the machine's platter"]);
}

#[test]
fn a_part_that_swings_into_a_column_is_told() {
    let folder = workshop();
    let column = "\n[[solid]]\nname = \"column\"\non = \"table\"\nbox = { lower = [-60, 30, -420], upper = [60, 90, -380] }\n";
    folder.write("column.toml", &(EXAMPLES[0].1.to_owned() + column));
    folder.write("swing.csv", "x,y,z,A,C\n0,0,100,0,0\n0,0,100,-60,0\n0,0,100,-90,0\n");
    let run = folder
        .imf("check block.obj swing.csv --unit mm --pitch 2 --tool paper --machine column.toml --json")
        .exits(3);
    let found = hits(&run);
    assert!(found.contains(&(4, "part".to_owned(), "column".to_owned())), "{found:?}");
    assert!(found.iter().all(|(line, ..)| *line > 2), "{found:?}");
}

#[test]
fn every_example_cuts_the_top_and_tells_what_its_head_meets() {
    for (name, letters) in [("trunnion.toml", "A0. C0."), ("head.toml", "B0. C0."), ("vise.toml", "B0. C0.")]
    {
        let start = format!("G21 G90 T1 M6\nG0 {letters}\nG43.4 H1 X-50. Y0. Z60.\n");
        let top = format!("{start}Z30.\nG1 X50. F900\nC90.\nX-50.\n");
        let run = check(("top.nc", &top), &format!("--machine {name}")).done();
        run.says(&["no collision, no axis out of its travel: 5 lines"]);
        // Down beside the block until the spindle's face is below its top.
        let run = check(
            ("deep.nc", &format!("{start}X-40. Z60.\nG1 Z-60. F900\n")),
            &format!("--machine {name} --json"),
        );
        let found = hits(&run);
        assert!(found.iter().any(|(_, element, _)| element.starts_with("spindle")), "{name}: {found:?}");
    }
}

/// The holder beside the platter that lies back: where all axes stand, drawn from three sides, and as bodies in the page.
#[test]
fn a_collision_with_the_machine_is_told_with_its_joints_drawn_and_shown() {
    let folder = workshop();
    folder.write("side.csv", "x,y,z,A,C\n0,0,100,0,0\n0,-100,10,-90,0\n0,-31,10,-90,0\n");
    let check = "check block.obj side.csv --pitch 1 --tool paper --machine trunnion.toml";
    let run = folder.imf(&format!("{check} --out out --html page.html --json")).exits(3);
    let answer = run.json();
    let hit = &answer["report"]["colliding"][0]["collisions"][0];
    assert_eq!(hit["joints"]["rotary"], serde_json::json!([-90.0, 0.0]), "{hit}");
    // The platter's colour, and that of the holder in it, in the middle of the panels.
    let picture = image::open(folder.path("out/worst.png")).unwrap().to_rgb8();
    assert!(picture.width() > 500);
    let data = page_data(&folder);
    let bodies = data["layers"][0]["classes"].as_array().unwrap();
    let names: Vec<&str> = bodies.iter().map(|body| body["name"].as_str().unwrap()).collect();
    let hidden: Vec<&str> = data["layers"][0]["hidden"]
        .as_array()
        .unwrap()
        .iter()
        .map(|at| names[at.as_u64().unwrap() as usize])
        .collect();
    assert!(names.contains(&"machine's platter") && !hidden.contains(&"machine's platter"), "{names:?}");
    assert!(hidden.contains(&"machine's bed"), "{hidden:?}");
    // The part and the place are looked at: the machine's bed alone is 600 long.
    let radius = data["radius"].as_f64().unwrap();
    assert!(radius > 43.0 && radius < 80.0, "{radius}");
}

/// What a page shows.
fn page_data(folder: &Workdir) -> Value {
    let page = folder.text("page.html");
    let data = page.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap();
    serde_json::from_str(data).unwrap()
}

/// About the A axis the tip goes along a half circle over the block, not straight through it.
#[test]
fn a_tip_that_swings_is_drawn_as_it_swings() {
    let folder = workshop();
    folder.write("swing.nc", "G21 G90 T1 M6\nG0 A-90. C0.\nG43 H1 X0. Y0. Z40.\nG1 A20. F100.\n");
    folder
        .imf("check block.obj swing.nc --pitch 2 --tool paper --machine trunnion.toml --html page.html")
        .exits(3);
    let points = |data: &Value| data["paths"][0]["points"].as_str().unwrap().len();
    // Two points of three numbers for each three degrees, four letters for three bytes.
    assert!(points(&page_data(&folder)) >= 36 * 2 * 16, "{}", points(&page_data(&folder)));
}

#[test]
fn travel_is_told_with_line_axis_value_and_range() {
    let program = "G21 G90 T1 M6\nG0 A0. C0.\nG43.4 H1 X0. Y0. Z100.\nX260. Z150.\nX0.\nA31.\n";
    let run = check(("far.nc", program), "--machine trunnion.toml").exits(3);
    run.says(&[
        "line 4: X would have to be at 25",
        "goes from -250 mm to 250 mm",
        "line 6: A would have to be at 3",
        "from -110° to 30°",
    ]);
    run.says(&["no collision, 3 lines lead out of the machine's travel"]);
    // An axis that turns while the others stand leaves its range where it does, not where it ends.
    let alone = "G21 G90 T1 M6\nG0 A0. C0.\nG43 H1 X0. Y0. Z100.\nG1 A50. F500\n";
    let run = check(("turn.nc", alone), "--machine trunnion.toml --json");
    let answer = run.json();
    let fault = &answer["report"]["out_of_travel"][0];
    let [value, farthest] = ["value", "farthest"].map(|name| fault[name].as_f64().unwrap());
    assert!(value > 30.0 && value < 30.2 && farthest == 50.0, "{fault}");
    let run = check(("far.nc", program), "--machine trunnion.toml --json");
    let answer = run.json();
    assert_eq!((run.code, &answer["passes"], &answer["collides"]), (Some(3), &false.into(), &false.into()));
    // Of many lines the first, and the farthest of the axis, line 124.
    let place = |n: u32| format!("X{}. Z{}.\n", if n == 120 { 270 } else { 260 }, 150 - n % 2);
    let folder = workshop();
    let begins: String = program.split_inclusive('\n').take(3).collect();
    folder.write("many.nc", begins + &(0..150).map(place).collect::<String>());
    let asked = "check block.obj many.nc --pitch 1 --tool paper --machine trunnion.toml --out out";
    let said = "… and 49 more ways out of the travel: the first 100 and the farthest of each axis";
    folder.imf(asked).exits(3).says(&[
        said,
        "all 150 are in out/travel.csv",
        "line 124: X would have to be at",
    ]);
    let (summary, table) = (folder.read_json("out/summary.json"), folder.text("out/travel.csv"));
    assert_eq!(summary["travel_faults"], 150);
    assert_eq!(summary["files"], serde_json::json!(["collisions.csv", "travel.csv", "summary.json"]));
    assert!(table.starts_with("line,axis,value,farthest,low,high,fraction\n4,X,25"), "{table}");
    assert_eq!(
        (table.lines().count(), table.lines().filter(|line| line.contains(",X,")).count()),
        (151, 150)
    );
}

#[test]
fn access_looks_from_where_the_machine_turns_to_and_names_its_angles() {
    let folder = workshop();
    let usual = "access block.obj --unit mm --pitch 6 --tool paper --orientations axes";
    let run = |more: &str| folder.json(&format!("{usual} {more}"));
    let found = run("--machine trunnion.toml --out reach");
    // A tilts to −110° and 30°: everything but from below.
    assert_eq!(found["orientation_count"], 5);
    let rows = folder.text("reach/rotary_angles.csv");
    let rows: Vec<&str> = rows.lines().collect();
    assert_eq!(rows[0], "orientation,i,j,k,A,C");
    // From above C is free; to the side A lies back, and C brings the side up.
    assert!(rows[1].starts_with("0,0,0,1,0,") && rows[1].ends_with(','), "{}", rows[1]);
    assert!(rows[2..].iter().all(|row| row.split(',').nth(4) == Some("-90")), "{rows:?}");
    // In a set-up the same angles are the machine's own.
    let found = run("--machine trunnion.toml --setups --out setups");
    let setups = &found["setups"];
    assert_eq!(setups["machine"], "trunnion A/C");
    for setup in setups["setups"].as_array().unwrap() {
        let axis = &setup["rotary"][0];
        let range: Vec<f64> = axis["range"].as_array().unwrap().iter().map(|a| a.as_f64().unwrap()).collect();
        assert!(
            axis["axis"] == "A" && -110.0 <= range[0] && range[0] <= range[1] && range[1] <= 30.0,
            "{axis}"
        );
    }
    // Where travel leaves one of two branches, its angles are told: a tilted cradle has the part on one side of the A axis.
    let trunnion = EXAMPLES.iter().find(|(name, _)| *name == "trunnion.toml").unwrap().1;
    for (travel, side) in [("[-200, -10]", 1.0), ("[10, 200]", -1.0)] {
        let text = trunnion.replace("y = [-200, 200]", &format!("y = {travel}"));
        folder.write("half.toml", text.replace("range = [-110, 30]", "range = [-110, 110]"));
        // From four sides, all of them oblique.
        let sides = usual.replace("axes", "0,45+90,45+180,45+270,45");
        let found = folder.json(&format!("{sides} --machine half.toml --setups --out half"));
        let angles = found["setups"]["setups"].as_array().unwrap().iter().flat_map(|setup| {
            let range = setup["rotary"][0]["range"].as_array().unwrap();
            range.iter().map(|angle| angle.as_f64().unwrap().round()).collect::<Vec<_>>()
        });
        let angles: Vec<f64> = angles.collect();
        assert!(angles.iter().any(|angle| angle * side > 0.0), "{angles:?}");
        assert!(angles.iter().all(|angle| angle * side >= 0.0), "{angles:?}");
    }
}

#[test]
fn set_ups_reach_what_the_machine_reaches_with_the_part_placed_so() {
    let folder = workshop();
    folder.write("short.toml", "travel = { x = [-10, 10] }\n[offsets]\nG54 = [0, 0, 0]\n");
    let usual = "access block.obj --unit mm --pitch 4 --tool paper --orientations axes --out out";
    let share = |value: &Value| value.as_f64().unwrap();
    for (machine, count) in [("trunnion.toml", 2), ("short.toml", 6)] {
        let machine = format!("--machine {machine}");
        let found = folder.json(&format!("{usual} {machine} --setups"))["setups"].clone();
        let chosen = found["setups"].as_array().unwrap();
        assert_eq!((chosen.len(), &found["proven"]), (count, &Value::Bool(true)), "{found}");
        for setup in chosen {
            let placed = setup["transform"].as_str().unwrap().replace(' ', "");
            let alone = folder.json(&format!("{usual} {machine} --transform {placed}"));
            let [one, other] = [&setup["reached"], &alone["surface"]["reached"]].map(share);
            assert!((one - other).abs() < 0.005, "{one} {other} {setup}");
        }
        let left = &found["left"];
        let kept = share(&left["kept_away_by_the_machine"]);
        // Each set-up of the short one reaches a band of 20 mm at most, lengthwise or across.
        let expected = if count == 2 { 0.0 } else { 1.0 - share(&found["reachable"]) };
        assert!((kept - expected).abs() < 1e-6 && share(&left["obstructed"]) == 0.0, "{left}");
    }
}

#[test]
fn access_counts_only_poses_to_which_the_machine_brings_the_tool() {
    let folder = workshop();
    folder.write("short.toml", "travel = { x = [-10, 10] }\n[offsets]\nG54 = [0, 0, 0]\n");
    let usual = "access block.obj --unit mm --pitch 2 --tool paper --orientations axes";
    let run = |more: &str| {
        let found = folder.json(&format!("{usual} {more}"));
        let rows = found["surface"]["obstructed_by"].as_array().unwrap().clone();
        let of_machine =
            rows.iter().find(|row| row["element"] == "machine").map(|row| row["fraction"].clone());
        let help =
            found["unreached"].as_array().into_iter().flatten().map(|patch| patch["fault"].to_string());
        let share = |value: &Value| value.as_f64().unwrap();
        (share(&found["surface"]["reached"]), of_machine.map_or(0.0, |v| share(&v)), help.collect::<String>())
    };
    // From the side the ball touches the bottom as well.
    let (reached, of_machine, _) = run("--limits ac:-110:30:-360:360 --out alone");
    assert!((reached - 1.0).abs() < 0.01 && of_machine == 0.0, "{reached} {of_machine}");
    // On the platter the bottom is not reached, a quarter of the surface, nor is the foot of its sides: the tip stays above the platter,
    // whose uppermost centres lie half a voxel below its top, and the lowest contact is a radius of 5 above the tip. From the side
    // the holder keeps the tool farther off.
    let (reached, of_machine, hits) = run("--machine trunnion.toml --out trunnion");
    let strip = 4.0 * 60.0 * (5.0 - 1.0) / 14_400.0;
    assert!((reached - 0.75 + strip).abs() < 0.02, "{reached}");
    assert!(of_machine > strip, "{of_machine}");
    assert!(hits.contains("hits the machine's platter"), "{hits}");
    // With 20 mm of travel a third of the top and of two sides.
    let (reached, of_machine, hits) = run("--machine short.toml --out short");
    assert!((reached - 2_400.0 / 14_400.0).abs() < 0.02, "{reached}");
    assert!(of_machine > 0.3 && hits.contains("the machine's X would have to be at"), "{of_machine} {hits}");
    // A crib is its tools, here too.
    let crib = usual.replace("access", "crib");
    let found = folder.json(&format!("{crib} --machine trunnion.toml --out crib"));
    assert!((found["reached"].as_f64().unwrap() - 0.75 + strip).abs() < 0.02, "{found}");
    // A part that is sunk into the platter stands there by mistake.
    for command in [usual, &crib] {
        let sunk = format!("{command} --machine trunnion.toml --transform translate:0,0,-12 --out sunk");
        let run = folder.imf(&sunk).done();
        assert!(run.stderr.contains("deep in the machine's platter: check where G54 is"), "{}", run.stderr);
        assert!(run.stderr.contains("stands in the frame of G54"), "{}", run.stderr);
    }
}

#[test]
fn a_remedy_at_a_machine_leads_to_where_the_axis_may_stand() {
    let folder = workshop();
    for (range, helps) in [("-500, -400", "a shorter tool"), ("400, 500", "a longer tool")] {
        folder.write("z.toml", format!("travel = {{ z = [{range}] }}\n[offsets]\nG54 = [0, 0, 0]\n"));
        let usual = "access block.obj --unit mm --pitch 2 --tool paper --orientations 0,0 --machine z.toml";
        let found = folder.json(&format!("{usual} --out out"));
        let patch = &found["unreached"][0];
        assert!(patch["fault"].as_str().unwrap().contains("the machine's Z would have to be at"), "{patch}");
        assert!(patch["would_help"].as_str().unwrap().contains(helps), "{patch}");
    }
    let usual = "access block.obj --unit mm --pitch 2 --tool paper --orientations axes";
    let found = folder.json(&format!("{usual} --machine trunnion.toml --out out"));
    let patches = found["unreached"].as_array().unwrap();
    let at = |fault: &str| patches.iter().find(|patch| patch["fault"].to_string().contains(fault)).cloned();
    let patch = at("the cutter hits the machine's platter").unwrap_or_else(|| panic!("{patches:?}"));
    assert!(patch["would_help"].as_str().unwrap().contains("another set-up"), "{patch}");
}
