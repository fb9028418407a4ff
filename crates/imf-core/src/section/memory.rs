//! What a plan of sections takes, told before it is made.

use super::bit_adder::TILE_BITS;
use super::bit_obstacle::BitObstacle;
use super::clipped::ClippedTool;
use super::counter::Estimate;
use super::sweep::{Order, Sweep};
use super::{SLANT, SectionPlan};
use crate::grid::Grid;
use crate::tool::{RotatedTool, Tool};

impl SectionPlan {
    /// Bytes that a plan with this many threads will take, known before it is made.
    #[must_use]
    pub fn memory_estimate(grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        Self::memory_estimate_with_query(grid, grid, tool, threads)
    }

    /// The same for a query grid of its own ([`SectionPlan::with_query`]).
    #[must_use]
    pub fn memory_estimate_with_query(grid: &Grid, query_grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        let offset = grid.offset_of(query_grid).unwrap_or_default();
        let (query, size) = Self::sizes(grid, offset, query_grid.dims, tool);
        let voxels = query.len() as u64;
        let threads = threads as u64;
        let rotated = (2.0 * tool.reach() / grid.pitch + 3.0).powi(3).min(1e18) as u64;
        let common = 2 * grid.len() as u64 + threads * (2 * rotated + 16 * voxels);
        // A tool of absurd size is left to the plan, which refuses it.
        let slanted = (rotated < 1 << 30).then(|| RotatedTool::new(tool, &SLANT, grid.pitch).ok()).flatten();
        let Some(rotated) = slanted else { return common };
        let clipped = ClippedTool::new(&rotated, &size);
        // Half of the voxels solid is more than most parts have.
        let single = size.error_bound::<f32>(grid.len() / 2, rotated.count as usize) < 0.5;
        let arch = pulp::Arch::new();
        let sweep = Sweep::choose(&clipped, grid.dims, size.line_bits(), &query, Order::Any);
        if Estimate::new(arch, grid.dims, &query, &size, &clipped, &sweep, single).prefers_run_ends() {
            return common + BitObstacle::memory(grid.dims, &size, TILE_BITS);
        }
        let complex = if single { 8 } else { 16 };
        let [nx, ny, nz] = size.n.map(|n| n as u64);
        let lines = (clipped.dims[0] * clipped.dims[1] + query.dims[0] * query.dims[1]) as u64;
        common + complex * (nz / 2 + 8) * (nx * ny + threads * lines)
    }

    /// Voxels of the query box: the query grid, grown by what sharp points reach.
    pub(super) fn query_voxels(grid: &Grid, query_grid: &Grid, tool: &Tool) -> u64 {
        let offset = grid.offset_of(query_grid).unwrap_or_default();
        Self::sizes(grid, offset, query_grid.dims, tool).0.len() as u64
    }
}
