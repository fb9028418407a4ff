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
//! shape = "ball"                # flat | ball | bull | tapered
//! diameter = 10.0               # at the tip for a tapered cutter
//! length = 35.0
//! # corner_radius = 1.0         # bull; tapered (half the diameter unless given)
//! # half_angle = 5.0            # tapered, degrees
//!
//! [shank]                       # optional
//! diameter = 10.0
//! length = 20.0
//!
//! [[holder]]                    # any number, from the tip upwards
//! diameter = 29.0
//! top_diameter = 29.0           # optional: a cone
//! length = 48.0
//! ```
//!
//! or `mesh = "head.stl"` instead of cutter, shank and holder: a closed mesh in the tool frame.

mod cutter;

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use thiserror::Error;
use toml::Spanned;

use cutter::CutterText;
pub(super) use cutter::rounded;

use super::library::{self, ToolLibraryError};
use super::{Element, ElementKind, Segment, SharpPoints, Tool, ToolError, ToolShape};
use crate::mesh::read::{MeshFileError, read_mesh_file};
use crate::unit::LengthUnit;

/// Why a tool file is refused.
#[derive(Debug, Error)]
pub enum ToolFileError {
    /// The file cannot be read.
    #[error("cannot read the tool file {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The text is not what a tool file holds.
    #[error("{path}, line {line}: {what}")]
    Content {
        /// The file.
        path: String,
        /// Line in the file, from 1.
        line: usize,
        /// The key and what is wrong with it.
        what: String,
    },
    /// The mesh that the file names cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The library of a CAM program.
    #[error(transparent)]
    Library(#[from] ToolLibraryError),
    /// The assembly has no volume.
    #[error("{path}: {source}")]
    Tool {
        /// The file.
        path: String,
        /// What is wrong with the tool.
        source: ToolError,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolText {
    name: Option<String>,
    unit: Option<LengthUnit>,
    stick_out: Option<Spanned<f64>>,
    sharp_points: Option<Spanned<SharpText>>,
    mesh: Option<Spanned<String>>,
    cutter: Option<Spanned<CutterText>>,
    shank: Option<Spanned<ShankText>>,
    #[serde(default)]
    holder: Vec<HolderText>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum SharpText {
    Name(String),
    Count(usize),
    Points(Vec<[f64; 3]>),
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
    pub fn read(path: &Path) -> Result<Self, ToolFileError> {
        if library::is_library(path) {
            return Ok(library::read(path, None)?);
        }
        let shown = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|source| ToolFileError::Read { path: shown.clone(), source })?;
        let reader = Reader { path: &shown, text: &text };
        let parsed: ToolText = toml::from_str(&text).map_err(|error| {
            let line = error.span().map_or(1, |span| reader.line(span.start));
            reader.at(line, error.message().to_owned())
        })?;
        let tool = reader.tool(&parsed, path.parent().unwrap_or(Path::new(".")))?;
        tool.check().map_err(|source| ToolFileError::Tool { path: shown.clone(), source })?;
        Ok(tool)
    }
}

impl Tool {
    /// As [`Tool::read`], of a path, or of `LIBRARY#TOOL`: a tool of several by its name or number.
    ///
    /// # Errors
    /// As [`Tool::read`]; a name that no tool of the library has, or several.
    pub fn find(text: &str) -> Result<Self, ToolFileError> {
        match library::location(text) {
            (path, Some(tool)) if library::is_library(path) => Ok(library::read(path, Some(tool))?),
            _ => Self::read(Path::new(text)),
        }
    }
}

/// The text being read, for errors that name their line.
struct Reader<'a> {
    path: &'a str,
    text: &'a str,
}

impl Reader<'_> {
    fn line(&self, offset: usize) -> usize {
        self.text[..offset.min(self.text.len())].matches('\n').count() + 1
    }

    fn at(&self, line: usize, what: String) -> ToolFileError {
        ToolFileError::Content { path: self.path.to_owned(), line, what }
    }

    /// A length that must be positive and finite.
    fn length(&self, key: &str, value: &Spanned<f64>) -> Result<f64, ToolFileError> {
        let number = *value.get_ref();
        if number.is_finite() && number > 0.0 {
            Ok(number)
        } else {
            let line = self.line(value.span().start);
            Err(self.at(line, format!("{key} must be a positive number, not {number}")))
        }
    }

    fn tool(&self, text: &ToolText, folder: &Path) -> Result<Tool, ToolFileError> {
        let mut unit = text.unit.unwrap_or_default();
        let shape = match (&text.mesh, &text.cutter) {
            (Some(mesh), None)
                if text.shank.is_none() && text.holder.is_empty() && text.stick_out.is_none() =>
            {
                let file = read_mesh_file(folder.join(mesh.get_ref()))?;
                unit = text.unit.or(file.unit).unwrap_or_default();
                ToolShape::Mesh(file.in_unit(unit))
            }
            (Some(mesh), _) => {
                let what = "mesh stands alone: remove cutter, shank, holder and stick_out, or remove mesh";
                return Err(self.at(self.line(mesh.span().start), what.into()));
            }
            (None, None) => return Err(self.at(1, "a tool needs a [cutter] or a mesh".into())),
            (None, Some(cutter)) => ToolShape::Revolved(self.elements(text, cutter.get_ref())?),
        };
        let sharp_points = match text.sharp_points.as_ref().map(|s| (s.get_ref(), s.span().start)) {
            None => SharpPoints::Tip,
            Some((SharpText::Name(name), _)) if name == "tip" => SharpPoints::Tip,
            Some((SharpText::Name(name), _))
                if name == "boundary" && matches!(shape, ToolShape::Revolved(_)) =>
            {
                SharpPoints::Boundary(None)
            }
            Some((SharpText::Count(count), _)) if *count > 0 && matches!(shape, ToolShape::Revolved(_)) => {
                SharpPoints::Cutter(*count)
            }
            Some((SharpText::Points(points), _))
                if !points.is_empty() && points.iter().flatten().all(|v| v.is_finite()) =>
            {
                SharpPoints::Points(points.iter().map(|&p| DVec3::from_array(p)).collect())
            }
            Some((_, offset)) => {
                let what = "sharp_points must be \"tip\", a positive number of points on the cutter or \"boundary\" \
                            (neither for a mesh), or a list of points [[x, y, z], …]";
                return Err(self.at(self.line(offset), what.into()));
            }
        };
        let name = text.name.clone().unwrap_or_else(|| {
            Path::new(self.path)
                .file_stem()
                .map_or_else(|| "tool".into(), |s| s.to_string_lossy().into_owned())
        });
        Ok(Tool { name, unit, shape, sharp_points })
    }

    fn elements(&self, text: &ToolText, cutter: &CutterText) -> Result<Vec<Element>, ToolFileError> {
        let cutter_profile = self.cutter(cutter)?;
        let cutter_length = *cutter.length.get_ref();
        let shank_diameter =
            text.shank.as_ref().map(|s| self.length("shank.diameter", &s.get_ref().diameter)).transpose()?;
        let shank_length = match text.shank.as_ref().and_then(|s| s.get_ref().length.as_ref()) {
            Some(length) => Some(self.length("shank.length", length)?),
            None => None,
        };
        let stick_out = text.stick_out.as_ref().map(|s| self.length("stick_out", s)).transpose()?;
        let face = stick_out.unwrap_or(cutter_length + shank_length.unwrap_or(0.0));
        if let (Some(stick), Some(length)) = (&text.stick_out, shank_length)
            && !text.holder.is_empty()
            && cutter_length + length < face
        {
            let what = format!(
                "stick_out {face} leaves a gap below the holder: cutter and shank reach only {}",
                cutter_length + length
            );
            return Err(self.at(self.line(stick.span().start), what));
        }
        if let (Some(stick), None) = (&text.stick_out, shank_diameter)
            && face > cutter_length
        {
            let what =
                format!("stick_out {face} is longer than the cutter ({cutter_length}): a [shank] is needed");
            return Err(self.at(self.line(stick.span().start), what));
        }
        // What is inside the holder belongs to the holder.
        let top = if text.holder.is_empty() { f64::INFINITY } else { face };
        let visible: Vec<Segment> = cutter_profile.iter().filter_map(|s| s.below(top)).collect();
        let mut elements = vec![Element { kind: ElementKind::Cutter, profile: visible }];
        let shank_top = shank_length.map_or(face, |length| cutter_length + length).min(top);
        if let Some(diameter) = shank_diameter.filter(|_| shank_top > cutter_length) {
            let radius = diameter / 2.0;
            let line =
                Segment::Line { from: cutter_length, to: shank_top, radius_from: radius, radius_to: radius };
            elements.push(Element { kind: ElementKind::Shank, profile: vec![line] });
        }
        let mut from = face;
        for (index, holder) in text.holder.iter().enumerate() {
            let radius_from = self.length("holder.diameter", &holder.diameter)? / 2.0;
            let top_diameter = holder.top_diameter.as_ref().unwrap_or(&holder.diameter);
            let radius_to = self.length("holder.top_diameter", top_diameter)? / 2.0;
            let to = from + self.length("holder.length", &holder.length)?;
            let line = Segment::Line { from, to, radius_from, radius_to };
            elements.push(Element { kind: ElementKind::Holder(index), profile: vec![line] });
            from = to;
        }
        Ok(elements)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Tool, ToolFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tool.toml");
        std::fs::write(&path, text).unwrap();
        Tool::read(&path)
    }

    const BALL: &str = "[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 35\n";

    #[test]
    fn the_papers_tool_can_be_written_down() {
        let tool = read(&format!("{BALL}[[holder]]\ndiameter = 29\nlength = 48\n")).unwrap();
        assert_eq!(tool.shape, Tool::paper().shape);
    }

    #[test]
    fn stick_out_hides_what_is_in_the_holder() {
        let text = format!("stick_out = 30\n{BALL}[[holder]]\ndiameter = 29\nlength = 48\n");
        let tool = read(&text).unwrap();
        assert_eq!(tool.length(), 78.0);
        let ToolShape::Revolved(elements) = tool.shape else { panic!() };
        assert_eq!(elements[0].profile[1].range(), (5.0, 30.0));
        let text =
            format!("stick_out = 50\n{BALL}[shank]\ndiameter = 8\n[[holder]]\ndiameter = 29\nlength = 40\n");
        let ToolShape::Revolved(elements) = read(&text).unwrap().shape else { panic!() };
        assert_eq!((elements[1].kind, elements[1].profile[0].range()), (ElementKind::Shank, (35.0, 50.0)));
    }

    #[test]
    fn every_cutter_shape_is_smooth_where_arc_meets_flank() {
        for shape in [
            "'bull'\ncorner_radius = 2",
            "'tapered'\nhalf_angle = 8",
            "'tapered'\nhalf_angle = 8\ncorner_radius = 1",
        ] {
            let tool = read(&format!("[cutter]\nshape = {shape}\ndiameter = 10\nlength = 30\n")).unwrap();
            let ToolShape::Revolved(elements) = tool.shape else { panic!() };
            let [arc, line] = elements[0].profile[..] else { panic!() };
            let joint = arc.range().1;
            assert!((arc.radius(joint) - line.radius(joint)).abs() < 1e-12);
            let slope =
                |s: Segment, side: f64| (s.radius(joint + side * 1e-6) - s.radius(joint)) / (side * 1e-6);
            assert!((slope(arc, -1.0) - slope(line, 1.0)).abs() < 1e-5, "{shape}");
        }
        let flat = read("[cutter]\nshape = 'flat'\ndiameter = 10\nlength = 30\n").unwrap();
        assert!((flat.volume() - 25.0 * std::f64::consts::PI * 30.0).abs() < 1e-9);
    }

    #[test]
    fn mistakes_name_their_line_and_key() {
        let cases = [
            ("[cutter]\nshape = 'ball'\ndiameter = -1\nlength = 35\n", 3, "cutter.diameter"),
            ("[cutter]\nshape = 'cube'\ndiameter = 1\nlength = 35\n", 2, "cube"),
            ("name = 'x'\n", 1, "[cutter]"),
            ("[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 35\ncolour = 3\n", 5, "colour"),
            ("[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 2\n", 4, "cutter.length"),
            ("[cutter]\nshape = 'bull'\ndiameter = 10\nlength = 20\ncorner_radius = 6\n", 5, "corner_radius"),
            ("stick_out = 90\n[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n", 1, "stick_out"),
            (
                "sharp_points = 'all'\n[cutter]\nshape = 'ball'\ndiameter = 10\nlength = 20\n",
                1,
                "sharp_points",
            ),
            ("[cutter\n", 1, ""),
        ];
        for (text, line, key) in cases {
            match read(text).unwrap_err() {
                ToolFileError::Content { line: found, what, .. } => {
                    assert_eq!(found, line, "{text}: {what}");
                    assert!(what.contains(key), "{text}: {what}");
                }
                other => panic!("{other}"),
            }
        }
        assert!(matches!(Tool::read(Path::new("no/such/tool.toml")), Err(ToolFileError::Read { .. })));
    }
}
