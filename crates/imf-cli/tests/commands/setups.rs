//! `imf access --setups`: the fewest set-ups, of the surface and of a stock, and those of machines with fixed axes.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use serde_json::Value;

use crate::access::{arguments, mill, workshop};
use crate::binary::Workdir;
use crate::shapes::cuboid;

const SET_UPS: &str = "--tool long.toml --orientations axes+normals+fibonacci:40 --setups";

/// The slot is open at the top and at both ends: on three axes one set-up leaves the face that it stands on, two do not.
#[test]
fn the_fewest_set_ups_are_proven_and_fewer_do_for_less() {
    let folder = workshop();
    let set_ups = |more: &str| {
        let summary = folder.json(&arguments(&format!("{SET_UPS} {more}")));
        let row = summary["setups"].clone();
        let share = |name: &str| row[name].as_f64().unwrap();
        let surface = summary["surface"]["reached"].as_f64().unwrap();
        assert!(
            share("reached") <= share("reachable") + 1e-9 && share("reachable") <= surface + 1e-9,
            "{row}"
        );
        assert_eq!(row["proven"], true);
        let chosen = row["setups"].as_array().unwrap();
        let alone: f64 = chosen.iter().map(|setup| setup["alone"].as_f64().unwrap()).sum();
        assert!(alone <= share("reached") + 1e-9, "{row}");
        let largest = chosen.iter().map(|setup| setup["reached"].as_f64().unwrap()).fold(0.0, f64::max);
        (chosen.len(), share("reached") / share("reachable"), largest / share("reachable"))
    };
    let (all, covered, best) = set_ups("");
    assert!(all >= 2 && (covered - 1.0).abs() < 1e-9, "{all} {covered}");
    let ply = String::from_utf8_lossy(&folder.bytes("out/surface.ply")).into_owned();
    assert!(ply.contains("property float setup\n"), "no set-up by triangle");
    let asked = (100.0 * best - 0.5).to_string();
    let (fewer, covered, _) = set_ups(&format!("--cover {asked}"));
    assert!(fewer == 1 && covered >= 0.01 * (100.0 * best - 0.5), "{fewer} {covered}");
}

/// A block of 40 × 40 × 20 in a stock of 10 more all around: from above a long mill removes all but what lies below the block.
#[test]
fn set_ups_for_a_stock_remove_it_too() {
    let folder = Workdir::new();
    folder.write("block.obj", cuboid([0, 0, 0], [40, 40, 20], 0));
    folder.write("mill.toml", mill("mill", 60.0));
    let usual =
        "access block.obj --unit mm --pitch 2 --tool mill.toml --orientations axes --setups --out out";
    let run = |more: &str| folder.json(&format!("{usual} {more}"))["setups"].clone();
    let (surface, both) = (run(""), run("--stock box:10"));
    assert!(surface["stock"].is_null() && surface["setups"].as_array().unwrap().len() == 2);
    let share = |value: &Value| value.as_f64().unwrap();
    let chosen = both["setups"].as_array().unwrap();
    assert_eq!((chosen.len(), &both["proven"]), (2, &Value::Bool(true)), "{both}");
    let stock = 60.0 * 60.0 * 40.0 - 40.0 * 40.0 * 20.0;
    for setup in chosen {
        let up = setup["up"][2].as_f64().unwrap().abs();
        let below = if up == 1.0 { 40.0 * 40.0 * 10.0 } else { 40.0 * 20.0 * 10.0 };
        let removed = share(&setup["removed"]);
        assert!((removed - (1.0 - below / stock)).abs() < 0.02, "{setup}");
    }
    assert!(share(&both["stock"]["removed"]) > 0.999, "{both}");
    // What may stay is counted of surface and stock together.
    let one = run("--stock box:10 --cover 75");
    assert_eq!(one["setups"].as_array().unwrap().len(), 1, "{one}");
}

/// A table that turns a quarter reaches the slot's ends where the part is turned for it, and says by how much.
#[test]
fn a_part_is_turned_to_what_the_rotary_axes_reach() {
    let folder = workshop();
    let set_ups = |range: &str| folder.json(&arguments(&format!("{SET_UPS} {range}")))["setups"].clone();
    let (whole, quarter) = (set_ups("ac:0:90:0:360"), set_ups("ac:0:90:20:110"));
    assert!(quarter["candidates"].as_u64() > whole["candidates"].as_u64(), "{quarter}");
    assert!(quarter["setups"].as_array().unwrap().len() >= whole["setups"].as_array().unwrap().len());
    for (row, turns) in [(&whole, [0.0, 360.0]), (&quarter, [20.0, 110.0])] {
        assert_eq!(row["proven"], true);
        for setup in row["setups"].as_array().unwrap() {
            assert!(setup["transform"].as_str().unwrap().starts_with("rotate:"), "{setup}");
            let rotary = &setup["rotary"];
            for (at, axis, [low, high]) in [(0, "A", [0.0, 90.0]), (1, "C", turns)] {
                assert_eq!(rotary[at]["axis"], axis);
                let end = |which: usize| rotary[at]["range"][which].as_f64().unwrap();
                assert!(low <= end(0) && end(0) <= end(1) && end(1) <= high, "{rotary}");
            }
        }
    }
}

/// A cylinder of ⌀24 × 16 with a blind hole of ⌀10, 10 deep, all of 24 sides.
fn cup() -> String {
    const SIDES: usize = 24;
    let mut text = String::new();
    for (radius, z) in [(12.0, 0.0), (12.0, 16.0), (5.0, 16.0), (5.0, 6.0)] {
        for side in 0..SIDES {
            let (sine, cosine) = (TAU * side as f64 / SIDES as f64).sin_cos();
            writeln!(text, "v {} {} {z}", radius * cosine, radius * sine).unwrap();
        }
    }
    for ring in 0..3 {
        for side in 0..SIDES {
            let [a, b] = [side, (side + 1) % SIDES].map(|side| ring * SIDES + side + 1);
            writeln!(text, "f {a} {b} {} {}", b + SIDES, a + SIDES).unwrap();
        }
    }
    let polygon = |vertices: &mut dyn Iterator<Item = usize>| {
        vertices.map(|vertex| format!(" {vertex}")).collect::<String>()
    };
    let (below, floor) = (polygon(&mut (1..=SIDES).rev()), polygon(&mut (3 * SIDES + 1..=4 * SIDES)));
    text + &format!("f{below}\nf{floor}\n")
}

/// From above and below a mill removes all, but for what the pitch does not decide; tilted it would for certain.
#[test]
fn what_a_pitch_does_not_decide_of_the_stock_takes_no_set_up() {
    let folder = Workdir::new();
    folder.write("cup.obj", cup());
    folder.write("mill.toml", mill("mill", 40.0).replacen("3.0", "5.0", 1));
    let run = |more: &str| {
        let usual = "access cup.obj --unit mm --pitch 2 --tool mill.toml --stock box:2 --out out";
        folder.json(&format!("{usual} {more}"))
    };
    let below = run("--orientations axes+fibonacci:40 --setups")["setups"].clone();
    assert_eq!(
        (below["setups"].as_array().unwrap().len(), &below["proven"]),
        (2, &Value::Bool(true)),
        "{below}"
    );
    let share = |value: &Value| value.as_f64().unwrap();
    let stock = &below["stock"];
    assert!(share(&stock["undecided"]) > 0.005, "{stock}");
    assert!(
        (share(&stock["removed"]) + share(&stock["undecided"]) - share(&stock["removable"])).abs() < 1e-9
    );
    for setup in below["setups"].as_array().unwrap() {
        assert!((setup["up"][2].as_f64().unwrap().abs() - 1.0).abs() < 1e-12, "{setup}");
        let alone = share(&setup["removed_alone"]);
        assert!(0.03 < alone && alone <= share(&setup["removed"]), "{setup}");
        assert!(share(&setup["removed"]) <= share(&setup["removed_at_most"]), "{setup}");
    }
    // What both leave is what the volume calls undecided.
    let volume = run("--orientations 0,0;0,180 --removable");
    assert_eq!(volume["stock"]["out_of_reach"]["voxels"], 0, "{volume}");
}

/// A tilt that stands still leaves every way up an arc of directions, which no set meets by chance.
#[test]
fn a_fixed_axis_has_its_own_directions_in_every_set_up() {
    let folder = workshop();
    let set_ups =
        |more: &str| folder.json(&arguments(&format!("--tool long.toml --setups {more}")))["setups"].clone();
    let fixed = set_ups("ac:30:30:0:20");
    assert!(fixed["reached"].as_f64().unwrap() > 0.3 && fixed["proven"] == true, "{fixed}");
    for setup in fixed["setups"].as_array().unwrap() {
        assert_eq!(setup["rotary"][0]["range"], serde_json::json!([30.0, 30.0]), "{setup}");
    }
    let given = arguments("--tool long.toml --orientations axes --setups ac:30:30:-360:360");
    folder.refuse(&given, &["ac:30:30:-360:360", "where an axis is fixed"]);
}
