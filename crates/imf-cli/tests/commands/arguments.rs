//! Arguments, folders and devices that cannot be served: one line that names the value and what may be done.

use crate::binary::{DATASET, TRAIN, Workdir};

#[test]
fn numbers_out_of_range_are_named() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 3 --threads 0 --out model");
    work.imf(&train).bad_input(&["--threads", "at least 1"]);
    assert!(!work.path("model/checkpoint.safetensors").exists());

    let dataset = DATASET.replace("--out data", "--out new");
    for (more, words) in [
        ("--density 2", ["density", "2"]),
        ("--density 0", ["density", "0"]),
        ("--density nan", ["density", "NaN"]),
        ("--density -1", ["density", "-1"]),
    ] {
        work.imf(&format!("{dataset} {more}")).bad_input(&words);
    }
    assert!(!work.path("new").exists(), "a refusal left a folder behind");
}

#[test]
fn numbers_out_of_range_are_refused_beside_the_option_that_they_were_given_to() {
    let work = Workdir::new();
    let trainings = [
        "train siren5 data --out m",
        "train bracket --out m",
        "train factored bracket --out m",
        "finetune m.safetensors data --out m",
    ];
    let of_training = ["--rate 0", "--rate -1", "--rate nan", "--rate inf", "--steps 0"];
    let mut lines: Vec<(&str, &str)> =
        trainings.iter().flat_map(|&line| of_training.map(|option| (line, option))).collect();
    lines.extend([
        ("train siren5 data --out m", "--batch 0"),
        ("finetune m.safetensors data --out m", "--batch -1"),
        ("train siren5 data --out m", "--network 3x24:1e30"),
        ("train siren5 data --out m", "--network :0"),
        ("train bracket --out m", "--network 3x24:nan"),
        ("train bracket --out m", "--network many"),
        ("train bracket --out m", "--network 3x0"),
        ("train siren5 data --out m", "--network 3x9000"),
        ("train siren5 data --out m", "--network 0x24"),
        ("eval m.safetensors", "--threshold nan"),
        ("eval m.safetensors", "--threshold=-inf"),
        ("access teapot --out m", "--tau 1"),
        ("train harmonic teapot --out f.safetensors", "--components 0"),
        ("train siren5 data --out m", "--set seed"),
        ("dataset teapot --out m", "--contact -1"),
        ("access teapot --out m", "--contact nan"),
        ("access teapot --out m", "--clearance=-1"),
        ("access teapot --out m", "--map 0,0"),
        ("access teapot --out m", "--map-step 0"),
        ("access teapot --out m", "--limits xy:0:1"),
        ("access teapot --out m", "--stock box:-2"),
        ("check teapot path.csv", "--stock box:x"),
        ("check teapot path.csv", "--clearance-holder inf"),
        ("check teapot path.csv", "--contact -1"),
        ("check teapot path.csv", "--step 0"),
    ]);
    for (line, option) in lines {
        let refused = work.imf(&format!("{line} {option}")).exits(2);
        let (name, value) = option.split_once([' ', '=']).unwrap();
        refused.warns(&[&format!("invalid value '{value}'"), &format!("for '{name} <")]);
    }
    assert!(work.entries().is_empty(), "a refusal left something behind");
}

#[test]
fn settings_are_named_with_those_that_there_are() {
    let work = Workdir::with_dataset();
    for (line, set, words) in [
        ("siren5 data", "bach=3", ["--set bach=3", "held_out"]),
        ("siren5 data", "seed=1 --set seed=2", ["--set seed stands twice", "once"]),
        ("siren5 data", "seed=-1", ["--set seed=-1", "integer"]),
        ("siren5 data", "weight_decay=nan", ["--set weight_decay=nan", "f32"]),
        ("siren5 data", "schedule=linear", ["--set schedule=linear", "cosine"]),
        ("siren5 data", "held_out_every=0", ["held_out_every=0", "at least 1"]),
        ("siren5 data", "weight_decay=-1", ["weight decay", "-1"]),
        ("factored bracket", "batch=0", ["`batch`", "at least 1"]),
        ("siren5 data", "checkpoint_every=-1", ["checkpoint_every=-1", "seconds"]),
        ("factored bracket", "held_out=3", ["--set held_out=3", "optimiser"]),
    ] {
        work.imf(&format!("train {line} --out m --set {set}")).bad_input(&words);
    }
    assert!(!work.path("m").exists());
}

#[test]
fn what_decisions_are_worth_is_measured_unless_that_is_left_out() {
    let work = Workdir::with_dataset();
    // As large a batch as the dataset is, whatever was asked for.
    let train =
        TRAIN.replace("--batch 256", "--batch 100000000000") + " --steps 2 --set held_out=0 --out model";
    let run = work.imf(&train).done();
    assert!(work.model("model/field.safetensors").calibration.is_none());
    run.says(&["Verdict: none, decisions are not calibrated"]);
    let resumed = train.replace(" --no-calibrate", "") + " --resume";
    let run = work.imf(&resumed).done();
    let known = work.model("model/field.safetensors").calibration.unwrap();
    run.says(&[&format!("Verdict: {}.", known.verdict())]);
}

#[test]
fn what_does_not_fit_the_memory_is_refused_with_an_estimate() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    let eval = "eval model/field.safetensors --device cpu --random 2 --imf fibonacci:2";
    for (line, limit, remedy) in [
        (DATASET.replace("--out data", "--out new"), 1, "--pitch"),
        (format!("{TRAIN} --steps 3 --out other"), 1, "--density"),
        (eval.to_owned(), 1, "the field in model"),
        (eval.to_owned(), 30, "--threads"),
    ] {
        work.imf(&format!("{line} --memory {limit}KiB")).refused(&[
            "this needs about",
            "iB of memory",
            &format!("{limit} KiB may be used"),
            remedy,
            "--memory",
        ]);
    }
    work.calibrate_quickly("model/field.safetensors");
    work.imf(&format!("{eval} --memory 1GiB")).done();
}

#[test]
fn folders_that_cannot_be_written_are_named_before_any_work() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    work.write("file", "in the way");
    let model = "model/field.safetensors";
    // Hours of work: the refusal comes before it.
    let large = "--dims 490,1470,870 --memory 1000GiB";
    for line in [
        "parts",
        &format!("voxelize teapot {large} --out"),
        &format!("field teapot --orientations grid:90 {large} --out"),
        &DATASET.replace("--out data", "--out"),
        &format!("{TRAIN} --steps 3 --out"),
        &format!("finetune {model} data --device cpu --steps 3 --out"),
        &format!("eval {model} --device cpu --out"),
        "demo --device cpu --out",
    ] {
        for folder in ["file", "file/below"] {
            let named = format!("cannot write to the folder {folder}: file is a file");
            work.refuse(&format!("{line} {folder}"), &[&named]);
        }
    }
    assert_eq!(work.text("file"), "in the way");
}

#[test]
fn divergence_stops_with_the_step_and_a_remedy() {
    let work = Workdir::with_dataset();
    let diverging = format!("{} --steps 400 --out model", TRAIN.replace("--rate 1e-3", "--rate 1e38"));
    let refused = work.imf(&diverging);
    refused.refused(&[
        "the loss became",
        "between steps 0 and 20",
        "lower learning rate",
        "no checkpoint was written",
    ]);
    assert!(!work.path("model/field.safetensors").exists());

    // A finished training in the same folder is not a place to go on from.
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    let before = work.bytes("model/checkpoint.safetensors");
    let error = work.imf(&diverging).refused(&["the loss became"]);
    assert!(!error.stderr.contains("add --resume"), "{}", error.stderr);
    assert!(work.bytes("model/checkpoint.safetensors") == before);
}

#[test]
#[cfg(target_os = "linux")]
fn a_machine_without_a_gpu_names_the_remedy() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    work.write("poses.csv", "x,y,z,theta,phi\n1,2,3,4,5\n");
    let train = TRAIN.replace("--device cpu", "--device DEVICE");
    for line in [
        format!("{train} --steps 3 --out gpu"),
        "finetune model/field.safetensors data --steps 3 --out gpu --device DEVICE".to_owned(),
        "eval model/field.safetensors --random 2 --imf fibonacci:2 --device DEVICE".to_owned(),
        "demo --out gpu --device DEVICE".to_owned(),
        "query model/field.safetensors poses.csv --out a.csv --device DEVICE".to_owned(),
    ] {
        for device in ["gpu", "software", "0", "geforce"] {
            let asked = format!("--device {device}");
            let refused = work.imf(&line.replace("--device DEVICE", &asked));
            refused.refused(&[&asked, "no GPU adapter was found", "mesa-vulkan-drivers", "the CPU engine"]);
        }
    }
    assert!(!work.path("gpu/field.safetensors").exists() && !work.path("a.csv").exists());
    // Left to itself it takes the CPU.
    let trained = work.json(&format!("{train} --steps 3 --out auto").replace("DEVICE", "auto"));
    assert!(trained["engine"].as_str().unwrap().contains("CPU"), "{trained}");
}
