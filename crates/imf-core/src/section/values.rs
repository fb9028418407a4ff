//! From counted overlaps to values: fractions of the tool, and the minimum over its sharp points by trilinear means.

use std::ops::Range;

use glam::DVec3;

use super::reading::{Line, LowestAround, SharpPointReader};
use super::{SectionPlan, direct};
use crate::orientation::Orientation;

impl SectionPlan {
    /// The collision measure at every voxel of the grid, from counts over the query box.
    pub(super) fn read_values(
        &self,
        orientation: &Orientation,
        normaliser: u32,
        (counts, around): (&[u32], &mut LowestAround),
        cmf: &mut [f32],
    ) {
        assert_eq!(cmf.len(), self.grid.len(), "one value for each voxel of the grid");
        if self.tip_alone() {
            for (value, &count) in cmf.iter_mut().zip(counts) {
                *value = overlap_fraction(count, normaliser);
            }
            return;
        }
        let reading = SharpPointReader::new(self, orientation, normaliser, (counts, around));
        let mut line = Line::default();
        cmf.fill(f32::INFINITY);
        for (range, at) in self.lines() {
            reading.lower(at, &mut cmf[range], None, &mut line);
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

/// The weighted mean of counts at the `z`-th voxel of a line.
#[inline(always)]
pub(super) fn mean(counts: &[u32], starts: &[(usize, f64)], z: usize) -> f32 {
    let mean: f64 = starts.iter().map(|&(from, weight)| weight * f64::from(counts[from + z])).sum();
    (mean as f32).clamp(0.0, 1.0)
}

/// The collision measure of `shared` common voxels of a tool that has `normaliser`, rounded as every section is.
#[inline]
#[must_use]
pub fn overlap_fraction(count: u32, normaliser: u32) -> f32 {
    ((1.0 / f64::from(normaliser)) * f64::from(count)).min(1.0) as f32
}
