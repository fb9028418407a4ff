//! The least over orientations and sharp points by asking pose by pose: the way that serves every field.

use glam::{DQuat, DVec3, Quat, Vec3};

use super::{Best, Decision, PlannerError, Pose, check_lengths};

/// Poses asked at a time.
pub const BLOCK: usize = 256;

/// Checks what is asked for a minimum.
pub fn check_minimum(points: &[Vec3], orientations: &[Quat], best: &[Best]) -> Result<(), PlannerError> {
    check_lengths(points.len(), best.len())?;
    if orientations.is_empty() || u32::try_from(orientations.len()).is_err() {
        return Err(PlannerError::Orientations(orientations.len()));
    }
    Ok(())
}

/// True where a pose is better than the best so far: free before all others, then by its value.
pub fn is_better(value: f32, decision: Decision, best: &Best) -> bool {
    if value.is_nan() {
        return false;
    }
    let (free, known) = (decision == Decision::Free, best.decision == Decision::Free);
    if free == known { best.value.is_nan() || value < best.value } else { free }
}

/// The best orientation at every point. `answer` gives values, not clipped, and decisions of poses.
pub fn least(
    points: &[Vec3],
    orientations: &[Quat],
    sharp_points: &[DVec3],
    best: &mut [Best],
    mut answer: impl FnMut(&[Pose], &mut [f32], &mut [Decision]) -> Result<(), PlannerError>,
) -> Result<(), PlannerError> {
    check_minimum(points, orientations, best)?;
    let mut poses = [Pose::new(Vec3::ZERO, Quat::IDENTITY); BLOCK];
    let mut values = [0.0; BLOCK];
    let mut decisions = [Decision::Near; BLOCK];
    for (&point, best) in points.iter().zip(best) {
        *best = Best::NONE;
        for first in (0..orientations.len()).step_by(BLOCK) {
            let rotations = &orientations[first..(first + BLOCK).min(orientations.len())];
            let (poses, values) = (&mut poses[..rotations.len()], &mut values[..rotations.len()]);
            let decisions = &mut decisions[..rotations.len()];
            for sharp in sharp_points {
                for (pose, &rotation) in poses.iter_mut().zip(rotations) {
                    let shift = rotated(rotation, *sharp);
                    *pose = Pose::new((point.as_dvec3() - shift).as_vec3(), rotation);
                }
                answer(poses, values, decisions)?;
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

/// `R k`; of a quaternion of any length.
fn rotated(rotation: Quat, sharp: DVec3) -> DVec3 {
    if sharp == DVec3::ZERO {
        return sharp;
    }
    let rotation = rotation.as_dquat();
    let squared = rotation.length_squared();
    DQuat::from_vec4(glam::DVec4::from(rotation) / squared.sqrt()) * sharp
}
