//! What the cutter may enter and the rest of the tool may not: the layer of the part that it cuts along.
//!
//! With contact down to a depth D, the overlap of a pose counts the solid voxels deeper than D and those of fixtures in
//! the whole tool, and the voxels of the layer above only in shank and holder. Where elements grown by a clearance
//! overlap, a voxel of the layer that shank or holder holds counts, whatever the cutter does. Both counts are
//! correlations of whole numbers, and so is their sum: contact costs one more section and nothing in exactness.

use super::counter::Counter;
use super::direct::spot_check;
use super::size::{CircularSize, QueryBox};
use super::{SectionError, SectionScratch};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::scene::Scene;
use crate::tool::{Assembly, RotatedTool, Tool, ToolError};

/// What a tool must stay out of.
#[derive(Clone, Copy, Debug)]
pub struct Obstacles<'a> {
    /// What no point of the tool may enter.
    pub solid: &'a Occupancy,
    /// What the cutter may enter.
    pub skin: Option<Skin<'a>>,
}

/// Voxels that only a part of the tool must stay out of.
#[derive(Clone, Copy, Debug)]
pub struct Skin<'a> {
    /// On the grid of [`Obstacles::solid`], which holds none of them.
    pub voxels: &'a Occupancy,
    /// What must stay out of them: shank and holder ([`Tool::without_cutter`]), grown as the whole tool is.
    pub rest: &'a Tool,
}

impl Skin<'_> {
    /// What must stay out of the voxels, rotated; `None` where it is too thin to hold a voxel centre in this orientation.
    ///
    /// # Errors
    /// A tool of absurd size.
    pub(crate) fn rotated(&self, orientation: &Orientation) -> Result<Option<RotatedTool>, ToolError> {
        match RotatedTool::new(self.rest, orientation, self.voxels.grid.pitch) {
            Err(ToolError::TooSmall { .. }) => Ok(None),
            rotated => rotated.map(Some),
        }
    }
}

impl<'a> Obstacles<'a> {
    /// Of an obstacle and the tool that must stay out of it.
    #[must_use]
    pub fn of(obstacle: &'a Obstacle, assembly: &'a Assembly) -> Self {
        let skin = obstacle.cuttable.as_deref().zip(assembly.noncutting());
        Self { solid: &obstacle.forbidden, skin: skin.map(|(voxels, rest)| Skin { voxels, rest }) }
    }

    /// Of a whole obstacle, and of how it is divided where the cutter may touch it; `rest` is what of the tool must stay out
    /// of the layer too, if there is any.
    #[must_use]
    pub fn new(whole: &'a Occupancy, contact: Option<&'a Contact>, rest: Option<&'a Tool>) -> Self {
        match contact {
            Some(contact) => contact.obstacles(rest),
            None => Self::from(whole),
        }
    }
}

impl<'a> From<&'a Occupancy> for Obstacles<'a> {
    fn from(solid: &'a Occupancy) -> Self {
        Self { solid, skin: None }
    }
}

/// Part and fixtures, divided into the layer that a cutter may enter and all else.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// The part deeper than the contact, and the fixtures.
    pub solid: Occupancy,
    /// The part's other voxels.
    pub skin: Occupancy,
}

impl Contact {
    /// Lets the cutter into a layer of an obstacle ([`Bodies::layer`](crate::scene::Bodies::layer)).
    #[must_use]
    pub fn new(obstacle: &Occupancy, layer: Occupancy) -> Self {
        let mut solid = obstacle.clone();
        solid.solid.iter_mut().zip(&layer.solid).for_each(|(s, &l)| *s &= 1 - l);
        Self { skin: layer, solid }
    }

    /// The division of a scene with contact.
    #[must_use]
    pub fn of_scene(scene: &Scene) -> Option<Self> {
        scene.layer.clone().map(|layer| Self::new(&scene.obstacle, layer))
    }

    /// What a tool must stay out of; `rest` is what of it must stay out of the layer too, if there is any.
    #[must_use]
    pub fn obstacles<'a>(&'a self, rest: Option<&'a Tool>) -> Obstacles<'a> {
        Obstacles { solid: &self.solid, skin: rest.map(|rest| Skin { voxels: &self.skin, rest }) }
    }
}

/// The layer as a plan keeps it.
pub(super) struct PlannedSkin {
    pub(super) voxels: Occupancy,
    rest: Tool,
    pub(super) counter: Counter,
}

impl PlannedSkin {
    pub(super) fn new(skin: Skin<'_>, query: QueryBox) -> Self {
        let grid = &skin.voxels.grid;
        let size = CircularSize::new(grid.dims, query, skin.rest.reach() / grid.pitch);
        let counter = Counter::new(skin.voxels, size);
        Self { voxels: skin.voxels.clone(), rest: skin.rest.clone(), counter }
    }

    pub(super) fn skin(&self) -> Skin<'_> {
        Skin { voxels: &self.voxels, rest: &self.rest }
    }

    /// Adds the layer's voxels in shank and holder to the counts over the query box.
    pub(super) fn add(
        &self,
        query: &QueryBox,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
    ) -> Result<(), SectionError> {
        let Some(rotated) = self.skin().rotated(orientation)? else { return Ok(()) };
        scratch.more.resize(query.len(), 0);
        self.counter.count(&self.voxels, &rotated, query, &mut scratch.counter, &mut scratch.more);
        spot_check(&self.voxels, &rotated, query, &scratch.more)?;
        scratch.counts.iter_mut().zip(&scratch.more).for_each(|(count, more)| *count += more);
        Ok(())
    }
}
