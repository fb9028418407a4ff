//! From exact sections to coefficients, by least squares.
//!
//! Sections at N orientations spread evenly, N a few times the number K of functions, determine every voxel's K
//! coefficients as the sum of squares' minimum: `c = G⁻¹ Bᵀ s`, B the N × K values of the functions, G = BᵀB, s the
//! voxel's N exact values. One matrix serves all voxels, so the work is sections (which cost milliseconds) and one dense
//! product. This is the series of `radial` with its tail averaged out rather than cut off, it is divided by the
//! voxels counted as exact sections are, and it asks nothing of the tool.
//!
//! Coefficients are kept along their principal axes: from a sample of voxels, a first pass over the orientations takes
//! the mean and the covariance; its leading eigenvectors U turn the solution into `z = Uᵀ(G⁻¹ Bᵀ s − μ)`, so that a
//! second pass makes the compressed coefficients as it goes, and the full ones never exist.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::basis::{Basis, Domain};
use super::coefficients::{Coefficients, Precision};
use super::{HarmonicError, HarmonicField};
use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::{SectionError, SectionPlan, SectionScratch};
use crate::siren::matrix::{Matrix, multiply};

/// What a harmonic field is made by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Highest degree L of the functions.
    pub degree: usize,
    /// Sections for each function; below about 1.3 the sum of squares has no firm minimum.
    pub sections_per_function: f64,
    /// Principal axes kept; all functions where there are fewer.
    pub axes: usize,
    /// How coefficients are kept.
    pub precision: Precision,
    /// Voxels of the sample that decides on the axes.
    pub sample: usize,
    /// Random orientations, none of the N, at which the sample tells the error to expect.
    pub held_out: usize,
    /// Seed of the held-out orientations.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            degree: 14,
            sections_per_function: 4.0,
            axes: 128,
            precision: Precision::default(),
            sample: 8192,
            held_out: 64,
            seed: 0,
        }
    }
}

impl FitSettings {
    /// Functions, sections and axes of a field over a domain.
    #[must_use]
    pub fn sizes(&self, domain: Domain) -> Sizes {
        let functions = Basis::count(domain, self.degree);
        let sections = (functions as f64 * self.sections_per_function).ceil() as usize;
        Sizes { functions, sections: sections.max(functions), axes: self.axes.clamp(1, functions) }
    }

    /// Bytes at the peak of making a field over `voxels` voxels, and of the field itself.
    #[must_use]
    pub fn memory(&self, domain: Domain, voxels: usize) -> (u64, u64) {
        let Sizes { functions, sections, axes } = self.sizes(domain);
        let field = (voxels * axes) as u64 * self.precision.bytes();
        let made = (voxels * axes * 4) as u64 + if self.precision == Precision::F32 { 0 } else { field };
        let batch = (batch_size(voxels, sections) * voxels * 4) as u64;
        let sampled = (self.sample.min(voxels) * (sections + self.held_out + functions) * 4) as u64;
        let square = (functions * functions * 8 * 6) as u64;
        (made.max(sampled) + batch + square, field)
    }

    pub(super) fn check(&self) -> Result<(), HarmonicError> {
        let refuse = |what: String| Err(HarmonicError::Settings(what));
        if self.degree > MOST_DEGREE {
            return refuse(format!("a degree of {} is above {MOST_DEGREE}", self.degree));
        }
        if !(1.0..=100.0).contains(&self.sections_per_function) {
            return refuse(format!(
                "sections_per_function must be from 1 to 100, not {}",
                self.sections_per_function
            ));
        }
        if self.axes == 0 || self.sample == 0 || self.held_out == 0 {
            return refuse("axes, sample and held_out must be at least 1".into());
        }
        Ok(())
    }
}

/// Higher degrees are refused as a slip of the keyboard: 1681 functions of a direction already.
pub(super) const MOST_DEGREE: usize = 40;

/// How large a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Axes kept.
    pub axes: usize,
}

/// What making a field told of its errors, on the sample's voxels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Mean squared error that the dropped axes make.
    pub dropped: f64,
    /// Mean squared error at the held-out orientations, all functions kept.
    pub held_out_mse: f64,
    /// Largest error there.
    pub held_out_mpe: f64,
}

/// Sections held at a time: enough to fill the products, within this memory.
const BATCH_BYTES: usize = 256 << 20;
/// Products reach full speed with about as many columns.
const MOST_AT_ONCE: usize = 128;
/// Voxels of a product's block.
const BLOCK: usize = 1024;

fn batch_size(voxels: usize, sections: usize) -> usize {
    (BATCH_BYTES / (4 * voxels.max(1))).clamp(8, MOST_AT_ONCE).min(sections.max(1))
}

/// Makes a field of what `plan`'s sections are: the overlap at the tip where the tip alone is sharp, else the least over
/// the sharp points. One unit of progress is one section; there are [`section_count`] of them.
///
/// # Errors
/// Settings out of range, a failed section, or cancellation.
pub fn fit(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<HarmonicField, HarmonicError> {
    let Prepared { basis, set, values, normal, solved, axes_matrix, report } =
        prepare(plan, domain, settings, control)?;
    let Sizes { functions, sections, axes } = settings.sizes(domain);

    // z = Uᵀ G⁻¹ Bᵀ s − Uᵀ μ: an N × axes matrix and a start.
    let projected = normal.solve(&axes_matrix);
    let mut weights = vec![0.0; sections * axes];
    let projected: Vec<f32> = row_major(&projected);
    multiply(
        &mut weights,
        axes,
        Matrix::row_major(&values, sections, functions, functions),
        Matrix::row_major(&projected, functions, axes, axes),
        false,
    );
    let start: Vec<f32> = (axes_matrix.transpose() * &solved.mean).iter().map(|&v| -v as f32).collect();
    let voxels = plan.grid().len();
    let mut coefficients = vec![0.0; voxels * axes];
    coefficients.par_chunks_mut(axes).for_each(|z| z.copy_from_slice(&start));
    let mut first = 0;
    for_batches(plan, &set, control, |batch, count| {
        coefficients.par_chunks_mut(BLOCK * axes).enumerate().for_each(|(block, z)| {
            let from = block * BLOCK;
            let sections = Matrix::row_major(&batch[from..], count, z.len() / axes, voxels).transposed();
            let weights = Matrix::row_major(&weights[first * axes..], count, axes, axes);
            multiply(z, axes, sections, weights, true);
        });
        first += count;
    })?;
    Ok(HarmonicField {
        grid: *plan.grid(),
        basis,
        axes: row_major(&axes_matrix),
        mean: solved.mean.iter().map(|&v| v as f32).collect(),
        coefficients: Coefficients::new(coefficients, settings.precision),
        report,
    })
}

/// What a fit with these settings would err, told by the sample's voxels alone. One unit of progress is one section;
/// there are half as many as for the fit.
///
/// # Errors
/// As [`fit`].
pub fn estimate(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<FitReport, HarmonicError> {
    Ok(prepare(plan, domain, settings, control)?.report)
}

/// All that the sample's voxels decide.
struct Prepared {
    basis: Basis,
    set: Vec<Orientation>,
    /// B: `[orientation][function]`.
    values: Vec<f32>,
    normal: NormalMatrix,
    solved: Solved,
    axes_matrix: DMatrix<f64>,
    report: FitReport,
}

fn prepare(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<Prepared, HarmonicError> {
    settings.check()?;
    let basis = Basis::new(domain, settings.degree);
    let Sizes { functions, sections, axes } = settings.sizes(domain);
    let set = basis.even_set(sections)?.orientations;
    let values = function_values(&basis, &set);
    let normal = NormalMatrix::new(&values, functions)?;
    let sample = Sample::take(plan, settings, &basis, &set, control)?;
    let solved = sample.moments(&values, functions).solve(&normal);
    let report = sample.report(&solved, &basis, settings, sections)?;
    let (axes_matrix, dropped) = principal_axes(&solved.covariance, axes);
    let report = FitReport { dropped, ..report };
    Ok(Prepared { basis, set, values, normal, solved, axes_matrix, report })
}

/// Sections that [`fit`] computes.
#[must_use]
pub fn section_count(domain: Domain, settings: &FitSettings) -> usize {
    2 * settings.sizes(domain).sections + settings.held_out
}

/// B: `[orientation][function]`.
fn function_values(basis: &Basis, set: &[Orientation]) -> Vec<f32> {
    let mut all = vec![0.0f32; set.len() * basis.len()];
    all.par_chunks_mut(basis.len()).zip(set).for_each_init(
        || vec![0.0; basis.len()],
        |row, (out, orientation)| {
            basis.values(orientation, row);
            out.iter_mut().zip(row).for_each(|(out, &mut v)| *out = v as f32);
        },
    );
    all
}

fn row_major(matrix: &DMatrix<f64>) -> Vec<f32> {
    matrix.transpose().iter().map(|&v| v as f32).collect()
}

/// Shows the sections of a set in order, as many at a time as memory allows: `visit(values, count)` with `values` as
/// `[count][voxels]`.
fn for_batches(
    plan: &SectionPlan,
    set: &[Orientation],
    control: Control<'_>,
    mut visit: impl FnMut(&[f32], usize),
) -> Result<(), SectionError> {
    let voxels = plan.grid().len();
    let at_once = batch_size(voxels, set.len());
    let mut batch = vec![0.0; at_once * voxels];
    for orientations in set.chunks(at_once) {
        batch.par_chunks_mut(voxels).zip(orientations).try_for_each_init(
            SectionScratch::default,
            |scratch, (cmf, orientation)| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                plan.cmf(orientation, scratch, cmf)?;
                (control.progress)(1);
                Ok(())
            },
        )?;
        visit(&batch[..orientations.len() * voxels], orientations.len());
    }
    Ok(())
}

/// G = BᵀB, factored.
struct NormalMatrix(Cholesky<f64, Dyn>);

impl NormalMatrix {
    fn new(values: &[f32], functions: usize) -> Result<Self, HarmonicError> {
        let gram = gram(values, functions);
        Cholesky::new(gram).map(Self).ok_or(HarmonicError::Singular)
    }

    fn solve(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        self.0.solve(right)
    }
}

/// AᵀA of a row-major matrix with `columns` columns; products in f32, sums of row blocks in f64.
fn gram(values: &[f32], columns: usize) -> DMatrix<f64> {
    let rows_at_once = 256;
    let parts: Vec<Vec<f32>> = values
        .par_chunks(rows_at_once * columns)
        .map(|rows| {
            let count = rows.len() / columns;
            let matrix = Matrix::row_major(rows, count, columns, columns);
            let mut product = vec![0.0; columns * columns];
            multiply(&mut product, columns, matrix.transposed(), matrix, false);
            product
        })
        .collect();
    let mut sum = DMatrix::zeros(columns, columns);
    for part in &parts {
        sum.iter_mut().zip(part).for_each(|(sum, &v)| *sum += f64::from(v));
    }
    sum
}

/// Exact values at a sample of voxels.
struct Sample {
    /// `[orientation of the even set][voxel]`.
    fitted: Vec<f32>,
    held_out: Vec<Orientation>,
    /// `[held-out orientation][voxel]`.
    judged: Vec<f32>,
    voxels: usize,
}

impl Sample {
    fn take(
        plan: &SectionPlan,
        settings: &FitSettings,
        basis: &Basis,
        set: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        let total = plan.grid().len();
        let voxels = settings.sample.min(total);
        // A golden step visits every part of the grid evenly, and every voxel once where all are taken.
        let places: Vec<usize> = if voxels == total {
            (0..total).collect()
        } else {
            (0..voxels)
                .map(|i| ((i as f64 * 0.618_033_988_749_894_9).fract() * total as f64) as usize)
                .collect()
        };
        let held_out = basis.random_set(settings.held_out, settings.seed)?.orientations;
        let gather = |set: &[Orientation]| -> Result<Vec<f32>, SectionError> {
            let mut all = vec![0.0; set.len() * voxels];
            all.par_chunks_mut(voxels).zip(set).try_for_each_init(
                || (SectionScratch::default(), vec![0.0; total]),
                |(scratch, cmf), (values, orientation)| {
                    if control.is_cancelled() {
                        return Err(SectionError::Cancelled);
                    }
                    plan.cmf(orientation, scratch, cmf)?;
                    values.iter_mut().zip(&places).for_each(|(value, &place)| *value = cmf[place]);
                    (control.progress)(1);
                    Ok(())
                },
            )?;
            Ok(all)
        };
        Ok(Self { fitted: gather(set)?, judged: gather(&held_out)?, held_out, voxels })
    }

    /// `Bᵀ S` with its mean over voxels and its second moments.
    fn moments(&self, values: &[f32], functions: usize) -> Moments {
        let sections = values.len() / functions;
        // [voxel][function], so that voxels are rows.
        let mut right = vec![0.0; self.voxels * functions];
        right.par_chunks_mut(BLOCK * functions).enumerate().for_each(|(block, out)| {
            let count = out.len() / functions;
            let own = Matrix::row_major(&self.fitted[block * BLOCK..], sections, count, self.voxels);
            let values = Matrix::row_major(values, sections, functions, functions);
            multiply(out, functions, own.transposed(), values, false);
        });
        let mut mean = DVector::zeros(functions);
        for row in right.chunks_exact(functions) {
            mean.iter_mut().zip(row).for_each(|(mean, &v)| *mean += f64::from(v));
        }
        mean /= self.voxels as f64;
        let second = gram(&right, functions) / self.voxels as f64;
        Moments { right, mean, second }
    }

    fn report(
        &self,
        solved: &Solved,
        basis: &Basis,
        settings: &FitSettings,
        sections: usize,
    ) -> Result<FitReport, HarmonicError> {
        let functions = basis.len();
        let values = function_values(basis, &self.held_out);
        let count = self.held_out.len();
        let mut predicted = vec![0.0; count * self.voxels];
        multiply(
            &mut predicted,
            self.voxels,
            Matrix::row_major(&values, count, functions, functions),
            Matrix::row_major(&solved.coefficients, self.voxels, functions, functions).transposed(),
            false,
        );
        let errors = predicted.iter().zip(&self.judged).map(|(&p, &e)| f64::from(p.clamp(0.0, 1.0) - e));
        let (sum, largest) =
            errors.fold((0.0, 0.0f64), |(sum, largest), e| (sum + e * e, largest.max(e.abs())));
        let held_out_mse = sum / (settings.held_out * self.voxels) as f64;
        Ok(FitReport { functions, sections, dropped: 0.0, held_out_mse, held_out_mpe: largest })
    }
}

struct Moments {
    /// Bᵀs of every voxel of the sample, `[voxel][function]`.
    right: Vec<f32>,
    mean: DVector<f64>,
    second: DMatrix<f64>,
}

struct Solved {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    /// `[voxel][function]` of the sample.
    coefficients: Vec<f32>,
}

impl Moments {
    fn solve(&self, normal: &NormalMatrix) -> Solved {
        let functions = self.mean.len();
        let mean = normal.0.solve(&self.mean);
        let half = normal.solve(&self.second);
        let covariance = normal.solve(&half.transpose()) - &mean * mean.transpose();
        let inverse = row_major(&normal.solve(&DMatrix::identity(functions, functions)));
        let mut coefficients = vec![0.0; self.right.len()];
        coefficients.par_chunks_mut(BLOCK * functions).enumerate().for_each(|(block, out)| {
            let count = out.len() / functions;
            let right = &self.right[block * BLOCK * functions..];
            let right = Matrix::row_major(right, count, functions, functions);
            multiply(
                out,
                functions,
                right,
                Matrix::row_major(&inverse, functions, functions, functions),
                false,
            );
        });
        Solved { mean, covariance, coefficients }
    }
}

/// The leading eigenvectors as columns, functions × axes, and the sum of the other eigenvalues.
fn principal_axes(covariance: &DMatrix<f64>, axes: usize) -> (DMatrix<f64>, f64) {
    let functions = covariance.nrows();
    if axes == functions {
        return (DMatrix::identity(functions, functions), 0.0);
    }
    let symmetric = (covariance + covariance.transpose()) * 0.5;
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(symmetric);
    let mut order: Vec<usize> = (0..functions).collect();
    order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
    let dropped = order[axes..].iter().map(|&i| eigenvalues[i].max(0.0)).sum();
    let columns: Vec<_> = order[..axes]
        .iter()
        .map(|&i| {
            let column = eigenvectors.column(i);
            // One sign for all machines: the largest component is positive.
            let largest = column.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(1.0);
            column * largest.signum()
        })
        .collect();
    (DMatrix::from_columns(&columns), dropped)
}
