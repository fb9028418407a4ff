//! The removable volume: stock that the cutter covers at some free pose.
//!
//! For every orientation one correlation finds the free positions of the whole tool (its overlap with the obstacle, tip
//! on a voxel centre, is at most τ), and a second one, of those positions with the rotated cutter, the voxels that it
//! sweeps there; here the second is a dilation of bits, 64 at a time. Both look only at the positions from which the cutter
//! in that orientation meets the stock. The stock itself is no obstacle: the question is what can be removed at all, in
//! whatever order.
//!
//! Tips on voxel centres alone leave a rim that gets thinner with the pitch. So there is an upper bound beside it, of tips
//! anywhere: what lies between both, this pitch does not decide.

use thiserror::Error;

use super::dilation::{Dilation, meeting_positions};
use crate::control::Control;
use crate::grid::{Grid, GridError};
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::section::{
    SectionError, SectionPlan, SectionScratch, ToolPoints, overlap_fraction, stream_orientations,
};
use crate::tool::{Assembly, Clearance, ElementKind, Tool, ToolError, ToolShape, ToolVoxels};

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

/// How far a tip may be from the nearest voxel's centre, in voxels: half the diagonal of one.
const ROUNDING: f64 = 0.866_025_403_784_438_7;

/// The stock that a cutter removes, between what it removes with its tip on voxel centres and what it removes at most with
/// its tip anywhere. Both tend to what it removes as the pitch falls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Removable {
    /// 1 for every voxel of the stock that the cutter covers at a free pose whose tip lies on a voxel's centre.
    pub covered: Vec<u8>,
    /// 1 for those, and for every voxel that it may cover at a free pose whose tip lies anywhere; every other voxel stays, whatever
    /// the pitch.
    pub possible: Vec<u8>,
}

/// The grid of all positions of the tip from which the cutter can cover a voxel of `stock`; `tool` as it is, not offset.
///
/// # Errors
/// A tool without a cutter, or a grid that is too large.
pub fn position_grid(stock: &Grid, tool: &Tool) -> Result<Grid, RemovableError> {
    let cutter = cutter_of(tool).ok_or_else(|| RemovableError::NoCutter(tool.name.clone()))?;
    Ok(around(stock, &cutter)?)
}

/// With room for the cutter offset by [`ROUNDING`].
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

/// What `cutter` ([`cutter_of`] the tool as it is) removes of `stock` at poses at which the overlap of the tool (perhaps offset
/// by a clearance) with the obstacle is at most `tau`. Lengths are in the grid's unit. Voxels of the stock that the obstacle
/// holds should be left out of it beforehand. Two units of progress are one orientation; the result does not depend on the
/// number of threads.
///
/// At most that is removed which the cutter covers, offset by half a voxel's diagonal, where the tool, eroded by as much, is free:
/// a free pose is never farther from a voxel's centre.
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
) -> Result<Removable, RemovableError> {
    let (obstacle, assembly) = (obstacle.into(), assembly.into());
    let slack = ROUNDING * stock.grid.pitch;
    // A cutter too thin for the grid is refused before the work begins.
    ToolVoxels::new(cutter, &Orientation::default(), stock.grid.pitch)?;
    let mut sweep =
        Sweep { obstacle, tool: Some(assembly.clone()), cutter, stock, orientations, tau, widest: None };
    let covered = sweep.run(control)?;
    let offset = Clearance { cutter: slack, ..Clearance::default() };
    let offset = cutter.with_clearance(&offset).map_err(SectionError::Clearance)?;
    let mut left = stock.clone();
    left.solid.iter_mut().zip(&covered).for_each(|(left, &gone)| *left &= 1 - gone);
    let mut possible = covered.clone();
    // Only around what is left.
    let Some((low, high)) = left.extent() else {
        (control.progress)(orientations.len() as u64);
        return Ok(Removable { covered, possible });
    };
    let before = low.map(|v| -(v as i64));
    let after = [0, 1, 2].map(|axis| high[axis] as i64 + 1 - stock.grid.dims[axis] as i64);
    let around = stock.grid.padded(before, after)?;
    if let Some(left) = left.on(&around) {
        // The tool at a pose holds no more than the tool offset as much at the centre next to it.
        sweep.widest = (tau > 0.0)
            .then(|| assembly.offset_further(slack))
            .transpose()
            .map_err(SectionError::Clearance)?;
        (sweep.tool, sweep.cutter, sweep.stock) = (assembly.eroded(slack), &offset, &left);
        let more = Occupancy { grid: around, solid: sweep.run(control)? };
        let more = more.on(&stock.grid).ok_or(GridError::Dims(around.dims))?;
        possible.iter_mut().zip(&more.solid).for_each(|(all, &more)| *all |= more);
    }
    Ok(Removable { covered, possible })
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
    /// Whose voxels `tau` is a share of, where they are not the tool's own.
    widest: Option<Assembly>,
}

impl Sweep<'_> {
    /// 1 for every voxel of the stock that is covered.
    fn run(&self, control: Control<'_>) -> Result<Vec<u8>, RemovableError> {
        let Self { obstacle, tool, cutter, stock, orientations, .. } = self;
        let positions = around(&stock.grid, cutter)?;
        let plan = match tool {
            Some(tool) => match SectionPlan::with_query(obstacle, tool, ToolPoints::Tip, &positions) {
                Err(SectionError::Tool(ToolError::TooSmall { .. })) => None,
                plan => Some(plan?),
            },
            None => None,
        };
        let start = || (SectionScratch::default(), Dilation::new(&stock.grid));
        let visit = |(scratch, dilation): &mut (SectionScratch, Dilation), index: usize| {
            let orientation = &orientations[index];
            let body = ToolVoxels::new(cutter, orientation, positions.pitch)?;
            let meeting = meeting_positions(&body, &stock.grid)?;
            let counted = match &plan {
                Some(plan) => match plan.counts_in(orientation, &meeting, scratch) {
                    // So thin that it holds no voxel's centre: nothing that it could hit.
                    Err(SectionError::Tool(ToolError::TooSmall { .. })) => None,
                    counted => Some(counted?),
                },
                None => None,
            };
            match counted {
                Some((own, counts)) => {
                    if let Some(most) = most_free(self.whole(orientation)?.unwrap_or(own), self.tau) {
                        dilation.cover(&body, counts, most);
                    }
                }
                None => dilation.cover(&body, &vec![0; meeting.len()], 0),
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

    fn whole(&self, orientation: &Orientation) -> Result<Option<u32>, ToolError> {
        let rotated = |widest: &Assembly| ToolVoxels::new(widest.whole(), orientation, self.stock.grid.pitch);
        Ok(self.widest.as_ref().map(rotated).transpose()?.map(|widest| widest.count))
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
mod tests {
    use std::f64::consts::PI;

    use glam::{DMat4, DQuat, DVec2, DVec3};

    use super::*;
    use crate::access::tests::{slotted, small_tool};
    use crate::mesh::Mesh;
    use crate::orientation::OrientationSet;
    use crate::parts::shell::{Axis, Facing, Shell, area, circle, pocketed, rounded_rectangle};
    use crate::section::direct_count;
    use crate::section::test_shapes::orientations;
    use crate::tool::{Element, Segment};
    use crate::voxelize::voxelize;

    #[test]
    fn it_is_what_the_cutter_covers_at_free_poses_counted_one_by_one() {
        let mut obstacle = slotted();
        // A cavity that nothing reaches.
        let cavity = obstacle.grid.index([3, 3, 4]);
        obstacle.solid[cavity] = 0;
        let mut stock = Occupancy::empty(obstacle.grid.padded([0, 1, 0], [0, -2, 2]).unwrap());
        let there = obstacle.on(&stock.grid).unwrap();
        stock.solid.iter_mut().zip(&there.solid).for_each(|(s, &part)| *s = 1 - part);
        let set = orientations("0,0;40,25;200,90;0,180");
        let (tool, cutter) = (small_tool(), cutter_of(&small_tool()).unwrap());
        for tau in [0.0, 0.1] {
            let mut expected = vec![0u8; stock.grid.len()];
            let shift = obstacle.grid.offset_of(&stock.grid).unwrap();
            for orientation in &set {
                let whole = ToolVoxels::new(&tool, orientation, 1.0).unwrap();
                let body = ToolVoxels::new(&cutter, orientation, 1.0).unwrap();
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
                assert_eq!(found.covered, expected);
                assert!(
                    found.covered.iter().zip(&found.possible).all(|(covered, possible)| covered <= possible)
                );
                assert!(found.possible.iter().zip(&stock.solid).all(|(possible, stock)| possible <= stock));
            }
            let count = expected.iter().map(|&v| usize::from(v)).sum::<usize>();
            assert!(count > 0 && (tau > 0.0 || count < stock.count()));
        }
    }

    /// A mill of a radius, 40 long.
    fn mill(radius: f64) -> Tool {
        let profile = vec![Segment::Line { from: 0.0, to: 40.0, radius_from: radius, radius_to: radius }];
        let element = Element { kind: ElementKind::Cutter, profile };
        Tool { shape: ToolShape::Revolved(vec![element]), ..small_tool() }
    }

    /// What a mill leaves of the stock that `mesh` leaves of `whole`: least and most, as volumes.
    fn left(mesh: &Mesh, whole: &Mesh, set: &[Orientation], radius: f64, pitch: f64) -> [f64; 2] {
        let (lower, upper) = whole.bounds().unwrap();
        let grid = Grid::with_pitch(lower, upper, pitch, 0).unwrap();
        let (part, mut stock) = (voxelize(mesh, &grid, false), voxelize(whole, &grid, false));
        stock.solid.iter_mut().zip(&part.solid).for_each(|(stock, &part)| *stock &= 1 - part);
        let tool = mill(radius);
        let found = removable(&part, &tool, &stock, &tool, set, 0.0, Control::quiet()).unwrap();
        [&found.possible, &found.covered].map(|gone| {
            let left = stock.solid.iter().zip(gone).filter(|&(&stock, &gone)| stock > gone).count();
            left as f64 * grid.voxel_volume()
        })
    }

    /// A box from the origin to `size`.
    fn block(size: DVec3) -> Mesh {
        let (outer, mut shell) = (rectangle(DVec2::ZERO, size.truncate()), Shell::default());
        shell.post(Axis::Z, &outer, [0.0, size.z]);
        shell.face(Axis::Z, 0.0, Facing::Down, &outer, &[]);
        shell.face(Axis::Z, size.z, Facing::Up, &outer, &[]);
        shell.into_mesh()
    }

    fn rectangle(lower: DVec2, upper: DVec2) -> Vec<DVec2> {
        vec![lower, DVec2::new(upper.x, lower.y), upper, DVec2::new(lower.x, upper.y)]
    }

    /// A plate of 30 × 30 × 12 with a hole of depth 8, and the same without it.
    fn plate(hole: &[DVec2]) -> [Mesh; 2] {
        let size = DVec3::new(30.0, 30.0, 12.0);
        [pocketed(size, hole, 8.0), block(size)]
    }

    /// What stays lies between both bounds, and their distance falls with the pitch.
    fn converges(hole: &[DVec2], radius: f64, closed: f64) {
        let ([part, whole], down) = (plate(hole), orientations("0,0"));
        let bounds = [1.0, 0.5, 0.25].map(|pitch| left(&part, &whole, &down, radius, pitch));
        for [least, most] in bounds {
            assert!((least..=most).contains(&closed), "{closed}: {bounds:?}");
        }
        let apart = bounds.map(|[least, most]| most - least);
        assert!(apart[1] < 0.7 * apart[0] && apart[2] < 0.7 * apart[1], "{apart:?}");
    }

    #[test]
    fn what_stays_of_holes_and_pockets_converges_to_the_closed_form() {
        let centre = DVec2::splat(15.0);
        // A hole wider than the mill is cleared, one that is narrower is not touched.
        converges(&circle(centre, 4.0, 64), 3.0, 0.0);
        let narrow = circle(centre, 4.0, 64);
        let volume = 8.0 * area(&narrow);
        let [part, whole] = plate(&narrow);
        let [least, most] = left(&part, &whole, &orientations("0,0"), 5.0, 0.25);
        assert!(
            least > 0.93 * volume && most > 0.97 * volume && most < 1.03 * volume,
            "{least} {most} {volume}"
        );
        // A round corner of a pocket keeps what lies between its radius and a larger one of the mill.
        let corners = |corner: f64| (4.0 - PI) * (9.0 - corner * corner).max(0.0) * 8.0;
        let (lower, upper) = (DVec2::new(4.0, 6.0), DVec2::new(26.0, 24.0));
        converges(&rectangle(lower, upper), 3.0, corners(0.0));
        for corner in [1.5, 4.0] {
            converges(&rounded_rectangle(lower, upper, corner, 16), 3.0, corners(corner));
        }
    }

    #[test]
    fn a_deep_hole_in_a_turned_block_is_cleared_along_the_axis_that_the_block_suggests() {
        let turn = DMat4::from_quat(DQuat::from_axis_angle(DVec3::new(2.0, 1.0, 0.5).normalize(), 0.6));
        let size = DVec3::new(12.0, 12.0, 40.0);
        let hole = circle(DVec2::splat(6.0), 4.0, 64);
        let volume = size.z * area(&hole);
        let [part, whole] = [pocketed(size, &hole, size.z), block(size)].map(|mesh| mesh.transformed(&turn));
        let directions = || part.machining_directions().into_iter().map(|found| found.direction).collect();
        let set = OrientationSet::parse_for("axes+normals+fibonacci:20", directions).unwrap().orientations;
        let even = orientations("axes+fibonacci:20");
        let bounds = [1.0, 0.5].map(|pitch| left(&part, &whole, &set, 3.0, pitch));
        // None of it is out of reach, and what the pitch does not decide gets less.
        assert!(bounds.iter().all(|[least, _]| *least == 0.0), "{bounds:?}");
        let shares = bounds.map(|[_, most]| most / volume);
        assert!(shares[0] < 0.45 && shares[1] < 0.7 * shares[0], "{shares:?}");
        let [least, _] = left(&part, &whole, &even, 3.0, 1.0);
        assert!(least > 0.1 * volume, "{least} of {volume} without the hole's axis");
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
