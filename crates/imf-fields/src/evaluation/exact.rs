//! The exact reference of a field: exact sections of its quantity, and where the bare tool collides.

use super::AT_ONCE;
use crate::parallel::*;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{DepthPlan, DepthScratch, Imf, Quantity, SectionError, SectionPlan, imf, sections};

/// The exact reference of a field: overlaps or depths of the tool that it was made for, and where the bare tool
/// collides.
pub struct ExactReference<'a> {
    pub(super) plan: &'a SectionPlan,
    depth: Option<DepthPlan>,
    /// Says where the bare tool collides, where the values themselves do not.
    pub(super) bare: Option<&'a SectionPlan>,
}

impl<'a> From<&'a SectionPlan> for ExactReference<'a> {
    /// Overlaps of a tool, which decisions are about too.
    fn from(plan: &'a SectionPlan) -> Self {
        Self { plan, depth: None, bare: None }
    }
}

impl<'a> ExactReference<'a> {
    /// Exact values of `quantity` for `plan`'s tool. Where that tool is offset by a clearance, `bare` is the plan of
    /// the true tool, by which decisions are counted.
    ///
    /// # Errors
    /// A tool that depths cannot be made of.
    pub fn new(
        plan: &'a SectionPlan,
        quantity: Quantity,
        bare: Option<&'a SectionPlan>,
    ) -> Result<Self, SectionError> {
        let depth = if quantity.is_overlap() { None } else { Some(DepthPlan::of(plan)?) };
        Ok(Self { plan, depth, bare })
    }

    /// The exact values of some orientations.
    ///
    /// # Errors
    /// A section that failed, or cancellation.
    pub fn sections(&self, set: &[Orientation], control: Control<'_>) -> Result<Vec<Vec<f32>>, SectionError> {
        let Some(depth) = &self.depth else { return sections(self.plan, set, control) };
        let section = |scratch: &mut DepthScratch, orientation: &Orientation| {
            control.check()?;
            let mut values = vec![0.0; depth.grid().len()];
            depth.depths(orientation, scratch, &mut values)?;
            (control.progress)(1);
            Ok(values)
        };
        set.par_iter().map_init(DepthScratch::default, section).collect()
    }

    /// The minimum of the values over some orientations. One unit of progress is one orientation.
    ///
    /// # Errors
    /// As [`ExactReference::sections`].
    pub fn minimum(&self, set: &[Orientation], control: Control<'_>) -> Result<Imf, SectionError> {
        if self.depth.is_none() {
            return imf(self.plan, set, control);
        }
        let mut least = Imf::new(self.plan.grid().len());
        for (chunk, part) in set.chunks(AT_ONCE).enumerate() {
            for (place, section) in self.sections(part, control)?.iter().enumerate() {
                least.lower_to(chunk * AT_ONCE + place, section);
            }
        }
        Ok(least)
    }
}
