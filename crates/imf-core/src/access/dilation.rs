//! What a body covers while it visits a set of voxels: the union of its copies, by runs along z.
//!
//! A correlation of the set with the mirrored body would count the copies over every voxel; whether there is any needs
//! no count. A run of the body [a, b] on a row, moved along a run of the set [s, e], covers [s + a, e + b], so a row of
//! the result is the union of a few intervals for each row of the body, found by a difference array.

use crate::grid::Grid;
use crate::tool::RotatedTool;

/// A run of solid voxels of the body: row offset, first and last offset along z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Run {
    x: i64,
    y: i64,
    first: i64,
    last: i64,
}

fn runs_of(body: &RotatedTool) -> Vec<Run> {
    let [_, ny, nz] = body.dims;
    let mut runs = Vec::new();
    for (row, line) in body.solid.chunks_exact(nz).enumerate() {
        let (x, y) =
            ((row / ny) as i64 + i64::from(body.lower[0]), (row % ny) as i64 + i64::from(body.lower[1]));
        for (first, end) in intervals(line) {
            let low = i64::from(body.lower[2]);
            runs.push(Run { x, y, first: first + low, last: end - 1 + low });
        }
    }
    runs
}

/// First and end (one past the last) of every run of voxels that are not 0.
fn intervals(line: &[u8]) -> Vec<(i64, i64)> {
    let mut found = Vec::new();
    let mut begun = None;
    for (z, &value) in line.iter().chain(&[0]).enumerate() {
        match (begun, value != 0) {
            (None, true) => begun = Some(z as i64),
            (Some(start), false) => {
                found.push((start, z as i64));
                begun = None;
            }
            _ => {}
        }
    }
    found
}

/// Adds to `covered` (1 where covered) every voxel of `target` that `body` covers with its origin on some voxel of
/// `poses` (a grid of the same voxels) whose entry in `visited` is not 0. Rows of the target for which `wanted` says
/// no (by x and y) are left alone.
///
/// # Panics
/// If the grids' voxels do not coincide, or an array has not its grid's length.
pub fn dilate(
    body: &RotatedTool,
    poses: &Grid,
    visited: &[u8],
    target: &Grid,
    covered: &mut [u8],
    wanted: impl Fn(&[u8], usize) -> bool,
) {
    assert_eq!(visited.len(), poses.len(), "one entry for each voxel of the poses' grid");
    assert_eq!(covered.len(), target.len(), "one entry for each voxel of the target grid");
    let offset = target.offset_of(poses);
    assert!(offset.is_some(), "both grids have the same voxels");
    let [ox, oy, oz] = offset.unwrap_or_default();
    let body = runs_of(body);
    let [px, py, pz] = poses.dims.map(|d| d as i64);
    let visits: Vec<Vec<(i64, i64)>> = visited.chunks_exact(poses.dims[2]).map(intervals).collect();
    let [_, ny, nz] = target.dims;
    let mut change = vec![0i32; nz + 1];
    for (row, line) in covered.chunks_exact_mut(nz).enumerate() {
        if !wanted(line, row) {
            continue;
        }
        let (x, y) = ((row / ny) as i64, (row % ny) as i64);
        change.fill(0);
        for run in &body {
            // The row of poses from which this run of the body lies on the row.
            let (from_x, from_y) = (x - run.x - ox, y - run.y - oy);
            if !(0..px).contains(&from_x) || !(0..py).contains(&from_y) {
                continue;
            }
            for &(start, end) in &visits[(from_x * py + from_y) as usize] {
                debug_assert!(end <= pz);
                let first = (start + oz + run.first).clamp(0, nz as i64);
                let last = (end + oz + run.last).clamp(0, nz as i64);
                change[first as usize] += 1;
                change[last as usize] -= 1;
            }
        }
        let mut depth = 0;
        for (value, step) in line.iter_mut().zip(&change) {
            depth += step;
            *value |= u8::from(depth > 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::tests::{slotted, small_tool};
    use crate::orientation::OrientationSet;

    #[test]
    fn it_is_the_union_of_the_bodys_copies() {
        let poses = slotted().grid.grown([-2, 3, 0], [1, -4, 2]).unwrap();
        let target = slotted().grid.grown([1, -2, 2], [-3, 2, 5]).unwrap();
        let visited: Vec<u8> =
            (0..poses.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 9 & 63 == 0)).collect();
        let shift = target.offset_of(&poses).unwrap();
        for orientation in OrientationSet::parse("random:5:2").unwrap().orientations {
            let body = RotatedTool::new(&small_tool(), &orientation, 1.0).unwrap();
            let mut expected = vec![0; target.len()];
            for pose in (0..poses.len()).filter(|&p| visited[p] == 1) {
                for index in (0..body.solid.len()).filter(|&i| body.solid[i] == 1) {
                    let [_, ny, nz] = body.dims;
                    let local = [index / (ny * nz), index / nz % ny, index % nz];
                    let at = [0, 1, 2].map(|a| {
                        poses.voxel(pose)[a] as i64 + shift[a] + local[a] as i64 + i64::from(body.lower[a])
                    });
                    if (0..3).all(|a| (0..target.dims[a] as i64).contains(&at[a])) {
                        expected[target.index(at.map(|v| v as usize))] = 1;
                    }
                }
            }
            let mut covered = vec![0; target.len()];
            dilate(&body, &poses, &visited, &target, &mut covered, |_, _| true);
            assert_eq!(covered, expected);
            let mut none = vec![0; target.len()];
            dilate(&body, &poses, &visited, &target, &mut none, |_, _| false);
            assert!(none.iter().all(|&v| v == 0));
        }
    }
}
