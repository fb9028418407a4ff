//! Motions that are made while some axis has not been said: no location results, so they are reported.
//!
//! Of each axis the first way since the path began leads from a place that is not known; only from the second one on is it a motion of
//! the program.

use glam::DVec3;

use super::Program;
use super::block::Block;
use crate::toolpath::error::Fault;

/// Axes closer than this, in the path's unit or degrees, stand where they stood: sums of offsets round.
const SAME: f64 = 1e-6;

/// Which of five axes are known: X, Y and Z, then the rotary ones.
#[derive(Debug, Default)]
pub(super) struct Unchecked {
    /// Axes stated since the path began anew.
    pub(super) said: [bool; 5],
    /// Axes stated anywhere.
    ever: [bool; 5],
    /// The first line that moves.
    first_motion: Option<usize>,
    /// Lines with motions that are not checked, and whether they only go home before the first tool.
    lines: Vec<(usize, bool)>,
    /// Lines that move a tool since it was changed to, as long as it has reached no place that is known.
    waiting: Vec<usize>,
    /// True behind a way to the machine's own place, which has a remark of its own.
    left: bool,
    /// The axes that were unknown in the first of them, in words.
    unknown: String,
}

/// Where the axes stand in the program's coordinates.
pub(super) type AxisPositions = [f64; 5];

impl Program<'_> {
    pub(super) fn standing(&self) -> AxisPositions {
        let DVec3 { x, y, z } = self.position().unwrap_or(self.joints.linear);
        let [first, second] = self.joints.rotary;
        [x, y, z, first, second]
    }

    /// What a block names is said, though it may stand there already.
    pub(super) fn take_axes(&mut self, line: usize, block: &Block) {
        self.unchecked.first_motion.get_or_insert(line);
        for (axis, given) in block.linear.iter().chain(&block.rotary).enumerate() {
            self.unchecked.said[axis] |= given.is_some();
            self.unchecked.ever[axis] |= given.is_some();
        }
    }

    /// Notes a motion that has just been made from there.
    pub(super) fn note_motion(&mut self, line: usize, before: &AxisPositions, goes_home: bool) {
        let after = self.standing();
        let moves = |axis: usize| {
            before[axis].is_nan() != after[axis].is_nan() || (after[axis] - before[axis]).abs() > SAME
        };
        let again = (0..5).any(|axis| self.unchecked.said[axis] && !before[axis].is_nan() && moves(axis));
        let is_new = self.unchecked.lines.last().is_none_or(|&(last, _)| last != line);
        if again && is_new && before.iter().any(|v| v.is_nan()) {
            if self.unchecked.lines.is_empty() {
                self.unchecked.unknown = self.names(|axis| before[axis].is_nan());
            }
            self.unchecked.lines.push((line, goes_home && self.tool.is_none()));
        }
        for axis in (0..5).filter(|&axis| moves(axis)) {
            self.unchecked.said[axis] = true;
        }
        if !after.iter().any(|v| v.is_nan()) {
            self.unchecked.waiting.clear();
        } else if self.tool.is_some() && !self.unchecked.left {
            self.unchecked.waiting.push(line);
        }
    }

    /// What has moved since the tool was changed to, and reached no place that is known, is not checked: the tool is changed, or goes
    /// home, or the program ends.
    pub(super) fn give_up_waiting(&mut self, left: bool) {
        let standing = self.standing();
        for line in std::mem::take(&mut self.unchecked.waiting) {
            let place = self.unchecked.lines.partition_point(|&(own, _)| own < line);
            if place == 0 {
                self.unchecked.unknown = self.names(|axis| standing[axis].is_nan());
            }
            if self.unchecked.lines.get(place).is_none_or(|&(own, _)| own != line) {
                self.unchecked.lines.insert(place, (line, false));
            }
        }
        self.unchecked.left = left;
    }

    /// Before its first tool a program only goes home, with nothing that could be checked.
    pub(super) fn forget_ways_home(&mut self) {
        self.unchecked.lines.retain(|&(_, goes_home)| !goes_home);
    }

    /// `C stands`, `A and C stand`.
    fn names(&self, is_meant: impl Fn(usize) -> bool) -> String {
        let rotary = self.machine.map_or(&[][..], |machine| machine.rotary.as_slice());
        let letters = ['X', 'Y', 'Z'].into_iter().chain(rotary.iter().map(|axis| axis.letter));
        let meant: Vec<String> = letters
            .enumerate()
            .filter(|&(axis, _)| is_meant(axis))
            .map(|(_, letter)| letter.into())
            .collect();
        match meant.as_slice() {
            [] => String::new(),
            [one] => format!("{one} stands"),
            [first @ .., last] => format!("{} and {last} stand", first.join(", ")),
        }
    }

    pub(super) fn remark_on_unchecked(&mut self) {
        let Some(&(line, _)) = self.unchecked.lines.first() else { return };
        let more = match self.unchecked.lines.len() - 1 {
            0 => String::new(),
            1 => ", nor that of one more line".into(),
            more => format!(", nor that of {more} more lines"),
        };
        let text = format!(
            "the motion here is not checked{more}: where {} was not said by then (name every axis first, before one moves again)",
            self.unchecked.unknown
        );
        self.path.unchecked = self.unchecked.lines.iter().map(|&(line, _)| line).collect();
        self.remark(line, "unchecked", &text);
    }

    /// Of a program that moves, and never to a place that is known.
    pub(super) fn check_said(&self) -> Result<(), Fault> {
        let Some(line) = self.unchecked.first_motion.filter(|_| self.path.locations.is_empty()) else {
            return Ok(());
        };
        let names = self.names(|axis| !self.unchecked.ever[axis]);
        match names.chars().next() {
            None => Ok(()),
            Some(letter) => {
                let remedy = format!("name every axis, such as G0 {letter}0.");
                let what = format!("the program moves and never says where {names}: {remedy}");
                Err(Fault::from(what).on_line(line))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use crate::machine::tests::meeting_trunnion;
    use crate::toolpath::error::Fault;
    use crate::toolpath::{PathReading, Toolpath};
    use crate::unit::LengthUnit;

    fn read(is_for_machine: bool, text: &str) -> Result<Toolpath, Fault> {
        let machine = meeting_trunnion();
        let machine = is_for_machine.then_some(&machine);
        let reading =
            PathReading { unit: LengthUnit::Mm, machine, lengths: &[(Some(1), 80.0), (Some(2), 80.0)] };
        parse(&format!("G21 G90 G17\n{text}"), &reading)
    }

    #[test]
    fn a_second_motion_before_every_axis_is_said_is_remarked() {
        let start = "T1 M6\nG0 A0.\nG43 H1 X0. Y0. Z80.\n";
        for (text, line, more, unknown) in [
            (format!("{start}Z5.\nX20.\nZ80.\nC0.\n"), 5, ", nor that of 2 more lines", "C stands"),
            (format!("{start}Z5.\nZ80.\nC0.\nG1 Z60. F9\n"), 5, ", nor that of one more line", "C stands"),
            // The last axis comes with the motion.
            (format!("{start}Z5. C0.\n"), 5, "", "C stands"),
            ("T1 M6\nG43 H1 G0 X-60. Y0. Z10.\nX60.\nA0. C0.\nZ100.\n".into(), 4, "", "A and C stand"),
            ("T1 M6\nG43.4 H1 G0 X-60. Y0. Z10.\nX60.\nA0. C0.\n".into(), 4, "", "A and C stand"),
            // Behind another tool change, and where the axes turn.
            (format!("{start}C0.\nT2 M6\nG0 A0.\nX0. Y0.\nA9.\nG43 H2 Z9.\n"), 9, "", "Z stands"),
        ] {
            let path = read(true, &text).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what));
            let said = format!(
                "line {line}: the motion here is not checked{more}: where {unknown} was not said by then (name"
            );
            let found = path.remarks.iter().filter(|remark| remark.starts_with(&said)).count();
            assert_eq!(found, 1, "{text}: {:?}", path.remarks);
        }
        let path = read(false, "T1 M6\nG0 Z5.\nY-60.\nY60.\nX0.\n").unwrap();
        let said = "line 5: the motion here is not checked: where X stands";
        assert!(path.remarks.iter().any(|remark| remark.starts_with(said)), "{:?}", path.remarks);
    }

    #[test]
    fn the_first_ways_to_a_place_are_not_remarked() {
        for (is_for_machine, text) in [
            (
                false,
                "T1 M6\nG0 X1. Y2.\nG43 H1 Z50.\nG1 Z2. F9\nG91 G28 Z0.\nG90 T2 M6\nG0 X3. Y4.\nG43 H2 Z9.\n",
            ),
            (
                true,
                "G91 G28 Z0.\nG28 X0. Y0.\nG90 T1 M6\nG0 A0. C0.\nX1. Y2.\nG43 H1 Z50.\nG53 Z0.\nT2 M6\nG0 A9. C8.\nX3.\nY1.\nG43 H2 Z50.\n",
            ),
            (true, "G53 G0 Z-9.\nG53 Z0.\nT1 M6\nG43.4 H1 G0 X1. Y2. Z50.\nC8.\nA9.\n"),
            (true, "T1 M6\nG0 A0. C0.\nX1. Y2.\nX1.\nG43 H1 Z50.\n"),
            // The way home has a remark of its own.
            (false, "T1 M6\nG0 X1. Y2.\nG43 H1 Z50.\nG91 G28 Z0.\nG90 X0. Y0.\nM30\n"),
        ] {
            let path = read(is_for_machine, text).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.what));
            let told = path.remarks.iter().any(|remark| remark.contains("here is not checked"));
            assert!(!told, "{text}: {:?}", path.remarks);
        }
    }

    #[test]
    fn a_tool_that_reaches_no_place_that_is_known_is_remarked() {
        let first = "T1 M6\nG0 X1. Y2.\nG43 H1 Z50.\n";
        for (then, line, more) in [
            ("T2 M6\nG43 H2 Z20.\nX-10.\nM30\n", 6, ", nor that of one more line"),
            ("T2 M6\nX-10.\nX-20.\nM30\n", 6, ", nor that of one more line"),
            ("T2 M6\nX-10.\nT1 M6\nX1. Y2.\nG43 H1 Z9.\n", 6, ""),
            ("T2 M6\nX-10. Y0.\nG91 G28 Z0.\nG90 T1 M6\nX1. Y2.\nG43 H1 Z9.\n", 6, ""),
        ] {
            let path = read(false, &format!("{first}{then}")).unwrap();
            let said = format!("line {line}: the motion here is not checked{more}: where ");
            assert!(
                path.remarks.iter().any(|remark| remark.starts_with(&said)),
                "{then}: {:?}",
                path.remarks
            );
            assert_eq!(path.unchecked[0], line, "{then}");
        }
    }

    #[test]
    fn axes_that_are_never_said_are_named() {
        let wrong = read(true, "T1 M6\nG43 H1 G0 X-60. Y0. Z50.\nG28 Z0.\nX0. Z50.\n").unwrap_err();
        let said = "the program moves and never says where A and C stand: name every axis, such as G0 A0.";
        assert_eq!((wrong.line, wrong.what.as_str()), (Some(3), said));
        assert!(read(true, "T1 M6\nM30\n").unwrap().locations.is_empty());
    }
}
