//! SOAP: Adam along the axes of a matrix's gradients, for the matrices between hidden layers.
//!
//! For a matrix of weights with gradient G the decaying means of `G Gᵀ` and `Gᵀ G` are held, and the axes of both:
//! their eigenvectors, as far as a step of power iteration and a QR decomposition every few steps bring them. Adam's
//! moments are of the gradient along these axes, `G' = Q_L G Q_Rᵀ` (axes are rows), and so is its step, which is
//! turned back. Where axes move, the first moments are turned with them; the second stay with their axes, which are
//! ordered by falling mean.
//!
//! The first gradient begins the means and moves nothing.
//!
//! Source: Vyas et al. 2024, "SOAP: improving and stabilizing Shampoo using Adam", arXiv 2409.11321, algorithm 3.

use crate::engine::orthonormal::Orthonormal;
use imf_core::vectorised::vectorised;
use imf_fields::recipe::{Optimiser, SoapConfig};
use imf_fields::siren::lanes::dot;
use imf_fields::siren::matrix::{Matrix, combine_by_rows};
use imf_fields::siren::stack::Stack;
use imf_fields::siren::{Layer, ShapeError};
use pulp::Arch;

/// Added to the root of the second moment, only so that 0 is not divided by 0.
pub const EPSILON: f32 = 1e-12;
/// Updates of the first gradient's eigenvectors, starting from those of the weights: after 1,000 steps fields err as
/// they do with an exact eigendecomposition of the first gradient (`docs/lab/optimisers.md`).
pub const FIRST_UPDATES: usize = 4;

/// What `kept` holds of each matrix between hidden layers after `step` steps, in the order of the layers: means and axes of
/// the rows, then of the columns, `[size][size]` each with an axis a row. Before the first step nothing of each.
///
/// # Errors
/// Another number of them than the network has.
pub fn state_of<'a>(stack: &Stack, step: u64, mut kept: &'a [f32]) -> Result<Vec<&'a [f32]>, ShapeError> {
    let layers = &stack.layers()[stack.between()];
    let count = |layer: &Layer| if step == 0 { 0 } else { Soap::state_count(layer.outputs, layer.inputs) };
    let expected: usize = layers.iter().map(count).sum();
    if kept.len() != expected {
        return Err(ShapeError::OptimiserState { found: kept.len(), step, expected });
    }
    let each = layers.iter().map(|layer| {
        let (own, others) = kept.split_at(count(layer));
        kept = others;
        own
    });
    Ok(each.collect())
}

/// State of one matrix beside its moments, and working memory.
pub(crate) struct Soap {
    config: SoapConfig,
    arch: Arch,
    /// Of the rows, then of the columns.
    sides: [Side; 2],
    /// The gradient along the axes, then the step; and what is on the way to it: `[rows][columns]`.
    along: Vec<f32>,
    half: Vec<f32>,
}

impl Soap {
    /// Numbers in the state of a matrix beside its moments: means and axes of both sides.
    pub(crate) fn state_count(rows: usize, columns: usize) -> usize {
        Optimiser::Soap(SoapConfig::default()).state_count(rows, columns)
    }

    /// Bytes of state and working memory.
    pub(crate) fn bytes(rows: usize, columns: usize) -> u64 {
        let of_sides: u64 =
            [rows, columns].map(|size| (8 * size * size) as u64 + Orthonormal::bytes(size)).iter().sum();
        (4 * (Self::state_count(rows, columns) + 2 * rows * columns)) as u64 + of_sides
    }

    /// For a matrix of this size that has met no gradient.
    pub(crate) fn new(config: SoapConfig, rows: usize, columns: usize) -> Self {
        let matrix = vec![0.0; rows * columns];
        let sides = [rows, columns].map(Side::new);
        Self { config, arch: Arch::new(), sides, along: matrix.clone(), half: matrix }
    }

    /// Means and axes, in the order in which they are saved: `[state_count]` together.
    pub(crate) fn kept(&self) -> [&[f32]; 4] {
        let [rows, columns] = &self.sides;
        [&rows.mean, &rows.axes, &columns.mean, &columns.axes]
    }

    /// Goes on from a saved state.
    ///
    /// # Panics
    /// If there are not [`Self::state_count`] numbers.
    pub(crate) fn restore(&mut self, mut kept: &[f32]) {
        for array in self.sides.iter_mut().flat_map(|side| [&mut side.mean, &mut side.axes]) {
            let (own, others) = kept.split_at(array.len());
            array.copy_from_slice(own);
            kept = others;
        }
        assert!(kept.is_empty(), "{} numbers more than are kept", kept.len());
    }

    /// Step number `step`, counted from 1, of the matrix with its gradient in the same layout and the moments along the axes.
    pub(crate) fn step(
        &mut self,
        step: u64,
        learning_rate: f32,
        weights: &mut [f32],
        gradient: &[f32],
        first_moment: &mut [f32],
        second_moment: &mut [f32],
    ) {
        let [rows, columns] = self.sides.each_ref().map(|side| side.size);
        let gradient = Matrix::row_major(gradient, rows, columns, columns);
        let SoapConfig { beta, precondition_every, rate } = self.config;
        let mean_beta = if step == 1 { 0.0 } else { beta };
        let of_gradient = if step == 1 { 1.0 } else { 1.0 - beta };
        if step > 1 {
            self.turn(gradient);
            let done = step - 1;
            let whole = 1.0 - f64::from(beta).powf(done as f64);
            let along = &mut self.along;
            vectorised!(self.arch, adam(beta, (1.0 / whole) as f32, along, first_moment, second_moment));
            let [left, right] = self.sides.each_ref().map(Side::axes);
            let along = Matrix::row_major(&self.along, rows, columns, columns);
            combine_by_rows(&mut self.half, 0.0, left.transposed(), along, 1.0);
            let half = Matrix::row_major(&self.half, rows, columns, columns);
            combine_by_rows(weights, 1.0, half, right, -learning_rate * rate);
        }
        let [left, right] = &mut self.sides;
        combine_by_rows(&mut left.mean, mean_beta, gradient, gradient.transposed(), of_gradient);
        combine_by_rows(&mut right.mean, mean_beta, gradient.transposed(), gradient, of_gradient);
        if step == 1 {
            for _ in 0..FIRST_UPDATES {
                rayon::join(|| left.update_axes(), || right.update_axes());
            }
        } else if (step - 1).is_multiple_of(precondition_every) {
            rayon::join(|| left.update_axes(), || right.update_axes());
            self.follow(first_moment, second_moment);
        }
    }

    /// `Q_L G Q_Rᵀ` into `along`.
    fn turn(&mut self, gradient: Matrix<'_>) {
        let [left, right] = self.sides.each_ref().map(Side::axes);
        combine_by_rows(&mut self.half, 0.0, left, gradient, 1.0);
        let [rows, columns] = self.sides.each_ref().map(|side| side.size);
        let half = Matrix::row_major(&self.half, rows, columns, columns);
        combine_by_rows(&mut self.along, 0.0, half, right.transposed(), 1.0);
    }

    /// Turns the moments to the axes of the last update.
    fn follow(&mut self, first_moment: &mut [f32], second_moment: &mut [f32]) {
        let [left, right] = &self.sides;
        let [rows, columns] = [left.size, right.size];
        let [turn_left, turn_right] = [left, right].map(|side| square(&side.turn, side.size));
        let moment = Matrix::row_major(first_moment, rows, columns, columns);
        combine_by_rows(&mut self.half, 0.0, turn_left, moment, 1.0);
        let half = Matrix::row_major(&self.half, rows, columns, columns);
        combine_by_rows(first_moment, 0.0, half, turn_right.transposed(), 1.0);
        for (row, &from) in self.half.chunks_exact_mut(columns).zip(&left.order) {
            let old = &second_moment[from * columns..][..columns];
            row.iter_mut().zip(&right.order).for_each(|(value, &from)| *value = old[from]);
        }
        second_moment.copy_from_slice(&self.half);
    }
}

/// Adam's moments of a gradient and, in its place, their step; `whole` is one over the fraction of the moments that
/// steps have filled.
#[inline(always)]
fn adam(beta: f32, whole: f32, gradient: &mut [f32], first_moment: &mut [f32], second_moment: &mut [f32]) {
    for ((value, first), second) in gradient.iter_mut().zip(first_moment).zip(second_moment) {
        *first = beta * *first + (1.0 - beta) * *value;
        *second = beta * *second + (1.0 - beta) * *value * *value;
        *value = *first * whole / ((*second * whole).sqrt() + EPSILON);
    }
}

/// Rows or columns of a matrix. All arrays are `[size][size]`.
struct Side {
    size: usize,
    /// Of the gradients' products.
    mean: Vec<f32>,
    /// One a row, by falling mean at the last update.
    axes: Vec<f32>,
    /// The axes before the last update, and intermediate results of the new ones.
    before: Vec<f32>,
    /// The new axes along those before.
    turn: Vec<f32>,
    /// Means along the axes, and where each axis stood before.
    along: Vec<f32>,
    order: Vec<usize>,
    orthonormal: Orthonormal,
}

impl Side {
    fn new(size: usize) -> Self {
        let matrix = vec![0.0; size * size];
        let mut axes = matrix.clone();
        axes.iter_mut().step_by(size + 1).for_each(|diagonal| *diagonal = 1.0);
        Self {
            size,
            mean: matrix.clone(),
            axes,
            before: matrix.clone(),
            turn: matrix,
            along: vec![0.0; size],
            order: (0..size).collect(),
            orthonormal: Orthonormal::new(size),
        }
    }

    fn axes(&self) -> Matrix<'_> {
        square(&self.axes, self.size)
    }

    /// A step of power iteration towards the mean's eigenvectors.
    fn update_axes(&mut self) {
        let Self { size, mean, axes, before, turn, along, order, orthonormal } = self;
        let size = *size;
        combine_by_rows(turn, 0.0, square(axes, size), square(mean, size), 1.0);
        let pairs = axes.chunks_exact(size).zip(turn.chunks_exact(size));
        along.iter_mut().zip(pairs).for_each(|(along, (axis, turned))| *along = dot(axis, turned));
        order.iter_mut().enumerate().for_each(|(place, from)| *from = place);
        order.sort_unstable_by(|&a, &b| along[b].total_cmp(&along[a]).then(a.cmp(&b)));
        for (row, &from) in before.chunks_exact_mut(size).zip(&*order) {
            row.copy_from_slice(&turn[from * size..][..size]);
        }
        orthonormal.of(before, turn);
        std::mem::swap(axes, turn);
        std::mem::swap(before, turn);
        combine_by_rows(turn, 0.0, square(axes, size), square(before, size).transposed(), 1.0);
    }
}

fn square(values: &[f32], size: usize) -> Matrix<'_> {
    Matrix::row_major(values, size, size, size)
}

#[cfg(test)]
mod tests;
