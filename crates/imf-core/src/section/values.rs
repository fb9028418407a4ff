//! From counted overlaps to values: fractions of the tool, and the minimum over its sharp points by trilinear means.

use std::ops::Range;

use glam::DVec3;

use super::{SectionPlan, direct};
use crate::orientation::Orientation;

impl SectionPlan {
    /// The collision measure at every voxel of the grid, from counts over the query box.
    pub(super) fn read_values(
        &self,
        orientation: &Orientation,
        normaliser: u32,
        counts: &[u32],
        cmf: &mut [f32],
    ) {
        assert_eq!(cmf.len(), self.grid.len(), "one value for each voxel of the grid");
        if self.tip_alone() {
            for (value, &count) in cmf.iter_mut().zip(counts) {
                *value = share(count, normaliser);
            }
            return;
        }
        let reading = Reading::new(self, orientation, normaliser, counts);
        let (mut starts, mut limits) = (Vec::new(), Vec::new());
        for (line, at) in self.lines() {
            let line = &mut cmf[line];
            line.fill(f32::INFINITY);
            reading.lower(at, line, &mut starts, &mut limits, |_, _| {});
        }
    }

    /// The voxels around `x − R sharp` from the voxel `x` of the grid, and the weights of their trilinear mean over the
    /// normaliser.
    pub(super) fn corners(
        &self,
        orientation: &Orientation,
        sharp: DVec3,
        normaliser: u32,
    ) -> Vec<([i64; 3], f64)> {
        let shift = -(orientation.rotation() * sharp / self.obstacle.grid().pitch);
        // Corners of weight zero are not read: a whole shift reads one voxel.
        let corners = direct::around(shift + DVec3::from_array(self.offset.map(|v| v as f64)));
        corners.map(|(corner, weight)| (corner, weight / f64::from(normaliser))).collect()
    }

    /// Every line along z of the grid: where it stands in an array over the grid, and its x and y.
    pub(super) fn lines(&self) -> impl Iterator<Item = (Range<usize>, [i64; 2])> {
        let [nx, ny, nz] = self.grid.dims;
        let line = move |x: usize, y: usize| ((x * ny + y) * nz..(x * ny + y + 1) * nz, [x as i64, y as i64]);
        (0..nx).flat_map(move |x| (0..ny).map(move |y| line(x, y)))
    }

    /// Where in the query box the reading of a line begins.
    pub(super) fn starts(
        &self,
        corners: &[([i64; 3], f64)],
        [x, y]: [i64; 2],
        starts: &mut Vec<(usize, f64)>,
    ) {
        starts.clear();
        let corners = corners.iter();
        starts.extend(corners.map(|&([dx, dy, dz], w)| (self.query.index([x + dx, y + dy, dz]), w)));
    }
}

/// Counts of an orientation, read at sharp points off the tip.
pub(super) struct Reading<'a> {
    plan: &'a SectionPlan,
    counts: &'a [u32],
    normaliser: u32,
    /// By sharp point.
    pub(super) corners: Vec<Vec<([i64; 3], f64)>>,
    /// The least count of a voxel and those after it along each axis: no mean around it is lower.
    lowest: Vec<u32>,
}

impl<'a> Reading<'a> {
    pub(super) fn new(
        plan: &'a SectionPlan,
        orientation: &Orientation,
        normaliser: u32,
        counts: &'a [u32],
    ) -> Self {
        let corners = |sharp: &DVec3| plan.corners(orientation, *sharp, normaliser);
        let corners = plan.sharp_points.iter().map(corners).collect();
        let [_, ny, nz] = plan.query.dims;
        let mut lowest = counts.to_vec();
        for line in lowest.chunks_exact_mut(nz.max(1)) {
            for z in 1..line.len() {
                line[z - 1] = line[z - 1].min(line[z]);
            }
        }
        for slab in lowest.chunks_exact_mut((ny * nz).max(1)) {
            lower_to_next(slab, nz);
        }
        lower_to_next(&mut lowest, ny * nz);
        Self { plan, counts, normaliser, corners, lowest }
    }

    /// Lowers the values of a line to the minimum over the sharp points; `lowered` hears of every voxel that a point lowers, the
    /// points in their order. Points that can lower none are passed over.
    pub(super) fn lower(
        &self,
        at: [i64; 2],
        values: &mut [f32],
        starts: &mut Vec<(usize, f64)>,
        limits: &mut Vec<u32>,
        mut lowered: impl FnMut(usize, usize),
    ) {
        // No count from here on is below the value, whatever the rounding.
        let limit = |value: f32| (f64::from(value) * f64::from(self.normaliser) * (1.0 + 1e-9)).ceil() as u32;
        limits.clear();
        limits.extend(values.iter().map(|&value| limit(value)));
        let [x, y] = at;
        for (index, corners) in self.corners.iter().enumerate() {
            // The first corner is the lowest one: its weight is never 0.
            let Some(&([dx, dy, dz], _)) = corners.first() else { continue };
            let from = self.plan.query.index([x + dx, y + dy, dz]);
            let lowest = &self.lowest[from..from + values.len()];
            let lower = lowest.iter().zip(&*limits).fold(false, |any, (low, limit)| any | (low < limit));
            if !lower {
                if limits.iter().all(|&limit| limit == 0) {
                    return;
                }
                continue;
            }
            self.plan.starts(corners, at, starts);
            for (z, (value, limit_here)) in values.iter_mut().zip(&mut *limits).enumerate() {
                if lowest[z] < *limit_here {
                    let overlap = mean(self.counts, starts, z);
                    if overlap < *value {
                        (*value, *limit_here) = (overlap, limit(overlap));
                        lowered(z, index);
                    }
                }
            }
        }
    }
}

/// Every element's minimum with the one `step` after it.
fn lower_to_next(values: &mut [u32], step: usize) {
    for next in step..values.len() {
        values[next - step] = values[next - step].min(values[next]);
    }
}

/// The weighted mean of counts at the `z`-th voxel of a line.
#[inline(always)]
pub(super) fn mean(counts: &[u32], starts: &[(usize, f64)], z: usize) -> f32 {
    let mean: f64 = starts.iter().map(|&(from, weight)| weight * f64::from(counts[from + z])).sum();
    (mean as f32).clamp(0.0, 1.0)
}

/// The collision measure of so many shared voxels of a tool that has `normaliser`, rounded as every section is.
#[inline]
#[must_use]
pub fn share(count: u32, normaliser: u32) -> f32 {
    ((1.0 / f64::from(normaliser)) * f64::from(count)).min(1.0) as f32
}
