//! Sections held against direct sums at pseudo-random voxels.

use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Result, bail};
use imf_core::orientation::Orientation;
use imf_core::section::SectionPlan;
use imf_core::tool::ToolVoxels;
use imf_train::training::permutation::Permutation;
use serde_json::{Value, json};

/// Decides which voxels are compared, so that a failure can be seen again.
const SEED: u64 = 0x1d3f;

/// How many voxels of every section are compared, and how many have been.
pub(super) struct Check {
    voxels: usize,
    agreed: AtomicU64,
}

impl Check {
    pub(super) fn new(voxels: usize) -> Self {
        Self { voxels, agreed: AtomicU64::new(0) }
    }

    /// Whether there is anything to compare.
    pub(super) fn is_wanted(&self) -> bool {
        self.voxels > 0
    }

    /// Compares a section with direct sums at its own voxels, other ones for every section.
    ///
    /// # Errors
    /// The first voxel that differs by more than the rounding of its f32: for a tool whose tip alone is sharp that
    /// means another count.
    pub(super) fn compare(
        &self,
        plan: &SectionPlan,
        orientation: &Orientation,
        index: usize,
        cmf: &[f32],
    ) -> Result<()> {
        if self.voxels == 0 {
            return Ok(());
        }
        let (tool, grid) = (plan.tool(), plan.grid());
        let order = Permutation::new(cmf.len(), SEED, index as u64);
        let rotated = ToolVoxels::new(tool, orientation, grid.pitch)?;
        for place in 0..self.voxels.min(cmf.len()) {
            let at = order.at(place);
            let voxel = grid.voxel(at);
            let (found, direct) = (cmf[at], plan.direct(orientation, &rotated, voxel)?);
            if (f64::from(found) - direct).abs() > f64::from(f32::EPSILON) * direct {
                let Orientation { theta, phi, .. } = orientation;
                bail!(
                    "section {index} (θ {theta}°, φ {phi}°) is {found} at voxel {voxel:?}, and the direct sum gives {direct}: \
                     please report this; the machine's memory may be faulty"
                );
            }
            self.agreed.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    }

    /// The result as text; nothing where nothing was to be compared.
    pub(super) fn describe(&self) -> Option<String> {
        let agreed = self.agreed.load(Ordering::Relaxed);
        (self.voxels > 0).then(|| format!("{agreed} of {agreed} compared voxels equal their direct sums"))
    }

    pub(super) fn summary(&self) -> Value {
        let agreed = self.agreed.load(Ordering::Relaxed);
        json!({ "voxels_per_section": self.voxels, "compared": agreed, "agreed": agreed })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::section::SectionScratch;
    use imf_core::tool::{SharpPoints, Tool};

    use super::*;
    use imf_core::section::ToolPoints;

    #[test]
    fn one_wrong_count_is_found_and_right_ones_are_counted() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [7, 5, 6] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 3 == 0)).collect();
        for sharp_points in [SharpPoints::Tip, SharpPoints::Points(vec![DVec3::new(1.0, 0.0, 3.0)])] {
            let tool = Tool { sharp_points, ..Tool::paper() };
            let plan = SectionPlan::new(
                &Occupancy { grid, solid: Vec::clone(&solid) },
                &tool,
                ToolPoints::SharpPoints,
            )
            .unwrap();
            let orientation = Orientation::new(30.0, 50.0);
            let mut cmf = vec![0.0; grid.len()];
            plan.cmf(&orientation, &mut SectionScratch::default(), &mut cmf).unwrap();
            let check = Check::new(1000);
            check.compare(&plan, &orientation, 0, &cmf).unwrap();
            assert_eq!(check.summary()["agreed"], grid.len());
            let count = ToolVoxels::new(&tool, &orientation, grid.pitch).unwrap().count;
            cmf[40] += 1.0 / count as f32;
            let message = check.compare(&plan, &orientation, 0, &cmf).unwrap_err().to_string();
            assert!(message.contains(&format!("{:?}", grid.voxel(40))), "{message}");
        }
    }
}
