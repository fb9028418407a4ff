//! Toolpaths in APT or CL form: `WORD/numbers`, one statement a line.
//!
//! Read are `GOTO/` and `FROM/` (x, y, z and, with an axis, i, j, k; the last axis holds on), `GODLTA/` (a step from
//! where the tool is), `TLAXIS/` (the axis alone), `RAPID`, `UNITS/` and tool changes by number (`LOADTL/`, `LOAD/TOOL`,
//! `TURRET/`). `CUTTER/` and `TLDATA/MILL` say what cutter the path was made for. `$$` begins a comment, a `$` at the end continues the statement on the next line. Words that can move nothing
//! are skipped. Words that transform coordinates are skipped where they change nothing and refused otherwise, since programs
//! disagree on what they mean for the part. Every other word is refused.

use std::str::FromStr;

use super::{CutterStatement, Direction, LineError, Location, MoveKind, Toolpath, pose};
use crate::unit::LengthUnit;

/// Words that neither move the tool nor change what its coordinates mean.
const STILL: &str = "AUXFUN CLEARP COOLNT DELAY DISPLY DWELL END END-OF-PATH FEDRAT FINI INTOL LEADER MACHIN MULTAX OPSKIP OPSTOP \
                     OUTTOL PAINT PARTNO PPRINT REMARK SELCTL SELECT SEQNO SPINDL STOP TOLER TPRINT";

/// Words that move the tool along a path that is not in the file.
const MOVING: &str = "CIRCLE CYCLE GOBACK GODOWN GOFWD GOHOME GOLFT GORGT GOUP RETRCT SPLINE THREAD";

/// Words that change where later coordinates lie.
const TRANSFORMS: &str = "COPY CUTCOM LCS MODE MSYS ORIGIN PREFUN ROTABL ROTATE ROTHED TMARK TRACUT TRANS";

/// True where a word is one of a list.
fn is_of(list: &str, word: &str) -> bool {
    list.split_ascii_whitespace().any(|known| known == word)
}

/// State of the interpreter.
struct State {
    locations: Vec<Location>,
    axis: [f64; 3],
    /// From the file's unit.
    factor: f64,
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
}

pub(super) fn parse(text: &str, unit: LengthUnit) -> Result<Toolpath, LineError> {
    let mut state = State {
        locations: Vec::new(),
        axis: [0.0, 0.0, 1.0],
        factor: 1.0,
        rapid: false,
        tool: None,
        loaded: false,
        described: Vec::new(),
        differs: None,
        cutters: Vec::new(),
        described_since: Vec::new(),
    };
    for (line, statement) in statements(text) {
        state.take(line, &statement, unit)?;
    }
    Ok(Toolpath { locations: state.locations, cutters: state.cutters, ..Toolpath::default() })
}

impl State {
    fn take(&mut self, line: usize, statement: &str, unit: LengthUnit) -> Result<(), LineError> {
        let (word, rest) = statement.split_once('/').unwrap_or((statement, ""));
        // PARTNO, PPRINT and their like may be followed by text without a slash.
        let word = word.split_whitespace().next().unwrap_or_default().to_ascii_uppercase();
        let wrong = |what: String| LineError { line, what };
        match word.as_str() {
            "" => {}
            "GOTO" | "FROM" => {
                let values = numbers(rest).map_err(wrong)?;
                let position = match *values.as_slice() {
                    [x, y, z] => [x, y, z],
                    [x, y, z, i, j, k] => {
                        self.axis = [i, j, k];
                        [x, y, z]
                    }
                    _ => return Err(wrong(format!("{word} needs 3 or 6 numbers, not {}", values.len()))),
                };
                self.go_to(line, position.map(|v| v * self.factor))?;
            }
            "GODLTA" => {
                let values = numbers(rest).map_err(wrong)?;
                let [x, y, z] = *values.as_slice() else {
                    return Err(wrong(format!("GODLTA needs 3 numbers, not {}", values.len())));
                };
                let last = self.locations.last().filter(|last| last.tool == self.tool);
                let last = last
                    .ok_or_else(|| wrong("GODLTA before any GOTO or FROM of this tool".into()))?
                    .pose
                    .position;
                let step = [x, y, z].map(|v| v * self.factor);
                self.go_to(line, [last.x + step[0], last.y + step[1], last.z + step[2]])?;
            }
            "TLAXIS" => {
                let values = numbers(rest).map_err(wrong)?;
                self.axis =
                    <[f64; 3]>::try_from(values).map_err(|_| wrong("TLAXIS needs 3 numbers".into()))?;
            }
            "RAPID" => self.rapid = true,
            "UNITS" => {
                let named = rest.trim().to_ascii_lowercase();
                let named = if named == "inches" { "inch" } else { &named };
                let file = LengthUnit::from_str(named).map_err(|error| wrong(error.to_string()))?;
                self.factor = file.in_mm() / unit.in_mm();
            }
            "LOADTL" | "TURRET" | "LOAD" => {
                let number = if word == "LOAD" {
                    rest.trim_start()
                        .strip_prefix("TOOL")
                        .and_then(|rest| rest.trim_start().strip_prefix(','))
                } else {
                    Some(rest)
                };
                let number = number.and_then(|text| text.split(',').next()?.trim().parse().ok());
                self.tool = Some(number.ok_or_else(|| {
                    wrong(format!(
                        "'{statement}' does not say the tool's number: write LOADTL/ and the number"
                    ))
                })?);
                self.loaded = true;
            }
            // What the tool is, in the words of whoever wrote the file.
            "CUTTER" | "TLDATA" | "TOOLNO" => {
                self.describe(line, &word, rest);
                let cutter = match word.as_str() {
                    "CUTTER" => Some(rest),
                    "TLDATA" => rest
                        .trim_start()
                        .strip_prefix("MILL")
                        .and_then(|rest| rest.trim_start().strip_prefix(',')),
                    _ => None,
                };
                if let Some(values) = cutter.filter(|rest| !is_off(rest)) {
                    let statement =
                        self.cutter(line, values).map_err(|what| wrong(format!("{word}: {what}")))?;
                    self.described_since.push(statement);
                }
            }
            "TOOL" if statement.to_ascii_uppercase().starts_with("TOOL PATH") => {
                self.describe(line, "TOOL PATH", rest.rsplit_once("TOOL,").map_or("", |(_, name)| name));
            }
            "AUXFUN" if numbers(rest).is_ok_and(|values| values.first() == Some(&6.0)) => {
                return Err(wrong(
                    "AUXFUN/6 changes the tool without a number: write LOADTL/ and the number".into(),
                ));
            }
            known if is_of(STILL, known) => {}
            known if is_of(TRANSFORMS, known) && changes_nothing(known, rest) => {}
            known if is_of(TRANSFORMS, known) => {
                return Err(wrong(format!(
                    "{statement} changes where the coordinates after it lie, which is not followed here: let the CAM program \
                     write every location in one coordinate system, the part's own"
                )));
            }
            "CYCLE" if is_off(rest) => {}
            moving if is_of(MOVING, moving) => {
                return Err(wrong(format!(
                    "{moving} moves the tool along a way that is not followed here; let the CAM program write that \
                     motion as GOTO/ lines"
                )));
            }
            _ => {
                return Err(wrong(format!(
                    "'{word}' is not understood and might move the tool: take it out of the file if it does not; let the CAM \
                     program write motions as GOTO/ lines if it does"
                )));
            }
        }
        Ok(())
    }

    fn go_to(&mut self, line: usize, position: [f64; 3]) -> Result<(), LineError> {
        if let Some((line, word)) = self.differs.take().filter(|_| !self.loaded) {
            return Err(LineError {
                line,
                what: format!(
                    "{word} describes another tool, and no number is loaded: write LOADTL/ and the number"
                ),
            });
        }
        let pose = pose(line, position, Direction::Axis(self.axis), None)?;
        let kind = if std::mem::take(&mut self.rapid) { MoveKind::Rapid } else { MoveKind::Feed };
        self.locations.push(Location { line, pose, rolled: false, tool: self.tool, kind, machine: None });
        let tool = self.tool;
        self.cutters.extend(self.described_since.drain(..).map(|cutter| CutterStatement { tool, ..cutter }));
        self.loaded = false;
        Ok(())
    }

    /// Diameter and, where it stands there, corner radius; what follows them only says more of tapers.
    fn cutter(&self, line: usize, values: &str) -> Result<CutterStatement, String> {
        let values = numbers(values)?;
        let diameter = *values.first().ok_or("its diameter is missing")? * self.factor;
        let corner_radius = values.get(1).map(|radius| radius * self.factor);
        Ok(CutterStatement { line, tool: self.tool, diameter, corner_radius })
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

fn is_off(rest: &str) -> bool {
    rest.trim().eq_ignore_ascii_case("OFF")
}

/// True where a transformation leaves every coordinate as it is.
fn changes_nothing(word: &str, rest: &str) -> bool {
    let rest = rest.trim().to_ascii_uppercase();
    let are = |wanted: &[f64]| numbers(&rest).is_ok_and(|values| values == wanted);
    match word {
        "CUTCOM" | "LCS" => rest == "OFF",
        "TRACUT" => rest == "NOMORE",
        "MODE" => rest == "MILL" || rest == "ABSOL",
        "TRANS" | "ORIGIN" => are(&[0.0; 3]),
        // Origin, then the directions of x and y.
        "MSYS" => are(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        _ => false,
    }
}

/// Statements with the line they begin on, comments taken out and continuations joined.
fn statements(text: &str) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    for (index, line) in text.lines().enumerate() {
        let line = line.split("$$").next().unwrap_or_default().trim();
        let (line, continues) = match line.strip_suffix('$') {
            Some(start) => (start, true),
            None => (line, false),
        };
        match found.last_mut().filter(|_| open) {
            Some((_, statement)) => statement.push_str(line),
            None => found.push((index + 1, line.to_owned())),
        }
        open = continues;
    }
    found
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(str::trim)
        .map(|field| field.parse().map_err(|_| format!("'{field}' is not a number")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn positions_axes_units_and_tools_are_read() {
        let text = "PARTNO BRACKET 5X / REV 2\n$$ a comment, GOTO/9,9,9\nUNITS/INCHES\nMULTAX/ON\nLOADTL/4,LENGTH,80\n\
                    MSYS/0.0000,0.0000,0.0000,1.0000000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000\nRAPID\n\
                    FROM/0.,0.,1.\nfedrat/20.,IPM\nGOTO / 1., 2.,$\n .5, 0., 0.6, 0.8 $$ tilted\nGOTO/1,2,3\n\
                    GODLTA/0,0,-1\nTLAXIS/1,0,0\nGOTO/0,0,0\nFINI\n";
        let path = parse(text, LengthUnit::Mm).unwrap().locations;
        let lines: Vec<usize> = path.iter().map(|l| l.line).collect();
        assert_eq!(lines, [8, 10, 12, 13, 15]);
        let (position, axis) = (|i: usize| path[i].pose.position, |i: usize| path[i].pose.axis().unwrap());
        assert_eq!(position(0), DVec3::new(0.0, 0.0, 25.4));
        assert!((axis(1) - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-15);
        assert_eq!(axis(2), axis(1));
        assert!((position(3).z - 50.8).abs() < 1e-12);
        assert_eq!(axis(4), DVec3::X);
        assert_eq!((path[0].kind, path[1].kind, path[4].tool), (MoveKind::Rapid, MoveKind::Feed, Some(4)));
    }

    #[test]
    fn tools_are_known_by_number_alone() {
        let of = |text: &str| parse(text, LengthUnit::Mm).map(|path| path.locations.last().unwrap().tool);
        assert_eq!(of("LOAD/TOOL,62,ADJUST,62\nSELECT/TOOL,3\nGOTO/1,2,3\n").unwrap(), Some(62));
        let first = "TOOL PATH/A,TOOL,D10\nTLDATA/MILL,10\nGOTO/1,2,3\n";
        // The same description again, and another one with its number before or after.
        assert_eq!(of(&format!("{first}TOOL PATH/B,TOOL,D10\nTLDATA/MILL,10\nGOTO/1,2,4\n")).unwrap(), None);
        for change in ["TLDATA/MILL,6\nLOADTL/2\n", "LOADTL/2\nTLDATA/MILL,6\n"] {
            assert_eq!(of(&format!("{first}{change}GOTO/1,2,4\n")).unwrap(), Some(2));
        }
        let wrong = of(&format!("{first}TOOL PATH/B,TOOL,D6\nGOTO/1,2,4\n")).unwrap_err();
        assert_eq!(wrong.line, 4);
        assert!(wrong.what.contains("TOOL PATH describes another tool"), "{}", wrong.what);
    }

    #[test]
    fn cutters_are_read_in_the_files_unit_and_belong_to_the_tool_that_follows() {
        let text = "UNITS/INCH\nLOADTL/1\nCUTTER/.5,.125\nGOTO/1,2,3\nTLDATA/MILL,.25,0,3,0,0\nLOADTL/2\nGOTO/1,2,3\n";
        let cutters = parse(text, LengthUnit::Mm).unwrap().cutters;
        let known: Vec<_> = cutters.iter().map(|c| (c.line, c.tool, c.diameter, c.corner_radius)).collect();
        assert_eq!(known, [(3, Some(1), 12.7, Some(3.175)), (5, Some(2), 6.35, Some(0.0))]);
        let wrong = parse("CUTTER/BALL\nGOTO/1,2,3\n", LengthUnit::Mm).unwrap_err();
        assert!(wrong.line == 1 && wrong.what.contains("'BALL' is not a number"), "{}", wrong.what);
    }

    #[test]
    fn what_is_not_followed_is_refused_with_its_line() {
        let cases = [
            ("GOTO/1,2,3\nGOTO/1,2\n", 2, "3 or 6"),
            ("\nGOTO/1,2,x\n", 2, "'x'"),
            ("GODLTA/1,2,3\n", 1, "before any"),
            ("UNITS/FURLONG\n", 1, "furlong"),
            ("GOTO/1,2,3,0,0,0\n", 1, "zero"),
            ("GOTO/1,2,3\nCYCLE/DRILL,9,1\n", 2, "CYCLE moves"),
            ("CIRCLE/0,0,0,0,0,1,5\n", 1, "GOTO/ lines"),
            ("CYCLE/OFF\nFIXTUR/2\n", 2, "'FIXTUR' is not understood"),
            ("INSERT/G54\n", 1, "'INSERT' is not understood"),
            ("GOTO/1,2,3\nTRANS/0,0,50\n", 2, "TRANS/0,0,50 changes where"),
            ("ROTATE/AAXIS,90\n", 1, "changes where"),
            ("ROTABL/90\n", 1, "changes where"),
            ("MSYS/0,0,-50,1,0,0,0,1,0\n", 1, "changes where"),
            ("ORIGIN/1,0,0\n", 1, "changes where"),
            ("COPY/1,TRANSL,5,0,0,3\n", 1, "changes where"),
            ("TRACUT/1\n", 1, "changes where"),
            ("CUTCOM/LEFT\n", 1, "changes where"),
            ("MODE/INCR\n", 1, "changes where"),
            ("LOADTL/BALL6\n", 1, "does not say the tool's number"),
            ("AUXFUN/8\nAUXFUN/6\n", 2, "changes the tool"),
        ];
        for (text, line, what) in cases {
            let Err(wrong) = parse(text, LengthUnit::Mm) else { panic!("{text}") };
            assert_eq!(wrong.line, line, "{text}");
            assert!(wrong.what.contains(what), "{text}: {}", wrong.what);
        }
        let idle =
            "TRANS/0,0,0\nORIGIN/0.,0.,0.\nCUTCOM/OFF\nTRACUT/NOMORE\nCYCLE/OFF\nMODE/MILL\nGOTO/1,2,3\n";
        assert_eq!(parse(idle, LengthUnit::Mm).unwrap().locations.len(), 1);
    }
}
