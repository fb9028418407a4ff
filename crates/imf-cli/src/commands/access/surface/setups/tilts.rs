//! The rotary angles with which a set-up reaches its samples.

use std::sync::Arc;

use imf_core::check::MachineReach;
use imf_core::orientation::{Limits, Orientation};
use imf_core::surface::{PartSetup, SetupTool, SurfaceSample, SurfaceTool};

/// Degrees by which a direction may lie beyond the end of a range.
const SLACK: f64 = 1e-5;

/// Samples that are reached, each at the smallest tilt that does.
pub(super) struct Tilts<'a> {
    pub(super) tools: &'a [SetupTool<'a>],
    pub(super) samples: &'a [SurfaceSample],
    pub(super) orientations: &'a [Orientation],
    pub(super) limits: &'a Limits,
}

impl Tilts<'_> {
    /// A set-up's directions as indices, with their angles, the smallest tilt first.
    pub(super) fn of(&self, setup: &PartSetup) -> Vec<(usize, [f64; 2])> {
        let angles = |&direction: &usize| {
            let turned = setup.rotation() * self.orientations[direction].direction();
            Some((direction, self.limits.angles(turned.normalize(), SLACK)?))
        };
        let mut tilts: Vec<(usize, [f64; 2])> = setup.directions.iter().filter_map(angles).collect();
        tilts.sort_by(|(_, a), (_, b)| {
            a[0].abs().total_cmp(&b[0].abs()).then(a[1].abs().total_cmp(&b[1].abs()))
        });
        tilts
    }

    /// The angles of one sample with tools that are brought to every pose.
    pub(super) fn angles(&self, sample: usize, tilts: &[(usize, [f64; 2])]) -> Option<[f64; 2]> {
        let free = |direction| self.tools.iter().any(|tool| tool.access.is_free(sample, direction));
        tilts.iter().find(|(direction, _)| free(*direction)).map(|(_, angles)| *angles)
    }

    /// The machine's own angles of one sample, by tool where the machine brings it.
    pub(super) fn on_machine(
        &self,
        sample: usize,
        tilts: &[(usize, [f64; 2])],
        brought: &[(SurfaceTool, Arc<MachineReach>)],
    ) -> Option<[f64; 2]> {
        tilts.iter().find_map(|&(direction, _)| {
            let orientation = &self.orientations[direction];
            self.tools.iter().zip(brought).find_map(|(tool, (limited, reach))| {
                let free = tool.access.is_free(sample, direction);
                let tip = free.then(|| limited.free_tip(&self.samples[sample], orientation))??;
                reach.angles(tip, orientation.direction())
            })
        })
    }
}
