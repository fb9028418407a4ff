//! The grid part by part, with the exact values of all orientations: a few planes at a time where sections can be counted
//! so, else whole.

use rayon::prelude::*;

use super::kept::{KeptSections, KeptWorkspaces};
use super::source::{Source, SourceScratch};
use crate::harmonic::HarmonicError;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionError, SectionPlan, SectionScratch, SectionWalk};

/// Bytes of a part's values: about what the outer caches hold. Smaller parts come to every tool's tables more often, larger ones
/// are written and read in memory; 12 MB cost 6 % and 400 MB 14 % of a fit of 300 sections.
const PART_BYTES: usize = 48 << 20;

/// Planes of a part.
fn planes_at_once([nx, ny, nz]: [usize; 3], sections: usize) -> usize {
    (PART_BYTES / (2 * sections * ny * nz).max(1)).clamp(1, nx)
}

/// Bytes at the peak of going through the parts of a grid of these dimensions, all or a side of a plan's; `None` where it has
/// but one.
pub(super) fn memory(plan: &SectionPlan, dims: [usize; 3], sections: usize) -> Option<u64> {
    let [_, ny, nz] = dims;
    let part = planes_at_once(dims, sections) * ny * nz;
    plan.walks().then(|| sections as u64 * plan.walk_bytes() + KeptSections::memory(sections, part))
}

/// Where the fit stands.
pub(super) struct Parts<'a> {
    source: &'a Source<'a>,
    set: &'a [Orientation],
    by_planes: Option<(&'a SectionPlan, Vec<SectionWalk>)>,
    /// Planes of a part.
    planes: usize,
    /// The first plane of the next part.
    next: usize,
    kept: Option<KeptSections>,
    workspaces: KeptWorkspaces,
}

impl<'a> Parts<'a> {
    /// Before the first part.
    pub(super) fn new(
        source: &'a Source<'a>,
        set: &'a [Orientation],
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        let mut parts = Self {
            source,
            set,
            by_planes: None,
            planes: source.grid().dims[0],
            next: 0,
            kept: None,
            workspaces: KeptWorkspaces::default(),
        };
        if let Source::Overlap(plan) = source
            && plan.walks()
        {
            let walks: Result<Vec<_>, SectionError> = set
                .par_iter()
                .map_init(SectionScratch::default, |scratch, orientation| {
                    if control.is_cancelled() {
                        return Err(SectionError::Cancelled);
                    }
                    plan.walk(orientation, scratch)
                })
                .collect();
            parts.planes = planes_at_once(plan.grid().dims, set.len());
            parts.by_planes = Some((*plan, walks?));
        }
        Ok(parts)
    }

    /// The next part: its first voxel and its values. One unit of progress is one section over the whole grid.
    pub(super) fn next(
        &mut self,
        control: Control<'_>,
    ) -> Result<Option<(usize, &KeptSections)>, HarmonicError> {
        let [nx, ny, nz] = self.source.grid().dims;
        let planes = self.next..(self.next + self.planes).min(nx);
        if planes.is_empty() {
            return Ok(None);
        }
        self.next = planes.end;
        let kept = match &mut self.by_planes {
            None => self.kept.insert(KeptSections::count(self.source, self.set, control)?),
            Some((plan, walks)) => {
                let room = self.planes * ny * nz;
                let count = self.set.len();
                let kept = self.kept.get_or_insert_with(|| KeptSections::new(self.source, count, room));
                let make = |walk: &mut SectionWalk, scratch: &mut SourceScratch, values: &mut [u16]| {
                    scratch.advance(plan, walk, planes.clone(), values)
                };
                kept.fill(planes.len() * ny * nz, walks, &self.workspaces, control, make)?;
                let done = |planes: usize| (count * planes / nx) as u64;
                (control.progress)(done(planes.end) - done(planes.start));
                kept
            }
        };
        Ok(Some((planes.start * ny * nz, kept)))
    }
}
