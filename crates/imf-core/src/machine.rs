//! Machines of three linear and up to two rotary axes: joints become poses of the tool, and directions become angles.
//!
//! Conventions, all in *machine coordinates*, right-handed, with z from the table into the spindle:
//! - A rotary axis turns what it carries, table or head, by the right-hand rule about its direction, as LinuxCNC's `xyzac-trt` and
//!   `xyzbc-trt` do. A table whose positive angles turn the *tool* right-handed against the part (ISO 841) has the direction
//!   the other way round: `[0, 0, -1]`.
//! - Centres, solids and offsets are where they stand with every axis at 0. The spindle's face, up to where a tool is
//!   described ([`Tool::length`](crate::tool::Tool::length)), has its middle in the origin then, and the tool its tip at
//!   `(0, 0, −length)`.
//! - Axes of one side are listed from the machine's frame outwards: each carries the next one. The part is carried by the last of the
//!   table, the tool by the last of the head.
//! - Linear axes move the head against the table. Which of them moves in truth changes nothing of what is said here.
//! - The part's frame is that of the work offset G54 with the rotary axes at 0: `machine = offset + part`.
//!
//! Angles are degrees, lengths in the machine's unit.

#[cfg(feature = "formats")]
mod file;
mod inverse;
mod limits;
mod motion;
mod solids;

pub use inverse::{NoAngles, RotarySolutions};
pub use limits::AxisLimits;
pub use motion::MachineMotion;
pub(crate) use motion::{Ball, Placement};
pub use solids::{MachineSolid, SolidShape};

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::pose::Pose;
use crate::unit::LengthUnit;

/// Which side of the machine something belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// It carries the part.
    Table,
    /// It carries the tool.
    Head,
}

/// A rotary axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotaryAxis {
    /// Its letter in programs: A, B or C.
    pub letter: char,
    /// What it turns.
    pub side: Side,
    /// Unit vector; positive angles turn right-handed about it.
    pub direction: DVec3,
    /// A point on it.
    pub centre: DVec3,
    /// Smallest and largest angle; infinite without a limit.
    pub range: [f64; 2],
}

/// Of two solutions the one to choose where nothing else decides: an axis at angles of at least 0, or of at most 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PreferredBranch {
    /// Place of the axis.
    pub axis: usize,
    /// True for angles of at least 0.
    pub positive: bool,
}

/// A machine. See the module for its conventions.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Name for people.
    pub name: String,
    /// Unit of every length.
    pub unit: LengthUnit,
    /// Up to two rotary axes, those of one side from the machine's frame outwards.
    pub rotary: Vec<RotaryAxis>,
    /// Smallest and largest position of x, y and z; infinite without a limit.
    pub travel: [[f64; 2]; 3],
    /// Reference point of G28.
    pub home: DVec3,
    /// Which branch of the angles is preferred.
    pub preferred: Option<PreferredBranch>,
    /// Work offsets by number, 54 to 59: where their origins lie. There is one of 54, in whose frame the part lies.
    pub offsets: BTreeMap<u8, DVec3>,
    /// What may be hit, beside tool, part and fixtures.
    pub solids: Vec<MachineSolid>,
}

/// Where every axis stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Joints {
    /// Machine coordinates of the spindle's face, before the head's rotary axes turn it.
    pub linear: DVec3,
    /// Angles in the order of [`Machine::rotary`]; 0 where there is no axis.
    pub rotary: [f64; 2],
}

/// An axis beyond its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfTravel {
    /// X, Y, Z or a rotary axis' letter.
    pub axis: char,
    /// Where it would have to be: the machine's unit for X, Y and Z, degrees for a rotary axis.
    pub value: f64,
    /// Where it can be, in the same unit.
    pub range: [f64; 2],
}

/// Angles and lengths this far outside a range still count as inside: its ends are meant to be reached.
const SLACK: f64 = 1e-7;

impl Machine {
    /// What is wrong with the machine, if anything: axes whose direction is not of length 1, twice of one letter or parallel, ranges the wrong
    /// way round, a preferred branch of no axis, no offset 54. What is asked of such a machine all the same is answered by its first two axes,
    /// and means nothing.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        if self.rotary.len() > 2 {
            return Some(format!("{} rotary axes, of which at most 2 are followed", self.rotary.len()));
        }
        let is_range = |[low, high]: &[f64; 2]| low <= high;
        for (place, axis) in self.rotary.iter().enumerate() {
            let letter = axis.letter;
            if !matches!(letter, 'A' | 'B' | 'C') {
                return Some(format!("a rotary axis is called A, B or C, not {letter}"));
            }
            // Another length would scale all that the axis turns.
            let is_unit = (axis.direction.length() - 1.0).abs() < 1e-9;
            if !is_unit || !axis.centre.is_finite() {
                return Some(format!("the axis {letter} needs a direction of length 1, and a finite centre"));
            }
            if !is_range(&axis.range) {
                return Some(format!(
                    "the range of {letter}, from {} to {}, does not go from a lower to an upper end",
                    axis.range[0], axis.range[1]
                ));
            }
            if self.rotary[..place].iter().any(|other| other.letter == letter) {
                return Some(format!("two rotary axes are called {letter}"));
            }
        }
        if let [one, other] = self.rotary.as_slice()
            && one.direction.cross(other.direction).length() < 1e-6
        {
            return Some("its two rotary axes are parallel".into());
        }
        if let Some(axis) = self.tool_sided().last().map(|&(place, _)| &self.rotary[place])
            && axis.direction.cross(DVec3::Z).length() < 1e-6
            && self.rotary.len() == 2
        {
            let letter = axis.letter;
            return Some(format!("the axis {letter} is the tool's own at 0: it turns the tool nowhere"));
        }
        if let Some(axis) = (0..3).find(|&axis| !is_range(&self.travel[axis])) {
            return Some(format!(
                "the travel of {} does not go from a lower to an upper end",
                ['x', 'y', 'z'][axis]
            ));
        }
        if let Some(PreferredBranch { axis, .. }) =
            self.preferred.filter(|branch| branch.axis >= self.rotary.len())
        {
            return Some(format!(
                "the preferred branch is of rotary axis {axis}, counted from 0, which is not there"
            ));
        }
        (!self.offsets.contains_key(&54))
            .then(|| "it needs the work offset G54: where the part's zero lies".into())
    }

    /// The machine with every length in `unit`.
    #[must_use]
    pub fn in_unit(&self, unit: LengthUnit) -> Self {
        let factor = self.unit.in_mm() / unit.in_mm();
        let rotary =
            self.rotary.iter().map(|axis| RotaryAxis { centre: axis.centre * factor, ..*axis }).collect();
        Self {
            unit,
            rotary,
            travel: self.travel.map(|range| range.map(|v| v * factor)),
            home: self.home * factor,
            offsets: self.offsets.iter().map(|(&number, &offset)| (number, offset * factor)).collect(),
            solids: self.solids.iter().map(|solid| solid.scaled(factor)).collect(),
            ..self.clone()
        }
    }

    /// Where the part's origin lies with the rotary axes at 0.
    #[must_use]
    pub fn part_zero(&self) -> DVec3 {
        self.offsets.get(&54).copied().unwrap_or_default()
    }

    /// Place of the rotary axis of a letter.
    #[must_use]
    pub fn rotary_by_letter(&self, letter: char) -> Option<usize> {
        self.rotary.iter().position(|axis| axis.letter == letter.to_ascii_uppercase())
    }

    /// How many rotary axes a side has.
    #[must_use]
    pub fn axes_of(&self, side: Side) -> usize {
        self.rotary.iter().filter(|axis| axis.side == side).count()
    }

    /// Axes of a side from the machine's frame outwards, with their places.
    pub(crate) fn chain(&self, side: Side) -> impl DoubleEndedIterator<Item = (usize, &RotaryAxis)> {
        self.rotary.iter().enumerate().take(2).filter(move |(_, axis)| axis.side == side)
    }

    /// Where what stands on the first `level` axes of a side is, for each level up to the last: a rigid motion from where it is with
    /// all axes at 0; the head's without the linear axes.
    pub(crate) fn placements(&self, side: Side, rotary: &[f64; 2]) -> [Pose; 3] {
        let mut at = [Pose::new(DVec3::ZERO, DQuat::IDENTITY); 3];
        for (level, (place, axis)) in self.chain(side).enumerate() {
            let turn = DQuat::from_axis_angle(axis.direction, rotary[place].to_radians());
            let about = Pose::new(axis.centre - turn * axis.centre, turn);
            let outer = at[level].of_pose(&about);
            at[level + 1..].fill(outer);
        }
        at
    }

    /// The tool in the part's frame, its tip `length` below the spindle's face; how it is rolled follows the axes.
    #[must_use]
    pub fn forward(&self, joints: &Joints, length: f64) -> Pose {
        let head = self.placements(Side::Head, &joints.rotary)[2];
        let table = self.placements(Side::Table, &joints.rotary)[2];
        let tool = Pose::new(joints.linear + head.of_point(DVec3::new(0.0, 0.0, -length)), head.rotation);
        let Pose { position, rotation } = table.inverse().of_pose(&tool);
        Pose::new(position - self.part_zero(), rotation)
    }

    /// Where a solid of this machine is at these joints: from where it is with all axes at 0, in machine coordinates, to the part's frame.
    #[must_use]
    pub fn place(&self, solid: &MachineSolid, joints: &Joints) -> Pose {
        let own = self.placements(solid.side, &joints.rotary)[solid.level.min(2)];
        let moved = if solid.side == Side::Head { joints.linear } else { DVec3::ZERO };
        let own = Pose::new(own.position + moved, own.rotation);
        let Pose { position, rotation } =
            self.placements(Side::Table, &joints.rotary)[2].inverse().of_pose(&own);
        Pose::new(position - self.part_zero(), rotation)
    }

    /// The linear axes that bring the tip to a position in the part's frame at given angles.
    #[must_use]
    pub fn linear(&self, tip: DVec3, rotary: &[f64; 2], length: f64) -> DVec3 {
        Placement::turned(self, rotary).linear(tip + self.part_zero(), length)
    }

    /// The first axis that is beyond its range, linear ones first.
    #[must_use]
    pub fn out_of_travel(&self, joints: &Joints) -> Option<OutOfTravel> {
        self.all_out_of_travel(joints).next()
    }

    /// Every axis that is beyond its range, linear ones first.
    pub(crate) fn all_out_of_travel(&self, joints: &Joints) -> impl Iterator<Item = OutOfTravel> {
        let linear = ['X', 'Y', 'Z'].into_iter().zip(joints.linear.to_array()).zip(self.travel);
        let linear = linear.filter_map(|((axis, value), range)| beyond(axis, value, range));
        linear.chain(self.turned_too_far(&joints.rotary))
    }

    /// The rotary axes that are beyond their ranges.
    pub(crate) fn turned_too_far(&self, rotary: &[f64; 2]) -> impl Iterator<Item = OutOfTravel> {
        self.rotary.iter().zip(*rotary).filter_map(|(axis, angle)| beyond(axis.letter, angle, axis.range))
    }

    /// How far each linear axis can go, whichever way, before one leaves its travel; below 0 where one has.
    pub(crate) fn room_in_travel(&self, linear: DVec3) -> f64 {
        let room = |(value, [low, high]): (f64, [f64; 2])| (value - low).min(high - value);
        linear.to_array().into_iter().zip(self.travel).map(room).fold(f64::INFINITY, f64::min)
    }
}

fn beyond(axis: char, value: f64, range: [f64; 2]) -> Option<OutOfTravel> {
    let is_within = (range[0] - SLACK..=range[1] + SLACK).contains(&value);
    (!is_within).then_some(OutOfTravel { axis, value, range })
}

#[cfg(test)]
pub(crate) mod tests;
