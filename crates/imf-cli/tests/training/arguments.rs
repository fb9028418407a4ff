//! Arguments, folders and devices that cannot be served: one line that names the value and what may be done.

use crate::binary::{DATASET, TRAIN, Workdir, finish};

#[test]
fn numbers_out_of_range_are_named() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 3 --out model");
    for (from, to, words) in [
        ("--width 24", "--width 0", ["neurons", "of 0"]),
        ("--width 24", "--width 9000", ["neurons", "9000"]),
        ("--layers 3", "--layers 0", ["hidden layers", "not 0"]),
        ("--steps 3", "--steps 3 --weight-decay nan", ["weight decay", "NaN"]),
        ("--steps 3", "--steps 3 --weight-decay -1", ["weight decay", "-1"]),
        ("--steps 3", "--steps 3 --threads 0", ["--threads", "at least 1"]),
    ] {
        let line = train.replace(from, to);
        assert_ne!(line, train);
        work.imf(&line).refused(&words);
    }
    assert!(!work.path("model/checkpoint.safetensors").exists());

    let dataset = DATASET.replace("--out data", "--out new");
    for (more, words) in [
        ("--density 2", ["density", "2"]),
        ("--density 0", ["density", "0"]),
        ("--density nan", ["density", "NaN"]),
        ("--density -1", ["density", "-1"]),
        ("--contact -1", ["contact", "-1"]),
        ("--positive-share 1.5", ["positive share", "1.5"]),
    ] {
        work.imf(&format!("{dataset} {more}")).refused(&words);
    }
    for (set, words) in [
        ("spiral:7", ["spiral:7", "fibonacci:N"]),
        ("grid:0", ["grid:0", "number of orientations"]),
        ("random:3", ["random:3", "random:N:SEED"]),
        ("random:3:x", ["random:3:x", "seed"]),
        ("0,190", ["0,190", "180"]),
        ("nowhere.csv", ["nowhere.csv", "cannot read"]),
        ("so3:8", ["so3:8", "rolls"]),
    ] {
        work.imf(&dataset.replace("fibonacci:16", set)).refused(&words);
    }
    assert!(!work.path("new").exists(), "a refusal left a folder behind");
}

#[test]
fn numbers_out_of_range_are_refused_beside_the_option_that_they_were_given_to() {
    let work = Workdir::new();
    let trainings = [
        "train data --out m",
        "train bracket --out m",
        "finetune m.safetensors data --out m",
        "compress f --out m",
    ];
    let of_training =
        ["--rate 0", "--rate -1", "--rate nan", "--rate inf", "--batch 0", "--batch -1", "--seed -1"];
    let mut lines: Vec<(&str, &str)> =
        trainings.iter().flat_map(|&line| of_training.map(|option| (line, option))).collect();
    lines.extend([
        ("train data --out m", "--omega 1e30"),
        ("train data --out m", "--omega 0"),
        ("train data --out m", "--omega nan"),
        ("train data --out m", "--held-out-every 0"),
        ("compress f --out m", "--omega 1e30"),
        ("eval m.safetensors", "--threshold nan"),
        ("eval m.safetensors", "--threshold -1"),
        ("eval m.safetensors", "--threshold=-1"),
        ("eval m.safetensors", "--threshold 2"),
        ("eval m.safetensors", "--threshold 1"),
        ("access teapot --out m", "--tau 1"),
        ("field teapot --method harmonic --save f.safetensors", "--axes 0"),
    ]);
    for (line, option) in lines {
        let refused = work.imf(&format!("{line} {option}"));
        let (name, value) = option.split_once([' ', '=']).unwrap();
        let value = value.rsplit(',').next().unwrap();
        assert_eq!(refused.code, Some(2), "`imf {line} {option}`:\n{}", refused.stderr);
        let words = [format!("invalid value '{value}'"), format!("for '{name} <")];
        assert!(words.iter().all(|words| refused.stderr.contains(words)), "{option}:\n{}", refused.stderr);
    }
    assert!(std::fs::read_dir(work.path(".")).unwrap().next().is_none(), "a refusal left something behind");
}

#[test]
fn a_batch_larger_than_the_dataset_is_judged_by_what_was_trained_with() {
    let work = Workdir::with_dataset();
    let train = TRAIN.replace("--batch 256", "--batch 100000000000");
    // Two steps of 9,872 samples: far too short a training for its calibration.
    work.imf(&format!("{train} --steps 2 --held-out 0 --out model")).done();
    assert!(work.model("model/model.safetensors").calibration.is_none());
}

#[test]
fn arguments_that_make_no_sense_have_an_exit_code_of_their_own() {
    let work = Workdir::new();
    for line in [
        "train",
        "train data",
        "train data --out model --epochs 3 --steps 3",
        "train bracket --out model --steps 0",
        "train data --out model --width many",
        "train data --out model --memory lots",
        "dataset bracket --dims 7,21 --orientations grid:2 --out data",
        "polish the-part",
        "",
    ] {
        let refused = work.imf(line);
        assert_eq!(refused.code, Some(2), "`imf {line}`:\n{}", refused.stderr);
        assert!(!refused.stderr.is_empty() && refused.stdout.is_empty(), "`imf {line}`");
    }
}

#[test]
fn what_does_not_fit_the_memory_is_refused_with_an_estimate() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    let eval = "eval model/model.safetensors --device cpu --random 2 --imf fibonacci:2";
    for (line, remedy) in [
        (DATASET.replace("--out data", "--out new"), "--pitch"),
        (format!("{TRAIN} --steps 3 --out other"), "--density"),
        (eval.to_owned(), "--threads"),
    ] {
        work.imf(&format!("{line} --memory 1KiB")).refused(&[
            "this needs about",
            "iB of memory",
            "1 KiB may be used",
            remedy,
            "--memory",
        ]);
    }
    work.imf(&format!("{eval} --memory 1GiB")).done();
}

#[test]
fn folders_that_cannot_be_written_are_named_before_any_work() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    work.write("file", b"in the way");
    let model = "model/model.safetensors";
    for line in [
        DATASET.replace("--out data", "--out file/below"),
        format!("{TRAIN} --steps 3 --out file/below"),
        format!("finetune {model} data --device cpu --steps 3 --out file/below"),
        format!("eval {model} --device cpu --out file/below"),
        "demo --device cpu --out file/below".to_owned(),
        "demo --device cpu --out file".to_owned(),
    ] {
        work.imf(&line).refused(&["cannot write to the folder file", "file is a file"]);
    }
    assert_eq!(work.bytes("file"), b"in the way");
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
    assert!(!work.path("model/model.safetensors").exists());

    // A finished training in the same folder is no place to go on from.
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
    let nothing = "/nonexistent/driver.json";
    let run = |line: &str| {
        let mut command = work.command(line);
        finish(line, command.env("VK_DRIVER_FILES", nothing).env("VK_ICD_FILENAMES", nothing))
    };
    let train = TRAIN.replace("--device cpu", "--device DEVICE");
    for line in [
        format!("{train} --steps 3 --out gpu"),
        "finetune model/model.safetensors data --steps 3 --out gpu --device DEVICE".to_owned(),
        "eval model/model.safetensors --random 2 --imf fibonacci:2 --device DEVICE".to_owned(),
        "demo --out gpu --device DEVICE".to_owned(),
    ] {
        for device in ["gpu", "software", "0", "geforce"] {
            let asked = format!("--device {device}");
            let refused = run(&line.replace("--device DEVICE", &asked));
            refused.refused(&[&asked, "no GPU adapter was found", "mesa-vulkan-drivers", "the CPU engine"]);
        }
    }
    assert!(!work.path("gpu/model.safetensors").exists());
    // Left to itself it takes the CPU.
    let trained =
        run(&format!("{train} --steps 3 --out auto --json").replace("DEVICE", "auto")).done().json();
    assert!(trained["engine"].as_str().unwrap().contains("CPU"), "{trained}");
}
