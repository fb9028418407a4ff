//! Meshes: files and built-in parts.

use std::path::Path;

use anyhow::Result;
use imf_core::mesh::read::read_mesh_file;
use imf_core::mesh::topology::MeshReport;
use imf_core::parts::ReferencePart;
use imf_core::unit::{LengthUnit, unit_check};
use serde_json::json;

use super::Description;
use crate::session::Session;

pub(super) fn describe_part(part: ReferencePart) -> Description {
    let report = MeshReport::new(&part.mesh());
    let whose = if part.is_papers_own() { "the paper's own part" } else { "ours, in the paper's style" };
    let mut lines = vec![
        ("built-in", format!("{part}: {}", part.description())),
        ("whose", whose.to_owned()),
        ("grid", part.dims().map(|d| d.to_string()).join("×")),
    ];
    lines.extend(report_lines(&report, LengthUnit::Mm));
    let json = json!({
        "kind": "reference part",
        "name": part.name(),
        "description": part.description(),
        "papers_own": part.is_papers_own(),
        "dims": part.dims(),
        "unit": "mm",
        "mesh": report,
    });
    Description { lines, json }
}

pub(super) fn describe_file(
    session: &Session,
    path: &Path,
    given: Option<LengthUnit>,
) -> Result<Description> {
    let file = read_mesh_file(path)?;
    let unit = given.or(file.unit).unwrap_or_default();
    let report = MeshReport::new(&file.mesh);
    let implausible = unit_check(report.extents, unit).map(|what| what.to_string());
    if let Some(what) = &implausible {
        session.warn(&format!("{}: {what}", path.display()));
    }
    let mut lines = vec![("mesh", path.display().to_string())];
    lines.extend(report_lines(&report, unit));
    let json = json!({
        "kind": "mesh",
        "file": path,
        "unit": unit,
        "mesh": report,
        "implausible_size": implausible,
    });
    Ok(Description { lines, json })
}

/// The report's own lines, whose names are known.
fn report_lines(report: &MeshReport, unit: LengthUnit) -> Vec<(&'static str, String)> {
    let text = report.display(unit).to_string();
    let value = |name: &'static str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        line.map(|value| (name, value.trim().to_owned()))
    };
    ["extents", "triangles", "surface"].into_iter().filter_map(value).collect()
}
