//! The passes over the orientations: one where memory holds all sections, else some of them at a time.

use crate::parallel::*;
use nalgebra::{DMatrix, DVector};
use pulp::Arch;

use super::quadrature::{ClassWeights, class_order};
use super::sample::{Sample, gather};
use super::sections::{CACHE_BLOCK, CachedSections, Parts};
use super::solve::{NormalMatrix, SampleSolution, keep_even, principal_components};
use super::source::{Source, SourceScratch};
use super::{BLOCK, batch_size};
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::{Coefficients, StoragePrecision};
use crate::harmonic::mirror::{Parity, Planes};
use crate::harmonic::settings::{FitReport, FitSettings, Sizes};
use crate::metrics::Validation;
use crate::siren::matrix::{Matrix, multiply};
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::SectionError;
use imf_core::workspaces::Workspaces;

/// What all ways begin with.
pub(super) struct Start {
    pub basis: Basis,
    set: Vec<Orientation>,
    sample: Sample,
    sizes: Sizes,
    /// Planes of which one side is fitted for both, and the functions' parities.
    pub(super) planes: Planes,
    parities: Vec<Parity>,
}

/// The least squares of all functions together.
pub(super) struct Dense {
    /// B: `[orientation][function]`.
    values: Vec<f32>,
    normal: NormalMatrix,
}

/// The field's numbers: its axes as columns, the mean, the coefficients and the measured errors.
pub(super) struct FitResult {
    pub components: DMatrix<f64>,
    pub mean: DVector<f64>,
    pub(super) coefficients: Coefficients,
    pub report: FitReport,
}

impl Start {
    pub(super) fn new(
        source: &Source<'_>,
        domain: Domain,
        settings: &FitSettings,
        planes: Planes,
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        let basis = Basis::new(domain, settings.degree);
        let parities = planes.parities_of(&basis);
        let sizes = settings.sizes(domain);
        let set = basis.fitted_set(sizes.sections)?;
        let sample = Sample::take(source, settings, &basis, planes, control)?;
        Ok(Self { basis, set, sample, sizes, planes, parities })
    }

    pub(super) fn dense(&self) -> Result<Dense, HarmonicError> {
        let values = self.basis.values_at(&self.set);
        let normal = NormalMatrix::new(&self.basis, &values)?;
        Ok(Dense { values, normal })
    }

    /// Results of the sample's values at the fitted orientations, `[orientation][voxel]`.
    fn solved(
        &self,
        own: &[f32],
        dense: &Dense,
        control: Control<'_>,
    ) -> Result<SampleSolution, HarmonicError> {
        let right = self.sample.right(own, &dense.values);
        Ok(SampleSolution::new(&right, &dense.normal, control)?.of_both_sides(&self.parities))
    }

    /// The parities of axes.
    pub(super) fn parities_of(&self, components: &DMatrix<f64>) -> Vec<Parity> {
        components.column_iter().map(|column| self.parities[column.iamax()]).collect()
    }

    fn components_of(&self, solved: &SampleSolution) -> (DMatrix<f64>, FitReport) {
        let (components, dropped) =
            principal_components(&solved.covariance, &self.parities, self.sizes.components);
        (components, self.report(dropped))
    }

    /// What is known before the field is held against exact sections; `dropped` by the axes left out.
    fn report(&self, dropped: f64) -> FitReport {
        let (functions, sections) = (self.basis.len(), self.sizes.sections);
        FitReport { functions, sections, dropped, validation: Validation::default() }
    }

    /// Axes and mean where all functions are retained as they are; they depend on no section.
    fn components_of_classes(&self) -> Result<(DMatrix<f64>, DVector<f64>), HarmonicError> {
        let functions = self.basis.len();
        let mut components = DMatrix::zeros(functions, functions);
        for (axis, function) in class_order(self.basis.degree()).into_iter().enumerate() {
            components[(function, axis)] = 1.0;
        }
        let mean = DVector::from_vec(self.sample.rough_means(&self.basis)?);
        Ok((components, keep_even(&mean, &self.parities)))
    }

    /// One pass, each class of functions by itself, part by part of the grid.
    pub(super) fn class_by_class(
        &self,
        source: &Source<'_>,
        precision: StoragePrecision,
        control: Control<'_>,
    ) -> Result<FitResult, HarmonicError> {
        let weights = ClassWeights::new(&self.basis, &self.set)?;
        let (arch, functions, order) = (Arch::new(), self.basis.len(), &weights.order);
        let workspaces = Workspaces::default();
        let (components, mean) = self.components_of_classes()?;
        let start: Vec<f32> = order.iter().map(|&function| -mean[function] as f32).collect();
        let solve = |sections: &CachedSections, z: &mut Coefficients, first| {
            let voxels = first..first + sections.voxels;
            // A block's sums of the classes, a quarter of a megabyte, stay in the inner caches.
            z.fill_by_blocks(voxels, functions, CACHE_BLOCK, &workspaces, |sums, block, z| {
                z.chunks_exact_mut(functions).for_each(|z| z.copy_from_slice(&start));
                weights.add(arch, sections, block, z, sums);
            });
        };
        let mut coefficients = Coefficients::zeros(source.grid().len() * functions, precision);
        let mut parts = Parts::new(source, &self.set, control)?;
        while let Some((first, sections)) = parts.next(control)? {
            solve(sections, &mut coefficients, first);
        }
        Ok(FitResult { components, mean, coefficients, report: self.report(0.0) })
    }

    /// One pass, whose sections stay in memory: those of the sample decide on the axes, then every block of voxels becomes
    /// coefficients in one product.
    pub(super) fn in_one_pass(
        &self,
        source: &Source<'_>,
        precision: StoragePrecision,
        control: Control<'_>,
    ) -> Result<FitResult, HarmonicError> {
        let dense = self.dense()?;
        let sections = CachedSections::count(source, &self.set, control)?;
        let of_sample = sections.at(&self.sample.places);
        let mut own = Vec::new();
        of_sample.read(Arch::new(), 0..of_sample.voxels.div_ceil(CACHE_BLOCK), &mut own);
        let solved = self.solved(&own, &dense, control)?;
        let (components, report) = self.components_of(&solved);
        let (weights, start) = dense.weights(&components, &solved.mean, control)?;
        let (count, width, arch) = (self.set.len(), components.ncols(), Arch::new());
        let weights = Matrix::row_major(&weights, count, width, width);
        let mut coefficients = Coefficients::zeros(sections.voxels * width, precision);
        let workspaces = Workspaces::default();
        coefficients.fill_by_blocks(0..sections.voxels, width, BLOCK, &workspaces, |own, block, z| {
            z.chunks_exact_mut(width).for_each(|z| z.copy_from_slice(&start));
            let (voxels, first) = (z.len() / width, block * (BLOCK / CACHE_BLOCK));
            sections.read(arch, first..first + voxels.div_ceil(CACHE_BLOCK), own);
            let own = Matrix::row_major(own, count, voxels, voxels).transposed();
            multiply(z, width, own, weights, true);
        });
        Ok(FitResult { components, mean: solved.mean, coefficients, report })
    }

    /// Some sections at a time, along axes on which a first pass decides, or which are the functions class by class.
    pub(super) fn in_batches(
        &self,
        source: &Source<'_>,
        precision: StoragePrecision,
        in_classes: bool,
        control: Control<'_>,
    ) -> Result<FitResult, HarmonicError> {
        let dense = self.dense()?;
        let (components, mean, report) = if in_classes {
            let (components, mean) = self.components_of_classes()?;
            (components, mean, self.report(0.0))
        } else {
            let own = gather(source, &self.set, &self.sample.places, control)?;
            let solved = self.solved(&own, &dense, control)?;
            let (components, report) = self.components_of(&solved);
            (components, solved.mean, report)
        };
        let (weights, start) = dense.weights(&components, &mean, control)?;
        let (voxels, width) = (source.grid().len(), components.ncols());
        let mut coefficients = vec![0.0; voxels * width];
        coefficients.par_chunks_mut(width).for_each(|z| z.copy_from_slice(&start));
        let at_once = batch_size(voxels, self.set.len());
        let mut batch = vec![0.0; at_once * voxels];
        for (set, weights) in self.set.chunks(at_once).zip(weights.chunks(at_once * width)) {
            let batch = &mut batch[..set.len() * voxels];
            count_sections(source, set, batch, control)?;
            let weights = Matrix::row_major(weights, set.len(), width, width);
            coefficients.par_chunks_mut(BLOCK * width).enumerate().for_each(|(block, z)| {
                let own = Matrix::row_major(&batch[block * BLOCK..], set.len(), z.len() / width, voxels);
                multiply(z, width, own.transposed(), weights, true);
            });
        }
        let coefficients = Coefficients::new(coefficients, precision);
        Ok(FitResult { components, mean, coefficients, report })
    }
}

impl Dense {
    /// What turns sections to coefficients along some axes, `z = Uᵀ (G + R)⁻¹ Bᵀ s − Uᵀ μ`: an N × axes matrix, and a start.
    fn weights(
        &self,
        components: &DMatrix<f64>,
        mean: &DVector<f64>,
        control: Control<'_>,
    ) -> Result<(Vec<f32>, Vec<f32>), HarmonicError> {
        let start = (components.transpose() * mean).iter().map(|&v| -v as f32).collect();
        Ok((self.normal.weights(&self.values, components, control)?, start))
    }
}

/// Exact sections, `[orientation][voxel]`.
pub(super) fn count_sections(
    source: &Source<'_>,
    set: &[Orientation],
    sections: &mut [f32],
    control: Control<'_>,
) -> Result<(), SectionError> {
    let sections = sections.par_chunks_exact_mut(source.grid().len());
    sections.zip(set).try_for_each_init(SourceScratch::default, |scratch, (values, orientation)| {
        control.check()?;
        source.section(orientation, scratch, values)?;
        (control.progress)(1);
        Ok(())
    })
}
