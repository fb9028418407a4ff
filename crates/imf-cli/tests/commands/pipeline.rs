//! Dataset, training, evaluation and fine-tuning, one after the other, as a script would run them.

use std::fs;

use serde_json::{Value, json};

use crate::binary::{DATASET, TRAIN, Workdir};

#[test]
fn a_dataset_is_made_once_and_kept() {
    let work = Workdir::new();
    let mut made = work.json(DATASET);
    // So coarse a grid is warned about.
    assert!(made.as_object_mut().unwrap().remove("warnings").is_some());
    let samples = 16 * 617; // 0.35 of 1,764 voxels, rounded, in each section
    assert_eq!(
        made,
        json!({
            "folder": "data", "sections": 16, "samples": samples,
            "shards_made": 1, "shards_kept": 0, "shards_of_others": 0
        })
    );
    let shard = work.bytes("data/shard-00000.safetensors");
    let again = work.json(DATASET);
    assert_eq!((&again["shards_made"], &again["shards_kept"]), (&json!(0), &json!(1)));
    assert_eq!(work.bytes("data/shard-00000.safetensors"), shard);

    work.imf(&format!("{DATASET} --seed 1")).refused(&["data", "another dataset", "sampling"]);
    work.imf(&DATASET.replace("16", "17")).refused(&["data", "another dataset", "orientation"]);
    work.imf(&DATASET.replace("7,21", "7,22")).refused(&["data", "another dataset", "scene"]);
    work.imf(DATASET).done();
}

/// The one row whose name ends so.
fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["rows"].as_array().unwrap();
    rows.iter().find(|row| row["name"].as_str().unwrap().ends_with(name)).unwrap()
}

/// What a report says must follow from its own numbers; true where the field may steer.
pub(crate) fn honest(report: &Value, text: &str) -> bool {
    let made = if report["family"] == json!("siren5") { "trained" } else { "fitted" };
    let (learnt, nearest) = (row(report, "random sections"), row(report, &format!("nearest {made} section")));
    let number = |value: &Value| value.as_f64().unwrap();
    let mse = number(&learnt["mse"]);
    let over_variance = mse / number(&learnt["variance"]);
    let over_nearest = mse / number(&nearest["mse"]);
    for (name, expected) in [("mse_over_variance", over_variance), ("mse_over_nearest", over_nearest)] {
        assert!((number(&report[name]) / expected - 1.0).abs() < 1e-9, "{name}: {report}");
    }
    let verdict = &report["verdict"];
    assert!(text.contains(&format!("Verdict: {}.", verdict["text"].as_str().unwrap())), "{text}");
    // The demo compares at the paper's threshold, everything else at the calibrated one.
    let asked = report["threshold_of"] == json!("question");
    assert_eq!(asked, report["threshold"] == json!(1e-3), "{report}");
    // The error's standard error is that of the rows' own orientations.
    let told = &report["validation"];
    assert!(
        (number(&told["mse"]) / mse - 1.0).abs() < 1e-9 && number(&told["standard_error"]) > 0.0,
        "{told}"
    );
    match verdict["usable_for"].as_str().unwrap() {
        "decisions" => number(&verdict["false_free_bound"]) <= 1e-4 && number(&verdict["found_free"]) >= 0.5,
        "steering" => number(&verdict["misordered_bound"]) <= 0.1,
        _ => {
            assert!(number(&verdict["misordered_bound"]) > 0.1, "{verdict}");
            false
        }
    }
}

#[test]
fn a_model_is_trained_evaluated_and_adapted() {
    let work = Workdir::with_dataset();
    let trained = work.json(&format!("{TRAIN} --steps 400 --set schedule=cosine --out model"));
    assert_eq!((&trained["steps"], &trained["parameters"]), (&json!(400), &json!(1_489)));
    assert_eq!(trained["field"], json!("model/field.safetensors"));
    assert!(
        trained["loss"].as_f64().unwrap() < 0.2 && trained["seconds"].as_f64().unwrap() > 0.0,
        "{trained}"
    );
    assert!(trained["engine"].as_str().unwrap().contains("CPU"), "{trained}");
    work.picture("model/loss.png");
    let model = work.model("model/field.safetensors");
    assert!(model.record.finished && !model.is_resumable());
    assert!(work.model("model/checkpoint.safetensors").is_resumable());

    let eval = "eval model/field.safetensors --device cpu --random 5 --imf fibonacci:8 --json --out report";
    let evaluated = work.imf(eval).done();
    let report = evaluated.json();
    assert_eq!(work.read_json("report/report.json"), report);
    assert_eq!(report["rows"].as_array().unwrap().len(), 5);
    assert_eq!((&report["training_steps"], &report["dims"]), (&json!(400), &json!([7, 21, 12])));
    // fibonacci:16 has neither (0°, 0°) nor (12°, 6°), and the report looks that up.
    assert_eq!(report["rows"][0]["name"], json!("section (0°, 0°), out-of-sample"));
    assert!(row(&report, "IMF over 8 (fibonacci:8)")["mpe"].as_f64().unwrap() <= 1.0);
    honest(&report, &work.text("report/report.md"));
    for picture in ["sections.png", "imf.png", "errors.png", "loss.png"] {
        work.picture(&format!("report/{picture}"));
        assert!(work.text("report/report.md").contains(picture));
    }
    // The same model, the same numbers, another thread count; and without --json a table for people.
    let other = eval.replace("--json --out report", "--threads 3 --in-sample -30,45");
    let table = work.imf(&other).done().stdout;
    assert!(table.contains(&format!("{:.2e}", report["rows"][2]["mse"].as_f64().unwrap())), "{table}");
    honest(&report, &table);
    // Angles below 0 need no equals sign.
    assert!(table.lines().any(|line| line.starts_with("section (330°, 45°)")), "{table}");

    work.imf(&DATASET.replace("bracket", "bracket-raw").replace("--out data", "--out raw")).done();
    // At a rate of next to nothing nothing moves: fine-tuning starts from the model's own weights.
    let finetune = "finetune model/field.safetensors raw --device cpu --batch 256 --no-calibrate";
    work.imf(&format!("{finetune} --steps 40 --rate 1e-30 --out still")).done();
    let still = work.model("still/field.safetensors");
    assert!(still.state.parameters == model.state.parameters, "so low a rate moved the weights");
    assert_eq!(still.record.fine_tuned_from.as_deref(), Some("bracket"));
    assert_eq!(still.scene.record.part, "bracket-raw");
    // It does not go on from another model's weights, though network and part are the same.
    let other = finetune.replace("model/field", "still/field").replace("raw", "data");
    work.imf(&format!("{other} --steps 4 --out again")).done();
    let again = other.replace("still/field", "model/field");
    work.imf(&format!("{again} --steps 4 --out again --resume"))
        .refused(&["was not fine-tuned from this model"]);
    // The network knows places by the fraction of the box alone.
    for (grid, is_other) in [("--dims 10,30,18", false), ("--pitch 7 --margin 2", true)] {
        work.imf(&DATASET.replace("--dims 7,21,12", grid).replace("--out data", "--out boxed")).done();
        let run = work.imf(&format!("{} --steps 4 --out in-box", finetune.replace("raw", "boxed"))).done();
        assert_eq!(run.stderr.contains("made for another box"), is_other, "{grid}: {}", run.stderr);
        ["boxed", "in-box"].iter().for_each(|folder| fs::remove_dir_all(work.path(folder)).unwrap());
    }
    let adapted = work.json(&format!("{finetune} --epochs 1 --out adapted"));
    assert_eq!(adapted["steps"], json!((16 * 617u64).div_ceil(256)));
    assert!(work.model("adapted/field.safetensors").state.parameters != model.state.parameters);
}

#[test]
fn a_network_that_was_hardly_trained_is_called_not_usable() {
    let work = Workdir::with_dataset();
    // Fewer steps than there are between two points of the loss curve.
    let trained = work.json(&format!("{TRAIN} --steps 1 --out short"));
    assert_eq!(trained["steps"], json!(1));
    assert!(trained["loss"].is_number(), "{trained}");
    let eval = "eval short/field.safetensors --device cpu --random 5 --imf fibonacci:8 --out short";
    let report = work.json(eval);
    assert!(!honest(&report, &work.text("short/report.md")), "{report}");
    assert!(work.path("short/loss.png").is_file());
}
