//! Exact values at a sample of voxels: what decides on the axes.

use crate::parallel::*;
use nalgebra::DMatrix;

use super::solve::NormalMatrix;
use super::source::{Source, SourceScratch};
use super::{BLOCK, ROUGH};
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::Basis;
use crate::harmonic::mirror::Planes;
use crate::harmonic::settings::FitSettings;
use crate::metrics::larger;
use crate::siren::matrix::{Matrix, multiply};
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::SectionError;

/// Voxels of a sample, and where means are needed before any section is fitted, exact values there at a few orientations.
pub(super) struct Sample {
    /// In rising order.
    pub(super) places: Vec<usize>,
    few: Vec<Orientation>,
    /// `[orientation of the few][voxel]`.
    values: Vec<f32>,
}

impl Sample {
    pub(super) fn take(
        source: &Source<'_>,
        settings: &FitSettings,
        basis: &Basis,
        planes: Planes,
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        let total = source.grid().len();
        let voxels = settings.sample.min(total);
        // A golden step visits every part of the grid evenly, and every voxel once where all are taken.
        let mut places: Vec<usize> = if voxels == total {
            (0..total).collect()
        } else {
            (0..voxels)
                .map(|i| ((i as f64 * 0.618_033_988_749_894_9).fract() * total as f64) as usize)
                .collect()
        };
        places.sort_unstable();
        if !settings.in_classes(basis.domain()) {
            return Ok(Self { places, few: Vec::new(), values: Vec::new() });
        }
        let mut few = basis.random_set(ROUGH, settings.seed)?.orientations;
        let mut values = gather(source, &few, &places, control)?;
        // With these the sections are whole again, and progress counts them as that.
        let images = planes.images(&few);
        values.extend(gather(source, &images, &places, Control { progress: &|_| {}, ..control })?);
        few.extend(images);
        Ok(Self { places, few, values })
    }

    /// The likeliest means over all voxels of the functions' coefficients, by a few orientations: known before any section is
    /// fitted, and near enough for deviations from them to be small.
    pub(super) fn rough_means(&self, basis: &Basis) -> Result<Vec<f64>, HarmonicError> {
        let values = basis.values_at(&self.few);
        let means = self
            .values
            .chunks_exact(self.places.len())
            .map(|own| own.iter().map(|&value| f64::from(value)).sum::<f64>() / own.len() as f64);
        let mut right = DMatrix::zeros(basis.len(), 1);
        for (row, mean) in values.chunks_exact(basis.len()).zip(means) {
            right.iter_mut().zip(row).for_each(|(right, &value)| *right += f64::from(value) * mean);
        }
        let means = NormalMatrix::new(basis, &values)?.solve(right, Control::quiet())?;
        Ok(means.iter().copied().collect())
    }

    /// `Bᵀ S` of the sections that are fitted, `[orientation][voxel]` at the sample's voxels: `[voxel][function]`.
    pub(super) fn right(&self, fitted: &[f32], values: &[f32]) -> Vec<f32> {
        let voxels = self.places.len();
        let sections = fitted.len() / voxels;
        let functions = values.len() / sections;
        // [voxel][function], so that voxels are rows.
        let mut right = vec![0.0; voxels * functions];
        right.par_chunks_mut(BLOCK * functions).enumerate().for_each(|(block, out)| {
            let count = out.len() / functions;
            let own = Matrix::row_major(&fitted[block * BLOCK..], sections, count, voxels);
            multiply(out, functions, own.transposed(), Matrix::dense(values, functions), false);
        });
        right
    }
}

/// Mean squared and largest error of a section's values.
pub(super) fn section_error(values: impl Iterator<Item = f32>, exact: &[f32]) -> (f64, f64) {
    let errors = values.zip(exact).map(|(value, exact)| f64::from(value - exact));
    let (sum, largest) = errors.fold((0.0, 0.0), |(sum, most), e| (sum + e * e, larger(most, e.abs())));
    (sum / exact.len() as f64, largest)
}

/// Exact values of some orientations at some voxels, `[orientation][voxel]`.
pub(super) fn gather(
    source: &Source<'_>,
    set: &[Orientation],
    places: &[usize],
    control: Control<'_>,
) -> Result<Vec<f32>, SectionError> {
    let mut all = vec![0.0; set.len() * places.len()];
    all.par_chunks_mut(places.len()).zip(set).try_for_each_init(
        || (SourceScratch::default(), vec![0.0; source.grid().len()]),
        |(scratch, section), (values, orientation)| {
            control.check()?;
            source.section(orientation, scratch, section)?;
            values.iter_mut().zip(places).for_each(|(value, &place)| *value = section[place]);
            (control.progress)(1);
            Ok::<_, SectionError>(())
        },
    )?;
    Ok(all)
}
