//! The path among part and fixtures for the page in 3D: lines that collide in red, the deepest places marked.

use std::collections::HashSet;

use glam::{DMat4, DVec3};
use imf_core::check::{HitBody, MachineBodies};
use imf_core::machine::{Joints, Machine, MachineMotion, MachineSolid, Side};
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::pose::Pose;
use imf_core::toolpath::{Location, MoveKind, Toolpath};

use super::{CheckRun, text};
use crate::output::length;
use crate::view::{Colours, Layer, NONE, PathLines, Place, Table, TableRow, View, distinct};

/// Places that are marked, at most: the deepest.
const PLACES: usize = 50;
const FEED: [u8; 3] = [40, 90, 170];
const RAPID: [u8; 3] = [130, 160, 130];
const COLLIDING: [u8; 3] = [205, 30, 30];
const STOCK: [u8; 3] = [214, 178, 110];
const TABLE: [u8; 3] = [165, 190, 205];
const HEAD: [u8; 3] = [120, 140, 190];

/// What is shown as surfaces, all in the result's frame.
pub(super) struct CheckScene {
    mesh: Mesh,
    /// Of every triangle, which of the names.
    of: Vec<f32>,
    /// With their colours, and whether they are hidden at first.
    names: Vec<(String, [u8; 3], bool)>,
    /// The box around the part, its stock and what is marked.
    focus: Option<(DVec3, DVec3)>,
}

impl CheckScene {
    /// `meshes` are in the world, the part first, of which `part` are the voxels; `back` leads from there to the result's frame, `set_up` from the
    /// path's frame to the world. A machine's solids are where they are at the deepest collision; without one those
    /// alone are shown that go with the part.
    pub(super) fn new(
        checked: &CheckRun<'_>,
        meshes: &[(String, Mesh)],
        part: &Occupancy,
        back: &DMat4,
        set_up: &DMat4,
    ) -> Self {
        let mut shown = Self { mesh: Mesh::default(), of: Vec::new(), names: Vec::new(), focus: None };
        for (index, (name, mesh)) in meshes.iter().enumerate() {
            shown.add(name, if index == 0 { NONE } else { distinct(index) }, false, &mesh.transformed(back));
        }
        let left = checked.stock.as_ref().and_then(|stock| stock.surface_beside(part, back));
        if let Some(left) = left {
            shown.add("stock that is left beside the part", STOCK, false, &left);
        }
        let worst = checked.report.worst();
        let places = worst.iter().take(PLACES).map(|(_, hit)| DVec3::from_array(hit.contact));
        let around = |(lower, upper): (DVec3, DVec3), place: DVec3| (lower.min(place), upper.max(place));
        shown.focus = shown.mesh.bounds().map(|bounds| places.fold(bounds, around));
        let Some(machine) = checked.machine.map(MachineBodies::machine) else { return shown };
        let joints = worst.iter().find_map(|(_, hit)| hit.joints);
        let top = machine.axes_of(Side::Table);
        let with_part = |solid: &&MachineSolid| solid.side == Side::Table && solid.level == top;
        for solid in machine.solids.iter().filter(|solid| joints.is_some() || with_part(solid)) {
            let joints = joints.unwrap_or(Joints { linear: DVec3::ZERO, rotary: [0.0; 2] });
            let Pose { position, rotation } = machine.place(solid, &joints);
            let place = *back * *set_up * DMat4::from_rotation_translation(rotation, position);
            let colour = if solid.side == Side::Table { TABLE } else { HEAD };
            // The others would stand before the part.
            let takes_part = worst.iter().any(|(_, hit)| {
                hit.element == solid.name || hit.against == HitBody::Machine(solid.name.clone())
            });
            shown.add(
                &format!("machine's {}", solid.name),
                colour,
                !takes_part,
                &solid.surface().transformed(&place),
            );
        }
        shown
    }

    fn add(&mut self, name: &str, colour: [u8; 3], is_hidden: bool, mesh: &Mesh) {
        self.mesh.append(mesh);
        self.of.resize(self.mesh.triangles.len(), self.names.len() as f32);
        self.names.push((name.to_owned(), colour, is_hidden));
    }
}

/// Degrees that a rotary axis turns between two places of a way that is not straight.
const SWING: f64 = 3.0;
/// Places of such a way: ten turns.
const MOST_SWINGS: f64 = 1200.0;

/// Where the tip is on its way from one location to the next: a tip that does not go straight swings about the rotary axes.
fn tips_along(path: &Toolpath, machine: Option<&Machine>, [from, to]: [&Location; 2]) -> Vec<DVec3> {
    let mut tips = vec![from.pose.position];
    if let (Some(machine), Some(before), Some(after)) = (machine, from.machine, to.machine)
        && !after.tip_goes_straight
    {
        let way = MachineMotion::new(machine, before.joints, after.joints, after.length, false);
        let turn = |axis: usize| (after.joints.rotary[axis] - before.joints.rotary[axis]).abs();
        let steps = (turn(0).max(turn(1)) / SWING).ceil().min(MOST_SWINGS) as usize;
        let tip = |step: usize| way.pose(step as f64 / steps as f64).position;
        tips.extend((1..steps).map(|step| path.set_up.transform_point3(tip(step))));
    }
    tips.push(to.pose.position);
    tips
}

/// What is shown; `path` is in the world.
pub(super) fn view<'a>(
    checked: &CheckRun<'_>,
    shown: &'a CheckScene,
    path: &Toolpath,
    back: &DMat4,
) -> View<'a> {
    let unit = checked.record.unit;
    let hit: HashSet<usize> = checked.report.colliding.iter().map(|line| line.line).collect();
    let mut paths = [("feed", FEED), ("rapid", RAPID), ("lines that collide", COLLIDING)]
        .map(|(name, colour)| PathLines { name, colour, pieces: Vec::new() });
    let machine = checked.machine.map(MachineBodies::machine);
    for pair in path.locations.windows(2) {
        let kind = match pair[1].kind {
            MoveKind::Start => continue,
            _ if hit.contains(&pair[1].line) => 2,
            MoveKind::Rapid => 1,
            MoveKind::Feed => 0,
        };
        let tips = tips_along(path, machine, [&pair[0], &pair[1]]);
        paths[kind]
            .pieces
            .extend(tips.windows(2).map(|ends| [0, 1].map(|end| back.transform_point3(ends[end]))));
    }
    let worst: Vec<_> = checked.report.worst().into_iter().take(PLACES).collect();
    let places = worst
        .iter()
        .map(|(_, hit)| Place { at: DVec3::from_array(hit.contact), normal: DVec3::from_array(hit.axis) });
    let rows = worst.iter().enumerate().map(|(place, (line, hit))| {
        let at = length::place(hit.contact, checked.record.unit);
        let cells = vec![line.line.to_string(), text::what(hit, checked.record.unit), at];
        TableRow { place: Some(place), cells }
    });
    let table = Table {
        title: format!("The deepest collisions, in {unit}"),
        columns: vec![("line", true), ("what", false), ("around", false)],
        rows: rows.collect(),
    };
    let path_name = checked.arguments.toolpath.display();
    View {
        title: format!("{}, path {path_name}: {}", checked.record.part, text::verdict(checked)),
        unit,
        mesh: &shown.mesh,
        focus: shown.focus,
        layers: vec![Layer {
            name: "body",
            title: "by body",
            colours: Colours::Bodies(shown.names.clone()),
            values: shown.of.clone(),
        }],
        directions: Vec::new(),
        place_name: "collisions",
        places: places.collect(),
        paths: paths.into_iter().filter(|path| !path.pieces.is_empty()).collect(),
        summary: text::text(checked),
        tables: if worst.is_empty() { Vec::new() } else { vec![table] },
    }
}
