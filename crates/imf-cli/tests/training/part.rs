//! `imf train` of a part: one command does what the commands of its family do one by one, and goes on where it stopped.

use imf_core::factored::file::FactoredFile;
use serde_json::json;

use crate::binary::Workdir;

/// The bracket on 675 voxels, and a network that a step of teaching takes a millisecond or two.
const PART: &str = "bracket --dims 5,15,9";
const LESSON: &str = "--width 32 --layers 2 --batch 128 --rate 4e-3";

/// An arm that stands off the axis: how the tool is rolled matters.
const ARM: &str = "v -6 -6 0\nv 40 -6 0\nv -6 6 0\nv 40 6 0\nv -6 -6 40\nv 40 -6 40\nv -6 6 40\nv 40 6 40\nf 1 3 4\nf 1 4 2\n\
                   f 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\nf 2 8 6\n";

#[test]
fn a_part_becomes_the_field_that_fit_and_lesson_make_one_by_one() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 6 {LESSON} --steps 600 --out field --json");
    let made = work.imf(&train).done().json();
    assert_eq!(
        (&made["field"], &made["teacher"]["functions"]),
        (&json!("field/field.safetensors"), &json!(49))
    );

    // All axes, as many as there may be.
    let all = format!("--axes {} --single --no-calibrate", usize::MAX);
    work.imf(&format!("field {PART} --method harmonic --degree 6 {all} --save harmonic.safetensors")).done();
    work.imf(&format!("compress harmonic.safetensors {LESSON} --steps 600 --out apart")).done();
    for file in ["field.safetensors", "teaching.safetensors"] {
        assert!(work.bytes(&format!("field/{file}")) == work.bytes(&format!("apart/{file}")), "{file}");
    }

    let eval = "eval field/field.safetensors --random 8 --imf fibonacci:20 --json";
    let row = &work.imf(eval).done().json()["rows"][2];
    let [mse, variance] = ["mse", "variance"].map(|name| row[name].as_f64().unwrap());
    // The teacher, of a low degree, has half of that error itself.
    assert!(mse < 0.4 * variance, "{row}");
    work.write("poses.csv", b"x,y,z,i,j,k\n24,70,40,0,0,1\n");
    let answers = work.imf("query field/field.safetensors poses.csv --json").done().json();
    assert!(answers[0]["overlap"].as_f64().is_some_and(|value| (0.0..=1.0).contains(&value)), "{answers}");

    // Weights kept in f16 are half the file.
    work.imf(&format!("{train} --half").replace("--out field", "--out half")).done();
    let [whole, half] =
        ["field", "half"].map(|folder| work.bytes(&format!("{folder}/field.safetensors")).len());
    assert!(half < whole, "{half} of {whole} bytes");
}

#[test]
fn left_to_itself_it_takes_the_degree_that_suits_the_tool() {
    let work = Workdir::new();
    work.write("arm.obj", ARM.as_bytes());
    work.write("arm.toml", b"name = \"arm\"\nmesh = \"arm.obj\"\n");
    // As many functions of whole rotations as of directions, nearly.
    for (tool, degree, functions) in [("paper", 16, 289), ("arm.toml", 5, 286)] {
        work.imf(&format!("train {PART} --tool {tool} --steps 1 --out {degree}")).done();
        let file = FactoredFile::read(&work.path(&format!("{degree}/field.safetensors"))).unwrap();
        assert_eq!((file.fit.degree, file.report.functions), (degree, functions), "{tool}");
        assert_eq!((file.settings.width, file.settings.hidden, file.settings.omega), (256, 3, 20.0));
        // Every function is taught.
        assert!(file.report.dropped <= 0.0, "{}", file.report.dropped);
    }
}

#[test]
#[cfg(unix)]
fn an_interrupted_part_goes_on_to_the_bytes_of_one_in_one_go() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 4 {LESSON} --steps 4000 --checkpoint-every 0.02");
    work.imf(&format!("{train} --out whole")).done();
    // A folder of the part's name is not the part.
    let begin = format!("{train} --out bracket");
    work.imf(&format!("{begin} --resume")).refused(&["nothing to resume", "bracket/teaching.safetensors"]);
    work.interrupted_once_there_is("bracket/teaching.safetensors", &begin)
        .interrupted(&["the checkpoint is bracket/teaching.safetensors", "--resume"]);
    assert!(!work.path("bracket/field.safetensors").exists());
    work.imf(&begin).refused(&["bracket/teaching.safetensors", "unfinished", "--resume"]);
    work.imf(&format!("{begin} --resume --degree 5").replace("--degree 4", ""))
        .refused(&["another harmonic field"]);
    work.imf(&format!("{begin} --resume")).done();
    for file in ["field.safetensors", "teaching.safetensors"] {
        assert!(work.bytes(&format!("whole/{file}")) == work.bytes(&format!("bracket/{file}")), "{file}");
    }
}

#[test]
#[cfg(unix)]
fn sections_alone_teach_a_part_and_go_on_where_they_stopped() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 4 {LESSON} --online 30 --checkpoint-every 0.02 --steps");
    let made = work.imf(&format!("{train} 1500 --out whole --json")).done().json();
    assert_eq!(made["settings"]["online"]["pool"], json!(30));
    let eval = "eval whole/field.safetensors --random 8 --imf fibonacci:20 --json";
    let row = &work.imf(eval).done().json()["rows"][2];
    let [mse, variance] = ["mse", "variance"].map(|name| row[name].as_f64().unwrap());
    // What degree 4 leaves out is most of it.
    assert!(mse < 0.5 * variance, "{row}");

    let begin = format!("{train} 1500 --out part");
    work.interrupted_once_there_is("part/teaching.safetensors", &begin)
        .interrupted(&["the checkpoint is part/teaching.safetensors", "--resume"]);
    work.imf(&format!("{begin} --resume").replace("--online 30", "")).refused(&["other settings"]);
    work.imf(&format!("{begin} --resume")).done();
    assert!(work.bytes("whole/field.safetensors") == work.bytes("part/field.safetensors"));
}

#[test]
fn a_fit_in_two_passes_is_gone_on_with_as_one_in_one() {
    let work = Workdir::new();
    let train = format!("train {PART} --width 16 --layers 1 --batch 32 --steps 1 --out field");
    // Between what sections take that stay in memory and what they take that are counted again: all 384 of them.
    let twice = work.imf(&format!("{train} --memory 6200KiB")).done();
    assert!(twice.stderr.contains("784 sections in"), "{}", twice.stderr);
    for limit in ["--memory 6200KiB", ""] {
        work.imf(&format!("{train} --resume {limit}")).done();
    }
}

#[test]
fn the_papers_network_of_a_part_is_that_of_its_dataset() {
    let work = Workdir::new();
    let network = "--device cpu --width 24 --layers 3 --omega 10 --rate 1e-3 --batch 256 --steps 40 --seed 3";
    let train = format!("train {PART} --family siren5 {network} --density 0.5 --out model");
    let trained = work.imf(&format!("{train} --json")).done().json();
    assert_eq!((&trained["model"], &trained["steps"]), (&json!("model/model.safetensors"), &json!(40)));

    let dataset = "--orientations fibonacci:225 --density 0.5 --seed 3 --out data";
    work.imf(&format!("dataset {PART} {dataset}")).done();
    work.imf(&format!("train data {network} --out apart")).done();
    for file in ["manifest.json", "shard-00000.safetensors"] {
        assert!(
            work.bytes(&format!("model/dataset/{file}")) == work.bytes(&format!("data/{file}")),
            "{file}"
        );
    }
    let [mut model, apart] =
        ["model", "apart"].map(|folder| work.model(&format!("{folder}/model.safetensors")));
    // The clock alone may differ.
    model.record.seconds = apart.record.seconds;
    assert!(model == apart, "another model");

    // What is sampled is taken as it is, and what is finished is not gone on with.
    let again = work.imf(&train).done();
    assert!(again.stderr.contains("0 shards made, 1 kept"), "{}", again.stderr);
    work.imf(&format!("{train} --resume")).refused(&["model/checkpoint.safetensors", "finished"]);
    work.imf(&train.replace("0.5", "0.4")).refused(&["model/dataset", "another dataset"]);
}

#[test]
fn options_of_the_other_family_and_subjects_that_are_none_are_refused_by_name() {
    let work = Workdir::with_dataset();
    std::fs::create_dir(work.path("empty")).unwrap();
    let of_siren = ["is of --family siren5", "a factored field is asked for"];
    let of_factored = ["is of --family factored", "siren5 is asked for"];
    let of_part = ["is of a part", "made with its own"];
    for (line, option, words) in [
        ("bracket", "--precision bf16", of_siren),
        ("bracket", "--schedule exponential", of_siren),
        ("bracket", "--held-out 7", of_siren),
        ("bracket", "--orientations grid:4", of_siren),
        // Given is given, though it is what it would be anyway.
        ("bracket", "--density 0.35", of_siren),
        ("bracket --family siren5", "--degree 8", of_factored),
        ("bracket --family siren5", "--half", of_factored),
        ("bracket --family siren5", "--online", of_factored),
        ("data", "--adam", of_factored),
        ("data", "--pitch 2", of_part),
        ("data", "--tool paper", of_part),
        ("data", "--clearance 1", of_part),
        ("data", "--contact 1", of_part),
        ("data", "--density 0.2", of_part),
        ("data", "--family factored", ["data is a dataset", "give the part"]),
        ("bracket --family siren5", "--orientations so3:8", ["so3:8", "rolls"]),
        ("nowhere", "--steps 1", ["nowhere is neither a part", "nor the folder of a dataset"]),
        ("empty", "--steps 1", ["empty is neither a part", "nor the folder of a dataset"]),
        ("bracket", "--width 0", ["neurons", "of 0"]),
        ("bracket", "--memory 1MiB", ["MiB of memory", "--pitch"]),
    ] {
        let (name, _) = option.split_once(' ').unwrap_or((option, ""));
        let refused = work.imf(&format!("train {line} {option} --out model")).refused(&words);
        let own = words[0].starts_with("is of");
        assert!(!own || refused.stderr.contains(&format!("{name} is of")), "{name}: {}", refused.stderr);
        assert!(!work.path("model").exists(), "{line} {option} left a folder behind");
    }
}
