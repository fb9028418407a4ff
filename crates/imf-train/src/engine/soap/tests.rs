//! SOAP against its definition in f64.

use super::*;
use crate::fixtures::numbers;
use nalgebra::DMatrix;

const BETA: f64 = 0.95;

fn matrix(values: &[f32], rows: usize) -> DMatrix<f64> {
    DMatrix::from_row_iterator(rows, values.len() / rows, values.iter().map(|&v| f64::from(v)))
}

/// The definition, with axes in columns and the first moment along the weights, as the paper has it.
struct Definition {
    done: u64,
    moments: [DMatrix<f64>; 2],
    means: [DMatrix<f64>; 2],
    axes: [DMatrix<f64>; 2],
}

impl Definition {
    fn new(rows: usize, columns: usize) -> Self {
        let square = |size| DMatrix::zeros(size, size);
        let zeros = DMatrix::zeros(rows, columns);
        let axes = [rows, columns].map(|size| DMatrix::identity(size, size));
        Self { done: 0, moments: [zeros.clone(), zeros], means: [rows, columns].map(square), axes }
    }

    fn step(&mut self, config: SoapConfig, rate: f64, weights: &mut DMatrix<f64>, gradient: &DMatrix<f64>) {
        let squares = [gradient * gradient.transpose(), gradient.transpose() * gradient];
        if self.done == 0 {
            self.means = squares;
            for _ in 0..FIRST_UPDATES {
                self.update_axes();
            }
            self.done = 1;
            return;
        }
        let [left, right] = &self.axes;
        let along = |m: &DMatrix<f64>| left.transpose() * m * right;
        let [first, second] = &mut self.moments;
        *first = &*first * BETA + gradient * (1.0 - BETA);
        *second = &*second * BETA + along(gradient).map(|g| g * g) * (1.0 - BETA);
        let whole = 1.0 - BETA.powf(self.done as f64);
        let step = along(first).zip_map(second, |m, v| m / whole / ((v / whole).sqrt() + f64::from(EPSILON)));
        *weights -= left * step * right.transpose() * (rate * f64::from(config.rate));
        for (mean, square) in self.means.iter_mut().zip(squares) {
            *mean = &*mean * BETA + square * (1.0 - BETA);
        }
        if self.done.is_multiple_of(config.precondition_every) {
            self.update_axes();
        }
        self.done += 1;
    }

    fn update_axes(&mut self) {
        for side in 0..2 {
            let turned = &self.means[side] * &self.axes[side];
            let along: Vec<f64> =
                (0..turned.ncols()).map(|k| self.axes[side].column(k).dot(&turned.column(k))).collect();
            let mut order: Vec<usize> = (0..along.len()).collect();
            order.sort_by(|&a, &b| along[b].total_cmp(&along[a]));
            self.axes[side] = turned.select_columns(&order).qr().q();
            let second = &self.moments[1];
            self.moments[1] =
                if side == 0 { second.select_rows(&order) } else { second.select_columns(&order) };
        }
    }
}

/// Gradients whose axes are apart: each some three times as strong as the next, seen along axes of their own.
fn gradient(rows: usize, columns: usize, seed: u64) -> Vec<f32> {
    let frame = |size: usize, seed| matrix(&numbers(size * size, seed), size).qr().q();
    let noise = matrix(&numbers(rows * columns, seed), rows);
    let scaled = DMatrix::from_fn(rows, columns, |i, j| noise[(i, j)] * 0.6f64.powi((i + j) as i32));
    let turned = frame(rows, 1000) * scaled * frame(columns, 1001);
    turned.transpose().iter().map(|&v| v as f32).collect()
}

#[test]
fn steps_are_the_definitions() {
    // A first gradient of unequal sides has axes that nothing but rounding decides: there the steps begin later.
    for (rows, columns, first_step) in [(6, 6, 1), (1, 1, 1), (5, 9, 2), (9, 4, 2)] {
        let config = SoapConfig { precondition_every: 4, rate: 2.0, ..SoapConfig::default() };
        let mut soap = Soap::new(config, rows, columns);
        let mut definition = Definition::new(rows, columns);
        if first_step > 1 {
            definition.done = 1;
            for side in 0..2 {
                let size = [rows, columns][side];
                let axes = matrix(&numbers(size * size, 7), size).qr().q();
                let spread =
                    DMatrix::from_fn(size, size, |i, j| if i == j { 0.5f64.powi(i as i32) } else { 0.0 });
                definition.means[side] = &axes * spread * axes.transpose();
                definition.axes[side] = axes;
            }
            let kept = [0, 1].map(|side| {
                // Row by row: a mean is symmetric, axes are rows.
                let [mean, axes] = [&definition.means[side], &definition.axes[side]];
                mean.iter().chain(axes.iter()).map(|&v| v as f32).collect::<Vec<f32>>()
            });
            soap.restore(&kept.concat());
        }
        let mut weights = numbers(rows * columns, 1);
        let mut expected = matrix(&weights, rows);
        let [mut first, mut second] = [0, 1].map(|_| vec![0.0; rows * columns]);
        for step in first_step..=30 {
            let gradient = gradient(rows, columns, 10 + step);
            definition.step(config, 1e-2, &mut expected, &matrix(&gradient, rows));
            soap.step(step, 1e-2, &mut weights, &gradient, &mut first, &mut second);
            let error = (matrix(&weights, rows) - &expected).abs().max();
            // Thirty steps of 0.02, of which f32 loses a few units in the fifth place where axes are weak.
            assert!(error < 1e-4, "{rows}×{columns}, step {step}: {error}");
            assert_eq!(step == 1, weights == numbers(rows * columns, 1));
        }
        let moved = (matrix(&weights, rows) - matrix(&numbers(rows * columns, 1), rows)).abs().max();
        assert!(moved > 0.02, "{moved}");
    }
}

#[test]
fn axes_become_the_means_eigenvectors() {
    let (rows, columns) = (40, 30);
    let mut soap = Soap::new(SoapConfig { precondition_every: 1, ..SoapConfig::default() }, rows, columns);
    let [mut weights, mut first, mut second] = [0; 3].map(|_| vec![0.0; rows * columns]);
    let same = gradient(rows, columns, 3);
    for step in 1..=30 {
        soap.step(step, 1e-2, &mut weights, &same, &mut first, &mut second);
    }
    for side in &soap.sides {
        let axes = matrix(&side.axes, side.size);
        let along = &axes * matrix(&side.mean, side.size) * axes.transpose();
        let rest = &along - DMatrix::from_diagonal(&along.diagonal());
        assert!(rest.abs().max() < 1e-4 * along[(0, 0)], "{}", rest.abs().max());
        assert!((0..5).all(|k| along[(k, k)] > along[(k + 1, k + 1)]));
    }
}

#[test]
fn what_was_kept_goes_on_to_the_same_bits_and_zeros_move_nothing() {
    let (rows, columns) = (33, 40);
    let config = SoapConfig { precondition_every: 3, ..SoapConfig::default() };
    let mut soap = Soap::new(config, rows, columns);
    let [mut weights, mut first, mut second] = [0; 3].map(|_| vec![0.0; rows * columns]);
    for step in 1..=20 {
        if step % 5 == 0 {
            let kept = soap.kept().concat();
            assert_eq!(kept.len(), Soap::state_count(rows, columns));
            let mut other = Soap::new(config, rows, columns);
            other.restore(&kept);
            let mut own = [weights.clone(), first.clone(), second.clone()];
            let [w, m, v] = &mut own;
            let gradient = gradient(rows, columns, step);
            soap.step(step, 1e-2, &mut weights, &gradient, &mut first, &mut second);
            other.step(step, 1e-2, w, &gradient, m, v);
            assert!(own == [weights.clone(), first.clone(), second.clone()]);
            continue;
        }
        soap.step(step, 1e-2, &mut weights, &gradient(rows, columns, step), &mut first, &mut second);
    }
    let mut zeros = Soap::new(config, rows, columns);
    let [mut weights, mut first, mut second] = [0; 3].map(|_| vec![0.0; rows * columns]);
    for step in 1..=10 {
        zeros.step(step, 1e-2, &mut weights, &vec![0.0; rows * columns], &mut first, &mut second);
    }
    assert!(weights.iter().chain(&first).chain(&second).all(|&v| v == 0.0));
}
