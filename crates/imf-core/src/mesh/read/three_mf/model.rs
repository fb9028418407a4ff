//! One XML model of a 3MF archive: its unit, its objects, what its build places.

use std::collections::HashMap;
use std::str::FromStr;

use glam::{DMat4, DVec3};
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::{Namespace, ResolveResult};
use quick_xml::{NsReader, XmlVersion};

use super::super::{no_vertex, not_finite};
use super::Fault;
use crate::mesh::Mesh;
use crate::unit::LengthUnit;

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

fn of_xml(error: impl std::fmt::Display) -> Fault {
    Fault::malformed(error.to_string())
}

/// What lengths of a file are multiplied by, and the unit they are in then.
fn unit(name: &str) -> Result<(f64, LengthUnit), Fault> {
    match name {
        "micron" => Ok((1e-3, LengthUnit::Mm)),
        "millimeter" => Ok((1.0, LengthUnit::Mm)),
        "centimeter" => Ok((1.0, LengthUnit::Cm)),
        "meter" => Ok((1.0, LengthUnit::M)),
        "inch" => Ok((1.0, LengthUnit::Inch)),
        "foot" => Ok((12.0, LengthUnit::Inch)),
        _ => Err(Fault::malformed(format!("'{name}' is not a unit of the format"))),
    }
}

/// An object that stands somewhere: by its number, in this model or another.
#[derive(Debug)]
pub(super) struct Placement {
    /// The other model's name in the archive.
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

#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) unit: (f64, LengthUnit),
    pub(super) objects: HashMap<u32, Object>,
    /// What is to be printed.
    pub(super) items: Vec<Placement>,
    /// How many items are not.
    pub(super) unprinted: usize,
}

/// The name of the root model that a package's relationships give.
pub(super) fn root_target(text: &str) -> Result<Option<String>, Fault> {
    let mut root = None;
    each(text, |name, start| {
        if let ("Relationship", Some(element)) = (name, start)
            && attribute(element, "Type")?.as_deref() == Some(ROOT)
        {
            root = attribute(element, "Target")?.as_deref().map(plain);
        }
        Ok(())
    })?;
    Ok(root)
}

/// A part's name in the archive, as paths in the XML begin with a slash.
fn plain(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

/// Calls `take` with the name of every element of the core namespace, or of none: at its beginning with the element, at its end
/// without.
fn each(
    text: &str,
    mut take: impl FnMut(&str, Option<&BytesStart<'_>>) -> Result<(), Fault>,
) -> Result<(), Fault> {
    let mut reader = NsReader::from_str(text);
    reader.config_mut().expand_empty_elements = true;
    let mut depth = 0_usize;
    loop {
        let (namespace, event) = match reader.read_resolved_event() {
            Ok(found) => found,
            Err(error) => return Err(of_xml(format!("{error}, at byte {}", reader.error_position()))),
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
                    take(element.local_name().as_ref(), Some(&element))?;
                }
            }
            Event::End(element) => {
                depth = depth.saturating_sub(1);
                if ours {
                    take(element.local_name().as_ref(), None)?;
                }
            }
            Event::DocType(_) => return Err(of_xml("it has a document type, which 3MF forbids")),
            Event::Eof if depth > 0 => return Err(Fault::truncated("the XML ends inside an element")),
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
        let found = found.map_err(of_xml)?;
        if is_it(found.key.as_ref()) {
            let value = found.normalized_value(XmlVersion::Implicit1_0).map_err(of_xml)?;
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
        .ok_or_else(|| Fault::malformed(format!("an element '{kind}' has no {name}")))?;
    text.trim().parse().map_err(|_| Fault::malformed(format!("{name} of an element '{kind}' is '{text}'")))
}

fn placement(element: &BytesStart<'_>) -> Result<Placement, Fault> {
    let transform = attribute(element, "transform")?.map_or(Ok(DMat4::IDENTITY), |text| transform(&text))?;
    let path = foreign(element, "path")?.as_deref().map(plain);
    Ok(Placement { path, object: number(element, "objectid")?, transform })
}

/// Twelve numbers: the images of the axes, then the shift.
fn transform(text: &str) -> Result<DMat4, Fault> {
    let numbers: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
    let numbers = numbers.ok().filter(|all| all.len() == 12 && all.iter().all(|n| n.is_finite()));
    let wrong = || Fault::malformed(format!("'{text}' is not a transform of twelve finite numbers"));
    let numbers = numbers.ok_or_else(wrong)?;
    let column = |row: usize, w: f64| DVec3::from_slice(&numbers[3 * row..]).extend(w);
    Ok(DMat4::from_cols(column(0, 0.0), column(1, 0.0), column(2, 0.0), column(3, 1.0)))
}

/// What has been read of a model.
#[derive(Default)]
struct Reading {
    model: Model,
    seen: bool,
    /// The object that is being read: its number, what it is for, its mesh or components.
    object: Option<(u32, Role)>,
    mesh: Option<Mesh>,
    components: Option<Vec<Placement>>,
}

impl Model {
    pub(super) fn read(text: &str) -> Result<Self, Fault> {
        let mut reading = Reading::default();
        each(text, |name, start| match start {
            Some(element) => reading.start(name, element),
            None if name == "object" => reading.end_object(),
            None => Ok(()),
        })?;
        if !reading.seen {
            return Err(Fault::malformed("it holds no model of the 3MF core specification"));
        }
        Ok(reading.model)
    }

    /// The components of all its objects.
    pub(super) fn components(&self) -> impl Iterator<Item = &Placement> {
        let components = self.objects.values().map(|object| match &object.body {
            Body::Components(components) => &components[..],
            Body::Mesh(_) => &[],
        });
        components.flatten()
    }
}

impl Reading {
    fn start(&mut self, name: &str, element: &BytesStart<'_>) -> Result<(), Fault> {
        match (name, self.object.is_some()) {
            ("model", false) => {
                self.seen = true;
                require_known(element)?;
                self.model.unit = unit(attribute(element, "unit")?.as_deref().unwrap_or("millimeter"))?;
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
                    return Err(not_finite(&format!("vertex {}", vertices.len())));
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
                    Some("0" | "false") => self.model.unprinted += 1,
                    _ => self.model.items.push(placed),
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
                    return Err(no_vertex(index.into(), vertices));
                }
                Body::Mesh(mesh)
            }
            (None, Some(components)) => Body::Components(components),
            _ => return Err(Fault::malformed(format!("object {id} is neither a mesh nor components"))),
        };
        if self.model.objects.insert(id, Object { role, body }).is_some() {
            return Err(Fault::malformed(format!("there are two objects {id}")));
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
            return Err(Fault::malformed(format!(
                "it requires the extension {namespace}, which is not read: export plain meshes"
            )));
        }
    }
    Ok(())
}
