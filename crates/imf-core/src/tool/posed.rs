//! Counting the obstacle's voxels in the tool at any pose, on the grid or off it.

use glam::{DMat4, DVec3};

use super::rotated::{SLACK, bounds, holds};
use super::{Segment, Tool, ToolShape};
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::voxelize::winding_number;

/// A world point in continuous voxel coordinates; numbers that are whole to a billionth become whole, so that ties are
/// decided as on the grid.
pub(crate) fn snapped(grid: &Grid, position: DVec3) -> DVec3 {
    grid.continuous(position).map(|v| if (v - v.round()).abs() < 1e-9 { v.round() } else { v })
}

impl Tool {
    /// Solid voxels whose centres lie inside the tool with its tip at the world point `position`: the definition of
    /// the exact field off the grid. Lengths are in the grid's unit.
    ///
    /// At a voxel centre (to a billionth of the pitch) the same centres count as in [`super::RotatedTool`].
    #[must_use]
    pub fn count_inside(&self, obstacle: &Occupancy, position: DVec3, orientation: &Orientation) -> u32 {
        let grid = &obstacle.grid;
        let tip = snapped(grid, position);
        let (lower, upper) = bounds(self, orientation, grid.pitch);
        let range = |axis: usize| {
            let clamp = |v: f64| v.clamp(0.0, grid.dims[axis] as f64) as usize;
            clamp((tip[axis] + lower[axis]).floor())..clamp((tip[axis] + upper[axis]).ceil() + 1.0)
        };
        let direction = orientation.direction();
        let (profile, mesh): (Vec<Segment>, _) = match &self.shape {
            ToolShape::Revolved(elements) => {
                (elements.iter().flat_map(|e| e.profile.iter().copied()).collect(), None)
            }
            ToolShape::Mesh(mesh) => {
                (Vec::new(), Some(mesh.transformed(&DMat4::from_mat3(orientation.rotation()))))
            }
        };
        let mut count = 0;
        for x in range(0) {
            for y in range(1) {
                for z in range(2) {
                    if obstacle.solid[grid.index([x, y, z])] == 0 {
                        continue;
                    }
                    let offset = (DVec3::new(x as f64, y as f64, z as f64) - tip) * grid.pitch;
                    let inside = match &mesh {
                        None => holds(&profile, direction, offset, SLACK * grid.pitch * grid.pitch),
                        Some(mesh) => winding_number(mesh, offset).abs() > 0.5,
                    };
                    count += u32::from(inside);
                }
            }
        }
        count
    }
}
