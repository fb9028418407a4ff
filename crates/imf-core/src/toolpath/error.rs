//! Why a toolpath cannot be read.

use thiserror::Error;

use crate::file_error::{CUT, unended_line};

/// Why a toolpath cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
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
        /// Only a machine gives it a meaning, and the path is read without one.
        needs_machine: bool,
    },
    /// No location at all.
    #[error(
        "{0} holds no tool location: neither lines below a header such as x,y,z,i,j,k nor GOTO/ lines nor G-code that moves x, y and z"
    )]
    Empty(String),
}

/// What is wrong with a line, before its number and the file's name are known.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) line: Option<usize>,
    pub(super) what: String,
    needs_machine: bool,
}

impl Fault {
    /// Of a line that only a machine gives a meaning, where none is given.
    pub(super) fn needs_machine(what: String) -> Self {
        Self { needs_machine: true, ..what.into() }
    }

    /// Refuses a text whose last line has no end and `may_be_cut`.
    pub(super) fn refuse_cut(text: &str, may_be_cut: impl Fn(&str) -> bool) -> Result<(), Self> {
        match unended_line(text.as_bytes()) {
            Some((line, tail)) if may_be_cut(&String::from_utf8_lossy(tail)) => {
                Err(Self::from(format!("{CUT}; if it is whole, end its last line")).on_line(line))
            }
            _ => Ok(()),
        }
    }

    /// On this line, unless it is known to be on another one.
    pub(super) fn on_line(self, line: usize) -> Self {
        Self { line: self.line.or(Some(line)), ..self }
    }

    /// The error of the file called `name`.
    pub(super) fn in_file(self, name: &str) -> ToolpathError {
        let Self { line, what, needs_machine } = self;
        // What a file holds is quoted, and must not reach a terminal as it is.
        let what = what
            .chars()
            .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.into() })
            .collect();
        ToolpathError::Line { path: name.to_owned(), line: line.unwrap_or_default(), what, needs_machine }
    }
}

impl From<String> for Fault {
    fn from(what: String) -> Self {
        Self { line: None, what, needs_machine: false }
    }
}

impl From<&str> for Fault {
    fn from(what: &str) -> Self {
        what.to_owned().into()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::fmt::Debug;

    use super::{Fault, ToolpathError};
    use crate::toolpath::Toolpath;
    use crate::unit::LengthUnit;

    /// A text is refused on a line, in words that say this.
    #[track_caller]
    pub(in crate::toolpath) fn assert_refused<T: Debug>(read: Result<T, Fault>, line: usize, said: &str) {
        let Fault { line: found, what, .. } = read.unwrap_err();
        assert!(found == Some(line) && what.contains(said), "line {line}, {said}: line {found:?}, {what}");
    }

    #[test]
    fn what_only_a_machine_gives_a_meaning_is_distinguished_from_what_is_wrong() {
        let read =
            |text: &str| Toolpath::parse(&format!("G21 G90\n{text}\n"), LengthUnit::Mm, "a.nc").unwrap_err();
        for (text, said) in [
            (
                "G0 X0. A3.",
                "a.nc, line 2: A3. turns a rotary axis, and no machine is given that says what it turns",
            ),
            (
                "G43.4 H1",
                "a.nc, line 2: it keeps the tool's centre point while rotary axes turn, and no machine is given that has some",
            ),
        ] {
            let error = read(text);
            assert!(matches!(error, ToolpathError::Line { line: 2, needs_machine: true, .. }), "{error:?}");
            assert_eq!(error.to_string(), said);
        }
        assert!(matches!(read("G0 X0. V3."), ToolpathError::Line { line: 2, needs_machine: false, .. }));
    }
}
