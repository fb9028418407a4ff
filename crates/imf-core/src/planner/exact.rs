//! The exact field as planners ask it.

use glam::{Quat, Vec3};

use super::differences::gradient;
use super::least::least;
use super::{Best, Decision, Gradient, PlannerError, Pose, PoseField, check_lengths};
use crate::field::{self, ExactField};
use crate::tool::ToolError;

/// Values are counts over the tool's own count in that orientation. They are steps, so that derivatives are differences:
/// over half a pitch either way in position, and over the angle either way that moves the tool's far end by a pitch.
/// Decisions are exact for voxel centres, and never [`Decision::Near`].
impl PoseField for ExactField<'_> {
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), values.len())?;
        // Poses of one rotation tend to stand together.
        let mut last: Option<(Quat, u32)> = None;
        for (pose, value) in poses.iter().zip(values) {
            let Some(count) = count(self, pose) else {
                *value = f32::NAN;
                continue;
            };
            if count == 0 {
                *value = 0.0;
                continue;
            }
            let whole = match last {
                Some((rotation, whole)) if rotation == pose.rotation => whole,
                _ => normaliser(self, pose)?,
            };
            last = Some((pose.rotation, whole));
            *value = (f64::from(count) / f64::from(whole)).min(1.0) as f32;
        }
        Ok(())
    }

    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), gradients.len())?;
        let step = (0.5 * self.grid().pitch) as f32;
        let angle = (self.grid().pitch / self.reach()).min(1.0) as f32;
        for (pose, out) in poses.iter().zip(gradients) {
            *out = gradient(pose, step, angle, |poses, values| self.query(poses, values))?;
        }
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), decisions.len())?;
        for (pose, decision) in poses.iter().zip(decisions) {
            *decision = if touches(self, pose) { Decision::Blocked } else { Decision::Free };
        }
        Ok(())
    }

    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError> {
        least(points, orientations, self.sharp_points(), best, |poses, values, decisions| {
            self.query(poses, values)?;
            for (value, decision) in values.iter().zip(decisions) {
                *decision = if *value == 0.0 { Decision::Free } else { Decision::Blocked };
            }
            Ok(())
        })
    }
}

/// Lower bound of the distance from the tool to the nearest solid voxel's centre, in world units; 0 where none is proven.
pub(super) fn clearance(field: &ExactField<'_>, pose: &Pose) -> f64 {
    let found = pose.direction().and_then(|direction| field.clearance_along(pose.tip(), direction));
    found.unwrap_or(0.0).max(0.0)
}

/// Solid voxels in the tool; `None` of what is no pose.
pub(super) fn count(field: &ExactField<'_>, pose: &Pose) -> Option<u32> {
    let direction = pose.direction()?;
    let count = field.count_along(pose.tip(), direction);
    Some(count.unwrap_or_else(|| field.count(&exact_pose(pose))))
}

pub(super) fn normaliser(field: &ExactField<'_>, pose: &Pose) -> Result<u32, ToolError> {
    let found = pose.direction().and_then(|direction| field.normaliser_along(direction));
    found.unwrap_or_else(|| field.normaliser(&pose.orientation()))
}

fn exact_pose(pose: &Pose) -> field::Pose {
    field::Pose { position: pose.tip(), orientation: pose.orientation() }
}

/// True where the tool holds a solid voxel's centre, and of what is no pose.
#[inline]
pub fn touches(field: &ExactField<'_>, pose: &Pose) -> bool {
    let Some(direction) = pose.direction() else { return true };
    let collides = field.collides_along(pose.tip(), direction);
    collides.unwrap_or_else(|| field.count(&exact_pose(pose)) > 0)
}
