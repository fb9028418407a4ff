//! The maximal removable volume: stock that the cutter covers at some free pose.
//!
//! For every orientation one correlation finds the free positions of the whole tool (its overlap with the obstacle, tip
//! on a voxel centre, is at most τ), and a second one, of those positions with the rotated cutter, the voxels that it
//! sweeps there; here the second is a dilation of bits, 64 at a time. Both look only at the positions from which the cutter
//! in that orientation meets the stock. The stock itself is no obstacle: the question is what can be removed at all, in
//! whatever order.

use thiserror::Error;

use super::dilation::{Dilation, meeting_positions};
use crate::control::Control;
use crate::grid::{Grid, GridError};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::section::{At, SectionError, SectionPlan, SectionScratch, share, stream_orientations};
use crate::tool::{Assembly, ElementKind, RotatedTool, Tool, ToolError, ToolShape};

/// Why the removable volume cannot be found.
#[derive(Debug, Error)]
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

/// The cutter of a tool alone, in the tool's frame; `None` for a mesh, or where no element is a cutter.
#[must_use]
pub fn cutter_of(tool: &Tool) -> Option<Tool> {
    let ToolShape::Revolved(elements) = &tool.shape else { return None };
    let cutters: Vec<_> = elements.iter().filter(|e| e.kind == ElementKind::Cutter).cloned().collect();
    (!cutters.is_empty()).then(|| Tool { shape: ToolShape::Revolved(cutters), ..tool.with_tip_only() })
}

/// The grid of all positions of the tip from which the cutter can cover a voxel of `stock`; `tool` as it is, not offset.
///
/// # Errors
/// A tool without a cutter, or a grid that is too large.
pub fn position_grid(stock: &Grid, tool: &Tool) -> Result<Grid, RemovableError> {
    let cutter = cutter_of(tool).ok_or_else(|| RemovableError::NoCutter(tool.name.clone()))?;
    Ok(around(stock, &cutter)?)
}

fn around(stock: &Grid, cutter: &Tool) -> Result<Grid, GridError> {
    let reach = (cutter.reach() / stock.pitch).ceil().min(1e9) as i64 + 1;
    stock.grown([reach; 3], [reach; 3])
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
    Ok(plan + threads as u64 * Dilation::memory(stock.dims, positions.dims) + stock.len() as u64)
}

/// 1 for every voxel of `stock` that `cutter` ([`cutter_of`] the tool as it is) covers at a pose at which the overlap of
/// the tool (perhaps offset by a clearance) with the obstacle is at most `tau`. Lengths are in the grid's unit. Voxels of
/// the stock that the obstacle holds should be left out of it beforehand. One unit of progress is one orientation; the
/// result does not depend on the number of threads.
///
/// # Errors
/// A stock on other voxels than the obstacle, as [`SectionPlan::cmf`], or cancellation.
pub fn removable(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    stock: &Occupancy,
    cutter: &Tool,
    orientations: &[Orientation],
    tau: f64,
    control: Control<'_>,
) -> Result<Vec<u8>, RemovableError> {
    let positions = around(&stock.grid, cutter)?;
    let plan = SectionPlan::with_query(obstacle, assembly, At::Tip, &positions)?;
    // A cutter too thin for the grid is refused before the work begins.
    RotatedTool::new(cutter, &Orientation::default(), positions.pitch)?;
    let start = || (SectionScratch::default(), Dilation::new(&stock.grid));
    let visit = |(scratch, dilation): &mut (SectionScratch, Dilation), index: usize| {
        let orientation = &orientations[index];
        let body = RotatedTool::new(cutter, orientation, positions.pitch)?;
        let meeting = meeting_positions(&body, &stock.grid)?;
        let (whole, counts) = plan.counts_in(orientation, &meeting, scratch)?;
        if let Some(most) = most_free(whole, tau) {
            dilation.cover(&body, counts, most);
        }
        Ok::<(), RemovableError>(())
    };
    let parts = stream_orientations(orientations.len(), control, start, visit)?;
    let mut whole = Dilation::new(&stock.grid);
    parts.iter().for_each(|(_, part)| whole.merge(part));
    let mut covered = whole.covered();
    covered.iter_mut().zip(&stock.solid).for_each(|(all, &there)| *all &= there);
    Ok(covered)
}

/// The largest count whose collision measure, as sections give it, is at most `tau`; none where even 0 is too much.
fn most_free(whole: u32, tau: f64) -> Option<u32> {
    let free = |count: u32| f64::from(share(count, whole)) <= tau;
    // The measure grows with the count.
    let (mut low, mut high) = (0, u64::from(whole) + 1);
    while low < high {
        let middle = low.midpoint(high);
        if free(middle as u32) { low = middle + 1 } else { high = middle }
    }
    low.checked_sub(1).map(|most| most as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::tests::{slotted, small_tool};
    use crate::section::direct_count;
    use crate::section::fixtures::orientations;

    #[test]
    fn it_is_what_the_cutter_covers_at_free_poses_counted_one_by_one() {
        let mut obstacle = slotted();
        // A cavity that nothing reaches.
        let cavity = obstacle.grid.index([3, 3, 4]);
        obstacle.solid[cavity] = 0;
        let mut stock = Occupancy::empty(obstacle.grid.grown([0, 1, 0], [0, -2, 2]).unwrap());
        let there = obstacle.on(&stock.grid).unwrap();
        stock.solid.iter_mut().zip(&there.solid).for_each(|(s, &part)| *s = 1 - part);
        let set = orientations("0,0;40,25;200,90;0,180");
        let (tool, cutter) = (small_tool(), cutter_of(&small_tool()).unwrap());
        for tau in [0.0, 0.1] {
            let mut expected = vec![0u8; stock.grid.len()];
            let shift = obstacle.grid.offset_of(&stock.grid).unwrap();
            for orientation in &set {
                let whole = RotatedTool::new(&tool, orientation, 1.0).unwrap();
                let body = RotatedTool::new(&cutter, orientation, 1.0).unwrap();
                for index in (0..stock.grid.len()).filter(|&i| stock.solid[i] == 1) {
                    let voxel = stock.grid.voxel(index);
                    // Every pose at which some voxel of the cutter lies on this voxel.
                    let reaches = (0..body.solid.len()).filter(|&i| body.solid[i] == 1).any(|i| {
                        let [_, ny, nz] = body.dims;
                        let local = [i / (ny * nz), i / nz % ny, i % nz];
                        let tip = [0, 1, 2]
                            .map(|a| voxel[a] as i64 + shift[a] - local[a] as i64 - i64::from(body.lower[a]));
                        f64::from(direct_count(&obstacle, &whole, tip)) <= tau * f64::from(whole.count)
                    });
                    expected[index] |= u8::from(reaches);
                }
            }
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let found = pool.install(|| {
                    removable(&obstacle, &tool, &stock, &cutter, &set, tau, Control::quiet()).unwrap()
                });
                assert_eq!(found, expected);
            }
            let count = expected.iter().map(|&v| usize::from(v)).sum::<usize>();
            assert!(count > 0 && (tau > 0.0 || count < stock.count()));
        }
    }

    #[test]
    fn the_largest_free_count_is_found_among_all_counts() {
        for whole in [1, 7, 1000] {
            for tau in [-1.0, 0.0, 1e-3, 0.07, 1.0 / 7.0, 0.5, 1.0, 3.0] {
                let share = 1.0 / f64::from(whole);
                let free = |&count: &u32| f64::from((share * f64::from(count)) as f32) <= tau;
                assert_eq!(most_free(whole, tau), (0..=whole).filter(free).max(), "{whole}, {tau}");
            }
        }
    }

    #[test]
    fn a_mesh_has_no_cutter() {
        let tool = Tool { shape: ToolShape::Mesh(crate::mesh::tests::unit_cube()), ..small_tool() };
        assert_eq!(cutter_of(&tool), None);
        let refusal = position_grid(&slotted().grid, &tool).unwrap_err();
        assert!(refusal.to_string().contains("no cutter"));
    }
}
