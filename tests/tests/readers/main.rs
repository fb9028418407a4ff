//! Readers of foreign files, on the inputs that fuzzing has kept (`fuzz/corpus`), on files of today's library, and on seeded changes
//! of both: neither a panic nor more memory than their multiple of the file (`imf_tests::readers`).

#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

mod seeds;

use std::fs;
use std::path::{Path, PathBuf};

use imf_tests::readers::{READERS, Reader};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use seeds::Seed;

/// Changed inputs for each reader; fewer of one that reads a folder of files, which are written first.
const CHANGED: usize = 20_000;
const CHANGED_FOLDERS: usize = 1_000;
/// The longest input that is changed.
const LONGEST: usize = 16_384;
/// Meshes shorter than this are read cut off after every byte.
const SMALL_MESH: usize = 2_048;
/// Pieces of text at which readers decide.
const TELLING: [&[u8]; 24] = [
    b"0",
    b"1",
    b"9",
    b"-",
    b".",
    b"e",
    b"1e308",
    b"1e-308",
    b"nan",
    b"inf",
    b"-1",
    b"4294967295",
    b"18446744073709551615",
    b"\n",
    b" ",
    b"/",
    b"\\",
    b"\"",
    b"[",
    b"]",
    b"{",
    b"}",
    b"<",
    b">",
];

fn corpus(reader: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(reader)
}

/// Name and content of every input of a reader.
fn inputs(reader: &str, made: &[Seed]) -> Vec<(String, Vec<u8>)> {
    let folder = corpus(reader);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let read = |path: PathBuf| (path.display().to_string(), fs::read(&path).unwrap());
    let mut inputs: Vec<_> = entries.map(|entry| read(entry.unwrap().path())).collect();
    inputs.sort();
    let made = made.iter().filter(|seed| seed.reader == reader);
    inputs.extend(made.map(|seed| (seed.name.to_owned(), seed.bytes.clone())));
    inputs
}

/// One to five changes anywhere: other bytes, pieces lost, doubled, or taken from another input.
fn change(bytes: &mut Vec<u8>, other: &[u8], random: &mut ChaCha8Rng) {
    for _ in 0..random.random_range(1..6) {
        let at = random.random_range(0..=bytes.len());
        let end = (at + random.random_range(1..40)).min(bytes.len());
        match random.random_range(0..7) {
            0 if at < bytes.len() => bytes[at] = random.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << random.random_range(0..8),
            2 => drop(bytes.drain(at..end)),
            3 => {
                let (piece, to) = (bytes[at..end].to_vec(), random.random_range(0..=bytes.len()));
                bytes.splice(to..to, piece);
            }
            4 => {
                let piece = TELLING[random.random_range(0..TELLING.len())];
                bytes.splice(at..end.min(at + random.random_range(0..3)), piece.iter().copied());
            }
            5 => {
                let from = random.random_range(0..=other.len());
                let piece = &other[from..(from + random.random_range(1..200)).min(other.len())];
                bytes.splice(at..end, piece.iter().copied());
            }
            // A number of four or eight bytes at its limits.
            _ => {
                let number = [0_u64, 1, u64::MAX, i64::MAX as u64, u32::MAX.into(), 1 << 40];
                let number = number[random.random_range(0..number.len())].to_le_bytes();
                let end = (at + random.random_range(1..=8)).min(bytes.len());
                bytes[at..end].copy_from_slice(&number[..end - at]);
            }
        }
    }
    bytes.truncate(LONGEST);
}

/// Runs a reader; a panic says which input it was.
fn check(reader: &Reader, name: &str, input: &[u8]) -> bool {
    let read = std::panic::catch_unwind(|| reader.check(input));
    read.unwrap_or_else(|_| {
        let kept = std::env::temp_dir().join(format!("imf-{}-failure", reader.name));
        fs::write(&kept, input).unwrap();
        panic!("{} failed on {name}, kept as {}", reader.name, kept.display());
    })
}

/// In one test, so that the inputs are made and changed in one order.
#[test]
fn no_input_makes_a_reader_panic_or_take_more_memory_than_its_multiple() {
    let made = seeds::all();
    for reader in &READERS {
        let inputs = inputs(reader.name, &made);
        let accepted = inputs.iter().filter(|(name, input)| check(reader, name, input)).count();
        assert!(accepted > 0, "{}: none of its inputs is accepted, so that little is tested", reader.name);
        let is_small = |input: &[u8]| reader.name.starts_with("mesh_") && input.len() < SMALL_MESH;
        for (name, input) in inputs.iter().filter(|(_, input)| is_small(input)) {
            for length in 0..input.len() {
                check(reader, &format!("{length} bytes of {name}"), &input[..length]);
            }
        }
        let mut random = ChaCha8Rng::seed_from_u64(29);
        let changed = if reader.name == "dataset" { CHANGED_FOLDERS } else { CHANGED };
        for number in 0..changed {
            let (name, input) = &inputs[random.random_range(0..inputs.len())];
            let mut bytes = input.clone();
            change(&mut bytes, &inputs[random.random_range(0..inputs.len())].1, &mut random);
            check(reader, &format!("change {number} of {name}"), &bytes);
        }
    }
}

/// For the fuzzer, after a format has changed.
#[test]
#[ignore = "writes into fuzz/corpus"]
fn the_librarys_own_files_become_inputs() {
    for Seed { reader, name, bytes } in seeds::all() {
        fs::create_dir_all(corpus(reader)).unwrap();
        fs::write(corpus(reader).join(name), bytes).unwrap();
    }
}
