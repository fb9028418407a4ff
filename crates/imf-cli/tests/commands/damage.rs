//! Files that are cut short, foreign, of a newer version or not there: one message that names the file.

use crate::binary::{DATASET, TRAIN, Workdir};

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn damaged_datasets_are_named() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 3 --out model");
    work.imf(&train.replace("train siren5 data", "train siren5 nowhere"))
        .refused(&["nowhere", "nor the folder of a dataset"]);

    let manifest = "data/manifest.json";
    let whole = work.bytes(manifest);
    let foreign = replaced(&whole, "imf-dataset", "someone-else");
    let newer = replaced(&whole, "\"version\": 1", "\"version\": 9");
    for (bytes, words) in [
        (&whole[..whole.len() / 2], ["not an intact dataset file", "EOF"]),
        (b"", ["not an intact dataset file", "EOF"]),
        (b"{\"format\": 3}", ["not an intact dataset file", "expected a string"]),
        (b"\xff\xfe not a text", ["cannot read", "UTF-8"]),
        (&foreign, ["not an intact dataset file", "someone-else"]),
        (&newer, ["version 9", "newer imf"]),
    ] {
        work.write(manifest, bytes);
        work.imf(&train).refused(&[&[manifest], &words[..]].concat());
        work.refuse("info data", &[&[manifest], &words[..]].concat());
    }
    // Nor does `imf dataset` write over what it cannot read.
    work.imf(DATASET).refused(&[manifest, "version 9", "newer imf"]);
    assert_eq!(work.bytes(manifest), newer);
    work.write(manifest, &whole);

    for file in ["data/shard-00000.safetensors", "data/obstacle.safetensors"] {
        let whole = work.bytes(file);
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        for bytes in
            [&whole[..whole.len() - 7], &whole[..3], b"", b"solid something else entirely", &flipped[..]]
        {
            work.write(file, bytes);
            work.imf(&train).refused(&[file, "not an intact dataset file"]);
        }
        std::fs::remove_file(work.path(file)).unwrap();
        work.imf(&train).refused(&[file, "cannot read"]);
        work.write(file, &whole);
    }
    assert!(!work.path("model/field.safetensors").exists());
    work.imf(&train).done();
}

#[test]
fn damaged_models_are_named() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 3 --out model")).done();
    let file = "model/field.safetensors";
    work.write("poses.csv", "x,y,z,theta,phi\n1,2,3,4,5\n");
    let eval = format!("eval {file} --device cpu --random 2 --imf fibonacci:2");
    let finetune = format!("finetune {file} data --device cpu --steps 2 --out adapted");
    let query = format!("query {file} poses.csv --out answers.csv");
    let refuse = |words: &str| {
        for line in [&eval, &finetune, &query, &format!("info {file}")] {
            work.refuse(line, &[file, words]);
        }
    };
    let whole = work.bytes(file);
    let newer = replaced(&whole, r#"\"version\":1"#, r#"\"version\":9"#);
    let foreign = replaced(&whole, "imf-model", "a-puzzle!");
    // Behind the header, whose length stands in front, the weights come first.
    let first_weight = 8 + u64::from_le_bytes(whole[..8].try_into().unwrap()) as usize;
    let mut not_a_number = whole.clone();
    not_a_number[first_weight..first_weight + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    for (bytes, words) in [
        (&whole[..whole.len() - 1], "not an intact model"),
        (b"a letter to the editor", "not an intact model"),
        (&foreign, "a-puzzle!"),
        (&not_a_number, "checksum"),
        (&newer, "version 9"),
    ] {
        work.write(file, bytes);
        refuse(words);
    }
    std::fs::remove_file(work.path(file)).unwrap();
    refuse("cannot read the model");
    work.write(file, &whole);
    work.calibrate_quickly(file);
    work.imf(&eval).done();
}

#[test]
fn a_damaged_checkpoint_is_named() {
    let work = Workdir::with_dataset();
    let train = format!("{TRAIN} --steps 3 --out model");
    work.imf(&format!("{train} --resume")).refused(&["nothing to resume", "model/checkpoint.safetensors"]);
    work.imf(&train).done();
    work.imf(&train).done().warns(&["an earlier training in model is replaced"]);
    let checkpoint = "model/checkpoint.safetensors";
    let whole = work.bytes(checkpoint);
    work.write(checkpoint, &whole[..whole.len() / 2]);
    work.imf(&format!("{train} --resume")).refused(&[checkpoint, "not an intact model"]);
    // The finished model is not a checkpoint: it has no moments.
    let mut model = work.model("model/field.safetensors");
    model.record.finished = false;
    model.write(&work.path(checkpoint)).unwrap();
    work.imf(&format!("{train} --resume")).refused(&[checkpoint, "no optimiser state"]);
}
