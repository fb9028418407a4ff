//! A crib's tools as they are read: files, folders of files, whole libraries.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use imf_core::file_error::FileError;
use imf_core::tool::{ElementKind, Tool, ToolShape};
use serde::Serialize;

use crate::arguments::inputs::read_tool;

/// Endings of the files that are tools, in a folder.
const ENDINGS: [&str; 4] = ["toml", "fctb", "json", "tools"];

#[derive(Clone, Debug, Serialize)]
pub(super) struct UndecidedTool {
    pub(super) tool: String,
    pub(super) why: String,
}

impl UndecidedTool {
    pub(super) fn new(tool: &str, why: &dyn std::fmt::Display) -> Self {
        Self { tool: tool.to_owned(), why: why.to_string() }
    }

    /// A tool, or tools, whose name is not known.
    fn of_file(error: &FileError) -> Self {
        let line = error.fault.line.map(|line| format!("line {line}: ")).unwrap_or_default();
        Self { tool: error.path.display().to_string(), why: line + &error.fault.cause }
    }
}

/// What a crib says of a tool, in the part's unit.
#[derive(Clone, Debug, Serialize)]
pub(super) struct CribTool {
    #[serde(rename = "tool")]
    pub(super) name: String,
    /// Of the cutter; nothing of a mesh.
    pub(super) diameter: Option<f64>,
    /// Nothing without a holder.
    pub(super) stick_out: Option<f64>,
    /// Diameter over stick-out, that of the shank where it is thinner than the cutter; nothing of a mesh, and without a holder.
    pub(super) rigidity: Option<f64>,
    /// The file that it came from.
    pub(super) file: String,
}

impl CribTool {
    pub(super) fn new(tool: &Tool, file: String) -> Self {
        let elements = match &tool.shape {
            ToolShape::Revolved(elements) => &elements[..],
            ToolShape::Mesh(_) => &[],
        };
        let of = |kind: ElementKind| elements.iter().filter(move |element| element.kind == kind);
        let diameter = of(ElementKind::Cutter).map(|cutter| 2.0 * cutter.max_radius()).reduce(f64::max);
        let shank =
            of(ElementKind::Shank).map(|shank| 2.0 * shank.min_radius()).fold(f64::INFINITY, f64::min);
        let stick_out = tool.stick_out();
        let rigidity = diameter.zip(stick_out).map(|(cutter, long)| cutter.min(shank) / long);
        Self { name: tool.name.clone(), diameter, stick_out, rigidity, file }
    }

    /// Tools of which nothing is known come last.
    pub(super) fn by_rigidity(&self, other: &Self) -> Ordering {
        let rank = |tool: &Self| tool.rigidity.unwrap_or(0.0);
        rank(other).total_cmp(&rank(self))
    }
}

/// Tools as they are read.
pub(super) struct Read {
    /// No two have the same name.
    pub(super) tools: Vec<Tool>,
    /// By tool, the file.
    pub(super) files: Vec<String>,
    pub(super) undecided: Vec<UndecidedTool>,
}

/// All tools that the paths name, and those that a library has and we cannot describe.
pub(super) fn read(paths: &[String]) -> Result<Read> {
    let (mut tools, mut files_of_tools, mut undecided) = (Vec::new(), Vec::new(), Vec::new());
    for text in paths {
        let path = Path::new(text);
        if !path.exists() {
            // Of a library the one behind its #, or the error that says what is missing.
            tools.push(read_tool(text)?);
            files_of_tools.push(text.clone());
            continue;
        }
        for file in files(path)? {
            let found = match Tool::read_all(&file) {
                Ok(found) => found,
                // Of a folder the other files are of use, whatever one of them is.
                Err(error) if path.is_dir() => vec![Err(error)],
                Err(error) => return Err(error).context("its tools cannot be used"),
            };
            for tool in found {
                match tool {
                    Ok(tool) => {
                        tools.push(tool);
                        files_of_tools.push(file.display().to_string());
                    }
                    Err(error) => undecided.push(UndecidedTool::of_file(&error)),
                }
            }
        }
    }
    let mut names = HashSet::new();
    for tool in &mut tools {
        let numbered = (2..).map(|times| format!("{} ({times})", tool.name));
        let mut free = std::iter::once(tool.name.clone()).chain(numbered);
        tool.name = free.find(|name| names.insert(name.clone())).unwrap_or_default();
    }
    Ok(Read { tools, files: files_of_tools, undecided })
}

/// The file, or a folder's files by name.
fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).with_context(|| path.display().to_string())?;
    let mut files = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<PathBuf>>>()?;
    files.retain(|file| {
        let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        file.is_file() && ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    });
    files.sort();
    ensure!(!files.is_empty(), "{} holds no tool: no .toml, .fctb, .json or .tools file", path.display());
    Ok(files)
}
