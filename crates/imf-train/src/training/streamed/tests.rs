use std::collections::BTreeMap;
use std::path::Path;

use super::*;
use crate::dataset::{Layout, generate_partition, load};
use crate::engine::CpuTrainer;
use crate::fixtures::{self, Recorder, bits, go_on, scene};
use crate::training::run::{Report, train};
use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_fields::recipe::{Sampling, TrainingLength, TrainingState};
use imf_fields::siren::SirenShape;
use std::ops::ControlFlow;

const SHAPE: SirenShape = SirenShape { width: 16, hidden: 2, skip_after: None, omega: 10.0 };

/// Seven shards, the last one smaller: 13 sections of 347 samples, two a shard.
fn dataset(folder: &Path) -> Shards {
    let set = OrientationSet::parse("fibonacci:13").unwrap();
    let layout = Layout { shard_samples: Some(2 * 347), partition: None };
    generate_partition(folder, &scene(), &set, &Sampling::default(), &layout, Control::quiet(), &|_| {})
        .unwrap();
    let shards = Shards::open(folder).unwrap();
    assert_eq!((shards.count(), shards.samples()), (7, 13 * 347));
    shards
}

/// Three epochs. A group's samples are no multiple of a batch: batches straddle groups.
fn plan() -> TrainingPlan {
    fixtures::plan(3)
}

fn engine(plan: &TrainingPlan, state: TrainingState) -> CpuTrainer {
    fixtures::engine(SHAPE, plan, state)
}

fn fed(shards: &Shards, groups: usize, plan: &TrainingPlan, start: Cursor) -> Vec<Vec<[u32; INPUTS + 1]>> {
    let mut recorder = Recorder::default();
    let (outcome, _) = train_streamed(plan, shards, groups, &mut recorder, start, &mut go_on).unwrap();
    assert_eq!(outcome, Outcome::Finished);
    recorder.rows()
}

#[test]
fn one_group_has_the_bits_of_a_training_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    let samples = load(folder.path()).unwrap().2;
    let plan = plan();
    let mut in_memory = engine(&plan, TrainingState::new(&SHAPE, 1));
    train(&plan, &samples, &mut in_memory, Cursor::default(), &mut go_on).unwrap();
    let expected = (in_memory.take_mean_loss().unwrap().to_bits(), in_memory.state().unwrap());
    let trained = |groups: usize| {
        let mut streamed = engine(&plan, TrainingState::new(&SHAPE, 1));
        train_streamed(&plan, &shards, groups, &mut streamed, Cursor::default(), &mut go_on).unwrap();
        (streamed.take_mean_loss().unwrap().to_bits(), streamed.state().unwrap())
    };
    assert!(trained(1) == expected);
    assert!(trained(3) != expected, "three groups have another order");
}

#[test]
fn an_epoch_in_groups_has_every_sample_once_and_two_epochs_differ() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    let mut expected = bits(&load(folder.path()).unwrap().2);
    expected.sort_unstable();
    let section_of = |row: &[u32; INPUTS + 1]| [row[3], row[4]];
    for groups in [1, 2, 3, 5, 8, 100] {
        for (epochs, batch) in [(2, 150), (2, 4000), (1, 1)] {
            let plan = TrainingPlan { length: TrainingLength::Epochs(epochs), batch, ..plan() };
            let batches = fed(&shards, groups, &plan, Cursor::default());
            let per_epoch = plan.steps_per_epoch(expected.len()) as usize;
            assert_eq!(batches.len(), per_epoch * epochs as usize, "{groups} groups, batch {batch}");
            let orders: Vec<Vec<_>> =
                batches.chunks(per_epoch).map(<[Vec<[u32; INPUTS + 1]>]>::concat).collect();
            for order in &orders {
                let mut sorted = order.clone();
                sorted.sort_unstable();
                assert!(sorted == expected, "{groups} groups, batch {batch}");
                // Mixed: each section has its part of any run of neighbours of the order, up to chance.
                for part in order.chunks_exact(13 * 25) {
                    let mut sections = BTreeMap::new();
                    part.iter().for_each(|row| *sections.entry(section_of(row)).or_insert(0) += 1);
                    // 25 of each expected: 5 is four standard deviations of 4.8 away.
                    assert!(
                        sections.len() == 13 && sections.values().all(|&n| n > 5),
                        "{groups}: {sections:?}"
                    );
                }
            }
            assert!(orders.len() == 1 || orders[0] != orders[1]);
        }
    }
}

#[test]
fn going_on_from_any_step_reads_the_same_batches() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    for length in [TrainingLength::Epochs(2), TrainingLength::Steps(41)] {
        let plan = TrainingPlan { length, ..plan() };
        let whole = fed(&shards, 2, &plan, Cursor::default());
        let per_epoch = plan.steps_per_epoch(shards.samples());
        assert_eq!(whole.len() as u64, plan.total_steps(shards.samples()));
        for step in 0..whole.len() as u64 {
            let start = Cursor { epoch: step / per_epoch, step: step % per_epoch };
            assert!(fed(&shards, 2, &plan, start) == whole[step as usize..], "from step {step}");
        }
    }
}

#[test]
fn pieces_have_the_bits_of_one_go_and_the_reader_ends_with_each() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    let plan = plan();
    let mut whole = engine(&plan, TrainingState::new(&SHAPE, 1));
    train_streamed(&plan, &shards, 2, &mut whole, Cursor::default(), &mut go_on).unwrap();
    let (mut state, mut cursor, mut pieces) = (TrainingState::new(&SHAPE, 1), Cursor::default(), 0);
    loop {
        let plan = TrainingPlan { report_every: 3 + pieces % 4, ..plan };
        let mut engine = engine(&plan, state);
        let stop = &mut |_: &Report, _: &mut dyn TrainingEngine| ControlFlow::Break(());
        let (outcome, _) = train_streamed(&plan, &shards, 2, &mut engine, cursor, stop).unwrap();
        state = engine.state().unwrap();
        pieces += 1;
        match outcome {
            Outcome::Stopped(next) => cursor = next,
            Outcome::Finished => break,
        }
    }
    assert!(pieces > 10, "{pieces} pieces");
    assert!(state == whole.state().unwrap(), "the pieces ended elsewhere");
}

#[test]
fn groups_are_as_few_as_the_memory_allows_and_even() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    // Six shards of 694 samples and one of 347, 13 sections.
    let one = shards.memory_in_groups(1);
    let file = one - 2 * Samples::memory_bytes(13, 13 * 347);
    assert!((694 * 8..694 * 8 + 8192).contains(&file), "a file of {file} bytes");
    for entry in std::fs::read_dir(folder.path()).unwrap().map(Result::unwrap) {
        let is_shard = entry.file_name().to_str().unwrap().starts_with("shard");
        assert!(!is_shard || entry.metadata().unwrap().len() <= file);
    }
    let thirds = Samples::memory_bytes(13, 6 * 232 + 116);
    assert_eq!(shards.memory_in_groups(3), 2 * thirds + file);
    assert_eq!(shards.memory_whole(), Samples::memory_bytes(13, 13 * 347) + file);
    for groups in 1..20 {
        let memory = shards.memory_in_groups(groups);
        assert_eq!(shards.groups_within(memory), Some(groups));
        assert_eq!(shards.groups_within(memory - 1), Some(groups + 1));
    }
    let least = shards.memory_in_groups(694);
    assert_eq!(shards.groups_within(least), Some(694));
    assert_eq!(shards.groups_within(least - 1), None);
    // What is guaranteed is what is taken: the room never grows. And nobody gets more than a card more than another.
    let mut room = shards.room_for(3);
    let capacity = (room.voxels.capacity(), room.values.capacity(), room.starts.capacity());
    let mut buffer = Vec::new();
    for (epoch, number) in [(0, 0), (0, 1), (0, 2), (1, 0)] {
        let deal = Deal::new(3, 9, epoch);
        let keep = |shard: usize, sample: usize| deal.group_of(shard, sample) == number;
        shards.read_into(&mut buffer, &mut room, &AtomicBool::new(false), &keep).unwrap();
        assert_eq!((room.voxels.capacity(), room.values.capacity(), room.starts.capacity()), capacity);
        assert!(buffer.capacity() as u64 <= file);
        assert!(room.len() >= 6 * 231 + 115 && room.angles.len() == 13);
        let group = Group::of_epoch(&shards, 3, 9, epoch).nth(number).unwrap();
        assert_eq!(room.len(), group.places.len());
    }
}

#[test]
fn every_sample_is_dealt_once_and_two_epochs_deal_otherwise() {
    for (groups, samples) in [(1, 10), (2, 7), (3, 9), (5, 3), (7, 100)] {
        let dealt = |epoch: u64| -> Vec<usize> {
            let deal = Deal::new(groups, 4, epoch);
            (0..samples).map(|sample| deal.group_of(2, sample)).collect()
        };
        let (first, second) = (dealt(0), dealt(1));
        for group in 0..groups {
            let count = first.iter().filter(|&&found| found == group).count();
            assert_eq!(count, Deal::new(groups, 4, 0).count(group, 2, samples), "{groups}, {samples}");
            assert!((samples / groups..=samples.div_ceil(groups)).contains(&count));
        }
        assert!(first.iter().all(|&group| group < groups));
        assert!(first == dealt(0) && (samples < 9 || groups == 1 || first != second));
    }
}

#[test]
fn a_shard_that_goes_bad_while_training_stops_it_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let shards = dataset(folder.path());
    let path = folder.path().join("shard-00004.safetensors");
    let mut bytes = std::fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let mut recorder = Recorder::default();
    let run = |recorder: &mut Recorder| {
        train_streamed(&plan(), &shards, 2, recorder, Cursor::default(), &mut go_on)
    };
    let error = run(&mut recorder).unwrap_err();
    assert!(matches!(error, TrainError::Dataset(DatasetError::Damaged { .. })), "{error}");
    assert!(error.to_string().contains("shard-00004"), "{error}");
    std::fs::remove_file(&path).unwrap();
    assert!(run(&mut recorder).unwrap_err().to_string().contains("shard-00004"));
    // Of a foreign size it is not even read, nor is a dataset opened that has it.
    for length in [100, 100_000] {
        std::fs::write(&path, vec![0; length]).unwrap();
        let error = run(&mut recorder).unwrap_err().to_string();
        assert!(error.contains("shard-00004") && error.contains(&format!("{length} bytes")), "{error}");
        assert!(matches!(Shards::open(folder.path()), Err(DatasetError::Damaged { .. })));
    }
    let none = train_streamed(&plan(), &shards, 0, &mut recorder, Cursor::default(), &mut go_on);
    assert!(none.unwrap_err().to_string().contains("at least one group"));
}
