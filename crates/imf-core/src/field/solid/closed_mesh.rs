//! Whether a tool that is a closed mesh holds a solid voxel's centre, asked in its own frame: of a pose few voxels have to be looked at,
//! where the tool's voxels would all have to be made anew.

use glam::DVec3;

use crate::mesh::Mesh;
use crate::mesh::crossings::CrossingIndex;
use crate::mesh::topology::boundary_chain;
use crate::occupancy::Occupancy;
use crate::pose::Pose;
use crate::tool::{ASIDE, snapped};
use crate::voxelize::BESIDE;

/// A closed mesh, prepared to be asked.
pub(super) struct ClosedMesh {
    crossings: CrossingIndex,
    lower: DVec3,
    upper: DVec3,
}

impl ClosedMesh {
    /// `None` of an open mesh, whose winding numbers are no whole numbers.
    pub(super) fn new(mesh: &Mesh) -> Option<Self> {
        let (lower, upper) = mesh.bounds()?;
        let is_closed = boundary_chain(mesh).is_empty();
        is_closed.then(|| Self { crossings: CrossingIndex::new(mesh.all_corners()), lower, upper })
    }

    /// Whether the tool at a valid pose holds a solid voxel's centre; of those on its surface as [`crate::tool::Tool::count_inside`] says.
    pub(super) fn holds_any(&self, obstacle: &Occupancy, pose: &Pose) -> bool {
        let (grid, tip) = (&obstacle.grid, snapped(&obstacle.grid, pose.position));
        let turn = pose.orientation().rotation();
        let back = turn.transpose();
        let local = |voxel: DVec3| (back * (voxel - tip + BESIDE) + ASIDE) * grid.pitch;
        // The corners of its own box, in voxels.
        let corners = (0..8).map(|corner| {
            let pick = |axis: usize| [self.lower, self.upper][corner >> axis & 1][axis];
            tip + turn * DVec3::new(pick(0), pick(1), pick(2)) / grid.pitch
        });
        let (low, high) = corners
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let range = |axis: usize| {
            let clamp = |at: f64| at.clamp(0.0, grid.dims[axis] as f64) as usize;
            clamp(low[axis].floor())..clamp(high[axis].ceil() + 1.0)
        };
        let step = back * DVec3::Z * grid.pitch;
        range(0).flat_map(|x| range(1).map(move |y| (x, y))).any(|(x, y)| {
            let start = local(DVec3::new(x as f64, y as f64, 0.0));
            let within = self.within(start, step, range(2));
            let first = grid.index([x, y, 0]);
            let line = &obstacle.solid[first + within.start..first + within.end];
            let mut solid = line.iter().zip(within).filter(|(solid, _)| **solid != 0);
            solid.any(|(_, z)| {
                let point = local(DVec3::new(x as f64, y as f64, z as f64));
                self.crossings.winding_number(point) != 0
            })
        })
    }

    /// The places along a line, of those in a range, that its box may hold; one more at either end.
    fn within(&self, start: DVec3, step: DVec3, range: std::ops::Range<usize>) -> std::ops::Range<usize> {
        let (mut from, mut to) = (range.start as f64, range.end as f64);
        for axis in 0..3 {
            let (low, high) = (self.lower[axis] - start[axis], self.upper[axis] - start[axis]);
            if step[axis].abs() > 1e-9 {
                let (a, b) = (low / step[axis], high / step[axis]);
                (from, to) = (from.max(a.min(b) - 1.0), to.min(a.max(b) + 2.0));
            }
        }
        let from = (from.max(0.0) as usize).clamp(range.start, range.end);
        from..(to.max(0.0) as usize).clamp(from, range.end)
    }
}
