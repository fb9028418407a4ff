//! Sections that stay in memory, two bytes a value.

use pulp::Arch;
use rayon::prelude::*;

use super::source::{Source, SourceScratch};
use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::SectionError;

/// Exact values as whole numbers ([`Source::keep`]).
pub(super) struct KeptSections {
    /// The least value, and what one step is worth: 0 and [`UNIT`] of overlaps.
    low: f32,
    step: f32,
    /// Values of a section.
    pub(super) voxels: usize,
    /// `[orientation][voxel]`.
    pub(super) values: Vec<u16>,
}

impl KeptSections {
    pub(super) fn count(
        source: &Source<'_>,
        set: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let (voxels, arch) = (source.grid().len(), Arch::new());
        let (low, step) = source.steps();
        let mut values = vec![0; set.len() * voxels];
        values.par_chunks_exact_mut(voxels).zip(set).try_for_each_init(
            || (SourceScratch::default(), vec![0.0; voxels]),
            |(scratch, section), (kept, orientation)| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                source.section(orientation, scratch, section)?;
                arch.dispatch(|| source.keep(section, kept));
                (control.progress)(1);
                Ok(())
            },
        )?;
        Ok(Self { low, step, voxels, values })
    }

    /// Overlaps that are known already.
    #[cfg(test)]
    pub(super) fn of_overlaps(voxels: usize, values: Vec<u16>) -> Self {
        Self { low: 0.0, step: super::source::UNIT, voxels, values }
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
fn widen(kept: &[u16], low: f32, step: f32, values: &mut [f32]) {
    for (value, &kept) in values.iter_mut().zip(kept) {
        *value = low + f32::from(kept) * step;
    }
}
