//! From counted overlaps to values: shares of the tool, and the least over its sharp points by trilinear means.

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
        let rotation = orientation.rotation();
        for (index, &sharp) in self.sharp_points.iter().enumerate() {
            let shift = rotation * sharp / self.obstacle.grid().pitch;
            self.read_shifted(counts, -shift, f64::from(normaliser), index == 0, cmf);
        }
    }

    /// The voxels around `x + shift` (in voxels) from the voxel `x` of the grid, and the weights of their trilinear mean.
    pub(super) fn corners(&self, shift: DVec3) -> Vec<([i64; 3], f64)> {
        // Corners of weight zero are not read: a whole shift reads one voxel.
        direct::around(shift + DVec3::from_array(self.offset.map(|v| v as f64))).collect()
    }

    /// `cmf[x] = min(cmf[x], overlap(x + shift))` with `shift` in voxels; the first call of a section sets.
    fn read_shifted(&self, counts: &[u32], shift: DVec3, normaliser: f64, first: bool, cmf: &mut [f32]) {
        let mut corners = self.corners(shift);
        corners.iter_mut().for_each(|(_, weight)| *weight /= normaliser);
        let [nx, ny, nz] = self.grid.dims;
        for x in 0..nx {
            for y in 0..ny {
                let line = &mut cmf[(x * ny + y) * nz..][..nz];
                // Most of space is free for the first sharp point, and nothing is below that.
                if !first && line.iter().all(|&value| value == 0.0) {
                    continue;
                }
                let starts: Vec<(usize, f64)> = corners
                    .iter()
                    .map(|&([dx, dy, dz], w)| (self.query.index([x as i64 + dx, y as i64 + dy, dz]), w))
                    .collect();
                for (z, value) in line.iter_mut().enumerate() {
                    let overlap: f64 = starts.iter().map(|&(from, w)| w * f64::from(counts[from + z])).sum();
                    let overlap = (overlap as f32).clamp(0.0, 1.0);
                    *value = if first { overlap } else { value.min(overlap) };
                }
            }
        }
    }
}

/// The collision measure of so many shared voxels of a tool that has `normaliser`, rounded as every section is.
#[inline]
#[must_use]
pub fn share(count: u32, normaliser: u32) -> f32 {
    ((1.0 / f64::from(normaliser)) * f64::from(count)).min(1.0) as f32
}
