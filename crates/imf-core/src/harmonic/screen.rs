//! Screening: the harmonic field ranks the orientations at every voxel, exact counts confirm the best of them.
//!
//! The result is an inaccessibility measure whose values are exact overlaps of the orientation named, and an upper bound
//! of the exact minimum. Where that value is 0 it is the minimum: proven. Elsewhere an orientation that the ranking put
//! behind the counted ones might be lower by chance: checked, not proven. The miss rate is measured by streaming all.
//!
//! Most voxels outside a part are free in many directions. So every so-manieth orientation is ranked and confirmed first,
//! and only voxels that none of these reaches freely are ranked over all.

use std::sync::atomic::{AtomicU64, Ordering};

use pulp::Arch;
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
/// One of so many orientations is looked at first.
const EVERY: usize = 16;
/// Sets below this size are ranked at once.
const LARGE: usize = 1000;

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
        let few: Vec<u32> = if orientations.len() < LARGE {
            Vec::new()
        } else {
            (0..orientations.len() as u32).step_by(EVERY).collect()
        };
        let few_heads =
            self.heads(&few.iter().map(|&index| orientations[index as usize]).collect::<Vec<_>>());
        let normalisers = orientations
            .par_iter()
            .map(|o| exact.normaliser(o))
            .collect::<Result<Vec<u32>, ToolError>>()
            .map_err(|error| HarmonicError::Section(error.into()))?;
        let (voxels, axes) = (self.grid.len(), self.axis_count());
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
                let mut own = 0;
                let Scratch { arch, coefficients, values } = scratch;
                let z = self.read(from..from + value.len(), coefficients);
                value.fill(f32::INFINITY);
                if !few.is_empty() {
                    for (index, candidates) in
                        ranked(z, axes, &few_heads, *arch, values).into_iter().enumerate()
                    {
                        let candidates = candidates.renamed(&few);
                        if let Some(found) = judge.free_of(from + index, &candidates, &mut own) {
                            (value[index], best[index]) = (0.0, found);
                        }
                    }
                }
                let left: Vec<usize> = (0..value.len()).filter(|&index| value[index] != 0.0).collect();
                let rows: Vec<f32> =
                    left.iter().flat_map(|&index| &z[index * axes..][..axes]).copied().collect();
                for (&index, candidates) in left.iter().zip(ranked(&rows, axes, &heads, *arch, values)) {
                    (value[index], best[index]) = judge.best_of(from + index, &candidates, &mut own);
                }
                proven.iter_mut().zip(&*value).for_each(|(proven, &value)| *proven = u8::from(value == 0.0));
                counted.fetch_add(own, Ordering::Relaxed);
                (control.progress)(value.len() as u64);
                Ok(())
            })?;
        Ok(Screened { imf: whole, proven, counted: counted.into_inner() })
    }
}

/// The orientations of least value at every voxel of a block with coefficients `z` `[voxel][axes]`, ascending.
fn ranked(z: &[f32], axes: usize, heads: &Heads, arch: Arch, values: &mut Vec<f32>) -> Vec<Candidates> {
    let mut all = vec![Candidates::default(); z.len() / axes];
    if all.is_empty() {
        return all;
    }
    for chunk in heads.chunks() {
        heads.values(z, axes, chunk.clone(), values);
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
    fn known(&self) -> impl Iterator<Item = u32> {
        self.orientations.into_iter().filter(|&index| index != u32::MAX)
    }

    fn last(&self) -> f32 {
        self.values[CANDIDATES - 1]
    }

    /// The same of a set in which `names` are the indices.
    fn renamed(self, names: &[u32]) -> Self {
        let name = |index: u32| names.get(index as usize).copied().unwrap_or(u32::MAX);
        Self { orientations: self.orientations.map(name), ..self }
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

impl Judge<'_> {
    fn pose(&self, voxel: usize, orientation: u32) -> Pose {
        let grid = &self.field.grid;
        let position = grid.centre(grid.voxel(voxel));
        Pose { position, orientation: self.orientations[orientation as usize] }
    }

    /// The first candidate that is free, which is cheap to ask.
    fn free_of(&self, voxel: usize, candidates: &Candidates, counted: &mut u64) -> Option<u32> {
        // A value far above zero is hardly free.
        if candidates.values[0] >= FREE_BELOW {
            return None;
        }
        candidates.known().find(|&index| {
            *counted += 1;
            !self.exact.collides(&self.pose(voxel, index))
        })
    }

    /// First whether any candidate is free; only then how much each overlaps.
    fn best_of(&self, voxel: usize, candidates: &Candidates, counted: &mut u64) -> (f32, u32) {
        if let Some(index) = self.free_of(voxel, candidates, counted) {
            return (0.0, index);
        }
        let mut found = (f32::INFINITY, u32::MAX);
        for index in candidates.known() {
            *counted += 1;
            let share = f64::from(self.exact.count(&self.pose(voxel, index)))
                / f64::from(self.normalisers[index as usize]);
            let value = share.min(1.0) as f32;
            if value < found.0 || (value == found.0 && index < found.1) {
                found = (value, index);
            }
        }
        found
    }
}

/// Ten times the largest error of the fields measured.
const FREE_BELOW: f32 = 0.3;
