//! How often screening missed a better orientation: measured by counting all of them at some voxels.

use rayon::prelude::*;
use serde::Serialize;

use super::Screened;
use super::judge::Judge;
use crate::control::Control;
use crate::field::VoxelMeasures;
use crate::harmonic::HarmonicError;
use crate::orientation::Orientation;
use crate::section::SectionError;
use crate::training::permutation::Permutation;

/// Decides which voxels are drawn, so that a measurement can be repeated.
const SEED: u64 = 0x5c4e;

/// What counting every orientation found at voxels that screening left above 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Misses {
    /// Voxels drawn by chance among those that are not proven.
    pub voxels: usize,
    /// Of these, how many have a lower orientation than the one found.
    pub missed: usize,
    /// Of those, how many have one that is free.
    pub free: usize,
    /// By how much the least is below what was found, in the mean of the missed.
    pub mean: f64,
    /// The same at most.
    pub most: f32,
}

impl Screened {
    /// Counts all `orientations` that were screened at up to `voxels` of the voxels that are not proven. One unit of progress is one
    /// voxel.
    ///
    /// # Errors
    /// A tool without volume in an orientation, or cancellation.
    pub fn misses(
        &self,
        orientations: &[Orientation],
        measures: &VoxelMeasures<'_>,
        voxels: usize,
        control: Control<'_>,
    ) -> Result<Misses, HarmonicError> {
        let value = &self.imf.value;
        let checked: Vec<usize> = (0..value.len()).filter(|&voxel| value[voxel] > 0.0).collect();
        let order = Permutation::new(checked.len(), SEED, 0);
        let drawn: Vec<usize> =
            (0..voxels.min(checked.len())).map(|place| checked[order.at(place)]).collect();
        let judge = Judge::new(measures, orientations, control)?;
        let below = drawn.par_iter().map(|&voxel| {
            let least = judge.least(voxel)?;
            (control.progress)(1);
            Ok((value[voxel] - least, least == 0.0))
        });
        let below = below.collect::<Result<Vec<(f32, bool)>, SectionError>>()?;
        let missed = || below.iter().filter(|&&(below, _)| below > 0.0);
        let count = missed().count();
        Ok(Misses {
            voxels: drawn.len(),
            missed: count,
            free: missed().filter(|&&(_, free)| free).count(),
            mean: missed().map(|&(below, _)| f64::from(below)).sum::<f64>() / count.max(1) as f64,
            most: missed().map(|&(below, _)| below).fold(0.0, f32::max),
        })
    }
}
