//! A pose of the tool: where its tip is and how it is turned.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::orientation::Orientation;

/// Where the tool's tip is, in the scene's unit and world frame, and how the tool is turned: from the tool's frame (tip at
/// the origin, axis +z from tip to holder) into the world.
///
/// The roll about the tool's own axis does not matter for tools of revolution. A quaternion of any length from 1e-150 to 1e150 is
/// taken as its direction. A pose with a number that is not finite, or another quaternion, is *invalid*: its value is NaN, and it
/// is never free.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// World position of the tip.
    pub position: DVec3,
    /// Rotation from the tool's frame to the world.
    pub rotation: DQuat,
}

/// Components of an axis below this are 0, so that axes along the grid stay on it.
const NEGLIGIBLE: f64 = 1e-12;

/// The square of the shortest length of a quaternion: a shorter one's has lost digits.
const SHORTEST: f64 = 1e-301;

/// A thousandth of a degree.
const SAME: f64 = 1.7e-5;

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

    /// The pose at a fraction of the way to another, from 0 to 1, its ends beyond: the tip goes along the line, and the axis along the great
    /// circle without rolling; the remaining roll is made about the tool's own axis, the shorter way (half a turn counts as
    /// left). All three are linear in `fraction`. `None` where a pose is invalid, the axes are opposite, or
    /// the fraction is not finite.
    #[must_use]
    pub fn interpolate(&self, to: &Self, fraction: f64) -> Option<Self> {
        StraightMotion::new(self, to).filter(|_| fraction.is_finite()).map(|way| way.at(fraction.max(0.0)))
    }

    /// Where the rigid motion takes a pose: both after one another, the inner one first.
    pub(crate) fn of_pose(&self, inner: &Self) -> Self {
        Self { position: self.of_point(inner.position), rotation: self.rotation * inner.rotation }
    }

    /// Where the rigid motion takes a point. The quaternion has length 1.
    pub(crate) fn of_point(&self, point: DVec3) -> DVec3 {
        self.position + self.rotation * point
    }

    /// The rigid motion back. The quaternion has length 1.
    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { position: rotation * -self.position, rotation }
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

/// The straight motion between two poses, by the rule of [`Pose::interpolate`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct StraightMotion {
    from: Pose,
    to: Pose,
    /// The axis turns about this pivot, by `angle` radians.
    pivot: DVec3,
    angle: f64,
    /// About the tool's own axis, in radians, from −π to π.
    roll: f64,
}

impl StraightMotion {
    /// `None` for an invalid pose, and for axes that are opposite to a thousandth of a degree: which way the tool turns is not
    /// defined.
    pub(crate) fn new(from: &Pose, to: &Pose) -> Option<Self> {
        let (one, other) = (from.axis()?, to.axis()?);
        let cross = one.cross(other);
        let angle = cross.length().atan2(one.dot(other));
        if angle > PI - SAME {
            return None;
        }
        let pivot = cross.try_normalize().unwrap_or(DVec3::X);
        let [from, to] = [from, to].map(|pose| Pose { rotation: pose.rotation.normalize(), ..*pose });
        let turned = DQuat::from_axis_angle(pivot, angle) * from.rotation;
        let rest = turned.conjugate() * to.rotation;
        let roll = (2.0 * rest.z.atan2(rest.w)).rem_euclid(TAU);
        // A billionth more than half a turn is still half a turn to the left.
        let roll = if roll > PI + 1e-9 { roll - TAU } else { roll };
        Some(Self { from, to, pivot, angle, roll })
    }

    /// Upper bound of how far any point of a tool moves whose points are at most `reach` away from its tip and, where it is not
    /// round, at most `radius` away from its axis.
    pub(crate) fn motion_bound(&self, reach: f64, radius: f64) -> f64 {
        self.from.position.distance(self.to.position) + self.angle * reach + self.roll.abs() * radius
    }

    /// Upper bound of how far any point of a round body moves that stands about the tool's axis, between two heights above the tip.
    /// Evenly divided times divide it evenly. A body moves little where the tool tips about a point of it.
    pub(crate) fn round_motion_bound(&self, heights: [f64; 2], radius: f64) -> f64 {
        let way = self.to.position - self.from.position;
        // What a height of 1 on the axis does in the middle of the way; before and after it is turned by half the angle at most.
        let tipping = self.at(0.5).axis().map_or(DVec3::ZERO, |axis| self.angle * self.pivot.cross(axis));
        let on_axis =
            |height: f64| (way + height * tipping).length() + 0.5 * self.angle * self.angle * height.abs();
        on_axis(heights[0]).max(on_axis(heights[1])) + self.angle * radius
    }

    /// True where the tool rolls by half a turn, to a thousandth of a degree: which way is not defined.
    pub(crate) fn rolls_over(&self) -> bool {
        self.roll.abs() > PI - SAME
    }

    /// The pose at a fraction of the way.
    pub(crate) fn at(&self, fraction: f64) -> Pose {
        if fraction >= 1.0 {
            return self.to;
        }
        let position = self.from.position.lerp(self.to.position, fraction);
        let mut rotation = self.from.rotation;
        if self.angle > 0.0 {
            rotation = DQuat::from_axis_angle(self.pivot, fraction * self.angle) * rotation;
        }
        if self.roll != 0.0 {
            rotation *= DQuat::from_rotation_z(fraction * self.roll);
        }
        Pose { position, rotation }
    }
}

/// The tool's axis from tip to holder of a quaternion of any length; `None` where it has none.
#[doc(hidden)]
#[inline]
#[must_use]
pub fn axis_of(rotation: DQuat) -> Option<DVec3> {
    let DQuat { x, y, z, w } = rotation;
    let squared = x * x + y * y + z * z + w * w;
    if !(squared > SHORTEST && squared.is_finite()) {
        return None;
    }
    let axis = DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w + z * z - x * x - y * y);
    let axis = (axis / squared).map(|v| if v.abs() < NEGLIGIBLE { 0.0 } else { v });
    Some(axis / axis.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::orientations;

    #[test]
    fn poses_keep_the_axis_of_their_orientation() {
        let mut all = orientations("random:300:2");
        all.extend(orientations("so3:100"));
        all.extend(orientations("grid:15"));
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
        let (a, b) = (Pose::along(DVec3::ZERO, DVec3::Z), Pose::along(DVec3::new(4.0, 0.0, 2.0), DVec3::X));
        let motion = StraightMotion::new(&a, &b).unwrap();
        let middle = a.interpolate(&b, 0.5).unwrap();
        assert_eq!(middle, motion.at(0.5));
        assert!((middle.position - DVec3::new(2.0, 0.0, 1.0)).length() < 1e-12);
        assert!((middle.axis().unwrap() - DVec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-12);
        let third = motion.at(1.0 / 3.0).axis().unwrap();
        assert!((third.z - 30f64.to_radians().cos()).abs() < 1e-12);
        assert!((motion.motion_bound(10.0, 3.0) - 20f64.sqrt() - 5.0 * PI).abs() < 1e-12);
        assert_eq!((motion.at(0.0), motion.at(1.0)), (a, b));
        assert_eq!(a.interpolate(&Pose::along(DVec3::ZERO, DVec3::NEG_Z), 0.5), None);
        assert_eq!(a.interpolate(&Pose::along(DVec3::NAN, DVec3::X), 0.5), None);
        assert_eq!([f64::NAN, f64::INFINITY].map(|fraction| a.interpolate(&b, fraction)), [None; 2]);
    }

    #[test]
    fn no_point_moves_farther_than_is_said_and_the_axis_keeps_to_the_great_circle() {
        let set = orientations("so3:40");
        let points = [DVec3::new(3.0, 0.0, 4.0), DVec3::new(0.0, -3.0, 0.0), DVec3::new(-1.0, 2.0, 4.5)];
        for (i, pair) in set.windows(2).enumerate() {
            let a = Pose::oriented(DVec3::splat(i as f64), &pair[0]);
            let b = Pose::oriented(DVec3::ONE, &pair[1]);
            let motion = StraightMotion::new(&a, &b).unwrap();
            let ends = a.axis().unwrap().cross(b.axis().unwrap());
            let steps = 64;
            let most = motion.motion_bound(5.0, 3.0) / f64::from(steps);
            // Without the roll, which moves nothing of a round body.
            let tipping = StraightMotion { roll: 0.0, ..motion };
            let round = [([4.0, 4.0], 3.0), ([0.0, 0.0], 3.0), ([4.0, 4.5], 5f64.sqrt())];
            let rounds = round.map(|(heights, radius)| motion.round_motion_bound(heights, radius));
            for step in 0..steps {
                let [before, after] = [step, step + 1].map(|s| motion.at(f64::from(s) / f64::from(steps)));
                let place = |pose: &Pose, point: DVec3| pose.position + pose.rotation * point;
                let moved = points.map(|p| place(&before, p).distance(place(&after, p)));
                assert!(moved.into_iter().all(|m| m <= most * (1.0 + 1e-9)), "{moved:?} {most}");
                let [before, after] = [step, step + 1].map(|s| tipping.at(f64::from(s) / f64::from(steps)));
                // The end of a motion is the pose that it was given, rolled.
                for (point, most) in points.into_iter().zip(rounds).filter(|_| step + 1 < steps) {
                    let moved = place(&before, point).distance(place(&after, point));
                    assert!(moved <= most / f64::from(steps) * (1.0 + 1e-9), "{moved} {most}");
                }
                // It does not leave the plane of the two axes.
                assert!(after.axis().unwrap().dot(ends).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_tips_about_a_point_of_itself_moves_little() {
        // The tip goes by 1 while the axis tips back by as much at a height of 50.
        let lean = DVec3::new(-1.0, 0.0, 50.0).normalize();
        let motion =
            StraightMotion::new(&Pose::along(DVec3::ZERO, DVec3::Z), &Pose::along(DVec3::X, lean)).unwrap();
        let at = |height: f64| motion.round_motion_bound([height; 2], 0.0);
        assert!((at(0.0) - 1.0).abs() < 1e-12 && (at(100.0) - 1.0).abs() < 0.03);
        assert!(at(50.0) < 0.03 && motion.motion_bound(100.0, 0.0) > 2.99);
        // Half of what tips is half the angle away from the middle of the way.
        assert!((motion.round_motion_bound([0.0, 100.0], 2.0) - 1.0).abs() < 0.08);
    }

    #[test]
    fn a_roll_goes_the_shorter_way_and_nothing_turns_over_between_neighbouring_axes() {
        let rolled = |roll: f64| Orientation { roll, ..Orientation::new(30.0, 40.0) };
        let middle = |from: f64, to: f64| {
            let [a, b] = [from, to].map(|roll| Pose::oriented(DVec3::ZERO, &rolled(roll)));
            a.interpolate(&b, 0.5).unwrap().orientation().roll
        };
        for (from, to, expected) in
            [(10.0, 50.0, 30.0), (350.0, 30.0, 10.0), (30.0, 350.0, 10.0), (0.0, 180.0, 90.0)]
        {
            assert!((middle(from, to) - expected).abs() < 1e-9, "{from} {to}");
        }
        // Past the pole θ jumps by half a turn, and the roll that undoes it makes a motion that only tilts.
        let a = Pose::oriented(DVec3::ZERO, &Orientation { roll: 180.0, ..Orientation::new(180.0, 1.0) });
        let b = Pose::oriented(DVec3::ZERO, &Orientation::new(0.0, 1.0));
        let motion = StraightMotion::new(&a, &b).unwrap();
        assert!((motion.motion_bound(1.0, 1.0) - 2f64.to_radians()).abs() < 1e-9);
        assert!(
            StraightMotion::new(
                &Pose { rotation: rolled(0.0).quaternion(), ..a },
                &Pose { rotation: rolled(180.0).quaternion(), ..a }
            )
            .unwrap()
            .rolls_over()
        );
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
