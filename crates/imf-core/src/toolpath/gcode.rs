//! Programs in G-code, for three axes without a machine and for any axes with one.
//!
//! Read are G0 to G3 (arcs and helices by chords, G17 to G19, centres from the start or radii), drilling cycles, G4, G20
//! and G21 (G70 and G71), G28, G30 and G53, G43 with G49, G43.4 and G234 (tool centre point control), G54 to G59, G90 and
//! G91, T with M6, words that move nothing, and words that smooth corners and M words of the machine's own, which get a
//! remark. Every other word is refused with its line, and so are anything after the end of the program, and a last line
//! that may have been cut. A program without an end gets a remark.
//!
//! Without a machine X, Y and Z are the tip's and the tool stands along +z; while no tool length is in force (after
//! G49, M6 and D0, before the first G43 of a program) Z must not move, and where G28 and G53 lead is not known; a
//! program without any gets the remark that Z is taken for the tip's. With a machine, and under tool centre point
//! control, they are the tip's in the frame that turns with the part, and the tip goes straight there; otherwise they
//! move the linear axes: with a tool length (G43) they are where the tip would be with the head upright, in the work
//! offset that does not turn. Angles are followed as they are written: from C350 to C10 is 340° back, and gets a
//! remark.

mod after_end;
mod arc;
mod block;
mod coordinates;
mod cycle;
mod length;
mod remarks;
mod unchecked;
mod words;

use glam::DVec3;

use super::error::Fault;
use super::{PathReading, Toolpath};
use crate::machine::{Joints, Machine};
use arc::Arc;
use block::Block;
pub(super) use block::STILL_M;
use cycle::Cycle;
use unchecked::Unchecked;
pub(super) use words::is_program;

/// The remark on a program that may have been cut between two lines.
const NO_END: &str = "the program stops here without M30, M2 or a closing '%': if it was cut short, what is missing is not checked";

/// How a block's X, Y and Z move the tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    Rapid,
    Feed,
    Clockwise,
    CounterClockwise,
}

/// The modal state. Unknown values are NaN.
#[derive(Default)]
struct Program<'a> {
    reading: PathReading<'a>,
    machine: Option<&'a Machine>,
    path: Toolpath,
    motion: Option<Motion>,
    /// In force in place of a motion.
    cycle: Option<Cycle>,
    /// A cycle ends where it began (G98), or at its R (G99), if it is said.
    returns: Option<bool>,
    /// Places of the plane's axes and of its normal.
    plane: [usize; 3],
    absolute: bool,
    /// From the program's unit; `None` while it is not said.
    factor: Option<f64>,
    offset: u8,
    /// A tool length is in force.
    length: bool,
    /// One has been.
    has_used_length: bool,
    /// The first line in which Z moved while none was in force.
    z_without_length: Option<usize>,
    /// Z is the spindle's, whatever the tool's length: since G53 or G28, up to a coordinate of the program.
    z_by_spindle: bool,
    /// Number of locations while all of them are by G53 and G28 before any tool.
    homed: usize,
    /// D has named a tool's edge.
    has_used_edge: bool,
    /// The number of the last H since the tool changed.
    length_number: Option<u32>,
    /// The edge that D names, and the one with which this tool moved before.
    edge: Option<f64>,
    edge_of_motion: Option<f64>,
    /// Where a tool moves with another edge than before, and both.
    edge_change: Option<(usize, f64, f64)>,
    /// The word that has ended a tool length, while none is in force again.
    ended_by: Option<&'static str>,
    /// The tool's centre point is kept.
    centre_point: bool,
    /// While it is: the coordinates that the program has said, which the axes do not determine while one of them is
    /// unknown.
    kept: DVec3,
    tool: Option<u32>,
    /// The last T, with its line.
    called: Option<(usize, u32)>,
    /// A T to which no M6 has changed yet, with its line, and whether the tool has moved since.
    waiting: Option<(usize, u32, bool)>,
    /// The first tool.
    first_tool: Option<u32>,
    /// The only tool of a program without M6.
    only_tool: Option<u32>,
    /// The next location starts a new stretch: its approach is unknown.
    broken: bool,
    joints: Joints,
    unchecked: Unchecked,
    chords_left: usize,
    /// By how much corners are rounded at most, in the program's unit.
    rounded: f64,
    /// What has been remarked, by a word for it.
    remarked: Vec<&'static str>,
    /// M words that are not known, and have been remarked.
    unknown_m: Vec<u32>,
    /// A `%` or a word has been read.
    has_begun: bool,
    /// G90 or G91 has been read.
    positioning_is_said: bool,
    /// The line in which the program ends.
    end: Option<usize>,
}

pub(super) fn parse(text: &str, reading: &PathReading<'_>) -> Result<Toolpath, Fault> {
    let axes = reading.machine.map_or(0, |machine| machine.rotary.len());
    let mut program = Program {
        reading: *reading,
        machine: reading.machine,
        plane: [0, 1, 2],
        absolute: true,
        offset: 54,
        kept: DVec3::NAN,
        broken: true,
        joints: Joints {
            linear: DVec3::NAN,
            rotary: [0, 1].map(|place| if place < axes { f64::NAN } else { 0.0 }),
        },
        chords_left: arc::most_chords(text.len()),
        ..Program::default()
    };
    program.only_tool = only_tool(text);
    for (index, text) in text.lines().enumerate() {
        program.take_line(index + 1, text).map_err(|fault| fault.on_line(index + 1))?;
    }
    if program.end.is_none() {
        Fault::refuse_cut(text, words::ends_in_word)?;
    }
    if let (None, Some((line, number))) = (program.tool, program.called) {
        let what = format!("T{number} calls a tool, and no M6 changes to it: write M6 after each T");
        return Err(Fault::from(what).on_line(line));
    }
    program.remark_on_call();
    program.check_said()?;
    program.remark_on_length();
    program.remark_on_edges();
    program.give_up_waiting(false);
    program.remark_on_unchecked();
    if program.end.is_none() {
        program.remark(text.lines().count(), "end", NO_END);
    }
    Ok(program.path)
}

/// The tool of a program that calls one number alone, and has no M6.
fn only_tool(text: &str) -> Option<u32> {
    let mut called = None;
    for line in text.lines() {
        for word in words::words(line).unwrap_or_default() {
            match word.letter {
                'M' if word.value == 6.0 => return None,
                'T' if called.is_some_and(|known| known != word.value) => return None,
                'T' => called = Some(word.value),
                _ => {}
            }
        }
    }
    called.map(|number| number as u32)
}

impl Program<'_> {
    fn take_line(&mut self, line: usize, text: &str) -> Result<(), Fault> {
        if let Some(end) = self.end {
            // Comments and names may follow, but nothing that would seem to have been checked.
            if after_end::is_command(text) {
                return Err(format!(
                    "it stands after the end of the program in line {end}: give each program a file of its own, or take out what does not run"
                )
                .into());
            }
            return Ok(());
        }
        let words = words::words(text).map_err(|wrong| match text.contains(words::KLARTEXT) {
            true => "Heidenhain's Klartext is not read: let the CAM program write ISO G-code or APT".into(),
            false => wrong,
        })?;
        // The first sign begins the program, unless something stands before it.
        let is_sign = words::is_sign(text);
        let ends = is_sign && self.has_begun;
        self.has_begun |= is_sign || !words.is_empty();
        let block = Block::new(&words, self.machine, self.cycle.is_some())?;
        self.take(line, &block)?;
        self.end = (ends || block.ends).then_some(line);
        Ok(())
    }

    fn take(&mut self, line: usize, block: &Block) -> Result<(), Fault> {
        self.remark_on_idle(line, block);
        if let Some(number) = block.tool {
            if !block.changes_tool {
                self.remark_on_call();
                self.waiting =
                    Some((line, number, false)).filter(|_| self.tool.is_some_and(|own| own != number));
            }
            self.called = Some((line, number));
        }
        if block.changes_tool {
            self.waiting = None;
            self.change_tool()?;
        } else if block.tool.is_some() && self.only_tool == block.tool && self.tool.is_none() {
            self.remark(
                line,
                "call",
                "no M6 changes to the only tool that is called: it is taken to be in the spindle from here",
            );
            self.change_tool()?;
        }
        self.first_tool = self.first_tool.or(self.tool);
        self.plane = block.plane.unwrap_or(self.plane);
        if let Some(mm) = block.unit_in_mm {
            self.factor = Some(mm / self.reading.unit.in_mm());
            self.path.states_unit = true;
        }
        if let Some(offset) = block.offset {
            self.set_offset(offset)?;
        }
        self.absolute = block.absolute.unwrap_or(self.absolute);
        self.positioning_is_said |= block.absolute.is_some();
        self.take_length(line, block)?;
        self.take_motion(block);
        if block.rounds {
            self.round_corners(line, block);
        }
        if block.smooths {
            self.remark(
                line,
                "smooths",
                "the control may leave the path at corners, by how much is not said: it is followed as written, so ask for clearance",
            );
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
        if !self.positioning_is_said && !block.in_machine_coordinates {
            self.remark(
                line,
                "positioning",
                "the program moves without G90 or G91: its coordinates are taken to be absolute",
            );
        }
        if self.machine.is_none() && self.offset != 54 {
            let text = format!(
                "the zero of {} is taken to be the part's: no machine says where it lies",
                block::offset_word(self.offset)
            );
            self.remark(line, "offset", &text);
        }
        self.note_edge(line);
        if let Some((.., has_moved)) = &mut self.waiting {
            *has_moved = true;
        }
        match block.home {
            Some(word) => self.go_home(line, block, word),
            None if block.in_machine_coordinates => self.go_in_machine_coordinates(line, block),
            None if block.drills => self.drill(line, block),
            None => self.go(line, block),
        }?;
        self.take_axes(line, block);
        Ok(())
    }

    fn go(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let motion = self.motion.ok_or("axes move, and none of G0, G1, G2 and G3 says how")?;
        self.check_length(line, block.linear[2].is_some())?;
        self.z_by_spindle &= block.linear[2].is_none();
        let is_arc = matches!(motion, Motion::Clockwise | Motion::CounterClockwise);
        if !is_arc && (block.centre.is_some() || block.radius.is_some()) {
            return Err("I, J, K and R belong to an arc (G2, G3), and this is not one".into());
        }
        let (to, rotary) = self.target(block)?;
        match motion {
            Motion::Rapid | Motion::Feed => {
                if motion == Motion::Rapid {
                    self.remark_on_rapid(line, block);
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
}

#[cfg(test)]
mod call_tests;
#[cfg(test)]
mod tests;
