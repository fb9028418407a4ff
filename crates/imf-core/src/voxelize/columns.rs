//! Winding numbers of a closed surface along columns of voxels, by counting signed crossings.
//!
//! A column's line may meet an edge or a vertex exactly. Every test is made as if the line stood at
//! (x + ε, y + ε²) for an infinitesimal ε: each shared edge then has the line on one definite side, so exactly one
//! of two neighbouring triangles is crossed. The signs come from an exact predicate.

use glam::DVec3;
use robust::{Coord, orient2d};

use crate::grid::Grid;

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
        let facing = orient2d(coord(a), coord(b), coord(c));
        if facing == 0.0 {
            continue;
        }
        let voxel_y = |y: f64| (y - grid.origin.y) / grid.pitch - 0.5;
        let low = voxel_y(a.y.min(b.y).min(c.y)).floor().max(0.0) as usize;
        let high = (voxel_y(a.y.max(b.y).max(c.y)).ceil() + 1.0).clamp(0.0, ny as f64) as usize;
        let sign = if facing > 0.0 { triangle.weight } else { -triangle.weight };
        for y in low..high {
            let centre = grid.centre([x, y, 0]);
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

/// Height at which the vertical line through `point` crosses the triangle, if it does.
fn crossing_height(corners: &[DVec3; 3], counter_clockwise: bool, point: DVec3) -> Option<f64> {
    let mut weights = [0.0; 3];
    for side in 0..3 {
        let (from, to) = (corners[(side + 1) % 3], corners[(side + 2) % 3]);
        let (area, left) = side_of(from, to, point);
        if left != counter_clockwise {
            return None;
        }
        weights[side] = area;
    }
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 {
        return Some((corners[0].z + corners[1].z + corners[2].z) / 3.0);
    }
    Some((weights[0] * corners[0].z + weights[1] * corners[1].z + weights[2] * corners[2].z) / sum)
}

/// Twice the signed area of (from, to, point), and whether the perturbed point is to the left of the edge.
fn side_of(from: DVec3, to: DVec3, point: DVec3) -> (f64, bool) {
    let area = orient2d(coord(from), coord(to), coord(point));
    let left = if area != 0.0 {
        area > 0.0
    } else if to.y != from.y {
        to.y < from.y
    } else {
        to.x > from.x
    };
    (area, left)
}

fn coord(p: DVec3) -> Coord<f64> {
    Coord { x: p.x, y: p.y }
}
