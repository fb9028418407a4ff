//! A pose of the tool: where its tip is and how it is turned.

use glam::{DMat3, DQuat, DVec3};

use crate::orientation::Orientation;

/// Where the tool's tip is, in the scene's unit and world frame, and how the tool is turned: from the tool's frame (tip at
/// the origin, axis +z from tip to holder) into the world.
///
/// The roll about the tool's own axis does not matter for tools of revolution. A quaternion of any length but 0 is taken as its
/// direction. A pose with a number that is not finite, or a quaternion of no length, is *invalid*: its value is NaN, and it
/// is never free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World position of the tip.
    pub position: DVec3,
    /// Rotation from the tool's frame to the world.
    pub rotation: DQuat,
}

/// Components of an axis below this are 0, so that axes along the grid keep to it.
const NEGLIGIBLE: f64 = 1e-12;

impl Pose {
    /// A tip and a rotation.
    #[must_use]
    pub const fn new(position: DVec3, rotation: DQuat) -> Self {
        Self { position, rotation }
    }

    /// A tip and the direction of the tool's axis from tip to holder, of any length but 0; no roll, as
    /// [`Orientation::from_direction`].
    #[must_use]
    pub fn along(position: DVec3, axis: DVec3) -> Self {
        let rotation = Orientation::from_direction(axis).map_or(DQuat::NAN, |o| o.quaternion());
        Self { position, rotation }
    }

    /// A tip and an orientation by angles.
    #[must_use]
    pub fn oriented(position: DVec3, orientation: &Orientation) -> Self {
        Self { position, rotation: orientation.quaternion() }
    }

    /// Unit vector from tip to holder; `None` for an invalid pose.
    #[inline]
    #[must_use]
    pub fn axis(&self) -> Option<DVec3> {
        if self.position.is_finite() { axis_of(self.rotation) } else { None }
    }

    /// The pose at a fraction of the way to another, from 0 to 1: the tip goes along the line and the axis along the great
    /// circle, both evenly, without roll. `None` where a pose is invalid, or the axes are opposite.
    #[must_use]
    pub fn interpolate(&self, to: &Self, fraction: f64) -> Option<Self> {
        let motion = StraightMotion::new((self.position, self.axis()?), (to.position, to.axis()?))?;
        let (position, axis) = motion.at(fraction);
        Some(Self::along(position, axis))
    }

    /// True where every number is finite and the quaternion has a length.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.axis().is_some()
    }

    /// The orientation by angles; NaN for an invalid rotation.
    #[must_use]
    pub fn orientation(&self) -> Orientation {
        Orientation::from_rotation(&DMat3::from_quat(self.rotation.normalize()))
    }
}

/// The straight motion between two poses: the tip goes along the line and the axis along the great circle, both evenly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StraightMotion {
    /// Tip and axis.
    from: (DVec3, DVec3),
    to: (DVec3, DVec3),
    /// Between the axes, in radians.
    angle: f64,
}

impl StraightMotion {
    /// `None` for axes that are opposite to a thousandth of a degree: which way the tool turns is not defined.
    pub(crate) fn new(from: (DVec3, DVec3), to: (DVec3, DVec3)) -> Option<Self> {
        let angle = from.1.cross(to.1).length().atan2(from.1.dot(to.1));
        (angle <= std::f64::consts::PI - 1.7e-5).then_some(Self { from, to, angle })
    }

    /// Upper bound of how far any point of a tool moves whose points are at most `reach` away from its tip.
    pub(crate) fn farthest(&self, reach: f64) -> f64 {
        self.from.0.distance(self.to.0) + self.angle * reach
    }

    /// Tip and axis at a fraction of the way.
    pub(crate) fn at(&self, fraction: f64) -> (DVec3, DVec3) {
        let position = self.from.0.lerp(self.to.0, fraction);
        let axis = if self.angle < 1e-9 {
            self.to.1
        } else {
            let weights = [((1.0 - fraction) * self.angle).sin(), (fraction * self.angle).sin()];
            (self.from.1 * weights[0] + self.to.1 * weights[1]).normalize_or(self.to.1)
        };
        (position, axis)
    }
}

/// The tool's axis from tip to holder of a quaternion of any length; `None` where it has none.
#[doc(hidden)]
#[inline]
#[must_use]
pub fn axis_of(rotation: DQuat) -> Option<DVec3> {
    let DQuat { x, y, z, w } = rotation;
    let squared = x * x + y * y + z * z + w * w;
    if !(squared > 0.0 && squared.is_finite()) {
        return None;
    }
    let axis = DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w + z * z - x * x - y * y);
    let axis = (axis / squared).map(|v| if v.abs() < NEGLIGIBLE { 0.0 } else { v });
    Some(axis / axis.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::OrientationSet;

    #[test]
    fn poses_keep_the_axis_of_their_orientation() {
        let mut all = OrientationSet::parse("random:300:2").unwrap().orientations;
        all.extend(OrientationSet::parse("so3:100").unwrap().orientations);
        all.extend(OrientationSet::parse("grid:15").unwrap().orientations);
        for orientation in all {
            let pose = Pose::oriented(DVec3::new(1.0, 2.0, 3.0), &orientation);
            let axis = pose.axis().unwrap();
            assert!((axis - orientation.direction()).length() < 1e-15, "{orientation:?}");
            // An axis that keeps to the grid does so by either way.
            let zeros = |v: DVec3| v.to_array().map(|c| c == 0.0);
            assert_eq!(zeros(axis), zeros(orientation.direction()), "{orientation:?}");
            assert!((pose.orientation().direction() - orientation.direction()).length() < 1e-12);
            let same = Pose::along(pose.position, axis * 3.0);
            assert!((same.axis().unwrap() - axis).length() < 1e-15);
            let longer = Pose { rotation: pose.rotation * 7.0, ..pose };
            assert!((longer.axis().unwrap() - axis).length() < 1e-15);
        }
    }

    #[test]
    fn axes_of_the_grid_stay_what_they_are() {
        for axis in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(Pose::along(DVec3::ZERO, axis).axis(), Some(axis));
            let arc = DQuat::from_rotation_arc(DVec3::Z, axis);
            assert_eq!(Pose::new(DVec3::ZERO, arc).axis(), Some(axis));
        }
    }

    #[test]
    fn motions_go_straight_and_turn_evenly() {
        let (from, to) = ((DVec3::ZERO, DVec3::Z), (DVec3::new(4.0, 0.0, 2.0), DVec3::X));
        let motion = StraightMotion::new(from, to).unwrap();
        let (position, axis) = motion.at(0.5);
        assert!((position - DVec3::new(2.0, 0.0, 1.0)).length() < 1e-12);
        assert!((axis - DVec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-12);
        let (_, third) = motion.at(1.0 / 3.0);
        assert!((third.z - 30f64.to_radians().cos()).abs() < 1e-12);
        assert!((motion.farthest(10.0) - 20f64.sqrt() - 5.0 * std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(motion.at(1.0), to);

        let (a, b) = (Pose::along(from.0, from.1), Pose::along(to.0, to.1));
        let middle = a.interpolate(&b, 0.5).unwrap();
        assert!((middle.position - position).length() < 1e-12);
        assert!((middle.axis().unwrap() - axis).length() < 1e-12);
        assert_eq!(a.interpolate(&Pose::along(DVec3::ZERO, DVec3::NEG_Z), 0.5), None);
        assert_eq!(a.interpolate(&Pose::along(DVec3::NAN, DVec3::X), 0.5), None);
    }

    #[test]
    fn invalid_poses_say_so() {
        let good = Pose::along(DVec3::ONE, DVec3::X);
        assert!(good.is_valid());
        for bad in [
            Pose { position: DVec3::new(0.0, f64::NAN, 0.0), ..good },
            Pose { position: DVec3::new(f64::INFINITY, 0.0, 0.0), ..good },
            Pose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
            Pose { rotation: DQuat::from_xyzw(0.0, f64::NAN, 0.0, 1.0), ..good },
            Pose { rotation: DQuat::from_xyzw(0.0, f64::INFINITY, 0.0, 1.0), ..good },
            Pose::along(DVec3::ONE, DVec3::ZERO),
            Pose::along(DVec3::ONE, DVec3::NAN),
            Pose::oriented(DVec3::ONE, &Orientation::new(f64::NAN, 0.0)),
            Pose::oriented(DVec3::ONE, &Orientation::new(0.0, f64::INFINITY)),
        ] {
            assert!(!bad.is_valid() && bad.axis().is_none(), "{bad:?}");
        }
        // Very short and very long quaternions.
        for scale in [1e-150, 1e150] {
            assert!(Pose { rotation: good.rotation * scale, ..good }.is_valid());
        }
    }
}
