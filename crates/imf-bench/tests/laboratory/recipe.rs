//! Recipes by the real binary: a tiny one of each kind from nothing to its report, killed and continued, and refused.

use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::binary::Workdir;
use crate::shapes::cuboid;

/// A built-in recipe with the part at about a seventh of its grid, a network that a step takes well under a millisecond, and few questions.
fn tiny(recipe: &str, more: &str) -> String {
    format!(
        "recipe run {recipe} --scale 0.14 --device cpu --set network.width=24 --set network.layers=3 --set network.omega=10 \
         --set stage.*.training.batch=128 --set evaluation.random=4 --set evaluation.imf=[\"grid:3\",\"grid:4\"] \
         --set stage.*.training.schedule.initial=1e-3 {more}"
    )
}

/// The same with few sections, in stages that have a fixed set, and so many steps.
fn few(recipe: &str, steps: u64, more: &str) -> String {
    let sections = "--set stage.*.orientations=fibonacci:12";
    tiny(recipe, &format!("{sections} --set stage.*.training.length={{steps={steps}}} {more}"))
}

/// A sweep of two small networks, and of what follows them.
fn sweep(more: &str) -> String {
    let variant = |name: &str, width: u32| format!("{{name=\"{name}\",set={{\"network.width\"={width}}}}}");
    let variants = format!("--set variant=[{},{}{more}] --out out", variant("a", 8), variant("b", 16));
    few("architecture", 40, &variants)
}

/// MSE of a result's answer whose name ends so.
fn mse(summary: &Value, stage: &str, name: &str) -> f64 {
    let results = summary["runs"][0]["results"].as_array().unwrap();
    let result = results.iter().find(|result| result["stage"] == stage).unwrap();
    let answers = result["answers"].as_array().unwrap();
    let answer = answers.iter().find(|answer| answer["name"].as_str().unwrap().ends_with(name)).unwrap();
    answer["mse"].as_f64().unwrap()
}

/// Kills the command each time its checkpoint has changed, `times` times, then lets it come to its end.
fn killed(work: &Workdir, line: &str, checkpoint: &str, times: usize) {
    let mut kills = 0;
    let changed_at = || std::fs::metadata(work.path(checkpoint)).and_then(|m| m.modified()).ok();
    for round in 0..times {
        let before = changed_at();
        let mut child = work.command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        let changed = || changed_at().is_some_and(|now| Some(now) != before);
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
    for name in ["single", "multi", "transfer", "sparsity", "architecture"] {
        assert!(list.lines().any(|line| line.starts_with(name)), "{name} in\n{list}");
        let shown = work.imf(&format!("recipe show {name}")).done().stdout;
        let file = format!("{}/recipes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        assert_eq!(shown, std::fs::read_to_string(file).unwrap());
    }
}

#[test]
fn single_from_a_file_of_ones_own_has_a_folder_of_its_own() {
    let work = Workdir::new();
    let shown = work.imf("recipe show single").done().stdout;
    work.write("mine.toml", shown.replace("name = \"single\"", "name = \"mine\""));
    let line = few("mine.toml", 300, "--part bracket --out out");
    let summary = work.json(&line);
    assert_eq!(
        (&summary["recipe"], &summary["runs"][0]["stages"][0]["part"]),
        (&"mine".into(), &"bracket".into())
    );
    for file in ["loss.png", "stages/main/sections.png", "stages/main/loss.png"] {
        work.picture(&format!("out/{file}"));
    }
    for file in ["recipe.toml", "recipe.md", "stages/main/report.md"] {
        assert!(!work.text(&format!("out/{file}")).is_empty());
    }
    let log = work.text("out/stages/main/log.jsonl");
    let last: Value = serde_json::from_str(log.lines().last().unwrap()).unwrap();
    assert_eq!(last["step"], 300, "{log}");
    let model = work.model("out/model.safetensors");
    assert_eq!((model.record.steps, model.shape.width), (300, 24));
    assert!(model.state == work.model("out/stages/main/field.safetensors").state);

    // The same again finds everything done, another recipe is refused, and what was written down repeats it.
    let before = work.text("out/recipe.json");
    let again = work.imf(&line).done();
    assert!(again.stderr.contains("finished already: 300 steps"), "{}", again.stderr);
    assert!(again.stderr.contains("main: kept"), "{}", again.stderr);
    for (change, words) in [
        ("--set network.seed=2", ["seed = 0 there, seed = 2 here", "--out"]),
        ("--set stage.main.training.length={steps=301}", ["steps = 300", "steps = 301"]),
        ("--set about=other", ["about = \"other\" here", "remove it"]),
    ] {
        work.imf(&format!("{line} {change}")).refused(&words);
    }
    assert_eq!(work.text("out/recipe.json"), before, "a refusal changed something");
    work.imf("recipe run out/recipe.toml --device cpu --out repeated").done();
    assert!(work.model("repeated/model.safetensors").state == model.state, "not repeated");
    assert!(work.path("repeated/stages/main/log.jsonl").exists(), "every training writes its log");
}

#[test]
fn multi_goes_on_after_sigkill_in_either_stage_to_the_same_bits() {
    let work = Workdir::new();
    let multi = |out: &str| few("multi", 700, &format!("--checkpoint-every 0.01 --out {out}"));
    work.imf(&multi("whole")).done();
    let [coarse, full] =
        ["coarse", "full"].map(|s| work.model(&format!("whole/stages/{s}/field.safetensors")));
    assert_eq!(coarse.scene, full.scene, "both stages' networks speak of the full grid");
    assert!(full.record.fine_tuned_from.as_ref().unwrap().contains("stage coarse"));
    let summary = work.read_json("whole/recipe.json");
    let voxels = |i: usize| {
        let dims = summary["runs"][0]["stages"][i]["dims"].as_array().unwrap();
        dims.iter().map(|d| d.as_u64().unwrap()).product::<u64>()
    };
    assert!(voxels(0) < voxels(1) / 2, "{} and {} voxels", voxels(0), voxels(1));

    killed(&work, &multi("broken"), "broken/stages/coarse/checkpoint.safetensors", 2);
    for (stage, whole) in [("coarse", coarse), ("full", full.clone())] {
        let broken = work.model(&format!("broken/stages/{stage}/field.safetensors"));
        assert!(broken.state == whole.state, "stage {stage} ended elsewhere");
    }
    killed(&work, &multi("late"), "late/stages/full/checkpoint.safetensors", 2);
    assert!(work.model("late/model.safetensors").state == full.state, "the second stage ended elsewhere");
}

#[test]
fn a_transferred_network_is_better_than_one_from_random_weights() {
    let work = Workdir::new();
    let more = "--set stage.raw.training.length={steps=2000} --set stage.adapted.training.schedule.initial=5e-4 \
                --out out --json";
    let summary = work.imf(&few("transfer", 150, more)).done().json();
    for question in ["random sections", "IMF over 16"] {
        let [adapted, control] = ["adapted", "control"].map(|stage| mse(&summary, stage, question));
        // The frame has little of its box: measured 0.56 at random sections.
        assert!(adapted < 0.75 * control, "{question}: {adapted:e} adapted, {control:e} from random weights");
    }
    let text = work.text("out/recipe.md");
    assert!(text.contains("| adapted | ") && text.contains("| control | "), "{text}");
    let stages = summary["runs"][0]["stages"].as_array().unwrap();
    let parts: Vec<&str> = stages.iter().map(|s| s["part"].as_str().unwrap()).collect();
    assert_eq!(parts, ["bracket-raw", "bracket", "bracket"]);
}

#[test]
fn a_sweep_runs_its_variants_once_and_tabulates_them() {
    let work = Workdir::new();
    // Five networks of the paper's size would take minutes; the variants' own values come last.
    for (line, expected) in [
        (few("sparsity", 40, "--out sparsity"), 3),
        (sweep("").replace("--out out", "--out architecture"), 2),
    ] {
        let name = if expected == 3 { "sparsity" } else { "architecture" };
        let all = work.json(&line);
        let runs = all["runs"].as_array().unwrap();
        assert_eq!(runs.len(), expected);
        let table = work.text(&format!("{name}/recipe.md"));
        for run in runs {
            let variant = run["variant"].as_str().unwrap();
            assert!(table.contains(&format!("| {variant}, main | ")), "{table}");
            assert!(work.path(&format!("{name}/{variant}/model.safetensors")).exists());
        }
        work.picture(&format!("{name}/loss.png"));
        // A variant that is gone is run again, the others are kept.
        let first = runs[0]["variant"].as_str().unwrap();
        std::fs::remove_dir_all(work.path(&format!("{name}/{first}"))).unwrap();
        let again = work.imf(&line).done();
        assert_eq!(
            again.stderr.matches("finished already: 40 steps").count(),
            expected - 1,
            "{}",
            again.stderr
        );
    }
    let summary = work.read_json("sparsity/recipe.json");
    let samples = [0, 1, 2].map(|i| summary["runs"][i]["stages"][0]["samples"].as_u64().unwrap());
    assert!(samples[1] > 3 * samples[0] && samples[2] > samples[1], "10, 35 and 50 %: {samples:?}");
}

#[test]
fn wrong_recipes_are_refused_before_the_first_training() {
    let work = Workdir::new();
    work.write("old.toml", b"version = 7\nname = 'x'\n");
    let variant_c = |set: &str| sweep(&format!(",{{name=\"c\",set={{{set}}}}}"));
    let transfer = few("transfer", 40, "--out out --set stage.adapted.part=braket");
    // 1,056,769 parameters at 64 bytes.
    let large = variant_c("\"network.width\"=512,\"network.layers\"=5") + " --memory 60MB";
    for (line, words) in [
        ("recipe show nothing", &["no recipe 'nothing'", "single, multi, transfer"][..]),
        ("recipe run nowhere.toml --out out", &["nowhere.toml", "imf-bench recipe list"]),
        ("recipe run single --set network.widht=3 --out out", &["widht"]),
        ("recipe run old.toml --out out", &["version 7", "newer"]),
        (&transfer, &["stage adapted", "braket"]),
        (&variant_c("\"scene.tool\"=\"no-such-tool.toml\""), &["variant c, stage main", "no-such-tool.toml"]),
        (&large, &["variant c, stage main", "network.width", "1056769", "--memory"]),
    ] {
        work.imf(line).refused(words);
    }
    assert!(!work.path("out").exists(), "a refusal left a folder behind");
}

#[test]
fn a_model_of_another_training_or_of_a_newer_program_is_not_overwritten() {
    let work = Workdir::new();
    // Only its voxels differ.
    let mesh = |height| cuboid([0; 3], [30, 30, height], 0);
    work.write("box.obj", mesh(24));
    let line = few("single", 40, "--part box.obj --set scene.pitch=6 --set scene.scale=1 --out out");
    work.imf(&line).done();
    let file = "out/stages/main/field.safetensors";
    let mut model = work.bytes(file);
    work.write("box.obj", mesh(36));
    work.imf(&line).refused(&["part, grid or tool", "--out", "remove out/stages/main"]);
    assert_eq!(work.bytes(file), model);

    work.write("box.obj", mesh(24));
    let (version, newer) = (br#"\"version\":1"#, br#"\"version\":9"#);
    let at = model.windows(version.len()).position(|window| window == version).unwrap();
    model[at..at + newer.len()].copy_from_slice(newer);
    work.write(file, &model);
    std::fs::remove_file(work.path("out/stages/main/checkpoint.safetensors")).unwrap();
    work.imf(&line).refused(&[file, "version 9", "newer imf"]);
    assert_eq!(work.bytes(file), model);
}
