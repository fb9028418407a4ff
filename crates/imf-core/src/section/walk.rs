//! Sections of many orientations side by side, some planes of voxels at a time.
//!
//! A tool that is counted by run ends comes through the query box plane by plane, and may rest between two planes. So a
//! fit that wants all orientations of a voxel at once need not hold whole sections. Counts are those of
//! [`SectionPlan::counts`], bit by bit.

use std::ops::Range;

use super::clipped::ClippedTool;
use super::contact::PlannedLayer;
use super::counter::{self, Counter};
use super::direct::{Spot, spots};
use super::run_ends::RunEnds;
use super::size::QueryBox;
use super::surface::Walk;
use super::{SLANT, SectionError, SectionPlan, SectionScratch};
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::RotatedTool;

/// A tool in one orientation on its way through a plan's planes along x.
pub struct SectionWalk {
    /// The rotated tool's own count.
    pub whole: u32,
    solid: Layer,
    cuttable: Option<Layer>,
}

/// The same through one of the obstacles.
struct Layer {
    walk: Walk,
    spots: [Spot; 3],
}

/// One of the obstacles and what counts it.
#[derive(Clone, Copy)]
struct Counted<'a> {
    counter: &'a Counter,
    obstacle: &'a Occupancy,
    query: &'a QueryBox,
}

impl Layer {
    fn new(counted: Counted<'_>, tool: &RotatedTool, scratch: &mut SectionScratch) -> Self {
        let Counted { counter, obstacle, query } = counted;
        let walk = counter.begin(obstacle, tool, query, &mut scratch.counter);
        Self { walk, spots: spots(obstacle, tool, query) }
    }

    /// Counts over some planes of the query box.
    fn advance(
        &mut self,
        counted: Counted<'_>,
        planes: &Range<usize>,
        scratch: &mut counter::Scratch,
        counts: &mut [u32],
    ) -> Result<(), SectionError> {
        let Counted { counter, obstacle, query } = counted;
        let ([lower, ..], [_, ny, nz]) = (query.lower, query.dims);
        let range = lower + planes.start as i64..lower + planes.end as i64;
        counter.advance(obstacle, &mut self.walk, (query, range), scratch, counts);
        let first = planes.start * ny * nz;
        let mut own = self.spots.iter().filter(|spot| (first..first + counts.len()).contains(&spot.index));
        own.try_for_each(|spot| spot.check(counts[spot.index - first]))
    }
}

impl SectionPlan {
    /// True where [`SectionPlan::walk`] can be asked for: sections are counted by run ends, and the tip alone is sharp.
    pub fn walks(&self) -> bool {
        self.tip_alone() && self.counter.takes_run_ends(self.estimate)
    }

    /// The tool in an orientation before the first plane of the grid along x.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn walk(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
    ) -> Result<SectionWalk, SectionError> {
        let rotated = RotatedTool::new(&self.tool, orientation, self.obstacle.grid().pitch)?;
        let solid = Layer::new(self.counted(), &rotated, scratch);
        let cuttable = match &self.layer {
            Some(layer) => {
                let rest = layer.rotated(orientation)?;
                rest.map(|rest| Layer::new(self.counted_layer(layer), &rest, scratch))
            }
            None => None,
        };
        Ok(SectionWalk { whole: rotated.count, solid, cuttable })
    }

    fn counted(&self) -> Counted<'_> {
        Counted { counter: &self.counter, obstacle: &self.obstacle.forbidden, query: &self.query }
    }

    fn counted_layer<'a>(&'a self, layer: &'a PlannedLayer) -> Counted<'a> {
        Counted { counter: &layer.counter, obstacle: &layer.voxels, query: &self.query }
    }

    /// Bytes of a [`SectionWalk`], by estimate.
    pub fn walk_bytes(&self) -> u64 {
        let [_, ny, nz] = self.query.dims;
        let Ok(slanted) = RotatedTool::new(&self.tool, &SLANT, self.obstacle.grid().pitch) else { return 0 };
        let clipped = ClippedTool::new(&slanted, self.counter.size());
        let ends = RunEnds::count(&clipped).into_iter().max().unwrap_or(0);
        let table = 2 * (clipped.dims[0] + 1) * (clipped.dims[1] + 1);
        let layers = 1 + u64::from(self.layer.is_some());
        layers * 4 * (table + 2 * ends + ny * nz) as u64
    }
}

impl SectionWalk {
    /// Shared voxels over the next planes of the grid, C-ordered, in the scratch: from plane 0 on, each once.
    ///
    /// # Errors
    /// A failed spot check.
    pub fn advance<'s>(
        &mut self,
        plan: &SectionPlan,
        planes: Range<usize>,
        scratch: &'s mut SectionScratch,
    ) -> Result<&'s [u32], SectionError> {
        let SectionScratch { counter, counts, more } = scratch;
        let [_, ny, nz] = plan.query.dims;
        counts.resize(planes.len() * ny * nz, 0);
        self.solid.advance(plan.counted(), &planes, counter, counts)?;
        if let Some((layer, planned)) = self.cuttable.as_mut().zip(plan.layer.as_ref()) {
            more.resize(counts.len(), 0);
            layer.advance(plan.counted_layer(planned), &planes, counter, more)?;
            counts.iter_mut().zip(more).for_each(|(count, more)| *count += *more);
        }
        Ok(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::OrientationSet;
    use crate::parts::ReferencePart;
    use crate::scene::SceneSpec;
    use crate::section::{At, Method};
    use crate::tool::Tool;

    #[test]
    fn planes_hold_the_counts_of_whole_sections() {
        let part = ReferencePart::Teapot;
        let (mesh, tool) = (part.mesh(), Tool::paper());
        let spec = SceneSpec::of_reference(part, &mesh, [15, 19, 31], &tool);
        let scene = spec.scene().unwrap();
        let bodies = spec.bodies(&scene.record.grid).unwrap();
        for touching in [false, true] {
            let depth = 2.0 * scene.record.grid.pitch;
            let scene = if touching { scene.clone().with_contact(&bodies, depth) } else { scene.clone() };
            let plan = SectionPlan::of_scene(&scene, At::Tip).unwrap().with_method(Method::RunEnds);
            assert_eq!((plan.walks(), plan.has_layer()), (true, touching));
            // Along the axes and aslant, with every axis of steps among them.
            let mut set = OrientationSet::parse("fibonacci:40").unwrap().orientations;
            set.extend(OrientationSet::parse("0,0;0,180;0,90;180,90;90,90;270,90").unwrap().orientations);
            let (mut scratch, mut whole) = (SectionScratch::default(), vec![0; plan.grid().len()]);
            for orientation in &set {
                let count = plan.counts(orientation, &mut scratch, &mut whole).unwrap();
                let mut walk = plan.walk(orientation, &mut scratch).unwrap();
                assert_eq!(walk.whole, count);
                let mut found = Vec::new();
                for planes in [0..1, 1..6, 6..7, 7..15] {
                    found.extend_from_slice(walk.advance(&plan, planes, &mut scratch).unwrap());
                }
                assert_eq!(found, whole, "{orientation:?}");
            }
        }
    }
}
