//! What is fitted, one orientation at a time: exact sections, or the depths that follow from them.

use std::ops::Range;

use pulp::Arch;

use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::{
    DepthPlan, DepthScratch, Quantity, SectionCursor, SectionError, SectionPlan, SectionScratch,
};
use imf_core::vectorised::vectorised;

/// What one of the whole numbers stands for where values are overlaps.
pub(super) const UNIT: f32 = 1.0 / STEPS;
/// Values are held as whole numbers up to this one.
const STEPS: f32 = 65535.0;

/// Where the values of an orientation come from.
pub(super) enum Source<'a> {
    /// Overlaps.
    Overlap(&'a SectionPlan),
    /// Signed penetration depths.
    Depth(Box<DepthPlan>),
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct SourceScratch {
    arch: Arch,
    sections: SectionScratch,
    depths: DepthScratch,
    values: Vec<f32>,
}

impl<'a> Source<'a> {
    /// The sections of a plan.
    ///
    /// # Errors
    /// A tool that depths cannot be made of.
    pub(super) fn new(plan: &'a SectionPlan, quantity: Quantity) -> Result<Self, SectionError> {
        Ok(match quantity {
            Quantity::Overlap => Self::Overlap(plan),
            Quantity::Depth => Self::Depth(Box::new(DepthPlan::of(plan)?)),
        })
    }

    pub(super) fn grid(&self) -> &Grid {
        match self {
            Self::Overlap(plan) => plan.grid(),
            Self::Depth(plan) => plan.grid(),
        }
    }

    /// What all values lie between.
    pub(super) fn range(&self) -> [f32; 2] {
        match self {
            Self::Overlap(_) => [0.0, 1.0],
            Self::Depth(plan) => [-plan.bound(), plan.bound()],
        }
    }

    /// The minimum value, and the size of one step of the held numbers: 0 and `UNIT` for overlaps.
    pub(super) fn steps(&self) -> (f32, f32) {
        let [low, high] = self.range();
        (low, (high - low) * UNIT)
    }

    /// The values of one orientation, C-ordered.
    pub(super) fn section(
        &self,
        orientation: &Orientation,
        scratch: &mut SourceScratch,
        values: &mut [f32],
    ) -> Result<(), SectionError> {
        match self {
            Self::Overlap(plan) => plan.cmf(orientation, &mut scratch.sections, values),
            Self::Depth(plan) => plan.depths(orientation, &mut scratch.depths, values),
        }
    }

    /// The same as parts of their range in steps of 1/65535: their rounding, 4e-6 of the range in the root mean square, is a
    /// thousandth of any field's error.
    pub(super) fn kept(
        &self,
        orientation: &Orientation,
        scratch: &mut SourceScratch,
        kept: &mut [u16],
    ) -> Result<(), SectionError> {
        if let Self::Overlap(plan) = self
            && plan.tip_alone()
        {
            let (whole, counts) = plan.counts_in(orientation, plan.grid(), &mut scratch.sections)?;
            keep_counts(scratch.arch, whole, counts, kept);
            return Ok(());
        }
        let mut values = std::mem::take(&mut scratch.values);
        values.resize(kept.len(), 0.0);
        let done = self.section(orientation, scratch, &mut values);
        let [low, high] = self.range();
        let factor = STEPS / (high - low);
        vectorised!(scratch.arch, round(values.iter().map(|value| (value - low) * factor), kept));
        scratch.values = values;
        done
    }
}

impl SourceScratch {
    /// Overlaps over the next planes of a walk, held as by [`Source::kept`].
    pub(super) fn advance(
        &mut self,
        plan: &SectionPlan,
        cursor: &mut SectionCursor,
        planes: Range<usize>,
        kept: &mut [u16],
    ) -> Result<(), SectionError> {
        let counts = cursor.advance(plan, planes, &mut self.sections)?;
        keep_counts(self.arch, cursor.whole, counts, kept);
        Ok(())
    }
}

/// Where the tip alone is sharp, counts are values but for a factor.
fn keep_counts(arch: Arch, whole: u32, counts: &[u32], kept: &mut [u16]) {
    let factor = STEPS / whole as f32;
    vectorised!(arch, round(counts.iter().map(|&count| count as f32 * factor), kept));
}

/// Values from 0 to [`STEPS`] to the nearest whole numbers.
#[inline(always)]
fn round(values: impl Iterator<Item = f32>, kept: &mut [u16]) {
    for (kept, value) in kept.iter_mut().zip(values) {
        // By way of i32, for which processors have an instruction.
        *kept = (value + 0.5).min(STEPS) as i32 as u16;
    }
}
