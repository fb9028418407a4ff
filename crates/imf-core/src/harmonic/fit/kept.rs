//! Sections that stay in memory, two bytes a value.

use pulp::Arch;
use rayon::prelude::*;

use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::{SectionError, SectionPlan, SectionScratch};

/// Exact values in [0, 1] as multiples of 1/65535: their rounding, 4e-6 in the root mean square, is a thousandth of any
/// field's error.
pub(super) struct KeptSections {
    /// Values of a section.
    pub(super) voxels: usize,
    /// `[orientation][voxel]`.
    pub(super) values: Vec<u16>,
}

/// What one of the whole numbers stands for.
pub(super) const UNIT: f32 = 1.0 / 65535.0;

impl KeptSections {
    pub(super) fn count(
        plan: &SectionPlan,
        set: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let (voxels, arch) = (plan.grid().len(), Arch::new());
        let mut values = vec![0; set.len() * voxels];
        values.par_chunks_exact_mut(voxels).zip(set).try_for_each_init(
            || (SectionScratch::default(), vec![0.0; voxels]),
            |(scratch, cmf), (kept, orientation)| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                plan.cmf(orientation, scratch, cmf)?;
                arch.dispatch(|| round(cmf, kept));
                (control.progress)(1);
                Ok(())
            },
        )?;
        Ok(Self { voxels, values })
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
        Self { voxels: places.len(), values }
    }

    /// The values of `count` voxels from `first` on, `[orientation][voxel]` into `values`.
    pub(super) fn read(&self, arch: Arch, first: usize, count: usize, values: &mut Vec<f32>) {
        values.resize(self.len() * count, 0.0);
        let sections = self.values.chunks_exact(self.voxels);
        for (values, section) in values.chunks_exact_mut(count).zip(sections) {
            arch.dispatch(|| widen(&section[first..first + count], values));
        }
    }
}

#[inline(always)]
fn round(values: &[f32], kept: &mut [u16]) {
    for (kept, &value) in kept.iter_mut().zip(values) {
        *kept = (value / UNIT + 0.5) as u16;
    }
}

#[inline(always)]
fn widen(kept: &[u16], values: &mut [f32]) {
    for (value, &kept) in values.iter_mut().zip(kept) {
        *value = f32::from(kept) * UNIT;
    }
}
