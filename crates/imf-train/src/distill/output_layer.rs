//! The best linear layer behind given hidden ones, in closed form.
//!
//! Behind its sines a network is linear, and its loss, summed over voxels, is a sum of squares: the last layer's best
//! weights solve a linear system of the hidden layers' width (least squares). An optimiser follows them slowly:
//! training that solves for them now and then needs a third of the steps (variable projection), and a network of
//! another part starts from the best use of its hidden layers.

use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

use crate::training::TrainingEngine;
use imf_core::field::EngineError;
use imf_fields::factored::targets::{ComponentBasis, TargetScratch, Targets};
use imf_fields::factored::{DistillSettings, FactoredField};
use imf_fields::harmonic::HarmonicField;
use imf_fields::siren::matrix::{Matrix, multiply};

/// Voxels for each weight of an output while training goes on: their choice adds some 3 % to the squared error, until the next.
pub(super) const IN_TRAINING: usize = 32;
/// Voxels for each weight of an output at the end.
pub(super) const AT_THE_END: usize = 128;
/// Voxels of a part; parts are added in their order, whatever thread does them.
const PART: usize = 2048;
/// What follows the last solution's choice of voxels.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// What is added to the diagonal, over its mean. Sums of products in f32 leave the smallest eigenvalues of a width of 380 off by
/// 1e-6 of it, either way: with no more than that one solution in a training of 3,000 steps threw all away.
const RIDGE: f64 = 1e-5;

/// Bytes that a solution of the output layer takes for a moment, over `voxels` voxels and `components` components: the
/// parts' sums and the whole system's.
#[must_use]
pub fn bytes_to_solve(settings: &DistillSettings, voxels: usize, components: usize) -> u64 {
    if settings.solve_every == 0 {
        return 0;
    }
    let columns = settings.width + 1;
    let parts = voxels.min(AT_THE_END * columns).div_ceil(PART);
    ((4 * parts + 3 * 8) * columns * (columns + components)) as u64
}

/// Replaces the output layer's weights by those of least squared error from `targets`, over `voxels` evenly spread
/// voxels for each weight of an output; `turn` in [0, 1) chooses which ones. The correction is what is solved for,
/// with a slight pull to 0 (ridge regression), so a direction that the voxels do not determine keeps its weights.
pub(super) fn solve_output_layer(field: &mut FactoredField, targets: &Targets<'_>, voxels: usize, turn: f64) {
    let Some(last) = field.shape.layers().pop() else { return };
    let (components, columns) = (last.outputs, last.inputs + 1);
    let (gram, right) = normal_equations(field, targets, columns, voxels, turn);
    let mean = gram.trace() / columns as f64;
    let regular = gram + DMatrix::identity(columns, columns) * (RIDGE * mean);
    let Some(factored) = Cholesky::new(regular) else { return };
    let change = factored.solve(&right);
    let parameters = &mut field.parameters;
    for axis in 0..components {
        let row = &mut parameters[last.weights + axis * last.inputs..][..last.inputs];
        for (place, weight) in row.iter_mut().enumerate() {
            *weight = (f64::from(*weight) + change[(place, axis)]) as f32;
        }
        let bias = &mut parameters[last.biases + axis];
        *bias = (f64::from(*bias) + change[(last.inputs, axis)]) as f32;
    }
}

/// `AᵀA` and `Aᵀ(T − Z)` over the voxels: A their last activations and a 1, T the harmonic field's coefficients in the
/// network's units, Z what the network says.
fn normal_equations(
    field: &FactoredField,
    targets: &Targets<'_>,
    columns: usize,
    voxels_each: usize,
    turn: f64,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let (components, grid) = (field.shape.components, &field.grid);
    let voxels = grid.len();
    let count = voxels.min(voxels_each.saturating_mul(columns));
    let apart = voxels as f64 / count as f64;
    let place = |row: usize| (((row as f64 + turn) * apart) as usize).min(voxels - 1);
    let evaluator = field.evaluator();
    let parts: Vec<(Vec<f32>, Vec<f32>)> = (0..count.div_ceil(PART))
        .into_par_iter()
        .map(|part| {
            let rows = part * PART..((part + 1) * PART).min(count);
            let places: Vec<usize> = rows.map(place).collect();
            let (mut last, mut rest) =
                (vec![0.0; places.len() * columns], vec![0.0; places.len() * components]);
            let points = places.iter().map(|&voxel| grid.centre(grid.voxel(voxel)));
            evaluator.with_last_layer(points, &mut last, &mut rest);
            let (mut scratch, mut target) = (TargetScratch::default(), vec![0.0; components]);
            for (rest, &voxel) in rest.chunks_exact_mut(components).zip(&places) {
                targets.read(voxel, &mut scratch, &mut target);
                rest.iter_mut().zip(&target).for_each(|(rest, &z)| *rest = z - *rest);
            }
            let left = Matrix::row_major(&last, places.len(), columns, columns);
            let (mut gram, mut right) = (vec![0.0; columns * columns], vec![0.0; columns * components]);
            multiply(&mut gram, columns, left.transposed(), left, false);
            let rest = Matrix::row_major(&rest, places.len(), components, components);
            multiply(&mut right, components, left.transposed(), rest, false);
            (gram, right)
        })
        .collect();
    let (mut gram, mut right) = (vec![0.0f64; columns * columns], vec![0.0f64; columns * components]);
    for (part_of_gram, part_of_right) in &parts {
        gram.iter_mut().zip(part_of_gram).for_each(|(sum, &part)| *sum += f64::from(part));
        right.iter_mut().zip(part_of_right).for_each(|(sum, &part)| *sum += f64::from(part));
    }
    (DMatrix::from_row_slice(columns, columns, &gram), DMatrix::from_row_slice(columns, components, &right))
}

/// Steps of the longest training that begins with a solution. A short one ends not far from the sines that it begins with; in
/// a long one the large weights that fit a field by random sines lead the hidden layers astray (both measured, in the record).
pub(super) const SOLVED_FIRST: u64 = 400;

/// Solves the output layer in closed form after every fixed number of steps, and after the last; in a short training
/// before the first too. Which ones those are depends on the plan alone, so that an interrupted training goes on to the
/// same bits.
pub(super) struct ClosedForm<'a> {
    targets: &'a Targets<'a>,
    /// Of the engine's weights at the last solution.
    field: FactoredField,
    every: u64,
    /// Steps of the plan.
    total: u64,
}

impl<'a> ClosedForm<'a> {
    pub(super) fn new(
        harmonic: &HarmonicField,
        targets: &'a Targets<'a>,
        settings: &DistillSettings,
    ) -> Self {
        let shape = settings.shape(settings.outputs(harmonic));
        let field = ComponentBasis::of(harmonic, targets).of_weights(shape, Vec::new());
        let total = settings.plan.total_steps(harmonic.grid.len());
        Self { targets, field, every: settings.solve_every, total }
    }

    /// Solves for an engine's output layer where that is due after `done` steps of the plan.
    pub(super) fn solve_after(
        &mut self,
        done: u64,
        engine: &mut dyn TrainingEngine,
    ) -> Result<(), EngineError> {
        let voxels = match self.every {
            0 => return Ok(()),
            _ if done == 0 && self.total > SOLVED_FIRST => return Ok(()),
            _ if done == self.total => AT_THE_END,
            every if done.is_multiple_of(every) => IN_TRAINING,
            _ => return Ok(()),
        };
        self.field.parameters = engine.weights()?;
        // By the golden section no two solutions in a row see the same voxels.
        let turn = (done as f64 * GOLDEN).fract();
        solve_output_layer(&mut self.field, self.targets, voxels, turn);
        engine.replace_parameters(&self.field.parameters)
    }
}
