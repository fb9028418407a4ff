//! Online training: no fixed set of orientations. A pool holds the latest sections; while training runs, a second thread
//! computes fresh ones at random orientations, and each replaces the oldest.
//!
//! Section `n` has an orientation and samples that follow from the seed and `n`. At step `s` the pool holds the
//! [`OnlineSettings::pool`] sections up to `pool − 1 + s / every`, and the step's batch follows from the seed and `s`. So a
//! run can be repeated, and resumed from the step alone: the pool is computed anew. A trainer that comes too early waits,
//! a producer that is [`OnlineSettings::lead`] sections ahead waits as well; [`Waits`] says who did.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::TrainingEngine;
use super::permutation::mix;
use super::run::{Observer, Outcome, Start, TrainError, gather, train_by};
use crate::dataset::draw;
use imf_core::grid::Grid;
use imf_core::section::{SectionError, SectionPlan, SectionScratch};
use imf_fields::recipe::Sampling;
use imf_fields::recipe::{Cursor, OnlineSettings, TrainingPlan};
use imf_fields::siren::{INPUTS, features};

/// Where fresh sections come from.
pub struct OnlineSections {
    /// Sections of the scene.
    pub plan: SectionPlan,
    /// The grid whose unit coordinates the network's inputs are.
    pub frame: Grid,
    /// How each section is sampled.
    pub sampling: Sampling,
    /// How sections come and go.
    pub settings: OnlineSettings,
}

/// The samples of one section.
#[derive(Clone, Debug, PartialEq)]
struct Section {
    angles: [f32; 2],
    voxels: Vec<u32>,
    values: Vec<f32>,
}

/// Seconds spent waiting since this run (not an earlier one that it continues) began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Waits {
    /// Until the pool was full for the first time.
    pub filling: f64,
    /// The trainer, for sections that were late.
    pub trainer: f64,
    /// The producer, for the trainer to take what was ready.
    pub producer: f64,
    /// Sections computed.
    pub sections: u64,
    /// Seconds from beginning to end.
    pub seconds: f64,
}

impl OnlineSections {
    /// Samples that the pool holds: one epoch.
    #[must_use]
    pub fn pool_samples(&self) -> usize {
        self.settings.pool * self.sampling.count(self.plan.grid().len())
    }

    /// Bytes of a pool: 8 a sample.
    #[must_use]
    pub fn memory_estimate(grid: &Grid, sampling: &Sampling, settings: &OnlineSettings) -> u64 {
        8 * (settings.pool + settings.lead + 2) as u64 * sampling.count(grid.len()) as u64
    }

    /// A sample of a section, as the network sees it.
    fn sample(&self, section: &Section, at: usize) -> ([f32; INPUTS], f32) {
        let grid = self.plan.grid();
        let point = self.frame.unit(grid.centre(grid.voxel(section.voxels[at] as usize))).as_vec3();
        let [theta, phi] = section.angles;
        (features(point.to_array(), theta, phi), section.values[at])
    }

    fn section(
        &self,
        number: u64,
        scratch: &mut SectionScratch,
        cmf: &mut [f32],
    ) -> Result<Section, SectionError> {
        let orientation = self.settings.orientation(number);
        self.plan.cmf(&orientation, scratch, cmf)?;
        let voxels = draw(cmf, self.plan.grid().dims, &self.sampling, number);
        let values = voxels.iter().map(|&v| cmf[v as usize]).collect();
        Ok(Section { angles: orientation.angles(), voxels, values })
    }
}

/// What a producer makes of a number.
type Made<S> = Result<S, SectionError>;

/// Makes something of the sections that a training from step `first` to step `last` meets, on a second thread, while
/// `train` takes them; says how long everybody waited. While the pool fills, `stop` is asked before each section.
pub(crate) fn with_arrivals<S: Send, T>(
    settings: OnlineSettings,
    [first, last]: [u64; 2],
    make: impl FnMut(u64) -> Made<S> + Send,
    stop: &dyn Fn() -> bool,
    train: impl FnOnce(&mut Arrivals<'_, S>) -> T,
) -> (T, Waits) {
    let begun = Instant::now();
    let oldest = settings.newest(first) + 1 - settings.pool as u64;
    let numbers = oldest..=settings.newest(last.max(first));
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(settings.lead);
        let producer = scope.spawn(move || produce(numbers, make, &sender));
        let mut arrivals = Arrivals {
            receiver: &receiver,
            settings,
            stop,
            first,
            next: oldest,
            pool: (0..settings.pool).map(|_| None).collect(),
            waits: Waits::default(),
        };
        let trained = train(&mut arrivals);
        let mut waits = arrivals.waits;
        // A producer that still has work stops once nobody takes it.
        drop(receiver);
        let (waited, made) = producer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        (waits.producer, waits.sections) = (waited.as_secs_f64(), made);
        waits.seconds = begun.elapsed().as_secs_f64();
        (trained, waits)
    })
}

/// Makes `numbers` one after the other until nobody wants them; returns how long it waited, and how many it made.
fn produce<S>(
    numbers: std::ops::RangeInclusive<u64>,
    mut make: impl FnMut(u64) -> Made<S>,
    sender: &SyncSender<Made<S>>,
) -> (Duration, u64) {
    let (mut waited, mut made) = (Duration::ZERO, 0);
    for number in numbers {
        let section = make(number);
        let failed = section.is_err();
        let begun = Instant::now();
        if sender.send(section).is_err() || failed {
            break;
        }
        waited += begun.elapsed();
        made += 1;
    }
    (waited, made)
}

/// The latest of what was made; number `n` stands in slot `n mod pool`.
pub(crate) struct Arrivals<'a, S> {
    receiver: &'a Receiver<Made<S>>,
    settings: OnlineSettings,
    stop: &'a dyn Fn() -> bool,
    /// Step at which the pool is filled.
    first: u64,
    /// Number to be received next.
    next: u64,
    pool: Vec<Option<S>>,
    waits: Waits,
}

impl<S> Arrivals<'_, S> {
    /// Waits for what the pool holds at a step: that, slot after slot, none of them empty. A pool that is filled for the first
    /// time, which may take minutes, is given up where that is wished: nothing was learnt from it yet.
    pub(crate) fn at(&mut self, step: u64) -> Result<&[Option<S>], SectionError> {
        let begun = Instant::now();
        while self.next <= self.settings.newest(step) {
            if step == self.first && (self.stop)() {
                return Err(SectionError::Cancelled);
            }
            // A producer that is gone has panicked, which is passed on when it is joined.
            let made = self.receiver.recv().unwrap_or(Err(SectionError::Cancelled))?;
            self.pool[(self.next % self.settings.pool as u64) as usize] = Some(made);
            self.next += 1;
        }
        let waited = begun.elapsed().as_secs_f64();
        if step == self.first {
            self.waits.filling += waited;
        } else {
            self.waits.trainer += waited;
        }
        Ok(&self.pool)
    }
}

/// Trains `engine` from `start` to the plan's end, or until the observer breaks, while a second thread computes the
/// sections. An epoch is as many samples as the pool holds; a batch is drawn from it with replacement. Before the first step,
/// while the pool fills, `cancelled` ends it; later the observer does.
///
/// # Errors
/// As [`super::run::train`], and a section that failed, or was not wanted any more.
pub fn train_online(
    plan: &TrainingPlan,
    sections: &OnlineSections,
    engine: &mut dyn TrainingEngine,
    start: impl Into<Start>,
    cancelled: &AtomicBool,
    observer: &mut Observer<'_>,
) -> Result<(Outcome, Waits), TrainError> {
    let settings = sections.settings;
    settings.check()?;
    plan.check()?;
    let start = start.into();
    let samples = sections.pool_samples();
    let per_epoch = plan.steps_per_epoch(samples);
    let first = start.cursor.epoch.saturating_mul(per_epoch).saturating_add(start.cursor.step);
    let last = plan.total_steps(samples).saturating_sub(1);
    let mut scratch = SectionScratch::default();
    let mut cmf = vec![0.0; sections.plan.grid().len()];
    let make = |number| sections.section(number, &mut scratch, &mut cmf);
    let key = mix(mix(plan.seed) ^ 0x6f6e_6c69_6e65);
    let per_section = sections.sampling.count(sections.plan.grid().len());
    let stop = || cancelled.load(Ordering::Relaxed);
    let (outcome, waits) = with_arrivals(settings, [first, last], make, &stop, |arrivals| {
        let mut feed = |_: Cursor, step: u64, rows: Range<usize>, inputs: &mut [f32], targets: &mut [f32]| {
            let pool = arrivals.at(step)?;
            let base = mix(key ^ mix(step));
            gather(inputs, targets, |row| {
                let random = mix(base.wrapping_add((rows.start + row) as u64));
                let index = ((u128::from(random) * samples as u128) >> 64) as usize;
                let section = pool[index / per_section].as_ref();
                section.map_or(([0.0; INPUTS], 0.0), |section| sections.sample(section, index % per_section))
            });
            Ok(())
        };
        train_by(plan, samples, &mut feed, engine, start, observer)
    });
    Ok((outcome?, waits))
}

#[cfg(test)]
mod tests;
