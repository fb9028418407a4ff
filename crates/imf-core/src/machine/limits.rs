//! A machine's rotary axes as limits on directions.

use glam::DVec3;

use super::Machine;
use crate::orientation::{Limits, TiltingAxis};

/// Axes this near to x, y or z are along it.
const ALONG: f64 = 1e-9;
/// The angle in degrees that stands for a rotary axis without a limit: every direction is within a turn either way.
const UNLIMITED: f64 = 360.0;

/// The directions that two rotary axes give the tool, and which axes these are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// The directions, in the part's frame.
    pub limits: Limits,
    /// The tilting and the turning axis, where there are such: its letter, and 1 or −1 by which the angles of `limits` are to be
    /// multiplied to be the machine's.
    pub axes: [Option<(char, f64)>; 2],
}

impl From<Limits> for AxisLimits {
    /// A machine whose angles are those of the limits.
    fn from(limits: Limits) -> Self {
        let axes = match limits {
            Limits::Cone { .. } => [None; 2],
            Limits::Rotary { tilting: TiltingAxis::A, .. } => [Some(('A', 1.0)), Some(('C', 1.0))],
            Limits::Rotary { tilting: TiltingAxis::B, .. } => [Some(('B', 1.0)), Some(('C', 1.0))],
        };
        Self { limits, axes }
    }
}

impl Machine {
    /// The directions that its rotary axes give the tool in the part's frame; `None` where limits have no words for them: the axis
    /// next to the part must turn about z and the other one tilt about x or y, or a single axis do either.
    #[must_use]
    pub fn limits(&self) -> Option<AxisLimits> {
        let along = |place: usize, axis: DVec3| {
            let cosine = self.rotary[place].direction.dot(axis);
            (cosine.abs() > 1.0 - ALONG).then_some(cosine.signum())
        };
        // An axis as the tool turns seen from the part: its range, its letter and its sense.
        let turned = |(place, sign): (usize, f64), axis: DVec3| {
            let sign = sign * along(place, axis)?;
            let [low, high] = self.rotary[place].range.map(|angle| sign * angle.clamp(-UNLIMITED, UNLIMITED));
            Some(([low.min(high), low.max(high)], (self.rotary[place].letter, sign)))
        };
        let tilting = |axis: (usize, f64), turning: Option<([f64; 2], (char, f64))>| {
            let a = turned(axis, DVec3::X).map(|found| (TiltingAxis::A, found));
            let (tilting, (tilt, name)) = a.or_else(|| Some((TiltingAxis::B, turned(axis, DVec3::Y)?)))?;
            let turn = turning.map_or([0.0; 2], |(range, _)| range);
            let axes = [Some(name), turning.map(|(_, name)| name)];
            Some(AxisLimits { limits: Limits::Rotary { tilting, tilt, turn }, axes })
        };
        let upright = AxisLimits::from(Limits::Cone { axis: DVec3::Z, half_angle: 0.0 });
        let about_z = |(place, _): (usize, f64)| along(place, DVec3::Z).is_some();
        match *self.tool_sided().as_slice() {
            [first, second] if !about_z(second) => tilting(second, Some(turned(first, DVec3::Z)?)),
            // A second one about z only turns the tool about itself.
            [first] | [first, _] if !about_z(first) => tilting(first, None),
            [] | [_] | [_, _] => Some(upright),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{axis, fork, head_and_table, machine_of, nutating, trunnion};
    use super::super::{Machine, Side};
    use super::AxisLimits;
    use crate::orientation::{Orientation, OrientationSet};

    #[test]
    fn limits_reach_what_has_angles_and_nothing_else() {
        let narrow = |mut machine: Machine, ranges: &[[f64; 2]]| {
            machine.rotary.iter_mut().zip(ranges).for_each(|(axis, range)| axis.range = *range);
            machine
        };
        let tilting_vise =
            machine_of(vec![axis('A', Side::Table, [-1.0, 0.0, 0.0], [0.0; 3], [-20.0, 90.0])]);
        let turning_table =
            machine_of(vec![axis('C', Side::Table, [0.0, 0.0, 1.0], [0.0; 3], [-20.0, 90.0])]);
        let machines = [
            trunnion(),
            head_and_table(),
            fork(),
            narrow(trunnion(), &[[-30.0, 100.0], [20.0, 130.0]]),
            narrow(head_and_table(), &[[-10.0, 95.0], [-40.0, 70.0]]),
            narrow(fork(), &[[-170.0, 15.0], [-5.0, 60.0]]),
            tilting_vise,
            turning_table,
            machine_of(vec![]),
        ];
        let set = OrientationSet::parse("axes+fibonacci:2000+bc:-90:90:90:90:37:1").unwrap();
        for machine in &machines {
            let AxisLimits { limits, axes } = machine.limits().unwrap();
            let mut reached = 0;
            for direction in set.orientations.iter().map(Orientation::direction) {
                let has_angles = !machine.inverse(direction).angles.is_empty();
                assert_eq!(limits.reach(direction), has_angles, "{limits} {direction} {:?}", machine.rotary);
                reached += usize::from(has_angles);
                // The angles of the limits, in the machine's sense, are among its own.
                if let (Some(found), [Some(tilt), Some(turn)]) = (limits.angles(direction, 1e-9), axes) {
                    let named = |(letter, sign): (char, f64), angle: f64| {
                        (machine.rotary_by_letter(letter).unwrap(), sign * angle)
                    };
                    let expected = [named(tilt, found[0]), named(turn, found[1])];
                    let is_pole = direction.truncate().length() < 1e-9;
                    let same = |pair: &[f64; 2]| {
                        expected.iter().enumerate().all(|(which, &(place, angle))| {
                            let turns = (pair[place] - angle) / 360.0;
                            is_pole && which == 1 || (turns - turns.round()).abs() < 1e-9
                        })
                    };
                    assert!(
                        machine.inverse(direction).angles.iter().any(same),
                        "{limits} {direction} {found:?}"
                    );
                }
            }
            assert!(reached > 0, "{limits}");
        }
        assert_eq!(nutating().limits(), None);
    }
}
