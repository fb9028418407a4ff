//! `imf train` of a part: one command does what the commands of its family do one by one, and goes on where it stopped.

use imf_core::control::Control;
use imf_fields::factored::file::FactoredFile;
use imf_fields::harmonic::file::HarmonicFile;
use serde_json::json;

use crate::binary::Workdir;
use crate::saved::HARMONIC;
use crate::shapes::cuboid;

/// The bracket on 675 voxels, and a network that a step takes a millisecond or two.
const PART: &str = "bracket --dims 5,15,9 --allow-coarse";
const NETWORK: &str = "--network 2x32 --set batch=128 --rate 4e-3 --no-calibrate";

#[test]
fn a_part_becomes_the_field_that_fit_and_distillation_make_one_by_one() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 6 {NETWORK} --steps 600 --out field --json");
    let made = work.imf(&train).done().json();
    assert_eq!(
        (&made["field"], &made["source"]["functions"]),
        (&json!("field/field.safetensors"), &json!(49))
    );

    // From the harmonic field that the library fits by the settings that the file says.
    let file = FactoredFile::read(&work.path("field/field.safetensors")).unwrap();
    let harmonic = HarmonicFile::fit(&file.scene, &file.fit, Control::quiet()).unwrap();
    harmonic.write(&work.path("harmonic.safetensors")).unwrap();
    work.imf(&format!("train factored harmonic.safetensors {NETWORK} --steps 600 --out apart")).done();
    for file in ["field.safetensors", "checkpoint.safetensors"] {
        assert!(work.bytes(&format!("field/{file}")) == work.bytes(&format!("apart/{file}")), "{file}");
    }

    work.calibrate_quickly("field/field.safetensors");
    let eval = "eval field/field.safetensors --random 8 --imf fibonacci:20 --json";
    let row = &work.imf(eval).done().json()["rows"][2];
    let [mse, variance] = ["mse", "variance"].map(|name| row[name].as_f64().unwrap());
    // The harmonic field, of a low degree, has half of that error itself.
    assert!(mse < 0.4 * variance, "{row}");
    work.write("poses.csv", b"x,y,z,i,j,k\n24,70,40,0,0,1\n");
    let answers = work.json("query field/field.safetensors poses.csv");
    assert!(answers[0]["overlap"].as_f64().is_some_and(|value| (0.0..=1.0).contains(&value)), "{answers}");

    // Gone on with, it keeps its rate where none is asked for.
    work.imf(&train.replace("--rate 4e-3", "--resume")).done();
    work.imf(&train.replace("--rate 4e-3", "--rate 3e-3 --resume")).refused(&["not 0.003"]);

    // Weights kept in f16 are half the file.
    work.imf(&format!("{train} --half").replace("--out field", "--out half")).done();
    let [whole, half] =
        ["apart", "half"].map(|folder| work.bytes(&format!("{folder}/field.safetensors")).len());
    assert!(half < whole, "{half} of {whole} bytes");
}

#[test]
fn symmetry_is_found_used_and_kept_unless_none_is_wanted() {
    let work = Workdir::new();
    let train = |more: &str| {
        work.imf(&format!("train teapot --dims 15,19,31 --degree 5 {NETWORK} --steps 60 {more}"))
    };
    train("--out told").done().warns(&["symmetry-reduced: mirrored across y, turned about x"]);
    train("--set symmetry=false --out plain").done();
    let symmetry = |folder: &str| {
        let info = work.json(&format!("info {folder}/field.safetensors"));
        info["network"]["symmetry"].clone()
    };
    assert_eq!((symmetry("told")["axis"]["along"].as_u64(), symmetry("plain")), (Some(0), json!(null)));
    let info = work.imf("info told/field.safetensors").done();
    info.says(&["mirrored across y, turned about x"]);

    // It is settled where a training begins: gone on with, and handed on to a changed part.
    train("--out told --resume").done();
    train("--out told --resume --set symmetry=false").refused(&["told/checkpoint.safetensors", "symmetry"]);
    let fit = "--degree 5 --no-calibrate";
    let from = "--from told/field.safetensors --steps 5 --no-calibrate";
    work.imf(&format!("train harmonic teapot --dims 16,20,32 {fit} --out other.safetensors")).done();
    work.imf(&format!("train factored other.safetensors {from} --out tuned")).done();
    assert_eq!(symmetry("tuned"), symmetry("told"));

    // Fields that leave functions out tell of it too.
    work.imf(&format!("train harmonic teapot --dims 15,19,31 {fit} --components 20 --out few.safetensors"))
        .done();
    work.imf(&format!("train factored few.safetensors {from} --out few")).done();
    // So does a changed part itself.
    work.imf(&format!("train teapot --dims 16,20,32 --degree 5 {from} --out changed")).done();
    assert_eq!((symmetry("changed"), symmetry("few")), (symmetry("told"), symmetry("told")));
}

#[test]
fn a_training_from_another_field_has_rates_of_its_own_and_is_resumed_by_them() {
    let work = Workdir::new();
    work.imf(HARMONIC).done();
    let train = |more: &str| {
        work.imf(&format!("train factored field.safetensors --steps 5 --no-calibrate --json {more}"))
    };
    let network = "--network 2x16";
    train(&format!("{network} --out small")).done();
    let from = "--from small/field.safetensors";
    let solve_every = |more: &str| train(more).done().json()["settings"]["solve_every"].as_u64();
    assert_eq!(solve_every(&format!("{network} --out plain")), Some(25));
    for (out, rate) in [("own", ""), ("given", "--rate 1e-4")] {
        assert_eq!(solve_every(&format!("{from} {rate} --out {out}")), Some(10));
        for start in [from, network] {
            let resume = format!("{start} --out {out} --resume");
            assert_eq!(solve_every(&format!("{resume} {rate}")), Some(10));
            train(&format!("{resume} --rate 2e-4")).refused(&["initial", "not 0.0002"]);
        }
    }
}

#[test]
fn left_to_itself_it_takes_the_degree_that_suits_the_tool() {
    let work = Workdir::new();
    // It stands off the axis: how the tool is rolled matters.
    work.write("arm.obj", cuboid([-6, -6, 0], [40, 6, 40], 0));
    work.write("arm.toml", b"name = \"arm\"\nmesh = \"arm.obj\"\n");
    // As many functions of whole rotations as of directions, nearly.
    for (tool, degree, functions) in [("paper", 16, 289), ("arm.toml", 5, 286)] {
        work.imf(&format!(
            "train {PART} --quantity overlap --tool {tool} --steps 1 --no-calibrate --out {degree}"
        ))
        .done();
        let file = FactoredFile::read(&work.path(&format!("{degree}/field.safetensors"))).unwrap();
        assert_eq!((file.fit.degree, file.report.functions), (degree, functions), "{tool}");
        assert_eq!((file.settings.width, file.settings.hidden, file.settings.omega), (256, 3, 20.0));
        // Every function is learnt.
        assert!(file.report.dropped <= 0.0, "{}", file.report.dropped);
    }
}

#[test]
#[cfg(unix)]
fn an_interrupted_part_goes_on_to_the_bytes_of_one_in_one_go() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 4 {NETWORK} --steps 400 --set checkpoint_every=0.02");
    work.imf(&format!("{train} --out whole")).done();
    // A folder of the part's name is not the part.
    let begin = format!("{train} --out bracket");
    work.imf(&format!("{begin} --resume")).refused(&["nothing to resume", "bracket/checkpoint.safetensors"]);
    work.interrupted_after(5, &begin)
        .interrupted(&["is saved in bracket/checkpoint.safetensors", "--resume"]);
    assert!(!work.path("bracket/field.safetensors").exists());
    work.imf(&begin).refused(&["bracket/checkpoint.safetensors", "unfinished", "--resume"]);
    let resume = format!("{begin} --resume");
    // Before a fit of minutes.
    for (given, other, words) in [
        ("--degree 4", "--degree 5", "another harmonic field (degree: 4, not 5)"),
        ("--steps 400", "--steps 401", "other settings (steps: 400, not 401)"),
        ("--dims 5,15,9", "--dims 6,15,9", "another scene (the grid differs)"),
        ("--degree 4", "--degree 4 --clearance 1", "another scene (the clearance differs)"),
    ] {
        let refused =
            work.imf(&resume.replace(given, other)).refused(&[words, "bracket/checkpoint.safetensors"]);
        assert!(!refused.stderr.contains("sections to fit"), "{}", refused.stderr);
    }
    work.imf(&resume).done();
    for file in ["field.safetensors", "checkpoint.safetensors"] {
        assert!(work.bytes(&format!("whole/{file}")) == work.bytes(&format!("bracket/{file}")), "{file}");
    }
}

#[test]
#[cfg(unix)]
fn a_fit_in_two_passes_is_gone_on_with_as_one_in_one() {
    let work = Workdir::new();
    // Of depths, whose axes a first pass decides on.
    let train =
        format!("train {PART} --quantity depth --network 1x16 --set batch=32 --steps 100000 --out field");
    // Between what sections take that stay in memory and what they take that are counted again: all 384 of them.
    let twice = work.interrupted_once_it_says("training 3→", &format!("{train} --memory 7440KiB"));
    twice.warns(&["832 sections in"]);
    for (limit, sections) in [("--memory 7440KiB", "832 sections in"), ("", "448 sections in")] {
        work.interrupted_once_it_says("training 3→", &format!("{train} --resume {limit}")).warns(&[sections]);
    }
}

#[test]
fn what_is_finished_says_so_at_once_and_where_it_is() {
    let work = Workdir::new();
    let train = format!("train {PART} --degree 4 {NETWORK} --steps 40 --out field");
    work.imf(&train).done();
    let field = "field/field.safetensors";
    let made = work.bytes(field);
    let resumed = |more: &str| {
        let again = work.imf(&format!("{train} --resume --json {more}")).done();
        again.warns(&["field/checkpoint.safetensors is finished"]);
        assert!(!again.stderr.contains("sections to fit"), "{}", again.stderr);
        assert_eq!(again.json()["field"], json!(field));
        again.stderr.contains("; wrote field/field.safetensors")
    };
    assert!(!resumed(""), "a field was written once more");
    // Error rates of its decisions were measured afterwards, and stay.
    work.imf(&format!("calibrate {field} --poses 4096 --boundary 1024 --false-free 0.1")).done();
    let calibrated = work.bytes(field);
    assert!(!resumed("") && work.bytes(field) == calibrated);
    // A field that is gone, or another training's, comes from the checkpoint.
    std::fs::remove_file(work.path(field)).unwrap();
    assert!(resumed("") && work.bytes(field) == made);
    let other = train.replace("--out field", "--out other --set seed=1");
    work.imf(&other).done();
    work.write(field, work.bytes("other/field.safetensors"));
    assert!(resumed("") && work.bytes(field) == made);
    // In the other precision too, and then it is there.
    assert!(resumed("--half") && work.bytes(field).len() < made.len() && !resumed("--half"));
}

#[test]
fn a_folder_with_the_other_familys_training_is_told_apart() {
    let work = Workdir::new();
    let factored = format!("train {PART} --degree 4 {NETWORK} --steps 2");
    let siren = format!("train siren5 {PART} --device cpu --network 2x16 --steps 2 --no-calibrate");
    work.imf(&format!("{factored} --out factored")).done();
    work.imf(&format!("{siren} --out siren")).done();
    for line in [
        format!("{factored} --out siren --resume"),
        format!("{siren} --out factored --resume"),
        "train siren5 siren/dataset --out factored --resume".to_owned(),
        "finetune siren/field.safetensors siren/dataset --out factored --resume".to_owned(),
    ] {
        let refused = work.imf(&line).refused(&["checkpoint.safetensors", "the other family", "--out"]);
        let worked =
            ["sampling", "sections to fit", "solid voxels"].map(|work| refused.stderr.contains(work));
        assert_eq!(worked, [false; 3], "{}", refused.stderr);
    }
}

#[test]
fn the_papers_network_of_a_part_is_that_of_its_dataset() {
    let work = Workdir::new();
    let network = "--device cpu --network 3x24:10 --rate 1e-3 --batch 256 --steps 40 --set seed=3";
    let train = format!("train siren5 {PART} {network} --out model");
    let trained = work.json(&train);
    assert_eq!((&trained["field"], &trained["steps"]), (&json!("model/field.safetensors"), &json!(40)));

    work.imf(&format!("dataset {PART} --orientations axes+fibonacci:225 --seed 3 --out data")).done();
    work.imf(&format!("train siren5 data {network} --out apart")).done();
    for file in ["manifest.json", "shard-00000.safetensors"] {
        let [made, apart] = ["model/dataset", "data"].map(|folder| work.bytes(&format!("{folder}/{file}")));
        assert!(made == apart, "{file}");
    }
    let [model, apart] = ["model", "apart"].map(|folder| work.model(&format!("{folder}/field.safetensors")));
    assert!(model == apart, "another model");
    let bytes = ["model", "apart"].map(|folder| work.bytes(&format!("{folder}/field.safetensors")));
    assert!(bytes[0] == bytes[1], "a file of the same seed differs");

    // What is sampled is taken as it is, and what is finished is not gone on with.
    let train = format!("{train} --no-calibrate");
    work.imf(&train).done().warns(&["0 shards made, 1 kept"]);
    work.imf(&train.replace("5,15,9", "6,15,9")).refused(&["model/dataset", "another dataset"]);
    let resume = format!("{train} --resume --json");
    // It is the same field however it was calibrated.
    work.calibrate_quickly("model/field.safetensors");
    // No sample is needed for what is known without.
    std::fs::remove_dir_all(work.path("model/dataset")).unwrap();
    let other = resume.replace("5,15,9", "6,15,9");
    work.imf(&other).refused(&["model/checkpoint.safetensors", "another dataset"]);
    for wrote in [false, true] {
        let over = work.imf(&resume).done();
        over.warns(&["model/checkpoint.safetensors is finished"]);
        assert_eq!(over.json()["field"], json!("model/field.safetensors"));
        assert_eq!(over.stderr.contains("wrote model/field.safetensors"), wrote, "{}", over.stderr);
        let again = work.model("model/field.safetensors");
        assert!(again.state == apart.state, "another model");
        std::fs::remove_file(work.path("model/field.safetensors")).unwrap();
    }
    assert!(!work.path("model/dataset").exists(), "samples were made");

    // From another network: as imf finetune does.
    let few = "--device cpu --steps 5 --no-calibrate";
    work.imf(&format!("finetune apart/field.safetensors data {few} --out tuned")).done();
    work.imf(&format!("train siren5 data --from apart/field.safetensors {few} --out from")).done();
    let [tuned, from] = ["tuned", "from"].map(|folder| work.model(&format!("{folder}/field.safetensors")));
    assert!(tuned.state == from.state && tuned.record.plan == from.record.plan);
}

#[test]
fn options_of_the_other_family_are_none_and_subjects_that_are_none_are_refused_by_name() {
    let work = Workdir::with_dataset();
    std::fs::create_dir(work.path("empty")).unwrap();
    let tool = "[cutter]\nshape = 'ball'\ndiameter = 6\nlength = 20\n";
    std::fs::write(work.path("tool.toml"), tool).unwrap();
    for line in ["bracket --epochs 3", "bracket --mpi", "siren5 bracket --degree 8", "siren5 data --half"] {
        work.imf(&format!("train {line} --out model")).exits(2);
    }
    let of_part = ["applies only to a part", "made with its own"];
    for (line, option, words) in [
        ("siren5 data", "--pitch 2", of_part),
        ("siren5 data", "--tool paper", of_part),
        ("siren5 data", "--clearance 1", of_part),
        ("siren5 data", "--contact 1", of_part),
        ("siren5 data", "--quantity overlap", of_part),
        ("siren5 bracket --tool tool.toml", "--steps 1", ["overlaps alone", "imf train bracket"]),
        ("siren5 bracket", "--quantity depth", ["overlaps alone", "--quantity overlap"]),
        ("siren5 nowhere", "--steps 1", ["nowhere is neither a part", "nor the folder of a dataset"]),
        ("siren5 empty", "--steps 1", ["empty is neither a part", "nor the folder of a dataset"]),
        ("factored nowhere", "--steps 1", ["nowhere", "no mesh file"]),
        ("data", "--steps 1", ["data is a dataset", "imf train siren5 data"]),
        ("bracket", "--memory 1MiB", ["MiB of memory", "--pitch"]),
    ] {
        let run = work.imf(&format!("train {line} {option} --out model"));
        if words == of_part {
            run.bad_input(&words)
        } else {
            run.refused(&words)
        };
        assert!(!work.path("model").exists(), "{line} {option} left a folder behind");
    }
}
