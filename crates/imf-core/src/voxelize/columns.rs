//! Winding numbers of a closed surface along columns of voxels, by counting signed crossings.

use glam::DVec3;

use super::deciding_point;
use crate::grid::Grid;
use crate::mesh::crossings::{crossing_height, seen_from_above};

/// A triangle that counts `weight` times.
pub(super) struct WeightedTriangle {
    pub(super) corners: [DVec3; 3],
    pub(super) weight: i32,
}

/// Winding numbers of the plane of voxel centres `x` into `counts [ny][nz + 1]`; the last entry of each column is
/// scratch.
pub(super) fn wind_plane<'a>(
    grid: &Grid,
    x: usize,
    triangles: impl Iterator<Item = &'a WeightedTriangle>,
    counts: &mut [i32],
) {
    let [_, ny, nz] = grid.dims;
    counts.fill(0);
    for triangle in triangles {
        let [a, b, c] = triangle.corners;
        let facing = seen_from_above(triangle.corners);
        if facing == 0.0 {
            continue;
        }
        let voxel_y = |y: f64| (y - grid.origin.y) / grid.pitch - 0.5;
        let low = voxel_y(a.y.min(b.y).min(c.y)).floor().max(0.0) as usize;
        let high = (voxel_y(a.y.max(b.y).max(c.y)).ceil() + 1.0).clamp(0.0, ny as f64) as usize;
        let sign = if facing > 0.0 { triangle.weight } else { -triangle.weight };
        for y in low..high {
            let centre = deciding_point(grid, [x, y, 0]);
            let Some(height) = crossing_height(&triangle.corners, facing > 0.0, centre) else { continue };
            // Voxels whose centres lie below the crossing see it above them.
            let below = ((height - centre.z) / grid.pitch).ceil().clamp(0.0, nz as f64) as usize;
            counts[y * (nz + 1) + below] += sign;
        }
    }
    for column in counts.chunks_exact_mut(nz + 1) {
        // The crossing stored at `below` counts for every voxel k < below.
        let mut above = 0;
        for entry in column.iter_mut().rev() {
            let crossings = *entry;
            *entry = above;
            above += crossings;
        }
    }
}
