//! Overlaps counted elsewhere, as on a GPU: what a device needs to know of a plan, and values from its counts.

use super::{SectionError, SectionLayer, SectionPlan, StepSpace, direct};
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{RotatedTool, Tool};

impl SectionPlan {
    /// What a device needs to know to count overlaps of the whole tool over the query box or parts of it.
    #[must_use]
    pub fn layer(&self) -> SectionLayer<'_> {
        self.layer_of(&self.obstacle.forbidden, &self.tool)
    }

    /// The same for what a part of the tool must stay out of as well, where there is such a thing.
    #[must_use]
    pub fn cuttable_layer(&self) -> Option<SectionLayer<'_>> {
        self.layer.as_ref().map(|layer| self.layer_of(&layer.voxels, &layer.noncutting))
    }

    fn layer_of<'a>(&self, obstacle: &'a Occupancy, tool: &'a Tool) -> SectionLayer<'a> {
        let grid = &obstacle.grid;
        let space = StepSpace::new(grid.dims, self.query, tool.reach() / grid.pitch);
        SectionLayer { obstacle, tool, space }
    }

    /// As [`SectionPlan::cmf`], from overlaps that were counted elsewhere, over [`SectionPlan::query_box`]: those of
    /// [`SectionPlan::layer`] with its tool in this orientation, and where the plan has a [`SectionPlan::cuttable_layer`] those
    /// of it, or none where its tool holds no voxel centre.
    ///
    /// # Errors
    /// A failed spot check.
    ///
    /// # Panics
    /// If counts have not the query box's length, or `cmf` the grid's.
    pub fn cmf_of_counts(
        &self,
        orientation: &Orientation,
        (rotated, mut counts): (&RotatedTool, Vec<u32>),
        cuttable: Option<(&RotatedTool, &[u32])>,
        cmf: &mut [f32],
    ) -> Result<(), SectionError> {
        assert_eq!(counts.len(), self.query.len(), "one count for each voxel of the query box");
        self.spot_check(rotated, &self.query, &counts)?;
        if let (Some((rest, more)), Some(layer)) = (cuttable, &self.layer) {
            direct::spot_check(&layer.voxels, rest, &self.query, more)?;
            counts.iter_mut().zip(more).for_each(|(count, more)| *count += more);
        }
        self.read_values(orientation, rotated.count, &counts, cmf);
        Ok(())
    }
}
