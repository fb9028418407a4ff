//! One line of a program: its words, a letter and a number each, and what each of them means. A word that could move the machine and is
//! not known is refused.
//!
//! Available parsers (the crate `gcode`) hold numbers in 24 bits, which is a hundredth of a millimetre at a metre in
//! tenths of inches, and skip what they do not know; here every character is read, or refused.

use glam::DVec3;

use super::Motion;
use crate::machine::Machine;
use crate::toolpath::error::Fault;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Word<'a> {
    /// In upper case.
    pub(super) letter: char,
    pub(super) value: f64,
    /// The number as written.
    pub(super) text: &'a str,
}

/// Whether a line is the sign that stands before and behind a program.
pub(super) fn is_sign(line: &str) -> bool {
    line.trim_start().starts_with('%')
}

/// The words of one line; none of a line that only separates or comments.
pub(super) fn words(line: &str) -> Result<Vec<Word<'_>>, String> {
    let mut rest = line.trim();
    let mut found = Vec::new();
    if let Some(name) = rest.strip_prefix('%') {
        // A name or a number may follow; words would not be run.
        let runs = |word: &Word<'_>| "GMTXYZABC".contains(word.letter);
        if words(name).is_ok_and(|words| words.iter().any(runs)) {
            return Err(
                "words stand behind '%', where a control skips them: give them a line of their own".into()
            );
        }
        return Ok(found);
    }
    if rest.starts_with('/') {
        return Err(
            "the line is skipped or not by a switch of the machine ('/'): take it out, or the '/' alone"
                .into(),
        );
    }
    while let Some(first) = rest.chars().next() {
        match first {
            ';' => break,
            '(' => {
                let end = rest.find(')').ok_or("a comment has no end: ')' is missing")?;
                rest = &rest[end + 1..];
            }
            letter if letter.is_ascii_alphabetic() => {
                let number = rest[1..].trim_start();
                let end = number.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '+' | '-')));
                let text = &number[..end.unwrap_or(number.len())];
                let value = text.parse::<f64>().map_err(|_| {
                    let word: String = rest.chars().take_while(|c| !c.is_whitespace()).take(24).collect();
                    format!(
                        "'{word}' is not understood: words are a letter and a number (no variables, expressions or names); let the \
                         CAM program write plain motions"
                    )
                })?;
                found.push(Word { letter: letter.to_ascii_uppercase(), value, text });
                rest = &number[text.len()..];
            }
            other => {
                return Err(format!(
                    "'{other}' is not understood and might move the machine: take it out if it does not"
                ));
            }
        }
        rest = rest.trim_start();
    }
    Ok(found)
}

/// True where a line ends in a word, which may be the beginning of a longer one.
pub(super) fn ends_in_word(line: &str) -> bool {
    words(line).is_ok_and(|words| words.last().is_some_and(|last| line.trim_end().ends_with(last.text)))
}

/// What a line says.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    pub(super) motion: Option<Motion>,
    pub(super) plane: Option<[usize; 3]>,
    pub(super) unit_in_mm: Option<f64>,
    pub(super) absolute: Option<bool>,
    pub(super) offset: Option<u8>,
    /// `Some(None)` ends a tool length, `Some(Some(true))` keeps the tool's centre point as well.
    pub(super) length: Option<Option<bool>>,
    pub(super) length_number: Option<u32>,
    /// D.
    pub(super) edge: Option<f64>,
    pub(super) in_machine_coordinates: bool,
    pub(super) goes_home: bool,
    pub(super) dwells: bool,
    pub(super) tool: Option<u32>,
    pub(super) changes_tool: bool,
    pub(super) ends: bool,
    /// X, Y and Z.
    pub(super) linear: [Option<f64>; 3],
    /// In the order of the machine's rotary axes.
    pub(super) rotary: [Option<f64>; 2],
    pub(super) centre: Option<DVec3>,
    pub(super) radius: Option<f64>,
    pub(super) has_decimals_missing: bool,
    /// G64: corners are rounded, `lengths` away from the path at most.
    pub(super) rounds: bool,
    /// G64 without a length, G5.1, G8, G187: how far the control leaves the path is not said.
    pub(super) smooths: bool,
    /// Of G5.1, G8 and G187 the word, and the letter that it needs.
    mode: Option<(&'static str, Option<char>)>,
    /// The G words of the block that exclude others, in tenths.
    excluding: Vec<u32>,
    /// P and Q.
    pub(super) lengths: [Option<f64>; 2],
}

/// G words that move nothing and change no coordinate, in tenths: exact stop, no cutter compensation, no scaling, end of a cycle, path
/// modes, no rotation, kinds of feed, the cycles' level.
const STILL_G: [u32; 15] = [90, 131, 150, 400, 610, 611, 670, 690, 800, 930, 940, 950, 970, 980, 990];
/// G words of which one alone is in force, in tenths: plane, unit, absolute or steps, tool length, work offset, path mode.
const EXCLUDING_G: [&[u32]; 6] = [
    &[170, 180, 190],
    &[200, 210],
    &[900, 910],
    &[430, 434, 2340, 490],
    &[540, 550, 560, 570, 580, 590],
    &[610, 611, 640],
];
/// M words that move neither tool nor part: stops, ends, spindle, coolant, clamps, overrides.
pub(in crate::toolpath) const STILL_M: [u32; 15] = [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 19, 30, 48, 49];

impl Block {
    pub(super) fn new(words: &[Word<'_>], machine: Option<&Machine>) -> Result<Self, Fault> {
        let mut block = Self::default();
        let mut seen = Vec::new();
        for word in words {
            if !matches!(word.letter, 'G' | 'M' | 'N') {
                if seen.contains(&word.letter) {
                    return Err(format!("{} stands twice in one line", word.letter).into());
                }
                seen.push(word.letter);
            }
            block.take(word, machine)?;
        }
        block.smooths |= block.mode.is_some();
        if block.rounds && !seen.iter().any(|letter| "PQ".contains(*letter)) {
            (block.rounds, block.smooths) = (false, true);
        }
        block.check(&seen)?;
        Ok(block)
    }

    /// True where it names an axis, or an arc that ends where it begins.
    pub(super) fn moves(&self) -> bool {
        let axes = self.linear.iter().chain(&self.rotary).any(Option::is_some);
        axes || self.centre.is_some() || self.radius.is_some() || self.goes_home
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
                known if STILL_M.contains(&known) => self.ends |= matches!(known, 2 | 30),
                _ => {
                    return Err(format!(
                        "M{text} is not understood and might move the machine: take it out of the program if it does not"
                    )
                    .into());
                }
            },
            // Numbers of blocks and programs, feed, spindle speed.
            'N' | 'O' | 'F' | 'S' => {}
            // The place of a radius in the control, or a tool's edge.
            'D' => self.edge = Some(value),
            'T' => self.tool = Some(whole()?),
            'H' => self.length_number = Some(whole()?),
            'P' => self.lengths[0] = Some(value),
            'Q' => self.lengths[1] = Some(value),
            'L' | 'U' => {}
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
            200 => self.unit_in_mm = Some(25.4),
            210 => self.unit_in_mm = Some(1.0),
            280 => self.goes_home = true,
            430 => self.length = Some(Some(false)),
            434 | 2340 => self.length = Some(Some(true)),
            490 => self.length = Some(None),
            530 => self.in_machine_coordinates = true,
            offset @ (540 | 550 | 560 | 570 | 580 | 590) => self.offset = Some((offset / 10) as u8),
            900 => self.absolute = Some(true),
            910 => self.absolute = Some(false),
            // Centres from the start, as they are read.
            911 => {}
            still if STILL_G.contains(&still) => {}
            640 => self.rounds = true,
            51 => self.mode = Some(("G5.1", Some('Q'))),
            80 => self.mode = Some(("G8", Some('P'))),
            1870 => self.mode = Some(("G187", None)),
            410 | 420 => {
                return Err(format!(
                    "G{text} moves the tool beside the path by a radius in the control: let the CAM program write the tip's own path (G40)"
                ));
            }
            730 | 740 | 760 | 810..=890 => {
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
            let moves = self.motion.is_some() || self.goes_home || self.in_machine_coordinates;
            let is_lost =
                |&letter: &char| moves || seen.iter().any(|&other| other != letter && "PXUF".contains(other));
            return match has("YZIJKRABCHQL").or(has("X").or(has("U")).filter(is_lost)) {
                Some(letter) => {
                    Err(format!("{letter} stands beside G4, which waits: write it in a line of its own"))
                }
                None => Ok(()),
            };
        }
        if let Some((word, needed)) = self.mode {
            if let Some(letter) = has("XYZABCIJKR") {
                return Err(format!(
                    "{letter} stands beside {word}, which is understood as smoothing of corners alone"
                ));
            }
            if let Some(letter) = needed.filter(|letter| !seen.contains(letter)) {
                return Err(format!("{word} is understood with {letter} alone, as smoothing of corners"));
            }
        }
        if self.rounds && self.lengths[0].is_none_or(|p| p < 0.0) {
            return Err(
                "G64 rounds corners, and no P says by how much at most: write P, or take it out to check the path as written"
                    .into(),
            );
        }
        if let Some(letter) = has(if self.rounds || self.smooths { "LU" } else { "PQLU" }) {
            return Err(format!("{letter} is not understood here and might move the machine"));
        }
        if self.length_number.is_some() && self.length.is_none_or(|length| length.is_none()) {
            return Err("H is a tool length, and neither G43 nor G43.4 in this line takes it up".into());
        }
        if self.length_number == Some(0) {
            return Err("H0 is not a tool's length: write G49 to end one".into());
        }
        if self.goes_home || self.in_machine_coordinates {
            if !self.linear.iter().chain(&self.rotary).any(Option::is_some) {
                return Err("it does not say which axes move: name them, such as Z0.".into());
            }
            if self.centre.is_some() || self.radius.is_some() {
                return Err("an arc does not go by the machine's coordinates".into());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_comments_are_not() {
        let read = |line: &str| -> Vec<(char, f64)> {
            words(line).unwrap().into_iter().map(|word| (word.letter, word.value)).collect()
        };
        assert_eq!(
            read("N10 g1X1.5Y-.25 (to, X9) Z+3. ; X7"),
            [('N', 10.0), ('G', 1.0), ('X', 1.5), ('Y', -0.25), ('Z', 3.0)]
        );
        assert_eq!(read("G43.4 H 1"), [('G', 43.4), ('H', 1.0)]);
        assert_eq!((read("%"), read("(X1)"), read("  ")), (vec![], vec![], vec![]));
        for (line, said) in [
            ("G1 X#101", "'X#101'"),
            ("G1 X[1+2]", "'X[1+2]'"),
            ("MSG(\"X\")", "'MSG"),
            ("#1=3", "'#'"),
            ("/G1 X1", "'/'"),
            ("G1 (X1", "')' is missing"),
            ("G1 X1.2.3", "'X1.2.3'"),
        ] {
            let error = words(line).unwrap_err();
            assert!(error.contains(said), "{line}: {error}");
        }
    }
}
