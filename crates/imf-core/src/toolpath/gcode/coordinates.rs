//! From the program's coordinates, and the machine's own (G53 and G28), to the machine's axes and back, and the location that results.

use glam::{DQuat, DVec3};

use super::block::{Block, offset_word};
use super::{Motion, Program};
use crate::machine::{Joints, OutOfTravel};
use crate::pose::Pose;
use crate::toolpath::{Location, MachinePoint, MoveKind};

/// By which coordinates a motion goes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Coordinates {
    /// Those of the program.
    Programs,
    /// The same, while the tool's centre point is kept.
    CentrePoints,
    /// The machine's own: G53 and G28.
    Machines,
}

impl Program<'_> {
    pub(super) fn set_offset(&mut self, offset: u8) -> Result<(), String> {
        let known = match self.machine {
            Some(machine) => machine.offsets.contains_key(&offset),
            // Of one offset alone it does not matter where it lies.
            None => self.offset == offset || self.is_nowhere(),
        };
        if !known {
            return Err(format!(
                "{} is another work offset than that of the part, and where it lies is not known: a machine says so ([offsets])",
                offset_word(offset)
            ));
        }
        let before = self.origin();
        self.offset = offset;
        self.kept += before - self.origin();
        Ok(())
    }

    /// No coordinate has been said that a location has or will have.
    fn is_nowhere(&self) -> bool {
        self.path.locations.is_empty() && (0..3).all(|axis| self.joints.linear[axis].is_nan())
    }

    /// The origin of the program's coordinates in the machine's.
    fn origin(&self) -> DVec3 {
        self.machine
            .map_or(DVec3::ZERO, |machine| machine.offsets.get(&self.offset).copied().unwrap_or(DVec3::NAN))
    }

    /// Where the program's coordinates stand.
    pub(super) fn position(&self) -> Result<DVec3, String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let Some(machine) = self.machine.filter(|_| self.centre_point) else {
            let below = if self.length || self.machine.is_none() { below } else { DVec3::ZERO };
            return Ok(self.joints.linear - self.origin() - below);
        };
        let turned = |place: usize| self.joints.rotary[place] != 0.0;
        if turned(0) || turned(1) || !self.joints.linear.is_nan() {
            let pose = machine.forward(&self.joints, below.z);
            return Ok(self.or_kept(pose.position + machine.part_zero() - self.origin()));
        }
        // With nothing turned one coordinate does not touch another.
        let standing = self.joints.linear - below - self.origin();
        Ok(self.or_kept(standing))
    }

    /// What the axes do not say as long as one of them is unknown, as the program has said it.
    fn or_kept(&self, standing: DVec3) -> DVec3 {
        DVec3::select(standing.is_nan_mask(), self.kept, standing)
    }

    pub(super) fn value(&self, given: f64) -> f64 {
        given * self.factor.unwrap_or(1.0)
    }

    /// Where a block leads: the program's coordinates, and the angles.
    pub(super) fn target(&self, block: &Block) -> Result<(DVec3, [f64; 2]), String> {
        let (mut to, mut rotary) = (self.position()?, self.joints.rotary);
        for axis in 0..3 {
            if let Some(given) = block.linear[axis] {
                let value = self.value(given);
                to[axis] = if self.absolute { value } else { to[axis] + value };
                if to[axis].is_nan() {
                    let letter = ['X', 'Y', 'Z'][axis];
                    return Err(format!(
                        "{letter} is a step (G91) from a place that is not known: give {letter} by G90 before"
                    ));
                }
            }
        }
        for (place, angle) in rotary.iter_mut().enumerate() {
            if let Some(given) = block.rotary[place] {
                *angle = if self.absolute { given } else { *angle + given };
            }
        }
        Ok((to, rotary))
    }

    /// Moves to program coordinates.
    pub(super) fn reach(
        &mut self,
        line: usize,
        to: DVec3,
        rotary: [f64; 2],
        motion: Motion,
    ) -> Result<(), String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let before = self.standing();
        let linear = match self.machine {
            Some(machine) if self.centre_point => {
                self.kept = to;
                machine.linear(to + self.origin() - machine.part_zero(), &rotary, below.z)
            }
            Some(_) if !self.length => to + self.origin(),
            _ => to + self.origin() + below,
        };
        let by = if self.centre_point { Coordinates::CentrePoints } else { Coordinates::Programs };
        self.arrive(line, Joints { linear, rotary }, motion, by)?;
        self.note_motion(line, &before, false);
        Ok(())
    }

    /// G53: the linear axes by the machine's own coordinates.
    pub(super) fn go_in_machine_coordinates(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let motion = self.motion.filter(|motion| matches!(motion, Motion::Rapid | Motion::Feed));
        let motion = motion.ok_or("G53 needs G0 or G1")?;
        if self.centre_point || !self.absolute {
            return Err("G53 is followed by G90 and while no centre point is kept (G49)".into());
        }
        if self.machine.is_none() {
            return self.leave(line, block, "G53");
        }
        let linear = block.linear.map(|given| Some(self.value(given?)));
        self.go_by_machine(line, linear, block.rotary, motion)
    }

    /// G28 or G30: by the place that is given to the reference point, each axis that is named.
    pub(super) fn go_home(&mut self, line: usize, block: &Block, word: &'static str) -> Result<(), String> {
        if self.centre_point {
            return Err(format!("{word} while the tool's centre point is kept: end that with G49 before"));
        }
        if word == "G30" && self.machine.is_some() {
            return Err("G30 goes to a place that the machine's description does not give: write G53".into());
        }
        let named = || block.linear.iter().chain(&block.rotary).flatten();
        if self.absolute && named().count() > 0 || named().any(|&step| step != 0.0) {
            if self.machine.is_none() {
                self.check_length(line, block.linear[2].is_some())?;
            }
            let (to, rotary) = self.target(block)?;
            self.z_by_spindle &= block.linear[2].is_none();
            self.reach(line, to, rotary, Motion::Rapid)?;
        }
        let Some(machine) = self.machine else { return self.leave(line, block, word) };
        let linear = [0, 1, 2].map(|axis| block.linear[axis].map(|_| machine.home[axis]));
        self.go_by_machine(line, linear, block.rotary.map(|given| given.map(|_| 0.0)), Motion::Rapid)
    }

    /// The axes that are named to places in the machine's own coordinates.
    fn go_by_machine(
        &mut self,
        line: usize,
        linear: [Option<f64>; 3],
        rotary: [Option<f64>; 2],
        motion: Motion,
    ) -> Result<(), String> {
        let (before, mut joints) = (self.standing(), self.joints);
        for (axis, place) in linear.into_iter().enumerate() {
            joints.linear[axis] = place.unwrap_or(joints.linear[axis]);
        }
        for (own, angle) in joints.rotary.iter_mut().zip(rotary) {
            *own = angle.unwrap_or(*own);
        }
        self.z_by_spindle |= linear[2].is_some();
        self.arrive(line, joints, motion, Coordinates::Machines)?;
        self.note_motion(line, &before, true);
        Ok(())
    }

    /// Without a machine: the axes that are named, or all, to a place that is not known, and the path begins anew behind it.
    fn leave(&mut self, line: usize, block: &Block, word: &str) -> Result<(), String> {
        self.give_up_waiting(true);
        let all = block.linear == [None; 3];
        for axis in (0..3).filter(|&axis| all || block.linear[axis].is_some()) {
            self.joints.linear[axis] = f64::NAN;
        }
        self.broken = true;
        self.unchecked.said = [false; 5];
        self.remark(
            line,
            "leaves",
            &format!(
                "{word} goes to the machine's own place, which only a machine's description says: the ways there and from there are not checked"
            ),
        );
        Ok(())
    }

    /// A location, once every axis is known.
    fn arrive(&mut self, line: usize, joints: Joints, motion: Motion, by: Coordinates) -> Result<(), String> {
        let before = std::mem::replace(&mut self.joints, joints);
        self.path.states_rapids |= motion == Motion::Rapid;
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
        // Before the first tool the spindle goes where the program says, and nothing hangs from it.
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
