//! What is wrong with a file: one error for meshes, tools and tool libraries that are read, one for all that is written.

use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

#[cfg(feature = "formats")]
pub use crate::atomic_file::AtomicFileError;

/// A file that could not be read. Its text names the file, the line where it is known, the cause and a remedy.
#[derive(Debug, Error)]
#[error("{}{}: {}", .path.display(), .fault.line.map(|line| format!(", line {line}")).unwrap_or_default(), .fault.cause)]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with a file's content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The kind of fault, for programs.
    pub kind: FaultKind,
    /// The line, from 1, where it is known.
    pub line: Option<usize>,
    /// Cause and remedy, human-readable.
    pub cause: String,
}

/// Kinds of faults of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultKind {
    /// There is no such file.
    Missing,
    /// The system refuses to read it.
    Unreadable,
    /// It is in a format that is not read.
    Format,
    /// There is nothing to work on.
    Empty,
    /// The content does not follow the format.
    Malformed,
    /// It ends too early.
    Truncated,
    /// It holds more than can be indexed, or than such a file ever holds.
    TooLarge,
}

/// What is wrong with a file whose last line has no end and cannot be told from one that was cut.
pub(crate) const CUT: &str = "the file ends in the middle of a line, perhaps of a number";

/// The last line of a text, with its number, where nothing ends it. Writers end the last line; a file that was cut may end in the
/// middle of a number, which cannot be distinguished from a shorter number.
pub(crate) fn unended_line(bytes: &[u8]) -> Option<(usize, &[u8])> {
    let (number, line) = bytes.split(|&byte| byte == b'\n').enumerate().last()?;
    (!line.trim_ascii().is_empty()).then_some((number + 1, line))
}

impl Fault {
    pub(crate) fn new(kind: FaultKind, cause: impl Into<String>) -> Self {
        Self { kind, line: None, cause: cause.into() }
    }

    pub(crate) fn malformed(cause: impl Into<String>) -> Self {
        Self::new(FaultKind::Malformed, cause)
    }

    #[cfg(feature = "formats")]
    pub(crate) fn truncated(cause: impl std::fmt::Display) -> Self {
        Self::new(FaultKind::Truncated, format!("cut short: {cause}"))
    }

    pub(crate) fn on_line(self, line: usize) -> Self {
        Self { line: Some(line), ..self }
    }

    /// What the system said when a file was to be read; `noun` is the kind of file.
    pub(crate) fn of_system(noun: &str, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => {
                let cause = format!("there is no {noun} of this name; check the name and the folder");
                Self::new(FaultKind::Missing, cause)
            }
            _ => {
                let cause =
                    format!("cannot read it: {error}; check that it is a file and that you may read it");
                Self::new(FaultKind::Unreadable, cause)
            }
        }
    }

    pub(crate) fn at(self, path: &Path) -> FileError {
        FileError { path: path.to_owned(), fault: self }
    }
}

/// The longest text file of a tool or a machine; a library of ten thousand tools is shorter.
#[cfg(feature = "formats")]
const MOST: u64 = 64 << 20;

/// The content of a small file; `noun` is its kind. What never ends, as some devices, is not read to its end.
#[cfg(feature = "formats")]
pub(crate) fn read_small(noun: &str, path: &Path) -> Result<Vec<u8>, Fault> {
    use io::Read as _;
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(MOST + 1).read_to_end(&mut bytes));
    read.map_err(|error| Fault::of_system(noun, &error))?;
    if bytes.len() as u64 > MOST {
        let cause = format!("it is longer than {} MiB, as no {noun} is; check the name", MOST >> 20);
        return Err(Fault::new(FaultKind::TooLarge, cause));
    }
    Ok(bytes)
}

/// A file's content, in UTF-8 where it is UTF-16 with a byte order mark, as some editors and shells save text.
pub(crate) fn as_utf8(bytes: &[u8]) -> Cow<'_, [u8]> {
    let unit = match bytes {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ => return Cow::Borrowed(bytes),
    };
    let units = bytes[2..].chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    let text = char::decode_utf16(units).map(|read| read.unwrap_or(char::REPLACEMENT_CHARACTER));
    Cow::Owned(text.collect::<String>().into_bytes())
}

/// A file's content as text.
#[cfg(feature = "formats")]
pub(crate) fn text_of(bytes: &[u8]) -> Result<String, Fault> {
    let text = String::from_utf8(as_utf8(bytes).into_owned());
    text.map_err(|_| Fault::malformed("it is not text in UTF-8: save it as that"))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Text as UTF-16, in both orders of bytes.
    pub(crate) fn as_utf16(text: &str) -> [Vec<u8>; 2] {
        let units = || std::iter::once(0xfeff).chain(text.encode_utf16());
        [units().flat_map(u16::to_le_bytes).collect(), units().flat_map(u16::to_be_bytes).collect()]
    }

    #[test]
    fn text_in_utf_16_is_read_as_in_utf_8() {
        let text = "v 0 0 0 # °\r\n";
        assert!(as_utf16(text).iter().all(|bytes| *as_utf8(bytes) == *text.as_bytes()));
        assert_eq!(*as_utf8(b"\xff\xfe\0\xd8v\0\0"), *"\u{fffd}v".as_bytes());
        assert_eq!(*as_utf8(text.as_bytes()), *text.as_bytes());
    }
}
