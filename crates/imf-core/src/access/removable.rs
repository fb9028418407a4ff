//! The removable volume: stock that the cutter covers at some free pose.
//!
//! For every orientation one correlation finds the free positions of the whole tool (its overlap with the obstacle,
//! tip on a voxel centre, is at most τ), and a second one, of those positions with the rotated cutter, the voxels
//! that it sweeps there; here the second is a dilation of bits, 64 at a time. Both visit only the positions from
//! which the cutter in that orientation meets the stock. The stock itself is not an obstacle: the result is what can
//! be removed at all, in whatever order.
//!
//! Tips on voxel centres alone leave a rim that gets thinner with the pitch. So there is also an upper bound, for
//! tips anywhere: this pitch does not decide what lies between both.

use thiserror::Error;

use super::dilation::{Dilation, meeting_positions};
use crate::control::Control;
use crate::grid::{Grid, GridError, HALF_DIAGONAL};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::section::{
    SectionError, SectionPlan, SectionScratch, ToolPoints, overlap_fraction, stream_orientations,
};
use crate::tool::{Assembly, Clearance, ElementKind, Tool, ToolError, ToolShape, ToolVoxels};

/// Why the removable volume cannot be found.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RemovableError {
    /// The tool has no cutter to remove anything with.
    #[error(
        "the tool '{0}' has no cutter: the removable volume needs a tool whose elements are named (a mesh has none)"
    )]
    NoCutter(String),
    /// The positions of the tool around the stock make too large a grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A section failed.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// The cutter does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
}

/// The cutter of a tool alone, in the tool's frame.
fn cutter_of(tool: &Tool) -> Result<Tool, RemovableError> {
    let cutters = tool.elements().iter().filter(|e| e.kind == ElementKind::Cutter);
    let cutters: Vec<_> = cutters.cloned().collect();
    if cutters.is_empty() {
        return Err(RemovableError::NoCutter(tool.name.clone()));
    }
    Ok(Tool { shape: ToolShape::Revolved(cutters), ..tool.with_tip_only() })
}

/// Bounds of the stock that a cutter removes: with its tip on voxel centres, and at most with its tip anywhere. Both
/// converge to the stock removed as the pitch falls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemovableStock {
    /// 1 for every voxel of the stock that the cutter covers at a free pose whose tip lies on a voxel's centre.
    pub covered: Vec<u8>,
    /// 1 for those, and for every voxel that it may cover at a free pose whose tip lies anywhere; every other voxel
    /// stays at any pitch.
    pub possible: Vec<u8>,
}

/// The grid of all positions of the tip from which the cutter can cover a voxel of `stock`; `tool` without clearance.
///
/// # Errors
/// A tool without a cutter, or a grid that is too large.
pub fn position_grid(stock: &Grid, tool: &Tool) -> Result<Grid, RemovableError> {
    Ok(around(stock, &cutter_of(tool)?)?)
}

/// With room for the cutter offset by [`HALF_DIAGONAL`].
fn around(stock: &Grid, cutter: &Tool) -> Result<Grid, GridError> {
    let reach = (cutter.reach() / stock.pitch).ceil().min(1e9) as i64 + 3;
    stock.padded([reach; 3], [reach; 3])
}

/// Bytes that [`removable`] takes for `tool`, which is `bare` or offset from it: known before anything is allocated.
///
/// # Errors
/// As [`position_grid`].
pub fn removable_memory_estimate(
    obstacle: &Grid,
    stock: &Grid,
    tool: &Tool,
    bare: &Tool,
    threads: usize,
) -> Result<u64, RemovableError> {
    let positions = position_grid(stock, bare)?;
    let plan = SectionPlan::memory_estimate_with_query(obstacle, &positions, &tool.with_tip_only(), threads);
    Ok(plan + threads as u64 * Dilation::memory(stock.dims, positions.dims) + 2 * stock.len() as u64)
}

/// What the tool's own cutter removes of `stock` at poses at which the overlap of the tool (perhaps offset
/// by a clearance) with the obstacle is at most `tau`. Lengths are in the grid's unit. Voxels of the stock that the obstacle
/// holds should be left out of it beforehand. Two units of progress are one orientation; the result does not depend on the
/// number of threads.
///
/// Upper bound: the stock covered by the cutter offset by half a voxel's diagonal, at poses where the tool eroded by
/// the same length is free. Every free pose is within that length of a voxel's centre.
///
/// # Errors
/// A tool without a cutter, a stock on other voxels than the obstacle, as [`SectionPlan::cmf`], or cancellation.
pub fn removable(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    stock: &Occupancy,
    orientations: &[Orientation],
    tau: f64,
    control: Control<'_>,
) -> Result<RemovableStock, RemovableError> {
    let (obstacle, assembly) = (obstacle.into(), assembly.into());
    // No tip is farther from the nearest voxel's centre.
    let (cutter, slack) = (cutter_of(assembly.tool())?, HALF_DIAGONAL * stock.grid.pitch);
    // A cutter too thin for the grid is refused before the work begins.
    ToolVoxels::new(&cutter, &Orientation::default(), stock.grid.pitch)?;
    let tool = Some(assembly.clone());
    let mut sweep = Sweep { obstacle, tool, cutter: &cutter, stock, orientations, tau, widest: None };
    let covered = sweep.run(control)?;
    let offset = offset(&cutter, slack)?;
    let mut left = stock.clone();
    left.solid.iter_mut().zip(&covered).for_each(|(left, &gone)| *left &= 1 - gone);
    let mut possible = covered.clone();
    // Only around what is left.
    let Some((low, high)) = left.extent() else {
        (control.progress)(orientations.len() as u64);
        return Ok(RemovableStock { covered, possible });
    };
    let before = low.map(|v| -(v as i64));
    let after = [0, 1, 2].map(|axis| high[axis] as i64 + 1 - stock.grid.dims[axis] as i64);
    let around = stock.grid.padded(before, after)?;
    if let Some(left) = left.on(&around) {
        let (tool, widest) = at_most(&assembly, tau, slack)?;
        (sweep.tool, sweep.widest, sweep.cutter, sweep.stock) = (tool, widest, &offset, &left);
        let more = Occupancy { grid: around, solid: sweep.run(control)? };
        let more = more.on(&stock.grid).ok_or(GridError::Dims(around.dims))?;
        possible.iter_mut().zip(&more.solid).for_each(|(all, &more)| *all |= more);
    }
    Ok(RemovableStock { covered, possible })
}

/// The cutter offset by a length.
fn offset(cutter: &Tool, slack: f64) -> Result<Tool, SectionError> {
    let by = Clearance { cutter: slack, ..Clearance::default() };
    cutter.with_clearance(&by).map_err(SectionError::Clearance)
}

/// What of a tool is free at a centre wherever the whole tool is at a pose within `slack` of it, and the tool of whose voxels `tau` is a
/// fraction there: at such a pose a tool holds no more than the tool offset as much at the centre.
fn at_most(
    assembly: &Assembly,
    tau: f64,
    slack: f64,
) -> Result<(Option<Assembly>, Option<Assembly>), SectionError> {
    let widest = (tau > 0.0).then(|| assembly.offset_further(slack)).transpose();
    Ok((assembly.eroded(slack), widest.map_err(SectionError::Clearance)?))
}

/// A cutter that visits every free position.
struct Sweep<'a> {
    obstacle: Obstacle,
    /// What must be free; `None` where nothing of it is left, and everything is.
    tool: Option<Assembly>,
    cutter: &'a Tool,
    stock: &'a Occupancy,
    orientations: &'a [Orientation],
    tau: f64,
    /// The tool of whose voxels `tau` is a fraction, where it is not the tool itself.
    widest: Option<Assembly>,
}

/// The stock that a cutter removes from one orientation: indices of voxels, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RemovedVoxels {
    /// As of [`RemovableStock::covered`].
    pub covered: Vec<u32>,
    /// What may be covered beside them, as of [`RemovableStock::possible`].
    pub undecided: Vec<u32>,
}

/// The voxels of `stock`, which may be a sample of all, that [`removable`] finds, by orientation. Two units of progress are one
/// orientation.
///
/// # Errors
/// As [`removable`].
pub fn removable_by_orientation(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    stock: &Occupancy,
    orientations: &[Orientation],
    tau: f64,
    control: Control<'_>,
) -> Result<Vec<RemovedVoxels>, RemovableError> {
    let (obstacle, assembly) = (obstacle.into(), assembly.into());
    let (cutter, slack) = (cutter_of(assembly.tool())?, HALF_DIAGONAL * stock.grid.pitch);
    let (offset, (tool, widest)) = (offset(&cutter, slack)?, at_most(&assembly, tau, slack)?);
    let whole = Some(assembly);
    let mut sweep = Sweep { obstacle, tool: whole, cutter: &cutter, stock, orientations, tau, widest: None };
    let certain = sweep.by_orientation(control)?;
    (sweep.tool, sweep.widest, sweep.cutter) = (tool, widest, &offset);
    let possible = sweep.by_orientation(control)?;
    let both = certain.into_iter().zip(possible).map(|(covered, mut undecided)| {
        undecided.retain(|voxel| covered.binary_search(voxel).is_err());
        RemovedVoxels { covered, undecided }
    });
    Ok(both.collect())
}

impl Sweep<'_> {
    /// 1 for every voxel of the stock that is covered.
    fn run(&self, control: Control<'_>) -> Result<Vec<u8>, RemovableError> {
        let mut whole = Dilation::new(&self.stock.grid);
        let parts = self.each(control, || (), |_, _, _| ())?;
        parts.iter().for_each(|(_, part)| whole.merge(part));
        let mut covered = whole.covered();
        covered.iter_mut().zip(&self.stock.solid).for_each(|(all, &there)| *all &= there);
        Ok(covered)
    }

    /// By orientation the voxels of the stock that are covered.
    fn by_orientation(&self, control: Control<'_>) -> Result<Vec<Vec<u32>>, RemovableError> {
        let stock = self.stock;
        let parts = self.each(control, Vec::new, |found, index, dilation| {
            let swept = std::mem::replace(dilation, Dilation::new(&stock.grid)).covered();
            let covered = |&voxel: &usize| swept[voxel] & stock.solid[voxel] == 1;
            let covered: Vec<u32> = (0..swept.len()).filter(covered).map(|voxel| voxel as u32).collect();
            found.push((index, covered));
        })?;
        let mut all: Vec<(usize, Vec<u32>)> = parts.into_iter().flat_map(|(found, _)| found).collect();
        all.sort_by_key(|(index, _)| *index);
        Ok(all.into_iter().map(|(_, covered)| covered).collect())
    }

    /// Shows after every orientation what each thread has covered.
    fn each<V: Send>(
        &self,
        control: Control<'_>,
        of_thread: impl Fn() -> V + Sync,
        show: impl Fn(&mut V, usize, &mut Dilation) + Sync,
    ) -> Result<Vec<(V, Dilation)>, RemovableError> {
        let Self { obstacle, tool, cutter, stock, orientations, .. } = self;
        let positions = around(&stock.grid, cutter)?;
        let plan = |tool| if_thick(SectionPlan::with_query(obstacle, tool, ToolPoints::Tip, &positions));
        let plan = tool.as_ref().map(plan).transpose()?.flatten();
        let start = || (SectionScratch::default(), Dilation::new(&stock.grid), of_thread());
        let visit = |(scratch, dilation, own): &mut (SectionScratch, Dilation, V), index: usize| {
            let orientation = &orientations[index];
            let body = ToolVoxels::new(cutter, orientation, positions.pitch)?;
            let meeting = meeting_positions(&body, &stock.grid)?;
            let counted = plan.as_ref().map(|plan| if_thick(plan.counts_in(orientation, &meeting, scratch)));
            match counted.transpose()?.flatten() {
                Some((own, counts)) => {
                    if let Some(most) = most_free(self.whole(orientation)?.unwrap_or(own), self.tau) {
                        dilation.cover(&body, counts, most);
                    }
                }
                None => dilation.cover(&body, &vec![0; meeting.len()], 0),
            }
            show(own, index, dilation);
            Ok::<(), RemovableError>(())
        };
        let parts = stream_orientations(orientations.len(), control, start, visit)?;
        Ok(parts.into_iter().map(|(_, dilation, own)| (own, dilation)).collect())
    }

    fn whole(&self, orientation: &Orientation) -> Result<Option<u32>, ToolError> {
        let rotated = |widest: &Assembly| ToolVoxels::new(widest.whole(), orientation, self.stock.grid.pitch);
        Ok(self.widest.as_ref().map(rotated).transpose()?.map(|widest| widest.count))
    }
}

/// None of a tool so thin that it holds no voxel's centre: there is nothing that it could hit.
fn if_thick<T>(found: Result<T, SectionError>) -> Result<Option<T>, SectionError> {
    match found {
        Err(SectionError::Tool(ToolError::TooSmall { .. })) => Ok(None),
        found => found.map(Some),
    }
}

/// The largest count whose collision measure, as sections give it, is at most `tau`; none where even 0 is too much.
fn most_free(whole: u32, tau: f64) -> Option<u32> {
    let free = |count: u32| f64::from(overlap_fraction(count, whole)) <= tau;
    // The measure grows with the count.
    let (mut low, mut high) = (0, u64::from(whole) + 1);
    while low < high {
        let middle = low.midpoint(high);
        if free(middle as u32) { low = middle + 1 } else { high = middle }
    }
    low.checked_sub(1).map(|most| most as u32)
}

#[cfg(test)]
mod tests;
