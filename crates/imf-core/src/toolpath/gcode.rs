//! Programs in G-code, for three axes without a machine and for any axes with one.
//!
//! Read are G0 to G3 (arcs and helices by chords, G17 to G19, centres from the start or radii), G4, G20 and G21, G28 and G53 with a
//! machine, G43 with G49, G43.4 and G234 (the tool's centre point is kept), G54 to G59, G90 and G91, T with M6, and words that move
//! nothing. Every other word is refused with its line.
//!
//! Without a machine X, Y and Z are the tip's and the tool stands along +z. With one, and with the centre point kept, they are the tip's in the
//! frame that turns with the part, and the tip goes straight there; otherwise they move the linear axes: with a tool length (G43) they are where
//! the tip would be with the head upright, in the work offset that does not turn. Angles are followed as they are written: from C350
//! to C10 is 340° back.

mod arc;
mod block;
mod reference;
mod words;

use glam::{DQuat, DVec3};

use super::{LineError, Location, MachinePoint, MoveKind, PathReading, Toolpath};
use crate::machine::{Joints, Machine};
use crate::pose::Pose;
use arc::Arc;
use block::Block;

/// Names of files that are programs, by their ends.
const ENDS: [&str; 9] = ["nc", "gcode", "ngc", "tap", "mpf", "cnc", "eia", "ptp", "iso"];

/// True where a file's name or first word says that it is a program.
pub(super) fn is_program(text: &str, name: &str) -> bool {
    let end = name.rsplit_once('.').map(|(_, end)| end.to_ascii_lowercase());
    let mut lines = text.lines().map(|line| line.trim_start_matches('\u{feff}').trim());
    let first = lines.find(|line| !line.is_empty() && !line.starts_with([';', '#'])).unwrap_or_default();
    end.is_some_and(|end| ENDS.contains(&end.as_str())) || first.starts_with(['%', '(']) || is_address(first)
}

/// A letter and a number, as machines read them.
fn is_address(line: &str) -> bool {
    let mut letters = line.split_whitespace().next().unwrap_or_default().chars();
    let letter = letters.next().is_some_and(|c| c.is_ascii_alphabetic());
    let number = letters.as_str().split(|c: char| c.is_ascii_alphabetic()).next().unwrap_or_default();
    letter && number.parse::<f64>().is_ok()
}

/// How a block's X, Y and Z move the tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    Rapid,
    Feed,
    Clockwise,
    CounterClockwise,
}

/// What has been said so far. What is not known is NaN.
struct Program<'a> {
    reading: PathReading<'a>,
    machine: Option<&'a Machine>,
    path: Toolpath,
    motion: Option<Motion>,
    /// Places of the plane's axes and of its normal.
    plane: [usize; 3],
    absolute: bool,
    /// From the program's unit; `None` while it is not said.
    factor: Option<f64>,
    offset: u8,
    /// A tool length is in force.
    length: bool,
    /// The tool's centre point is kept.
    centre_point: bool,
    tool: Option<u32>,
    /// The last T, with its line.
    called: Option<(usize, u32)>,
    /// The path begins anew.
    broken: bool,
    joints: Joints,
    chords_left: usize,
    /// By how much corners are rounded at most, in the program's unit.
    rounded: f64,
    /// What has been remarked, by a word for it.
    remarked: Vec<&'static str>,
}

pub(super) fn parse(text: &str, reading: &PathReading<'_>) -> Result<Toolpath, LineError> {
    let axes = reading.machine.map_or(0, |machine| machine.rotary.len());
    let mut program = Program {
        reading: *reading,
        machine: reading.machine,
        path: Toolpath::default(),
        motion: None,
        plane: [0, 1, 2],
        absolute: true,
        factor: None,
        offset: 54,
        length: false,
        centre_point: false,
        tool: None,
        called: None,
        broken: true,
        joints: Joints {
            linear: DVec3::NAN,
            rotary: [0, 1].map(|place| if place < axes { f64::NAN } else { 0.0 }),
        },
        chords_left: arc::most_chords(text.len()),
        rounded: 0.0,
        remarked: Vec::new(),
    };
    for (index, line) in text.lines().enumerate() {
        let wrong = |what: String| LineError { line: index + 1, what };
        let words = words::words(line).map_err(wrong)?;
        let block = Block::new(&words, reading.machine).map_err(wrong)?;
        program.take(index + 1, &block).map_err(wrong)?;
        if block.ends {
            break;
        }
    }
    if let (None, Some((line, number))) = (program.tool, program.called) {
        return Err(LineError { line, what: format!("T{number} calls a tool, and no M6 changes to it") });
    }
    Ok(program.path)
}

impl Program<'_> {
    fn take(&mut self, line: usize, block: &Block) -> Result<(), String> {
        if let Some(number) = block.tool {
            self.called = Some((line, number));
        }
        if block.changes_tool {
            self.change_tool()?;
        }
        self.plane = block.plane.unwrap_or(self.plane);
        if let Some(mm) = block.unit_in_mm {
            self.factor = Some(mm / self.reading.unit.in_mm());
        }
        if let Some(offset) = block.offset {
            self.set_offset(offset)?;
        }
        self.absolute = block.absolute.unwrap_or(self.absolute);
        self.take_length(block)?;
        self.motion = block.motion.or(self.motion);
        if block.rounds {
            self.round_corners(line, block);
        }
        if block.dwells || !block.moves() {
            return Ok(());
        }
        if block.has_decimals_missing {
            self.remark(line, "points", "numbers without a decimal point are taken as whole units");
        }
        if self.factor.is_none() {
            let unit = self.reading.unit;
            self.remark(
                line,
                "unit",
                &format!("the program moves without G20 or G21: its unit is taken to be {unit}"),
            );
        }
        match (block.goes_home, block.in_machine_coordinates) {
            (true, _) => self.go_home(line, block),
            (_, true) => self.go_in_machine_coordinates(line, block),
            _ => self.go(line, block),
        }
    }

    /// The path is followed as it is written.
    fn round_corners(&mut self, line: usize, block: &Block) {
        let [p, q] = block.lengths.map(Option::unwrap_or_default);
        if p + q > self.rounded {
            self.rounded = p + q;
            self.path.remarks.push(format!(
                "line {line}: with G64 the control leaves the path by up to {}: it is followed as written, so ask for as much more clearance",
                self.rounded
            ));
        }
    }

    fn remark(&mut self, line: usize, about: &'static str, text: &str) {
        if !self.remarked.contains(&about) {
            self.remarked.push(about);
            self.path.remarks.push(format!("line {line}: {text}"));
        }
    }

    fn change_tool(&mut self) -> Result<(), String> {
        let (_, number) =
            self.called.ok_or("M6 changes the tool, and no T says to which: write T and its number")?;
        if self.centre_point {
            return Err("the tool changes while its centre point is kept: end that with G49 before".into());
        }
        self.tool = Some(number);
        self.length = false;
        // The way to where tools are changed is the machine's own.
        self.joints.linear = DVec3::NAN;
        self.broken = true;
        Ok(())
    }

    fn set_offset(&mut self, offset: u8) -> Result<(), String> {
        let known = match self.machine {
            Some(machine) => machine.offsets.contains_key(&offset),
            // Of one offset alone it does not matter where it lies.
            None => self.offset == offset || self.path.locations.is_empty(),
        };
        if !known {
            return Err(format!(
                "G{offset} is another work offset than that of the part, and where it lies is not known: a machine says so ([offsets])"
            ));
        }
        self.offset = offset;
        Ok(())
    }

    fn take_length(&mut self, block: &Block) -> Result<(), String> {
        let Some(length) = block.length else { return Ok(()) };
        if let (Some(number), Some(tool)) = (block.length_number, self.tool)
            && length.is_some()
            && number != tool
        {
            return Err(format!("H{number} is the length of another tool than T{tool}"));
        }
        let keeps = length == Some(true);
        if keeps && self.machine.is_none_or(|machine| machine.rotary.is_empty()) {
            return Err("it keeps the tool's centre point while rotary axes turn, and no machine with such axes is given".into());
        }
        (self.length, self.centre_point) = (length.is_some(), keeps);
        Ok(())
    }

    /// From the spindle's face to the tip of the tool in use; 0 without a machine, where both are one.
    fn tool_length(&self) -> Result<f64, String> {
        if self.machine.is_none() {
            return Ok(0.0);
        }
        self.reading.length_of(self.tool).ok_or_else(|| match self.tool {
            Some(number) => format!("tool {number} is not given, and its length moves the machine"),
            None => "no tool is called before this motion, and the tools that are given have numbers".into(),
        })
    }

    /// The origin of the program's coordinates in the machine's.
    fn origin(&self) -> DVec3 {
        self.machine
            .map_or(DVec3::ZERO, |machine| machine.offsets.get(&self.offset).copied().unwrap_or(DVec3::NAN))
    }

    /// Where the program's coordinates stand.
    fn position(&self) -> Result<DVec3, String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let Some(machine) = self.machine.filter(|_| self.centre_point) else {
            let below = if self.length || self.machine.is_none() { below } else { DVec3::ZERO };
            return Ok(self.joints.linear - self.origin() - below);
        };
        let turned = |place: usize| self.joints.rotary[place] != 0.0;
        if turned(0) || turned(1) || !self.joints.linear.is_nan() {
            let pose = machine.forward(&self.joints, below.z);
            return Ok(pose.position + machine.part_zero() - self.origin());
        }
        // With nothing turned one coordinate does not touch another.
        Ok(self.joints.linear - below - self.origin())
    }

    fn value(&self, given: f64) -> f64 {
        given * self.factor.unwrap_or(1.0)
    }

    /// Where a block leads: the program's coordinates, and the angles.
    fn target(&self, block: &Block) -> Result<(DVec3, [f64; 2]), String> {
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

    fn go(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let motion = self.motion.ok_or("axes move, and none of G0, G1, G2 and G3 says how")?;
        if let Some(machine) = self.machine
            && !self.length
            && block.linear[2].is_some()
        {
            let more = if machine.rotary.is_empty() { "" } else { ", or G43.4" };
            return Err(format!(
                "Z moves while no tool length is in force: whether it is the tip's or the spindle's is not said (write G43 H{more} before)"
            ));
        }
        let is_arc = matches!(motion, Motion::Clockwise | Motion::CounterClockwise);
        if !is_arc && (block.centre.is_some() || block.radius.is_some()) {
            return Err("I, J, K and R belong to an arc (G2, G3), and this is none".into());
        }
        let (to, rotary) = self.target(block)?;
        match motion {
            Motion::Rapid | Motion::Feed => {
                if motion == Motion::Rapid
                    && !self.broken
                    && block.linear.iter().flatten().count() + block.rotary.iter().flatten().count() > 1
                {
                    self.remark(
                        line,
                        "rapids",
                        "G0 is followed straight: a machine that moves each axis at its own full speed takes another way",
                    );
                }
                self.reach(line, to, rotary, motion)
            }
            Motion::Clockwise | Motion::CounterClockwise => {
                if block.rotary.iter().any(Option::is_some) {
                    return Err(
                        "an arc with a rotary axis is not followed: let the CAM program write G1".into()
                    );
                }
                let from = self.position()?;
                let centre = block.centre.map(|centre| centre.map(|v| self.value(v)));
                let radius = block.radius.map(|radius| self.value(radius));
                let clockwise = motion == Motion::Clockwise;
                if let Some(axis) = (0..3).find(|&axis| from[axis].is_nan()) {
                    return Err(format!("the arc begins where {} is not known", ['X', 'Y', 'Z'][axis]));
                }
                let arc = Arc { from, to, plane: self.plane, clockwise, centre, radius };
                for point in arc.chords(1.0 / self.reading.unit.in_mm(), &mut self.chords_left)? {
                    self.reach(line, point, rotary, motion)?;
                }
                Ok(())
            }
        }
    }

    /// Moves to program coordinates.
    fn reach(&mut self, line: usize, to: DVec3, rotary: [f64; 2], motion: Motion) -> Result<(), String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let linear = match self.machine {
            Some(machine) if self.centre_point => {
                machine.linear(to + self.origin() - machine.part_zero(), &rotary, below.z)
            }
            Some(_) if !self.length => to + self.origin(),
            _ => to + self.origin() + below,
        };
        let straight = self.centre_point;
        self.arrive(line, Joints { linear, rotary }, motion, straight)
    }

    /// A location, once every axis is known.
    fn arrive(&mut self, line: usize, joints: Joints, motion: Motion, straight: bool) -> Result<(), String> {
        self.joints = joints;
        let unknown = (0..3).find(|&axis| joints.linear[axis].is_nan()).map(|axis| ['X', 'Y', 'Z'][axis]);
        let rotary = self.machine.map_or(&[][..], |machine| machine.rotary.as_slice());
        let turned =
            rotary.iter().zip(joints.rotary).find(|(_, angle)| angle.is_nan()).map(|(axis, _)| axis.letter);
        if let Some(letter) = turned.or(unknown) {
            if motion == Motion::Rapid {
                return Ok(());
            }
            return Err(format!(
                "where {letter} stands is not known: write it before the first cut, such as G0 {letter}0."
            ));
        }
        let length = self.tool_length()?;
        let (pose, machine) = match self.machine {
            Some(machine) => {
                let point = MachinePoint { joints, length, tip_goes_straight: straight };
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
}

#[cfg(test)]
mod tests;
