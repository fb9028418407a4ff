//! A dataset larger than the memory allowed: read from its shards while training runs, to the same bits however often it
//! is interrupted, in the memory that was guaranteed.
#![cfg(target_os = "linux")]

use std::process::Stdio;
use std::time::Duration;

use crate::binary::{Finished, Workdir};

/// 64 sections of all 75,336 voxels, two a shard: 32 shards, 38.6 MB of samples.
const DATASET: &str = "dataset bracket --dims 24,73,43 --density 1 --orientations fibonacci:64 --shard-samples 151000 --out data";
const SAMPLE_BYTES: u64 = 64 * 75_336 * 8;
/// More than an epoch, which has 2,355 steps.
const TRAIN: &str = "train siren5 data --device cpu --network 3x24:10 --rate 1e-3 --batch 2048 --steps 2600 \
                     --threads 2 --set held_out=500";
/// Too little for all samples, and enough for a few groups of them.
const LITTLE: &str = "--memory 60MiB";
const LITTLE_BYTES: u64 = 60 << 20;
const PLENTY: &str = "--memory 2GiB";

/// Runs a command to its end; also the most memory that it ever had, in bytes.
fn with_peak(work: &Workdir, line: &str) -> (Finished, u64) {
    let mut child = work.command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        // The system's mark never falls, so the last look has all that came before.
        peak = kilobytes.map_or(peak, |kilobytes| kilobytes << 10);
        std::thread::sleep(Duration::from_millis(2));
    }
    (Finished::new(line, &child.wait_with_output().unwrap()), peak)
}

#[test]
fn a_dataset_larger_than_memory_trains_from_its_shards_and_resumes_to_the_same_bits() {
    let work = Workdir::new();
    work.imf(DATASET).done();

    // In memory, and with its order.
    let (finished, peak) = with_peak(&work, &format!("{TRAIN} {PLENTY} --no-calibrate --out whole"));
    let finished = finished.done();
    assert!(!finished.stderr.contains("groups an epoch"), "{}", finished.stderr);
    assert!(peak > SAMPLE_BYTES, "all samples in {peak} bytes");
    let in_memory = work.model("whole/field.safetensors");
    assert_eq!(in_memory.record.groups_per_epoch, None);

    // From the shards, in the memory that was allowed.
    let (finished, peak) = with_peak(&work, &format!("{TRAIN} {LITTLE} --out streamed"));
    let finished = finished.done();
    assert!(peak < LITTLE_BYTES, "{peak} bytes instead of {LITTLE_BYTES}\n{}", finished.stderr);
    let streamed = work.model("streamed/field.safetensors");
    let groups = streamed.record.groups_per_epoch.expect("groups");
    assert!((2..16).contains(&groups), "{groups} groups");
    finished.warns(&[&format!("is read in {groups} groups an epoch"), "training waited"]);
    assert!(streamed.state != in_memory.state, "the order is another one");
    assert_eq!((streamed.record.steps, in_memory.record.steps), (2600, 2600));
    // And as good: both have come down from 0.3 or so to a few hundredths.
    let [of_memory, of_shards] =
        [&in_memory, &streamed].map(|model| model.record.losses.last().unwrap().loss);
    assert!(of_shards < 1.5 * of_memory && of_memory < 0.1, "{of_shards} and {of_memory}");

    // Interrupted, and gone on with where there is plenty.
    let begin = format!("{TRAIN} {LITTLE} --out broken --set checkpoint_every=0.05");
    let checkpoint = "broken/checkpoint.safetensors";
    work.interrupted_after(5, &begin).interrupted(&["is saved in", checkpoint, "--resume"]);
    let saved = work.model(checkpoint);
    assert!((1..2600).contains(&saved.record.steps), "{}", saved.record.steps);
    assert_eq!(saved.record.groups_per_epoch, Some(groups));
    work.imf(&format!("{TRAIN} --memory 30MiB --out broken --resume")).refused(&[
        "this needs about",
        &format!("begun on {groups} groups an epoch of data"),
        "raise --memory",
    ]);
    assert!(work.model(checkpoint) == saved, "a refusal changed the checkpoint");
    work.imf(&format!("{TRAIN} {PLENTY} --no-calibrate --out broken --resume")).done();
    for file in ["field.safetensors", "checkpoint.safetensors"] {
        let [whole, broken] = ["streamed", "broken"].map(|folder| work.model(&format!("{folder}/{file}")));
        assert!(whole.state == broken.state, "{file}: the pieces ended elsewhere");
        assert_eq!(broken.record.groups_per_epoch, Some(groups));
    }

    // Begun in memory, it does not go on in another order.
    work.interrupted_after(5, &format!("{TRAIN} {PLENTY} --out held --set checkpoint_every=0.05"))
        .interrupted(&["is saved in"]);
    work.imf(&format!("{TRAIN} {LITTLE} --out held --resume"))
        .refused(&["begun with all of them in memory", "8 bytes each"]);

    // Not even a sample of each shard at a time.
    work.imf(&format!("{TRAIN} --memory 1MiB --out none")).refused(&[
        "parameters at 64 bytes each",
        "4821504 samples of data",
        "8 bytes each",
        "--shard-samples",
        "--batch",
    ]);
}
