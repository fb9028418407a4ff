//! Sections of many orientations in step, a few planes of voxels at a time.
//!
//! Run-length counting yields a section plane by plane and may pause between two planes, so that a fit that needs all
//! orientations of a voxel at once need not store whole sections. Counts are those of
//! [`SectionPlan::counts_in`], bit by bit.

use std::ops::Range;

use super::overlap::OverlapCursor;
use super::{SectionError, SectionPlan, SectionScratch};
use crate::orientation::Orientation;
use crate::tool::ToolError;

/// A section of one orientation in progress, plane by plane along x.
pub struct SectionCursor {
    /// The rotated tool's own count.
    pub whole: u32,
    forbidden: OverlapCursor,
    cuttable: Option<OverlapCursor>,
}

impl SectionPlan {
    /// True where [`SectionPlan::cursor`] can be used: sections are counted by run boundaries, and the tip alone is sharp.
    pub fn has_cursor(&self) -> bool {
        let estimate = self.whole.usual_estimate(&self.query);
        self.tip_alone() && estimate.is_some_and(|estimate| self.whole.uses_run_length(estimate))
    }

    /// Begins the section of an orientation, before the first plane of the grid along x.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn cursor(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
    ) -> Result<SectionCursor, SectionError> {
        let scratch = &mut scratch.counter;
        let rotated = self.rotated(orientation)?;
        let forbidden = self.whole.begin(&rotated, &self.query, scratch);
        let noncutting = self.noncutting.as_ref().map(|counter| -> Result<_, ToolError> {
            let rest = counter.rotated(orientation)?;
            Ok(rest.map(|rest| counter.begin(&rest, &self.query, scratch)))
        });
        Ok(SectionCursor { whole: rotated.count, forbidden, cuttable: noncutting.transpose()?.flatten() })
    }

    /// Bytes of a [`SectionCursor`], by estimate.
    pub fn cursor_bytes(&self) -> u64 {
        (1 + u64::from(self.has_layer())) * self.whole.cursor_bytes(&self.query)
    }
}

impl SectionCursor {
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
        let SectionScratch { counter: scratch, counts, more, .. } = scratch;
        let [_, ny, nz] = plan.query.dims;
        counts.resize(planes.len() * ny * nz, 0);
        let window = (&plan.query, &planes);
        plan.whole.advance(&mut self.forbidden, window, scratch, counts)?;
        if let Some((cursor, counter)) = self.cuttable.as_mut().zip(plan.noncutting.as_ref()) {
            more.resize(counts.len(), 0);
            counter.advance(cursor, window, scratch, more)?;
            counts.iter_mut().zip(more).for_each(|(count, more)| *count += *more);
        }
        Ok(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::ReferencePart;
    use crate::scene::SceneSpec;
    use crate::section::test_shapes::{counts, orientations};
    use crate::section::{Method, ToolPoints};
    use crate::tool::Tool;

    #[test]
    fn planes_hold_the_counts_of_whole_sections() {
        let part = ReferencePart::Teapot;
        let (mesh, tool) = (part.mesh(), Tool::paper());
        let spec = SceneSpec::of_reference(part, &mesh, [15, 19, 31], &tool);
        let scene = spec.scene().unwrap();
        let bodies = spec.bodies(&scene.record.grid).unwrap();
        let touching = scene.clone().with_contact(&bodies, 2.0 * scene.record.grid.pitch);
        // Along the axes and aslant, with every axis of steps among them.
        let mut set = orientations("fibonacci:40");
        set.extend(orientations("0,0;0,180;0,90;180,90;90,90;270,90"));
        for (scene, has_layer) in [(scene, false), (touching, true)] {
            let plan = SectionPlan::of_scene(&scene, ToolPoints::Tip).unwrap().with_method(Method::RunLength);
            assert_eq!((plan.has_cursor(), plan.has_layer()), (true, has_layer));
            let mut scratch = SectionScratch::default();
            for orientation in &set {
                let (whole, count) = counts(&plan, orientation);
                let mut cursor = plan.cursor(orientation, &mut scratch).unwrap();
                assert_eq!(cursor.whole, count);
                let mut found = Vec::new();
                for planes in [0..1, 1..6, 6..7, 7..15] {
                    found.extend_from_slice(cursor.advance(&plan, planes, &mut scratch).unwrap());
                }
                assert_eq!(found, whole, "{orientation:?}");
            }
        }
    }
}
