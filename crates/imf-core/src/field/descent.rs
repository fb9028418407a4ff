//! The best orientation at a point among all: some of a set, then descent by a field's gradients.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::minimum::{check_minimum, is_better};
use super::{Best, Decision, FieldError, Gradient, PoseField};
use crate::pose::Pose;

/// How the best orientation is searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DescentSettings {
    /// Number of descents: they start from the best of the rotations that are given.
    pub starts: usize,
    /// Gradients of each descent.
    pub steps: usize,
    /// The point of the tool, in its own frame, that stands still while it turns: its tip, or the centre of its ball.
    pub pivot: DVec3,
}

impl Default for DescentSettings {
    fn default() -> Self {
        Self { starts: 4, steps: 30, pivot: DVec3::ZERO }
    }
}

/// The best orientation that was found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BestPose {
    /// The tool's pose, its pivot at the point.
    pub pose: Pose,
    /// The field's value there (a fraction for overlaps, a length for depths); NaN for a point that is not finite.
    pub value: f32,
    /// The decision there.
    pub decision: Decision,
}

/// A descent's first turn and its last, in radians.
const FIRST: f64 = 0.15;
const LAST: f64 = 5e-4;

/// The pose of minimum value with the pivot at a point: the best of the given rotations, then descents from those
/// over all rotations. A pose that is decided free is better than any that is not. [`PoseField::best`] does it for
/// many points over a set alone.
///
/// # Errors
/// No rotation; as the field's.
pub fn best_orientation(
    field: &dyn PoseField,
    point: DVec3,
    rotations: &[DQuat],
    settings: &DescentSettings,
) -> Result<BestPose, FieldError> {
    check_minimum(&[point], rotations, &[Best::NONE])?;
    let at = |rotation: DQuat| {
        let rotation = rotation.normalize();
        Pose::new(point - rotation * settings.pivot, rotation)
    };
    let poses: Vec<Pose> = rotations.iter().map(|&rotation| at(rotation)).collect();
    let (mut values, mut decisions) = (vec![f32::NAN; poses.len()], vec![Decision::Undecided; poses.len()]);
    field.values(&poses, &mut values)?;
    field.classify(&poses, &mut decisions)?;
    let mut order: Vec<usize> = (0..poses.len()).collect();
    order.sort_by(|&a, &b| {
        let not_free = |index: usize| decisions[index] != Decision::Free;
        not_free(a).cmp(&not_free(b)).then(values[a].total_cmp(&values[b]))
    });
    let first = order[0];
    let mut best = BestPose { pose: poses[first], value: values[first], decision: decisions[first] };
    for &start in order.iter().take(settings.starts) {
        let mut here = BestPose { pose: poses[start], value: values[start], decision: decisions[start] };
        let mut angle = FIRST;
        for _ in 0..settings.steps {
            let mut gradient = [Gradient::NAN];
            field.gradients(&[here.pose], &mut gradient)?;
            let downhill = -gradient[0].about(&here.pose, settings.pivot).rotation.as_dvec3();
            let Some(axis) = downhill.try_normalize() else { break };
            // Half as far until it is better.
            let found = loop {
                let pose = at(DQuat::from_axis_angle(axis, angle) * here.pose.rotation);
                let (mut value, mut decision) = ([f32::NAN], [Decision::Undecided]);
                field.values(&[pose], &mut value)?;
                field.classify(&[pose], &mut decision)?;
                if is_better(value[0], decision[0], &known(&here)) {
                    break Some(BestPose { pose, value: value[0], decision: decision[0] });
                }
                angle *= 0.5;
                if angle < LAST {
                    break None;
                }
            };
            let Some(found) = found else { break };
            here = found;
            angle *= 1.5;
        }
        if is_better(here.value, here.decision, &known(&best)) {
            best = here;
        }
    }
    Ok(best)
}

fn known(found: &BestPose) -> Best {
    Best { value: found.value, orientation: 0, decision: found.decision }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::orientation::{Orientation, OrientationSet};
    use crate::section::Quantity;

    /// A smooth field of which everything is known: free where the axis leans no more than so to one side.
    struct Lean {
        towards: DVec3,
        free: f64,
    }

    impl Lean {
        /// Grows with the angle to the best axis, and along x.
        fn value(&self, pose: &Pose) -> f64 {
            1.0 - pose.axis().unwrap().dot(self.towards) + 0.01 * pose.position.x
        }
    }

    impl PoseField for Lean {
        fn quantity(&self) -> Quantity {
            Quantity::Overlap
        }

        fn bounds(&self) -> Option<[DVec3; 2]> {
            None
        }

        fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
            values.iter_mut().zip(poses).for_each(|(value, pose)| *value = self.value(pose) as f32);
            Ok(())
        }

        fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError> {
            for (gradient, pose) in gradients.iter_mut().zip(poses) {
                let axis = pose.axis().unwrap();
                let direction = -(self.towards - axis * axis.dot(self.towards));
                *gradient = Gradient {
                    value: self.value(pose) as f32,
                    position: Vec3::X * 0.01,
                    direction: direction.as_vec3(),
                    rotation: axis.cross(direction).as_vec3(),
                };
            }
            Ok(())
        }

        fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
            for (decision, pose) in decisions.iter_mut().zip(poses) {
                let is_free = pose.axis().unwrap().y >= self.free;
                *decision = if is_free { Decision::Free } else { Decision::Colliding };
            }
            Ok(())
        }

        fn best(&self, _: &[DVec3], _: &[DQuat], _: &mut [Best]) -> Result<(), FieldError> {
            unreachable!()
        }
    }

    #[test]
    fn gradients_about_a_pivot_are_differences_about_it() {
        let field = Lean { towards: DVec3::new(0.6, 0.0, 0.8), free: -2.0 };
        let pivot = DVec3::new(0.5, -0.3, 7.0);
        for orientation in OrientationSet::parse("so3:30").unwrap().orientations {
            let pose = Pose::oriented(DVec3::new(1.0, 2.0, 3.0), &orientation);
            let mut gradient = [Gradient::NAN];
            field.gradients(&[pose], &mut gradient).unwrap();
            let about = gradient[0].about(&pose, pivot);
            let still = pose.position + pose.rotation * pivot;
            for axis in DVec3::AXES {
                let turned = |angle: f64| {
                    let rotation = DQuat::from_axis_angle(axis, angle) * pose.rotation;
                    field.value(&Pose::new(still - rotation * pivot, rotation))
                };
                let slope = (turned(1e-4) - turned(-1e-4)) / 2e-4;
                assert!((slope - about.rotation.as_dvec3().dot(axis)).abs() < 1e-5, "{orientation:?} {axis}");
            }
            let axis = pose.axis().unwrap().as_vec3();
            assert!(about.direction.dot(axis).abs() < 1e-6 && about.position == gradient[0].position);
            assert!(gradient[0].about(&pose, DVec3::ZERO).rotation == gradient[0].rotation);
        }
    }

    #[test]
    fn descent_finds_the_best_of_all_and_stays_free() {
        let towards = DVec3::new(0.3, -0.4, 0.9).normalize();
        let set = OrientationSet::parse("axes").unwrap().orientations;
        let rotations: Vec<DQuat> = set.iter().map(Orientation::quaternion).collect();
        let point = DVec3::new(5.0, 0.0, 1.0);
        for pivot in [DVec3::ZERO, DVec3::Z * 5.0] {
            let settings = DescentSettings { pivot, ..DescentSettings::default() };
            let field = Lean { towards, free: -2.0 };
            let found = best_orientation(&field, point, &rotations, &settings).unwrap();
            let off = found.pose.axis().unwrap().angle_between(towards);
            // With the pivot off the tip the tip moves as well, which shifts the best a little.
            assert!(off < if pivot == DVec3::ZERO { 0.01 } else { 0.1 }, "{off}");
            assert!((found.pose.position + found.pose.rotation * pivot - point).length() < 1e-9);
            // The least of many axes is no better.
            let many = OrientationSet::parse("fibonacci:3000").unwrap().orientations;
            let least = many.iter().map(|o| {
                let rotation = o.quaternion();
                field.value(&Pose::new(point - rotation * pivot, rotation))
            });
            assert!(f64::from(found.value) < least.fold(f64::INFINITY, f64::min) + 1e-4);
            // Of the free ones the best.
            let free = Lean { towards, free: 0.0 };
            let found = best_orientation(&free, point, &rotations, &settings).unwrap();
            assert_eq!(found.decision, Decision::Free);
            assert!(found.pose.axis().unwrap().y >= 0.0 && found.value < 0.3, "{found:?}");
        }
        let none = best_orientation(&Lean { towards, free: 0.0 }, point, &[], &DescentSettings::default());
        assert!(matches!(none, Err(FieldError::Orientations(0))));
    }
}
