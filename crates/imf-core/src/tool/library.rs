//! Tools out of the libraries of CAM programs: FreeCAD's tool bits (`.fctb`) and Fusion's libraries (`.json` as exported, or
//! `.tools`, the same zipped).
//!
//! A tool of a library with several is named behind a `#`: `tools.json#1/4 in ball` by its description or product number,
//! `tools.json#5` by its number in the machine. What the file says of cutter, shoulder, shaft and holder becomes elements; what
//! has no place in a stack of bodies of revolution is refused by name, never left out. FreeCAD's bits know no holder, and no tool
//! here has other sharp points than its tip.

mod freecad;
mod fusion;

use std::path::Path;

use super::Tool;
use super::stack::{Stack, end_mill, line, pointed, top};
use crate::file_error::Fault;

/// The message for `FILE#`: an empty name would match any tool without a name.
const NAMELESS: &str = "no tool is named behind the #";

/// Names that a message lists.
const LISTED: usize = 20;

/// Several tools, or none, have the name.
fn no_choice(what: &str, tools: &[String]) -> Fault {
    Fault::malformed(format!("{what}; its tools are: {}", listed(tools)))
}

/// The file is not what its ending says.
fn damaged(what: impl std::fmt::Display) -> Fault {
    Fault::malformed(format!("it is no intact tool library: {what}; export it again"))
}

/// What is missing in a tool, wrong, or without a place among elements.
fn refused(tool: &str, what: &str) -> Fault {
    Fault::malformed(format!(
        "tool '{tool}': {what}; describe it in a tool file (TOML) instead, as a mesh where no shape of it fits"
    ))
}

fn listed(tools: &[String]) -> String {
    if tools.is_empty() {
        return "none".into();
    }
    let more = tools.len().saturating_sub(LISTED);
    let names = tools.iter().take(LISTED).map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{names} and {more} more") } else { names }
}

/// True for a file whose ending is one of these.
fn ends_in(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|ending| endings.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// True for a file whose ending is that of a library.
pub(super) fn is_library(path: &Path) -> bool {
    ends_in(path, &["fctb", "json", "tools"])
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

/// The tool of a library that `wanted` names, or its only one.
pub(super) fn tool(path: &Path, bytes: &[u8], wanted: Option<&str>) -> Result<Tool, Fault> {
    if ends_in(path, &["fctb"]) { freecad::tool(bytes, wanted) } else { fusion::tool(bytes, wanted) }
}

/// All tools of a library.
pub(super) fn tools(path: &Path, bytes: &[u8]) -> Result<Vec<Result<Tool, Fault>>, Fault> {
    if ends_in(path, &["fctb"]) { Ok(vec![freecad::tool(bytes, None)]) } else { fusion::tools(bytes) }
}

#[cfg(test)]
mod tests;
