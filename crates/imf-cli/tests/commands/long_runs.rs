//! What a long run meets: damaged checkpoints, a full disk, divergence; and what others read while it goes on.
#![cfg(unix)]

use std::process::{Command, Stdio};

use imf_fields::model::TrainingRecord;
use serde_json::Value;

use crate::binary::{TRAIN, Workdir, finish, signalled_once_it_says};

const CURRENT: &str = "model/checkpoint.safetensors";
const PREVIOUS: &str = "model/checkpoint.previous.safetensors";

#[test]
fn a_damaged_checkpoint_costs_the_steps_since_the_one_before() {
    let work = Workdir::with_dataset();
    // A checkpoint at every report, which is every twenty steps and at the end of an epoch of 39.
    let train = format!("{TRAIN} --steps 400 --set checkpoint_every=0 --out model");
    work.imf(&train).done();
    let (current, previous) = (work.bytes(CURRENT), work.bytes(PREVIOUS));
    assert_eq!(work.model(PREVIOUS).record.steps, 390);
    let whole = work.model("model/field.safetensors");
    let header = u64::from_le_bytes(current[..8].try_into().unwrap()) as usize;
    let flipped = |at: usize| {
        let mut bytes = current.clone();
        bytes[at] ^= 4;
        bytes
    };
    // The tensors stand behind the header: moments first by name, then weights.
    let damages = [
        ("length", flipped(3)),
        ("description", flipped(8 + header / 2)),
        ("first tensor", flipped(8 + header)),
        ("middle", flipped((8 + header + current.len()) / 2)),
        ("last byte", flipped(current.len() - 1)),
        ("cut short", current[..current.len() * 2 / 3].to_vec()),
        ("empty", Vec::new()),
    ];
    for (what, bytes) in damages {
        work.write(CURRENT, &bytes);
        work.write(PREVIOUS, &previous);
        let resumed = work.imf(&format!("{train} --resume")).done();
        let warning = resumed.stderr.lines().find(|line| line.contains("warning")).unwrap();
        assert!(warning.contains(CURRENT) && warning.contains(PREVIOUS), "{what}: {warning}");
        assert!(warning.contains("step 390") && warning.contains("repeated"), "{what}: {warning}");
        if what == "last byte" {
            assert!(warning.contains("10 steps are repeated"), "{warning}");
        }
        let again = work.model("model/field.safetensors");
        assert!(again.state == whole.state, "{what}: the steps repeated ended elsewhere");
        assert_eq!(again.record.losses, whole.record.losses, "{what}");
        assert_eq!(again.record.held_out, whole.record.held_out, "{what}");
        assert_eq!(work.model(CURRENT).record.steps, 400, "{what}");
    }
    // Both damaged: nothing is guessed.
    work.write(CURRENT, &current[..100]);
    work.write(PREVIOUS, &previous[..100]);
    work.imf(&format!("{train} --resume")).refused(&[CURRENT, PREVIOUS, "nothing to resume"]);
}

#[test]
fn a_full_disk_is_one_warning_and_the_last_good_checkpoint_stays() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 600 --out model");
    work.imf(&train.replace("--out model", "--out whole")).done();
    work.interrupted_after(20, &format!("{train} --set checkpoint_every=0")).interrupted(&[CURRENT]);
    let before = [CURRENT, PREVIOUS].map(|file| work.path(file).exists().then(|| work.bytes(file)));
    let step = work.model(CURRENT).record.steps;

    // No file may grow beyond four blocks, as on a disk without room.
    let script = format!(
        "ulimit -f 4; exec '{}' {train} --resume --set checkpoint_every=0",
        env!("CARGO_BIN_EXE_imf")
    );
    let mut limited = Command::new("sh");
    limited.args(["-c", &script]).current_dir(work.path("")).stdin(Stdio::null());
    let refused = finish(&script, &mut limited);
    // The log is too long as well, and has a warning of its own.
    let of_checkpoint = |line: &&str| line.starts_with("imf: warning:") && line.contains("checkpoint");
    let warnings = refused.stderr.lines().filter(of_checkpoint).count();
    assert_eq!(warnings, 1, "{}", refused.stderr);
    refused.warns(&["training goes on"]);
    refused.refused(&["could not be written", CURRENT, &format!("of step {step}")]);
    let after = [CURRENT, PREVIOUS].map(|file| work.path(file).exists().then(|| work.bytes(file)));
    assert!(before == after, "a checkpoint that could not be written changed those that were");

    work.imf(&format!("{train} --resume")).done();
    assert!(work.model("model/field.safetensors").state == work.model("whole/field.safetensors").state);
}

#[test]
#[cfg(unix)]
fn a_run_that_ignores_hang_ups_goes_on_after_one() {
    let work = Workdir::with_dataset();
    let script =
        format!("trap '' HUP; exec '{}' {TRAIN} --steps 2000 --out model", env!("CARGO_BIN_EXE_imf"));
    let mut shell = Command::new("sh");
    shell.args(["-c", &script]).current_dir(work.path("")).stdin(Stdio::null());
    signalled_once_it_says("training", &script, &mut shell, "HUP").done();
}

#[test]
fn a_diverged_training_goes_on_more_slowly() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 600 --out model");
    work.interrupted_after(20, &format!("{train} --set checkpoint_every=0.01")).interrupted(&[CURRENT]);
    let step = work.model(CURRENT).record.steps;
    let too_fast = train.replace("--rate 1e-3", "--rate 1e38");
    work.imf(&format!("{too_fast} --resume")).refused(&[
        "the loss became",
        &format!("the last good checkpoint is {CURRENT}, of step {step}"),
        "add --resume with --rate 3.3e37",
    ]);
    assert_eq!(work.model(CURRENT).record.steps, step);
    work.imf(&format!("{train} --resume")).done();
    assert_eq!(work.model("model/field.safetensors").record.steps, 600);
}

#[test]
fn a_divergence_is_noticed_however_often_the_training_is_interrupted() {
    let work = Workdir::with_dataset();
    let train = "train siren5 data --device cpu --network 3x32:10 --rate 2e-3 --batch 1024 --set schedule=cosine \
                 --steps 12000 --out model --set checkpoint_every=0.01";
    // It learns first, for long enough to have a loss a sixth of a constant's.
    let learnt = |work: &Workdir| work.path(PREVIOUS).exists() && work.model(PREVIOUS).record.steps > 3500;
    while !learnt(&work) {
        let resume = if work.path(CURRENT).exists() { " --resume" } else { "" };
        work.interrupted_after(40, &format!("{train}{resume}")).interrupted(&[CURRENT]);
    }
    let good = work.model(CURRENT).record;
    assert!(!good.watch.is_suspicious());
    // Far too fast: its outputs become a constant.
    let too_fast = format!("{} --resume", train.replace("--rate 2e-3", "--rate 30"));
    let mut ended = None;
    for run in 1..100 {
        let run = work.interrupted_after(run, &too_fast);
        if run.code != Some(130) {
            ended = Some(run);
            break;
        }
    }
    let ended = ended.expect("a training that has diverged ends");
    let ended = ended.refused(&["training has diverged", "the last good checkpoint", "--rate 1.0e1"]);
    // What is left to go on from is of before.
    let kept = [CURRENT, PREVIOUS].map(|file| work.path(file).exists().then(|| work.model(file).record));
    let left = kept.into_iter().flatten().next().unwrap();
    assert!(!left.watch.is_suspicious() && left.steps >= good.steps, "step {}", left.steps);
    let last = |record: &TrainingRecord| record.losses.last().unwrap().loss;
    assert!(last(&left) < 4.0 * last(&good), "{} after {}", last(&left), last(&good));
    ended.warns(&[&format!("of step {}", left.steps)]);
}

#[test]
fn options_that_differ_from_the_training_that_is_resumed_are_refused() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 300 --out model");
    work.imf(&train).done();
    let before = work.bytes("model/field.safetensors");
    for option in [
        "--batch 128",
        "--steps 400",
        "--network 3x32",
        "--set seed=7",
        "--set loss=l2",
        "--set schedule=exponential",
        "--set held_out=7",
        "--set held_out_every=20",
    ] {
        let name = option.split('=').next().unwrap();
        let name = if name.starts_with("--set") { name } else { option.split(' ').next().unwrap() };
        let others: Vec<&str> = train.split(' ').filter(|&word| word != "--no-calibrate").collect();
        let (command, others) = others.split_at(3);
        let kept = others.chunks(2).filter(|pair| pair[0] != name).flatten();
        let kept: Vec<&str> = command.iter().chain(kept).copied().collect();
        let line = format!("{} --no-calibrate {option} --resume", kept.join(" "));
        work.imf(&line).refused(&[&format!("{name} is not that of the training"), "--out"]);
    }
    // The same again, and what is left to its default, are not others.
    work.imf(&format!("{train} --resume")).done();
    work.imf("train siren5 data --device cpu --no-calibrate --out model --resume").done();
    assert!(work.bytes("model/field.safetensors") == before);

    work.imf("finetune model/field.safetensors data --device cpu --steps 5 --out model")
        .refused(&["would be replaced", "another --out"]);
    work.imf("finetune model/field.safetensors data --device cpu --steps 5 --no-calibrate --out tuned")
        .done();
    let wider = TRAIN.replace("3x24", "3x16");
    work.imf(&format!("{wider} --steps 20 --out other")).done();
    work.imf("finetune other/field.safetensors data --device cpu --steps 5 --out tuned --resume")
        .refused(&["not fine-tuned from this model"]);
    assert!(work.bytes("model/field.safetensors") == before);
}

#[test]
fn a_folder_is_written_to_by_one_run_at_a_time() {
    let work = Workdir::with_dataset();
    std::fs::create_dir(work.path("model")).unwrap();
    let other = std::fs::File::open(work.path("model")).unwrap();
    other.lock().unwrap();
    let train = format!("{TRAIN} --steps 30 --out model");
    let all = [
        train.as_str(),
        "voxelize bracket --pitch 6 --out model",
        "field bracket --pitch 6 --orientations 0,0 --out model",
    ];
    for command in all {
        let run = work.imf(command).exits(1);
        run.warns(&["imf: error: another run of imf is writing to model", "another --out"]);
    }
    drop(other);
    for command in all {
        work.imf(command).done();
    }
}

#[test]
fn poses_held_out_are_counted_before_they_are_drawn() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 30 --out model --set held_out=100000000000");
    work.imf(&train).refused(&["100000000000 poses held out", "hold out fewer poses", "iB of memory"]);
    assert!(!work.path("model/field.safetensors").exists());
}

#[test]
fn the_log_equals_the_record_through_interruptions() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 1000 --set held_out=500 --set held_out_every=200");
    work.imf(&format!("{train} --out whole")).done();
    let broken = format!("{train} --out model");
    work.interrupted_after(20, &format!("{broken} --set checkpoint_every=0.01")).interrupted(&[CURRENT]);
    // Rows after the checkpoint, as a killed process leaves them.
    let late = work.text("model/log.jsonl") + &work.text("whole/log.jsonl").lines().last().unwrap()[..30];
    work.write("model/log.jsonl", late);
    work.imf(&format!("{broken} --resume")).done();

    let whole = work.model("whole/field.safetensors").record;
    for (log, folder) in [("whole/log.jsonl", "whole"), ("model/log.jsonl", "model")] {
        let record = work.model(&format!("{folder}/field.safetensors")).record;
        assert_eq!((&record.losses, &record.held_out), (&whole.losses, &whole.held_out), "{folder}");
        let rows: Vec<Value> =
            work.text(log).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let column = |name: &str| -> Vec<(u64, f64)> {
            rows.iter().filter_map(|row| Some((row["step"].as_u64()?, row[name].as_f64()?))).collect()
        };
        let losses: Vec<_> = record.losses.iter().map(|point| (point.step, point.loss)).collect();
        assert_eq!(column("loss"), losses, "{log}");
        let held_out = record.held_out.unwrap();
        let errors = || held_out.errors.iter();
        assert_eq!(
            errors().map(|error| error.step).collect::<Vec<_>>(),
            (200..=1000).step_by(200).collect::<Vec<_>>()
        );
        assert_eq!(column("held_out_mse"), errors().map(|e| (e.step, e.mse)).collect::<Vec<_>>(), "{log}");
        assert_eq!(column("held_out_mae"), errors().map(|e| (e.step, e.mae)).collect::<Vec<_>>(), "{log}");
        // Of poses that training sees: 16 sections of so slender a part say little about others.
        assert!(losses.last().unwrap().1 < 0.5 * losses[0].1, "nothing was learnt: {losses:?}");
        assert!(rows.iter().all(|row| row["samples_per_second"].as_f64().unwrap() > 0.0));
    }
}
