//! `imf train harmonic` and `imf train factored`, held against exact sections and against their own files.

use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::section::{SectionPlan, ToolPoints, sections};
use imf_fields::harmonic::file::HarmonicFile;

use crate::binary::Workdir;
use crate::model::model;

/// The bracket's harmonic field, written to field.safetensors.
fn fitted(folder: &Workdir) -> serde_json::Value {
    let fit = "train harmonic bracket --dims 5,15,9 --allow-coarse --degree 6 --components 30";
    folder.json(&format!("{fit} --no-calibrate --out field.safetensors"))
}

#[test]
fn sections_are_near_the_exact_ones_and_the_file_gives_them_again() {
    let folder = Workdir::new();
    let set = "fibonacci:19";
    fitted(&folder);
    let summary = folder.json(&format!("field field.safetensors --orientations {set} --out out"));
    let scene = model().scene;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let orientations = OrientationSet::parse(set).unwrap().orientations;
    let exact = sections(&plan, &orientations, Control::quiet()).unwrap();
    let file = HarmonicFile::read(&folder.path("field.safetensors")).unwrap();
    let mut again = vec![0.0; plan.grid().len() * orientations.len()];
    file.field.sections(&file.field.direction_weights(&orientations), &mut again);
    let mut squares = 0.0;
    for (index, (exact, again)) in exact.iter().zip(again.chunks_exact(plan.grid().len())).enumerate() {
        let found = folder.npy::<f32>(&format!("out/cmf-{index:05}.npy"));
        for ((&found, &exact), &again) in found.iter().zip(exact).zip(again) {
            // The same product in blocks of other sizes.
            assert!((found - again).abs() < 1e-5);
            squares += f64::from(found - exact).powi(2);
        }
    }
    let mse = squares / again.len() as f64;
    let told = summary["harmonic"]["report"]["validation"]["mse"].as_f64().unwrap();
    assert!(mse < 3.0 * told && mse < 5e-3, "{mse} against {told}");
    assert!(summary["guarantee"].as_str().unwrap().starts_with("approximate"));

    let info = folder.json("info field.safetensors");
    assert_eq!((&info["kind"], &info["settings"]["degree"]), (&"harmonic".into(), &6.into()));
    folder.imf("info field.safetensors").done().says(&["49 basis functions of degree 6"]);
    // At a voxel's centre a pose is answered as its section is.
    let grid = *plan.grid();
    let voxel = grid.index([2, 7, 8]);
    let [x, y, z] = grid.centre([2, 7, 8]).to_array();
    let (theta, phi) = (orientations[4].theta, orientations[4].phi);
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{x},{y},{z},{theta},{phi}\n9e9,0,0,10,20\n"));
    let run = folder.imf("query field.safetensors poses.csv --exact --json").done();
    run.warns(&["1 of 2 poses lie outside the box"]);
    let answers = run.json();
    let overlap = answers[0]["overlap"].as_f64().unwrap() as f32;
    assert!((overlap - again[4 * grid.len() + voxel].clamp(0.0, 1.0)).abs() < 1e-5);
    assert_eq!(answers[0]["overlap_exact"].as_f64().unwrap() as f32, exact[4][voxel]);
}

/// Cuts at its flanks alone, and not all around.
const SIDE: &str = "name = \"side\"\nunit = \"mm\"\nstick_out = 35.0\nsharp_points = [[5.0, 0.0, 20.0], [0.0, -5.0, 30.0]]\n\
    [cutter]\nshape = \"ball\"\ndiameter = 10.0\nlength = 35.0\n[[holder]]\ndiameter = 29.0\nlength = 48.0\n";

#[test]
fn a_saved_field_is_of_the_tip_whatever_points_are_sharp() {
    let folder = Workdir::new();
    folder.write("side.toml", SIDE);
    let fit = "train harmonic bracket --dims 8,24,15 --tool side.toml --degree 10";
    let overlap = "--quantity overlap --out side.safetensors --no-calibrate";
    folder.imf(&format!("{fit} {overlap}")).done();
    let info = folder.json("info side.safetensors");
    // A body of revolution: functions of the direction, not of the whole rotation.
    assert_eq!(info["report"]["functions"], 121);
    let spread = |index: u32, prime: u32| f64::from(index * prime % 251) / 251.0;
    let poses: String = (0..200)
        .map(|i| {
            let [x, y, z] =
                [(37, 49.0), (53, 147.0), (71, 87.0)].map(|(prime, size)| size * spread(i, prime));
            format!("{x},{y},{z},{},{}\n", 360.0 * spread(i, 11), 180.0 * spread(i, 13))
        })
        .collect();
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{poses}"));
    let mean = |more: &str, name: &str| {
        let answers = folder.json(&format!("query side.safetensors poses.csv --exact {more}"));
        let difference = |a: &serde_json::Value| {
            let exact = a[format!("{name}_exact")].as_f64().unwrap();
            ((a[name].as_f64().unwrap() - exact).abs(), exact)
        };
        let all: Vec<(f64, f64)> = answers.as_array().unwrap().iter().map(difference).collect();
        let n = all.len() as f64;
        (all.iter().map(|a| a.0).sum::<f64>() / n, all.iter().map(|a| a.1).sum::<f64>() / n)
    };
    for (error, value) in [mean("", "overlap"), mean("--sharp", "overlap_sharp")] {
        // Counts step from voxel to voxel, which are coarse here; the other quantity is off by more than half.
        assert!(error < 0.4 * value, "{error} of {value}");
    }
}

#[test]
fn a_fit_beyond_the_memory_names_what_takes_less() {
    let fit =
        "train harmonic bracket --dims 5,15,9 --allow-coarse --degree 30 --memory 8MiB --out no.safetensors";
    Workdir::new().refuse(fit, &["--degree", "--memory"]);
}

#[test]
fn a_field_is_distilled_into_a_network_through_an_interruption() {
    let folder = Workdir::new();
    fitted(&folder);
    fn distil(more: &str) -> String {
        let small = "train factored field.safetensors --network 2x32 --set batch=128";
        format!("{small} --steps 600 --rate 4e-3 --no-calibrate {more}")
    }
    let whole = folder.json(&distil("--out whole"));
    let variance = 1e-2;
    assert!(whole["loss"].as_f64().unwrap() < 0.1 * variance, "{whole}");
    // A checkpoint after every report changes nothing.
    folder.imf(&distil("--out often --set checkpoint_every=0")).done();
    assert_eq!(folder.bytes("whole/field.safetensors"), folder.bytes("often/field.safetensors"));
    std::fs::remove_file(folder.path("often/field.safetensors")).unwrap();
    folder.refuse(&distil("--out often"), &["unfinished", "--resume"]);
    folder.imf(&distil("--out often --resume")).done();
    assert_eq!(folder.bytes("whole/field.safetensors"), folder.bytes("often/field.safetensors"));
    // A damaged checkpoint costs the steps since the one before it.
    let damaged = folder.bytes("often/checkpoint.safetensors");
    folder.write("often/checkpoint.safetensors", &damaged[..damaged.len() / 2]);
    std::fs::remove_file(folder.path("often/field.safetensors")).unwrap();
    let resumed = folder.imf(&distil("--out often --resume")).done();
    resumed.warns(&["often/checkpoint.previous.safetensors at step 5"]);
    assert_eq!(folder.bytes("whole/field.safetensors"), folder.bytes("often/field.safetensors"));
    folder.refuse(&distil("--out often --resume --set seed=3"), &["other settings"]);
    let again = folder.json(&distil("--out often --resume"));
    assert!(again["loss"].is_null(), "no step was taken: {again}");

    // From its own network a few steps are enough, where random sines with the best output layer are not; a network of another shape
    // is taken over.
    let few = "train factored field.safetensors --set batch=128 --steps 20 --rate 1e-4 --no-calibrate";
    let loss = |more: &str| folder.json(&format!("{few} {more}"))["loss"].as_f64().unwrap();
    let (tuned, fresh) =
        (loss("--from whole/field.safetensors --out tuned"), loss("--network 2x32 --out fresh"));
    assert!(tuned < 1.5 * whole["loss"].as_f64().unwrap() && tuned < 0.5 * fresh, "{tuned} {fresh}");
    let info = folder.json("info tuned/field.safetensors");
    assert_eq!(info["network"]["width"], 32);
    // The same line goes on; another field's network is not the one that was begun with, nor are widths given twice.
    let tuned = format!("{few} --from whole/field.safetensors --out tuned --resume");
    folder.imf(&tuned).done().warns(&["tuned/checkpoint.safetensors is finished"]);
    folder.imf(&format!("{few} --network 2x16 --out narrow")).done();
    let words =
        ["tuned/checkpoint.safetensors", "narrow/field.safetensors", "2 layers of 32", "2 layers of 16"];
    folder.refuse(&tuned.replace("whole/", "narrow/"), &words);
    folder.refuse(&tuned.replace("whole/", "fresh/"), &["was not begun from the weights of fresh/field"]);
    folder.imf(&format!("{tuned} --network 2x20")).exits(2).warns(&["--network"]);
    folder.refuse(&format!("{few} --from field.safetensors --out no"), &["field.safetensors"]);
    // What adapts which is said where they are mixed up.
    let distilled = "whole/field.safetensors";
    let words = [distilled, "a factored field already", "--from whole/field.safetensors"];
    folder.refuse(&format!("train {distilled} --out no"), &words);
    let words = ["is a factored field", "imf train factored PART --from whole/field.safetensors"];
    folder.refuse(&format!("finetune {distilled} data --out no"), &words);
    folder.refuse("finetune field.safetensors data --out no", &["is a harmonic field", "anew"]);

    let info = folder.json("info whole/field.safetensors");
    assert_eq!((&info["kind"], &info["network"]["width"]), (&"factored".into(), &32.into()));
    let file =
        imf_fields::factored::file::FactoredFile::read(&folder.path("whole/field.safetensors")).unwrap();
    let grid = file.field.grid;
    let [x, y, z] = grid.centre([2, 7, 4]).to_array();
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{x},{y},{z},40,70\n"));
    let answer = &folder.json("query whole/field.safetensors poses.csv")[0]["overlap"];
    let expected = file.field.evaluator().overlap_with_gradient(
        grid.centre([2, 7, 4]),
        imf_core::orientation::Orientation::new(40.0, 70.0).direction(),
        &mut imf_fields::factored::PointScratch::default(),
    );
    let expected = f64::from(expected.unwrap().value.clamp(0.0, 1.0));
    assert!((answer.as_f64().unwrap() - expected).abs() < 1e-6);
}

/// Errors of a field's sections against exact ones, and the variance of these, by plain sums.
fn errors(
    field: &imf_fields::harmonic::HarmonicField,
    plan: &SectionPlan,
    set: &[imf_core::orientation::Orientation],
) -> (f64, f64, f64) {
    let exact = sections(plan, set, Control::quiet()).unwrap().concat();
    let mut values = vec![0.0; exact.len()];
    field.sections(&field.direction_weights(set), &mut values);
    let n = exact.len() as f64;
    let difference = |(&e, &v): (&f32, &f32)| f64::from(v) - f64::from(e);
    let squared: f64 = exact.iter().zip(&values).map(difference).map(|d| d * d).sum();
    let largest = exact.iter().zip(&values).map(difference).fold(0.0f64, |a, d| a.max(d.abs()));
    let mean = exact.iter().map(|&e| f64::from(e)).sum::<f64>() / n;
    let spread: f64 = exact.iter().map(|&e| (f64::from(e) - mean).powi(2)).sum();
    (squared / n, largest, spread / n)
}

#[test]
fn eval_says_of_both_families_what_plain_sums_say() {
    let folder = Workdir::new();
    fitted(&folder);
    let small = "train factored field.safetensors --network 2x32 --set batch=128";
    folder.imf(&format!("{small} --steps 600 --rate 4e-3 --no-calibrate --out small")).done();
    let scene = model().scene;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let random = OrientationSet::parse("random:20:3").unwrap().orientations;
    let harmonic = HarmonicFile::read(&folder.path("field.safetensors")).unwrap();
    let factored =
        imf_fields::factored::file::FactoredFile::read(&folder.path("small/field.safetensors")).unwrap();
    let expanded = factored
        .field
        .evaluator()
        .expanded(imf_fields::harmonic::coefficients::StoragePrecision::F32, factored.report);
    for (file, family, field) in [
        ("field.safetensors", "harmonic", &harmonic.field),
        ("small/field.safetensors", "factored", &expanded),
    ] {
        folder.calibrate_quickly(file);
        let asked = format!("eval {file} --random 20 --seed 3 --imf fibonacci:30 --out {family}");
        let report = folder.json(&asked);
        let (mse, mpe, variance) = errors(field, &plan, &random);
        let row = &report["rows"][2];
        assert_eq!((&row["name"], &report["family"]), (&"20 random sections".into(), &family.into()));
        for (name, expected) in [("mse", mse), ("mpe", mpe), ("variance", variance)] {
            let found = row[name].as_f64().unwrap();
            // One section at a time, in blocks of other sizes: the same product up to rounding.
            assert!(
                (found - expected).abs() < 1e-6 + 1e-3 * expected,
                "{family} {name}: {found}, {expected}"
            );
        }
        let nearest = report["rows"][3]["name"].as_str().unwrap();
        assert!(nearest.ends_with("by nearest fitted section"), "{nearest}");
        // 1.33 for each of the 49 functions of degree 6, in whole fours.
        assert_eq!(report["training_sections"], 64);
        for file in ["report.md", "sections.png", "imf.png", "errors.png"] {
            assert!(folder.path(family).join(file).exists(), "{file}");
        }
        assert!(folder.text(&format!("{family}/report.md")).contains("made from 64 exact sections"));
    }
}
