//! Where a motion ends: a location of the path, once every axis is known.

use glam::DQuat;

use super::{Motion, Program};
use crate::machine::{Joints, OutOfTravel};
use crate::pose::Pose;
use crate::toolpath::{Location, MachinePoint, MoveKind};

/// By which coordinates a motion goes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Coordinates {
    /// Those of the program.
    Programs,
    /// The same, while the tool's centre point is kept.
    CentrePoints,
    /// The machine's own: G53 and G28.
    Machines,
}

impl Program<'_> {
    /// A location, once every axis is known.
    pub(super) fn arrive(
        &mut self,
        line: usize,
        joints: Joints,
        motion: Motion,
        by: Coordinates,
    ) -> Result<(), String> {
        let before = std::mem::replace(&mut self.joints, joints);
        self.remark_on_turn(line, &before.rotary);
        let unknown = (0..3).find(|&axis| joints.linear[axis].is_nan()).map(|axis| ['X', 'Y', 'Z'][axis]);
        let rotary = self.machine.map_or(&[][..], |machine| machine.rotary.as_slice());
        let turned =
            rotary.iter().zip(joints.rotary).find(|(_, angle)| angle.is_nan()).map(|(axis, _)| axis.letter);
        if let Some(letter) = turned.or(unknown) {
            self.check_known_axes()?;
            if motion == Motion::Rapid {
                return Ok(());
            }
            return Err(format!(
                "where {letter} stands is not known: write it before the first cut, such as G0 {letter}0."
            ));
        }
        // Before the first tool the spindle goes where it is told, and nothing hangs from it.
        if by == Coordinates::Machines && self.tool.is_none() && self.tool_length().is_err() {
            return self.check_known_axes();
        }
        let length = self.tool_length()?;
        let (pose, machine) = match self.machine {
            Some(machine) => {
                let tip_goes_straight = by == Coordinates::CentrePoints;
                let point = MachinePoint { joints, length, tip_goes_straight, by_spindle: self.z_by_spindle };
                (machine.forward(&joints, length), Some(point))
            }
            None => (Pose::new(joints.linear, DQuat::IDENTITY), None),
        };
        if !pose.is_valid() {
            return Err("a position must be finite".into());
        }
        let kind = match motion {
            _ if self.broken => MoveKind::Start,
            Motion::Rapid => MoveKind::Rapid,
            _ => MoveKind::Feed,
        };
        self.broken = false;
        let goes_home = by == Coordinates::Machines && self.tool.is_none();
        self.homed += usize::from(goes_home && self.path.locations.len() == self.homed);
        self.path.locations.push(Location {
            line,
            pose,
            rolled: machine.is_some(),
            tool: self.tool,
            kind,
            machine,
        });
        Ok(())
    }

    /// The check of the path sees locations alone: what leads out of its range on the way to the first is refused here.
    fn check_known_axes(&self) -> Result<(), String> {
        let Some(machine) = self.machine else { return Ok(()) };
        let Some(out) = machine.all_out_of_travel(&self.joints).find(|out| !out.value.is_nan()) else {
            return Ok(());
        };
        let unit = if "XYZ".contains(out.axis) { format!(" {}", self.reading.unit) } else { "°".into() };
        let end = |end: f64| if end.is_finite() { format!("{end}{unit}") } else { "no limit".into() };
        let OutOfTravel { axis, value, range: [low, high] } = out;
        Err(format!(
            "{axis} would have to be at {value:.3}{unit}, and goes from {} to {}: check the angle, the work offset, the tool's length, and \
             the range that the machine's description gives",
            end(low),
            end(high)
        ))
    }

    /// Angles are followed as they are written; of an axis without ends a control may take the short way.
    fn remark_on_turn(&mut self, line: usize, before: &[f64; 2]) {
        let Some(machine) = self.machine.filter(|_| self.absolute) else { return };
        for (place, axis) in machine.rotary.iter().enumerate() {
            let turn = (self.joints.rotary[place] - before[place]).abs();
            if turn > 180.0 && axis.range.iter().any(|end| end.is_infinite()) {
                self.remark(
                    line,
                    "turns",
                    &format!(
                        "{} turns by {}° as written; a control whose axis rolls over takes the short way, so check its settings",
                        axis.letter,
                        (turn * 1e6).round() / 1e6
                    ),
                );
            }
        }
    }
}
