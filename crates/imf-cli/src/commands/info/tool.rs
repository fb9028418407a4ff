//! Tools: elements with their heights and radii, and what follows from them.

use imf_core::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
use serde_json::{Value, json};

use super::Description;
use crate::output::short;

pub(super) fn describe(tool: &Tool) -> Description {
    let unit = tool.unit;
    let mut lines = vec![("tool", tool.name.clone())];
    let elements = match &tool.shape {
        ToolShape::Revolved(elements) => {
            lines.extend(elements.iter().map(|element| line(element, tool)));
            elements.iter().map(entry).collect()
        }
        ToolShape::Mesh(mesh) => {
            lines.push(("mesh", format!("{} triangles, in the tool's frame", mesh.triangles.len())));
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
    lines.extend([
        ("length", format!("{} {unit}", short(tool.length()))),
        ("reach", format!("{} {unit} from the tip to the farthest point", short(tool.reach()))),
        ("volume", format!("{} {unit}³", short(tool.volume()))),
        (
            "symmetry",
            if symmetric { "the same at every roll" } else { "not axisymmetric: orientations have a roll" }
                .to_owned(),
        ),
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
    });
    Description { lines, json }
}

/// Lower and upper end of an element, and its smallest and largest radius at the ends of its segments.
fn extent(element: &Element) -> [f64; 4] {
    let ends = || element.profile.iter().map(Segment::range);
    let from = ends().map(|(from, _)| from).fold(f64::INFINITY, f64::min);
    let to = ends().map(|(_, to)| to).fold(f64::NEG_INFINITY, f64::max);
    let at_ends = element.profile.iter().flat_map(|s| [s.radius(s.range().0), s.radius(s.range().1)]);
    let least = at_ends.fold(f64::INFINITY, f64::min);
    let largest = element.profile.iter().map(Segment::max_radius).fold(0.0, f64::max);
    [from, to, least, largest]
}

fn line(element: &Element, tool: &Tool) -> (&'static str, String) {
    let [from, to, least, largest] = extent(element);
    let name = match element.kind {
        ElementKind::Cutter => "cutter",
        ElementKind::Shank => "shank",
        ElementKind::Holder(_) => "holder",
    };
    let largest_text = short(largest);
    let radii = if least == largest { largest_text } else { format!("{} to {largest_text}", short(least)) };
    let volume: f64 = element.profile.iter().map(Segment::volume).sum();
    let share = 100.0 * volume / tool.volume();
    let unit = tool.unit;
    let (from, to) = (short(from), short(to));
    (name, format!("{from} to {to} {unit} above the tip, radius {radii} {unit}, {share:.1} % of the volume"))
}

fn entry(element: &Element) -> Value {
    let [from, to, least, largest] = extent(element);
    json!({
        "kind": element.kind,
        "from": from,
        "to": to,
        "least_radius": least,
        "largest_radius": largest,
        "volume": element.profile.iter().map(Segment::volume).sum::<f64>(),
    })
}
