//! A crib's tools as they are read: files, folders of files, whole libraries.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use imf_core::file_error::FileError;
use imf_core::tool::{Element, ElementKind, Tool, ToolShape};
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
    /// Without a holder, the tool's length.
    pub(super) stick_out: f64,
    /// Diameter over stick-out; 0 of a mesh.
    pub(super) rigidity: f64,
}

impl CribTool {
    pub(super) fn new(tool: &Tool) -> Self {
        let diameter = match &tool.shape {
            ToolShape::Revolved(elements) => {
                let cutter = elements.iter().filter(|e| e.kind == ElementKind::Cutter);
                cutter.map(|e| 2.0 * Element::max_radius(e)).reduce(f64::max)
            }
            ToolShape::Mesh(_) => None,
        };
        let stick_out = tool.stick_out().unwrap_or_else(|| tool.length());
        Self {
            name: tool.name.clone(),
            diameter,
            stick_out,
            rigidity: diameter.map_or(0.0, |diameter| diameter / stick_out),
        }
    }
}

/// All tools that the paths name, names made their own, and those that a library has and we cannot describe.
pub(super) fn read(paths: &[String]) -> Result<(Vec<Tool>, Vec<UndecidedTool>)> {
    let (mut tools, mut undecided) = (Vec::new(), Vec::new());
    for text in paths {
        let path = Path::new(text);
        if !path.exists() {
            // Of a library the one behind its #, or the error that says what is missing.
            tools.push(read_tool(text)?);
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
                    Ok(tool) => tools.push(tool),
                    Err(error) => undecided.push(UndecidedTool::of_file(&error)),
                }
            }
        }
    }
    let mut seen: HashMap<String, usize> = HashMap::new();
    for tool in &mut tools {
        let times = seen.entry(tool.name.clone()).or_default();
        *times += 1;
        if *times > 1 {
            tool.name = format!("{} ({times})", tool.name);
        }
    }
    Ok((tools, undecided))
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
