//! Toolpaths in APT or CL form: `WORD/numbers`, one statement a line.
//!
//! Read are `GOTO/` and `FROM/` (x, y, z and, with an axis, i, j, k; the last axis holds on), `GODLTA/` (a step from
//! where the tool is), `TLAXIS/` (the axis alone) and `UNITS/`. `$$` begins a comment, a `$` at the end continues the
//! statement on the next line. Words that move nothing are skipped, words that move the tool along a way that is not
//! followed here are refused, and any other word is reported, once.

use std::str::FromStr;

use super::{Toolpath, UnknownWord, Wrong, location};
use crate::unit::LengthUnit;

/// Words without a movement of their own.
const STILL: &str = "AUXFUN CLEARP COOLNT CUTCOM CUTTER DELAY DISPLY END END-OF-PATH FEDRAT FINI HEAD INSERT INTOL LEADER LOADTL \
                     MACHIN MODE MSYS MULTAX OPSKIP OPSTOP OUTTOL PAINT PARTNO PPRINT PREFUN RAPID REMARK SELCTL SEQNO \
                     SPINDL STOP TLENGTH TOLER TLDATA TOOL TOOLNO TPRINT TURRET";

/// Words that move the tool along a way of their own; `CYCLE` does at every location that follows.
const MOVING: &str = "CIRCLE CYCLE GOBACK GODOWN GOFWD GOLFT GORGT GOUP SPLINE";

/// True where a word is one of a list.
fn is_of(list: &str, word: &str) -> bool {
    list.split_ascii_whitespace().any(|known| known == word)
}

pub(super) fn parse(text: &str, unit: LengthUnit) -> Result<Toolpath, Wrong> {
    let mut toolpath = Toolpath::default();
    let mut axis = [0.0, 0.0, 1.0];
    let mut factor = 1.0;
    for (line, statement) in statements(text) {
        let (word, rest) = statement.split_once('/').unwrap_or((&statement, ""));
        // PARTNO, PPRINT and their like may be followed by text without a slash.
        let word = word.split_whitespace().next().unwrap_or_default().to_ascii_uppercase();
        let wrong = |what: String| Wrong { line, what };
        match word.as_str() {
            "" => {}
            "GOTO" | "FROM" => {
                let values = numbers(rest).map_err(wrong)?;
                let position = match *values.as_slice() {
                    [x, y, z] => [x, y, z],
                    [x, y, z, i, j, k] => {
                        axis = [i, j, k];
                        [x, y, z]
                    }
                    _ => return Err(wrong(format!("{word} needs 3 or 6 numbers, not {}", values.len()))),
                };
                toolpath.locations.push(location(line, position.map(|v| v * factor), axis)?);
            }
            "GODLTA" => {
                let values = numbers(rest).map_err(wrong)?;
                let [x, y, z] = *values.as_slice() else {
                    return Err(wrong(format!("GODLTA needs 3 numbers, not {}", values.len())));
                };
                let last = toolpath.locations.last();
                let last = last.ok_or_else(|| wrong("GODLTA before any GOTO or FROM".into()))?.position;
                let position = [last.x + x * factor, last.y + y * factor, last.z + z * factor];
                toolpath.locations.push(location(line, position, axis)?);
            }
            "TLAXIS" => {
                let values = numbers(rest).map_err(wrong)?;
                axis = <[f64; 3]>::try_from(values).map_err(|_| wrong("TLAXIS needs 3 numbers".into()))?;
            }
            "UNITS" => {
                let named = rest.trim().to_ascii_lowercase();
                let named = if named == "inches" { "inch" } else { &named };
                let file = LengthUnit::from_str(named).map_err(|error| wrong(error.to_string()))?;
                factor = file.in_mm() / unit.in_mm();
            }
            known if is_of(STILL, known) => {}
            "CYCLE" if rest.trim().eq_ignore_ascii_case("OFF") => {}
            moving if is_of(MOVING, moving) => {
                return Err(wrong(format!(
                    "{moving} moves the tool along a way that is not followed here; let the CAM program write that \
                     motion as GOTO/ lines"
                )));
            }
            _ => match toolpath.unknown.iter_mut().find(|u| u.word == word) {
                Some(unknown) => unknown.times += 1,
                None => toolpath.unknown.push(UnknownWord { word, line, times: 1 }),
            },
        }
    }
    Ok(toolpath)
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
    fn positions_axes_and_units_are_read() {
        let text = "PARTNO BRACKET 5X / REV 2\n$$ a comment, GOTO/9,9,9\nUNITS/INCHES\nMULTAX/ON\nLOADTL/4\nRAPID\n\
                    FROM/0.,0.,1.\nfedrat/20.,IPM\nGOTO / 1., 2.,$\n .5, 0., 0.6, 0.8 $$ tilted\nGOTO/1,2,3\n\
                    GODLTA/0,0,-1\nTLAXIS/1,0,0\nGOTO/0,0,0\nFINI\n";
        let path = parse(text, LengthUnit::Mm).ok().unwrap();
        let lines: Vec<usize> = path.locations.iter().map(|l| l.line).collect();
        assert_eq!(lines, [7, 9, 11, 12, 14]);
        assert_eq!(path.locations[0].position, DVec3::new(0.0, 0.0, 25.4));
        assert_eq!(path.locations[1].axis, DVec3::new(0.0, 0.6, 0.8));
        assert_eq!(path.locations[2].axis, path.locations[1].axis);
        assert!((path.locations[3].position.z - 50.8).abs() < 1e-12);
        assert_eq!(path.locations[4].axis, DVec3::X);
        assert_eq!(path.unknown, []);
    }

    #[test]
    fn unknown_words_are_reported_once() {
        let text = "FIXTUR/1\nGOTO/1,2,3\nCYCLE/OFF\nFIXTUR/2\nVERIFY\nTOOL PATH/A\n";
        let path = parse(text, LengthUnit::Mm).ok().unwrap();
        let unknown: Vec<_> = path.unknown.iter().map(|u| (u.word.as_str(), u.line, u.times)).collect();
        assert_eq!(unknown, [("FIXTUR", 1, 2), ("VERIFY", 5, 1)]);
    }

    #[test]
    fn mistakes_name_their_line() {
        let cases = [
            ("GOTO/1,2,3\nGOTO/1,2\n", 2, "3 or 6"),
            ("\nGOTO/1,2,x\n", 2, "'x'"),
            ("GODLTA/1,2,3\n", 1, "before any"),
            ("UNITS/FURLONG\n", 1, "furlong"),
            ("GOTO/1,2,3,0,0,0\n", 1, "zero"),
            ("GOTO/1,2,3\nCYCLE/DRILL,9,1\n", 2, "CYCLE moves"),
            ("CIRCLE/0,0,0,0,0,1,5\n", 1, "GOTO/ lines"),
        ];
        for (text, line, what) in cases {
            let Err(wrong) = parse(text, LengthUnit::Mm) else { panic!("{text}") };
            assert_eq!(wrong.line, line, "{text}");
            assert!(wrong.what.contains(what), "{text}: {}", wrong.what);
        }
    }
}
