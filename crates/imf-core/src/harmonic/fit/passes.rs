//! The passes over the orientations: one where memory holds all sections, else two.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::sample::Sample;
use super::solve::{NormalMatrix, Solved, function_values, principal_axes};
use super::{BLOCK, FitReport, FitSettings, Sizes, batch_size};
use crate::control::Control;
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::{Coefficients, Precision};
use crate::orientation::Orientation;
use crate::section::{SectionError, SectionPlan, SectionScratch};
use crate::siren::matrix::{Matrix, multiply};

/// What both ways begin with.
pub(super) struct Start {
    pub(super) basis: Basis,
    set: Vec<Orientation>,
    /// B: `[orientation][function]`.
    values: Vec<f32>,
    normal: NormalMatrix,
    sample: Sample,
    sizes: Sizes,
}

/// The field's numbers: its axes as columns, the mean, the coefficients and what is known of the errors.
pub(super) struct Fitted {
    pub(super) axes: DMatrix<f64>,
    pub(super) mean: DVector<f64>,
    pub(super) coefficients: Coefficients,
    pub(super) report: FitReport,
}

impl Start {
    pub(super) fn new(
        plan: &SectionPlan,
        domain: Domain,
        settings: &FitSettings,
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        settings.check()?;
        let basis = Basis::new(domain, settings.degree);
        let sizes = settings.sizes(domain);
        let set = basis.even_set(sizes.sections)?.orientations;
        let values = function_values(&basis, &set);
        let normal = NormalMatrix::new(&basis, &values)?;
        let sample = Sample::take(plan, settings, &basis, control)?;
        Ok(Self { basis, set, values, normal, sample, sizes })
    }

    /// What the sample's voxels alone tell, by a pass over the orientations.
    pub(super) fn sampled(
        &self,
        plan: &SectionPlan,
        control: Control<'_>,
    ) -> Result<(Solved, DMatrix<f64>, FitReport), HarmonicError> {
        let solved = self
            .sample
            .moments(&self.sample.gather(plan, &self.set, control)?, &self.values)
            .solve(&self.normal);
        let (axes, report) = self.axes_of(&solved);
        Ok((solved, axes, report))
    }

    fn axes_of(&self, solved: &Solved) -> (DMatrix<f64>, FitReport) {
        let (axes, dropped) = principal_axes(&solved.covariance, self.sizes.axes);
        let report = self.sample.report(solved, &self.basis, self.sizes.sections, dropped);
        (axes, report)
    }

    /// What turns sections to coefficients along some axes, `z = Uᵀ (G + R)⁻¹ Bᵀ s − Uᵀ μ`: an N × axes matrix, and a start.
    fn weights(&self, axes: &DMatrix<f64>, mean: &DVector<f64>) -> (Vec<f32>, Vec<f32>) {
        let start = (axes.transpose() * mean).iter().map(|&v| -v as f32).collect();
        (self.normal.weights(&self.values, axes), start)
    }

    /// One pass, whose sections stay in memory: those of the sample decide on the axes, then every block of voxels becomes
    /// coefficients in one product.
    pub(super) fn in_one_pass(
        &self,
        plan: &SectionPlan,
        precision: Precision,
        control: Control<'_>,
    ) -> Result<Fitted, HarmonicError> {
        let voxels = plan.grid().len();
        let mut sections = vec![0.0; self.set.len() * voxels];
        count_sections(plan, &self.set, &mut sections, control)?;
        let of_sample = sections.chunks_exact(voxels);
        let of_sample: Vec<f32> =
            of_sample.flat_map(|section| self.sample.places.iter().map(|&place| section[place])).collect();
        let solved = self.sample.moments(&of_sample, &self.values).solve(&self.normal);
        let (axes, report) = self.axes_of(&solved);
        let (weights, start) = self.weights(&axes, &solved.mean);
        let (count, width) = (self.set.len(), axes.ncols());
        let weights = Matrix::row_major(&weights, count, width, width);
        let coefficients = Coefficients::by_blocks(voxels, width, BLOCK, precision, |first, z| {
            z.chunks_exact_mut(width).for_each(|z| z.copy_from_slice(&start));
            let own = Matrix::row_major(&sections[first..], count, z.len() / width, voxels).transposed();
            multiply(z, width, own, weights, true);
        });
        Ok(Fitted { axes, mean: solved.mean, coefficients, report })
    }

    /// A first pass decides on the axes, a second makes the coefficients along them, some sections at a time.
    pub(super) fn in_two_passes(
        &self,
        plan: &SectionPlan,
        precision: Precision,
        control: Control<'_>,
    ) -> Result<Fitted, HarmonicError> {
        let (solved, axes, report) = self.sampled(plan, control)?;
        let (weights, start) = self.weights(&axes, &solved.mean);
        let (voxels, width) = (plan.grid().len(), axes.ncols());
        let mut coefficients = vec![0.0; voxels * width];
        coefficients.par_chunks_mut(width).for_each(|z| z.copy_from_slice(&start));
        let at_once = batch_size(voxels, self.set.len());
        let mut batch = vec![0.0; at_once * voxels];
        for (set, weights) in self.set.chunks(at_once).zip(weights.chunks(at_once * width)) {
            let batch = &mut batch[..set.len() * voxels];
            count_sections(plan, set, batch, control)?;
            let weights = Matrix::row_major(weights, set.len(), width, width);
            coefficients.par_chunks_mut(BLOCK * width).enumerate().for_each(|(block, z)| {
                let own = Matrix::row_major(&batch[block * BLOCK..], set.len(), z.len() / width, voxels);
                multiply(z, width, own.transposed(), weights, true);
            });
        }
        let coefficients = Coefficients::new(coefficients, precision);
        Ok(Fitted { axes, mean: solved.mean, coefficients, report })
    }
}

/// Exact sections, `[orientation][voxel]`.
fn count_sections(
    plan: &SectionPlan,
    set: &[Orientation],
    sections: &mut [f32],
    control: Control<'_>,
) -> Result<(), SectionError> {
    let sections = sections.par_chunks_exact_mut(plan.grid().len());
    sections.zip(set).try_for_each_init(SectionScratch::default, |scratch, (cmf, orientation)| {
        if control.is_cancelled() {
            return Err(SectionError::Cancelled);
        }
        plan.cmf(orientation, scratch, cmf)?;
        (control.progress)(1);
        Ok(())
    })
}
