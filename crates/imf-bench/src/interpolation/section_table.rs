//! Tables of exact sections at an angle grid, with linear interpolation: the baseline that uses memory alone.

use anyhow::{Result, ensure};
use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{SectionPlan, sections};
use rayon::prelude::*;

use super::grid_weights;

/// Voxels that one thread interpolates at a time.
const BLOCK: usize = 4096;

/// Exact sections at the pairs of an angle grid.
pub(crate) struct SectionTable {
    n: usize,
    orientations: Vec<Orientation>,
    /// `[section][voxel]`
    sections: Vec<Vec<f32>>,
}

impl SectionTable {
    /// Computes the n × n sections of `grid:n`, n at least 3. One unit of progress is one section.
    ///
    /// # Errors
    /// Fewer directions, a failed section, or cancellation.
    pub(crate) fn new(plan: &SectionPlan, n: usize, control: Control<'_>) -> Result<Self> {
        ensure!(n >= 3, "a turn needs at least three steps, not {n}");
        let orientations = OrientationSet::parse(&format!("grid:{n}"))?.orientations;
        let sections = sections(plan, &orientations, control)?;
        Ok(Self { n, orientations, sections })
    }

    /// Bytes that n × n sections of `voxels` voxels take.
    pub(crate) fn memory(n: usize, voxels: usize) -> u64 {
        4 * (n * n * voxels) as u64
    }

    /// The section of the nearest direction.
    ///
    /// # Panics
    /// If `values` has not its length.
    pub(crate) fn nearest(&self, orientation: &Orientation, values: &mut [f32]) {
        let direction = orientation.direction();
        let closeness = |o: &Orientation| direction.dot(o.direction());
        let places = self.orientations.iter().enumerate();
        let nearest = places.max_by(|(_, a), (_, b)| closeness(a).total_cmp(&closeness(b)));
        values.copy_from_slice(&self.sections[nearest.map_or(0, |(index, _)| index)]);
    }

    /// The section at an orientation: linear in angle, by [`grid_weights`].
    ///
    /// # Panics
    /// If `values` has not a section's length.
    pub(crate) fn linear(&self, orientation: &Orientation, values: &mut [f32]) {
        let weights = grid_weights(self.n, orientation);
        values.par_chunks_mut(BLOCK).enumerate().for_each(|(block, values)| {
            values.fill(0.0);
            for &(index, weight) in &weights {
                let section = &self.sections[index][block * BLOCK..][..values.len()];
                values.iter_mut().zip(section).for_each(|(value, &s)| *value += weight as f32 * s);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::section::ToolPoints;
    use imf_core::tool::Tool;

    fn plan() -> SectionPlan {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
        SectionPlan::new(&Occupancy { grid, solid }, Tool::paper(), ToolPoints::SharpPoints).unwrap()
    }

    #[test]
    fn whole_sections_are_interpolated_in_angle_alone() {
        let plan = plan();
        let (voxels, stored) = (plan.grid().len(), SectionTable::new(&plan, 6, Control::quiet()).unwrap());
        assert_eq!(SectionTable::memory(6, voxels), (4 * stored.sections.len() * voxels) as u64);
        let between = Orientation::new(37.0, 81.0);
        let exact = sections(&plan, &stored.orientations, Control::quiet()).unwrap();
        let (mut linear, mut nearest) = (vec![7.0; voxels], vec![7.0; voxels]);
        stored.linear(&between, &mut linear);
        stored.nearest(&between, &mut nearest);
        for voxel in 0..voxels {
            let expected: f64 =
                grid_weights(6, &between).iter().map(|&(i, w)| w * f64::from(exact[i][voxel])).sum();
            // Four products of values below 1, in f32.
            assert!((f64::from(linear[voxel]) - expected).abs() < 1e-6);
        }
        // θ = 60°, φ = 90° is the nearest of the grid's pairs: index 1·6 + 3.
        assert_eq!(nearest, exact[9]);
    }
}
