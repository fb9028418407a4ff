//! Overlaps counted on a device such as a GPU: its inputs for a plan and for a tool in an orientation, and values from its counts.
//!
//! It is the arithmetic of `run_length`, prepared for a device instead of computed here: at every voxel p of a box the difference of
//! two neighbouring overlaps is `overlap(p + 1) − overlap(p) = Σ O[p + covered] − Σ O[p + uncovered]`, where p + 1 is
//! the next voxel along the axis. Upwards the differences below a voxel sum up to its overlap, downwards those from the
//! voxel on to its negative. Where no difference is taken the overlap is zero.

use super::direct::spot_check;
use super::overlap::OverlapCounter;
use super::reading::LowestAround;
use super::run_boundaries::{Axis, Offsets, RunBoundaries};
use super::size::{CircularSize, QueryBox, VoxelBox};
use super::sweep::Sweep;
use super::{SectionError, SectionPlan};
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Tool, ToolVoxels};

/// Run boundaries, sorted by x, then y, then z.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoundaryOffsets {
    /// Offset of the first plane of `starts` along x, from the tip's voxel.
    pub first_plane: i64,
    /// `[planes + 1]`: where the ends of each plane begin in `offsets`.
    pub starts: Vec<u32>,
    /// Offsets from the tip's voxel, in voxels along x, y, z.
    pub offsets: Vec<[i64; 3]>,
}

/// Run-length differences of a tool in one orientation over a box of voxels, for a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ToolDifferences {
    /// Axis along which the tool is stepped: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Whether a difference leads to the next voxel, or back from it.
    pub upwards: bool,
    /// Voxels where differences are taken, in the obstacle's grid.
    pub steps: QueryBox,
    /// What a step covers.
    pub covered: BoundaryOffsets,
    /// What a step uncovers.
    pub uncovered: BoundaryOffsets,
}

/// Sizes that hold for a plan's whole query box, and thus for every part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DifferenceLimits {
    /// Dimensions of the obstacle's grid.
    pub obstacle: [usize; 3],
    /// The tool's reach in voxels.
    reach: i64,
    /// Voxels from a line (along y) or the first voxel of a line (along z) to the next so that, with nothing in the
    /// places beyond the obstacle, reading at any offset meets the line itself or nothing. Not needed along x.
    pub spacing: [usize; 3],
    /// Maximum number of differences along each axis.
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
    pub space: DifferenceLimits,
}

impl DifferenceLimits {
    fn new(obstacle: [usize; 3], query: QueryBox, reach: f64) -> Self {
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
    pub fn step(&self, tool: &ToolVoxels, query: &QueryBox, most: usize) -> Option<ToolDifferences> {
        let clipped = VoxelBox::of_tool(tool, &CircularSize::new(self.obstacle, *query, self.reach as f64));
        let nothing = || ToolDifferences {
            axis: 0,
            upwards: true,
            steps: QueryBox { lower: query.lower, dims: [0; 3] },
            covered: BoundaryOffsets::new(&Offsets::default()),
            uncovered: BoundaryOffsets::new(&Offsets::default()),
        };
        if clipped.dims[0] == 0 {
            return Some(nothing());
        }
        let sweep = Sweep::choose_within(&clipped, self.obstacle, query, most)?;
        if sweep.steps() == 0 {
            return Some(nothing());
        }
        let ranges = Axis::ALL.map(|axis| sweep.range(axis, query));
        let mut ends = RunBoundaries::default();
        ends.collect(&clipped, sweep.axis);
        Some(ToolDifferences {
            axis: sweep.axis as usize,
            upwards: sweep.upwards,
            steps: QueryBox {
                lower: ranges.clone().map(|range| range.start),
                dims: ranges.map(|range| (range.end - range.start) as usize),
            },
            covered: BoundaryOffsets::new(&ends.covered),
            uncovered: BoundaryOffsets::new(&ends.uncovered),
        })
    }
}

impl BoundaryOffsets {
    fn new(ends: &Offsets) -> Self {
        Self { first_plane: ends.lower[0], starts: ends.plane_starts(), offsets: ends.iter().collect() }
    }
}

impl SectionPlan {
    /// What a device needs to know to count overlaps of the whole tool over the query box or parts of it.
    #[must_use]
    pub fn layer(&self) -> SectionLayer<'_> {
        self.layer_of(&self.whole)
    }

    /// The same for the cuttable layer against shank and holder; `None` where the plan has none.
    #[must_use]
    pub fn cuttable_layer(&self) -> Option<SectionLayer<'_>> {
        self.noncutting.as_ref().map(|counter| self.layer_of(counter))
    }

    fn layer_of<'a>(&self, OverlapCounter { obstacle, tool, .. }: &'a OverlapCounter) -> SectionLayer<'a> {
        let space = DifferenceLimits::new(obstacle.grid.dims, self.query, tool.reach() / obstacle.grid.pitch);
        SectionLayer { obstacle, tool, space }
    }

    /// As [`SectionPlan::cmf`], from overlaps that were counted on a device, over [`SectionPlan::query_box`]: those of
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
        (rotated, mut counts): (&ToolVoxels, Vec<u32>),
        cuttable: Option<(&ToolVoxels, &[u32])>,
        cmf: &mut [f32],
    ) -> Result<(), SectionError> {
        assert_eq!(counts.len(), self.query.len(), "one count for each voxel of the query box");
        spot_check(&self.obstacle.forbidden, rotated, &self.query, &counts)?;
        if let (Some((rest, more)), Some(counter)) = (cuttable, &self.noncutting) {
            spot_check(&counter.obstacle, rest, &self.query, more)?;
            counts.iter_mut().zip(more).for_each(|(count, more)| *count += more);
        }
        self.read_values(orientation, rotated.count, (&counts, &mut LowestAround::default()), cmf);
        Ok(())
    }
}
