//! The definition: overlaps counted voxel by voxel. Slow and obviously right.

use glam::DVec3;

use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{RotatedTool, Tool, ToolError};

/// Voxels that are solid both in the obstacle and in the rotated tool with its tip on `voxel`, which may lie outside
/// the obstacle's grid (space there is empty).
#[must_use]
pub fn direct_count(obstacle: &Occupancy, tool: &RotatedTool, voxel: [i64; 3]) -> u32 {
    let dims = obstacle.grid.dims;
    let first = [0, 1, 2].map(|axis| voxel[axis] + i64::from(tool.lower[axis]));
    // Only the box where tool and grid overlap.
    let range = |axis: usize| {
        let low = (-first[axis]).max(0);
        let high = (dims[axis] as i64 - first[axis]).min(tool.dims[axis] as i64);
        low..high.max(low)
    };
    let mut count = 0;
    for x in range(0) {
        for y in range(1) {
            let z = range(2);
            if z.is_empty() {
                continue;
            }
            let length = (z.end - z.start) as usize;
            let in_tool = (x as usize * tool.dims[1] + y as usize) * tool.dims[2] + z.start as usize;
            let at = [first[0] + x, first[1] + y, first[2] + z.start].map(|i| i as usize);
            let in_obstacle = obstacle.grid.index(at);
            let tool = &tool.solid[in_tool..in_tool + length];
            let obstacle = &obstacle.solid[in_obstacle..in_obstacle + length];
            count += tool.iter().zip(obstacle).map(|(&t, &o)| u32::from(t & o)).sum::<u32>();
        }
    }
    count
}

/// The collision measure at the centre of `voxel`: the least overlap over the sharp points, each the trilinear mean
/// of the eight direct sums around `x − R k`.
///
/// # Errors
/// A tool that holds no voxel centre, or is too large.
pub fn direct_cmf(
    obstacle: &Occupancy,
    tool: &Tool,
    orientation: &Orientation,
    voxel: [usize; 3],
) -> Result<f64, ToolError> {
    let rotated = RotatedTool::new(tool, orientation, obstacle.grid.pitch)?;
    let rotation = orientation.rotation();
    let mut least = f64::INFINITY;
    for sharp in tool.sharp_point_positions() {
        let at = DVec3::from_array(voxel.map(|v| v as f64)) - rotation * sharp / obstacle.grid.pitch;
        let low = at.floor();
        let share = at - low;
        let mut mean = 0.0;
        for corner in 0..8 {
            let bits = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight: f64 =
                (0..3).map(|axis| if bits[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
            let position = [0, 1, 2].map(|axis| low[axis] as i64 + bits[axis]);
            mean += weight * f64::from(direct_count(obstacle, &rotated, position));
        }
        least = least.min(mean / f64::from(rotated.count));
    }
    Ok(least)
}
