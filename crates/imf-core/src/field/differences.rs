//! Derivatives by central differences: for fields whose values are steps.

use glam::{DQuat, DVec3, Vec3};

use super::{FieldError, Gradient};
use crate::pose::Pose;

/// Poses of one gradient: the pose itself, then a pair for each axis of position and of rotation.
pub(super) const POSES: usize = 13;

/// The pose with its neighbours, `step` away in position and `angle` in rotation about each axis of the world.
fn neighbours(pose: &Pose, step: f64, angle: f64) -> [Pose; POSES] {
    std::array::from_fn(|index| {
        let Some(pair) = index.checked_sub(1) else { return *pose };
        let axis = DVec3::AXES[pair / 2 % 3];
        let side = if pair % 2 == 0 { 1.0 } else { -1.0 };
        if pair < 6 {
            Pose { position: pose.position + axis * (side * step), ..*pose }
        } else {
            // Of any length, as the pose's own.
            let turn = DQuat::from_axis_angle(axis, side * angle);
            Pose { rotation: turn.mul_quat(pose.rotation), ..*pose }
        }
    })
}

/// A gradient by differences of `values`.
pub(super) fn gradient(
    pose: &Pose,
    step: f64,
    angle: f64,
    values: impl FnOnce(&[Pose], &mut [f32]) -> Result<(), FieldError>,
) -> Result<Gradient, FieldError> {
    let Some(axis) = pose.axis() else { return Ok(Gradient::NAN) };
    let mut found = [0.0; POSES];
    values(&neighbours(pose, step, angle), &mut found)?;
    let slopes = |first: usize, width: f64| {
        Vec3::from_array(std::array::from_fn(|a| {
            (found[first + 2 * a] - found[first + 2 * a + 1]) / width as f32
        }))
    };
    let rotation = slopes(7, 2.0 * angle);
    Ok(Gradient {
        value: found[0],
        position: slopes(1, 2.0 * step),
        direction: rotation.cross(axis.as_vec3()),
        rotation,
    })
}
