//! Ctrl-C: what is finished is kept, and going on ends where a run in one go ends.
#![cfg(unix)]

use serde_json::json;

use crate::binary::{DATASET, TRAIN, Workdir};

/// Fifteen epochs, of which the interruption leaves thirteen.
const STEPS: &str = "--steps 600 --set schedule=cosine";

#[test]
fn a_training_goes_on_from_its_checkpoint_to_the_bits_of_one_in_one_go() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} {STEPS} --out whole")).done();

    let begin = format!("{TRAIN} {STEPS} --out broken --set checkpoint_every=0.02");
    let checkpoint = "broken/checkpoint.safetensors";
    work.interrupted_after(5, &begin).interrupted(&["is saved in", checkpoint, "--resume"]);
    let saved = work.model(checkpoint);
    assert!((1..600).contains(&saved.record.steps) && !saved.record.finished, "{}", saved.record.steps);
    assert!(saved.is_resumable() && !work.path("broken/field.safetensors").exists());

    // Nothing starts over what is unfinished, and nothing goes on with other samples.
    let steps = saved.record.steps.to_string();
    work.imf(&begin).refused(&[checkpoint, "unfinished", &steps, "--resume"]);
    work.imf(&DATASET.replace("fibonacci:16 --out data", "fibonacci:15 --out other")).done();
    let elsewhere = begin.replace("train siren5 data", "train siren5 other");
    work.imf(&format!("{elsewhere} --resume")).refused(&[checkpoint, "another dataset"]);
    assert!(work.model(checkpoint) == saved, "a refusal changed the checkpoint");

    let resumed = work.imf(&format!("{TRAIN} {STEPS} --out broken --resume")).done();
    let cursor = saved.record.cursor;
    let from = format!("resuming at epoch {}, step {} ({steps} steps done)", cursor.epoch, cursor.step);
    resumed.warns(&[&from]);
    for file in ["field.safetensors", "checkpoint.safetensors"] {
        let [whole, broken] = ["whole", "broken"].map(|folder| work.model(&format!("{folder}/{file}")));
        assert!(whole.state == broken.state, "{file}: the pieces ended elsewhere");
        assert_eq!((whole.record.steps, broken.record.steps), (600, 600));
        assert_eq!(whole.record.plan, broken.record.plan);
    }
    let over = work.imf(&format!("{TRAIN} {STEPS} --out broken --resume")).done();
    over.warns(&[&format!("{checkpoint} is finished after 600 steps")]);
}

#[test]
fn a_run_that_ends_while_it_writes_says_that_its_folder_is_not_complete() {
    let work = Workdir::new();
    work.write("path.csv", "x,y,z\n24.5,73.5,95\n24.5,73.5,60\n");
    for (out, line) in [
        ("path", "check bracket path.csv --pitch 0.7 --stock box:5 --out path"),
        ("voxels", "voxelize bracket --pitch 0.4 --out voxels"),
    ] {
        let left = [&format!("the results in {out} are not complete"), "same command"];
        work.interrupted_once_there_is(out, line).interrupted(&left);
        let summary = work.path(out).join("summary.json");
        assert!(!summary.exists());
        let whole = work.imf(line);
        assert!(summary.exists(), "{}", whole.stderr);
        assert!(work.names(out).iter().all(|name| !name.starts_with('.')), "{:?}", work.names(out));
    }
}

#[test]
fn a_dataset_keeps_its_finished_shards() {
    let work = Workdir::new();
    // 53 sections of 75,336 voxels, all sampled, fill a shard: four shards.
    let dataset = "dataset bracket --dims 24,73,43 --density 1 --orientations fibonacci:212 --json --out";
    let first = "broken/shard-00000.safetensors";
    work.interrupted_once_there_is(first, &format!("{dataset} broken"))
        .interrupted(&["finished shards are kept in broken", "same command"]);
    let kept = work.bytes(first);

    // Training does not start on a part of it.
    work.imf("train siren5 broken --device cpu --out model").refused(&["broken", "lacks", "of 4 shards"]);

    let went_on = work.imf(&format!("{dataset} broken")).done().json();
    let (kept_shards, made) = (&went_on["shards_kept"], &went_on["shards_made"]);
    assert!(kept_shards.as_u64().unwrap() > 0 && made.as_u64().unwrap() > 0, "{went_on}");
    assert_eq!(went_on["samples"], json!(212 * 75_336));
    assert!(work.bytes(first) == kept, "a finished shard was made again");

    let whole = work.imf(&format!("{dataset} whole")).done().json();
    assert_eq!((&whole["shards_made"], &whole["shards_kept"]), (&json!(4), &json!(0)));
    let files = work.names("whole");
    assert_eq!(files.len(), 6, "manifest, obstacle, four shards: {files:?}");
    for name in files {
        let same = work.bytes(&format!("whole/{name}")) == work.bytes(&format!("broken/{name}"));
        assert!(same, "{name} differs from that of a run in one go");
    }
}
