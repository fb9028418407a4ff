//! Muon: momentum made orthogonal before it becomes a step, for the matrices between hidden layers.
//!
//! The gradient's momentum U (Nesterov's) of a matrix is replaced by the nearest matrix with orthonormal rows, found by
//! five steps of a quintic Newton-Schulz iteration on `X = U/‖U‖`: `A = X Xᵀ`, `X ← a X + (b A + c A²) X`. All directions
//! of the weights then move alike, however small their gradient. Steps are as long as Adam's typical ones: root mean
//! square 0.2 times the learning rate.
//!
//! Source: Jordan et al. 2024, "Muon: an optimizer for hidden layers in neural networks" (iteration, coefficients); Liu et
//! al. 2025, arXiv 2502.16982 (length of the step).

use imf_fields::recipe::MuonConfig;
use imf_fields::siren::matrix::{Matrix, combine_by_rows};

/// Coefficients a, b, c of the iteration.
pub const QUINTIC: [f32; 3] = [3.4445, -4.7750, 2.0315];
/// Iterations: singular values end near 1, between about 0.7 and 1.2.
pub const STEPS: usize = 5;
/// A step's root mean square over the learning rate.
pub const LENGTH: f32 = 0.2;

/// Working memory for matrices of up to some size.
pub(crate) struct Muon {
    config: MuonConfig,
    x: Vec<f32>,
    next: Vec<f32>,
    gram: Vec<f32>,
    square: Vec<f32>,
}

impl Muon {
    /// Bytes of its working memory.
    pub(crate) fn bytes(rows: usize, columns: usize) -> u64 {
        (4 * 2 * rows * (rows + columns)) as u64
    }

    /// For matrices of `rows` rows and at most `columns` columns, no fewer than rows.
    pub(crate) fn new(config: MuonConfig, rows: usize, columns: usize) -> Self {
        let (matrix, gram) = (vec![0.0; rows * columns], vec![0.0; rows * rows]);
        Self { config, x: matrix.clone(), next: matrix, gram: gram.clone(), square: gram }
    }

    /// One step of a matrix `[rows][columns]`, rows ≤ columns, with its gradient and momentum in the same layout.
    pub(crate) fn step(
        &mut self,
        learning_rate: f32,
        rows: usize,
        weights: &mut [f32],
        gradient: &[f32],
        momentum: &mut [f32],
    ) {
        let columns = weights.len() / rows;
        let kept = self.config.momentum;
        let mut norm = 0.0;
        for ((x, momentum), &gradient) in self.x.iter_mut().zip(momentum).zip(gradient) {
            *momentum = kept * *momentum + (1.0 - kept) * gradient;
            *x = kept * *momentum + (1.0 - kept) * gradient;
            norm += f64::from(*x) * f64::from(*x);
        }
        if norm == 0.0 {
            return;
        }
        let scale = (1.0 / norm.sqrt()) as f32;
        self.x[..weights.len()].iter_mut().for_each(|x| *x *= scale);
        self.orthogonalise(rows, columns);
        let length = learning_rate * self.config.rate * LENGTH * (columns as f32).sqrt();
        weights.iter_mut().zip(&self.x).for_each(|(weight, x)| *weight -= length * x);
    }

    /// `x [rows][columns]` of norm 1 towards the nearest matrix with orthonormal rows.
    fn orthogonalise(&mut self, rows: usize, columns: usize) {
        let [a, b, c] = QUINTIC;
        for _ in 0..STEPS {
            let (x, next) = (&self.x[..rows * columns], &mut self.next[..rows * columns]);
            let (gram, square) = (&mut self.gram[..rows * rows], &mut self.square[..rows * rows]);
            let whole = Matrix::row_major(x, rows, columns, columns);
            combine_by_rows(gram, 0.0, whole, whole.transposed(), 1.0);
            let whole_gram = Matrix::row_major(gram, rows, rows, rows);
            combine_by_rows(square, 0.0, whole_gram, whole_gram, 1.0);
            square.iter_mut().zip(&*gram).for_each(|(square, &gram)| *square = b * gram + c * *square);
            next.iter_mut().zip(x).for_each(|(next, &x)| *next = a * x);
            combine_by_rows(next, 1.0, Matrix::row_major(square, rows, rows, rows), whole, 1.0);
            std::mem::swap(&mut self.x, &mut self.next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn sample(rows: usize, columns: usize, seed: u64) -> Vec<f32> {
        let shape =
            imf_fields::siren::SirenShape { width: rows * columns, hidden: 1, skip_after: None, omega: 1.0 };
        shape.initial_parameters(seed)[..rows * columns].to_vec()
    }

    fn matrix(values: &[f32], rows: usize) -> DMatrix<f64> {
        DMatrix::from_row_iterator(rows, values.len() / rows, values.iter().map(|&v| f64::from(v)))
    }

    #[test]
    fn a_step_is_the_definitions() {
        for (rows, columns) in [(70, 70), (5, 9), (1, 1)] {
            let config = MuonConfig { momentum: 0.9, rate: 2.0 };
            // Room for larger matrices.
            let mut muon = Muon::new(config, rows + 1, columns + 2);
            let (mut weights, mut momentum) = (sample(rows, columns, 1), sample(rows, columns, 2));
            let gradient = sample(rows, columns, 3);
            let g = matrix(&gradient, rows);
            let moved = matrix(&momentum, rows) * 0.9 + &g * 0.1;
            let mut x = &moved * 0.9 + &g * 0.1;
            x /= x.norm();
            let [a, b, c] = QUINTIC.map(f64::from);
            for _ in 0..STEPS {
                let gram = &x * x.transpose();
                x = &x * a + (&gram * b + &gram * &gram * c) * &x;
            }
            let expected = matrix(&weights, rows) - &x * (1e-2 * 2.0 * 0.2 * (columns as f64).sqrt());
            muon.step(1e-2, rows, &mut weights, &gradient, &mut momentum);
            // Five iterations in f32 lose a few units in the last place of values up to 1.
            assert!((matrix(&weights, rows) - expected).abs().max() < 1e-5);
            assert!((matrix(&momentum, rows) - moved).abs().max() < 1e-6);
        }
    }

    #[test]
    fn steps_are_nearly_orthogonal() {
        let (rows, columns) = (40, 60);
        let mut muon = Muon::new(MuonConfig { momentum: 0.0, rate: 1.0 }, rows, columns);
        let mut weights = vec![0.0; rows * columns];
        let mut momentum = weights.clone();
        muon.step(1.0, rows, &mut weights, &sample(rows, columns, 7), &mut momentum);
        let step = matrix(&weights, rows) / (0.2 * (columns as f64).sqrt());
        for value in step.singular_values().iter() {
            // Where the quintic's fixed band lies.
            assert!((0.6..1.3).contains(value), "{value}");
        }
        let before = weights.clone();
        Muon::new(MuonConfig::default(), rows, columns).step(
            1.0,
            rows,
            &mut weights,
            &vec![0.0; rows * columns],
            &mut vec![0.0; rows * columns],
        );
        assert_eq!(weights, before);
    }
}
