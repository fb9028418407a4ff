//! The worst places of a check as a picture: for each the tool and what it hits, in three planes through the contact point.

use std::path::Path;

use anyhow::Result;
use glam::{DMat4, DVec3};
use imf_core::check::{CheckBodies, CheckReport, Collision, HitBody, MachineBodies};
use imf_core::grid::Grid;
use imf_core::machine::{Machine, MachineSolid, Side};
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::tool::{Element, Tool, ToolShape};
use imf_core::unit::LengthUnit;
use imf_core::voxelize::voxelize;
use ndarray::Array2;

use super::stock::StockResult;
use super::text;
use crate::picture::{Axes, Panel, PanelRow, PanelSheet, Scale};
use crate::slices::{self, is_solid};

/// Places that are drawn, one of a line.
const PLACES: usize = 4;
/// Squares along a side.
const SIDE: usize = 90;
/// How far from the contact point a plane may lie, in voxels.
const BESIDE: f64 = 0.5;
const PART: f32 = 1.0;
const FIXTURE: f32 = 2.0;
const TOOL: f32 = 3.0;
const OVERLAP: f32 = 4.0;
const STOCK: f32 = 5.0;
const MACHINE: f32 = 6.0;
const CLASSES: [&str; 7] = ["empty", "part", "fixture", "tool", "overlap", "stock", "machine"];

/// The frame that a picture is drawn in.
pub(super) struct PictureFrame {
    /// From it into the world.
    pub(super) set_up: DMat4,
    /// Whose frame it is, where there are two.
    pub(super) name: Option<&'static str>,
    pub(super) unit: LengthUnit,
}

impl PictureFrame {
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
    frame: &PictureFrame,
    path: &Path,
) -> Result<bool> {
    let unit = frame.unit;
    let mut chosen: Vec<(String, usize, &Collision, &Tool)> = Vec::new();
    for (line, hit) in report.worst() {
        let tool = tools.iter().find(|(number, _)| number.is_none() || *number == line.tool);
        let is_new = chosen.len() < PLACES && chosen.iter().all(|(_, known, ..)| *known != line.line);
        let Some((_, tool)) = tool.filter(|_| is_new) else { continue };
        let title = format!("{}: {}", text::place(line), text::what(hit, unit));
        chosen.push((title, line.line, hit, *tool));
    }
    if chosen.is_empty() {
        return Ok(false);
    }
    let cuts: Vec<_> = chosen
        .into_iter()
        .map(|(title, line, hit, tool)| {
            let in_stock = |point: DVec3| stock.is_some_and(|stock| stock.is_there(line, point));
            let moving = MachineSolids::new(hit, bodies.machine.map(MachineBodies::machine), &frame.set_up);
            let plane = |axis| {
                let at = |shift| cut(hit, tool, &moving, bodies, &in_stock, &frame.set_up, (axis, shift));
                let shows = |(_, values): &(Grid, Array2<f32>)| values.iter().any(|&class| class == OVERLAP);
                // A plane that touches the tool alone shows nothing of it.
                let beside = [-BESIDE, BESIDE].map(|shift| shift * bodies.part.grid.pitch);
                let through = at(0.0);
                if shows(&through) {
                    return through;
                }
                beside.into_iter().map(at).find(shows).unwrap_or(through)
            };
            let planes: Vec<_> = (0..3).map(plane).collect();
            (title, planes)
        })
        .collect();
    // All of them, so that each has one colour in every picture.
    let scale = Scale::classes(&CLASSES);
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
        notes: vec!["The contact point is in the middle of every panel, or half a voxel before or behind it; the tool without clearance".into()],
        pixels_per_voxel: Some(3),
    }
    .save(path)?;
    Ok(true)
}

/// The machine's solids at a collision, each with the way from the world to where it is with all axes at 0.
struct MachineSolids<'a> {
    solids: Vec<(&'a MachineSolid, DMat4)>,
}

impl<'a> MachineSolids<'a> {
    fn new(hit: &Collision, machine: Option<&'a Machine>, set_up: &DMat4) -> Self {
        let Some((machine, joints)) = machine.zip(hit.joints) else { return Self { solids: Vec::new() } };
        let placed = |solid: &'a MachineSolid| {
            let Pose { position, rotation } = machine.place(solid, &joints);
            (solid, (*set_up * DMat4::from_rotation_translation(rotation, position)).inverse())
        };
        Self { solids: machine.solids.iter().map(placed).collect() }
    }

    /// Whether one of that side holds a point of the world; of that name, where one is given.
    fn hold(&self, side: Side, name: Option<&str>, point: DVec3) -> bool {
        let is_asked =
            |solid: &MachineSolid| solid.side == side && name.is_none_or(|name| solid.name == name);
        let mut own = self.solids.iter().filter(|(solid, _)| is_asked(solid));
        own.any(|(solid, back)| solid.contains(back.transform_point3(point)))
    }

    /// Half the smallest extent of the head's solid that hits.
    fn thickness(&self, element: &str) -> Option<f64> {
        let (solid, _) =
            self.solids.iter().find(|(solid, _)| solid.side == Side::Head && solid.name == element)?;
        let (lower, upper) = solid.bounds();
        Some(0.5 * (upper - lower).min_element())
    }
}

/// What lies in the plane of the frame at right angles to `axis` through the contact point, or beside it by `shift` in the world: a grid
/// of one layer, and its classes. Overlap is what the body and the element that the collision names share.
fn cut(
    hit: &Collision,
    tool: &Tool,
    moving: &MachineSolids<'_>,
    bodies: CheckBodies<'_>,
    in_stock: &impl Fn(DVec3) -> bool,
    set_up: &DMat4,
    (axis, shift): (usize, f64),
) -> (Grid, Array2<f32>) {
    let back = set_up.inverse();
    let scale = back.x_axis.length();
    let mut contact = back.transform_point3(DVec3::from_array(hit.contact));
    contact[axis] += shift * scale;
    let orientation = Orientation::from_direction(DVec3::from_array(hit.axis)).unwrap_or_default();
    let pose = Pose::oriented(
        DVec3::from_array(hit.position),
        &Orientation { roll: hit.roll.unwrap_or(0.0), ..orientation },
    );
    let wide = moving.thickness(&hit.element).unwrap_or_else(|| widest(tool, &hit.element));
    let side = 2.0 * (1.5 * wide).max(8.0 * bodies.part.grid.pitch);
    let side = side * scale;
    let pitch = side / SIDE as f64;
    let mut dims = [SIDE; 3];
    dims[axis] = 1;
    let mut origin = contact - 0.5 * side;
    origin[axis] = contact[axis] - 0.5 * pitch;
    let grid = Grid { origin, pitch, dims };
    // The part or a fixture where that hits the machine, and no element of the tool.
    let fixtures = bodies.fixtures.iter().map(|(name, _)| HitBody::Fixture(name.clone()));
    let on_table = std::iter::once(HitBody::Part).chain(fixtures).find(|own| own.to_string() == hit.element);
    let in_fixture = |name: Option<&str>, point: DVec3| {
        let mut own = bodies.fixtures.iter().filter(|(own, _)| name.is_none_or(|name| own == name));
        own.any(|(_, fixture)| is_solid(fixture, point))
    };
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
            let (in_tool, is_named) = match &turned {
                Some(voxels) => {
                    let in_tool = voxels.solid[index] == 1;
                    (in_tool, in_tool && hit.element == "tool")
                }
                None => {
                    let element = tool.element_at(&pose, point);
                    (element.is_some(), element.is_some_and(|kind| kind.to_string() == hit.element))
                }
            };
            let standing = match () {
                () if is_solid(bodies.part, point) => PART,
                () if in_fixture(None, point) => FIXTURE,
                () if in_stock(point) => STOCK,
                () if moving.hold(Side::Table, None, point) => MACHINE,
                () => 0.0,
            };
            let is_in = |body: &HitBody| match body {
                HitBody::Part => standing == PART,
                HitBody::Fixture(name) => in_fixture(Some(name), point),
                HitBody::Machine(name) => moving.hold(Side::Table, Some(name), point),
                HitBody::Stock => standing == STOCK,
            };
            let hits = match &on_table {
                Some(body) => is_in(body),
                None => is_named || moving.hold(Side::Head, Some(&hit.element), point),
            };
            match () {
                () if hits && is_in(&hit.against) => OVERLAP,
                () if in_tool => TOOL,
                () if moving.hold(Side::Head, None, point) => MACHINE,
                () => standing,
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
            .reduce(f64::max)
            .unwrap_or_else(|| 0.5 * tool.reach()),
        ToolShape::Mesh(_) => 0.5 * tool.reach(),
    }
}

#[cfg(test)]
mod tests {
    use imf_core::occupancy::Occupancy;

    use super::*;

    /// The paper's tool, its holder and cutter in a part below 40 and in stock up to 45.
    #[test]
    fn overlap_is_of_the_body_and_the_element_that_are_named() {
        let grid = Grid { origin: DVec3::splat(-50.0), pitch: 1.0, dims: [100; 3] };
        let mut part = Occupancy::empty(grid);
        (0..grid.len()).filter(|&v| grid.centre(grid.voxel(v)).z < 40.0).for_each(|v| part.solid[v] = 1);
        let tool = Tool::paper();
        let drawn = |element: &str, against: HitBody| {
            let hit = Collision {
                element: element.into(),
                against,
                clearance: 0.0,
                depth: 3.0,
                depth_in_tool: 3.0,
                contact: [0.5, 0.5, 37.5],
                position: [0.0; 3],
                axis: [0.0, 0.0, 1.0],
                roll: None,
                joints: None,
                fraction: 1.0,
                voxels: 1,
                volume: 1.0,
                poses: 1,
            };
            let in_stock = |point: DVec3| point.z < 45.0;
            let moving = MachineSolids::new(&hit, None, &DMat4::IDENTITY);
            let bodies = CheckBodies::of_part(&part);
            let (grid, values) = cut(&hit, &tool, &moving, bodies, &in_stock, &DMat4::IDENTITY, (0, 0.0));
            let count = |class: f32| values.iter().filter(|&&value| value == class).count();
            let pose = Pose::oriented(DVec3::ZERO, &Orientation::default());
            let shared = (0..grid.len()).map(|index| grid.centre(grid.voxel(index))).filter(|&point| {
                let is_named = tool.element_at(&pose, point).is_some_and(|kind| kind.to_string() == element);
                let in_body = match hit.against {
                    HitBody::Part => is_solid(&part, point),
                    _ => !is_solid(&part, point) && in_stock(point),
                };
                is_named && in_body
            });
            assert_eq!(count(OVERLAP), shared.count(), "{element} {}", hit.against);
            [OVERLAP, TOOL, STOCK].map(count)
        };
        // Beside the holder the cutter is in the part as well, and the holder in the stock.
        let in_part = drawn("holder 1", HitBody::Part);
        assert!(in_part.iter().all(|&count| count > 0), "{in_part:?}");
        assert!(drawn("cutter", HitBody::Part)[0] > 0 && drawn("holder 1", HitBody::Stock)[0] > 0);
        assert_eq!(drawn("cutter", HitBody::Stock)[0], 0);
    }
}
