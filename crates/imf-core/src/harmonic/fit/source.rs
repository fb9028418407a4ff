//! What is fitted, one orientation at a time: exact sections, or the depths that follow from them.

use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::section::{DepthPlan, DepthScratch, Quantity, SectionError, SectionPlan, SectionScratch};

/// What one of the whole numbers stands for where values are overlaps.
pub(crate) const UNIT: f32 = 1.0 / 65535.0;

/// Where the values of an orientation come from.
pub(crate) enum Source<'a> {
    Overlap(&'a SectionPlan),
    Depth(Box<DepthPlan>),
}

/// Working memory of one thread.
#[derive(Default)]
pub(crate) struct SourceScratch {
    sections: SectionScratch,
    depths: DepthScratch,
}

impl<'a> Source<'a> {
    pub(crate) fn new(plan: &'a SectionPlan, quantity: Quantity) -> Result<Self, SectionError> {
        Ok(match quantity {
            Quantity::Overlap => Self::Overlap(plan),
            Quantity::Depth => Self::Depth(Box::new(DepthPlan::of(plan)?)),
        })
    }

    pub(crate) fn grid(&self) -> &Grid {
        match self {
            Self::Overlap(plan) => plan.grid(),
            Self::Depth(plan) => plan.grid(),
        }
    }

    /// What all values lie between.
    pub(crate) fn range(&self) -> [f32; 2] {
        match self {
            Self::Overlap(_) => [0.0, 1.0],
            Self::Depth(plan) => [-plan.bound(), plan.bound()],
        }
    }

    /// Values as parts of their range in steps of 1/65535: their rounding, 4e-6 of the range in the root mean square, is a
    /// thousandth of any field's error.
    #[inline(always)]
    pub(crate) fn keep(&self, values: &[f32], kept: &mut [u16]) {
        let (low, step) = self.steps();
        for (kept, &value) in kept.iter_mut().zip(values) {
            *kept = ((value - low) / step + 0.5) as u16;
        }
    }

    /// The least value, and what one step of those that are kept is worth: 0 and [`UNIT`] of overlaps.
    pub(crate) fn steps(&self) -> (f32, f32) {
        let [low, high] = self.range();
        (low, (high - low) * UNIT)
    }

    /// The values of one orientation, C-ordered.
    pub(crate) fn section(
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
}
