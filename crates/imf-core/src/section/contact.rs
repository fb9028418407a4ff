//! What the cutter may enter and the rest of the tool may not: the layer of the part that it cuts along.
//!
//! With contact down to a depth D, the overlap of a pose counts the solid voxels deeper than D and those of fixtures in
//! the whole tool, and the voxels of the layer above only in shank and holder. Where elements offset by a clearance
//! overlap, a voxel of the layer that shank or holder holds counts, whatever the cutter does. Both counts are
//! correlations of whole numbers, and so is their sum: contact costs one more section and nothing in exactness.

use std::sync::Arc;

use super::counter::Counter;
use super::direct::spot_check;
use super::size::{CircularSize, QueryBox};
use super::{SectionError, SectionScratch};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Assembly, RotatedTool, Tool, ToolError};

/// The layer that the cutter may enter, and what of the tool may not.
#[derive(Clone, Copy)]
pub(crate) struct Cuttable<'a> {
    pub(crate) voxels: &'a Arc<Occupancy>,
    pub(crate) noncutting: &'a Tool,
}

impl<'a> Cuttable<'a> {
    /// `None` where there is no such layer, or nothing that must stay out of it.
    pub(crate) fn of(obstacle: &'a Obstacle, assembly: &'a Assembly) -> Option<Self> {
        let (voxels, noncutting) = obstacle.cuttable.as_ref().zip(assembly.noncutting())?;
        Some(Self { voxels, noncutting })
    }

    /// What must stay out of the voxels, rotated; `None` where it is too thin to hold a voxel centre in this orientation.
    ///
    /// # Errors
    /// A tool of absurd size.
    pub(crate) fn rotated(&self, orientation: &Orientation) -> Result<Option<RotatedTool>, ToolError> {
        match RotatedTool::new(self.noncutting, orientation, self.voxels.grid.pitch) {
            Err(ToolError::TooSmall { .. }) => Ok(None),
            rotated => rotated.map(Some),
        }
    }
}

/// The layer as a plan keeps it.
pub(super) struct PlannedLayer {
    pub(super) voxels: Arc<Occupancy>,
    pub(super) noncutting: Tool,
    pub(super) counter: Counter,
}

impl PlannedLayer {
    pub(super) fn new(layer: Cuttable<'_>, query: QueryBox) -> Self {
        let Cuttable { voxels, noncutting } = layer;
        let size = CircularSize::new(voxels.grid.dims, query, noncutting.reach() / voxels.grid.pitch);
        let counter = Counter::new(voxels, size);
        Self { voxels: voxels.clone(), noncutting: noncutting.clone(), counter }
    }

    pub(super) fn rotated(&self, orientation: &Orientation) -> Result<Option<RotatedTool>, ToolError> {
        Cuttable { voxels: &self.voxels, noncutting: &self.noncutting }.rotated(orientation)
    }

    /// Adds the layer's voxels in shank and holder to the counts over the query box.
    pub(super) fn add(
        &self,
        query: &QueryBox,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
    ) -> Result<(), SectionError> {
        let Some(rotated) = self.rotated(orientation)? else { return Ok(()) };
        scratch.more.resize(query.len(), 0);
        self.counter.count(&self.voxels, &rotated, query, &mut scratch.counter, &mut scratch.more);
        spot_check(&self.voxels, &rotated, query, &scratch.more)?;
        scratch.counts.iter_mut().zip(&scratch.more).for_each(|(count, more)| *count += more);
        Ok(())
    }
}
