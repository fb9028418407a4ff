//! Sections that stay in memory, two bytes a value.

use pulp::Arch;
use rayon::prelude::*;

use super::source::{Source, SourceScratch};
use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::SectionError;

/// Exact values as parts of their range in steps of 1/65535: their rounding, 4e-6 of the range in the root mean square, is a
/// thousandth of any field's error.
pub(super) struct KeptSections {
    /// The least value, and what one step is worth: 0 and [`UNIT`] of overlaps.
    low: f32,
    step: f32,
    /// Values of a section.
    pub(super) voxels: usize,
    /// `[orientation][voxel]`.
    pub(super) values: Vec<u16>,
}

/// What one of the whole numbers stands for where values are overlaps.
pub(super) const UNIT: f32 = 1.0 / 65535.0;

impl KeptSections {
    pub(super) fn count(
        source: &Source<'_>,
        set: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let (voxels, arch) = (source.grid().len(), Arch::new());
        let [low, high] = source.range();
        let step = (high - low) * UNIT;
        let mut values = vec![0; set.len() * voxels];
        values.par_chunks_exact_mut(voxels).zip(set).try_for_each_init(
            || (SourceScratch::default(), vec![0.0; voxels]),
            |(scratch, section), (kept, orientation)| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                source.section(orientation, scratch, section)?;
                arch.dispatch(|| round(section, low, step, kept));
                (control.progress)(1);
                Ok(())
            },
        )?;
        Ok(Self { low, step, voxels, values })
    }

    /// Overlaps that are known already.
    #[cfg(test)]
    pub(super) fn of_overlaps(voxels: usize, values: Vec<u16>) -> Self {
        Self { low: 0.0, step: UNIT, voxels, values }
    }

    /// Sections kept.
    pub(super) fn len(&self) -> usize {
        self.values.len() / self.voxels
    }

    /// The values at some voxels alone.
    pub(super) fn at(&self, places: &[usize]) -> Self {
        let sections = self.values.par_chunks_exact(self.voxels);
        let values =
            sections.flat_map_iter(|section| places.iter().map(move |&place| section[place])).collect();
        Self { low: self.low, step: self.step, voxels: places.len(), values }
    }

    /// The values of `count` voxels from `first` on, `[orientation][voxel]` into `values`.
    pub(super) fn read(&self, arch: Arch, first: usize, count: usize, values: &mut Vec<f32>) {
        values.resize(self.len() * count, 0.0);
        let sections = self.values.chunks_exact(self.voxels);
        for (values, section) in values.chunks_exact_mut(count).zip(sections) {
            arch.dispatch(|| widen(&section[first..first + count], self.low, self.step, values));
        }
    }
}

#[inline(always)]
fn round(values: &[f32], low: f32, step: f32, kept: &mut [u16]) {
    for (kept, &value) in kept.iter_mut().zip(values) {
        *kept = ((value - low) / step + 0.5) as u16;
    }
}

#[inline(always)]
fn widen(kept: &[u16], low: f32, step: f32, values: &mut [f32]) {
    for (value, &kept) in values.iter_mut().zip(kept) {
        *value = low + f32::from(kept) * step;
    }
}
