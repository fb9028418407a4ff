//! What a field's decisions are worth: `imf calibrate`, and `imf check` with the guarded field.

use serde_json::Value;

use crate::folder::Folder;

const SCENE: [&str; 7] = ["teapot", "--dims", "15,20,31", "--clearance", "4", "--clearance-cutter", "4"];

#[test]
fn a_calibrated_field_tells_what_it_is_worth_and_proves_what_a_check_may_leave_out() {
    let folder = Folder::new();
    let made =
        ["--method", "harmonic", "--degree", "6", "--orientations", "0,0", "--save", "field.safetensors"];
    folder.succeed(&[&["field"], &SCENE[..], &made, &["--out", "sections"]].concat());
    folder.refuse(
        &["calibrate", "field.safetensors", "--verify"],
        &["field.safetensors", "leave out --verify"],
    );
    // Fewer poses cannot show the rate that is asked for.
    let few = ["calibrate", "field.safetensors", "--poses", "2000"];
    folder.run(&few).is_refusal(&["draw more poses"], &few);
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
    folder.write("path.csv", "-40,-80,90,0,0,1\n-40,-80,60,0,0,1\n29,0,0,0,0,1\n");
    let check = [&["check"], &SCENE[..1], &["path.csv"], &SCENE[1..]].concat();
    let plain = folder.run(&check);
    let guarded = folder.run(&[&check[..], &["--field", "field.safetensors"]].concat());
    assert_eq!((plain.code, guarded.code), (Some(3), Some(3)), "{}", guarded.stderr);
    assert_eq!(plain.stdout, guarded.stdout);
    assert!(guarded.stderr.contains("were proven free by the guarded field"), "{}", guarded.stderr);
    let other = [&check[..], &["--field", "field.safetensors", "--margin", "3"]].concat();
    folder.run(&other).is_refusal(&["field.safetensors"], &other);
}
