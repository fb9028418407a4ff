//! A dataset made in partitions, joined, and completed.

use serde_json::json;

use crate::binary::Workdir;

/// Twelve sections of 617 samples in shards of two sections: six shards.
const DATASET: &str =
    "dataset bracket --dims 7,21,12 --allow-coarse --orientations fibonacci:12 --shard-samples 1300 --out";

#[test]
fn shares_join_to_the_dataset_made_at_once_and_what_is_missing_is_named() {
    let work = Workdir::new();
    work.imf(&format!("{DATASET} whole")).done();
    for partition in [1, 3] {
        let made = work.json(&format!("{DATASET} part-{partition} --shard {partition}/3"));
        assert_eq!((&made["shards_made"], &made["shards_of_others"]), (&json!(2), &json!(4)));
    }
    // A partition is not a dataset yet.
    for line in ["train siren5 part-1 --device cpu --out model", "info part-1"] {
        work.imf(line).refused(&["part-1 holds 1 partition", "imf dataset merge"]);
    }

    let merged = work.imf("dataset merge out part-1 part-3").exits(1);
    merged.says(&[
        "missing: shard 1, 2 of 12 orientations: number 2, 8 ",
        "missing: shard 4, 2 of 12 orientations: number 5, 11 ",
    ]);
    merged.warns(&["imf dataset finish out"]);

    // The command that was named makes the rest, without the part.
    let finished = work.json("dataset finish out");
    assert_eq!((&finished["shards_made"], &finished["shards_kept"]), (&json!(2), &json!(4)));
    // All partitions in one folder, too.
    for partition in [2, 3, 1] {
        work.imf(&format!("{DATASET} together --shard {partition}/3")).done();
    }
    work.imf("dataset merge together").done();
    assert_eq!(work.names("whole").len(), 8);
    for folder in ["out", "together"] {
        assert_eq!(work.names(folder), work.names("whole"));
        for name in work.names("whole") {
            let same = work.bytes(&format!("{folder}/{name}")) == work.bytes(&format!("whole/{name}"));
            assert!(same, "{folder}/{name}");
        }
    }
}

#[test]
fn a_dataset_that_is_there_stays_cut_up_as_it_is_and_says_so() {
    let work = Workdir::new();
    let shards = |more: &str| {
        let line = DATASET.replace(" --shard-samples 1300 --out", &format!("{more} --json --out whole"));
        let made = work.imf(&line).done();
        let json = made.json();
        let said = made
            .stderr
            .contains("--shard-samples is passed over: whole is cut up already, at most 2 sections");
        (json["shards_made"].as_u64().unwrap(), json["shards_kept"].as_u64().unwrap(), said)
    };
    assert_eq!(shards(" --shard-samples 1300"), (6, 0, false));
    // As many sections of a file as before, though of another number, or none that was asked for.
    assert_eq!(shards(" --shard-samples 1400"), (0, 6, false));
    assert_eq!(shards(""), (0, 6, false));
    assert_eq!(shards(" --shard-samples 5000"), (0, 6, true));
    std::fs::remove_file(work.path("whole/shard-00003.safetensors")).unwrap();
    assert_eq!(shards(" --shard-samples 1"), (1, 5, true));
}

#[test]
fn shares_of_other_datasets_are_refused() {
    let work = Workdir::new();
    work.imf(&format!("{DATASET} a --shard 1/2")).done();
    work.imf(&format!("{DATASET} b --shard 2/2 --seed 1")).done();
    work.imf("dataset merge out a b")
        .refused(&["b/manifest.2-of-2.json is of another dataset than a/manifest", "the sampling"]);
    work.imf("dataset merge out a nowhere").refused(&["nowhere"]);
    assert!(!work.path("out").exists());
    for line in [format!("{DATASET} a --shard 3/2"), "dataset".to_owned(), "dataset merge".to_owned()] {
        work.imf(&line).exits(2);
    }
}
