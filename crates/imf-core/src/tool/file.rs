//! Tools on disk: a TOML file of stacked elements, or of a mesh beside it.
//!
//! ```toml
//! name = "10 mm ball end mill"
//! unit = "mm"
//! stick_out = 35.0              # from the tip to the holder's face; by default the cutter and shank laid end to end
//! sharp_points = "tip"          # or 40 (points on the cutter), "boundary" (every voxel of its surface), or
//!                               # [[x, y, z], …] in the tool frame
//!
//! [cutter]
//! shape = "ball"                # flat | ball | bull | tapered | lollipop | drill
//! diameter = 10.0               # at the tip for a tapered cutter
//! length = 35.0                 # not of a lollipop, which is a ball down to the shank
//! # corner_radius = 1.0         # bull; tapered (half the diameter unless given, 0 for a sharp corner)
//! # half_angle = 5.0            # tapered, degrees
//! # point_angle = 118.0         # drill, degrees from edge to edge
//! # back_cutting = true         # its upper end cuts too, as that of a T-slot cutter
//! # plunge_only = true          # it cuts along its axis alone, as a drill does by itself
//!
//! [shank]                       # optional
//! diameter = 10.0
//! length = 20.0                 # with stick_out: all of it, what is in the holder included
//!
//! [[holder]]                    # any number, from the tip upwards
//! diameter = 29.0
//! top_diameter = 29.0           # optional: a cone
//! length = 48.0
//! ```
//!
//! or `mesh = "head.stl"` instead of cutter, shank and holder: a closed mesh in the tool frame. `sharp_points = { within = 12.0 }`
//! says which of its vertices cut: those within 12 of the tip.

mod cutter;

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use toml::Spanned;

use super::library;
use super::profile::top;
use super::stack::{Stack, line};
use super::{SharpPoints, Tool, ToolError, ToolShape};
use crate::file_error::{Fault, FaultKind, FileError, read_small, text_of};
use crate::mesh::read::read_mesh_file;
use crate::unit::LengthUnit;
use cutter::CutterText;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolText {
    name: Option<String>,
    unit: Option<LengthUnit>,
    stick_out: Option<Spanned<f64>>,
    sharp_points: Option<Spanned<SharpText>>,
    mesh: Option<Spanned<String>>,
    cutter: Option<CutterText>,
    shank: Option<ShankText>,
    #[serde(default)]
    holder: Vec<HolderText>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum SharpText {
    Name(String),
    Count(f64),
    Points(Vec<[f64; 3]>),
    /// The vertices of a mesh within a distance of its tip.
    Within {
        within: f64,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ShankText {
    diameter: Spanned<f64>,
    length: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HolderText {
    diameter: Spanned<f64>,
    top_diameter: Option<Spanned<f64>>,
    length: Spanned<f64>,
}

impl Tool {
    /// Reads a tool file, or the only tool of a CAM program's library (`.fctb`, `.json`, `.tools`).
    ///
    /// # Errors
    /// Names the file, the line and the key.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        read(path, None)
    }

    /// As [`Tool::read`], from the text of a tool file (TOML) called `name`; a mesh that it names lies beside that.
    ///
    /// # Errors
    /// As [`Tool::read`].
    pub fn parse(text: &str, name: &Path) -> Result<Self, FileError> {
        Reader { text }.tool(name).and_then(checked).map_err(|fault| fault.at(name))
    }

    /// Every tool of a file, in its order: the one of a tool file (TOML) or of FreeCAD, all of one of Fusion's libraries.
    ///
    /// # Errors
    /// As [`Tool::read`] of the file; of a library each tool that is incomplete or has no place in a stack of bodies of revolution
    /// is an error of its own.
    pub fn read_all(path: &Path) -> Result<Vec<Result<Self, FileError>>, FileError> {
        Self::all_from_bytes(&read_small("tool file", path).map_err(|fault| fault.at(path))?, path)
    }

    /// As [`Tool::read_all`], from the content of a file called `name`.
    ///
    /// # Errors
    /// As [`Tool::read_all`].
    pub fn all_from_bytes(bytes: &[u8], name: &Path) -> Result<Vec<Result<Self, FileError>>, FileError> {
        if !library::is_library(name) {
            return Ok(vec![Ok(Self::parse(&text_of(bytes).map_err(|fault| fault.at(name))?, name)?)]);
        }
        let tools = library::tools(name, bytes).map_err(|fault| fault.at(name))?;
        let checked = |tool: Result<Self, Fault>| tool.and_then(checked).map_err(|fault| fault.at(name));
        Ok(tools.into_iter().map(checked).collect())
    }

    /// As [`Tool::read`], of a path, or of `LIBRARY#TOOL`: a tool of several by its name or number.
    ///
    /// # Errors
    /// As [`Tool::read`]; a name that no tool of the library has, or several.
    pub fn find(text: &str) -> Result<Self, FileError> {
        match library::location(text) {
            (path, Some(tool)) if library::is_library(path) => read(path, Some(tool)),
            _ => read(Path::new(text), None),
        }
    }
}

/// The tool of a file, or the one of a library that `wanted` names.
fn read(path: &Path, wanted: Option<&str>) -> Result<Tool, FileError> {
    let whole = || -> Result<Tool, Fault> {
        let bytes = read_small("tool file", path)?;
        let tool = if library::is_library(path) {
            library::tool(path, &bytes, wanted)?
        } else {
            Reader { text: &text_of(&bytes)? }.tool(path)?
        };
        checked(tool)
    };
    whole().map_err(|fault| fault.at(path))
}

fn checked(tool: Tool) -> Result<Tool, Fault> {
    match tool.check() {
        Ok(()) => Ok(tool),
        Err(error @ ToolError::Open { .. }) => Err(Fault::malformed(error.to_string())),
        Err(error) => Err(Fault::new(FaultKind::Empty, error.to_string())),
    }
}

/// The text being read, for errors that name their line.
struct Reader<'a> {
    text: &'a str,
}

impl Reader<'_> {
    fn at(&self, offset: usize, what: impl Into<String>) -> Fault {
        let line = self.text[..offset.min(self.text.len())].matches('\n').count() + 1;
        Fault::malformed(what).on_line(line)
    }

    fn wrong<T>(&self, place: &Spanned<T>, what: impl Into<String>) -> Fault {
        self.at(place.span().start, what)
    }

    /// A length that must be positive and finite.
    fn length(&self, key: &str, value: &Spanned<f64>) -> Result<f64, Fault> {
        let number = *value.get_ref();
        if number.is_finite() && number > 0.0 {
            return Ok(number);
        }
        Err(self.wrong(value, format!("{key} must be a positive number, not {number}")))
    }

    fn tool(&self, path: &Path) -> Result<Tool, Fault> {
        let text: ToolText = toml::from_str(self.text)
            .map_err(|error| self.at(error.span().map_or(0, |span| span.start), error.message()))?;
        let of_file = || path.file_stem().map_or_else(|| "tool".into(), |s| s.to_string_lossy().into_owned());
        let name = text.name.clone().unwrap_or_else(of_file);
        let tool = match (&text.mesh, &text.cutter) {
            (Some(mesh), None)
                if text.shank.is_none() && text.holder.is_empty() && text.stick_out.is_none() =>
            {
                let file = path.parent().unwrap_or(Path::new(".")).join(mesh.get_ref());
                let file = read_mesh_file(file).map_err(|error| Fault {
                    kind: error.fault.kind,
                    ..self.wrong(mesh, error.to_string())
                })?;
                let unit = text.unit.or(file.unit).unwrap_or_default();
                // A tool has no warnings: what is repaired is what would be of a part.
                let (mesh, _) = file.in_unit(unit).with_consistent_faces();
                Tool { unit, shape: ToolShape::Mesh(mesh), ..Tool::revolved(name, []) }
            }
            (Some(mesh), _) => {
                let what = "mesh stands alone: remove cutter, shank, holder and stick_out, or remove mesh";
                return Err(self.wrong(mesh, what));
            }
            (None, None) => return Err(self.at(0, "a tool needs a [cutter] or a mesh")),
            (None, Some(cutter)) => {
                let (stack, overall_length) = self.stack(&text, cutter)?;
                let unit = text.unit.unwrap_or_default();
                let (back_cutting, plunge_only) = (cutter.back_cutting, cutter.plunges_only());
                Tool { overall_length, back_cutting, plunge_only, ..stack.tool(name, unit) }
            }
        };
        let Some(sharp) = &text.sharp_points else { return Ok(tool) };
        let sharp_points = sharp_points(sharp.get_ref(), &tool.shape).ok_or_else(|| {
            let what = "sharp_points must be \"tip\", a number of points on the cutter (5 and more, which is a ring) or \"boundary\" \
                        (neither for a mesh), { within = LENGTH } (of a mesh: its vertices so near the tip; there must be some), or \
                        a list of points [[x, y, z], …]";
            self.wrong(sharp, what)
        })?;
        Ok(Tool { sharp_points, ..tool })
    }

    /// The stack, and the length of cutter and shank where the file states it beside the stick-out.
    fn stack(&self, text: &ToolText, cutter: &CutterText) -> Result<(Stack, Option<f64>), Fault> {
        let shank = text.shank.as_ref();
        let diameter = shank.map(|shank| self.length("shank.diameter", &shank.diameter)).transpose()?;
        let profile = self.cutter(cutter, diameter)?;
        let cutter_length = top(&profile);
        let length = shank.and_then(|shank| shank.length.as_ref());
        let length = length.map(|length| self.length("shank.length", length)).transpose()?;
        let shank_end = length.map(|length| cutter_length + length);
        let stick_out = text.stick_out.as_ref().map(|s| self.length("stick_out", s)).transpose()?;
        let face = stick_out.unwrap_or(shank_end.unwrap_or(cutter_length));
        if let Some(stick) = &text.stick_out {
            if let Some(end) = shank_end.filter(|&end| end < face && !text.holder.is_empty()) {
                let what = format!(
                    "stick_out {face} leaves a gap below the holder: cutter and shank reach only {end}"
                );
                return Err(self.wrong(stick, what));
            }
            if diameter.is_some() && face < cutter_length && !text.holder.is_empty() {
                let what = format!(
                    "stick_out {face} ends within the cutter ({cutter_length}), which leaves nothing of the [shank]: state a longer \
                     one, or leave out the shank"
                );
                return Err(self.wrong(stick, what));
            }
            if diameter.is_none() && face > cutter_length {
                let what = format!(
                    "stick_out {face} is longer than the cutter ({cutter_length}): a [shank] is needed"
                );
                return Err(self.wrong(stick, what));
            }
        }
        if let Some(shank) = shank.filter(|_| shank_end.is_none() && stick_out.is_none()) {
            let what = "nothing says how long the [shank] is: state its length, or stick_out";
            return Err(self.wrong(&shank.diameter, what));
        }
        let (end, radius) = (shank_end.unwrap_or(face), diameter.unwrap_or_default() / 2.0);
        let shank =
            diameter.filter(|_| end > cutter_length).map(|_| line(cutter_length, end, radius, radius));
        let mut holder = Vec::new();
        for part in &text.holder {
            let lower = self.length("holder.diameter", &part.diameter)?;
            let upper = part.top_diameter.as_ref().unwrap_or(&part.diameter);
            let upper = self.length("holder.top_diameter", upper)?;
            holder.push([self.length("holder.length", &part.length)?, lower, upper]);
        }
        // Without a holder nothing is hidden.
        let face = if holder.is_empty() { f64::INFINITY } else { face };
        let overall = shank_end.filter(|_| stick_out.is_some());
        Ok((Stack { cutter: profile, shank: shank.into_iter().collect(), face, holder }, overall))
    }
}

/// `None` for points that the shape cannot have.
fn sharp_points(text: &SharpText, shape: &ToolShape) -> Option<SharpPoints> {
    let revolved = matches!(shape, ToolShape::Revolved(_));
    match text {
        SharpText::Name(name) if name == "tip" => Some(SharpPoints::Tip),
        SharpText::Name(name) if name == "boundary" && revolved => Some(SharpPoints::Boundary(None)),
        SharpText::Count(count) if (*count == 1.0 || *count >= 5.0) && count.fract() == 0.0 && revolved => {
            Some(SharpPoints::Cutter(*count as usize))
        }
        SharpText::Points(points) if !points.is_empty() && points.iter().flatten().all(|v| v.is_finite()) => {
            Some(SharpPoints::Points(points.iter().map(|&p| DVec3::from_array(p)).collect()))
        }
        SharpText::Within { within } if *within > 0.0 => {
            let ToolShape::Mesh(mesh) = shape else { return None };
            let mut points = mesh.welded().vertices;
            points.retain(|vertex| vertex.length() <= *within);
            (!points.is_empty()).then_some(SharpPoints::Points(points))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests;
