//! `imf train` of a part: one command does what the commands of its family do one by one, and goes on where it stopped.

use imf_fields::factored::file::FactoredFile;
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

    // Gone on with, it keeps its rate where none is asked for.
    work.imf(&train.replace("--rate 4e-3", "--resume")).done();
    work.imf(&train.replace("--rate 4e-3", "--rate 3e-3 --resume")).refused(&["not 0.003"]);

    // Weights kept in f16 are half the file.
    work.imf(&format!("{train} --half").replace("--out field", "--out half")).done();
    let [whole, half] =
        ["field", "half"].map(|folder| work.bytes(&format!("{folder}/field.safetensors")).len());
    assert!(half < whole, "{half} of {whole} bytes");
}

#[test]
fn symmetry_is_found_told_and_kept_unless_none_is_asked_for() {
    let work = Workdir::new();
    let train =
        |more: &str| work.imf(&format!("train teapot --dims 15,19,31 --degree 5 {LESSON} --steps 60 {more}"));
    let said = train("--out told").done();
    assert!(said.stderr.contains("told of symmetry: mirrored across y, turned about x"), "{}", said.stderr);
    train("--symmetry none --out plain").done();
    let symmetry = |folder: &str| {
        let info = work.imf(&format!("info {folder}/field.safetensors --json")).done().json();
        info["network"]["symmetry"].clone()
    };
    assert_eq!((symmetry("told")["axis"]["along"].as_u64(), symmetry("plain")), (Some(0), json!(null)));
    let info = work.imf("info told/field.safetensors").done();
    assert!(info.stdout.contains("mirrored across y, turned about x"), "{}", info.stdout);

    // It is settled where a teaching begins: gone on with, and handed on to a changed part.
    train("--out told --resume").done();
    train("--out told --resume --symmetry none").refused(&["told/teaching.safetensors", "symmetry"]);
    work.imf("field teapot --dims 16,20,32 --method harmonic --degree 5 --save other.safetensors").done();
    work.imf("compress other.safetensors --from told/field.safetensors --steps 5 --out tuned").done();
    assert_eq!(symmetry("tuned"), symmetry("told"));

    // Fields that leave functions out tell of it too, sections do not.
    let few = "field teapot --dims 15,19,31 --method harmonic --degree 5 --axes 20 --save few.safetensors";
    work.imf(few).done();
    work.imf("compress few.safetensors --from told/field.safetensors --steps 5 --out few").done();
    let both = "compress few.safetensors --from told/field.safetensors --symmetry none --out no";
    assert!(work.imf(both).stderr.contains("--symmetry"));
    let both = train("--online 40 --symmetry auto --out no");
    both.refused(&["--symmetry auto", "--online", "leave out one of them"]);
    let by_sections = train("--online 40 --out by-sections").done().stdout;
    // Nothing but sections teaches, and nothing else is named.
    assert!(by_sections.contains("MSE from exact sections in the last steps"), "{by_sections}");
    let info = work.imf("info by-sections/field.safetensors").done().stdout;
    let teacher = info.lines().find(|line| line.starts_with("teacher")).unwrap();
    assert!(
        teacher.contains("fresh exact sections, 40 at a time") && !teacher.contains("harmonic"),
        "{teacher}"
    );
    assert!(!by_sections.contains("its teacher"), "{by_sections}");
    assert_eq!((symmetry("few"), symmetry("by-sections")), (symmetry("told"), json!(null)));
}

#[test]
fn a_teaching_from_another_field_has_rates_of_its_own_and_is_resumed_by_them() {
    let work = Workdir::new();
    work.imf("field teapot --dims 15,19,31 --method harmonic --degree 4 --save field.safetensors").done();
    let network = "--width 16 --layers 2";
    work.imf(&format!("compress field.safetensors {network} --steps 5 --out small")).done();
    let from = "--from small/field.safetensors";
    let solve_every = |line: &str| {
        let report = work.imf(&format!("compress field.safetensors --steps 5 --json {line}")).done().json();
        report["settings"]["solve_every"].as_u64()
    };
    assert_eq!(solve_every(&format!("{network} --out plain")), Some(25));
    for (out, rate) in [("own", ""), ("given", "--rate 1e-4")] {
        assert_eq!(solve_every(&format!("{from} {rate} --out {out}")), Some(10));
        for start in [from, network] {
            let resume = format!("{start} --out {out} --resume");
            assert_eq!(solve_every(&format!("{resume} {rate}")), Some(10));
            work.imf(&format!("compress field.safetensors --steps 5 {resume} --rate 2e-4"))
                .refused(&["initial", "not 0.0002"]);
        }
    }
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
    let resume = format!("{begin} --resume");
    // Before a fit of minutes.
    for (given, other, words) in [
        ("--degree 4", "--degree 5", "other sections (degree: 4, not 5)"),
        ("--steps 4000", "--steps 4001", "other settings (steps: 4000, not 4001)"),
        ("--dims 5,15,9", "--dims 6,15,9", "another scene"),
    ] {
        let refused =
            work.imf(&resume.replace(given, other)).refused(&[words, "bracket/teaching.safetensors"]);
        assert!(!refused.stderr.contains("sections to fit"), "{}", refused.stderr);
    }
    work.imf(&resume).done();
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
    let without = format!("{begin} --resume").replace("--online 30", "");
    let refused = work.imf(&without).refused(&["other settings (online: {", "not none)"]);
    assert!(!refused.stderr.contains("sections to fit"), "{}", refused.stderr);
    work.imf(&format!("{begin} --resume")).done();
    assert!(work.bytes("whole/field.safetensors") == work.bytes("part/field.safetensors"));
}

#[test]
#[cfg(unix)]
fn a_fit_in_two_passes_is_gone_on_with_as_one_in_one() {
    let work = Workdir::new();
    let train = format!("train {PART} --width 16 --layers 1 --batch 32 --steps 100000 --out field");
    // Between what sections take that stay in memory and what they take that are counted again: all 384 of them.
    let twice = work.interrupted_once_it_says("teaching 3→", &format!("{train} --memory 6305KiB"));
    assert!(twice.stderr.contains("784 sections in"), "{}", twice.stderr);
    for (limit, sections) in [("--memory 6305KiB", "784 sections in"), ("", "400 sections in")] {
        let on = work.interrupted_once_it_says("teaching 3→", &format!("{train} --resume {limit}"));
        assert!(on.stderr.contains(sections), "{}", on.stderr);
    }
}

#[test]
fn what_is_finished_says_so_at_once_and_where_it_is() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 4 {LESSON} --steps 40 --out field");
    work.imf(&train).done();
    let field = "field/field.safetensors";
    let made = work.bytes(field);
    let resumed = |more: &str| {
        let again = work.imf(&format!("{train} --resume --json {more}")).done();
        assert!(again.stderr.contains("field/teaching.safetensors is finished"), "{}", again.stderr);
        assert!(!again.stderr.contains("sections to fit"), "{}", again.stderr);
        assert_eq!(again.json()["field"], json!(field));
        again.stderr.contains("; wrote field/field.safetensors")
    };
    assert!(!resumed(""), "a field was written once more");
    // What its decisions are worth was measured afterwards, and stays.
    work.imf(&format!("calibrate {field} --poses 4096 --boundary 1024 --false-free 0.1")).done();
    let calibrated = work.bytes(field);
    assert!(!resumed("") && work.bytes(field) == calibrated);
    // A field that is gone, or another teaching's, comes from the checkpoint.
    std::fs::remove_file(work.path(field)).unwrap();
    assert!(resumed("") && work.bytes(field) == made);
    let other = train.replace("--out field", "--out other --seed 1");
    work.imf(&other).done();
    work.write(field, &work.bytes("other/field.safetensors"));
    assert!(resumed("") && work.bytes(field) == made);
    // In the other precision too, and then it is there.
    assert!(resumed("--half") && work.bytes(field).len() < made.len() && !resumed("--half"));
}

#[test]
fn a_folder_with_the_other_familys_training_is_told_apart() {
    let work = Workdir::new();
    let factored = format!("train {PART} --degree 4 {LESSON} --steps 2");
    let siren =
        format!("train {PART} --family siren5 --device cpu --width 16 --layers 2 --steps 2 --density 0.3");
    work.imf(&format!("{factored} --out factored")).done();
    work.imf(&format!("{siren} --out siren")).done();
    let nothing = "nothing to resume";
    let of_siren = ["siren/teaching.safetensors", "siren/checkpoint.safetensors", "--family siren5 --resume"];
    let of_factored =
        ["factored/checkpoint.safetensors", "factored/teaching.safetensors", "--family factored --resume"];
    let refused = |line: &str, words: [&str; 3]| {
        let refused = work.imf(&format!("{line} --resume")).refused(&[&[nothing], &words[..]].concat());
        let worked =
            ["sampling", "sections to fit", "solid voxels"].map(|work| refused.stderr.contains(work));
        assert_eq!(worked, [false; 3], "{}", refused.stderr);
    };
    refused(&format!("{factored} --out siren"), of_siren);
    refused(&format!("{siren} --out factored"), of_factored);
    refused("train siren/dataset --out factored", of_factored);
    refused("finetune siren/model.safetensors siren/dataset --out factored", of_factored);
    work.imf(&format!(
        "field {PART} --method harmonic --degree 4 --no-calibrate --save harmonic.safetensors"
    ))
    .done();
    refused("compress harmonic.safetensors --out siren", of_siren);
}

#[test]
fn memory_is_asked_for_before_functions_are_chosen() {
    let work = Workdir::new();
    // Of what 1000 sections make of a batch; the choice alone would fit.
    let train = format!("train {PART} {LESSON} --online 1000 --memory 16MiB --out field");
    let refused = work.imf(&train).refused(&["the sections and the network", "--online"]);
    assert!(!refused.stderr.contains("functions:"), "{}", refused.stderr);
    // And the choice by itself, though few sections teach.
    work.imf(&train.replace("1000 --memory 16MiB", "2 --memory 4MiB"))
        .refused(&["the sections and the network"]);
}

#[test]
#[cfg(unix)]
fn a_pool_that_fills_heeds_ctrl_c_between_two_sections() {
    let work = Workdir::new();
    // A thousand sections take seconds.
    let train = "train bracket --dims 24,73,43 --degree 2 --width 16 --layers 1 --online 1000 --out field";
    work.interrupted_once_it_says("teaching 3→", train)
        .interrupted(&["the checkpoint is field/teaching.safetensors", "--resume"]);
    let file = FactoredFile::read(&work.path("field/teaching.safetensors")).unwrap();
    // The first report would be at step 20.
    assert_eq!(file.state.unwrap().training.step, 0, "the pool was filled first");
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
    work.imf(&train.replace("0.5", "0.4")).refused(&["model/dataset", "another dataset"]);
    let resume = format!("{train} --resume --json");
    // No sample is needed for what is known without.
    std::fs::remove_dir_all(work.path("model/dataset")).unwrap();
    for other in [resume.replace("0.5", "0.4"), resume.replace("5,15,9", "6,15,9")] {
        work.imf(&other).refused(&["model/checkpoint.safetensors", "another dataset"]);
    }
    for wrote in [false, true] {
        let over = work.imf(&resume).done();
        assert!(over.stderr.contains("model/checkpoint.safetensors is finished"), "{}", over.stderr);
        assert_eq!(over.json()["model"], json!("model/model.safetensors"));
        assert_eq!(over.stderr.contains("wrote model/model.safetensors"), wrote, "{}", over.stderr);
        let again = work.model("model/model.safetensors");
        assert!(again.state == apart.state, "another model");
        std::fs::remove_file(work.path("model/model.safetensors")).unwrap();
    }
    assert!(!work.path("model/dataset").exists(), "samples were made");
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
        ("data", "--optimiser adam", of_factored),
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
