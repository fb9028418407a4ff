//! Meshes, built-in parts and tools.

use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use imf_core::mesh::read::read_mesh_file;
use imf_core::mesh::topology::MeshReport;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneWarning;
use imf_core::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
use imf_core::unit::{LengthUnit, unit_check};
use serde_json::json;

use super::{Description, Line};
use crate::arguments::scene::warn_of;
use crate::commands::parts::origin;
use crate::output::{short, show_measure};
use crate::session::Session;

pub(super) fn part(part: ReferencePart) -> Description {
    let report = MeshReport::new(&part.mesh());
    let mut lines = vec![
        ("built-in", format!("{part}: {}", part.description())),
        ("whose", origin(part).to_owned()),
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

pub(super) fn mesh_file(session: &Session, path: &Path, given: Option<LengthUnit>) -> Result<Description> {
    let file = read_mesh_file(path)?;
    let said = given.or(file.unit);
    let unit = said.unwrap_or_default();
    if let (Some(given), Some(stated)) = (given, file.unit)
        && given != stated
    {
        session.warn(&format!("{} says that it is in {stated}; --unit {given} overrules it", path.display()));
    }
    let (mesh, repair) = file.mesh.with_consistent_faces();
    let report = MeshReport::new(&mesh);
    warn_of(session, &SceneWarning::of_repair(&path.display().to_string(), &repair, report.triangles));
    let implausible = unit_check(report.extents, unit).map(|what| what.to_string());
    if let Some(what) = &implausible {
        session.warn(&format!("{}: {what}", path.display()));
    }
    let mut lines = vec![("mesh", path.display().to_string())];
    lines.extend(report_lines(&report, unit));
    if said.is_none() {
        lines.push(("unit", format!("not said by the file, {unit} is assumed: --unit says another")));
    }
    let json = json!({
        "kind": "mesh",
        "file": path.display().to_string(),
        "unit": unit,
        "unit_is_assumed": said.is_none(),
        "mesh": report,
        "turned_triangles": repair.flipped,
        "one_sided_triangles": repair.one_sided,
        "implausible_size": implausible,
    });
    Ok(Description { lines, json })
}

/// The report's own lines, whose names are known.
fn report_lines(report: &MeshReport, unit: LengthUnit) -> Vec<Line> {
    let text = report.display(unit).to_string();
    let value = |name: &'static str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        line.map(|value| (name, value.trim().to_owned()))
    };
    ["extents", "triangles", "surface"].into_iter().filter_map(value).collect()
}

pub(super) fn tool(session: &Session, tool: &Tool) -> Description {
    let unit = tool.unit;
    // How slender a tip is depends on a pitch, which a tool alone does not know.
    let frame = SceneWarning::of_frame(tool, tool.thinnest().1 / 6.0).into_iter();
    let frame = frame.filter(|warning| !matches!(warning, SceneWarning::SlenderTip { .. }));
    warn_of(session, &frame.collect::<Vec<_>>());
    let mut lines = vec![("tool", tool.name.clone())];
    let elements = match &tool.shape {
        ToolShape::Revolved(elements) => {
            let (texts, elements): (Vec<Line>, Vec<_>) =
                elements.iter().map(|element| describe_element(element, tool)).unzip();
            lines.extend(texts);
            elements
        }
        ToolShape::Mesh(mesh) => {
            let corner = |p: DVec3| p.to_array().map(short).join(", ");
            let (lower, upper) = mesh.bounds().unwrap_or_default();
            let count = mesh.triangles.len();
            lines.push((
                "mesh",
                format!(
                    "{count} triangles, from {} to {} {unit} in the tool's frame",
                    corner(lower),
                    corner(upper)
                ),
            ));
            Vec::new()
        }
    };
    // Voxels of the boundary are points at a pitch, which a tool alone does not know.
    let sharp =
        (!matches!(tool.sharp_points, SharpPoints::Boundary(_))).then(|| tool.sharp_point_positions(1.0));
    let count = sharp.as_ref().map_or(0, Vec::len);
    let sharp_text = match &tool.sharp_points {
        SharpPoints::Tip => "the tip".to_owned(),
        SharpPoints::Cutter(_) => format!("{count} on the cutter's surface, tip included"),
        SharpPoints::Boundary(_) => {
            "every voxel of the cutter's surface, at the pitch of the grid".to_owned()
        }
        SharpPoints::Points(_) => format!("{count} given"),
    };
    let sharp = sharp.map_or_else(|| json!("boundary"), |points| json!(points));
    let symmetric = tool.is_axisymmetric();
    let symmetry =
        if symmetric { "the same at every roll" } else { "not axisymmetric: orientations have a roll" };
    lines.extend([
        ("length", format!("{} {unit}", short(tool.length()))),
        ("reach", format!("{} {unit} from the tip to the farthest point", short(tool.reach()))),
        ("volume", format!("{} {unit}³", show_measure(tool.volume()))),
        ("symmetry", symmetry.to_owned()),
        ("sharp points", sharp_text),
    ]);
    let json = json!({
        "kind": "tool",
        "name": tool.name,
        "unit": unit,
        "elements": elements,
        "length": tool.length(),
        "reach": tool.reach(),
        "volume": tool.volume(),
        "axisymmetric": symmetric,
        "sharp_points": sharp,
        "back_cutting": tool.back_cutting,
        "plunge_only": tool.plunge_only,
    });
    Description { lines, json }
}

/// Lower and upper end of an element, and its smallest and largest radius at the ends of its segments.
fn describe_element(element: &Element, tool: &Tool) -> (Line, serde_json::Value) {
    let ends = || element.profile.iter().map(Segment::range);
    let from = ends().map(|(from, _)| from).fold(f64::INFINITY, f64::min);
    let to = ends().map(|(_, to)| to).fold(f64::NEG_INFINITY, f64::max);
    let at_ends = element.profile.iter().flat_map(|s| [s.radius(s.range().0), s.radius(s.range().1)]);
    let least = at_ends.fold(f64::INFINITY, f64::min);
    let largest = element.max_radius();
    let volume: f64 = element.profile.iter().map(Segment::volume).sum();
    let name = match element.kind {
        ElementKind::Cutter => "cutter",
        ElementKind::Shank => "shank",
        ElementKind::Holder(_) => "holder",
    };
    let radii =
        if least == largest { short(largest) } else { format!("{} to {}", short(least), short(largest)) };
    let (unit, percent) = (tool.unit, 100.0 * volume / tool.volume());
    let is_cutter = name == "cutter";
    let back = if tool.back_cutting && is_cutter { "; its upper end cuts too" } else { "" };
    let along = if tool.plunge_only && is_cutter { "; it cuts along its axis alone" } else { "" };
    let text = format!(
        "{} to {} {unit} above the tip, radius {radii} {unit}, {percent:.1} % of the volume{back}{along}",
        short(from),
        short(to)
    );
    let json = json!({
        "kind": element.kind,
        "from": from,
        "to": to,
        "minimum_radius": least,
        "largest_radius": largest,
        "volume": volume,
    });
    ((name, text), json)
}
