//! `imf info`: what a mesh, a tool, a dataset or a model is.

mod dataset;
mod devices;
mod factored;
mod harmonic;
mod mesh;
mod model;
mod tool;

use std::path::Path;
use std::str::FromStr;

use anyhow::{Result, bail};
use glam::DMat4;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneRecord;
use imf_core::section::{DEPTH_CAP, Quantity};
use imf_core::tool::Tool;
use imf_fields::calibration::Calibration;
use imf_fields::file::FieldFile;
use serde_json::Value;

use super::calibrate::judgement;
use crate::arguments::InfoArguments;
use crate::arguments::clearance::clearance_text;
use crate::output::{print, print_json, short};
use crate::session::Session;

/// The answer, for people and for scripts.
struct Description {
    /// Names and values, aligned when they are printed.
    lines: Vec<(&'static str, String)>,
    json: Value,
}

pub(crate) fn run(session: &Session, arguments: &InfoArguments) -> Result<()> {
    let Some(what) = &arguments.what else { return devices::run(session) };
    let Description { lines, json } = describe(session, what, arguments)?;
    if session.json {
        return print_json(&json);
    }
    let width = lines.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let text = lines.iter().map(|(name, value)| format!("{name:<width$}  {value}\n"));
    print(&text.collect::<String>())
}

/// Decides by what is there: a folder, else the ending of a file; a name of which there is no file is built in.
fn describe(session: &Session, path: &Path, arguments: &InfoArguments) -> Result<Description> {
    let unit = arguments.unit.as_deref().map(str::parse).transpose()?;
    if !path.exists() {
        let name = path.to_string_lossy();
        if let Ok(part) = ReferencePart::from_str(&name) {
            return Ok(mesh::describe_part(part));
        }
        if name == "paper" {
            return Ok(tool::describe(&Tool::paper()));
        }
        if name.contains('#') {
            return Ok(tool::describe(&Tool::find(&name)?));
        }
        if path.extension().is_none() {
            bail!(
                "there is no file or folder {name}, and no built-in part of that name (teapot, bracket, bracket-raw, \
                 screw-gear; the tool paper)"
            );
        }
    }
    if path.is_dir() {
        return dataset::describe(path);
    }
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        Some("toml" | "fctb" | "json" | "tools") => Ok(tool::describe(&Tool::read(path)?)),
        Some("safetensors") => match FieldFile::read(path)? {
            FieldFile::Siren(model) => model::describe(path, &model),
            FieldFile::Harmonic(file) => harmonic::describe(path, &file),
            FieldFile::Factored(file) => factored::describe(path, &file),
        },
        _ => mesh::describe_file(session, path, unit),
    }
}

/// What a field's decisions are worth.
fn calibration_lines(calibration: Option<&Calibration>) -> Vec<(&'static str, String)> {
    let Some(known) = calibration else {
        return vec![("decisions", "not calibrated: imf calibrate measures what they are worth".into())];
    };
    let threshold = |value: Option<f32>| value.map_or("never".into(), |v| format!("{v:.3e}"));
    vec![
        (
            "decisions",
            format!(
                "free up to {}, colliding from {}, undecided between; bounds at {} % confidence",
                threshold(known.free_up_to),
                threshold(known.colliding_from),
                known.goals.confidence * 100.0
            ),
        ),
        ("  anywhere", judgement(&known.uniform)),
        ("  at contact", judgement(&known.boundary)),
    ]
}

/// What a field's values are.
fn quantity_text(quantity: Quantity, scene: &SceneRecord) -> String {
    let unit = scene.unit;
    match quantity {
        Quantity::Overlap => "overlap: the share of the tool's volume that lies in the part".into(),
        Quantity::Depth => {
            let [_, most] = quantity.bounds(scene.grid.pitch);
            format!(
                "depth in {unit}: how far the tool must be moved to be free, below 0 how far it may be moved; held within \
                 {DEPTH_CAP} pitches, {} {unit}",
                short(most)
            )
        }
    }
}

/// What a learnt or fitted field was made for: its own values guarantee nothing.
fn field_lines(scene: &SceneRecord) -> Vec<(&'static str, String)> {
    let mut lines = scene_lines(scene);
    for (name, text) in &mut lines {
        if *name == "guarantee" {
            *text =
                format!("none by its own values, which are estimates; what is counted (--exact) is {text}");
        }
    }
    lines
}

/// What samples were made for, or a field.
fn scene_lines(scene: &SceneRecord) -> Vec<(&'static str, String)> {
    let (grid, unit, tool) = (&scene.grid, scene.unit, scene.bare_tool());
    let [x, y, z] = grid.dims;
    let rule = if scene.conservative { "every voxel that the surface touches" } else { "voxel centres" };
    let surface = if scene.closed { "closed" } else { "open" };
    let mut lines = vec![
        ("part", format!("{} ({surface} mesh; solid: {rule})", scene.part)),
        ("grid", format!("{x}×{y}×{z}, pitch {} {unit}, margin {}", short(grid.pitch), scene.margin)),
        (
            "tool",
            format!(
                "{}, length {} {unit}, reach {} {unit}",
                tool.name,
                short(tool.length()),
                short(tool.reach())
            ),
        ),
    ];
    if let Some(depth) = scene.contact {
        lines.push(("contact", format!("the cutter may reach {depth} {unit} below the part's surface")));
    }
    if let Some(text) = clearance_text(&scene.clearance, unit) {
        lines.push(("clearance", format!("{text}: the field is that of the grown tool")));
    }
    lines.push(("guarantee", scene.guarantee().to_string()));
    if scene.transform != DMat4::IDENTITY {
        let rows = scene.transform.transpose().to_cols_array_2d();
        let row = |r: [f64; 4]| r.map(short).join(" ");
        lines.push(("set-up", rows[..3].iter().map(|&r| row(r)).collect::<Vec<_>>().join("; ")));
    }
    lines
}
