//! Which voxels a triangle touches: separating axes between a closed box and a triangle (Akenine-Möller 2001).

use glam::DVec3;

use crate::grid::Grid;

/// Marks the voxels of the plane `x` (`plane [ny][nz]`) that the triangle touches.
pub(super) fn touch_plane(grid: &Grid, x: usize, corners: &[DVec3; 3], plane: &mut [u8]) {
    let [_, ny, nz] = grid.dims;
    // Slack of rounding: a touch is never missed.
    let half = 0.5 * grid.pitch * (1.0 + 1e-9);
    let range = |axis: usize, n: usize| {
        let values = corners.map(|c| (c[axis] - grid.origin[axis]) / grid.pitch);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let clamp = |v: f64| v.clamp(0.0, n as f64) as usize;
        clamp((low - 1e-6).floor())..clamp((high + 1e-6).floor() + 1.0)
    };
    for y in range(1, ny) {
        for z in range(2, nz) {
            let centre = grid.centre([x, y, z]);
            if plane[y * nz + z] == 0 && touches(corners.map(|c| c - centre), half) {
                plane[y * nz + z] = 1;
            }
        }
    }
}

/// True where a triangle meets the closed cube of half edge `half` around the origin.
fn touches(corners: [DVec3; 3], half: f64) -> bool {
    let [a, b, c] = corners;
    let edges = [b - a, c - b, a - c];
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let separated = |axis: DVec3| {
        let reach = half * axis.abs().element_sum();
        let values = corners.map(|corner| corner.dot(axis));
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        low > reach || high < -reach
    };
    !axes.iter().any(|&axis| separated(axis))
        && !separated(edges[0].cross(edges[1]))
        && !edges.iter().any(|edge| axes.iter().any(|axis| separated(edge.cross(*axis))))
}
