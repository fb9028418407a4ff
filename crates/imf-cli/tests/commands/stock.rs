//! `imf check --stock`: what a path cuts, what touches the stock that is still there, and what is left.

use serde_json::{Value, json};

use crate::binary::{Finished, Workdir};
use crate::shapes::cuboid;

/// A block of 30 × 20 × 10 mm, its top at z = 0.
const BLOCK: &str = "v -15 -10 -10\nv 15 -10 -10\nv 15 10 -10\nv -15 10 -10\nv -15 -10 0\nv 15 -10 0\nv 15 10 0\n\
                     v -15 10 0\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
const MILL: &str = "name = \"end mill\"\nunit = \"mm\"\nstick_out = 20.0\ncutter = { shape = \"flat\", diameter = 6.0, length = 4.0 }\n\
                    shank = { diameter = 6.0 }\nholder = [{ diameter = 18.0, length = 12.0 }]\n";

fn folder(name: &str, path: &str) -> Workdir {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("mill.toml", MILL);
    folder.write(name, path);
    folder
}

fn check(folder: &Workdir, path: &str, more: &str) -> Finished {
    folder.imf(&format!("check block.obj {path} --unit mm --pitch 0.5 --tool mill.toml {more}"))
}

/// Faces the top 3 mm off a stock with as much allowance, in rows.
fn facing() -> String {
    let mut program = String::from("G21 G90\nG0 X-25. Y-12. Z20.\nG0 Z0.\n");
    for row in 0..7 {
        let (from, to) = if row % 2 == 0 { (-25, 25) } else { (25, -25) };
        let y = f64::from(row) * 4.0 - 12.0;
        program += &format!("G1 X{from}. Y{y:.1} F500\nX{to}.\n");
    }
    program + "G0 Z20.\n"
}

#[test]
fn a_facing_pass_cuts_its_volume_and_what_is_left_is_a_stock_again() {
    let folder = folder("face.nc", &facing());
    let found = check(&folder, "face.nc", "--stock box:3 --out out --json").done().json();
    assert_eq!(found["collides"], false);
    let stock = &found["stock"];
    let number = |name: &str| stock[name].as_f64().unwrap();
    // 36 × 26 × 16 mm, of which 3 mm go over the whole of it.
    assert_eq!(number("volume"), 36.0 * 26.0 * 16.0);
    assert!((number("removed") / (36.0 * 26.0 * 3.0) - 1.0).abs() < 1e-9, "{stock}");
    assert_eq!((&stock["first_touch"], &stock["first_rapid_cut"]), (&Value::Null, &Value::Null));
    assert_eq!((number("removed_of_part"), stock["rapids_are_known"].as_bool()), (0.0, Some(true)));
    // 3 mm at both sides and below.
    let left = &stock["left"];
    assert_eq!(left["volume"], 36.0 * 26.0 * 13.0 - 30.0 * 20.0 * 10.0);
    let corner = 3f64.sqrt() * 3.0;
    assert!((left["farthest"].as_f64().unwrap() - corner).abs() < 1e-9, "{left}");

    let table = folder.text("out/removed.csv");
    assert!(table.starts_with("line,tool,kind,volume,of_part\n2,,start,0,0\n"), "{table}");
    let volumes = table.lines().skip(1).map(|line| line.split(',').nth(3).unwrap().parse::<f64>().unwrap());
    assert!((volumes.sum::<f64>() - number("removed")).abs() < 1e-3);
    let files = json!(["collisions.csv", "removed.csv", "stock.vti", "stock.stl", "summary.json"]);
    let summary = folder.read_json("out/summary.json");
    assert_eq!(summary["files"], files);
    let voxels = folder.bytes("out/stock.vti");
    let head = String::from_utf8_lossy(&voxels[..1500]).into_owned();
    assert!(head.contains("stock") && head.contains("removed_by_line"), "{head}");

    // The next set-up begins with it, and has nothing to do where this one was; also where the part stands elsewhere.
    folder.write("again.nc", facing());
    for set_up in ["", "--transform rotate:0,0,1:90;translate:5,3,20"] {
        let more = format!("--stock out/stock.stl --json {set_up}");
        let again = check(&folder, "again.nc", &more).done().json();
        assert_eq!(again["stock"]["volume"], number("volume") - number("removed"), "{again}");
        assert_eq!((&again["stock"]["removed"], &again["stock"]["lines_that_cut"]), (&json!(0.0), &json!(0)));
        assert_eq!(again["stock"]["left"]["volume"], left["volume"]);
    }
}

#[test]
fn a_rapid_into_the_stock_and_a_shank_in_a_wall_are_told_with_their_lines() {
    let plunge = folder("plunge.nc", "G21 G90\nG0 X0. Y0. Z20.\nG0 Z1.\nG1 X5. F300\nG0 Z20.\n");
    let run = check(&plunge, "plunge.nc", "--stock box:3").exits(3);
    run.says(&[
        "line 3, rapid: cutter is 2 mm deep in the stock",
        "line 3 is the first that cuts it at rapid rate",
    ]);
    let found = check(&plunge, "plunge.nc", "--stock box:3 --json").json();
    assert_eq!(found["stock"]["first_rapid_cut"]["line"], 3);
    let volume = found["stock"]["first_rapid_cut"]["volume"].as_f64().unwrap();
    assert!((volume / (std::f64::consts::PI * 18.0) - 1.0).abs() < 0.08, "{volume}");

    // 6 mm deep with flutes of 4: the shank is 2 mm in, from where the tool enters.
    let slot = folder("slot.csv", "x,y,z\n-30,0,-3\n-22,0,-3\n15,0,-3\n15,0,20\n");
    let run = check(&slot, "slot.csv", "--stock box:3 --out out").exits(3);
    run.says(&[
        "line 4: shank is 2 mm deep in the stock",
        "touched first by the shank on line 4",
        "a column rapid says so",
    ]);
    let table = slot.text("out/collisions.csv");
    let depth = table.split("4,,feed,shank,stock,").nth(1).and_then(|rest| rest.split(',').next()).unwrap();
    assert!((depth.parse::<f64>().unwrap() - 2.0).abs() < 1e-6, "{table}");
    assert!(image::open(slot.path("out/worst.png")).unwrap().width() > 500);
    // In two layers it is free, though the part is cut.
    slot.write("layers.csv", "x,y,z\n-30,0,0\n25,0,0\n25,0,-3\n-30,0,-3\n");
    check(&slot, "layers.csv", "--stock box:3").exits(3);
    let layers = check(&slot, "layers.csv", "--stock box:3 --json").json();
    let against = |hit: &Value| hit["against"] == "stock";
    let lines = layers["report"]["colliding"].as_array().unwrap();
    assert!(!lines.iter().any(|line| line["collisions"].as_array().unwrap().iter().any(against)), "{layers}");
    // The slot in the part.
    let of_part = layers["stock"]["removed_of_part"].as_f64().unwrap();
    assert!((of_part - 30.0 * 6.0 * 3.0).abs() < 1e-6, "{of_part}");
}

#[test]
fn a_stock_that_cannot_be_meant_is_refused_or_told() {
    let folder = folder("free.csv", "x,y,z\n0,0,30\n");
    let refuse = |stock: &str, said: &str| {
        check(&folder, "free.csv", &format!("--stock {stock}")).exits(1).warns(&[said]);
    };
    refuse("nowhere.stl", "the stock cannot be used: nowhere.stl: there is no mesh file");
    refuse("box:100000", "choose a larger pitch");
    folder.write("small.obj", BLOCK.replace("-15", "-1").replace("15", "1"));
    refuse("small.obj", "most of the part lies outside the stock");
    folder.write("short.obj", BLOCK.replace("-15", "-12"));
    let short = check(&folder, "free.csv", "--stock short.obj").done();
    short.warns(&["of the part lie outside the stock"]);
    // A mesh does not say what of it cuts.
    folder.write("mesh.toml", "name = \"head\"\nunit = \"mm\"\nmesh = \"block.obj\"\n");
    let path = "check block.obj turned.csv --unit mm --pitch 1 --tool mesh.toml --stock box";
    folder.write("turned.csv", "x,y,z,roll\n0,0,90,0\n");
    folder.imf(path).exits(2).warns(&["does not say what of it cuts"]);
}

#[test]
fn supports_beside_the_part_are_stock_and_walls_between_the_centres_are_told() {
    // At the height of the mill's tip, through what stands on the block.
    let folder = folder("across.nc", "G21 G90\nG0 X-25. Y0. Z20.\nG0 Z2.\nG0 X25.\n");
    // Voxels of 0.5 have their centres at quarters.
    let thick = cuboid([-2, -10, 0], [2, 10, 10], 0);
    folder.write("thick.obj", thick.clone());
    let thin = cuboid([53, -100, 0], [57, 100, 100], 8);
    let tenths = |word: &str| word.parse::<f64>().map_or(word.to_owned(), |at| (at / 10.0).to_string());
    let scaled = thin.lines().map(|line| match line.starts_with('v') {
        true => line.split(' ').map(tenths).collect::<Vec<_>>().join(" ") + "\n",
        false => format!("{line}\n"),
    });
    folder.write("thin.obj", thick + &scaled.collect::<String>());
    let thick = check(&folder, "across.nc", "--stock thick.obj --json").exits(3);
    thick.warns(&["the stock 'thick.obj' stands beside the part"]);
    let found = &thick.json()["stock"];
    assert_eq!(found["volume"], 30.0 * 20.0 * 10.0 + 4.0 * 20.0 * 10.0);
    // By the 4 mm of the cutter; the shank above them crashes into the wall.
    assert_eq!(
        (&found["removed"], &found["first_touch"]["element"]),
        (&json!(4.0 * 6.0 * 4.0), &json!("shank"))
    );
    assert!(!thick.stderr.contains("between the centres"), "{}", thick.stderr);
    check(&folder, "across.nc", "--stock thin.obj").exits(3).warns(&[
        "the stock 'thin.obj'",
        "so thin that they lie between the centres of voxels of 0.5",
        "choose a smaller pitch",
    ]);
}

#[test]
fn an_open_stock_is_refused_or_warned_of() {
    let folder = folder("face.nc", &facing());
    let faces =
        |left_out: &[&str]| left_out.iter().fold(BLOCK.to_owned(), |text, face| text.replace(face, ""));
    folder.write("tube.obj", faces(&["f 5 6 7 8\n", "f 4 3 2 1\n"]));
    check(&folder, "face.nc", "--stock tube.obj").exits(1).warns(&["solid and empty cannot be told apart"]);
    folder.write("tray.obj", faces(&["f 5 6 7 8\n"]));
    check(&folder, "face.nc", "--stock tray.obj").warns(&["is open: of "]);
}

#[test]
fn what_rapids_brush_off_is_told_though_it_is_accepted() {
    let folder = folder("brush.nc", "G21 G90\nG0 X-25. Y0. Z20.\nZ0.7\nX25.\nZ20.\n");
    // Centres of the topmost voxels are 0.05 mm deep in the cutter.
    let found = check(&folder, "brush.nc", "--stock box:1 --json").done().json();
    assert_eq!(found["stock"]["first_rapid_cut"], Value::Null);
    assert_eq!(found["stock"]["removed_not_at_feed"], 32.0 * 6.0 * 0.5);
    let text = check(&folder, "brush.nc", "--stock box:1").stdout;
    assert!(text.contains("where the path begins 96.0 mm³ go"), "{text}");
}

#[test]
fn of_a_row_of_rapids_the_first_that_cuts_is_named() {
    // Line 3 takes what is accepted, line 4 goes deeper at its end, where nothing is left to take of the stock before the row.
    let folder = folder("row.nc", "G21 G90\nG0 X-25. Y0. Z20.\nZ0.7\nX25.\nZ0.3\nX-25.\nZ20.\n");
    let found = check(&folder, "row.nc", "--stock box:1 --json").exits(3).json();
    let first = &found["stock"]["first_rapid_cut"];
    assert!(first["line"] == 4 && first["volume"] == 96.0, "{first}");
    // Where the path begins in the stock, a rapid behind it is named too.
    folder.write("begin.nc", "G21 G90\nG0 X0. Y0. Z-2.\nX10.\nZ20.\n");
    let found = check(&folder, "begin.nc", "--stock box:1 --json").exits(3).json();
    let stock = &found["stock"];
    let lines = ["begins_in_stock", "first_rapid_cut"].map(|name| &stock[name]["line"]);
    assert_eq!(lines, [2, 3]);
}

#[test]
fn what_is_left_of_the_stock_is_so_by_centres_where_voxels_are_conservative_too() {
    let folder = folder("face.nc", &facing());
    let of = |more: &str| {
        let found = check(&folder, "face.nc", &format!("--stock box:3 --json {more}")).json();
        (found["stock"]["left"].clone(), found["stock"]["removed"].clone())
    };
    assert_eq!(of("--conservative --contact 0.5"), of(""));
}

#[test]
fn a_stock_that_larger_voxels_left_is_warned_of() {
    let folder = folder("face.nc", &facing());
    check(&folder, "face.nc", "--stock box:3 --out out");
    let again = |pitch: &str| {
        let usual = "check block.obj face.nc --unit mm --tool mill.toml --stock out/stock.stl";
        folder.imf(&format!("{usual} --pitch {pitch}")).stderr
    };
    assert!(again("0.4").contains("was left by voxels of 0.5, larger than those of now"), "{}", again("0.4"));
    assert!(!again("0.5").contains("was left by"));
}
