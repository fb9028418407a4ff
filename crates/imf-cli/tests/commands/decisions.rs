//! What a field's decisions are worth: `imf calibrate`, and `imf check` with the guarded field.

use serde_json::Value;

use crate::folder::Folder;

const SCENE: [&str; 7] = ["teapot", "--dims", "15,20,31", "--clearance", "4", "--clearance-cutter", "4"];

#[test]
fn a_calibrated_field_tells_what_it_is_worth_and_proves_what_a_check_may_leave_out() {
    let folder = Folder::new();
    let made = ["--degree", "6", "--no-calibrate", "--out", "field.safetensors"];
    folder.succeed(&[&["train", "harmonic"], &SCENE[..], &made].concat());
    folder.refuse(
        &["calibrate", "field.safetensors", "--verify"],
        &["field.safetensors", "leave out --verify"],
    );
    // Fewer poses cannot show the rate that is asked for.
    let few = ["calibrate", "field.safetensors", "--poses", "2000"];
    folder.run(&few).is_refusal(&["draw more poses"], &few);
    for more in ["--poses", "--boundary"] {
        let many = ["calibrate", "field.safetensors", more, "99999999999999"];
        folder.refuse(&many, &["of memory, and", "99999999999999", "use fewer --poses or --boundary"]);
    }
    let small = ["--poses", "100000", "--boundary", "2000"];
    let found = folder.json(&[&["calibrate", "field.safetensors"], &small[..]].concat());
    let known = folder.json(&["info", "field.safetensors"]);
    assert_eq!(found["calibration"], known["calibration"]);
    assert!(known["calibration"].is_object(), "{known}");
    let fresh = ["--verify", "--seed", "1", "--json"];
    let run = folder.run(&[&["calibrate", "field.safetensors"], &small[..], &fresh].concat());
    let judged: Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(judged["calibration"]["uniform"]["poses"].is_u64(), "{judged}");

    // Down beside the teapot, then into it: the answer is the same line by line, whoever gives it.
    folder.write("path.csv", "x,y,z,i,j,k\n-40,-80,90,0,0,1\n-40,-80,60,0,0,1\n29,0,0,0,0,1\n");
    let check = [&["check"], &SCENE[..1], &["path.csv"], &SCENE[1..]].concat();
    let plain = folder.run(&check);
    let guarded = folder.run(&[&check[..], &["--field", "field.safetensors"]].concat());
    assert_eq!((plain.code, guarded.code), (Some(3), Some(3)), "{}", guarded.stderr);
    assert_eq!(plain.stdout, guarded.stdout);
    assert!(guarded.stderr.contains("were proven free by the guarded field"), "{}", guarded.stderr);
    let other = [&check[..], &["--field", "field.safetensors", "--margin", "3"]].concat();
    folder.run(&other).is_refusal(&["field.safetensors"], &other);
}

#[test]
fn a_field_of_depth_is_calibrated_when_it_is_made_and_leaves_little_near() {
    let folder = Folder::new();
    let made = ["--quantity", "depth", "--degree", "8", "--out", "depth.safetensors"];
    // Two voxels of clearance.
    let scene = ["teapot", "--dims", "15,20,31", "--clearance", "8", "--clearance-cutter", "8"];
    let making = [&["train", "harmonic"], &scene[..], &made].concat();
    let run = folder.run(&[&making[..], &["--json"]].concat());
    let told: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(told["settings"]["quantity"], "depth");
    let info = folder.json(&["info", "depth.safetensors"]);
    assert_eq!(info["settings"]["quantity"], "depth");
    let most = 8.0 * info["scene"]["grid"]["pitch"].as_f64().unwrap();
    assert_eq!((&info["quantity"], &info["bounds"]), (&"depth".into(), &serde_json::json!([-most, most])));
    let said = folder.succeed(&["info", "depth.safetensors"]).stdout;
    assert!(said.contains("depth in mm: how far") && said.contains("held within 8 pitches, 30.93"), "{said}");
    let uniform = &info["calibration"]["uniform"];
    let count = |value: &Value| value.as_u64().unwrap_or_else(|| panic!("{info}"));
    assert!(count(&uniform["false_free"]["of"]) >= 46_052, "{uniform}");
    assert!(uniform["false_free"]["bound"].as_f64().unwrap() <= 1e-4, "{uniform}");
    assert!(uniform["false_colliding"]["bound"].as_f64().unwrap() <= 0.05, "{uniform}");
    assert!(10 * count(&uniform["undecided"]) <= count(&uniform["poses"]), "{uniform}");
    // The stated rates hold on fresh poses.
    folder.succeed(&["calibrate", "depth.safetensors", "--verify", "--seed", "1"]);

    folder.write("poses.csv", "x,y,z,theta,phi\n0,0,0,10,20\n");
    let asked = folder.succeed(&["query", "depth.safetensors", "poses.csv"]);
    assert!(asked.stdout.lines().next().unwrap().ends_with("depth"), "{}", asked.stdout);
    assert!(asked.stderr.contains("held within 8 pitches, 30.93"), "{}", asked.stderr);
    let exact = ["query", "depth.safetensors", "poses.csv", "--exact"];
    folder.run(&exact).is_refusal(&["depth.safetensors", "--exact counts overlaps"], &exact);
    let eval = ["eval", "depth.safetensors"];
    folder.run(&eval).is_refusal(&["imf calibrate --verify"], &eval);
}
