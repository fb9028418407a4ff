//! One XML model of a 3MF archive: its unit, its objects, what its build places.

use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

use glam::{DMat4, DVec3, DVec4};
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::{Namespace, ResolveResult};
use quick_xml::{NsReader, XmlVersion};
use zip::result::ZipError;

use super::MeshFileError;
use crate::mesh::Mesh;

/// The namespace of objects, meshes and items.
const CORE: &str = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
/// The relationship of a package to its root model.
const ROOT: &str = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel";
/// Extensions that a file may require: paths of components, colours, names of triangles.
const KNOWN: [&str; 4] = [
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
    CORE,
];

/// What is wrong with a file.
#[derive(Debug)]
pub(super) enum Fault {
    Malformed(String),
    Truncated(String),
    Index { index: u32, vertices: usize },
    NotFinite(String),
    TooLarge,
}

impl Fault {
    pub(super) fn of_archive(error: &ZipError) -> Self {
        Self::Truncated(format!("it is no whole ZIP archive, as 3MF files are ({error})"))
    }

    fn of_xml(error: impl std::fmt::Display) -> Self {
        Self::Malformed(error.to_string())
    }

    /// Names the part of the archive.
    pub(super) fn within(self, name: &str) -> Self {
        match self {
            Self::Malformed(cause) => Self::Malformed(format!("{name}: {cause}")),
            Self::Truncated(cause) => Self::Truncated(format!("{name}: {cause}")),
            Self::NotFinite(vertex) => Self::NotFinite(format!("{vertex} of {name}")),
            other => other,
        }
    }

    pub(super) fn at(self, path: &Path) -> MeshFileError {
        let path = path.to_owned();
        match self {
            Self::Malformed(cause) => MeshFileError::Malformed { path, line: None, cause },
            Self::Truncated(cause) => MeshFileError::Truncated { path, cause },
            Self::Index { index, vertices } => {
                MeshFileError::VertexIndex { path, line: None, index: index.into(), vertices }
            }
            Self::NotFinite(vertex) => MeshFileError::NotFinite { path, line: None, vertex },
            Self::TooLarge => MeshFileError::TooLarge { path },
        }
    }
}

/// The units of the format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unit {
    Micron,
    Millimeter,
    Centimeter,
    Inch,
    Foot,
    Meter,
}

impl FromStr for Unit {
    type Err = Fault;

    fn from_str(text: &str) -> Result<Self, Fault> {
        match text {
            "micron" => Ok(Self::Micron),
            "millimeter" => Ok(Self::Millimeter),
            "centimeter" => Ok(Self::Centimeter),
            "inch" => Ok(Self::Inch),
            "foot" => Ok(Self::Foot),
            "meter" => Ok(Self::Meter),
            _ => Err(Fault::Malformed(format!("'{text}' is no unit of the format"))),
        }
    }
}

/// An object that stands somewhere: by its number, in this model or another.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    pub(super) path: Option<String>,
    pub(super) object: u32,
    pub(super) transform: DMat4,
}

#[derive(Debug)]
pub(super) enum Body {
    Mesh(Mesh),
    Components(Vec<Placement>),
}

/// What an object is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// The part or a piece of it.
    Part,
    /// What a printer adds.
    Support,
    /// What no item may place, such as a region that a slicer treats by other settings.
    Other,
}

#[derive(Debug)]
pub(super) struct Object {
    pub(super) role: Role,
    pub(super) body: Body,
}

#[derive(Debug)]
pub(super) struct Model {
    pub(super) unit: Unit,
    pub(super) objects: HashMap<u32, Object>,
    /// What is to be printed.
    pub(super) items: Vec<Placement>,
    /// How many items are not.
    pub(super) unprinted: usize,
}

/// What an archive says of its parts.
pub(super) struct Relationships {
    /// The path of the root model.
    pub(super) root: Option<String>,
}

impl Relationships {
    pub(super) fn read(text: &str) -> Result<Self, Fault> {
        let mut root = None;
        each(text, |event| {
            if let Part::Start { name: "Relationship", element } = event
                && attribute(element, "Type")?.as_deref() == Some(ROOT)
            {
                root = attribute(element, "Target")?;
            }
            Ok(())
        })?;
        Ok(Self { root })
    }
}

/// The beginning or the end of an element of the core namespace.
enum Part<'a> {
    Start { name: &'a str, element: &'a BytesStart<'a> },
    End { name: &'a str },
}

/// Calls `take` with the beginning and the end of every element of the core namespace, or of none.
fn each(text: &str, mut take: impl FnMut(Part<'_>) -> Result<(), Fault>) -> Result<(), Fault> {
    let mut reader = NsReader::from_str(text);
    let mut depth = 0_usize;
    loop {
        let (namespace, event) = match reader.read_resolved_event() {
            Ok(found) => found,
            Err(error) => {
                let at = reader.error_position();
                return Err(Fault::Malformed(format!("{error}, at byte {at}")));
            }
        };
        let ours = match namespace {
            ResolveResult::Bound(Namespace(name)) => name == CORE || name.ends_with("/relationships"),
            ResolveResult::Unbound => true,
            ResolveResult::Unknown(_) => false,
        };
        match event {
            Event::Start(element) => {
                depth += 1;
                if ours {
                    take(Part::Start { name: element.local_name().as_ref(), element: &element })?;
                }
            }
            Event::Empty(element) if ours => {
                take(Part::Start { name: element.local_name().as_ref(), element: &element })?;
                take(Part::End { name: element.local_name().as_ref() })?;
            }
            Event::End(element) => {
                depth = depth.saturating_sub(1);
                if ours {
                    take(Part::End { name: element.local_name().as_ref() })?;
                }
            }
            Event::DocType(_) => {
                return Err(Fault::Malformed("it has a document type, which 3MF forbids".into()));
            }
            Event::Eof if depth > 0 => return Err(Fault::Truncated("the XML ends inside an element".into())),
            Event::Eof => return Ok(()),
            _ => {}
        }
    }
}

/// An attribute without prefix.
fn attribute(element: &BytesStart<'_>, name: &str) -> Result<Option<String>, Fault> {
    matching(element, |key| key == name)
}

/// An attribute of another namespace, whatever its prefix.
fn foreign(element: &BytesStart<'_>, name: &str) -> Result<Option<String>, Fault> {
    matching(element, |key| key.rsplit_once(':').is_some_and(|(_, local)| local == name))
}

fn matching(element: &BytesStart<'_>, is_it: impl Fn(&str) -> bool) -> Result<Option<String>, Fault> {
    for found in element.attributes() {
        let found = found.map_err(Fault::of_xml)?;
        if is_it(found.key.as_ref()) {
            let value = found.normalized_value(XmlVersion::Implicit1_0).map_err(Fault::of_xml)?;
            return Ok(Some(value.into_owned()));
        }
    }
    Ok(None)
}

/// A number that must be there.
fn number<T: FromStr>(element: &BytesStart<'_>, name: &str) -> Result<T, Fault> {
    let kind = element.local_name();
    let kind: &str = kind.as_ref();
    let text = attribute(element, name)?
        .ok_or_else(|| Fault::Malformed(format!("an element '{kind}' has no {name}")))?;
    text.trim().parse().map_err(|_| Fault::Malformed(format!("{name} of an element '{kind}' is '{text}'")))
}

fn placement(element: &BytesStart<'_>) -> Result<Placement, Fault> {
    let transform = attribute(element, "transform")?.map_or(Ok(DMat4::IDENTITY), |text| transform(&text))?;
    Ok(Placement { path: foreign(element, "path")?, object: number(element, "objectid")?, transform })
}

/// Twelve numbers: the images of the axes, then the shift.
fn transform(text: &str) -> Result<DMat4, Fault> {
    let wrong = || Fault::Malformed(format!("'{text}' is no transform of twelve finite numbers"));
    let numbers: Vec<f64> = text.split_ascii_whitespace().filter_map(|n| n.parse().ok()).collect();
    let whole = numbers.len() == 12 && text.split_ascii_whitespace().count() == 12;
    if !whole || numbers.iter().any(|n| !n.is_finite()) {
        return Err(wrong());
    }
    let column =
        |row: usize, w: f64| DVec4::new(numbers[3 * row], numbers[3 * row + 1], numbers[3 * row + 2], w);
    Ok(DMat4::from_cols(column(0, 0.0), column(1, 0.0), column(2, 0.0), column(3, 1.0)))
}

/// What of a model was read so far.
#[derive(Default)]
struct Reading {
    unit: Option<Unit>,
    seen: bool,
    objects: HashMap<u32, Object>,
    items: Vec<Placement>,
    unprinted: usize,
    /// The object that is being read: its number, what it is for, its mesh or components.
    object: Option<(u32, Role)>,
    mesh: Option<Mesh>,
    components: Option<Vec<Placement>>,
}

impl Model {
    pub(super) fn read(text: &str) -> Result<Self, Fault> {
        let mut reading = Reading::default();
        each(text, |part| match part {
            Part::Start { name, element } => reading.start(name, element),
            Part::End { name: "object" } => reading.end_object(),
            Part::End { .. } => Ok(()),
        })?;
        let Reading { unit, seen, objects, items, unprinted, .. } = reading;
        if !seen {
            return Err(Fault::Malformed("it holds no model of the 3MF core specification".into()));
        }
        Ok(Self { unit: unit.unwrap_or(Unit::Millimeter), objects, items, unprinted })
    }

    /// The other models that its components name.
    pub(super) fn paths(&self) -> impl Iterator<Item = String> + use<'_> {
        let components = self.objects.values().filter_map(|object| match &object.body {
            Body::Components(components) => Some(components),
            Body::Mesh(_) => None,
        });
        components.flatten().filter_map(|part| part.path.clone())
    }
}

impl Reading {
    fn start(&mut self, name: &str, element: &BytesStart<'_>) -> Result<(), Fault> {
        match (name, self.object.is_some()) {
            ("model", false) => {
                self.seen = true;
                require_known(element)?;
                self.unit = attribute(element, "unit")?.map(|text| text.parse()).transpose()?;
            }
            ("object", false) => {
                let kind = attribute(element, "type")?;
                let role = match kind.as_deref() {
                    Some("support" | "solidsupport") => Role::Support,
                    Some("other") => Role::Other,
                    _ => Role::Part,
                };
                self.object = Some((number(element, "id")?, role));
            }
            ("mesh", true) => self.mesh = Some(Mesh::default()),
            ("components", true) => self.components = Some(Vec::new()),
            ("component", true) => {
                let placed = placement(element)?;
                self.components.get_or_insert_default().push(placed);
            }
            ("vertex", true) => {
                let [x, y, z] = ["x", "y", "z"].map(|name| number(element, name));
                let vertex = DVec3::new(x?, y?, z?);
                let vertices = &mut self.mesh.get_or_insert_default().vertices;
                if !vertex.is_finite() {
                    return Err(Fault::NotFinite(format!("vertex {}", vertices.len())));
                }
                vertices.push(vertex);
            }
            ("triangle", true) => {
                let [a, b, c] = ["v1", "v2", "v3"].map(|name| number(element, name));
                self.mesh.get_or_insert_default().triangles.push([a?, b?, c?]);
            }
            ("item", false) => {
                let placed = placement(element)?;
                match attribute(element, "printable")?.as_deref().map(str::trim) {
                    Some("0" | "false") => self.unprinted += 1,
                    _ => self.items.push(placed),
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn end_object(&mut self) -> Result<(), Fault> {
        let Some((id, role)) = self.object.take() else { return Ok(()) };
        let body = match (self.mesh.take(), self.components.take()) {
            (Some(mesh), None) => {
                let vertices = mesh.vertices.len();
                let beyond = mesh.triangles.iter().flatten().find(|&&index| index as usize >= vertices);
                if let Some(&index) = beyond {
                    return Err(Fault::Index { index, vertices });
                }
                Body::Mesh(mesh)
            }
            (None, Some(components)) => Body::Components(components),
            _ => return Err(Fault::Malformed(format!("object {id} is neither a mesh nor components"))),
        };
        if self.objects.insert(id, Object { role, body }).is_some() {
            return Err(Fault::Malformed(format!("there are two objects {id}")));
        }
        Ok(())
    }
}

/// Refuses extensions that change what is solid.
fn require_known(model: &BytesStart<'_>) -> Result<(), Fault> {
    let required = attribute(model, "requiredextensions")?.unwrap_or_default();
    for prefix in required.split_ascii_whitespace() {
        let namespace = attribute(model, &format!("xmlns:{prefix}"))?.unwrap_or_else(|| prefix.to_owned());
        if !KNOWN.contains(&namespace.as_str()) {
            return Err(Fault::Malformed(format!(
                "it requires the extension {namespace}, which is not read: export plain meshes"
            )));
        }
    }
    Ok(())
}
