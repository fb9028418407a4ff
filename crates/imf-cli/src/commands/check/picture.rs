//! The worst places of a check as a picture: for each the tool and what it hits, in three planes through the contact point.

use std::path::Path;

use anyhow::Result;
use glam::{DMat4, DVec3};
use imf_core::check::{CheckBodies, CheckReport, Collision, HitBody};
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::tool::{Element, Tool, ToolShape};
use imf_core::unit::LengthUnit;
use imf_core::voxelize::voxelize;
use ndarray::Array2;

use super::stock::StockResult;
use super::text;
use crate::output::short;
use crate::picture::{Axes, Panel, PanelRow, PanelSheet, Scale};
use crate::slices;

/// Places that are drawn, one of a line.
const PLACES: usize = 4;
/// Squares along a side.
const SIDE: usize = 90;
const CLASSES: [&str; 6] = ["empty", "part", "fixture", "tool", "tool in a body", "stock"];

/// The frame that a picture is drawn in.
pub(super) struct Drawn {
    /// From it into the world.
    pub(super) set_up: DMat4,
    /// Whose frame it is, where there are two.
    pub(super) name: Option<&'static str>,
    pub(super) unit: LengthUnit,
}

impl Drawn {
    /// Where a slice lies, its axes named by their frame where there are two.
    fn axes(&self, grid: &Grid, axis: usize) -> Axes {
        let axes = slices::axes(grid, self.unit, axis);
        match self.name {
            Some(name) => Axes { names: axes.names.map(|own| format!("{own} ({name})")), ..axes },
            None => axes,
        }
    }
}

/// Draws the deepest collisions of a report in world coordinates; false where there are none.
pub(super) fn draw(
    report: &CheckReport,
    tools: &[(Option<u32>, &Tool)],
    bodies: CheckBodies<'_>,
    stock: Option<&StockResult>,
    frame: &Drawn,
    path: &Path,
) -> Result<bool> {
    let unit = frame.unit;
    let mut chosen: Vec<(String, usize, &Collision, &Tool)> = Vec::new();
    let mut lines = Vec::new();
    for (line, hit) in report.worst() {
        // What else of the machine hits or is hit is not drawn.
        let of_tool = |tool: &&(Option<u32>, &Tool)| {
            let names = match &tool.1.shape {
                ToolShape::Revolved(elements) => elements.iter().map(|own| own.kind.to_string()).collect(),
                ToolShape::Mesh(_) => vec!["tool".to_owned()],
            };
            !matches!(hit.against, HitBody::Machine(_)) && names.contains(&hit.element)
        };
        let tool = tools.iter().find(|(number, _)| number.is_none() || *number == line.tool).filter(of_tool);
        let Some((_, tool)) = tool.filter(|_| !lines.contains(&line.line) && lines.len() < PLACES) else {
            continue;
        };
        lines.push(line.line);
        let title = format!(
            "{}: {}, {} {unit} deep in the {}",
            text::place(line),
            hit.element,
            short(hit.depth),
            hit.against
        );
        chosen.push((title, line.line, hit, *tool));
    }
    if chosen.is_empty() {
        return Ok(false);
    }
    let cuts: Vec<_> = chosen
        .into_iter()
        .map(|(title, line, hit, tool)| {
            let in_stock = |point: DVec3| stock.is_some_and(|stock| stock.is_there(line, point));
            let plane = |axis| cut(hit, tool, bodies, &in_stock, &frame.set_up, axis);
            let planes: Vec<_> = (0..3).map(plane).collect();
            (title, planes)
        })
        .collect();
    let scale = Scale::classes(&CLASSES[..if stock.is_some() { 6 } else { 5 }]);
    let rows = cuts.iter().map(|(title, planes)| PanelRow {
        title: title.clone(),
        panels: planes
            .iter()
            .enumerate()
            .map(|(axis, (grid, values))| Panel {
                title: slices::layer_title(grid, unit, axis, 0),
                values: values.view(),
                mask: None,
                scale: scale.clone(),
                axes: frame.axes(grid, axis),
            })
            .collect(),
    });
    PanelSheet {
        title: "The deepest collisions".into(),
        rows: rows.collect(),
        notes: vec!["The contact point is in the middle of every panel; the tool without clearance".into()],
        pixels_per_voxel: Some(3),
    }
    .save(path)?;
    Ok(true)
}

/// What lies in the plane of the frame at right angles to `axis` through the contact point: a grid of one layer, and its classes.
fn cut(
    hit: &Collision,
    tool: &Tool,
    bodies: CheckBodies<'_>,
    in_stock: &impl Fn(DVec3) -> bool,
    set_up: &DMat4,
    axis: usize,
) -> (Grid, Array2<f32>) {
    let back = set_up.inverse();
    let contact = back.transform_point3(DVec3::from_array(hit.contact));
    let orientation = Orientation::from_direction(DVec3::from_array(hit.axis)).unwrap_or_default();
    let pose = Pose::oriented(
        DVec3::from_array(hit.position),
        &Orientation { roll: hit.roll.unwrap_or(0.0), ..orientation },
    );
    let side = 2.0 * (1.5 * widest(tool, &hit.element)).max(8.0 * bodies.part.grid.pitch);
    let side = side * back.x_axis.length();
    let pitch = side / SIDE as f64;
    let mut dims = [SIDE; 3];
    dims[axis] = 1;
    let mut origin = contact - 0.5 * side;
    origin[axis] = contact[axis] - 0.5 * pitch;
    let grid = Grid { origin, pitch, dims };
    let turned = match &tool.shape {
        ToolShape::Revolved(_) => None,
        ToolShape::Mesh(mesh) => {
            let placed = DMat4::from_rotation_translation(pose.rotation, pose.position);
            Some(voxelize(&mesh.transformed(&(back * placed)), &grid, false))
        }
    };
    let values: Vec<f32> = (0..grid.len())
        .map(|index| {
            let point = set_up.transform_point3(grid.centre(grid.voxel(index)));
            let in_tool = match &turned {
                Some(voxels) => voxels.solid[index] == 1,
                None => tool.element_at(&pose, point).is_some(),
            };
            let in_fixture = || bodies.fixtures.iter().any(|(_, fixture)| is_solid(fixture, point));
            match (in_tool, is_solid(bodies.part, point)) {
                (false, true) => 1.0,
                (true, true) => 4.0,
                (false, false) if in_fixture() => 2.0,
                (true, false) if in_fixture() || in_stock(point) => 4.0,
                (true, false) => 3.0,
                (false, false) if in_stock(point) => 5.0,
                (false, false) => 0.0,
            }
        })
        .collect();
    let values = slices::slice(&values, &grid, axis, 0);
    (grid, values)
}

/// Largest radius of the element of that name, or of the whole tool.
fn widest(tool: &Tool, element: &str) -> f64 {
    match &tool.shape {
        ToolShape::Revolved(elements) => elements
            .iter()
            .filter(|own| own.kind.to_string() == element)
            .map(Element::max_radius)
            .fold(0.0, f64::max),
        ToolShape::Mesh(_) => 0.5 * tool.reach(),
    }
}

fn is_solid(body: &Occupancy, point: DVec3) -> bool {
    let voxel = body.grid.continuous(point).round().to_array();
    let inside = (0..3).all(|a| voxel[a] >= 0.0 && voxel[a] < body.grid.dims[a] as f64);
    inside && body.solid[body.grid.index(voxel.map(|v| v as usize))] == 1
}
