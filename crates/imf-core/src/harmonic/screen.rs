//! Screening: the harmonic field ranks the orientations at every voxel, exact counts confirm the best of them.
//!
//! The result is an inaccessibility measure whose values are exact collision measures of the orientation named, and an upper
//! bound of the exact minimum. Where that value is 0 it is the minimum: proven. Elsewhere an orientation that the ranking
//! put behind the counted ones might be lower by chance: checked, not proven. How often that is so is measured by counting
//! all orientations at some voxels ([`Screened::misses`]).
//!
//! A large set is looked at in three stages, since a field of some degree has no valleys narrower than that degree
//! allows. A few orientations, evenly spread, find most of the voxels that are free in many directions. The others
//! are valued at the centres of [`Cells`], and only the orientations of the cells whose centres are lowest are ranked.

mod candidates;
mod judge;
mod misses;

pub use misses::Misses;

use std::sync::atomic::{AtomicU64, Ordering};

use pulp::Arch;
use rayon::prelude::*;

use self::candidates::Candidates;
use self::judge::Judge;
use super::cells::Cells;
use super::evaluate::{Heads, VoxelCoefficients as _, lowest};
use super::{HarmonicError, HarmonicField};
use crate::control::Control;
use crate::field::VoxelMeasures;
use crate::orientation::Orientation;
use crate::section::{Imf, SectionError};
use crate::siren::matrix::{Matrix, multiply};
use crate::vectorised::vectorised;

/// What screening found.
#[derive(Clone, Debug, PartialEq)]
pub struct Screened {
    /// Exact measures of the best orientation counted, and which it is. A value of 0 is proven to be the least.
    pub imf: Imf,
    /// Exact counts and yes/no answers taken.
    pub counted: u64,
}

/// Orientations that are confirmed at a voxel, most likely first.
pub const CANDIDATES: usize = 8;
/// Sets below this size are ranked at once.
const LARGE: usize = 1000;
/// Orientations of a cell, in the mean.
const MEMBERS: usize = 10;
/// Cells at most: no field of a degree in use has more valleys.
const MOST_CELLS: usize = 4000;
/// Of the cells' centres so many are looked at first.
const FIRST: usize = 250;
/// Cells whose orientations are ranked.
const NEAR: usize = 20;
/// Voxels of a block: its pairs of voxel and cell are sorted by cell, and then as many voxels share a cell's orientations.
const BLOCK: usize = 2048;

impl HarmonicField {
    /// The inaccessibility measure over `orientations`, ranked by this field and confirmed by exact measures at its voxels. One unit
    /// of progress is one voxel.
    ///
    /// # Errors
    /// A tool without volume in an orientation, or cancellation.
    pub fn screened(
        &self,
        orientations: &[Orientation],
        measures: &VoxelMeasures<'_>,
        control: Control<'_>,
    ) -> Result<Screened, HarmonicError> {
        let judge = Judge::new(measures, orientations, control)?;
        let stages = Stages::new(self, orientations);
        let mut whole = Imf::new(self.grid.len());
        let counted = AtomicU64::new(0);
        whole
            .value
            .par_chunks_mut(BLOCK)
            .zip(whole.best.par_chunks_mut(BLOCK))
            .enumerate()
            .try_for_each_init(Scratch::default, |scratch, (block, (value, best))| {
                let mut own = 0;
                let voxels = value.len() as u64;
                stages.screen(self, &judge, block * BLOCK, (value, best), scratch, &mut own)?;
                counted.fetch_add(own, Ordering::Relaxed);
                (control.progress)(voxels);
                Ok::<_, SectionError>(())
            })?;
        Ok(Screened { imf: whole, counted: counted.into_inner() })
    }
}

/// Working memory of one thread.
#[derive(Default)]
struct Scratch {
    arch: Arch,
    coefficients: Vec<f32>,
    values: Vec<f32>,
    /// `[voxel][axes]` of the voxels that are left.
    rows: Vec<f32>,
    /// `[voxel][axes]` of those that share a cell.
    gathered: Vec<f32>,
}

/// A set of orientations as screening looks at it.
enum Stages {
    /// All of them.
    One(Heads),
    /// A few, the centres of all cells, the orientations of some cells.
    Three { few: Heads, centres: Heads, cells: Cells, members: CellHeads },
}

impl Stages {
    fn new(field: &HarmonicField, orientations: &[Orientation]) -> Self {
        if orientations.len() < LARGE {
            return Self::One(field.heads(orientations));
        }
        let count = (orientations.len() / MEMBERS).min(MOST_CELLS);
        let cells = Cells::new(orientations, field.basis.domain(), count);
        let chosen = |list: &[u32]| -> Vec<Orientation> {
            list.iter().map(|&index| orientations[index as usize]).collect()
        };
        let first = &cells.centres[..FIRST.min(cells.centres.len())];
        Self::Three {
            few: field.heads(&chosen(first)),
            centres: field.heads(&chosen(&cells.centres)),
            members: CellHeads::new(field.heads(&chosen(&cells.members)), &cells),
            cells,
        }
    }

    /// Fills a block of voxels that begins at `from`.
    fn screen(
        &self,
        field: &HarmonicField,
        judge: &Judge<'_>,
        from: usize,
        (value, best): (&mut [f32], &mut [u32]),
        scratch: &mut Scratch,
        counted: &mut u64,
    ) -> Result<(), SectionError> {
        let axes = field.axis_count();
        let Scratch { arch, coefficients, values, rows, gathered } = scratch;
        let z = field.read(from..from + value.len(), coefficients);
        let (few, centres, cells, members) = match self {
            Self::One(heads) => {
                for (index, candidates) in
                    ranked::<CANDIDATES>(z, axes, heads, *arch, values).iter().enumerate()
                {
                    (value[index], best[index]) = judge.best_of(from + index, candidates, counted)?;
                }
                return Ok(());
            }
            Self::Three { few, centres, cells, members } => (few, centres, cells, members),
        };
        value.fill(f32::INFINITY);
        for (index, candidates) in ranked::<CANDIDATES>(z, axes, few, *arch, values).iter().enumerate() {
            let found = judge.free_of(from + index, &candidates.renamed(&cells.centres), counted)?;
            if let Some(found) = found {
                (value[index], best[index]) = (0.0, found);
            }
        }
        let mut left: Vec<usize> = (0..value.len()).filter(|&index| value[index] != 0.0).collect();
        rows.clear();
        rows.extend(left.iter().flat_map(|&index| &z[index * axes..][..axes]));
        let near = ranked::<NEAR>(rows, axes, centres, *arch, values);
        // The cells of each voxel that is still left, and its row.
        let mut kept = Vec::with_capacity(left.len());
        for (row, (&index, near)) in left.iter().zip(&near).enumerate() {
            let best_centres = near.first::<CANDIDATES>().renamed(&cells.centres);
            match judge.free_of(from + index, &best_centres, counted)? {
                Some(found) => (value[index], best[index]) = (0.0, found),
                None => kept.push(row),
            }
        }
        let mut candidates = vec![Candidates::<CANDIDATES>::default(); kept.len()];
        members.rank(&near, &kept, rows, axes, gathered, values, &mut candidates);
        left = kept.iter().map(|&row| left[row]).collect();
        for (&index, candidates) in left.iter().zip(&candidates) {
            let candidates = candidates.renamed(&cells.members);
            (value[index], best[index]) = judge.best_of(from + index, &candidates, counted)?;
        }
        Ok(())
    }
}

/// Orientations as the field reads them, each cell's side by side.
struct CellHeads {
    /// `[axes][member]` of one cell after the other.
    along: Vec<f32>,
    /// `[member]`.
    constant: Vec<f32>,
    /// Where each cell begins among all members; one more at the end.
    starts: Vec<usize>,
}

impl CellHeads {
    /// From orientations in the order of the cells' members.
    fn new(heads: Heads, cells: &Cells) -> Self {
        let (all, constant) = heads.into_parts();
        let (count, axes) = (constant.len(), all.len() / constant.len().max(1));
        let mut along = vec![0.0; all.len()];
        for cell in 0..cells.centres.len() {
            let own = cells.of(cell);
            let target = along[own.start * axes..own.end * axes].chunks_exact_mut(own.len());
            for (target, row) in target.zip(all.chunks_exact(count)) {
                target.copy_from_slice(&row[own.clone()]);
            }
        }
        Self { along, constant, starts: cells.starts.clone() }
    }

    /// The best members, by their place among all, of the cells that are `near` to each of the `kept` rows.
    fn rank(
        &self,
        near: &[Candidates<NEAR>],
        kept: &[usize],
        rows: &[f32],
        axes: usize,
        gathered: &mut Vec<f32>,
        values: &mut Vec<f32>,
        best: &mut [Candidates<CANDIDATES>],
    ) {
        let mut pairs: Vec<(u32, u32)> = kept
            .iter()
            .enumerate()
            .flat_map(|(place, &row)| near[row].known().map(move |cell| (cell, place as u32)))
            .collect();
        pairs.sort_unstable();
        for own in pairs.chunk_by(|a, b| a.0 == b.0) {
            let cell = own[0].0 as usize;
            let members = self.starts[cell]..self.starts[cell + 1];
            let count = members.len();
            gathered.clear();
            values.clear();
            for &(_, place) in own {
                gathered.extend_from_slice(&rows[kept[place as usize] * axes..][..axes]);
                values.extend_from_slice(&self.constant[members.clone()]);
            }
            multiply(
                values,
                count,
                Matrix::row_major(gathered, own.len(), axes, axes),
                Matrix::row_major(&self.along[members.start * axes..], axes, count, count),
                true,
            );
            for (&(_, place), values) in own.iter().zip(values.chunks_exact(count)) {
                for (&value, member) in values.iter().zip(members.clone()) {
                    best[place as usize].insert(value, member as u32);
                }
            }
        }
    }
}

/// The orientations of least value at every voxel of rows with coefficients `z` `[voxel][axes]`, ascending.
fn ranked<const COUNT: usize>(
    z: &[f32],
    axes: usize,
    heads: &Heads,
    arch: Arch,
    values: &mut Vec<f32>,
) -> Vec<Candidates<COUNT>> {
    let mut all = vec![Candidates::default(); z.len() / axes];
    let blocks = z.chunks(HarmonicField::BLOCK * axes).zip(all.chunks_mut(HarmonicField::BLOCK));
    for (z, all) in blocks {
        for chunk in heads.chunks() {
            heads.values(z, axes, chunk.clone(), values);
            for (own, row) in all.iter_mut().zip(values.chunks_exact(chunk.len())) {
                // Most pieces hold nothing that is low enough: their least value alone is looked at.
                for (piece, values) in row.chunks(PIECE).enumerate() {
                    if vectorised!(arch, lowest(values)) < own.last() {
                        for (place, &value) in values.iter().enumerate() {
                            own.insert(value, (chunk.start + piece * PIECE + place) as u32);
                        }
                    }
                }
            }
        }
    }
    all
}

/// Values compared at a time.
const PIECE: usize = 64;
