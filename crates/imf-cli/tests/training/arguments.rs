//! Arguments, folders and devices that cannot be served: one line that names the value and what may be done.

use crate::binary::{DATASET, TRAIN, Workdir, finish};

#[test]
fn numbers_out_of_range_are_named() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 3 --out model");
    for (from, to, words) in [
        ("--rate 1e-3", "--rate nan", ["initial", "NaN"]),
        ("--rate 1e-3", "--rate inf", ["initial", "inf"]),
        ("--rate 1e-3", "--rate=-1e-3", ["initial", "-0.001"]),
        ("--width 24", "--width 0", ["neurons", "of 0"]),
        ("--width 24", "--width 9000", ["neurons", "9000"]),
        ("--layers 3", "--layers 0", ["hidden layers", "not 0"]),
        ("--omega 10", "--omega 0", ["frequency", "0"]),
        ("--omega 10", "--omega nan", ["frequency", "NaN"]),
        ("--batch 256", "--batch 0", ["`batch`", "at least 1"]),
        ("--steps 3", "--steps 3 --weight-decay nan", ["weight decay", "NaN"]),
        ("--steps 3", "--steps 3 --weight-decay=-1", ["weight decay", "-1"]),
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
