//! `imf info`: what a mesh, a tool, a dataset or a model is.

mod devices;
mod fields;
mod geometry;

use std::path::Path;
use std::str::FromStr;

use anyhow::{Result, bail};
use imf_core::parts::ReferencePart;
use imf_core::tool::Tool;
use imf_core::unit::LengthUnit;
use serde_json::Value;

use super::field::is_field;
use crate::arguments::InfoArguments;
use crate::arguments::explicit::applies_only;
use crate::engine::read_field;
use crate::output::{aligned, print_result};
use crate::session::Session;

type Line = (&'static str, String);

struct Description {
    /// Names and values, aligned when they are printed.
    lines: Vec<Line>,
    json: Value,
}

pub(crate) fn run(session: &Session, arguments: &InfoArguments) -> Result<()> {
    let described =
        arguments.what.as_ref().map(|what| describe(session, what, arguments.unit)).transpose()?;
    let is_mesh = described.as_ref().is_some_and(|description| description.json["kind"] == "mesh");
    if arguments.unit.is_some() && !is_mesh {
        return Err(applies_only("unit", "the files of meshes"));
    }
    let Some(Description { lines, json }) = described else { return devices::run(session) };
    print_result(session, &json, &aligned(&lines))
}

/// Decides by what is there: a folder, else the ending of a file; a name of which there is no file is built in.
fn describe(session: &Session, path: &Path, unit: Option<LengthUnit>) -> Result<Description> {
    if !path.exists() {
        let name = path.to_string_lossy();
        if let Ok(part) = ReferencePart::from_str(&name) {
            return Ok(geometry::part(part));
        }
        if name == "paper" {
            return Ok(geometry::tool(session, &Tool::paper()));
        }
        if name.contains('#') {
            return Ok(geometry::tool(session, &Tool::find(&name)?));
        }
        if path.extension().is_none() {
            bail!(
                "there is no file or folder {name}, and no built-in part of that name (teapot, bracket, bracket-raw, \
                 screw-gear; the tool paper)"
            );
        }
    }
    if path.is_dir() {
        return fields::dataset(path);
    }
    if is_field(path) {
        return fields::field(path, &read_field(session, path)?);
    }
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        Some("toml" | "fctb" | "json" | "tools") => Ok(geometry::tool(session, &Tool::read(path)?)),
        _ => geometry::mesh_file(session, path, unit),
    }
}
