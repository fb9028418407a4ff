//! Screening: the harmonic field ranks the orientations at every voxel, exact counts confirm the best of them.
//!
//! The result is an inaccessibility measure whose values are exact overlaps of the orientation named, and an upper bound
//! of the exact minimum. Where that value is 0 it is the minimum: proven. Elsewhere an orientation that the ranking put
//! behind the counted ones might be lower by chance: checked, not proven. The miss rate is measured by streaming all.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::evaluate::{Heads, Scratch, VoxelCoefficients as _};
use super::{HarmonicError, HarmonicField};
use crate::control::Control;
use crate::field::{ExactField, Pose};
use crate::orientation::Orientation;
use crate::section::{Imf, SectionError};
use crate::tool::ToolError;

/// What screening found.
#[derive(Clone, Debug, PartialEq)]
pub struct Screened {
    /// Exact overlaps of the best orientation counted, and which it is.
    pub imf: Imf,
    /// 1 where the value is proven to be the least, `[voxel]`.
    pub proven: Vec<u8>,
    /// Exact counts and yes/no answers taken.
    pub counted: u64,
}

/// Orientations that are confirmed at a voxel, most likely first.
pub const CANDIDATES: usize = 8;

impl HarmonicField {
    /// The inaccessibility measure over `orientations`, ranked by this field and confirmed by `exact`. One unit of
    /// progress is one voxel.
    ///
    /// # Errors
    /// A tool without volume in an orientation, or cancellation.
    pub fn screened(
        &self,
        orientations: &[Orientation],
        exact: &ExactField<'_>,
        control: Control<'_>,
    ) -> Result<Screened, HarmonicError> {
        let heads = self.heads(orientations);
        let normalisers = orientations
            .par_iter()
            .map(|o| exact.normaliser(o))
            .collect::<Result<Vec<u32>, ToolError>>()
            .map_err(|error| HarmonicError::Section(error.into()))?;
        let voxels = self.grid.len();
        let mut whole = Imf::new(voxels);
        let mut proven = vec![0; voxels];
        let counted = AtomicU64::new(0);
        let judge = Judge { field: self, orientations, normalisers: &normalisers, exact };
        whole
            .value
            .par_chunks_mut(Self::BLOCK)
            .zip(whole.best.par_chunks_mut(Self::BLOCK))
            .zip(proven.par_chunks_mut(Self::BLOCK))
            .enumerate()
            .try_for_each_init(Scratch::default, |scratch, (block, ((value, best), proven))| {
                if control.is_cancelled() {
                    return Err(HarmonicError::Section(SectionError::Cancelled));
                }
                let from = block * Self::BLOCK;
                let candidates = self.candidates(from..from + value.len(), &heads, scratch);
                let mut own = 0;
                for (index, candidates) in candidates.iter().enumerate() {
                    let found = judge.best_of(from + index, candidates);
                    (value[index], best[index]) = (found.value, found.best);
                    proven[index] = u8::from(found.value == 0.0);
                    own += found.counted;
                }
                counted.fetch_add(own, Ordering::Relaxed);
                (control.progress)(value.len() as u64);
                Ok(())
            })?;
        Ok(Screened { imf: whole, proven, counted: counted.into_inner() })
    }

    /// The orientations of least value at every voxel of a range, ascending.
    fn candidates(
        &self,
        voxels: std::ops::Range<usize>,
        heads: &Heads,
        scratch: &mut Scratch,
    ) -> Vec<Candidates> {
        let mut all = vec![Candidates::default(); voxels.len()];
        let Scratch { arch, coefficients, values } = scratch;
        let z = self.read(voxels, coefficients);
        for chunk in heads.chunks() {
            heads.values(z, self.axis_count(), chunk.clone(), values);
            for (own, row) in all.iter_mut().zip(values.chunks_exact(chunk.len())) {
                // Most pieces hold nothing that is low enough: their least value alone is looked at.
                for (piece, values) in row.chunks(PIECE).enumerate() {
                    if arch.dispatch(|| lowest(values)) < own.last() {
                        for (place, &value) in values.iter().enumerate() {
                            own.insert(value, (chunk.start + piece * PIECE + place) as u32);
                        }
                    }
                }
            }
        }
        all
    }
}

/// Values compared at a time.
const PIECE: usize = 64;

#[inline(always)]
fn lowest(values: &[f32]) -> f32 {
    values.iter().fold(f32::INFINITY, |a, &b| if b < a { b } else { a })
}

/// The least values seen, ascending.
#[derive(Clone, Debug)]
struct Candidates {
    values: [f32; CANDIDATES],
    orientations: [u32; CANDIDATES],
}

impl Default for Candidates {
    fn default() -> Self {
        Self { values: [f32::INFINITY; CANDIDATES], orientations: [u32::MAX; CANDIDATES] }
    }
}

impl Candidates {
    fn last(&self) -> f32 {
        self.values[CANDIDATES - 1]
    }

    fn insert(&mut self, value: f32, orientation: u32) {
        if value >= self.last() {
            return;
        }
        let mut place = CANDIDATES - 1;
        while place > 0 && self.values[place - 1] > value {
            self.values[place] = self.values[place - 1];
            self.orientations[place] = self.orientations[place - 1];
            place -= 1;
        }
        (self.values[place], self.orientations[place]) = (value, orientation);
    }
}

/// Confirms candidates by exact answers.
struct Judge<'a> {
    field: &'a HarmonicField,
    orientations: &'a [Orientation],
    normalisers: &'a [u32],
    exact: &'a ExactField<'a>,
}

struct Found {
    value: f32,
    best: u32,
    counted: u64,
}

impl Judge<'_> {
    /// First whether any candidate is free, which is cheap to ask; only then how much each overlaps.
    fn best_of(&self, voxel: usize, candidates: &Candidates) -> Found {
        let grid = &self.field.grid;
        let position = grid.centre(grid.voxel(voxel));
        let pose = |index: u32| Pose { position, orientation: self.orientations[index as usize] };
        let known = || candidates.orientations.iter().copied().filter(|&index| index != u32::MAX);
        let mut found = Found { value: f32::INFINITY, best: u32::MAX, counted: 0 };
        // A value far above zero is hardly free.
        if candidates.values[0] < FREE_BELOW {
            for index in known() {
                found.counted += 1;
                if !self.exact.collides(&pose(index)) {
                    return Found { value: 0.0, best: index, ..found };
                }
            }
        }
        for index in known() {
            found.counted += 1;
            let share =
                f64::from(self.exact.count(&pose(index))) / f64::from(self.normalisers[index as usize]);
            let value = share.min(1.0) as f32;
            if value < found.value || (value == found.value && index < found.best) {
                (found.value, found.best) = (value, index);
            }
        }
        found
    }
}

/// Ten times the largest error of the fields measured.
const FREE_BELOW: f32 = 0.3;
