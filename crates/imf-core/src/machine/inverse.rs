//! From directions to rotary angles: both branches, every turn within the ranges, and the pole where an angle is free.

use glam::DVec3;

use super::{Joints, Machine, SLACK, Side};
use crate::pose::Pose;

/// All angles that give the tool a direction.
#[derive(Clone, Debug, PartialEq)]
pub struct RotarySolutions {
    /// In the order of [`Machine::rotary`], the preferred branch first, then by how far the axes are from 0.
    pub angles: Vec<[f64; 2]>,
    /// Place of the axis whose angle is free (the pole: it turns the tool about the tool's own axis). In `angles` it
    /// stands as near to 0 as its range allows.
    pub free: Option<usize>,
}

/// Why a pose has no angles.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoAngles {
    /// No angles within the ranges give this direction.
    #[error("no angles within the ranges of the machine's axes turn the tool along {0:.6},{1:.6},{2:.6}")]
    OutOfReach(f64, f64, f64),
    /// The pose is invalid.
    #[error("the pose is invalid: a number is not finite, or the rotation has no length")]
    InvalidPose,
}

/// Directions this near to an axis of rotation, or to those that an axis alone gives, are taken for them: files give six digits.
const POLE: f64 = 2e-6;
/// Degrees outside a range that are taken for its end, for the same reason.
const END: f64 = 1e-4;

impl Machine {
    /// Rotary axes from the part to the tool: places, and how a positive angle turns the tool as seen from the part.
    pub(super) fn tool_sided(&self) -> Vec<(usize, f64)> {
        let table = self.chain(Side::Table).rev().map(|(place, _)| (place, -1.0));
        table.chain(self.chain(Side::Head).map(|(place, _)| (place, 1.0))).collect()
    }

    /// Every pair of angles within the ranges that turns the tool's axis along a direction in the part's frame, of any length but 0.
    /// None at all where the machine does not reach it.
    #[must_use]
    pub fn inverse(&self, direction: DVec3) -> RotarySolutions {
        let Some(direction) = direction.try_normalize() else {
            return RotarySolutions { angles: Vec::new(), free: None };
        };
        let mut free = None;
        // d = P(α) Q(β) z, with P next to the part.
        let raw: Vec<[f64; 2]> = match self.tool_sided().as_slice() {
            [] if along(direction, DVec3::Z) => vec![[0.0; 2]],
            &[(place, sign)] => {
                let axis = self.rotary[place].direction;
                if (axis.dot(direction) - axis.z).abs() > POLE {
                    Vec::new()
                } else if along(DVec3::Z, axis) || along(DVec3::Z, -axis) {
                    free = Some(place);
                    vec![[0.0; 2]]
                } else {
                    let mut pair = [0.0; 2];
                    pair[place] = sign * about(axis, DVec3::Z, direction);
                    vec![pair]
                }
            }
            &[(first, p_sign), (second, q_sign)] => {
                let (p, q) = (self.rotary[first].direction, self.rotary[second].direction);
                let is_pole = along(direction, p) || along(direction, -p);
                let found = between(p, q, direction, is_pole).into_iter().map(|w| {
                    let alpha = if is_pole { 0.0 } else { p_sign * about(p, w, direction) };
                    let mut pair = [0.0; 2];
                    (pair[first], pair[second]) = (alpha, q_sign * about(q, DVec3::Z, w));
                    pair
                });
                if is_pole {
                    free = Some(first);
                }
                found.collect()
            }
            _ => Vec::new(),
        };
        let mut angles: Vec<[f64; 2]> = raw.into_iter().flat_map(|pair| self.turns(pair, free)).collect();
        let cost = |pair: &[f64; 2]| {
            let preferred = self.preferred.is_none_or(|branch| {
                let right = |angle: &f64| if branch.positive { *angle >= -SLACK } else { *angle <= SLACK };
                pair.get(branch.axis).is_none_or(right)
            });
            (u8::from(!preferred), pair[0].abs() + pair[1].abs())
        };
        angles.sort_by(|a, b| cost(a).0.cmp(&cost(b).0).then(cost(a).1.total_cmp(&cost(b).1)));
        angles.dedup_by(|a, b| (0..2).all(|i| (a[i] - b[i]).abs() < 1e-6));
        RotarySolutions { angles, free }
    }

    /// A pair of angles and all whole turns of it within the ranges.
    fn turns(&self, pair: [f64; 2], free: Option<usize>) -> Vec<[f64; 2]> {
        let of = |place: usize| -> Vec<f64> {
            let Some(axis) = self.rotary.get(place) else { return vec![0.0] };
            let [low, high] = axis.range;
            if (low..=high).is_empty() {
                return Vec::new();
            }
            if free == Some(place) {
                return vec![0.0_f64.clamp(low, high)];
            }
            // Without limits two turns either way are listed.
            let (low, high) = (low.max(pair[place] - 720.0), high.min(pair[place] + 720.0));
            let first = ((low - END - pair[place]) / 360.0).ceil() as i64;
            let last = ((high + END - pair[place]) / 360.0).floor() as i64;
            (first..=last).map(|turn| (pair[place] + 360.0 * turn as f64).clamp(low, high)).collect()
        };
        let second = of(1);
        of(0).into_iter().flat_map(|a| second.iter().map(move |&b| [a, b])).collect()
    }

    /// The joints of a pose in the part's frame: of all solutions the one nearest to the current angles, the first
    /// one where those are unknown; a free angle stays where it is. The pose's roll about the tool's axis is ignored:
    /// the machine determines it.
    ///
    /// # Errors
    /// An invalid pose, a direction that the ranges do not allow.
    pub fn joints(&self, pose: &Pose, length: f64, from: Option<&Joints>) -> Result<Joints, NoAngles> {
        let direction = pose.axis().ok_or(NoAngles::InvalidPose)?;
        let mut found = self.inverse(direction);
        if let Some(from) = from {
            if let Some(place) = found.free {
                found.angles.iter_mut().for_each(|pair| pair[place] = from.rotary[place]);
            }
            // Of an axis without a limit the turn that is nearest.
            for pair in &mut found.angles {
                for (place, axis) in self.rotary.iter().enumerate() {
                    let turns = ((from.rotary[place] - pair[place]) / 360.0).round();
                    let near = pair[place] + 360.0 * turns;
                    if (axis.range[0]..=axis.range[1]).contains(&near) {
                        pair[place] = near;
                    }
                }
            }
            let turned =
                |pair: &[f64; 2]| (pair[0] - from.rotary[0]).abs().max((pair[1] - from.rotary[1]).abs());
            found.angles.sort_by(|a, b| turned(a).total_cmp(&turned(b)));
        }
        let rotary =
            *found.angles.first().ok_or(NoAngles::OutOfReach(direction.x, direction.y, direction.z))?;
        Ok(Joints { linear: self.linear(pose.position, &rotary, length), rotary })
    }
}

fn along(one: DVec3, other: DVec3) -> bool {
    one.distance(other) < POLE
}

/// The angle in degrees by which one vector turns into another about an axis; both as far along it.
fn about(axis: DVec3, from: DVec3, to: DVec3) -> f64 {
    let (from, to) = (from - axis * axis.dot(from), to - axis * axis.dot(to));
    axis.dot(from.cross(to)).atan2(from.dot(to)).to_degrees()
}

/// Unit vectors that z turns into about q, and that turn into `d` about p: up to two, one at the pole.
fn between(p: DVec3, q: DVec3, d: DVec3, is_pole: bool) -> Vec<DVec3> {
    let (cosine, cross) = (p.dot(q), p.cross(q));
    let squared = cross.length_squared();
    let (of_p, of_q) = (p.dot(d), q.z);
    let (x, y) = ((of_p - cosine * of_q) / squared, (of_q - cosine * of_p) / squared);
    let rest = 1.0 - (x * x + y * y + 2.0 * x * y * cosine);
    // Parallel axes have none. At the end of the reach the two branches meet; rounding is not a reason to miss it.
    if squared == 0.0 || rest < -1e-12 {
        return Vec::new();
    }
    let out = (rest.max(0.0) / squared).sqrt();
    let foot = p * x + q * y;
    if is_pole { vec![foot.normalize()] } else { vec![foot + cross * out, foot - cross * out] }
}
