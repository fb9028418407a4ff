//! Toolpaths in APT or CL form: `WORD/numbers`, one statement a line.
//!
//! Read are `GOTO/` (x, y, z and, with an axis, i, j, k; the last axis holds on, up to `MULTAX/OFF`), `FROM/` (the same: where the tool
//! is, to which no way leads), `GODLTA/` (a step from where the tool is), `TLAXIS/` (the axis alone), `RAPID`, `UNITS/` and tool changes
//! by number (`LOADTL/`, `LOAD/TOOL`, `TURRET/`); locations before the first of these belong to its tool. `CUTTER/` and `TLDATA/MILL`
//! say what cutter the path was made for. `$$` begins a comment, a `$` at the end continues the statement on the next line, but a text
//! (`PARTNO`, `PPRINT`) never. Words that can move nothing are skipped. Words that transform coordinates are skipped where they change nothing and refused otherwise, since programs
//! disagree on what they mean for the part. Every other word is refused.

mod frame;
mod statement;

use std::str::FromStr;

use super::error::Fault;
use super::{CutterStatement, Direction, Location, MoveKind, Toolpath, gcode, pose};
use crate::unit::LengthUnit;
use frame::{TRANSFORMS, changes_nothing};
use statement::{Statement, TEXT, first_word, is_of, numbers, statements};

/// Words that neither move the tool nor change what its coordinates mean.
const STILL: &str = "CLEARP COOLNT DELAY DISPLY DWELL END END-OF-PATH FEDRAT FINI INTOL LEADER MACHIN OPSTOP \
                     OUTTOL PAINT PARTNO PPRINT REMARK SELCTL SELECT SEQNO SPINDL STOP TOLER TPRINT";

/// Words that end a file; NX writes the last one.
const ENDS: &str = "FINI END END-OF-PATH";

/// Words that move the tool along a path that is not in the file.
const MOVING: &str = "CIRCLE CYCLE GOBACK GODOWN GOFWD GOHOME GOLFT GORGT GOUP RETRCT SPLINE THREAD";

/// The axis of three-axis milling.
const UP: [f64; 3] = [0.0, 0.0, 1.0];

/// State of the interpreter.
#[derive(Default)]
struct State {
    locations: Vec<Location>,
    axis: [f64; 3],
    /// `MULTAX/OFF`: the axis is +z.
    upright: bool,
    /// From the file's unit.
    factor: f64,
    /// The path's unit, while the file has not said its own.
    unit_taken: Option<LengthUnit>,
    /// `UNITS/` has been read.
    has_unit: bool,
    rapid: bool,
    tool: Option<u32>,
    /// Loaded since the last location.
    loaded: bool,
    /// The last description of the tool, by word.
    described: Vec<(String, String)>,
    /// A description that differs from the one before, since the last location.
    differs: Option<(usize, String)>,
    cutters: Vec<CutterStatement>,
    /// Cutters described since the last location: of the tool that is loaded by the next one.
    described_since: Vec<CutterStatement>,
    remarks: Vec<String>,
    /// The last comment of a coordinate system.
    system: String,
}

pub(super) fn parse(text: &str, unit: LengthUnit) -> Result<Toolpath, Fault> {
    let mut state = State { axis: UP, factor: 1.0, unit_taken: Some(unit), ..State::default() };
    let (mut ends, mut is_over) = (false, false);
    for Statement { line, text, is_comment } in statements(text) {
        if is_comment {
            state.take_comment(line, text);
        } else {
            let word = first_word(&text);
            if is_over && !word.is_empty() && !is_of(TEXT, &word) && !is_of(ENDS, &word) {
                let what = "the program has ended before, by FINI: give each program a file of its own";
                return Err(Fault::from(what).on_line(line));
            }
            ends = is_of(ENDS, &word);
            is_over |= word == "FINI";
            state.take(line, &text, unit).map_err(|fault| fault.on_line(line))?;
        }
    }
    if !ends {
        // The words of a text or a comment move nothing.
        Fault::refuse_cut(text, |line| !line.contains("$$") && !is_of(TEXT, &first_word(line)))?;
        let line = text.lines().count();
        state
            .remarks
            .push(format!("line {line}: the file stops here without FINI: if it was cut short, what is missing is not checked"));
    }
    let State { locations, cutters, remarks, has_unit: states_unit, .. } = state;
    Ok(Toolpath { locations, cutters, remarks, states_unit, ..Toolpath::default() })
}

/// Why a statement that is not followed is refused.
fn refusal(statement: &str, word: &str) -> String {
    if word == "OPSKIP" {
        return format!(
            "the lines after {statement} are skipped or not by a switch of the machine: take them out, or {statement} alone"
        );
    }
    if is_of(TRANSFORMS, word) {
        return format!(
            "{statement} changes where the coordinates after it lie, which is not followed here: let the CAM program \
             write every location in one coordinate system, the part's own"
        );
    }
    if is_of(MOVING, word) {
        return format!(
            "{word} moves the tool along a way that is not followed here; let the CAM program write that \
             motion as GOTO/ lines"
        );
    }
    format!(
        "'{word}' is not understood and might move the tool: take it out of the file if it does not; let the CAM \
         program write motions as GOTO/ lines if it does"
    )
}

impl State {
    fn take(&mut self, line: usize, statement: &str, unit: LengthUnit) -> Result<(), Fault> {
        let rest = statement.split_once('/').map_or("", |(_, rest)| rest);
        // PARTNO, PPRINT and their like may be followed by text without a slash.
        let word = first_word(statement);
        match word.as_str() {
            "" => {}
            "GOTO" | "FROM" => self.locate(line, &word, rest)?,
            "GODLTA" => self.step(line, rest)?,
            "TLAXIS" => {
                let axis = <[f64; 3]>::try_from(numbers(rest)?).map_err(|_| "TLAXIS needs 3 numbers")?;
                self.turn_to(axis, &word)?;
            }
            "RAPID" => self.rapid = true,
            "FEDRAT" if rest.to_ascii_uppercase().contains("RAPID") => {
                return Err(format!(
                    "{statement} is not understood: write RAPID before each motion that is one"
                )
                .into());
            }
            "MULTAX" => self.set_axes(statement, rest)?,
            "UNITS" => self.set_unit(rest, unit)?,
            "LOADTL" | "TURRET" | "LOAD" => self.load(statement, &word, rest)?,
            // Free text that describes the tool.
            "CUTTER" | "TLDATA" | "TOOLNO" => self.take_description(line, &word, rest)?,
            "TOOL" if statement.to_ascii_uppercase().starts_with("TOOL PATH") => {
                let name = rest.to_ascii_uppercase().rfind("TOOL,").map_or("", |at| &rest[at + 5..]);
                self.describe(line, "TOOL PATH", name);
            }
            "AUXFUN" => check_auxiliary(statement, rest)?,
            "OPSKIP" | "CYCLE" if is_off(rest) => {}
            known if is_of(STILL, known) => {}
            known if is_of(TRANSFORMS, known) && changes_nothing(known, rest) => {}
            unknown => return Err(refusal(statement, unknown).into()),
        }
        Ok(())
    }

    /// A location, with its axis where the statement has six numbers.
    fn locate(&mut self, line: usize, word: &str, rest: &str) -> Result<(), Fault> {
        let values = numbers(rest)?;
        let position = match *values.as_slice() {
            [x, y, z] => [x, y, z],
            [x, y, z, i, j, k] => {
                self.turn_to([i, j, k], word)?;
                [x, y, z]
            }
            _ => return Err(format!("{word} needs 3 or 6 numbers, not {}", values.len()).into()),
        };
        self.go_to(line, position.map(|v| v * self.factor), word == "FROM")
    }

    /// A location by its distance from the one before.
    fn step(&mut self, line: usize, rest: &str) -> Result<(), Fault> {
        let values = numbers(rest)?;
        let [x, y, z] = *values.as_slice() else {
            return Err(format!("GODLTA needs 3 numbers, not {}", values.len()).into());
        };
        let last = self.locations.last().filter(|last| last.tool == self.tool);
        let last = last.ok_or("GODLTA before any GOTO or FROM of this tool")?.pose.position;
        let step = [x, y, z].map(|v| v * self.factor);
        self.go_to(line, [last.x + step[0], last.y + step[1], last.z + step[2]], false)
    }

    /// Whether the tool may turn.
    fn set_axes(&mut self, statement: &str, rest: &str) -> Result<(), String> {
        match rest.trim().to_ascii_uppercase().as_str() {
            "" | "ON" => self.upright = false,
            "OFF" => (self.upright, self.axis) = (true, UP),
            _ => {
                return Err(format!(
                    "{statement} is not understood, and says whether the tool turns: write MULTAX/ON or MULTAX/OFF"
                ));
            }
        }
        Ok(())
    }

    /// The unit of the numbers from here on.
    fn set_unit(&mut self, rest: &str, unit: LengthUnit) -> Result<(), String> {
        let named = rest.trim().to_ascii_lowercase();
        let named = if named == "inches" { "inch" } else { &named };
        let file = LengthUnit::from_str(named).map_err(|error| error.to_string())?;
        self.factor = file.in_mm() / unit.in_mm();
        self.unit_taken = None;
        if !std::mem::replace(&mut self.has_unit, true) {
            self.convert_cutters();
        }
        Ok(())
    }

    /// The tool of the locations from here on.
    fn load(&mut self, statement: &str, word: &str, rest: &str) -> Result<(), String> {
        let number = if word == "LOAD" { behind(rest, "TOOL") } else { Some(rest) };
        let number = number.and_then(|text| text.split(',').next()?.trim().parse().ok());
        self.tool = Some(number.ok_or_else(|| {
            format!("'{statement}' does not say the tool's number: write LOADTL/ and the number")
        })?);
        self.loaded = true;
        Ok(())
    }

    /// What a statement says of the tool, and of its cutter's size.
    fn take_description(&mut self, line: usize, word: &str, rest: &str) -> Result<(), String> {
        self.describe(line, word, rest);
        let cutter = match word {
            "CUTTER" => Some(rest),
            "TLDATA" => behind(rest, "MILL"),
            _ => None,
        };
        if let Some(values) = cutter.filter(|rest| !is_off(rest)) {
            let statement = self.cutter(line, values).map_err(|what| format!("{word}: {what}"))?;
            self.described_since.push(statement);
        }
        Ok(())
    }

    /// Sets the tool's axis.
    fn turn_to(&mut self, axis: [f64; 3], word: &str) -> Result<(), String> {
        let [i, j, k] = axis;
        if self.upright && !(i == 0.0 && j == 0.0 && k > 0.0) {
            return Err(format!(
                "{word} turns the tool to ({i}, {j}, {k}) after MULTAX/OFF, where it stands along +z: write MULTAX/ON before"
            ));
        }
        self.axis = axis;
        Ok(())
    }

    fn go_to(&mut self, line: usize, position: [f64; 3], is_start: bool) -> Result<(), Fault> {
        match self.differs.take() {
            Some((line, word)) if !self.loaded => {
                let what = format!(
                    "{word} describes another tool, and no number is loaded: write LOADTL/ and the number"
                );
                return Err(Fault::from(what).on_line(line));
            }
            None if self.loaded => self.adopt(),
            _ => {}
        }
        if let Some(unit) = self.unit_taken.take() {
            self.remarks
                .push(format!("line {line}: the file moves without UNITS/: its unit is taken to be {unit}"));
        }
        let pose = pose(position, Direction::Axis(self.axis), None)?;
        // RAPID applies to the next motion; a statement of where the tool is does not count as one.
        let kind = if is_start {
            MoveKind::Start
        } else if std::mem::take(&mut self.rapid) {
            MoveKind::Rapid
        } else {
            MoveKind::Feed
        };
        self.locations.push(Location { line, pose, rolled: false, tool: self.tool, kind, machine: None });
        let tool = self.tool;
        self.cutters.extend(self.described_since.drain(..).map(|cutter| CutterStatement { tool, ..cutter }));
        self.loaded = false;
        Ok(())
    }

    /// Locations before the first tool call are the first tool's: CATIA writes where tools are changed before it.
    fn adopt(&mut self) {
        let (Some(number), Some(first)) = (self.tool, self.locations.first()) else { return };
        if self.locations.last().is_some_and(|last| last.tool.is_some()) {
            return;
        }
        self.remarks.push(format!(
            "line {}: the tool of the locations before the first tool call is taken to be the one called there, {number}",
            first.line
        ));
        self.locations.iter_mut().for_each(|location| location.tool = self.tool);
        self.cutters.iter_mut().for_each(|cutter| cutter.tool = self.tool);
    }

    /// A comment that states something.
    fn take_comment(&mut self, line: usize, comment: String) {
        if let Some(remark) = frame::remark_on(&comment)
            && self.system != comment
        {
            self.remarks.push(format!("line {line}: {remark}"));
            self.system = comment;
        }
    }

    /// Diameter and, where it stands there, corner radius; what follows them only says more of tapers.
    fn cutter(&self, line: usize, values: &str) -> Result<CutterStatement, String> {
        let values = numbers(values)?;
        let diameter = *values.first().ok_or("its diameter is missing")? * self.factor;
        let corner_radius = values.get(1).map(|radius| radius * self.factor);
        Ok(CutterStatement { line, tool: self.tool, diameter, corner_radius })
    }

    /// Cutters that were described before the first `UNITS/` are in its unit.
    fn convert_cutters(&mut self) {
        for cutter in self.cutters.iter_mut().chain(&mut self.described_since) {
            cutter.diameter *= self.factor;
            cutter.corner_radius = cutter.corner_radius.map(|radius| radius * self.factor);
        }
    }

    /// Before the first location a description begins; after it, another one is another tool.
    fn describe(&mut self, line: usize, word: &str, text: &str) {
        let text = text.trim().to_owned();
        match self.described.iter_mut().find(|(known, _)| known == word) {
            Some((_, known)) if *known == text => {}
            Some((_, known)) => {
                *known = text;
                if !self.locations.is_empty() {
                    self.differs.get_or_insert((line, word.to_owned()));
                }
            }
            None => self.described.push((word.to_owned(), text)),
        }
    }
}

/// An M word of the machine by its number, of which the same are known as in a program.
fn check_auxiliary(statement: &str, rest: &str) -> Result<(), String> {
    let number = rest.split(',').next().and_then(|number| number.trim().parse::<f64>().ok());
    match number {
        Some(6.0) => Err("AUXFUN/6 changes the tool without a number: write LOADTL/ and the number".into()),
        Some(known) if known >= 0.0 && known.fract() == 0.0 && gcode::STILL_M.contains(&(known as u32)) => {
            Ok(())
        }
        _ => Err(format!(
            "{statement} is not understood and might move the machine: take it out of the file if it does not"
        )),
    }
}

/// What follows a word and a comma.
fn behind<'a>(rest: &'a str, word: &str) -> Option<&'a str> {
    let (first, rest) = rest.split_once(',')?;
    first.trim().eq_ignore_ascii_case(word).then_some(rest)
}

fn is_off(rest: &str) -> bool {
    rest.trim().eq_ignore_ascii_case("OFF")
}

#[cfg(test)]
mod tests;
