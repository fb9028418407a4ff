//! Recipes by the real binary: a tiny one of each kind from nothing to its report, killed and continued, and refused.

use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::binary::Workdir;

/// The part at about a seventh of its grid, a network that a step takes well under a millisecond, few questions.
const TINY: &str = "--scale 0.14 --device cpu --set network.width=24 --set network.layers=3 --set network.omega=10 \
                    --set stage.*.training.batch=128 --set evaluation.random=4 \
                    --set evaluation.imf=[\"grid:3\",\"grid:4\"] --set stage.*.training.schedule.initial=1e-3";
/// Few sections, in stages that have a fixed set.
const FEW: &str = "--set stage.*.orientations=fibonacci:12";

fn steps(n: u64) -> String {
    format!("--set stage.*.training.length={{steps={n}}}")
}

fn online() -> String {
    format!("recipe run online {TINY} --set stage.main.online.pool=8 {} --checkpoint-every 0.01", steps(1500))
}

fn multi() -> String {
    format!("recipe run multi {TINY} {FEW} {} --checkpoint-every 0.01", steps(700))
}

/// The answer of a result to the question whose name ends so.
fn mse(summary: &Value, stage: &str, name: &str) -> f64 {
    let results = summary["results"].as_array().unwrap();
    let result = results.iter().find(|result| result["stage"] == stage).unwrap();
    let answers = result["answers"].as_array().unwrap();
    let answer = answers.iter().find(|answer| answer["name"].as_str().unwrap().ends_with(name)).unwrap();
    answer["mse"].as_f64().unwrap()
}

/// Kills the command each time its checkpoint has changed, `times` times, then lets it come to its end.
fn killed(work: &Workdir, line: &str, checkpoint: &str, times: usize) {
    let mut kills = 0;
    for round in 0..times {
        let before = std::fs::metadata(work.path(checkpoint)).and_then(|m| m.modified()).ok();
        let mut child = work.command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        let changed = || {
            let now = std::fs::metadata(work.path(checkpoint)).and_then(|m| m.modified()).ok();
            now.is_some() && now != before
        };
        while !changed() && child.try_wait().unwrap().is_none() && begun.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(1));
        }
        // Not only right after a checkpoint.
        std::thread::sleep(Duration::from_millis(7 * round as u64));
        child.kill().unwrap();
        kills += usize::from(!child.wait().unwrap().success());
    }
    assert!(kills >= 1, "`imf {line}` was never killed in time");
    work.imf(line).done();
}

#[test]
fn recipes_are_listed_and_shown_as_they_are() {
    let work = Workdir::new();
    let list = work.imf("recipe list").done().stdout;
    for name in ["single", "multi", "transfer", "sparsity", "architecture", "online"] {
        assert!(list.lines().any(|line| line.starts_with(name)), "{name} in\n{list}");
        let shown = work.imf(&format!("recipe show {name}")).done().stdout;
        let file = format!("{}/recipes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        assert_eq!(shown, std::fs::read_to_string(file).unwrap());
    }
}

#[test]
fn single_from_a_file_of_ones_own() {
    let work = Workdir::new();
    let shown = work.imf("recipe show single").done().stdout;
    work.write("mine.toml", shown.replace("name = \"single\"", "name = \"mine\"").as_bytes());
    let line = format!("recipe run mine.toml --part bracket {TINY} {FEW} {} --out out", steps(300));
    let summary = work.imf(&format!("{line} --json")).done().json();
    assert_eq!((&summary["recipe"], &summary["stages"][0]["part"]), (&"mine".into(), &"bracket".into()));
    for file in ["loss.png", "stages/main/sections.png", "stages/main/loss.png"] {
        work.picture(&format!("out/{file}"));
    }
    for file in ["recipe.toml", "recipe.md", "stages/main/report.md"] {
        assert!(!work.text(&format!("out/{file}")).is_empty());
    }
    let model = work.model("out/model.safetensors");
    assert_eq!((model.record.steps, model.shape.width), (300, 24));
    assert!(model.state == work.model("out/stages/main/field.safetensors").state);

    // The same again finds everything done, other settings are refused, and what was written down repeats it.
    let again = work.imf(&line).done();
    assert!(again.stderr.contains("finished already: 300 steps"), "{}", again.stderr);
    work.imf(&format!("{line} --set network.seed=2")).refused(&["stage main (network)", "--out"]);
    work.imf("recipe run out/recipe.toml --device cpu --out repeated").done();
    assert!(work.model("repeated/model.safetensors").state == model.state, "not repeated");
}

#[test]
fn multi_goes_on_after_sigkill_in_either_stage_to_the_same_bits() {
    let work = Workdir::new();
    work.imf(&format!("{} --out whole", multi())).done();
    let [coarse, full] =
        ["coarse", "full"].map(|s| work.model(&format!("whole/stages/{s}/field.safetensors")));
    assert_eq!(coarse.scene, full.scene, "both stages' networks speak of the full grid");
    assert!(full.record.fine_tuned_from.as_ref().unwrap().contains("stage coarse"));
    let summary: Value = serde_json::from_str(&work.text("whole/recipe.json")).unwrap();
    let voxels = |i: usize| {
        summary["stages"][i]["dims"].as_array().unwrap().iter().map(|d| d.as_u64().unwrap()).product::<u64>()
    };
    assert!(voxels(0) < voxels(1) / 2, "{} and {} voxels", voxels(0), voxels(1));

    killed(&work, &format!("{} --out broken", multi()), "broken/stages/coarse/checkpoint.safetensors", 2);
    for stage in ["coarse", "full"] {
        let broken = work.model(&format!("broken/stages/{stage}/field.safetensors"));
        let whole = work.model(&format!("whole/stages/{stage}/field.safetensors"));
        assert!(broken.state == whole.state, "stage {stage} ended elsewhere");
    }
    killed(&work, &format!("{} --out late", multi()), "late/stages/full/checkpoint.safetensors", 2);
    assert!(work.model("late/model.safetensors").state == full.state, "the second stage ended elsewhere");
}

#[test]
fn online_goes_on_after_sigkill_to_the_same_bits_and_says_who_waited() {
    let work = Workdir::new();
    let summary = work.imf(&format!("{} --out whole --json", online())).done().json();
    let waits = &summary["stages"][0]["waits"];
    // 1,500 steps with a fresh section each: the last step's pool ends with section 8 + 1,499.
    assert_eq!(waits["sections"].as_u64(), Some(1507), "{waits}");
    assert!(waits["trainer"].as_f64().unwrap() + waits["producer"].as_f64().unwrap() > 0.0, "{waits}");
    assert!(work.text("whole/recipe.md").contains("The trainer waited"));
    killed(&work, &format!("{} --out broken", online()), "broken/stages/main/checkpoint.safetensors", 4);
    let [whole, broken] = ["whole", "broken"].map(|f| work.model(&format!("{f}/model.safetensors")));
    assert!(whole.state == broken.state, "the pieces ended elsewhere");
    assert_eq!(whole.record.orientations, broken.record.orientations);
}

#[test]
fn a_transferred_network_is_better_than_one_from_random_weights() {
    let work = Workdir::new();
    let line = format!(
        "recipe run transfer {TINY} {FEW} {} --set stage.raw.training.length={{steps=2000}} \
         --set stage.adapted.training.schedule.initial=5e-4 --out out --json",
        steps(150)
    );
    let summary = work.imf(&line).done().json();
    for question in ["random sections", "IMF over 16 (grid:4)"] {
        let [adapted, control] = ["adapted", "control"].map(|stage| mse(&summary, stage, question));
        // The frame has little of its box: measured 0.56 at random sections.
        assert!(adapted < 0.75 * control, "{question}: {adapted:e} adapted, {control:e} from random weights");
    }
    let text = work.text("out/recipe.md");
    assert!(text.contains("| adapted: ") && text.contains("| control: "), "{text}");
    let parts: Vec<&str> =
        summary["stages"].as_array().unwrap().iter().map(|s| s["part"].as_str().unwrap()).collect();
    assert_eq!(parts, ["bracket-raw", "bracket", "bracket"]);
}

#[test]
fn a_sweep_runs_its_variants_once_and_tabulates_them() {
    let work = Workdir::new();
    for (name, variants) in [("sparsity", 3), ("architecture", 5)] {
        let base = format!("recipe run {name} {TINY} {FEW} {} --out {name}", steps(40));
        let line = if name == "architecture" {
            // Five networks of the paper's size would take minutes; the variants' own overrides come last.
            format!(
                "{base} --set variant=[{{name=\"a\",set={{\"network.width\"=8}}}},{{name=\"b\",set={{\"network.layers\"=4}}}}]"
            )
        } else {
            base
        };
        let all = work.imf(&format!("{line} --json")).done().json();
        let expected = if name == "architecture" { 2 } else { variants };
        let lines = all.as_array().unwrap();
        assert_eq!(lines.len(), expected);
        let table = work.text(&format!("{name}/sweep.md"));
        for one in lines {
            let variant = one["variant"].as_str().unwrap();
            assert!(table.contains(&format!("| {variant} | ")), "{table}");
            assert!(work.path(&format!("{name}/{variant}/model.safetensors")).exists());
        }
        work.picture(&format!("{name}/loss.png"));
        // A variant that is gone is run again, the others are kept.
        let first = lines[0]["variant"].as_str().unwrap();
        std::fs::remove_dir_all(work.path(&format!("{name}/{first}"))).unwrap();
        let again = work.imf(&line).done();
        let kept = again.stderr.matches("finished already\n").count();
        assert_eq!(kept, expected - 1, "{}", again.stderr);
    }
    let samples: Vec<u64> = serde_json::from_str::<Value>(&work.text("sparsity/sweep.json"))
        .unwrap()
        .as_array()
        .unwrap()
        .iter()
        .map(|line| line["stages"][0]["samples"].as_u64().unwrap())
        .collect();
    assert!(samples[1] > 3 * samples[0] && samples[2] > samples[1], "10, 35 and 50 %: {samples:?}");
}

#[test]
fn wrong_recipes_are_refused_by_name() {
    let work = Workdir::new();
    work.imf("recipe show nothing").refused(&["no recipe 'nothing'", "single, multi, transfer"]);
    work.imf("recipe run nowhere.toml --out out").refused(&["nowhere.toml", "imf-bench recipe list"]);
    work.imf("recipe run single --set network.widht=3 --out out").refused(&["widht"]);
    work.imf("recipe run single --set network.width --out out").refused(&["KEY=VALUE"]);
    work.imf("recipe run multi --set stage.fine.training.batch=3 --out out").refused(&["no stage 'fine'"]);
    work.write("old.toml", b"version = 7\nname = 'x'\n");
    work.imf("recipe run old.toml --out out").refused(&["version 7", "newer"]);
    assert!(!work.path("out").exists(), "a refusal left a folder behind");
}
