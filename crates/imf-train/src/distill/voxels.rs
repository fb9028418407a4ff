//! Which voxels a step of distillation takes.

use std::ops::Range;

use rayon::prelude::*;

use crate::training::permutation::Permutation;
use imf_core::grid::Grid;
use imf_fields::factored::Symmetry;
use imf_fields::factored::targets::TargetScratch;
use imf_fields::recipe::{Cursor, TrainingPlan};

/// Rows of a batch that one thread gathers at a time.
const ROWS: usize = 64;

/// The voxels of every step: an epoch is each of them once, in an order of its own.
pub(super) struct Voxels<'a> {
    plan: &'a TrainingPlan,
    grid: &'a Grid,
    symmetry: Symmetry,
    /// Of an epoch.
    order: (u64, Permutation),
}

impl<'a> Voxels<'a> {
    /// From a cursor on.
    pub(super) fn new(plan: &'a TrainingPlan, grid: &'a Grid, symmetry: Symmetry, start: Cursor) -> Self {
        Self {
            plan,
            grid,
            symmetry,
            order: (start.epoch, Permutation::new(grid.len(), plan.seed, start.epoch)),
        }
    }

    /// Fills rows of the batch at a cursor: a row's inputs are its voxel's place, its targets what `read` says of the voxel,
    /// with working memory of a thread.
    pub(super) fn fill(
        &mut self,
        at: Cursor,
        rows: &Range<usize>,
        inputs: &mut [f32],
        targets: &mut [f32],
        read: impl Fn(&mut TargetScratch, usize, &mut [f32]) + Send + Sync,
    ) {
        let Self { plan, grid, symmetry, order } = self;
        if order.0 != at.epoch {
            *order = (at.epoch, Permutation::new(grid.len(), plan.seed, at.epoch));
        }
        let first = at.step as usize * plan.batch + rows.start;
        let outputs = targets.len() / rows.len().max(1);
        let rows =
            inputs.par_chunks_exact_mut(symmetry.inputs()).zip(targets.par_chunks_exact_mut(outputs.max(1)));
        rows.enumerate().with_min_len(ROWS).for_each_init(
            TargetScratch::default,
            |scratch, (row, (inputs, targets))| {
                let voxel = order.1.at(first + row);
                let place = symmetry.place(grid.centre(grid.voxel(voxel)));
                inputs.copy_from_slice(&symmetry.inputs_at(grid, &place));
                read(scratch, voxel, targets);
            },
        );
    }
}
