//! Error rates of a field's decisions: `imf calibrate`.

use serde_json::Value;

use crate::binary::Workdir;

const SCENE: &str = "teapot --dims 15,20,31 --clearance 4 --clearance-cutter 4";

#[test]
fn a_calibrated_field_tells_what_it_is_worth() {
    let folder = Workdir::new();
    let made = "--degree 6 --no-calibrate --out field.safetensors";
    folder.imf(&format!("train harmonic {SCENE} {made}")).done();
    folder.refuse("calibrate field.safetensors --verify", &["field.safetensors", "leave out --verify"]);
    // Fewer poses cannot show the rate that is asked for.
    let few = "calibrate field.safetensors --poses 2000";
    folder.imf(few).refused(&["draw more poses"]);
    for more in ["--poses", "--boundary"] {
        let many = format!("calibrate field.safetensors {more} 99999999999999");
        folder.refuse(&many, &["of memory, and", "99999999999999", "use fewer --poses or --boundary"]);
    }
    let small = "--poses 100000 --boundary 2000";
    let found = folder.json(&format!("calibrate field.safetensors {small}"));
    let known = folder.json("info field.safetensors");
    assert_eq!(found["calibration"], known["calibration"]);
    assert!(known["calibration"].is_object(), "{known}");
    let judged = folder.imf(&format!("calibrate field.safetensors {small} --verify --seed 1 --json")).json();
    assert!(judged["calibration"]["uniform"]["poses"].is_u64(), "{judged}");
    folder.refuse_input("calibrate field.safetensors --verify --seed 0", &["--seed 0 drew the poses"]);
}

#[test]
fn a_field_of_depth_is_calibrated_when_it_is_made_and_leaves_little_near() {
    let folder = Workdir::new();
    let made = "--quantity depth --degree 8 --out depth.safetensors";
    // Two voxels of clearance.
    let scene = "teapot --dims 15,20,31 --clearance 8 --clearance-cutter 8";
    let told = folder.json(&format!("train harmonic {scene} {made}"));
    assert_eq!(told["settings"]["quantity"], "depth");
    let info = folder.json("info depth.safetensors");
    assert_eq!(info["settings"]["quantity"], "depth");
    let most = 7.5 * info["scene"]["grid"]["pitch"].as_f64().unwrap();
    assert_eq!((&info["quantity"], &info["bounds"]), (&"depth".into(), &serde_json::json!([-most, most])));
    let said = folder.imf("info depth.safetensors").done().stdout;
    assert!(
        said.contains("depth in mm: how far") && said.contains("clamped within 7.5 pitches, 29 mm"),
        "{said}"
    );
    let uniform = &info["calibration"]["uniform"];
    let count = |value: &Value| value.as_u64().unwrap_or_else(|| panic!("{info}"));
    assert!(count(&uniform["false_free"]["of"]) >= 46_052, "{uniform}");
    assert!(uniform["false_free"]["bound"].as_f64().unwrap() <= 1e-4, "{uniform}");
    assert!(uniform["false_colliding"]["bound"].as_f64().unwrap() <= 0.05, "{uniform}");
    assert!(10 * count(&uniform["undecided"]) <= count(&uniform["poses"]), "{uniform}");
    // The stated rates hold on fresh poses.
    folder.imf("calibrate depth.safetensors --verify --seed 1").done();

    // The middle of the box.
    let grid = &info["scene"]["grid"];
    let middle = [0, 1, 2].map(|axis| {
        let size = grid["pitch"].as_f64().unwrap() * grid["dims"][axis].as_f64().unwrap();
        grid["origin"][axis].as_f64().unwrap() + 0.5 * size
    });
    let [x, y, z] = middle;
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{x},{y},{z},10,20\n"));
    let asked = folder.imf("query depth.safetensors poses.csv").done();
    assert!(asked.stdout.lines().next().unwrap().ends_with("depth,decision,outside"), "{}", asked.stdout);
    asked.warns(&["clamped within 7.5 pitches, 29 mm"]);
    // Exact depths beside the field's: nearer than a voxel, and a pose well inside collides.
    let exact = folder.json("query depth.safetensors poses.csv --exact");
    let (depth, counted) = (exact[0]["depth"].as_f64().unwrap(), exact[0]["depth_exact"].as_f64().unwrap());
    assert!((depth - counted).abs() < 3.87 && counted > 0.0, "{exact}");
    assert_eq!((&exact[0]["decision"], &exact[0]["outside"]), (&"colliding".into(), &false.into()));
    // The report's decisions follow the file's threshold, and its error is a stranger's.
    // As the field's values are.
    folder.refuse("eval depth.safetensors --threshold 1e6", &["a threshold of this field is at least -"]);
    let eval = folder.json("eval depth.safetensors --random 6 --imf fibonacci:6");
    let told = &info["report"]["validation"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}"));
    let apart = (number(&eval["validation"]["mse"]) - number(&told["mse"])).abs();
    let sure = number(&eval["validation"]["standard_error"]).hypot(number(&told["standard_error"]));
    assert!(apart < 4.0 * sure, "{eval}");
    assert_eq!((&eval["quantity"], &eval["verdict"]["usable_for"]), (&"depth".into(), &"decisions".into()));
    assert!(number(&eval["rows"][2]["false_free"]) < 1e-3, "{eval}");
    // The minimum over directions, and what of it is called free.
    let least = "field depth.safetensors --orientations fibonacci:6 --imf --out least";
    let least = folder.json(least);
    let threshold = number(&info["calibration"]["free_up_to"]);
    assert!(
        (number(&least["tau"]) - threshold).abs() < 1e-6 && least["accessible_outside"].is_u64(),
        "{least}"
    );
    let lengths = folder.npy::<f32>("least/minimum-depth-mm.npy");
    assert!(lengths.iter().any(|&depth| depth < 0.0) && lengths.iter().all(|&depth| depth.abs() <= 30.94));
}

#[test]
fn a_users_part_gets_a_field_of_depth_that_decides_and_approach_moves_are_inside() {
    let folder = Workdir::new();
    folder.imf("parts parts --only bracket").done();
    let part = "parts/bracket.obj --tool paper --pitch 6";
    let making = format!("train harmonic {part} --degree 6 --out depth.safetensors");
    folder.imf(&making).done().says(&["\nVerdict: usable for decisions: of "]);
    let info = folder.json("info depth.safetensors");
    assert_eq!((&info["quantity"], &info["scene"]["margin"]), (&"depth".into(), &6.into()));
    // Two voxels; the cutter may touch.
    assert_eq!(
        info["scene"]["clearance"],
        serde_json::json!({ "holder": 12.0, "shank": 12.0, "cutter": 0.0 })
    );
    // A tool that stands just above the part is within what the field knows, and is free there.
    let grid = &info["scene"]["grid"];
    let at = |axis: usize, voxels: &dyn Fn(f64) -> f64| {
        grid["origin"][axis].as_f64().unwrap() + 6.0 * voxels(grid["dims"][axis].as_f64().unwrap())
    };
    // Beyond the clearance of two voxels over the part's top.
    let (x, y, z) = (at(0, &|n| n / 2.0), at(1, &|n| n / 2.0), at(2, &|n| n - 2.0));
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{x},{y},{z},0,0\n"));
    let answer = folder.json("query depth.safetensors poses.csv");
    assert_eq!((&answer[0]["decision"], &answer[0]["outside"]), (&"free".into(), &false.into()), "{answer}");

    // The paper's question keeps the paper's measure, and so does whoever asks for it.
    let overlap = "--degree 3 --no-calibrate --json --out overlap.safetensors";
    let given = format!("train harmonic {part} --quantity overlap {overlap}");
    let paper = format!("train harmonic bracket --pitch 6 {overlap}");
    for (making, margin) in [(given, 6), (paper, 0)] {
        folder.imf(&making).done();
        let info = folder.json("info overlap.safetensors");
        assert_eq!((&info["quantity"], &info["scene"]["margin"]), (&"overlap".into(), &margin.into()));
        assert!(info["scene"]["clearance"].is_null(), "{info}");
    }
}
