//! Tools out of the libraries of CAM programs: FreeCAD's tool bits (`.fctb`) and Fusion's libraries (`.json` as exported, or
//! `.tools`, the same zipped).
//!
//! A tool of a library with several is named behind a `#`: `tools.json#1/4 in ball` by its description or product number,
//! `tools.json#5` by its number in the machine. What the file says of cutter, shoulder, shaft and holder becomes elements; what
//! has no place in a stack of bodies of revolution is refused by name, never left out. FreeCAD's bits know no holder, and no tool
//! here has other sharp points than its tip.

mod bodies;
mod freecad;
mod fusion;

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{Tool, ToolError};

/// Why a library gives no tool. Every message names the file.
#[derive(Debug, Error)]
pub enum ToolLibraryError {
    /// The file cannot be read.
    #[error("cannot read the tool library {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is not what its ending says.
    #[error("{path} is no intact tool library: {what}; export it again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// Several tools, or none, answer to the name.
    #[error("{path}: {what}; its tools are: {}", listed(.tools))]
    Choice {
        /// The file.
        path: PathBuf,
        /// What was asked.
        what: String,
        /// What there is.
        tools: Vec<String>,
    },
    /// The tool cannot be described by elements.
    #[error("{path}, tool '{tool}': {what}; describe it in a tool file (TOML) instead")]
    Tool {
        /// The file.
        path: PathBuf,
        /// The tool.
        tool: String,
        /// What is missing, wrong, or without a place.
        what: String,
    },
    /// The assembly has no volume.
    #[error("{path}: {source}")]
    Empty {
        /// The file.
        path: PathBuf,
        /// What is wrong with the tool.
        source: ToolError,
    },
}

/// What is wrong with `FILE#`: an empty name would be answered by whatever tool happens to have none.
const NAMELESS: &str = "no tool is named behind the #";

/// Names that a message lists.
const LISTED: usize = 20;

fn listed(tools: &[String]) -> String {
    if tools.is_empty() {
        return "none".into();
    }
    let more = tools.len().saturating_sub(LISTED);
    let names = tools.iter().take(LISTED).map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{names} and {more} more") } else { names }
}

/// Which program's file it is.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    FreeCad,
    Fusion,
}

fn kind(path: &Path) -> Option<Kind> {
    let ending = path.extension()?.to_ascii_lowercase();
    match ending.to_str()? {
        "fctb" => Some(Kind::FreeCad),
        "json" | "tools" => Some(Kind::Fusion),
        _ => None,
    }
}

/// True for a file whose ending is that of a library.
pub(super) fn is_library(path: &Path) -> bool {
    kind(path).is_some()
}

/// A path and, behind a `#`, the tool that is meant: only where there is no file of the whole name.
pub(super) fn location(text: &str) -> (&Path, Option<&str>) {
    if Path::new(text).exists() {
        return (Path::new(text), None);
    }
    // Names hold a `#` as well ("#7 drill"), and so may folders: the first one behind a library counts, else the last.
    let mut places = text.match_indices('#').map(|(place, _)| text.split_at(place));
    let found = places.find(|(path, _)| is_library(Path::new(path)));
    match found.map(|(path, tool)| (path, &tool[1..])).or_else(|| text.rsplit_once('#')) {
        Some((path, tool)) => (Path::new(path), Some(tool)),
        None => (Path::new(text), None),
    }
}

/// Reads the tool of a library that `wanted` names, or its only one.
pub(super) fn read(path: &Path, wanted: Option<&str>) -> Result<Tool, ToolLibraryError> {
    let bytes = std::fs::read(path).map_err(|source| ToolLibraryError::Read { path: path.into(), source })?;
    let tool = match kind(path) {
        Some(Kind::FreeCad) => freecad::tool(path, &bytes, wanted)?,
        _ => fusion::tool(path, &bytes, wanted)?,
    };
    tool.check().map_err(|source| ToolLibraryError::Empty { path: path.into(), source })?;
    Ok(tool)
}

#[cfg(test)]
mod tests;
