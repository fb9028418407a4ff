//! A pose as planners hold it: single precision, a point and a quaternion.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};

use crate::field;
use crate::orientation::Orientation;

/// Where the tool's tip is, in the scene's unit and world frame, and how the tool is turned: from the tool's frame (tip at
/// the origin, axis +z from tip to holder) into the world.
///
/// The roll about the tool's own axis is idle for tools of revolution. A quaternion of any length but 0 is taken as its
/// direction. A pose with a number that is not finite, or a quaternion of no length, is *no pose*: fields answer NaN and
/// [`Decision::Blocked`](super::Decision::Blocked).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World position of the tip.
    pub position: Vec3,
    /// Rotation from the tool's frame to the world.
    pub rotation: Quat,
}

/// Components of a direction below this are 0: a step of single precision, so that axes along the grid keep to it.
const STEP: f64 = 1e-7;

impl Pose {
    /// A tip and a rotation.
    #[must_use]
    pub const fn new(position: Vec3, rotation: Quat) -> Self {
        Self { position, rotation }
    }

    /// A tip and the direction of the tool's axis from tip to holder, of any length but 0; no roll, as
    /// [`Orientation::from_direction`].
    #[must_use]
    pub fn along(position: Vec3, axis: Vec3) -> Self {
        Self { position, rotation: rotation_along(axis) }
    }

    /// The pose of the exact interface, in double precision.
    #[must_use]
    pub fn from_exact(pose: &field::Pose) -> Self {
        let rotation = DQuat::from_mat3(&pose.orientation.rotation());
        Self { position: pose.position.as_vec3(), rotation: rotation.as_quat() }
    }

    /// Unit vector from tip to holder.
    #[must_use]
    pub fn axis(&self) -> Vec3 {
        self.direction().map_or(Vec3::NAN, DVec3::as_vec3)
    }

    /// True where every number is finite and the quaternion has a length.
    #[must_use]
    pub fn is_pose(&self) -> bool {
        self.direction().is_some()
    }

    /// Position of the tip in double precision.
    pub fn tip(&self) -> DVec3 {
        self.position.as_dvec3()
    }

    /// Unit vector from tip to holder; `None` for what is no pose.
    #[inline]
    pub fn direction(&self) -> Option<DVec3> {
        let DQuat { x, y, z, w } = self.rotation.as_dquat();
        let axis = DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w + z * z - x * x - y * y);
        let squared = x * x + y * y + z * z + w * w;
        if !(squared > 0.0 && squared.is_finite() && self.position.is_finite()) {
            return None;
        }
        let axis = (axis / squared).map(|v| if v.abs() < STEP { 0.0 } else { v });
        Some(axis / axis.length())
    }

    /// The orientation; its angles are NaN for what is no pose.
    #[must_use]
    pub fn orientation(&self) -> Orientation {
        Orientation::from_rotation(&DMat3::from_quat(self.rotation.as_dquat().normalize()))
    }
}

/// The rotation of a tool whose axis points along `axis`, without roll; NaN for a vector without direction.
#[must_use]
pub fn rotation_along(axis: Vec3) -> Quat {
    let Some(orientation) = Orientation::from_direction(axis.as_dvec3()) else { return Quat::NAN };
    DQuat::from_mat3(&orientation.rotation()).as_quat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::OrientationSet;

    #[test]
    fn poses_keep_the_direction_of_their_orientation() {
        let mut all = OrientationSet::parse("random:300:2").unwrap().orientations;
        all.extend(OrientationSet::parse("so3:100").unwrap().orientations);
        for orientation in all {
            let exact = field::Pose { position: DVec3::new(1.0, 2.0, 3.0), orientation };
            let pose = Pose::from_exact(&exact);
            // A few steps of single precision.
            assert!((pose.direction().unwrap() - orientation.direction()).length() < 5e-7);
            assert!((pose.orientation().direction() - orientation.direction()).length() < 5e-7);
            let same = Pose::along(pose.position, pose.axis() * 3.0);
            assert!((same.axis() - pose.axis()).length() < 5e-7);
            let longer = Pose { rotation: pose.rotation * 7.0, ..pose };
            assert!((longer.direction().unwrap() - orientation.direction()).length() < 5e-7);
        }
    }

    #[test]
    fn axes_of_the_grid_stay_what_they_are() {
        for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            assert_eq!(Pose::along(Vec3::ZERO, axis).direction(), Some(axis.as_dvec3()));
            let arc = Quat::from_rotation_arc(Vec3::Z, axis);
            assert_eq!(Pose::new(Vec3::ZERO, arc).direction(), Some(axis.as_dvec3()));
        }
    }

    #[test]
    fn what_is_no_pose_says_so() {
        let good = Pose::along(Vec3::ONE, Vec3::X);
        assert!(good.is_pose());
        for bad in [
            Pose { position: Vec3::new(0.0, f32::NAN, 0.0), ..good },
            Pose { position: Vec3::new(f32::INFINITY, 0.0, 0.0), ..good },
            Pose { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
            Pose { rotation: Quat::from_xyzw(0.0, f32::NAN, 0.0, 1.0), ..good },
            Pose { rotation: Quat::from_xyzw(0.0, f32::INFINITY, 0.0, 1.0), ..good },
            Pose::along(Vec3::ONE, Vec3::ZERO),
        ] {
            assert!(!bad.is_pose() && bad.axis().is_nan(), "{bad:?}");
        }
        // The smallest and the largest quaternions that there are.
        for scale in [1e-30, 1e18] {
            assert!(Pose { rotation: good.rotation * scale, ..good }.is_pose());
        }
    }
}
