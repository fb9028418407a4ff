//! The minimum over rotations and sharp points, pose by pose, for any field.

use glam::{DQuat, DVec3};

use super::{Best, Decision, FieldError, check_lengths};
use crate::pose::Pose;

/// Poses evaluated at a time.
pub const BLOCK: usize = 256;

/// Checks the arguments of a minimum.
pub fn check_minimum(points: &[DVec3], rotations: &[DQuat], best: &[Best]) -> Result<(), FieldError> {
    check_lengths(points.len(), best.len())?;
    if rotations.is_empty() || u32::try_from(rotations.len()).is_err() {
        return Err(FieldError::Orientations(rotations.len()));
    }
    Ok(())
}

/// True where a pose is better than the current best: free before all others, then by its value.
pub fn is_better(value: f32, decision: Decision, best: &Best) -> bool {
    if value.is_nan() {
        return false;
    }
    let (free, known) = (decision == Decision::Free, best.decision == Decision::Free);
    if free == known { best.value.is_nan() || value < best.value } else { free }
}

/// The best rotation at every point. `evaluate` gives values, not clipped, and decisions of poses.
pub fn minimum_pose_by_pose(
    points: &[DVec3],
    rotations: &[DQuat],
    sharp_points: &[DVec3],
    best: &mut [Best],
    mut evaluate: impl FnMut(&[Pose], &mut [f32], &mut [Decision]) -> Result<(), FieldError>,
) -> Result<(), FieldError> {
    check_minimum(points, rotations, best)?;
    let mut poses = [Pose::new(DVec3::ZERO, DQuat::IDENTITY); BLOCK];
    let mut values = [0.0; BLOCK];
    let mut decisions = [Decision::Undecided; BLOCK];
    for (&point, best) in points.iter().zip(best) {
        *best = Best::NONE;
        for first in (0..rotations.len()).step_by(BLOCK) {
            let rotations = &rotations[first..(first + BLOCK).min(rotations.len())];
            let (poses, values) = (&mut poses[..rotations.len()], &mut values[..rotations.len()]);
            let decisions = &mut decisions[..rotations.len()];
            for sharp in sharp_points {
                for (pose, &rotation) in poses.iter_mut().zip(rotations) {
                    *pose = with_sharp_point_at(point, *sharp, rotation);
                }
                evaluate(poses, values, decisions)?;
                for (place, (&value, &decision)) in values.iter().zip(decisions.iter()).enumerate() {
                    if is_better(value, decision, best) {
                        *best = Best { value, orientation: (first + place) as u32, decision };
                    }
                }
            }
        }
    }
    Ok(())
}

/// The pose at which a sharp point of the tool stands at a point.
pub(super) fn with_sharp_point_at(point: DVec3, sharp: DVec3, rotation: DQuat) -> Pose {
    let position = if sharp == DVec3::ZERO { point } else { point - rotation.normalize() * sharp };
    Pose::new(position, rotation)
}
