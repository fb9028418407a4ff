//! The path among part and fixtures for the page in 3D: lines that collide in red, the deepest places marked.

use glam::{DMat4, DVec3};
use imf_core::mesh::Mesh;
use imf_core::toolpath::{MoveKind, Toolpath};

use super::{CheckRun, text};
use crate::output::short;
use crate::view::{Colours, Layer, NONE, PathLines, Place, Table, TableRow, View, distinct};

/// Places that are marked, at most: the deepest.
const PLACES: usize = 50;
const FEED: [u8; 3] = [40, 90, 170];
const RAPID: [u8; 3] = [130, 160, 130];
const COLLIDING: [u8; 3] = [205, 30, 30];

/// The bodies as one mesh in the frame of the answer, and the body of each triangle. `meshes` are in the world, the part first;
/// `back` leads from there to the answer's frame.
pub(super) fn bodies(meshes: &[(String, Mesh)], back: &DMat4) -> (Mesh, Vec<f32>) {
    let (mut all, mut of) = (Mesh::default(), Vec::new());
    for (index, (_, mesh)) in meshes.iter().enumerate() {
        all.append(&mesh.transformed(back));
        of.resize(all.triangles.len(), index as f32);
    }
    (all, of)
}

/// What is shown; `path` is in the world.
pub(super) fn view<'a>(
    checked: &CheckRun<'_>,
    meshes: &[(String, Mesh)],
    (mesh, of): &'a (Mesh, Vec<f32>),
    path: &Toolpath,
    back: &DMat4,
) -> View<'a> {
    let unit = checked.record.unit;
    let colours = meshes
        .iter()
        .enumerate()
        .map(|(index, (name, _))| (name.clone(), if index == 0 { NONE } else { distinct(index) }));
    let hit: Vec<usize> = checked.report.colliding.iter().map(|line| line.line).collect();
    let mut paths = [("feed", FEED), ("rapid", RAPID), ("lines that collide", COLLIDING)]
        .map(|(name, colour)| PathLines { name, colour, pieces: Vec::new() });
    for pair in path.locations.windows(2) {
        let kind = match pair[1].kind {
            MoveKind::Start => continue,
            _ if hit.contains(&pair[1].line) => 2,
            MoveKind::Rapid => 1,
            MoveKind::Feed => 0,
        };
        paths[kind].pieces.push([0, 1].map(|end| back.transform_point3(pair[end].pose.position)));
    }
    let worst: Vec<_> = checked.report.worst().into_iter().take(PLACES).collect();
    let places = worst
        .iter()
        .map(|(_, hit)| Place { at: DVec3::from_array(hit.contact), normal: DVec3::from_array(hit.axis) });
    let rows = worst.iter().enumerate().map(|(place, (line, hit))| {
        let at = hit.contact.map(|value| format!("{value:.1}")).join(", ");
        let cells =
            vec![line.line.to_string(), hit.element.clone(), hit.against.to_string(), short(hit.depth), at];
        TableRow { place: Some(place), cells }
    });
    let table = Table {
        title: format!("The deepest collisions, in {unit}"),
        columns: vec![("line", true), ("element", false), ("in", false), ("depth", true), ("around", false)],
        rows: rows.collect(),
    };
    View {
        title: format!("{}, path {}", checked.record.part, checked.arguments.toolpath.display()),
        unit,
        mesh,
        layers: vec![Layer {
            name: "body",
            title: "by body",
            colours: Colours::Classes(colours.collect()),
            values: of.clone(),
        }],
        directions: Vec::new(),
        place_name: "collisions",
        places: places.collect(),
        paths: paths.into_iter().filter(|path| !path.pieces.is_empty()).collect(),
        summary: text::text(checked),
        tables: if worst.is_empty() { Vec::new() } else { vec![table] },
    }
}
