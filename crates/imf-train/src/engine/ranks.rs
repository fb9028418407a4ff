//! One training on the CPUs of several processes, the *ranks*: each has a part of every batch and the whole network.
//!
//! Rank `r` of `n` takes the rows from `r·batch/n` to `(r + 1)·batch/n` of the very batch that one process would train on,
//! and computes its part of the gradient. The parameters are cut into `n` slices. Every rank receives all parts of its own
//! slice, adds them in the order of the ranks, and hands the sum to all; then each takes the same Adam step. So all ranks
//! have the same bits, whoever is early or late, and a training of `n` ranks can be repeated. Between different `n`
//! sums are grouped differently: the bits differ, the training is the same but for rounding.
//!
//! [`Collectives`] connects the ranks: by MPI in the command, by threads in the tests.

use std::ops::Range;

use crate::engine::CpuTrainer;
use crate::training::TrainingEngine;
use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;

/// Communication between the ranks of a training. All ranks call the same functions in the same order; each waits for
/// the others.
pub trait Collectives {
    /// This rank, from 0.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn ranks(&self) -> usize;

    /// Cuts `values` into one slice for each rank, at `cuts` (one entry more than ranks), and gives each its own.
    /// `parts` becomes what this rank is given, rank 0's part first; all are of the length of this rank's slice.
    ///
    /// # Errors
    /// Ranks that cannot be reached.
    fn all_to_all(&mut self, values: &[f32], cuts: &[usize], parts: &mut [f32]) -> Result<(), EngineError>;

    /// Puts together the slices of all ranks, of which this is `slice`, into `values`, cut as before.
    ///
    /// # Errors
    /// Ranks that cannot be reached.
    fn all_gather(&mut self, slice: &[f32], cuts: &[usize], values: &mut [f32]) -> Result<(), EngineError>;

    /// A number of every rank, rank 0's first.
    ///
    /// # Errors
    /// Ranks that cannot be reached.
    fn all_gather_number(&mut self, number: u64) -> Result<Vec<u64>, EngineError>;
}

/// Bytes for each parameter that training in ranks takes beside the engine: the parts of the own slice, and its sum.
pub const BYTES_PER_PARAMETER: u64 = 2 * 4;

/// Trains together with other ranks.
pub struct RankTrainer<E> {
    cpu: CpuTrainer,
    collectives: E,
    /// Where the parameters are cut.
    cuts: Vec<usize>,
    /// `[ranks][length of the own slice]`
    parts: Vec<f32>,
    /// The own slice, summed.
    slice: Vec<f32>,
    /// Samples of the batch that was announced.
    batch: usize,
    /// Sum over steps of this rank's part of the mean loss, and how many steps.
    losses: (f64, u64),
}

impl<E: Collectives> RankTrainer<E> {
    /// An engine that shares batches of up to the given size with the ranks of `collectives`. `cpu` must have been made
    /// for [`most_rows`] of them, and all ranks' for the same network and state.
    pub fn new(cpu: CpuTrainer, collectives: E) -> Self {
        let (rank, ranks, length) = (collectives.rank(), collectives.ranks(), cpu.parameters().len());
        let cuts: Vec<usize> = (0..=ranks).map(|r| part_of(length, r, ranks).start).collect();
        let own = cuts[rank + 1] - cuts[rank];
        Self {
            cpu,
            collectives,
            cuts,
            parts: vec![0.0; own * ranks],
            slice: vec![0.0; own],
            batch: 0,
            losses: (0.0, 0),
        }
    }

    /// The sum over all ranks of what each has in `values`, in the order of the ranks.
    fn sum(&mut self) -> Result<(), EngineError> {
        let Self { cpu, collectives, cuts, parts, slice, .. } = self;
        let gradient = &mut cpu.gradient;
        collectives.all_to_all(gradient, cuts, parts)?;
        if !slice.is_empty() {
            let (first, others) = parts.split_at(slice.len());
            slice.copy_from_slice(first);
            for part in others.chunks_exact(slice.len()) {
                for (sum, value) in slice.iter_mut().zip(part) {
                    *sum += value;
                }
            }
        }
        collectives.all_gather(slice, cuts, gradient)
    }
}

/// Maximum number of rows of a batch that one of `ranks` ranks has.
#[must_use]
pub fn most_rows(batch: usize, ranks: usize) -> usize {
    batch.div_ceil(ranks.max(1)).max(1)
}

/// Share `index` of `of` equal ones of `0..length`, as nearly as can be. The last ends at the length.
fn part_of(length: usize, index: usize, of: usize) -> Range<usize> {
    let cut = |index: usize| (length as u128 * index as u128 / of as u128) as usize;
    cut(index)..cut(index + 1)
}

impl<E: Collectives> TrainingEngine for RankTrainer<E> {
    fn describe(&self) -> String {
        format!("{} ranks, each: {}", self.collectives.ranks(), self.cpu.describe())
    }

    fn rows_of_batch(&mut self, batch: usize) -> Range<usize> {
        self.batch = batch;
        part_of(batch, self.collectives.rank(), self.collectives.ranks())
    }

    /// `inputs` and `targets` are the rows that [`Self::rows_of_batch`] named.
    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let batch = self.batch;
        let rows = self.rows_of_batch(batch).len();
        if rows != targets.len() || batch == 0 {
            return Err(EngineError::Shape(format!(
                "{} samples of a batch of {batch}; this rank's share are {rows}",
                targets.len()
            )));
        }
        let (loss, _) = self.cpu.gradient(inputs, targets, batch)?;
        self.sum()?;
        self.cpu.update(learning_rate);
        self.losses.0 += loss / batch as f64;
        self.losses.1 += 1;
        Ok(())
    }

    /// Also checks that all ranks still have the same weights.
    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        let (sum, steps) = std::mem::take(&mut self.losses);
        let sums = self.collectives.all_gather_number(sum.to_bits())?;
        let total: f64 = sums.into_iter().map(f64::from_bits).sum();
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(bytemuck::cast_slice(self.cpu.parameters()));
        let checksums = self.collectives.all_gather_number(u64::from(hasher.finalize()))?;
        if let Some(other) = checksums.iter().position(|checksum| *checksum != checksums[0]) {
            return Err(EngineError::Device(format!(
                "ranks 0 and {other} no longer have the same weights: train on machines with the same vector \
                 instructions"
            )));
        }
        Ok(if steps == 0 { 0.0 } else { total / steps as f64 })
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        self.cpu.state()
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.cpu.replace_parameters(parameters)
    }
}

#[cfg(test)]
mod tests;
