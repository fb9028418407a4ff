//! A rotated tool prepared for a device that counts by differences: its run ends along the best axis, and the box of
//! voxels where the tool is stepped.
//!
//! It is the same arithmetic as `surface`, handed out instead of done: at every voxel p of the box the difference of
//! two neighbouring overlaps is `overlap(p + 1) − overlap(p) = Σ O[p + covered] − Σ O[p + uncovered]`, where p + 1 is
//! the next voxel along the axis. Upwards the differences below a voxel sum up to its overlap, downwards those from the
//! voxel on to its negative. Where no difference is taken the overlap is zero.

use super::clipped::ClippedTool;
use super::run_ends::{Axis, Offsets, RunEnds};
use super::size::{CircularSize, QueryBox};
use super::sweep::Sweep;
use crate::occupancy::Occupancy;
use crate::tool::{RotatedTool, Tool};

/// Run ends, sorted by x, then y, then z.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepEnds {
    /// Offset of the first plane of `starts` along x, from the tip's voxel.
    pub first_plane: i64,
    /// `[planes + 1]`: where the ends of each plane begin in `offsets`.
    pub starts: Vec<u32>,
    /// Offsets from the tip's voxel, in voxels along x, y, z.
    pub offsets: Vec<[i64; 3]>,
}

/// What a device needs of a tool in one orientation to count its overlaps over a box of voxels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SteppedTool {
    /// Axis along which the tool is stepped: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Whether a difference leads to the next voxel, or back from it.
    pub upwards: bool,
    /// Voxels where differences are taken, in the obstacle's grid.
    pub steps: QueryBox,
    /// What a step covers.
    pub covered: StepEnds,
    /// What a step uncovers.
    pub uncovered: StepEnds,
}

/// Sizes that hold for a plan's whole query box, and thus for every part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepSpace {
    /// Dimensions of the obstacle's grid.
    pub obstacle: [usize; 3],
    /// The tool's reach in whole voxels.
    reach: i64,
    /// Voxels from a line (along y) or the first voxel of a line (along z) to the next so that, with nothing in the
    /// places beyond the obstacle, reading at any offset meets the line itself or nothing. Not needed along x.
    pub spacing: [usize; 3],
    /// At most so many differences are taken along each axis.
    pub most_steps: [usize; 3],
}

/// What a device needs to know to count overlaps of a tool with an obstacle over a plan's query box or parts of it.
#[derive(Clone, Copy, Debug)]
pub struct SectionLayer<'a> {
    /// The obstacle.
    pub obstacle: &'a Occupancy,
    /// What must stay out of it, in the grid's unit.
    pub tool: &'a Tool,
    /// Sizes.
    pub space: StepSpace,
}

impl StepSpace {
    pub(super) fn new(obstacle: [usize; 3], query: QueryBox, reach: f64) -> Self {
        let size = CircularSize::new(obstacle, query, reach);
        // Along the axis of the steps the tool is tried from where it does not meet the obstacle yet.
        let spacing = [0, 1, 2].map(|a| {
            let tool = (size.last[a] - size.first[a] + 1).max(0) as usize;
            size.needed[a].max(obstacle[a] + tool)
        });
        Self { obstacle, reach: reach.min(1e9).ceil() as i64, spacing, most_steps: size.needed }
    }

    /// Prepares a tool for `query`, the plan's query box or a part of it, by the cheapest axis along which there are at
    /// most `most` differences. Nothing if there is none.
    #[must_use]
    pub fn step(&self, tool: &RotatedTool, query: &QueryBox, most: usize) -> Option<SteppedTool> {
        let size = CircularSize::new(self.obstacle, *query, self.reach as f64);
        let clipped = ClippedTool::new(tool, &size);
        let nothing = QueryBox { lower: query.lower, dims: [0; 3] };
        let none = StepEnds { starts: vec![0], ..StepEnds::default() };
        let mut stepped =
            SteppedTool { axis: 0, upwards: true, steps: nothing, covered: none.clone(), uncovered: none };
        if clipped.dims[0] == 0 {
            return Some(stepped);
        }
        let sweep = Sweep::choose_within(&clipped, self.obstacle, query, most)?;
        if sweep.steps() == 0 {
            return Some(stepped);
        }
        let ranges = Axis::ALL.map(|axis| sweep.range(axis, query));
        stepped.axis = sweep.axis.index();
        stepped.upwards = sweep.upwards;
        stepped.steps = QueryBox {
            lower: ranges.clone().map(|range| range.start),
            dims: ranges.map(|range| (range.end - range.start) as usize),
        };
        let mut ends = RunEnds::default();
        ends.collect(&clipped, sweep.axis);
        stepped.covered = StepEnds::new(&ends.covered);
        stepped.uncovered = StepEnds::new(&ends.uncovered);
        Some(stepped)
    }
}

impl StepEnds {
    fn new(offsets: &Offsets) -> Self {
        let table = &offsets.table;
        let [planes, lines] = table.dims;
        let mut ends = Self { first_plane: table.lower[0], ..Self::default() };
        ends.offsets.reserve(offsets.z.len());
        for x in 0..planes {
            ends.starts.push(ends.offsets.len() as u32);
            for y in 0..lines {
                let at = [table.lower[0] + x as i64, table.lower[1] + y as i64];
                let line = &offsets.z[table.range(x, y, y + 1)];
                ends.offsets.extend(line.iter().map(|&z| [at[0], at[1], i64::from(z)]));
            }
        }
        ends.starts.push(ends.offsets.len() as u32);
        ends
    }
}
