//! Training from a dataset larger than memory: it is read in groups while training runs.
//!
//! An epoch's order follows from the plan's seed, the epoch, the number of groups and the dataset, from nothing else:
//!
//! 1. Every shard's samples are distributed over the groups: each run of as many neighbours as there are groups has
//!    one for each, in a rotation that depends on seed, epoch, shard and run. So every group has its part of every
//!    section, evenly over the part, and all groups of an epoch together have every sample once.
//! 2. The samples of a group, in the order of the dataset, are permuted by seed, epoch and the group's number. One group has
//!    the order of [`super::run::train`].
//!
//! Groups follow each other without a seam: a batch may have its first samples from one and its others from the next,
//! so an epoch has as many steps as in memory. Batches are as mixed as those of a training in memory, and so are the last ones
//! that a network sees, for the price of reading all files once for every group. Where a group was a few whole shards instead,
//! the network ended on the sections of the last ones and erred twice as much at others.
//!
//! A second thread reads the next group while the present one is trained on. Two groups' room is allocated once and
//! goes to and fro between the threads; [`Shards::memory_in_groups`] says how much that is.

use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};

use super::TrainingEngine;
use super::permutation::{Permutation, mix};
use super::run::{Observer, Outcome, Start, TrainError, gather, train_by};
use crate::dataset::{DatasetError, Shards};
use crate::samples::Samples;
use imf_core::control::Cancelled;
use imf_core::section::SectionError;
use imf_fields::recipe::{Cursor, RecipeError, TrainingPlan};
use imf_fields::siren::INPUTS;

/// Sets the turns of dealing apart from the order of the samples.
const DEAL_KEY: u64 = 0x7368_6172_6473;
/// Buffers for groups: one in use, one being read.
const BUFFERS: usize = 2;

/// Who gets which samples of an epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Deal {
    groups: usize,
    key: u64,
}

impl Deal {
    fn new(groups: usize, seed: u64, epoch: u64) -> Self {
        Self { groups, key: mix(mix(mix(seed) ^ DEAL_KEY) ^ epoch) }
    }

    fn group_of(self, shard: usize, sample: usize) -> usize {
        let run = sample / self.groups;
        (sample % self.groups + self.turn(shard, run)) % self.groups
    }

    /// Which group has the first sample of a run.
    fn turn(self, shard: usize, run: usize) -> usize {
        (mix(mix(self.key ^ shard as u64) ^ run as u64) % self.groups as u64) as usize
    }

    /// How many of a shard's samples a group has.
    fn count(self, group: usize, shard: usize, samples: usize) -> usize {
        let (runs, rest) = (samples / self.groups, samples % self.groups);
        let place = (group + self.groups - self.turn(shard, runs)) % self.groups;
        runs + usize::from(place < rest)
    }
}

/// One group of an epoch, and where its samples stand in the epoch's order.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Group {
    epoch: u64,
    /// Number in the epoch, from 0.
    number: usize,
    deal: Deal,
    places: Range<usize>,
}

impl Group {
    fn of_epoch(shards: &Shards, groups: usize, seed: u64, epoch: u64) -> impl Iterator<Item = Self> {
        let deal = Deal::new(groups, seed, epoch);
        let mut start = 0;
        (0..groups).map(move |number| {
            let of_shard = |shard| deal.count(number, shard, shards.samples_of(shard));
            let samples: usize = (0..shards.count()).map(of_shard).sum();
            let places = start..start + samples;
            start += samples;
            Self { epoch, number, deal, places }
        })
    }

    fn order(&self, seed: u64) -> Permutation {
        let seed = if self.number == 0 { seed } else { mix(mix(seed) ^ mix(self.number as u64)) };
        Permutation::new(self.places.len(), seed, self.epoch)
    }

    fn holds(&self, epoch: u64, place: usize) -> bool {
        self.epoch == epoch && self.places.contains(&place)
    }
}

/// A group in memory.
struct Loaded {
    group: Group,
    order: Permutation,
    samples: Samples,
}

/// What the reading thread does: groups from `start` on, up to the run's last sample, each into a buffer that comes
/// back from the trainer.
struct Reader<'a> {
    shards: &'a Shards,
    groups: usize,
    seed: u64,
    /// Epoch and place of the first and of the last sample of the run.
    run: [(u64, usize); 2],
    stopped: &'a AtomicBool,
}

impl Reader<'_> {
    fn run(&self, empty: &Receiver<Samples>, full: &SyncSender<Result<Loaded, DatasetError>>) {
        let [(first_epoch, first), (last_epoch, last)] = self.run;
        let mut file = Vec::new();
        for epoch in first_epoch..=last_epoch {
            for group in Group::of_epoch(self.shards, self.groups, self.seed, epoch) {
                let before = epoch == first_epoch && group.places.end <= first;
                let after = epoch == last_epoch && group.places.start > last;
                if before || after || group.places.is_empty() {
                    continue;
                }
                // The trainer is gone where nothing comes back, and where nobody takes what was read.
                let Ok(mut samples) = empty.recv() else { return };
                let Group { number, deal, .. } = group;
                let keep = |shard: usize, sample: usize| deal.group_of(shard, sample) == number;
                let read = self.shards.read_into(&mut file, &mut samples, self.stopped, &keep);
                let failed = read.is_err();
                let loaded = read.map(|()| Loaded { order: group.order(self.seed), group, samples });
                if full.send(loaded).is_err() || failed {
                    return;
                }
            }
        }
    }
}

/// The trainer's end: the group in use.
struct Groups {
    full: Receiver<Result<Loaded, DatasetError>>,
    empty: Sender<Samples>,
    current: Option<Loaded>,
    waited: Duration,
}

impl Groups {
    /// The group that holds a place, at or after the one in use.
    fn at(&mut self, epoch: u64, place: usize) -> Result<&Loaded, TrainError> {
        while !self.current.as_ref().is_some_and(|loaded| loaded.group.holds(epoch, place)) {
            if let Some(spent) = self.current.take() {
                // A reader that has ended needs no more room.
                let _ = self.empty.send(spent.samples);
            }
            let begun = Instant::now();
            // A reader that is gone has panicked, which is passed on when it is joined.
            let next = self.full.recv().unwrap_or(Err(SectionError::from(Cancelled).into()))?;
            self.waited += begun.elapsed();
            self.current = Some(next);
        }
        self.current.as_ref().ok_or(TrainError::NoSamples)
    }

    /// Fills the rows of a batch from a place of the epoch on.
    fn fill(
        &mut self,
        epoch: u64,
        first: usize,
        inputs: &mut [f32],
        targets: &mut [f32],
    ) -> Result<(), TrainError> {
        let mut row = 0;
        while row < targets.len() {
            let Loaded { group, order, samples } = self.at(epoch, first + row)?;
            let within = first + row - group.places.start;
            let rows = row..targets.len().min(group.places.end - first);
            row = rows.end;
            let inputs = &mut inputs[rows.start * INPUTS..rows.end * INPUTS];
            gather(inputs, &mut targets[rows], |index| samples.sample(order.at(within + index)));
        }
        Ok(())
    }
}

/// As [`super::run::train`], on a dataset that is read in `groups` groups an epoch. Also returns how long the trainer
/// waited for shards.
///
/// # Errors
/// As [`super::run::train`], and a shard that is damaged or gone.
pub fn train_streamed(
    plan: &TrainingPlan,
    shards: &Shards,
    groups: usize,
    engine: &mut dyn TrainingEngine,
    start: impl Into<Start>,
    observer: &mut Observer<'_>,
) -> Result<(Outcome, Duration), TrainError> {
    let start = start.into();
    plan.check()?;
    if groups == 0 {
        return Err(RecipeError("an epoch needs at least one group".into()).into());
    }
    let samples = shards.samples();
    if samples == 0 {
        return Err(TrainError::NoSamples);
    }
    let per_epoch = plan.steps_per_epoch(samples);
    let last_step = plan.total_steps(samples).saturating_sub(1);
    let last = ((last_step % per_epoch) as usize * plan.batch + plan.batch).min(samples) - 1;
    let stopped = AtomicBool::new(false);
    let reader = Reader {
        shards,
        groups,
        seed: plan.seed,
        run: [
            (start.cursor.epoch, (start.cursor.step as usize).saturating_mul(plan.batch)),
            (last_step / per_epoch, last),
        ],
        stopped: &stopped,
    };
    std::thread::scope(|scope| {
        let (give, empty) = channel();
        let (send, full) = sync_channel(1);
        for _ in 0..BUFFERS {
            // The other end stands two lines above.
            let _ = give.send(shards.room_for(groups));
        }
        let thread = scope.spawn(move || reader.run(&empty, &send));
        let mut loaded = Groups { full, empty: give, current: None, waited: Duration::ZERO };
        let mut feed = |cursor: Cursor, rows: Range<usize>, inputs: &mut [f32], targets: &mut [f32]| {
            loaded.fill(cursor.epoch, cursor.step as usize * plan.batch + rows.start, inputs, targets)
        };
        let outcome = train_by(plan, samples, &mut feed, &mut |_, _| Ok(()), engine, start, observer);
        let waited = loaded.waited;
        stopped.store(true, std::sync::atomic::Ordering::Relaxed);
        // With its channels closed a reader that still has work stops.
        drop(loaded);
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok((outcome?, waited))
    })
}

#[cfg(test)]
mod tests;
