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
use super::profile::top;
use super::stack::{ROUNDED_DIGITS, Stack, end_mill, line, pointed};
use crate::file_error::Fault;

/// Names that a message lists.
const LISTED: usize = 20;

/// A tool of a library.
struct Entry {
    /// What people call it.
    title: String,
    /// What it can be named by behind the `#`.
    names: Vec<String>,
    tool: Result<Tool, Fault>,
}

/// The file is not what its ending says.
fn damaged(what: impl std::fmt::Display) -> Fault {
    Fault::malformed(format!("it is not an intact tool library: {what}; export it again"))
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

/// True for a file of FreeCAD's.
fn is_bit(path: &Path) -> bool {
    ends_in(path, &["fctb"])
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
    let entries = if is_bit(path) { vec![freecad::entry(bytes)?] } else { fusion::entries(bytes)? };
    let titles: Vec<String> = entries.iter().map(|entry| entry.title.clone()).collect();
    let wanted = wanted.map(str::trim);
    let is_wanted = |entry: &Entry| match wanted {
        // It would match any tool without a name.
        Some("") => false,
        Some(wanted) => entry.names.iter().any(|name| name.trim().eq_ignore_ascii_case(wanted)),
        None => true,
    };
    let mut found: Vec<Entry> = entries.into_iter().filter(is_wanted).collect();
    let what = match (found.len(), wanted) {
        (1, _) => return found.remove(0).tool,
        (count, None) => format!("it holds {count} tools; name one, as in FILE#NAME"),
        (_, Some("")) => "no tool is named behind the #".into(),
        (0, Some(wanted)) => format!("no tool of it is called '{wanted}'"),
        (count, Some(wanted)) => format!(
            "{count} tools of it are called '{wanted}': name one by its number, or give them names of their own"
        ),
    };
    Err(Fault::malformed(format!("{what}; its tools are: {}", listed(&titles))))
}

/// All tools of a library.
pub(super) fn tools(path: &Path, bytes: &[u8]) -> Result<Vec<Result<Tool, Fault>>, Fault> {
    if is_bit(path) {
        return Ok(vec![tool(path, bytes, None)]);
    }
    Ok(fusion::entries(bytes)?.into_iter().map(|entry| entry.tool).collect())
}

#[cfg(test)]
mod tests;
