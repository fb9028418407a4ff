//! Trainings of several processes by `mpirun`: they end where one process ends, however many there are, and none waits for
//! one that is gone. Built with the feature `mpi` alone; `cargo xtask mpi` runs them.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

#[path = "../commands/binary.rs"]
#[expect(dead_code, reason = "shared with the tests of one process, which use more of it")]
mod binary;

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use binary::{DATASET, Finished, TRAIN, Workdir, finish, signal};
use imf_fields::model::Model;

/// The binary that is run.
const PROGRAM: &str = env!("CARGO_BIN_EXE_imf");
/// Of the loss, between trainings that group their sums differently, in the first steps: rounding alone, 7e-8 was seen.
const FIRST_TOLERANCE: f64 = 1e-5;
/// Steps that count as the first.
const FIRST_STEPS: u64 = 200;
/// Later: Adam lets weights with tiny gradients go either way, so paths part after some 350 steps of this training, and
/// stay as good as each other; 9e-3 was seen.
const LATER_TOLERANCE: f64 = 5e-2;
/// No failure may take longer than this to end all ranks.
const AT_ONCE: Duration = Duration::from_secs(30);

/// `mpirun` in the work folder, on any machine and as any user, with more ranks than cores if need be.
fn mpirun(work: &Workdir, words: &str) -> Command {
    let mut command = Command::new("mpirun");
    for (name, value) in [
        ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
        ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
        ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
        ("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe"),
        // Ranks that outnumber the cores let each other work.
        ("OMPI_MCA_mpi_yield_when_idle", "1"),
    ] {
        command.env(name, value);
    }
    let words = words.replace("imf ", concat!(env!("CARGO_BIN_EXE_imf"), " "));
    command.args(words.split_whitespace()).current_dir(work.path("")).stdin(Stdio::null());
    command
}

/// Trains on so many ranks.
fn on_ranks(work: &Workdir, ranks: usize, line: &str) -> Finished {
    let words = format!("-n {ranks} imf {line} --mpi --threads 1");
    finish(&words, &mut mpirun(work, &words))
}

/// Fails unless the losses are the same but for rounding; the largest difference in the first steps, and later.
fn like(found: &Model, expected: &Model) -> [f64; 2] {
    let points = |model: &Model| model.record.losses.iter().map(|point| point.step).collect::<Vec<_>>();
    assert_eq!(points(found), points(expected));
    let mut most = [0.0f64; 2];
    for (found, expected) in found.record.losses.iter().zip(&expected.record.losses) {
        let most = &mut most[usize::from(found.step > FIRST_STEPS)];
        *most = most.max((found.loss / expected.loss - 1.0).abs());
    }
    assert!(most[0] < FIRST_TOLERANCE && most[1] < LATER_TOLERANCE, "losses differ by {most:?}");
    most
}

fn errors(stderr: &str) -> Vec<&str> {
    stderr.lines().filter(|line| line.starts_with("imf: error")).collect()
}

#[test]
fn ranks_reach_the_loss_of_one_process_and_repeat_to_the_bit() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 600 --set held_out=300 --set held_out_every=200");
    work.imf(&format!("{train} --threads 1 --out one")).done();
    let one = work.model("one/field.safetensors");
    // One rank, with and without mpirun, is one process.
    work.imf(&format!("{train} --threads 1 --mpi --out single")).done();
    on_ranks(&work, 1, &format!("{train} --out lone")).done();
    for folder in ["single", "lone"] {
        assert!(work.model(&format!("{folder}/field.safetensors")).state == one.state, "{folder}");
    }
    for ranks in [2, 3] {
        let done = on_ranks(&work, ranks, &format!("{train} --out of-{ranks}")).done();
        let several = work.model(&format!("of-{ranks}/field.safetensors"));
        let [first, later] = like(&several, &one);
        println!(
            "{ranks} ranks: losses differ from one process's by {first:.1e} in {FIRST_STEPS} steps, {later:.1e} later"
        );
        assert!(several.record.engine.contains(&format!("{ranks} ranks")), "{}", several.record.engine);
        let [mine, its] = [&several, &one].map(|model| model.record.held_out.clone().unwrap().errors);
        assert_eq!(mine.len(), its.len());
        assert!((mine[2].mse / its[2].mse - 1.0).abs() < 0.1, "{} and {}", mine[2].mse, its[2].mse);
        // One speaks.
        assert_eq!(done.stdout.lines().count(), 1, "{}", done.stdout);
        assert_eq!(done.stderr.matches("wrote of-").count(), 1, "{}", done.stderr);
        assert!(work.text(&format!("of-{ranks}/log.jsonl")).lines().count() > 10);
        on_ranks(&work, ranks, &format!("{train} --out again-{ranks}")).done();
        assert!(work.model(&format!("again-{ranks}/field.safetensors")).state == several.state, "again");
    }
}

#[test]
fn ctrl_c_saves_once_and_any_number_of_ranks_goes_on() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 4000");
    work.imf(&format!("{train} --threads 1 --out whole")).done();
    let whole = work.model("whole/field.safetensors");
    let words = format!("-n 2 imf {train} --mpi --threads 1 --out broken --set checkpoint_every=0.05");
    let ended = ended(&work, &words, |child| {
        await_file(&work, "broken/checkpoint.safetensors", child);
        signal("INT", &child.id().to_string());
    });
    // The code is mpirun's own after a signal.
    assert!(ended.code != Some(0), "{}", ended.stderr);
    assert_eq!(ended.stderr.matches("is saved in broken/checkpoint").count(), 1, "{}", ended.stderr);
    assert!(errors(&ended.stderr).is_empty(), "{}", ended.stderr);
    let saved = work.model("broken/checkpoint.safetensors");
    assert!((1..4000).contains(&saved.record.steps) && !saved.record.finished, "{}", saved.record.steps);

    // The checkpoint knows nothing of ranks: two, three and one go on from it, and two to the bits of two in one go.
    on_ranks(&work, 2, &format!("{train} --out of-two")).done();
    for ranks in [2, 3, 1] {
        let folder = format!("resumed-{ranks}");
        std::fs::create_dir(work.path(&folder)).unwrap();
        work.write(&format!("{folder}/checkpoint.safetensors"), work.bytes("broken/checkpoint.safetensors"));
        on_ranks(&work, ranks, &format!("{train} --out {folder} --resume")).done();
        let resumed = work.model(&format!("{folder}/field.safetensors"));
        assert_eq!(resumed.record.steps, 4000);
        // After thousands of steps the paths have parted; how good they are has not.
        let [found, expected] = [&resumed, &whole].map(|model| model.record.losses.last().unwrap().loss);
        assert!((found / expected - 1.0).abs() < 0.1, "{ranks} ranks: {found} and {expected}");
        if ranks == 2 {
            assert!(resumed.state == work.model("of-two/field.safetensors").state);
        }
    }
}

#[test]
fn what_fails_on_one_rank_or_on_all_ends_all_with_one_message() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --mpi --threads 1 --steps 100000000");
    // All alike.
    for (line, word) in [
        (train.replace("train siren5 data", "train siren5 nowhere"), "nowhere/manifest.json"),
        (format!("{train} --memory 1MiB"), "this needs about"),
    ] {
        let ended = ended(&work, &format!("-n 3 imf {line} --out out"), |_| ());
        let said = errors(&ended.stderr);
        assert!(ended.code != Some(0) && said.len() == 1 && said[0].contains(word), "{}", ended.stderr);
    }
    // One alone, before the first step: another seed, too little memory.
    for (second, word) in [
        (train.replace("--mpi", "--mpi --set seed=5"), "different training"),
        (format!("{train} --memory 1MiB"), "memory"),
    ] {
        let words = format!("-n 1 imf {train} --out out : -n 1 imf {second} --out out");
        let ended = ended(&work, &words, |_| ());
        let said = errors(&ended.stderr);
        assert!(ended.code != Some(0) && said.iter().any(|said| said.contains(word)), "{}", ended.stderr);
    }
    // One is killed, or told to stop, in the middle of training.
    for (name, code) in [("KILL", None), ("TERM", Some(130))] {
        let words = format!("-n 2 imf {train} --out {name} --set checkpoint_every=0.05");
        let checkpoint = format!("{name}/checkpoint.safetensors");
        let ended = ended(&work, &words, |child| {
            await_file(&work, &checkpoint, child);
            let list = format!("/proc/{0}/task/{0}/children", child.id());
            let ranks = std::fs::read_to_string(list).unwrap();
            let last = ranks.split_whitespace().last().expect("ranks are children of mpirun");
            signal(name, last);
        });
        assert!(ended.code != Some(0), "{}", ended.stderr);
        assert!(code.is_none() || ended.code == code, "{:?}\n{}", ended.code, ended.stderr);
        assert!(work.model(&checkpoint).record.steps > 0);
    }
    // Without the flag each would train by itself.
    let words = format!("-n 2 imf {} --out out", train.replace("--mpi", ""));
    assert!(ended(&work, &words, |_| ()).stderr.contains("add --mpi"));
    assert!(!work.path("out/checkpoint.safetensors").exists());
}

#[test]
fn ranks_with_unlike_memory_read_a_large_dataset_in_one_order() {
    let work = Workdir::new();
    work.imf(&format!("{} --shard-samples 30000", DATASET.replace("7,21,12", "24,73,43"))).done();
    // 16 sections of 26,368 samples, one a shard: 3.4 MB beside 25.7 MB for the rest.
    let train = format!("{TRAIN} --steps 300 --set held_out=0");
    let trained = |memory: &str, out: &str| {
        let words = format!(
            "-n 1 imf {train} --mpi --threads 1 --memory 1GiB --out {out} : -n 1 imf {train} --mpi \
                             --threads 1 --memory {memory} --out {out}"
        );
        finish(&words, &mut mpirun(&work, &words)).done();
        work.model(&format!("{out}/field.safetensors"))
    };
    let of_whole = trained("900MiB", "whole");
    let of_groups = trained("27500KiB", "groups");
    assert_eq!(of_whole.record.groups_per_epoch, None);
    assert!(of_groups.record.groups_per_epoch.is_some_and(|groups| (2..16).contains(&groups)));
    assert!(of_groups.state != of_whole.state);
    on_ranks(&work, 2, &format!("{train} --memory 27500KiB --out again")).done();
    assert!(work.model("again/field.safetensors").state == of_groups.state);
}

/// Waits for a file that the child writes.
fn await_file(work: &Workdir, file: &str, child: &mut Child) {
    work.wait_for(file, child);
    assert!(work.path(file).exists(), "{file} was never written");
}

/// Runs `mpirun`, with something done to it on the way, to its end, which must come soon.
fn ended(work: &Workdir, words: &str, on_the_way: impl FnOnce(&mut Child)) -> Finished {
    let begun = Instant::now();
    let mut child = mpirun(work, words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    on_the_way(&mut child);
    let (finished, late) = std::sync::mpsc::channel::<()>();
    let id = child.id().to_string();
    let watch = std::thread::spawn(move || {
        if late.recv_timeout(AT_ONCE).is_err() {
            signal("KILL", &id);
        }
    });
    let output = child.wait_with_output().unwrap();
    let _ = finished.send(());
    watch.join().unwrap();
    assert!(begun.elapsed() < 2 * AT_ONCE, "`mpirun {words}` did not end by itself");
    Finished::new(words, &output)
}
