//! Exact values at a sample of voxels: what decides on the axes, and what the errors are estimated from.

use crate::parallel::*;
use nalgebra::DMatrix;

use super::BLOCK;
use super::solve::NormalMatrix;
use super::source::{Source, SourceScratch};
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::Basis;
use crate::harmonic::mirror::Planes;
use crate::harmonic::settings::{FitReport, FitSettings};
use crate::metrics::{Validation, larger};
use crate::siren::matrix::{Matrix, multiply, product};
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{Quantity, SectionError};

/// Voxels of a sample, and exact values there at orientations that are not fitted.
pub(super) struct Sample {
    /// In rising order.
    pub(super) places: Vec<usize>,
    held_out: Vec<Orientation>,
    /// `[held-out orientation][voxel]`.
    judged: Vec<f32>,
    quantity: Quantity,
    pitch: f64,
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
        let mut held_out = basis.random_set(settings.held_out, settings.seed)?.orientations;
        let mut judged = gather(source, &held_out, &places, control)?;
        // With these the sections are whole again, and progress counts them as that.
        let images = planes.images(&held_out);
        judged.extend(gather(source, &images, &places, Control { progress: &|_| {}, ..control })?);
        held_out.extend(images);
        Ok(Self { places, held_out, judged, quantity: settings.quantity, pitch: source.grid().pitch })
    }

    /// Those from voxel `first` on, `count` voxels' worth, counted from `first`.
    pub(super) fn places_in(&self, first: usize, count: usize) -> Vec<usize> {
        let place = |voxel| self.places.partition_point(|&place| place < voxel);
        self.places[place(first)..place(first + count)].iter().map(|place| place - first).collect()
    }

    /// The likeliest means over all voxels of the functions' coefficients, by the orientations that are not fitted: known before
    /// any section is, and near enough for deviations from them to be small.
    pub(super) fn rough_means(&self, basis: &Basis) -> Result<Vec<f64>, HarmonicError> {
        let values = basis.values_at(&self.held_out);
        let means = self
            .judged
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

    /// The errors of the sample's coefficients, `[voxel][function]`, where they were not fitted; `dropped` by the axes left
    /// out. The functions stand in `order`.
    pub(super) fn report(
        &self,
        coefficients: &[f32],
        basis: &Basis,
        order: impl Fn(usize) -> usize,
        sections: usize,
        dropped: f64,
    ) -> FitReport {
        let functions = basis.len();
        let values = basis.values_at(&self.held_out);
        let (rows, order) = (values.chunks_exact(functions), &order);
        let values: Vec<f32> =
            rows.flat_map(|row| (0..functions).map(move |place| row[order(place)])).collect();
        let of_voxels = Matrix::dense(coefficients, functions).transposed();
        let predicted = product(Matrix::dense(&values, functions), of_voxels);
        let voxels = self.places.len();
        let rows = predicted.chunks_exact(voxels).zip(self.judged.chunks_exact(voxels));
        let held = |value| self.quantity.clamp(value, self.pitch);
        let errors: Vec<_> = rows.map(|(p, e)| section_error(p.iter().map(|&p| held(p)), e)).collect();
        let sampled = Validation::of(&errors);
        // The errors of dropped components add, since they are orthogonal to the retained ones.
        let validation = Validation { mse: sampled.mse + dropped, ..sampled };
        FitReport { functions, sections, dropped, validation }
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
