//! The dense algebra of a fit: the normal matrix, moments of a sample, principal axes.

use crate::parallel::*;
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn, SymmetricEigen};

use crate::harmonic::HarmonicError;
use crate::harmonic::basis::Basis;
use crate::harmonic::mirror::Parity;
use crate::siren::matrix::{Matrix, product};
use imf_core::control::Control;
use imf_core::section::SectionError;

/// A matrix by rows, in f32.
pub(super) fn row_major(matrix: &DMatrix<f64>) -> Vec<f32> {
    matrix.transpose().iter().map(|&v| v as f32).collect()
}

/// G = BᵀB + R, factored.
///
/// R is what is known before any section is counted: a coefficient's mean square falls with its degree l as l⁻⁷, so
/// what the degrees left out add to a section is no larger than `Σ_(l > L) n_l l⁻⁷` beside `l⁻⁷` of a retained
/// coefficient, whatever the scale. Their quotient on the diagonal makes the sum of squares' minimum the likeliest
/// coefficients (ridge regression): with four sections a function it changes nothing, with one it replaces a singular
/// matrix.
pub(super) struct NormalMatrix(Cholesky<f64, Dyn>);

/// Columns that a thread solves for at a time, and rows of a block.
const COLUMNS: usize = 64;
const ROWS: usize = 64;

/// Measured: 900 sections of the half-resolution teapot, degrees 5 to 18, fall as l^−6.97. Powers 6 to 8 give errors within
/// 4 % of each other.
const FALL: i32 = 7;
/// Degrees beyond this add nothing to the sum of those left out.
const LAST_DEGREE: usize = 400;

/// R's diagonal, function by function.
pub(super) fn ridge(basis: &Basis) -> Vec<f64> {
    let power = |degree: usize| (degree.max(1) as f64).powi(-FALL);
    let count = |degree| Basis::count_of_degree(basis.domain(), degree);
    let left_out: f64 =
        (basis.degree() + 1..LAST_DEGREE).map(|degree| count(degree) as f64 * power(degree)).sum();
    let degrees = (0..=basis.degree()).flat_map(|degree| std::iter::repeat_n(degree, count(degree)));
    // The constant may be anything.
    degrees.map(|degree| if degree == 0 { 0.0 } else { left_out / power(degree) }).collect()
}

/// Fractions of the mean of the diagonal that are added to it, one after the other, until the matrix is
/// positive definite.
const LIFTS: [f64; 5] = [0.0, 1e-8, 1e-7, 1e-6, 1e-5];

/// The Cholesky factor of a normal matrix, which is made again with a lift where rounding (f32 or high degrees) made
/// it indefinite.
pub(super) fn factored(
    gram: impl Fn() -> DMatrix<f64>,
    ridge: &[f64],
) -> Result<Cholesky<f64, Dyn>, HarmonicError> {
    let lifted = |lift: f64| {
        let mut gram = gram();
        let lift = lift * gram.trace() / gram.nrows() as f64;
        for (place, ridge) in ridge.iter().enumerate() {
            gram[(place, place)] += ridge + lift;
        }
        Cholesky::new(gram)
    };
    LIFTS.into_iter().find_map(lifted).ok_or(HarmonicError::Singular)
}

impl NormalMatrix {
    pub(super) fn new(basis: &Basis, values: &[f32]) -> Result<Self, HarmonicError> {
        factored(|| gram(values, basis.len()), &ridge(basis)).map(Self)
    }

    /// `(G + R)⁻¹` times a matrix, some columns at a time on every thread.
    pub(super) fn solve(
        &self,
        mut right: DMatrix<f64>,
        control: Control<'_>,
    ) -> Result<DMatrix<f64>, HarmonicError> {
        let rows = right.nrows();
        right.as_mut_slice().par_chunks_mut(rows * COLUMNS).try_for_each(|columns| {
            control.check().map_err(SectionError::from)?;
            let count = columns.len() / rows;
            self.solve_columns(DMatrixViewMut::from_slice(columns, rows, count));
            Ok::<_, SectionError>(())
        })?;
        Ok(right)
    }

    /// `L` then `Lᵀ`, a block of rows at a time, so that most of the work is products of matrices.
    fn solve_columns(&self, mut x: DMatrixViewMut<'_, f64>) {
        let factor = self.0.l_dirty();
        let rows = x.nrows();
        let blocks = || (0..rows).step_by(ROWS).map(|first| (first, ROWS.min(rows - first)));
        for (first, size) in blocks() {
            let (mut own, mut rest) = x.rows_range_pair_mut(first..first + size, first + size..);
            factor.view((first, first), (size, size)).solve_lower_triangular_unchecked_mut(&mut own);
            let below = factor.view((first + size, first), (rows - first - size, size));
            rest.gemm(-1.0, &below, &own, 1.0);
        }
        for (first, size) in blocks().rev() {
            let (mut own, rest) = x.rows_range_pair_mut(first..first + size, first + size..);
            let below = factor.view((first + size, first), (rows - first - size, size));
            own.gemm(-1.0, &below.transpose(), &rest, 1.0);
            factor.view((first, first), (size, size)).tr_solve_lower_triangular_unchecked_mut(&mut own);
        }
    }

    /// `B (G + R)⁻¹ U`: what a section's value adds to every coefficient along `components`, `[orientation][axis]`.
    pub(super) fn weights(
        &self,
        values: &[f32],
        components: &DMatrix<f64>,
        control: Control<'_>,
    ) -> Result<Vec<f32>, HarmonicError> {
        let (functions, count) = components.shape();
        let projected = row_major(&self.solve(components.clone(), control)?);
        Ok(product(Matrix::dense(values, functions), Matrix::dense(&projected, count)))
    }
}

/// AᵀA of a row-major matrix with `columns` columns; products in f32, sums of row blocks in f64.
pub(super) fn gram(values: &[f32], columns: usize) -> DMatrix<f64> {
    let (rows_at_once, parts_at_once) = (256, threads().clamp(4, 8));
    let square = |rows: &[f32]| {
        let matrix = Matrix::dense(rows, columns);
        product(matrix.transposed(), matrix)
    };
    let mut sum = DMatrix::zeros(columns, columns);
    // Always in the same order, some parts in memory at a time.
    for rows in values.chunks(parts_at_once * rows_at_once * columns) {
        let parts: Vec<Vec<f32>> = rows.par_chunks(rows_at_once * columns).map(square).collect();
        for part in &parts {
            sum.iter_mut().zip(part).for_each(|(sum, &v)| *sum += f64::from(v));
        }
    }
    sum
}

/// Statistics of the coefficients from a sample.
pub(super) struct SampleSolution {
    pub mean: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
}

impl SampleSolution {
    /// That of a sample's `right`, `[voxel][function]`: Bᵀs of every voxel.
    pub(super) fn new(
        right: &[f32],
        normal: &NormalMatrix,
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        let functions = normal.0.l_dirty().nrows();
        let mean = normal.0.solve(&column_means(right, functions));
        let second = gram(right, functions) / (right.len() / functions) as f64;
        let half = normal.solve(second, control)?;
        let mut covariance = normal.solve(half.transpose(), control)?;
        drop(half);
        covariance.ger(-1.0, &mean, &mean, 1.0);
        Ok(Self { mean, covariance })
    }

    /// Statistics of both sides from a sample of one: the covariance has nothing between even and odd functions, and
    /// the mean nothing of the odd ones (voxels on the plane, which are their own images, are taken for either
    /// side's).
    pub(super) fn of_both_sides(mut self, parities: &[Parity]) -> Self {
        if parities.iter().all(|&parity| parity == 0) {
            return self;
        }
        let both = keep_even(&self.mean, parities);
        self.covariance += &self.mean * self.mean.transpose() - &both * both.transpose();
        let rows = parities.len();
        for (place, value) in self.covariance.iter_mut().enumerate() {
            if parities[place % rows] != parities[place / rows] {
                *value = 0.0;
            }
        }
        self.mean = both;
        self
    }
}

/// The mean over both sides, from that over one.
pub(super) fn keep_even(mean: &DVector<f64>, parities: &[Parity]) -> DVector<f64> {
    let both = mean.iter().zip(parities).map(|(&mean, &parity)| if parity == 0 { mean } else { 0.0 });
    DVector::from_iterator(mean.len(), both)
}

/// Means of the columns of a row-major matrix.
fn column_means(values: &[f32], columns: usize) -> DVector<f64> {
    let mut mean = DVector::zeros(columns);
    for row in values.chunks_exact(columns) {
        mean.iter_mut().zip(row).for_each(|(mean, &v)| *mean += f64::from(v));
    }
    mean / (values.len() / columns) as f64
}

/// The leading eigenvectors as columns, functions × axes, and the sum of the other eigenvalues. Functions of different
/// parities have no covariance, and no axis has both.
pub(super) fn principal_components(
    covariance: &DMatrix<f64>,
    parities: &[Parity],
    components: usize,
) -> (DMatrix<f64>, f64) {
    let functions = covariance.nrows();
    if components == functions {
        return (DMatrix::identity(functions, functions), 0.0);
    }
    let mut all: Vec<(f64, DVector<f64>)> = Vec::with_capacity(functions);
    for parity in 0..=parities.iter().copied().max().unwrap_or_default() {
        let own: Vec<usize> = (0..functions).filter(|&function| parities[function] == parity).collect();
        if own.is_empty() {
            continue;
        }
        let among = covariance.select_rows(&own).select_columns(&own);
        let symmetric = (&among + among.transpose()) * 0.5;
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(symmetric);
        for (&value, column) in eigenvalues.iter().zip(eigenvectors.column_iter()) {
            // One sign for all machines: the largest component is positive.
            let largest = column.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(1.0);
            let mut axis = DVector::zeros(functions);
            own.iter().zip(&column).for_each(|(&place, &v)| axis[place] = v * largest.signum());
            all.push((value, axis));
        }
    }
    all.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let dropped = all[components..].iter().map(|(value, _)| value.max(0.0)).sum();
    let columns: Vec<_> = all.into_iter().take(components).map(|(_, axis)| axis).collect();
    (DMatrix::from_columns(&columns), dropped)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::harmonic::basis::Domain;

    #[test]
    fn blocks_of_rows_and_columns_solve_what_the_factor_solves() {
        // 165 functions: two blocks of rows and a part of one; 130 columns.
        let basis = Basis::new(Domain::Rotations, 4);
        let set = basis.even_set(240).unwrap().orientations;
        let normal = NormalMatrix::new(&basis, &basis.values_at(&set)).unwrap();
        let right = DMatrix::from_fn(165, 130, |row, column| ((row * 37 + column * 11) % 23) as f64 - 11.0);
        let (found, expected) =
            (normal.solve(right.clone(), Control::quiet()).unwrap(), normal.0.solve(&right));
        // The same sums in another order.
        assert!((&found - &expected).amax() < 1e-10 * expected.amax());
        let cancelled = Control { cancelled: &AtomicBool::new(true), ..Control::quiet() };
        assert!(matches!(
            normal.solve(right, cancelled),
            Err(HarmonicError::Section(SectionError::Cancelled(_)))
        ));
    }
}
