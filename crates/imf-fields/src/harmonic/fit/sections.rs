//! The exact values that are fitted, held in memory as two bytes a value.
//!
//! ```text
//! group 0 (sections 0 to 3): block 0: [section][voxel] block 1: [section][voxel] … | group 1: …
//! ```
//! Sections are written a group at a time and read a block at a time: this order keeps both in long stretches. Where sections
//! can be counted plane by plane, the grid is visited part by part ([`Parts`]).

use std::ops::Range;

use pulp::Arch;

use super::source::{Source, SourceScratch};
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::IMAGES;
use crate::parallel::*;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionCursor, SectionError, SectionPlan, SectionScratch};
use imf_core::vectorised::vectorised;
use imf_core::workspaces::Workspaces;

/// Voxels of a block.
pub(super) const CACHE_BLOCK: usize = 256;
/// Sections of a group: a direction and its images.
const GROUP: usize = IMAGES;

/// Working memory of threads that fill sections in; the values are `[section of a group][voxel]`.
pub(super) type CachedWorkspaces = Workspaces<(SourceScratch, Vec<u16>)>;

/// Exact values as whole numbers ([`Source::kept`]).
pub(super) struct CachedSections {
    /// The minimum value, and the size of one step: 0 and `UNIT` for overlaps.
    low: f32,
    step: f32,
    /// Values of a section.
    pub(super) voxels: usize,
    values: Vec<u16>,
}

impl CachedSections {
    /// Room for `sections` of `voxels` values each.
    pub(super) fn new(source: &Source<'_>, sections: usize, voxels: usize) -> Self {
        let (low, step) = source.steps();
        Self { low, step, voxels, values: vec![0; sections * voxels] }
    }

    /// All sections of the grid, whole.
    pub(super) fn count(
        source: &Source<'_>,
        set: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let voxels = source.grid().len();
        let mut kept = Self::new(source, set.len(), voxels);
        let make = |orientation: &mut &Orientation, scratch: &mut SourceScratch, section: &mut [u16]| {
            source.kept(orientation, scratch, section)?;
            (control.progress)(1);
            Ok(())
        };
        let mut orientations: Vec<_> = set.iter().collect();
        kept.fill(voxels, &mut orientations, &Workspaces::default(), control, make)?;
        Ok(kept)
    }

    /// Fills in sections of `voxels` values, at most as many as there is room for: `make` computes each from one of
    /// `tools`.
    pub(super) fn fill<T: Send>(
        &mut self,
        voxels: usize,
        tools: &mut [T],
        workspaces: &CachedWorkspaces,
        control: Control<'_>,
        make: impl Fn(&mut T, &mut SourceScratch, &mut [u16]) -> Result<(), SectionError> + Sync,
    ) -> Result<(), SectionError> {
        self.voxels = voxels;
        self.values.truncate(tools.len() * voxels);
        let groups = self.values.par_chunks_mut(GROUP * voxels).zip(tools.par_chunks_mut(GROUP));
        groups.try_for_each(|(kept, tools)| {
            workspaces.with(|(scratch, sections)| {
                sections.resize(tools.len() * voxels, 0);
                for (section, tool) in sections.chunks_exact_mut(voxels).zip(tools) {
                    control.check()?;
                    make(tool, scratch, section)?;
                }
                into_blocks(sections, voxels, kept);
                Ok(())
            })
        })
    }

    /// Overlaps that are known already, `[section][voxel]`.
    #[cfg(test)]
    pub(super) fn of_overlaps(voxels: usize, sections: &[u16]) -> Self {
        let mut values = vec![0; sections.len()];
        let groups = sections.chunks(GROUP * voxels).zip(values.chunks_mut(GROUP * voxels));
        groups.for_each(|(sections, kept)| into_blocks(sections, voxels, kept));
        Self { low: 0.0, step: super::source::UNIT, voxels, values }
    }

    /// Bytes that `sections` sections of `voxels` voxels take while they are counted.
    pub(super) fn memory(sections: usize, voxels: usize) -> u64 {
        2 * ((sections + GROUP * threads()) * voxels) as u64
    }

    /// Number of sections held.
    pub(super) fn len(&self) -> usize {
        self.values.len() / self.voxels
    }

    /// The values of a block, group by group: `[section of the group][voxel of the block]`.
    pub(super) fn block(&self, block: usize) -> impl Iterator<Item = &[u16]> {
        let first = block * CACHE_BLOCK;
        let voxels = CACHE_BLOCK.min(self.voxels - first);
        self.values.chunks(GROUP * self.voxels).map(move |group| {
            let sections = group.len() / self.voxels;
            &group[sections * first..][..sections * voxels]
        })
    }

    /// The values at some voxels alone.
    pub(super) fn at(&self, places: &[usize]) -> Self {
        let mut values = vec![0; self.len() * places.len()];
        let groups =
            values.par_chunks_mut(GROUP * places.len()).zip(self.values.par_chunks(GROUP * self.voxels));
        groups.for_each(|(kept, group)| {
            let sections = group.len() / self.voxels;
            let blocks = kept.chunks_mut(CACHE_BLOCK * sections).zip(places.chunks(CACHE_BLOCK));
            for (kept, places) in blocks {
                for (section, kept) in kept.chunks_exact_mut(places.len()).enumerate() {
                    for (kept, &place) in kept.iter_mut().zip(places) {
                        let first = place / CACHE_BLOCK * CACHE_BLOCK;
                        let voxels = CACHE_BLOCK.min(self.voxels - first);
                        *kept = group[sections * first + section * voxels + place - first];
                    }
                }
            }
        });
        Self { low: self.low, step: self.step, voxels: places.len(), values }
    }

    /// The values of some blocks, `[orientation][voxel]` into `values`.
    pub(super) fn read(&self, arch: Arch, blocks: Range<usize>, values: &mut Vec<f32>) {
        let first = blocks.start * CACHE_BLOCK;
        let count = (blocks.end * CACHE_BLOCK).min(self.voxels) - first;
        values.resize(self.len() * count, 0.0);
        for block in blocks {
            let from = block * CACHE_BLOCK - first;
            let voxels = CACHE_BLOCK.min(count - from);
            let sections = self.block(block).flat_map(|group| group.chunks_exact(voxels));
            for (values, section) in values.chunks_exact_mut(count).zip(sections) {
                vectorised!(arch, widen(section, self.low, self.step, &mut values[from..from + voxels]));
            }
        }
    }
}

/// From `[section][voxel]` to `[block][section][voxel of the block]`.
fn into_blocks(sections: &[u16], voxels: usize, kept: &mut [u16]) {
    let count = sections.len() / voxels;
    for (block, kept) in kept.chunks_mut(count * CACHE_BLOCK).enumerate() {
        let own = kept.len() / count;
        for (kept, section) in kept.chunks_exact_mut(own).zip(sections.chunks_exact(voxels)) {
            kept.copy_from_slice(&section[block * CACHE_BLOCK..][..own]);
        }
    }
}

#[inline(always)]
fn widen(kept: &[u16], low: f32, step: f32, values: &mut [f32]) {
    for (value, &kept) in values.iter_mut().zip(kept) {
        *value = low + f32::from(kept) * step;
    }
}

/// Bytes of a part's values: about what the outer caches hold. Smaller parts read every tool's tables more often,
/// larger ones spill to main memory; 12 MB cost 6 % and 400 MB 14 % of a fit of 300 sections.
const PART_BYTES: usize = 48 << 20;

/// Planes of a part.
fn planes_at_once([nx, ny, nz]: [usize; 3], sections: usize) -> usize {
    (PART_BYTES / (2 * sections * ny * nz).max(1)).clamp(1, nx)
}

/// Bytes at the peak of going through the parts of a grid of these dimensions, all or a side of a plan's; `None` where it has
/// but one.
pub(super) fn memory_by_parts(plan: &SectionPlan, dims: [usize; 3], sections: usize) -> Option<u64> {
    let [_, ny, nz] = dims;
    let part = planes_at_once(dims, sections) * ny * nz;
    plan.has_cursor().then(|| sections as u64 * plan.cursor_bytes() + CachedSections::memory(sections, part))
}

/// Where the fit stands.
pub(super) struct Parts<'a> {
    source: &'a Source<'a>,
    set: &'a [Orientation],
    by_planes: Option<(&'a SectionPlan, Vec<SectionCursor>)>,
    /// Planes of a part.
    planes: usize,
    /// The first plane of the next part.
    next: usize,
    kept: Option<CachedSections>,
    workspaces: CachedWorkspaces,
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
            workspaces: CachedWorkspaces::default(),
        };
        if let Source::Overlap(plan) = source
            && plan.has_cursor()
        {
            let cursors: Result<Vec<_>, SectionError> = set
                .par_iter()
                .map_init(SectionScratch::default, |scratch, orientation| {
                    control.check()?;
                    plan.cursor(orientation, scratch)
                })
                .collect();
            parts.planes = planes_at_once(plan.grid().dims, set.len());
            parts.by_planes = Some((*plan, cursors?));
        }
        Ok(parts)
    }

    /// The next part: its first voxel and its values. One unit of progress is one section over the whole grid.
    pub(super) fn next(
        &mut self,
        control: Control<'_>,
    ) -> Result<Option<(usize, &CachedSections)>, HarmonicError> {
        let [nx, ny, nz] = self.source.grid().dims;
        let planes = self.next..(self.next + self.planes).min(nx);
        if planes.is_empty() {
            return Ok(None);
        }
        self.next = planes.end;
        let kept = match &mut self.by_planes {
            None => self.kept.insert(CachedSections::count(self.source, self.set, control)?),
            Some((plan, cursors)) => {
                let room = self.planes * ny * nz;
                let count = self.set.len();
                let kept = self.kept.get_or_insert_with(|| CachedSections::new(self.source, count, room));
                let make = |cursor: &mut SectionCursor, scratch: &mut SourceScratch, values: &mut [u16]| {
                    scratch.advance(plan, cursor, planes.clone(), values)
                };
                kept.fill(planes.len() * ny * nz, cursors, &self.workspaces, control, make)?;
                let done = |planes: usize| (count * planes / nx) as u64;
                (control.progress)(done(planes.end) - done(planes.start));
                kept
            }
        };
        Ok(Some((planes.start * ny * nz, kept)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::UNIT;
    use super::*;

    #[test]
    fn blocks_hold_what_sections_held() {
        // Three blocks, the last one short; two groups, the last one of one section.
        let (voxels, count) = (600, 5);
        let value = |section: usize, voxel: usize| (section * 7919 + voxel * 104_729) as u16;
        let sections: Vec<u16> =
            (0..count).flat_map(|section| (0..voxels).map(move |voxel| value(section, voxel))).collect();
        let kept = CachedSections::of_overlaps(voxels, &sections);
        assert_eq!(kept.len(), count);
        let mut values = Vec::new();
        kept.read(Arch::new(), 1..3, &mut values);
        for (section, own) in values.chunks_exact(voxels - CACHE_BLOCK).enumerate() {
            for (place, &found) in own.iter().enumerate() {
                assert_eq!(found, f32::from(value(section, CACHE_BLOCK + place)) * UNIT);
            }
        }
        let places: Vec<usize> = (0..300).map(|i| i * 7 % voxels).collect();
        kept.at(&places).read(Arch::new(), 0..2, &mut values);
        for (section, own) in values.chunks_exact(places.len()).enumerate() {
            for (&place, &found) in places.iter().zip(own) {
                assert_eq!(found, f32::from(value(section, place)) * UNIT);
            }
        }
    }
}
