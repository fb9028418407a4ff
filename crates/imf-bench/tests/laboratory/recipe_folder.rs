//! A recipe's folder: what is found before the first training, what a changed recipe keeps there, and what it refuses to
//! overwrite; the counters and logs of its stages.

use serde_json::Value;

use crate::binary::Workdir;

/// A part at about a seventh of its grid, a small network, few questions.
const TINY: &str = "--scale 0.14 --device cpu --set network.width=24 --set network.layers=3 --set network.omega=10 \
                    --set stage.*.training.batch=128 --set evaluation.random=4 --set evaluation.imf=[\"grid:3\"]";
const FEW: &str = "--set stage.*.orientations=fibonacci:12 --set stage.*.training.length={steps=40}";

fn transfer() -> String {
    format!("recipe run transfer {TINY} {FEW} --out out")
}

/// A sweep of two small variants, and of what follows them.
fn sweep(more: &str) -> String {
    format!(
        "recipe run architecture {TINY} {FEW} --out out --set \
         variant=[{{name=\"a\",set={{\"network.width\"=8}}}},{{name=\"b\",set={{\"network.width\"=16}}}}{more}]"
    )
}

fn json(work: &Workdir, file: &str) -> Value {
    serde_json::from_str(&work.text(file)).unwrap()
}

/// How often something was said.
fn said(stderr: &str, what: &str) -> usize {
    stderr.matches(what).count()
}

#[test]
fn a_slip_in_a_later_stage_or_variant_is_found_before_the_first_training() {
    let work = Workdir::new();
    let line = transfer();
    work.imf(&format!("{line} --set stage.adapted.part=braket")).refused(&["stage adapted", "braket"]);
    let wrong = sweep(",{name=\"c\",set={\"scene.tool\"=\"no-such-tool.toml\"}}");
    work.imf(&wrong).refused(&["variant c, stage main", "no-such-tool.toml"]);
    assert!(!work.path("out").exists(), "a refusal left a folder behind");
}

#[test]
fn memory_is_asked_for_every_variant_before_the_first_training() {
    let work = Workdir::new();
    // 1,056,769 parameters at 64 bytes.
    let line = sweep(",{name=\"c\",set={\"network.width\"=512,\"network.layers\"=5}}");
    work.imf(&format!("{line} --memory 60MB")).refused(&[
        "variant c, stage main",
        "network.width",
        "1056769",
        "--memory",
    ]);
    assert!(!work.path("out").exists(), "a refusal left a folder behind");
}

#[test]
fn a_changed_recipe_keeps_the_stages_that_are_the_same_and_overwrites_none() {
    let work = Workdir::new();
    let line = transfer();
    work.imf(&line).done();
    let [raw, control] = ["raw", "control"].map(|s| work.bytes(&format!("out/stages/{s}/field.safetensors")));
    let summary = work.text("out/recipe.json");

    // A stage that was trained is named, with those that started from it, and how to go on.
    let adapted = format!("{line} --set stage.adapted.training.length={{steps=60}}");
    let refused =
        work.imf(&adapted).refused(&["stage adapted (training)", "--out", "remove out/stages/adapted"]);
    assert!(!refused.stderr.contains("stage control") && !refused.stderr.contains("stage raw ("));
    work.imf(&format!("{line} --set stage.raw.training.seed=3")).refused(&[
        "stage raw (training)",
        "stage adapted (settings of its start)",
        "remove out/stages/raw and out/stages/adapted",
    ]);
    work.imf(&format!("{line} --set network.seed=2")).refused(&["stage raw (network)", "stage control"]);
    assert_eq!(work.text("out/recipe.json"), summary, "a refusal changed something");

    // The same of a folder in which an older program wrote no settings beside the stages.
    for stage in ["raw", "adapted", "control"] {
        std::fs::remove_file(work.path(&format!("out/stages/{stage}/settings.json"))).unwrap();
    }
    work.imf(&adapted).refused(&["stage adapted (training)"]);
    std::fs::remove_dir_all(work.path("out/stages/adapted")).unwrap();
    let done = work.imf(&adapted).done();
    assert_eq!(said(&done.stderr, "finished already: 40 steps"), 2, "{}", done.stderr);
    assert!(done.stderr.contains("finished stages with the same settings are kept"), "{}", done.stderr);
    assert_eq!(work.bytes("out/stages/raw/field.safetensors"), raw);
    assert_eq!(work.bytes("out/stages/control/field.safetensors"), control);
    assert_eq!(json(&work, "out/recipe.json")["stages"][1]["steps"], 60);
    assert!(work.text("out/recipe.toml").contains("steps = 60"));
    // What the former recipe came to is put aside.
    assert_eq!(work.text("out/former/1/recipe.json"), summary);
    assert!(!work.text("out/former/1/recipe.toml").contains("steps = 60"));

    // A stage that was left out for a while is not forgotten.
    work.write(
        "out/recipe.toml",
        work.text("out/recipe.toml").replace("\"control\"", "\"other\"").as_bytes(),
    );
    work.imf(&format!("{adapted} --set stage.control.training.seed=5"))
        .refused(&["stage control (training)"]);
}

#[test]
fn weights_of_another_training_are_not_overwritten_whatever_the_settings_say() {
    let work = Workdir::new();
    let mesh = |height: f64| {
        // A box; only its voxels differ.
        let corner =
            |i: usize| format!("v {} {} {}\n", 30 * (i & 1), 30 * (i >> 1 & 1), height * (i >> 2) as f64);
        let faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"];
        (0..8).map(corner).collect::<String>() + &faces.map(|f| format!("f {f}\n")).concat()
    };
    work.write("box.obj", mesh(24.0).as_bytes());
    let line = format!(
        "recipe run single --part box.obj {TINY} {FEW} --set scene.pitch=6 --set scene.scale=1 --out out"
    );
    work.imf(&line).done();
    let model = work.bytes("out/stages/main/field.safetensors");
    work.write("box.obj", mesh(36.0).as_bytes());
    work.imf(&line).refused(&["stage main", "part, grid or tool", "--out", "remove out/stages/main"]);
    assert_eq!(work.bytes("out/stages/main/field.safetensors"), model);
}

#[test]
fn a_model_of_a_newer_program_is_not_overwritten() {
    let work = Workdir::new();
    let line = format!("recipe run single {TINY} {FEW} --out out");
    work.imf(&line).done();
    let file = "out/stages/main/field.safetensors";
    let (version, newer) = (br#"\"version\":1"#, br#"\"version\":9"#);
    let mut bytes = work.bytes(file);
    let at = bytes.windows(version.len()).position(|window| window == version).unwrap();
    bytes[at..at + newer.len()].copy_from_slice(newer);
    work.write(file, &bytes);
    std::fs::remove_file(work.path("out/stages/main/checkpoint.safetensors")).unwrap();
    work.imf(&line).refused(&[file, "version 9", "newer imf"]);
    assert_eq!(work.bytes(file), bytes);
}

#[cfg(unix)]
#[test]
fn an_unfinished_stage_is_kept_for_its_own_settings() {
    let work = Workdir::new();
    let line = format!(
        "recipe run single {TINY} --set stage.*.orientations=fibonacci:12 --set \
         stage.*.training.length={{steps=4000}} --checkpoint-every 0.01 --out out"
    );
    let checkpoint = "out/stages/main/checkpoint.safetensors";
    work.interrupted_after(5, &line).interrupted(&["to go on"]);
    let kept = work.bytes(checkpoint);
    work.imf(&format!("{line} --set stage.main.training.batch=64"))
        .refused(&["stage main (training)", "--out"]);
    work.imf(&format!("{line} --set stage.main.resolution=0.9"))
        .refused(&["stage main (resolution)", "--out"]);
    assert_eq!(work.bytes(checkpoint), kept);
    let done = work.imf(&format!("{line} --set about=\"said-otherwise\"")).done();
    assert!(done.stderr.contains("going on at epoch"), "{}", done.stderr);
}

#[test]
fn a_sweep_grows_by_a_variant_and_stale_summaries_are_no_results() {
    let work = Workdir::new();
    work.imf(&sweep("")).done();
    let model = work.bytes("out/a/stages/main/field.safetensors");
    let third = ",{name=\"c\",set={\"network.width\"=12}}";
    let grown = work.imf(&sweep(third)).done();
    assert_eq!(said(&grown.stderr, "finished already\n"), 2, "{}", grown.stderr);
    assert_eq!(json(&work, "out/sweep.json").as_array().unwrap().len(), 3);
    assert_eq!(json(&work, "out/former/1/sweep.json").as_array().unwrap().len(), 2);

    // Other words change nothing but the reports' own.
    let told = work.imf(&format!("{} --set about=\"said-otherwise\"", sweep(third))).done();
    assert_eq!(said(&told.stderr, "finished already\n"), 3, "{}", told.stderr);
    assert_eq!(json(&work, "out/a/recipe.json")["about"], "said-otherwise");
    assert!(work.text("out/a/recipe.md").contains("said-otherwise"));
    assert!(!work.path("out/a/former").exists());

    // Other questions are asked anew of the same networks.
    let asked = work.imf(&format!("{} --set evaluation.random=5", sweep(third))).done();
    assert_eq!(said(&asked.stderr, "finished already\n"), 0, "{}", asked.stderr);
    assert_eq!(said(&asked.stderr, "finished already: 40 steps"), 3, "{}", asked.stderr);
    assert!(work.text("out/a/recipe.json").contains("5 random sections"));
    assert!(work.text("out/a/former/1/recipe.json").contains("4 random sections"));
    assert_eq!(work.bytes("out/a/stages/main/field.safetensors"), model);

    // A variant with other settings is refused by name.
    let other = sweep("").replace("\"network.width\"=16", "\"network.width\"=20");
    work.imf(&format!("{other} --set evaluation.random=5"))
        .refused(&["variant b, stage main (network)", "out/b/"]);
}

#[cfg(unix)]
#[test]
fn the_waits_of_an_online_stage_are_those_of_all_its_runs() {
    let work = Workdir::new();
    let line = format!(
        "recipe run online {TINY} --set stage.main.online.pool=8 --set stage.main.training.length={{steps=1500}} \
         --checkpoint-every 0.01 --out out"
    );
    let checkpoint = "out/stages/main/checkpoint.safetensors";
    work.interrupted_after(5, &line).interrupted(&["to go on"]);
    let first = json(&work, "out/stages/main/waits.json");
    let count = |value: &Value, key: &str| value[key].as_u64().unwrap();
    assert!(count(&first, "sections") >= 8 && first["seconds"].as_f64().unwrap() > 0.0, "{first}");
    assert_eq!((count(&first, "begun"), count(&first, "counted")), (1, 1), "{first}");
    let done = work.imf(&format!("{line} --json")).done().json();
    let all = &done["stages"][0]["waits"];
    // 1,500 steps meet 1,507 sections, and the second run's pool was computed anew.
    assert!(count(all, "sections") >= 1507, "{all} after {first}");
    assert!(all["seconds"].as_f64() > first["seconds"].as_f64(), "{all} after {first}");
    assert_eq!((count(all, "begun"), count(all, "counted")), (2, 2), "{all}");
    let text = work.text("out/recipe.md");
    assert!(text.contains("sections were computed beside") && !text.contains("at least"), "{text}");
    let sentence =
        |text: &str| text.lines().find(|l| l.starts_with("Stage main:")).map(str::to_owned).unwrap();
    let once = sentence(&text);
    // Read again, a finished stage says the same.
    work.imf(&line).done();
    assert_eq!(sentence(&work.text("out/recipe.md")), once);

    // A run that was killed is in no sum, which is said.
    std::fs::remove_dir_all(work.path("out")).unwrap();
    let mut child = work.command(&line).stderr(std::process::Stdio::null()).spawn().unwrap();
    while !work.path(checkpoint).exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success(), "it was never killed in time");
    work.imf(&line).done();
    let text = work.text("out/recipe.md");
    assert!(text.contains("at least") && text.contains("1 of 2 runs ended without being counted"), "{text}");
}

#[test]
fn every_stage_has_its_log() {
    let work = Workdir::new();
    work.imf(&transfer()).done();
    for stage in ["raw", "adapted", "control"] {
        let log = work.text(&format!("out/stages/{stage}/log.jsonl"));
        let last: Value = serde_json::from_str(log.lines().last().unwrap()).unwrap();
        assert_eq!(last["step"], 40, "{stage}: {log}");
    }
}
