//! What a tool reaches of space: where its sharp points may stand, from which orientations, and what stock its cutter removes there, in one
//! pass over the orientations. What it reaches of a part's surface is [`surface`](crate::surface).
//!
//! Orientations are streamed: each section is reduced and dropped, so memory does not grow with their number.
//! A pose counts as free where its collision measure is at most τ; with τ = 0 that is exact for voxel centres.

mod components;
mod dilation;
mod map;
mod removable;

pub use components::{Component, Components, cavities, components};
pub use map::{AccessMap, access_map};
pub use removable::{
    RemovableError, RemovableStock, RemovedVoxels, position_grid, removable, removable_by_orientation,
    removable_memory_estimate,
};

use crate::control::Control;
use crate::orientation::{Orientation, repeats};
use crate::section::{Imf, SectionError, SectionPlan, stream_sections};

/// What one tool reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolAccess {
    /// Inaccessibility measure and best orientation of every voxel.
    pub imf: Imf,
    /// Number of free orientations of every voxel; those in which the tool stands alike are one.
    pub free: Vec<u32>,
}

/// The exact accessibility of every voxel of the plan's grid over `orientations`, on all threads of the current pool;
/// the result does not depend on their number. A pose is free where its collision measure, in [0, 1], is at most `tau`. One unit of
/// progress is one orientation.
///
/// # Errors
/// As [`SectionPlan::cmf`]; [`SectionError::Cancelled`] when the control asks to stop.
pub fn tool_access(
    plan: &SectionPlan,
    orientations: &[Orientation],
    tau: f64,
    control: Control<'_>,
) -> Result<ToolAccess, SectionError> {
    let grid = plan.grid();
    let again = repeats(orientations, plan.tool().is_axisymmetric());
    let start = || ToolAccess { imf: Imf::new(grid.len()), free: vec![0; grid.len()] };
    let parts = stream_sections(plan, orientations, control, start, |access, index, cmf| {
        access.imf.lower_to(index, cmf);
        if again[index] {
            return;
        }
        for (count, &value) in access.free.iter_mut().zip(cmf) {
            *count += u32::from(f64::from(value) <= tau);
        }
    })?;
    let mut whole = start();
    for part in parts {
        whole.imf.merge(&part.imf);
        whole.free.iter_mut().zip(part.free).for_each(|(count, more)| *count += more);
    }
    Ok(whole)
}

/// Bytes that [`tool_access`] takes beside the plan and its scratch: known before anything is allocated.
#[must_use]
pub fn memory_estimate(dims: [usize; 3], threads: usize) -> u64 {
    let voxels = dims.iter().map(|&d| d as u64).product::<u64>();
    // Measure, best orientation and count of each thread and of the whole, and each thread's section.
    voxels * (12 + 16 * threads as u64)
}

/// Several tools together: a voxel is as accessible as its best tool makes it.
#[derive(Clone, Debug, PartialEq)]
pub struct CombinedAccess {
    /// Minimum inaccessibility measure over the tools, with that tool's best orientation.
    pub imf: Imf,
    /// The tool that has it; the first one at a tie.
    pub tool: Vec<u32>,
    /// Number of free pairs of tool and orientation, the sum of [`ToolAccess::free`].
    pub free: Vec<u32>,
}

impl CombinedAccess {
    /// No tool yet.
    #[must_use]
    pub fn new(voxels: usize) -> Self {
        Self { imf: Imf::new(voxels), tool: vec![u32::MAX; voxels], free: vec![0; voxels] }
    }

    /// Takes another tool into account; tools must be added in order.
    pub fn take(&mut self, tool: usize, access: &ToolAccess) {
        for voxel in 0..self.tool.len() {
            if access.imf.value[voxel] < self.imf.value[voxel] {
                self.imf.value[voxel] = access.imf.value[voxel];
                self.imf.best[voxel] = access.imf.best[voxel];
                self.tool[voxel] = tool as u32;
            }
            self.free[voxel] = self.free[voxel].saturating_add(access.free[voxel]);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use glam::DVec3;

    use super::*;
    use crate::grid::Grid;
    use crate::occupancy::Occupancy;
    use crate::section::test_shapes::{cylinder, orientations, revolved};
    use crate::section::{ToolPoints, sections};
    use crate::tool::{ElementKind, Segment, Tool};

    /// A cutter of radius 1.2 and length 5 in a holder of radius 2.7 up to 9.
    pub(crate) fn small_tool() -> Tool {
        revolved([
            (ElementKind::Cutter, vec![Segment::cylinder(0.0, 5.0, 1.2)]),
            (ElementKind::Holder(0), vec![Segment::cylinder(5.0, 9.0, 2.7)]),
        ])
    }

    /// A block with a slot that opens towards +z, and a loose voxel above.
    pub(crate) fn slotted() -> Occupancy {
        let grid = Grid { origin: DVec3::new(-1.0, 2.0, 0.5), pitch: 1.0, dims: [13, 11, 12] };
        Occupancy::of(grid, |[x, y, z]| {
            let block = (1..12).contains(&x) && (1..10).contains(&y) && (1..9).contains(&z);
            let slot = (5..8).contains(&x) && z >= 3;
            block && !slot || [x, y, z] == [6, 5, 11]
        })
    }

    #[test]
    fn counts_are_those_of_the_single_sections() {
        let obstacle = slotted();
        let query = obstacle.grid.padded([2, 1, 0], [-1, 3, 2]).unwrap();
        let plan = SectionPlan::with_query(&obstacle, small_tool(), ToolPoints::SharpPoints, &query).unwrap();
        let orientations = [orientations("fibonacci:23"), orientations("0,0;90,0;0,0")].concat();
        let all = sections(&plan, &orientations, Control::quiet()).unwrap();
        for (tau, threads) in [(0.0, 1), (0.07, 3)] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let access = pool.install(|| tool_access(&plan, &orientations, tau, Control::quiet())).unwrap();
            for voxel in 0..query.len() {
                // Of the last three the tool cannot tell one from another.
                let free = all[..24].iter().filter(|cmf| f64::from(cmf[voxel]) <= tau).count();
                assert_eq!(access.free[voxel] as usize, free);
            }
            assert!(access.free.contains(&0) && access.free.iter().any(|&n| n > 3));
            assert_eq!(access.imf, crate::section::imf(&plan, &orientations, Control::quiet()).unwrap());
        }
    }

    #[test]
    fn together_is_the_least_over_tools() {
        let obstacle = slotted();
        let orientations = orientations("fibonacci:9");
        let access = [small_tool(), cylinder(0.6, 9.0)].map(|tool| {
            let plan = SectionPlan::new(&obstacle, &tool, ToolPoints::SharpPoints).unwrap();
            tool_access(&plan, &orientations, 0.0, Control::quiet()).unwrap()
        });
        let mut together = CombinedAccess::new(obstacle.grid.len());
        access.iter().enumerate().for_each(|(tool, access)| together.take(tool, access));
        for voxel in 0..obstacle.grid.len() {
            let (a, b) = (access[0].imf.value[voxel], access[1].imf.value[voxel]);
            let expected = usize::from(b < a);
            assert_eq!(together.tool[voxel] as usize, expected);
            assert_eq!(together.imf.value[voxel], a.min(b));
            assert_eq!(together.imf.best[voxel], access[expected].imf.best[voxel]);
            assert_eq!(together.free[voxel], access[0].free[voxel] + access[1].free[voxel]);
        }
    }
}
