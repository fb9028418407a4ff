//! Exact sections of the collision measure field: one orientation, every voxel of the query grid.
//!
//! `overlap(x) = Σ_o O[x + o]·RT[o] / count(RT)`: a correlation of two sets of voxels. `direct` is its definition;
//! `overlap` computes the same whole numbers by real FFTs or by run-length difference counting, by estimate. The
//! collision measure is the minimum overlap over the tool's sharp points, `CMF(x) = min_k overlap(x − R k)`, read by trilinear means of the whole-number sections
//! where `R k` is not a whole number of voxels.

mod bit_obstacle;
mod bit_sliced;
mod cursor;
mod depth;
#[doc(hidden)]
pub mod device;
mod direct;
mod elements;
mod fft;
mod overlap;
mod reading;
mod run_boundaries;
mod run_length;
mod size;
mod stream;
mod sweep;
#[cfg(test)]
pub(crate) mod test_shapes;

pub use cursor::SectionCursor;
pub use depth::{DEPTH_CAP, DepthPlan, DepthScratch, Quantity};
use direct::minimum_mean;
pub use direct::{direct_cmf, direct_count, direct_element_measures};
pub use elements::{ElementMeasures, ElementPlans, ElementScratch, elements_at_best};
pub use overlap::Method;
use overlap::cuttable_and_noncutting;
pub use reading::overlap_fraction;
pub use size::QueryBox;
pub(crate) use stream::stream_orientations;
pub use stream::{Imf, imf, sections, stream_depths, stream_sections};

use glam::DVec3;
use thiserror::Error;

use crate::control::Cancelled;
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::orientation::Orientation;
use crate::scene::Scene;
use crate::tool::{Assembly, ClearanceError, Tool, ToolError, ToolVoxels};

use overlap::OverlapCounter;
use reading::LowestAround;

/// Why a section cannot be computed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SectionError {
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A clearance that is not a length.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// A direct sum disagreed with the convolution: a defect of this program or of the machine.
    #[error(
        "the convolution gave {found} at voxel {voxel:?}, a direct sum {expected}: please report this; \
         the machine's memory may be faulty"
    )]
    SpotCheck {
        /// The voxel.
        voxel: [i64; 3],
        /// What the convolution gave.
        found: u32,
        /// What the direct sum gave.
        expected: u32,
    },
    /// Neither method counts exactly: transforms round, and run-length counting addresses 2 GiB of the obstacle's bits.
    #[error(
        "the grid has too many voxels for its overlaps to be counted exactly: voxelise with a larger pitch, or cut \
         away what the tool cannot reach"
    )]
    TooManyVoxels,
    /// The voxels of the query grid are not those of the obstacle's grid.
    #[error(
        "the query grid (origin {query}, pitch {query_pitch}) does not lie on the voxels of the obstacle's grid \
         (origin {obstacle}, pitch {pitch}): both need one pitch and a distance of whole voxels"
    )]
    QueryGrid {
        /// Origin of the query grid.
        query: DVec3,
        /// Pitch of the query grid.
        query_pitch: f64,
        /// Origin of the obstacle's grid.
        obstacle: DVec3,
        /// Pitch of the obstacle's grid.
        pitch: f64,
    },
    /// The caller's [`Control`](crate::control::Control) asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

/// The points of the tool over which a section takes the minimum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToolPoints {
    /// The tip alone: the overlap, which fields are made of.
    Tip,
    /// All sharp points: the collision measure.
    SharpPoints,
}

/// What is computed once for an obstacle and a tool, and used for any number of orientations.
///
/// Plan once, run many: sections take `&self` and a [`SectionScratch`] of the calling thread.
pub struct SectionPlan {
    obstacle: Obstacle,
    assembly: Assembly,
    sharp_points: Vec<DVec3>,
    grid: Grid,
    /// Voxel (0, 0, 0) of `grid` in the obstacle's grid.
    offset: [i64; 3],
    query: QueryBox,
    /// The whole tool, sharp where the minimum is taken, and what is forbidden.
    whole: OverlapCounter,
    /// Shank and holder, and what the cutter may enter.
    noncutting: Option<OverlapCounter>,
}

/// Working memory of one thread; buffers grow at the first use and are reused.
#[derive(Default)]
pub struct SectionScratch {
    counter: overlap::Scratch,
    counts: Vec<u32>,
    more: Vec<u32>,
    around: LowestAround,
}

/// Voxels from the obstacle's first to that of a query grid.
fn offset_of_query(obstacle: &Grid, query: &Grid) -> Result<[i64; 3], SectionError> {
    obstacle.offset_of(query).ok_or(SectionError::QueryGrid {
        query: query.origin,
        query_pitch: query.pitch,
        obstacle: obstacle.origin,
        pitch: obstacle.pitch,
    })
}

/// The voxels where overlaps are counted: those of the query grid, and as many around them as sharp points off the tip reach.
fn query_box(obstacle: &Grid, query: &Grid, sharp_points: &[DVec3]) -> Result<QueryBox, SectionError> {
    let farthest = sharp_points.iter().map(|k| k.length()).fold(0.0, f64::max);
    let padding = if farthest > 0.0 { (farthest / obstacle.pitch).ceil() as i64 + 1 } else { 0 };
    Ok(QueryBox::around(offset_of_query(obstacle, query)?, query.dims, padding))
}

impl SectionPlan {
    /// Plans sections of a tool around an obstacle at every voxel of the obstacle's grid. The tool's lengths must be
    /// in the grid's unit ([`Tool::in_unit`]).
    ///
    /// # Errors
    /// A tool without volume.
    pub fn new(
        obstacle: impl Into<Obstacle>,
        assembly: impl Into<Assembly>,
        at: ToolPoints,
    ) -> Result<Self, SectionError> {
        let obstacle = obstacle.into();
        let grid = *obstacle.grid();
        Self::with_query(obstacle, assembly, at, &grid)
    }

    /// Plans sections of a scene, with its clearance, and with contact where the scene has it.
    ///
    /// # Errors
    /// A tool without volume.
    pub fn of_scene(scene: &Scene, at: ToolPoints) -> Result<Self, SectionError> {
        Self::new(scene, scene.record.assembly()?, at)
    }

    /// Plans sections at every voxel of `query_grid`, which lies on the obstacle's voxels and may be a part of its grid,
    /// stick out of it or stand beside it. The obstacle counts as a whole, space outside its grid is empty.
    ///
    /// # Errors
    /// A tool without volume, or a query grid with other voxels than the obstacle's.
    pub fn with_query(
        obstacle: impl Into<Obstacle>,
        assembly: impl Into<Assembly>,
        at: ToolPoints,
        query_grid: &Grid,
    ) -> Result<Self, SectionError> {
        let (obstacle, assembly) = (obstacle.into(), assembly.into());
        let tool = match at {
            ToolPoints::Tip => assembly.whole().with_tip_only(),
            ToolPoints::SharpPoints => assembly.whole().clone(),
        };
        // As it was given: what is offset or eroded need not stand on one another.
        assembly.tool().check()?;
        let own = *obstacle.grid();
        let sharp_points = tool.sharp_point_positions(own.pitch);
        let query = query_box(&own, query_grid, &sharp_points)?;
        let whole = OverlapCounter::new(obstacle.forbidden.clone(), tool, query);
        // A tool too large or too small is refused now rather than at the first section.
        whole.voxels(&Orientation::default())?;
        let noncutting = cuttable_and_noncutting(&obstacle, &assembly)
            .map(|(voxels, tool)| OverlapCounter::new(voxels.clone(), tool.clone(), query));
        Ok(Self {
            offset: offset_of_query(&own, query_grid)?,
            sharp_points,
            grid: *query_grid,
            query,
            whole,
            noncutting,
            obstacle,
            assembly,
        })
    }

    /// The same plan with sections by this method alone.
    #[must_use]
    pub fn with_method(mut self, method: Method) -> Self {
        let counters = [Some(&mut self.whole), self.noncutting.as_mut()];
        counters.into_iter().flatten().for_each(|counter| counter.method = method);
        self
    }

    /// The same sections at the voxels of another grid, as [`SectionPlan::with_query`].
    ///
    /// # Errors
    /// A grid with other voxels than the obstacle's.
    pub fn over(&self, query_grid: &Grid) -> Result<Self, SectionError> {
        let at = if self.tip_alone() { ToolPoints::Tip } else { ToolPoints::SharpPoints };
        let plan = Self::with_query(&self.obstacle, &self.assembly, at, query_grid)?;
        Ok(plan.with_method(self.whole.method))
    }

    /// Bytes that a plan with this many threads will take, known before it is made.
    #[must_use]
    pub fn memory_estimate(grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        Self::memory_estimate_with_query(grid, grid, tool, threads)
    }

    /// The same for a query grid of its own ([`SectionPlan::with_query`]).
    #[must_use]
    pub fn memory_estimate_with_query(grid: &Grid, query_grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        let query = query_box(grid, query_grid, &tool.sharp_point_positions(grid.pitch)).unwrap_or_default();
        let threads = threads as u64;
        let whole = (2.0 * tool.reach() / grid.pitch + 3.0).powi(3).min(1e18) as u64;
        let counting = overlap::memory(grid, &query, tool, threads);
        // Of a mesh all is voxelised before the rest is left out.
        let rotated =
            if tool.mesh().is_some() { whole } else { overlap::kept_voxels(grid, query, tool).min(whole) };
        2 * grid.len() as u64 + threads * (2 * rotated + 24 * query.len() as u64) + counting
    }

    /// The grid whose voxels a section covers.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What the tool must stay out of.
    #[must_use]
    pub fn obstacle(&self) -> &Obstacle {
        &self.obstacle
    }

    /// The tool as it is counted, in the grid's unit.
    #[must_use]
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// The whole tool, sharp where the minimum is taken.
    #[must_use]
    pub fn tool(&self) -> &Tool {
        &self.whole.tool
    }

    /// True where there is a layer that the cutter may enter and something that may not: then forbidden voxels in the whole tool
    /// alone do not make up the overlap.
    #[must_use]
    pub fn has_layer(&self) -> bool {
        self.noncutting.is_some()
    }

    /// Human-readable, one line: how sections are computed.
    #[must_use]
    pub fn describe(&self) -> String {
        let estimate = self.whole.usual_estimate(&self.query);
        estimate.map_or_else(String::new, |estimate| self.whole.describe(estimate))
    }

    /// The collision measure field of one orientation, C-ordered into `cmf`, in [0, 1].
    ///
    /// # Errors
    /// A tool that does not fit the grid, or a failed spot check.
    ///
    /// # Panics
    /// If `cmf` has not the grid's length.
    pub fn cmf(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
        cmf: &mut [f32],
    ) -> Result<(), SectionError> {
        let normaliser = self.box_counts(orientation, &self.query, scratch)?;
        self.read_values(orientation, normaliser, (&scratch.counts, &mut scratch.around), cmf);
        Ok(())
    }

    /// The collision measure at a voxel of the grid by direct sums: the definition, for the plan's tool rotated into the
    /// orientation. With a layer that the cutter may enter it is the sum of the elements' measures.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn direct(
        &self,
        orientation: &Orientation,
        rotated: &ToolVoxels,
        voxel: [usize; 3],
    ) -> Result<f64, ToolError> {
        let at = [0, 1, 2].map(|axis| voxel[axis] as i64 + self.offset[axis]);
        if self.has_layer() {
            let elements =
                direct::element_measures(&self.obstacle, &self.assembly, self.tool(), orientation, at)?;
            return Ok(elements.iter().map(|&(_, measure)| measure).sum());
        }
        let at = DVec3::from_array(at.map(|v| v as f64));
        Ok(minimum_mean(&self.obstacle.forbidden, rotated, &self.sharp_points, orientation, at))
    }

    /// The voxels where overlaps are counted: those of the grid, and where points off the tip are sharp as many
    /// around them as these points reach.
    #[must_use]
    pub fn query_box(&self) -> QueryBox {
        self.query
    }

    /// True where the tip alone is sharp: then a section's values are fractions of the counts over its own grid.
    #[must_use]
    pub fn tip_alone(&self) -> bool {
        self.sharp_points == [DVec3::ZERO]
    }

    /// Voxels shared by obstacle and rotated tool with the tip at every voxel of `window`: the plan's grid or a box within
    /// it, which may be another one for every orientation. Whole numbers, equal to [`direct_count`]. Returns the rotated
    /// tool's own count and the counts, C-ordered over the window, in the scratch.
    ///
    /// # Errors
    /// A tool that does not fit the grid, a window on other voxels than the obstacle's, or a failed spot check.
    ///
    /// # Panics
    /// If the window sticks out of the plan's grid.
    pub fn counts_in<'s>(
        &self,
        orientation: &Orientation,
        window: &Grid,
        scratch: &'s mut SectionScratch,
    ) -> Result<(u32, &'s [u32]), SectionError> {
        let offset = offset_of_query(self.obstacle.grid(), window)?;
        let query = QueryBox::around(offset, window.dims, 0);
        assert!(self.query.contains(&query), "a window within the plan's grid");
        let rotated = self.box_counts(orientation, &query, scratch)?;
        Ok((rotated, &scratch.counts))
    }

    /// Counts over a box within the plan's into `scratch.counts`; returns the rotated tool's own count.
    fn box_counts(
        &self,
        orientation: &Orientation,
        query: &QueryBox,
        scratch: &mut SectionScratch,
    ) -> Result<u32, SectionError> {
        let rotated = self.rotated(orientation)?;
        let SectionScratch { counter: scratch, counts, more, .. } = scratch;
        counts.resize(query.len(), 0);
        self.whole.count(&rotated, query, scratch, counts)?;
        if let Some(counter) = &self.noncutting {
            counter.add(orientation, query, scratch, (counts, more))?;
        }
        Ok(rotated.count)
    }

    /// What of the whole tool can matter in an orientation, with the count of all.
    fn rotated(&self, orientation: &Orientation) -> Result<ToolVoxels, ToolError> {
        self.whole.voxels(orientation)
    }
}

#[cfg(test)]
mod tests;
