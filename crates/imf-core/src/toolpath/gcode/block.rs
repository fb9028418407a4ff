//! What the words of one line mean. A word that could move the machine and is not known is refused.

use glam::DVec3;

use super::Motion;
use super::words::Word;
use crate::machine::Machine;
use crate::toolpath::error::Fault;

/// What a line says.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    pub(super) motion: Option<Motion>,
    pub(super) plane: Option<[usize; 3]>,
    pub(super) unit_in_mm: Option<f64>,
    pub(super) absolute: Option<bool>,
    /// G54 to G59 by their numbers, G54.1 P1 to P99 from 101 on ([`offset_word`]).
    pub(super) offset: Option<u8>,
    /// G54.1 or G154, whose P is a number of an offset.
    numbers_offset: bool,
    /// `Some(None)` ends a tool length, `Some(Some(true))` keeps the tool's centre point as well.
    pub(super) length: Option<Option<bool>>,
    pub(super) length_number: Option<u32>,
    /// D.
    pub(super) edge: Option<f64>,
    pub(super) in_machine_coordinates: bool,
    /// G28, or G30.
    pub(super) home: Option<&'static str>,
    pub(super) dwells: bool,
    pub(super) tool: Option<u32>,
    pub(super) changes_tool: bool,
    pub(super) ends: bool,
    /// M words that are not known, and are taken to move nothing.
    pub(super) unknown_m: Vec<u32>,
    /// A drilling cycle begins, by its G word; or ends.
    pub(super) cycle: Option<u32>,
    pub(super) ends_cycle: bool,
    /// G98, or not G98 but G99.
    pub(super) returns: Option<bool>,
    /// It is a hole of the cycle in force; how often it is made, by L or K.
    pub(super) drills: bool,
    pub(super) repeats: Option<(char, f64)>,
    /// M19, whose R is an angle.
    turns_spindle: bool,
    /// A, B or C of an axis that is not given, at 0.
    pub(super) idle_axis: Option<char>,
    /// X, Y and Z.
    pub(super) linear: [Option<f64>; 3],
    /// In the order of the machine's rotary axes.
    pub(super) rotary: [Option<f64>; 2],
    pub(super) centre: Option<DVec3>,
    pub(super) radius: Option<f64>,
    pub(super) has_decimals_missing: bool,
    /// G64: corners are rounded, `lengths` away from the path at most.
    pub(super) rounds: bool,
    /// G64 without a length, G5, G5.1, G8, G187, G641 to G645: how far the control leaves the path is not said.
    pub(super) smooths: bool,
    /// A word that is understood without coordinates alone, the letter that it needs, and as what.
    alone: Option<(String, Option<char>, &'static str)>,
    /// The G words of the block that exclude others, in tenths.
    excluding: Vec<u32>,
    /// P and Q.
    pub(super) lengths: [Option<f64>; 2],
}

/// G words that move nothing and change no coordinate, in tenths: exact stop, no cutter compensation and its corners, no scaling, path
/// modes, no rotation, no turning of the tool, kinds of feed.
const STILL_G: [u32; 19] =
    [90, 131, 150, 400, 401, 610, 611, 670, 690, 930, 940, 950, 960, 970, 4500, 4510, 6010, 6020, 6030];
/// G words of which one alone is in force, in tenths: plane, unit, absolute or steps, level and kind of cycles, tool length, work offset, path mode.
const EXCLUDING_G: [&[u32]; 8] = [
    &[170, 180, 190],
    &[200, 210, 700, 710],
    &[900, 910],
    &[980, 990],
    &[730, 740, 800, 810, 820, 830, 840, 850, 860, 890],
    &[430, 434, 2340, 490],
    &[540, 541, 550, 560, 570, 580, 590, 1540],
    &[610, 611, 640, 6410, 6420, 6430, 6440, 6450],
];
/// M words that move neither tool nor part: stops, ends, spindle, coolant, clamps, overrides.
pub(in crate::toolpath) const STILL_M: [u32; 15] = [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 19, 30, 48, 49];
/// M words that call programs, mirror, change pallets or tools, or change what other words mean. Above 89 controls have too many of them;
/// of the rest those that are not known are relays: chip conveyors, coolants, doors, gears.
const MOVING_M: [u32; 12] = [17, 21, 22, 23, 47, 60, 61, 66, 70, 71, 72, 73];

/// The word of a work offset.
pub(super) fn offset_word(offset: u8) -> String {
    match offset.checked_sub(100) {
        Some(number) => format!("G54.1 P{number}"),
        None => format!("G{offset}"),
    }
}

impl Block {
    /// `in_cycle`: a drilling cycle is in force.
    pub(super) fn new(words: &[Word<'_>], machine: Option<&Machine>, in_cycle: bool) -> Result<Self, Fault> {
        let mut block = Self::default();
        let mut seen = Vec::new();
        for word in words {
            if !matches!(word.letter, 'G' | 'M' | 'N' | ':') {
                if seen.contains(&word.letter) {
                    return Err(format!("{} stands twice in one line", word.letter).into());
                }
                seen.push(word.letter);
            }
            block.take(word, machine)?;
        }
        block.take_cycle(&seen, in_cycle)?;
        block.take_offset()?;
        if block.rounds && !seen.iter().any(|letter| "PQ".contains(*letter)) {
            (block.rounds, block.smooths) = (false, true);
        }
        block.check(&seen)?;
        if !block.linear.iter().chain(&block.rotary).any(Option::is_some) {
            block.check_named(machine)?;
        }
        if block.is_arguments() {
            block.radius = None;
        }
        Ok(block)
    }

    /// Whether it is a hole: K is no centre there.
    fn take_cycle(&mut self, seen: &[char], in_cycle: bool) -> Result<(), String> {
        let goes_otherwise =
            self.motion.is_some() || self.home.is_some() || self.in_machine_coordinates || self.dwells;
        if let (Some(word), true) = (self.cycle, goes_otherwise) {
            return Err(format!("G{word} is a second kind of motion in one line"));
        }
        self.drills = self.cycle.is_some() || in_cycle && !self.ends_cycle && !goes_otherwise;
        if self.drills {
            let by_k = self.centre.take().filter(|_| seen.contains(&'K')).map(|centre| ('K', centre.z));
            self.repeats = self.repeats.or(by_k);
        }
        Ok(())
    }

    fn take_offset(&mut self) -> Result<(), String> {
        if self.numbers_offset {
            let number = self.lengths[0].take().filter(|p| (1.0..100.0).contains(p) && p.fract() == 0.0);
            let number = number.ok_or("the work offset needs its number, P1 to P99")?;
            self.offset = Some(100 + number as u8);
        }
        Ok(())
    }

    /// What is neither an axis nor a motion in it belongs to an M word: the angle of M19, and what the machine's own need.
    fn is_arguments(&self) -> bool {
        let is_still = self.motion.is_none() && self.linear == [None; 3];
        is_still && (self.turns_spindle || !self.unknown_m.is_empty())
    }

    /// Of a block that names no axis that moves.
    fn check_named(&mut self, machine: Option<&Machine>) -> Result<(), String> {
        if self.idle_axis.is_some() {
            (self.home, self.in_machine_coordinates) = (None, false);
        }
        // Without a machine it is not known where all of them go.
        if self.in_machine_coordinates || self.home.is_some() && machine.is_some() {
            return Err("it does not say which axes move: name them, such as Z0.".into());
        }
        Ok(())
    }

    /// True where it names an axis, or an arc that ends where it begins.
    pub(super) fn moves(&self) -> bool {
        let axes = self.linear.iter().chain(&self.rotary).any(Option::is_some);
        axes || self.centre.is_some() || self.radius.is_some() || self.home.is_some()
    }

    fn take(&mut self, word: &Word<'_>, machine: Option<&Machine>) -> Result<(), Fault> {
        let Word { letter, value, text } = *word;
        let whole = || {
            let is_number = value >= 0.0 && value.fract() == 0.0 && value < 1e6;
            is_number
                .then_some(value as u32)
                .ok_or_else(|| format!("{letter}{text} is not a number of a {letter} word"))
        };
        if "XYZABCIJKR".contains(letter) {
            self.has_decimals_missing |= value != 0.0 && !text.contains('.');
        }
        match letter {
            'G' => self.take_g(value, text)?,
            'M' => match whole()? {
                6 => self.changes_tool = true,
                known if STILL_M.contains(&known) => {
                    self.ends |= matches!(known, 2 | 30);
                    self.turns_spindle |= known == 19;
                }
                unknown if unknown < 90 && !MOVING_M.contains(&unknown) => self.unknown_m.push(unknown),
                _ => {
                    return Err(format!(
                        "M{text} is not understood and might move the machine: take it out of the program if it does not"
                    )
                    .into());
                }
            },
            // Numbers of blocks and programs, feed, spindle speed.
            ':' | 'N' | 'O' | 'F' | 'S' => {}
            // The place of a radius in the control, or a tool's edge.
            'D' => self.edge = Some(value),
            'T' => self.tool = Some(whole()?),
            'H' => self.length_number = Some(whole()?),
            'P' => self.lengths[0] = Some(value),
            'Q' => self.lengths[1] = Some(value),
            'L' => self.repeats = Some((letter, value)),
            'U' => {}
            'X' | 'Y' | 'Z' => {
                self.linear["XYZ".find(letter).unwrap_or_default()] = Some(value);
            }
            'I' | 'J' | 'K' => {
                let place = "IJK".find(letter).unwrap_or_default();
                self.centre.get_or_insert_default()[place] = value;
            }
            'R' => self.radius = Some(value),
            'A' | 'B' | 'C' => {
                let place = machine.and_then(|machine| machine.rotary_by_letter(letter));
                if place.is_none() && value == 0.0 {
                    self.idle_axis = Some(letter);
                    return Ok(());
                }
                let place = place.ok_or_else(|| match machine {
                    Some(machine) => {
                        format!("{letter}{text} turns an axis that the machine '{}' has not", machine.name)
                            .into()
                    }
                    None => Fault::needs_machine(format!(
                        "{letter}{text} turns a rotary axis, and no machine is given that says what it turns"
                    )),
                })?;
                self.rotary[place] = Some(value);
            }
            _ => return Err(format!("{letter}{text} is not understood and might move the machine").into()),
        }
        Ok(())
    }

    fn take_g(&mut self, value: f64, text: &str) -> Result<(), String> {
        let tenths = (value * 10.0).round();
        if (tenths / 10.0 - value).abs() > 1e-9 || !(0.0..1e5).contains(&tenths) {
            return Err(format!("G{text} is not understood and might move the machine"));
        }
        self.exclude(tenths as u32, text)?;
        let motion = match tenths as u32 {
            0 => Some(Motion::Rapid),
            10 => Some(Motion::Feed),
            20 => Some(Motion::Clockwise),
            30 => Some(Motion::CounterClockwise),
            _ => None,
        };
        match tenths as u32 {
            0 | 10 | 20 | 30 if self.motion.is_some() && self.motion != motion => {
                return Err(format!("G{text} is a second kind of motion in one line"));
            }
            0 | 10 | 20 | 30 => self.motion = motion,
            40 => self.dwells = true,
            170 => self.plane = Some([0, 1, 2]),
            180 => self.plane = Some([2, 0, 1]),
            190 => self.plane = Some([1, 2, 0]),
            200 | 700 => self.unit_in_mm = Some(25.4),
            210 | 710 => self.unit_in_mm = Some(1.0),
            280 => self.home = Some("G28"),
            300 => self.home = Some("G30"),
            430 => self.length = Some(Some(false)),
            434 | 2340 => self.length = Some(Some(true)),
            490 => self.length = Some(None),
            530 => self.in_machine_coordinates = true,
            offset @ (540 | 550 | 560 | 570 | 580 | 590) => self.offset = Some((offset / 10) as u8),
            541 | 1540 => self.numbers_offset = true,
            900 => self.absolute = Some(true),
            910 => self.absolute = Some(false),
            // Centres from the start, as they are read.
            911 => {}
            still if STILL_G.contains(&still) => {}
            640 => self.rounds = true,
            smooths @ (50 | 51 | 80 | 1870 | 6410..=6450) => {
                let needed = match smooths {
                    50 | 80 => Some('P'),
                    51 => Some('Q'),
                    _ => None,
                };
                self.smooths = true;
                self.alone = Some((format!("G{text}"), needed, "smoothing of corners"));
            }
            500 | 501 => self.alone = Some((format!("G{text}"), None, "the end of scaling and mirroring")),
            921 | 922 => self.alone = Some((format!("G{text}"), None, "the end of a shift")),
            410 | 420 => {
                return Err(format!(
                    "G{text} moves the tool beside the path by a radius in the control: let the CAM program write the tip's own path (G40)"
                ));
            }
            730 | 740 | 810 | 820 | 830 | 840 | 850 | 860 | 890 => self.cycle = Some(tenths as u32 / 10),
            800 => self.ends_cycle = true,
            980 | 990 => self.returns = Some(tenths == 980.0),
            760 | 810..=890 => {
                return Err(format!(
                    "G{text} is a cycle, which is not followed: let the CAM program write its motions as G0 and G1"
                ));
            }
            _ => return Err(format!("G{text} is not understood and might move the machine")),
        }
        Ok(())
    }

    /// Which of two such words wins differs from control to control.
    fn exclude(&mut self, tenths: u32, text: &str) -> Result<(), String> {
        let Some(group) = EXCLUDING_G.iter().find(|group| group.contains(&tenths)) else { return Ok(()) };
        let before = self.excluding.iter().find(|before| group.contains(before) && **before != tenths);
        if let Some(&before) = before {
            return Err(format!(
                "G{text} stands beside G{} in one line, and each ends the other: write one of them",
                f64::from(before) / 10.0
            ));
        }
        self.excluding.push(tenths);
        Ok(())
    }

    /// Words that say nothing where they stand might mean something that is not known.
    fn check(&self, seen: &[char]) -> Result<(), String> {
        let has = |letters: &str| seen.iter().copied().find(|&letter| letters.contains(letter));
        if self.dwells {
            // The time is P, or X or U where they can be nothing else.
            let moves = self.motion.is_some() || self.home.is_some() || self.in_machine_coordinates;
            let is_lost =
                |&letter: &char| moves || seen.iter().any(|&other| other != letter && "PXUF".contains(other));
            return match has("YZIJKRABCHQL").or(has("X").or(has("U")).filter(is_lost)) {
                Some(letter) => {
                    Err(format!("{letter} stands beside G4, which waits: write it in a line of its own"))
                }
                None => Ok(()),
            };
        }
        if let Some((word, needed, meaning)) = &self.alone {
            if let Some(letter) = has("XYZABCIJKR") {
                return Err(format!("{letter} stands beside {word}, which is understood as {meaning} alone"));
            }
            if let Some(letter) = needed.filter(|letter| !seen.contains(letter)) {
                return Err(format!("{word} is understood with {letter} alone, as {meaning}"));
            }
        }
        if let (Some(offset @ (58 | 59)), None, Some(letter)) =
            (self.offset, self.motion, has("XYZABC").filter(|_| self.cycle.is_none()))
        {
            return Err(format!(
                "{letter} stands beside G{offset} without a motion, which shifts the zero on some controls and moves on others: write G0 or \
                 G1, or G{offset} in a line of its own"
            ));
        }
        if self.rounds && self.lengths[0].is_none_or(|p| p < 0.0) {
            return Err(
                "G64 rounds corners, and no P says by how much at most: write P, or take it out to check the path as written"
                    .into(),
            );
        }
        let unknown = match (self.drills || self.is_arguments(), self.rounds || self.smooths) {
            (true, _) => "U",
            (false, true) => "LU",
            (false, false) if self.numbers_offset => "QLU",
            (false, false) => "PQLU",
        };
        if let Some(letter) = has(unknown) {
            return Err(format!("{letter} is not understood here and might move the machine"));
        }
        if self.length_number.is_some() && self.length.is_none_or(|length| length.is_none()) {
            return Err("H is a tool length, and neither G43 nor G43.4 in this line takes it up".into());
        }
        if self.length_number == Some(0) {
            return Err("H0 is not a tool's length: write G49 to end one".into());
        }
        let by_machine = self.home.is_some() || self.in_machine_coordinates;
        if by_machine && (self.centre.is_some() || self.radius.is_some()) {
            return Err("an arc does not go by the machine's coordinates".into());
        }
        Ok(())
    }
}
