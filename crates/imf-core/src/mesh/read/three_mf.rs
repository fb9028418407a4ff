//! 3MF: a ZIP archive of XML models; the build's items are placed by their transforms and joined to one mesh.
//!
//! Objects may be made of components, and those may lie in other models of the archive (the production extension). Objects
//! of the types `support` and `solidsupport` are what a printer adds, not the part, and are left out; so are components of the
//! type `other`, which slicers give to regions of other settings, and which the core specification allows in no item. Items that
//! slicers mark `printable="0"` (not in the specification) are beside the part and are left out too.
//! Files that require an extension which changes what is solid are refused: slices, beams, booleans, displacement,
//! encryption; and those of which a slicer says that some volumes of a mesh are cut out or modifiers.
//!
//! The crates for this format drop vertices that they cannot read (`threemf2`) or read no components of other models
//! (`threemf`), so that the XML is read here, by `quick-xml`, strictly.

mod model;

use std::collections::HashMap;
use std::io::{Cursor, Read};

use glam::{DMat4, DVec3};
use zip::ZipArchive;
use zip::result::ZipError;

use super::{Fault, MeshFile};
use crate::file_error::FaultKind;
use crate::mesh::Mesh;
use model::{Body, Model, Role};

/// Maximum number of unpacked bytes for each byte of an archive: meshes as text are packed some ten times.
const MAX_UNFOLDING: u64 = 200;
/// Maximum number of placed triangles for each byte of an archive, and how many of them, and of placements beside one a byte, any
/// archive may have: a few objects can name each other to any number. A thousand screws of 5,000 triangles each take 90 a byte.
const MAX_TRIANGLES: usize = 100;
const MAX_OF_ANY: usize = 1 << 17;
/// The deepest nesting of components.
const DEEPEST: usize = 64;

/// Where slicers say what the volumes in an object's mesh are, and how they say of some that they are not the part: cut out of it, or
/// regions of other settings. (Where those are objects of their own, of the type `other`, they are left out.)
const NO_PART: [(&str, &[&str]); 2] = [
    (
        "Metadata/Slic3r_PE_model.config",
        &[
            "value=\"NegativeVolume\"",
            "value=\"ParameterModifier\"",
            "value=\"SupportBlocker\"",
            "value=\"SupportEnforcer\"",
        ],
    ),
    ("Metadata/model_settings.config", &["subtype=\"negative_part\""]),
];

/// How every ZIP archive of files begins.
const ZIP: &[u8] = b"PK";

type Archive<'a> = ZipArchive<Cursor<&'a [u8]>>;

fn no_archive(error: &ZipError) -> Fault {
    Fault::truncated(format!("it is not a whole ZIP archive, as 3MF files are ({error})"))
}

pub(super) fn parse(bytes: &[u8]) -> Result<MeshFile, Fault> {
    if !bytes.starts_with(ZIP) {
        return Err(Fault::malformed("it is not a 3MF file: it does not begin as a ZIP archive does"));
    }
    let mut archive = Archive::new(Cursor::new(bytes)).map_err(|error| no_archive(&error))?;
    let mut budget = (bytes.len() as u64).saturating_mul(MAX_UNFOLDING);
    let root = root_name(&mut archive, &mut budget)?;
    for (name, kinds) in NO_PART {
        if archive.index_for_name(name).is_none() {
            continue;
        }
        let text = unpack(&mut archive, name, &mut budget)?;
        if let Some(found) = kinds.iter().find(|kind| text.contains(*kind)) {
            let cause = format!(
                "{name} of its slicer says that some of its volumes are no part ({found}); export the part alone, as it is to be made"
            );
            return Err(Fault::malformed(cause));
        }
    }
    let mut models = HashMap::new();
    // The root, and the models that items and components name.
    let mut wanted = vec![root.clone()];
    while let Some(name) = wanted.pop() {
        if models.contains_key(&name) {
            continue;
        }
        let text = unpack(&mut archive, &name, &mut budget)?;
        let model = Model::read(&text)
            .map_err(|fault| Fault { cause: format!("{name}: {}", fault.cause), ..fault })?;
        if models.get(&root).is_some_and(|first: &Model| first.unit != model.unit) {
            return Err(Fault::malformed(format!("{name} and {root} are in different units")));
        }
        let items = if name == root { &model.items[..] } else { &[] };
        wanted.extend(items.iter().chain(model.components()).filter_map(|placed| placed.path.clone()));
        models.insert(name, model);
    }
    let Model { items, unprinted, unit: (scale, unit), .. } = &models[&root];
    if items.is_empty() {
        return Err(Fault::malformed(match unprinted {
            0 => "its build has no item: nothing is placed".to_owned(),
            count => format!("nothing of its build is to be printed: {count} items have printable=\"0\""),
        }));
    }
    let mut placing = Assembler { models: &models, mesh: Mesh::default(), placements: 0, bytes: bytes.len() };
    for item in items {
        let (model, object) = (item.path.as_ref().unwrap_or(&root), item.object);
        if models.get(model).and_then(|m| m.objects.get(&object)).is_some_and(|o| o.role == Role::Other) {
            let cause =
                format!("an item places object {object} of {model}, whose type 'other' no item may have");
            return Err(Fault::malformed(cause));
        }
        placing.place(model, object, &item.transform, 0)?;
    }
    let mesh = placing.mesh;
    let mesh = if *scale == 1.0 { mesh } else { mesh.transformed(&DMat4::from_scale(DVec3::splat(*scale))) };
    Ok(MeshFile { mesh: mesh.welded(), unit: Some(*unit) })
}

/// The name of the model that the package's relationships call its root; where it usually is if they do not.
fn root_name(archive: &mut Archive<'_>, budget: &mut u64) -> Result<String, Fault> {
    const RELATIONSHIPS: &str = "_rels/.rels";
    let found = match archive.index_for_name(RELATIONSHIPS) {
        Some(_) => model::root_target(&unpack(archive, RELATIONSHIPS, budget)?)?,
        None => None,
    };
    Ok(found.unwrap_or_else(|| "3D/3dmodel.model".into()))
}

/// A part of the archive.
fn unpack(archive: &mut Archive<'_>, name: &str, budget: &mut u64) -> Result<String, Fault> {
    // Either may be written with `%20` for a space, and so on.
    let is_same = |&index: &usize| {
        let own = archive.name_for_index(index).and_then(Result::ok);
        own.is_some_and(|own| decoded(&own) == decoded(name))
    };
    let index = archive.index_for_name(name).or_else(|| (0..archive.len()).find(is_same));
    let Some(index) = index else {
        return Err(Fault::malformed(format!("the archive has no {name}")));
    };
    let file = archive.by_index(index).map_err(|error| no_archive(&error))?;
    let mut text = Vec::new();
    file.take(*budget + 1)
        .read_to_end(&mut text)
        .map_err(|error| Fault::truncated(format!("{name}: {error}")))?;
    let length = text.len() as u64;
    if length > *budget {
        return Err(Fault::malformed(format!("{name} unfolds to more than {MAX_UNFOLDING} times the file")));
    }
    *budget -= length;
    String::from_utf8(text).map_err(|_| Fault::malformed(format!("{name} is not text in UTF-8")))
}

/// Without percent-encoding.
fn decoded(name: &str) -> Vec<u8> {
    let mut rest = name.as_bytes();
    let mut found = Vec::new();
    while let Some((&first, behind)) = rest.split_first() {
        let hex = behind.get(..2).and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        match hex.filter(|_| first == b'%') {
            Some(byte) => (found.push(byte), rest = &behind[2..]),
            None => (found.push(first), rest = behind),
        };
    }
    found
}

struct Assembler<'a> {
    models: &'a HashMap<String, Model>,
    mesh: Mesh,
    placements: usize,
    /// Of the archive.
    bytes: usize,
}

impl Assembler<'_> {
    /// Appends an object and all that it is made of.
    fn place(&mut self, model: &str, object: u32, transform: &DMat4, depth: usize) -> Result<(), Fault> {
        self.placements += 1;
        if depth > DEEPEST || self.placements > self.bytes + MAX_OF_ANY {
            let cause = "its components nest too deeply, in a circle, or are too many";
            return Err(Fault::malformed(cause));
        }
        let missing = || Fault::malformed(format!("{model} has no object {object}, which is placed"));
        let models = self.models;
        let found = models.get(model).and_then(|model| model.objects.get(&object)).ok_or_else(missing)?;
        match &found.body {
            _ if found.role != Role::Part => {}
            Body::Mesh(mesh) => {
                let most = self.bytes * MAX_TRIANGLES + MAX_OF_ANY;
                if self.mesh.triangles.len() + mesh.triangles.len() > most {
                    let cause = format!(
                        "it places more than {most} triangles, {MAX_TRIANGLES} for each of its bytes; export the placed bodies as one mesh"
                    );
                    return Err(Fault::new(FaultKind::TooLarge, cause));
                }
                let placed = mesh.transformed(transform);
                if placed.vertices.iter().any(|vertex| !vertex.is_finite()) {
                    let cause = format!("object {object} of {model} is placed beyond what numbers hold");
                    return Err(Fault::malformed(cause));
                }
                self.mesh.append(&placed);
            }
            Body::Components(components) => {
                for part in components {
                    let within = part.path.as_deref().unwrap_or(model);
                    self.place(within, part.object, &(*transform * part.transform), depth + 1)?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
