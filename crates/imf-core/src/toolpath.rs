//! Toolpaths of five axes: where the tip goes and how the tool is turned, line by line of the file it came from.
//!
//! Positions are the tool's tip; axes point from the tip to the holder. Between two lines the tip moves straight and
//! the axis turns along the great circle, both evenly, as in [`Pose::interpolate`](crate::pose::Pose::interpolate).

mod apt;
mod csv;

use std::path::Path;

use glam::DVec3;
use serde::Serialize;
use thiserror::Error;

use crate::unit::LengthUnit;

/// A tip position with an axis, and the line that says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Line of the file, from 1.
    pub line: usize,
    /// The tip.
    pub position: DVec3,
    /// Unit vector from the tip to the holder.
    pub axis: DVec3,
}

/// A word that is not understood: if it moves the tool, that movement is not known.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UnknownWord {
    /// The word.
    pub word: String,
    /// Line at which it stands first.
    pub line: usize,
    /// How often it stands.
    pub times: usize,
}

/// The locations of a file in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Toolpath {
    /// In the order of the file.
    pub locations: Vec<Location>,
    /// Each word once, in the order of the file.
    pub unknown: Vec<UnknownWord>,
}

/// Why a toolpath cannot be read.
#[derive(Debug, Error)]
pub enum ToolpathError {
    /// The file cannot be read.
    #[error("cannot read the toolpath {path}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A line is wrong.
    #[error("{path}, line {line}: {what}")]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        what: String,
    },
    /// No location at all.
    #[error("{0} holds no tool location: neither lines x,y,z,i,j,k nor GOTO/ lines")]
    Empty(String),
}

/// What is wrong with a line, before the file's name is known.
struct Wrong {
    line: usize,
    what: String,
}

impl Toolpath {
    /// Reads a CSV file (`x,y,z,i,j,k`) or an APT/CL file (`GOTO/x,y,z,i,j,k`), distinguished by the words in it. Lengths
    /// become those of `unit`: a CSV file is taken to be in it, an APT file too unless it has a `UNITS/` line.
    ///
    /// # Errors
    /// Names the file and the line that is wrong.
    pub fn read(path: &Path, unit: LengthUnit) -> Result<Self, ToolpathError> {
        let name = path.display().to_string();
        let bytes =
            std::fs::read(path).map_err(|source| ToolpathError::Read { path: name.clone(), source })?;
        // Comments may be in any encoding; what counts is ASCII.
        Self::parse(&String::from_utf8_lossy(&bytes), unit, &name)
    }

    /// As [`Toolpath::read`], from the text of a file called `name`.
    ///
    /// # Errors
    /// Names the file and the line that is wrong.
    pub fn parse(text: &str, unit: LengthUnit, name: &str) -> Result<Self, ToolpathError> {
        let is_apt = text.lines().any(|line| {
            let word = line.split('/').next().unwrap_or_default().trim();
            line.contains('/') && !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric())
        });
        let toolpath = if is_apt { apt::parse(text, unit) } else { csv::parse(text) };
        let toolpath = toolpath.map_err(|Wrong { line, what }| ToolpathError::Line {
            path: name.to_owned(),
            line,
            what,
        })?;
        if toolpath.locations.is_empty() {
            return Err(ToolpathError::Empty(name.to_owned()));
        }
        Ok(toolpath)
    }
}

/// A location from its numbers, checked.
fn location(line: usize, position: [f64; 3], axis: [f64; 3]) -> Result<Location, Wrong> {
    let position = DVec3::from_array(position);
    if !position.is_finite() {
        return Err(Wrong { line, what: "a position must be finite".into() });
    }
    let axis = DVec3::from_array(axis).try_normalize();
    let axis = axis.ok_or_else(|| Wrong { line, what: "the tool axis must not be zero".into() })?;
    Ok(Location { line, position, axis })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_recognised_and_missing_files_named() {
        let unit = LengthUnit::Mm;
        let apt = Toolpath::parse("PARTNO A/B\nGOTO/1,2,3\n", unit, "a").unwrap();
        let csv = Toolpath::parse("x,y,z\n1,2,3\n", unit, "b").unwrap();
        assert_eq!(apt.locations[0].position, csv.locations[0].position);
        assert!(matches!(Toolpath::parse("\n", unit, "c"), Err(ToolpathError::Empty(_))));
        let error = Toolpath::read(Path::new("no/such/path.apt"), unit).unwrap_err();
        assert!(error.to_string().contains("no/such/path.apt"));
    }
}
