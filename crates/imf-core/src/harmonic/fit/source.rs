//! What is fitted, one orientation at a time: exact sections, or the depths that follow from them.

use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::section::{DepthPlan, DepthScratch, Quantity, SectionError, SectionPlan, SectionScratch};

/// Where the values of an orientation come from.
pub(super) enum Source<'a> {
    Overlap(&'a SectionPlan),
    Depth(Box<DepthPlan>),
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct SourceScratch {
    sections: SectionScratch,
    depths: DepthScratch,
}

impl<'a> Source<'a> {
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
}
