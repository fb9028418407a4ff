//! Along which axis, and in which direction, the tool is stepped through the obstacle.

use std::ops::Range;

use super::bit_sliced::TILE_BITS;
use super::run_boundaries::{Axis, RunBoundaries};
use super::size::{QueryBox, VoxelBox};

/// In which order the differences are summed up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sweep {
    pub(super) axis: Axis,
    pub(super) upwards: bool,
    /// Voxels along the axis where a difference to the next one is taken.
    lower: i64,
    upper: i64,
    /// Run boundaries along the axis.
    ends: usize,
}

/// The order in which a sweep may visit the planes along x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    Any,
    /// From the lowest plane on, so that it can stop between two planes: under one percent dearer than the best, on average
    /// over all directions.
    PlanesUpwards,
}

impl Sweep {
    /// The cheapest sweep of a tool with these run boundaries.
    pub(super) fn choose(
        tool: &VoxelBox<'_>,
        obstacle: [usize; 3],
        line_bits: i64,
        query: &QueryBox,
        order: Order,
    ) -> Self {
        // Along z the zeros between two lines must hold the tool.
        let fits =
            |sweep: &Self| sweep.axis != Axis::Z || obstacle[2] as i64 + tool.dims[2] as i64 <= line_bits;
        Self::cheapest(tool, obstacle, query, order, fits).unwrap_or(Self {
            axis: Axis::X,
            upwards: true,
            lower: 0,
            upper: 0,
            ends: 0,
        })
    }

    /// The cheapest sweep that takes at most `most` differences over the query box; none where every one takes more.
    pub(super) fn choose_within(
        tool: &VoxelBox<'_>,
        obstacle: [usize; 3],
        query: &QueryBox,
        most: usize,
    ) -> Option<Self> {
        Self::cheapest(tool, obstacle, query, Order::Any, |sweep| {
            let lengths = Axis::ALL.map(|axis| sweep.range(axis, query)).map(|range| range.end - range.start);
            lengths.into_iter().try_fold(1i64, i64::checked_mul).is_some_and(|n| n as u64 <= most as u64)
        })
    }

    fn cheapest(
        tool: &VoxelBox<'_>,
        obstacle: [usize; 3],
        query: &QueryBox,
        order: Order,
        fits: impl Fn(&Self) -> bool,
    ) -> Option<Self> {
        let ends = RunBoundaries::count(tool);
        let upper = tool.upper();
        let sweeps = Axis::ALL.into_iter().filter_map(|axis| {
            let a = axis as usize;
            let n = obstacle[a] as i64;
            let Range { start: q0, end: q1 } = query.range(a);
            let down = Self { axis, upwards: false, lower: q0, upper: n - tool.lower[a], ends: ends[a] };
            let up = Self { axis, upwards: true, lower: -upper[a] - 1, upper: q1 - 1, ends: ends[a] };
            let upwards = order == Order::PlanesUpwards && axis == Axis::X;
            let sweep = if down.steps() <= up.steps() && !upwards { down } else { up };
            let cost = ends[a] as f64 * sweep.steps() as f64 / query.dims[a] as f64;
            fits(&sweep).then_some((cost, sweep))
        });
        sweeps.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, sweep)| sweep)
    }

    /// How many differences are taken along the axis.
    pub(super) fn steps(&self) -> i64 {
        (self.upper - self.lower).max(0)
    }

    /// The voxels where differences are taken along `axis`: the sweep's own along its axis, else the query's.
    pub(super) fn range(&self, axis: Axis, query: &QueryBox) -> Range<i64> {
        if axis == self.axis { self.lower..self.upper.max(self.lower) } else { query.range(axis as usize) }
    }

    /// Tile-wide loads that the sweep makes, by estimate: run boundaries spread evenly over the tool's box, lines of the
    /// obstacle nowhere empty.
    pub(super) fn loads(
        &self,
        tool: &VoxelBox<'_>,
        obstacle: [usize; 3],
        line_bits: i64,
        query: &QueryBox,
    ) -> f64 {
        let ranges = Axis::ALL.map(|axis| self.range(axis, query));
        // Mean fraction of the tool's offsets that meet the obstacle's box, times the voxels where they are tried.
        let tried = |a: usize| {
            let met: i64 = (tool.lower[a]..=tool.upper()[a])
                .map(|o| (ranges[a].end.min(obstacle[a] as i64 - o) - ranges[a].start.max(-o)).max(0))
                .sum();
            met as f64 / tool.dims[a].max(1) as f64
        };
        self.ends as f64 * tried(0) * tried(1) * line_bits as f64 / TILE_BITS as f64
    }
}
