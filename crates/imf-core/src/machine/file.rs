//! Machines on disk, in TOML.
//!
//! ```toml
//! name = "trunnion A/C"
//! unit = "mm"
//! travel = { x = [-300, 300], y = [-200, 250], z = [-450, 0] }   # each optional
//! home = [0, 0, 0]              # reference point of G28; the machine's zero by default
//! prefer = "A-"                 # optional: of two solutions the one with A at 0 or below
//!
//! [offsets]
//! G54 = [0, 0, -350]            # where the part's zero lies with the rotary axes at 0; G55 to G59 as well
//!
//! [[rotary]]                    # axes of one side from the machine's frame outwards
//! letter = "A"
//! on = "table"                  # or "head"
//! axis = [1, 0, 0]              # positive angles turn what it carries right-handed about it
//! centre = [0, 0, -380]         # a point on it; [0, 0, 0] by default
//! range = [-120, 30]            # degrees; without it there is no limit
//!
//! [[solid]]                     # any number
//! name = "platter"
//! on = "C"                      # the axis that carries it; "table" or "head" for what no rotary axis turns
//! cylinder = { base = [0, 0, -390], top = [0, 0, -350], diameter = 200 }
//! # or box = { lower = [-100, -100, -400], upper = [100, 100, -390] }
//! # or mesh = "platter.stl"     # closed, relative to this file
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use toml::Spanned;

use super::{Machine, MachineSolid, PreferredBranch, RotaryAxis, Side, SolidShape};
use crate::file_error::{Fault, FaultKind, FileError, read_small, text_of};
use crate::mesh::read::read_mesh_file;
use crate::unit::LengthUnit;
use crate::voxelize::openings;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MachineText {
    name: Option<String>,
    unit: Option<LengthUnit>,
    #[serde(default)]
    travel: TravelText,
    home: Option<[f64; 3]>,
    prefer: Option<Spanned<String>>,
    #[serde(default)]
    offsets: BTreeMap<String, Spanned<[f64; 3]>>,
    #[serde(default)]
    rotary: Vec<Spanned<RotaryText>>,
    #[serde(default)]
    solid: Vec<Spanned<SolidText>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct TravelText {
    x: Option<[f64; 2]>,
    y: Option<[f64; 2]>,
    z: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RotaryText {
    letter: char,
    on: Side,
    axis: [f64; 3],
    #[serde(default)]
    centre: [f64; 3],
    range: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SolidText {
    name: String,
    on: String,
    cylinder: Option<CylinderText>,
    #[serde(rename = "box")]
    cuboid: Option<BoxText>,
    mesh: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CylinderText {
    base: [f64; 3],
    top: [f64; 3],
    diameter: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxText {
    lower: [f64; 3],
    upper: [f64; 3],
}

impl Machine {
    /// Reads a machine file.
    ///
    /// # Errors
    /// Names the file, the line where it is known, the cause and the remedy.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let bytes = read_small("machine file", path).map_err(|fault| fault.at(path))?;
        Self::parse(&text_of(&bytes).map_err(|fault| fault.at(path))?, path)
    }

    /// As [`Machine::read`], from the text of a machine file called `name`; meshes that it names lie beside that.
    ///
    /// # Errors
    /// As [`Machine::read`].
    pub fn parse(text: &str, name: &Path) -> Result<Self, FileError> {
        Reader { text }.machine(name).map_err(|fault| fault.at(name))
    }
}

/// No coordinate of a machine is as large, in any unit.
const FARTHEST: f64 = 1e6;

/// The text being read, for errors that name their line.
struct Reader<'a> {
    text: &'a str,
}

impl Reader<'_> {
    fn at(&self, offset: usize, what: impl Into<String>) -> Fault {
        let line = self.text[..offset.min(self.text.len())].matches('\n').count() + 1;
        Fault::malformed(what).on_line(line)
    }

    fn machine(&self, path: &Path) -> Result<Machine, Fault> {
        let text: MachineText = toml::from_str(self.text)
            .map_err(|error| self.at(error.span().map_or(0, |span| span.start), error.message()))?;
        let unit = text.unit.unwrap_or_default();
        let unlimited = [f64::NEG_INFINITY, f64::INFINITY];
        let rotary: Vec<RotaryAxis> =
            text.rotary.iter().map(|axis| self.rotary(axis)).collect::<Result<_, _>>()?;
        let of_file =
            || path.file_stem().map_or_else(|| "machine".into(), |s| s.to_string_lossy().into_owned());
        let mut machine = Machine {
            name: text.name.unwrap_or_else(of_file),
            unit,
            rotary,
            travel: [text.travel.x, text.travel.y, text.travel.z].map(|range| range.unwrap_or(unlimited)),
            home: self.point(0, text.home.unwrap_or_default())?,
            preferred: None,
            offsets: self.offsets(&text.offsets)?,
            solids: Vec::new(),
        };
        if let Some(fault) = machine.fault() {
            return Err(Fault::malformed(fault));
        }
        if let Some(prefer) = &text.prefer {
            let preferred = branch(prefer.get_ref(), &machine);
            let wrong = || self.at(prefer.span().start, "prefer is a rotary axis and + or -, such as \"A-\"");
            machine.preferred = Some(preferred.ok_or_else(wrong)?);
        }
        for solid in &text.solid {
            let made = self.solid(solid, &machine, path)?;
            machine.solids.push(made);
        }
        Ok(machine)
    }

    fn offsets(&self, text: &BTreeMap<String, Spanned<[f64; 3]>>) -> Result<BTreeMap<u8, DVec3>, Fault> {
        let offset = |(name, at): (&String, &Spanned<[f64; 3]>)| {
            let number = name.strip_prefix(['G', 'g']).and_then(|number| number.parse().ok());
            let number = number.filter(|number| (54..=59).contains(number));
            let wrong = || self.at(at.span().start, format!("'{name}' is not a work offset from G54 to G59"));
            Ok((number.ok_or_else(wrong)?, self.point(at.span().start, *at.get_ref())?))
        };
        text.iter().map(offset).collect()
    }

    fn point(&self, offset: usize, point: [f64; 3]) -> Result<DVec3, Fault> {
        let point = DVec3::from_array(point);
        if !point.is_finite() {
            return Err(self.at(offset, "a coordinate must be finite"));
        }
        if point.abs().max_element() > FARTHEST {
            let what = format!(
                "a coordinate of {:e} is beyond {FARTHEST:e}: check it, and the file's unit",
                point.abs().max_element()
            );
            return Err(self.at(offset, what));
        }
        Ok(point)
    }

    fn rotary(&self, text: &Spanned<RotaryText>) -> Result<RotaryAxis, Fault> {
        let (place, text) = (text.span().start, text.get_ref());
        let axis = DVec3::from_array(text.axis);
        if !axis.is_finite() {
            return Err(self.at(place, "a coordinate must be finite"));
        }
        let direction = axis.try_normalize().ok_or_else(|| self.at(place, "the axis must not be zero"))?;
        let range = text.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let (letter, side) = (text.letter.to_ascii_uppercase(), text.on);
        Ok(RotaryAxis { letter, side, direction, centre: self.point(place, text.centre)?, range })
    }

    fn solid(
        &self,
        text: &Spanned<SolidText>,
        machine: &Machine,
        path: &Path,
    ) -> Result<MachineSolid, Fault> {
        let (place, text) = (text.span().start, text.get_ref());
        let wrong = |what: String| self.at(place, format!("the solid '{}' {what}", text.name));
        let (side, level) = carrier(&text.on, machine).ok_or_else(|| {
            wrong(format!(
                "is on '{}', which is neither \"table\" nor \"head\" nor the letter of a rotary axis",
                text.on
            ))
        })?;
        let shape = match (&text.cylinder, &text.cuboid, &text.mesh) {
            (Some(CylinderText { base, top, diameter }), None, None) => {
                let (base, top) = (self.point(place, *base)?, self.point(place, *top)?);
                if base == top || !(*diameter > 0.0 && *diameter < FARTHEST) {
                    return Err(wrong(
                        "needs two different ends and a diameter above 0 and below 1e6".into(),
                    ));
                }
                SolidShape::Cylinder { base, top, diameter: *diameter }
            }
            (None, Some(BoxText { lower, upper }), None) => {
                let (lower, upper) = (self.point(place, *lower)?, self.point(place, *upper)?);
                if !lower.cmplt(upper).all() {
                    return Err(wrong("needs a lower corner below its upper one in x, y and z".into()));
                }
                SolidShape::Box { lower, upper }
            }
            (None, None, Some(mesh)) => {
                let file = path.parent().unwrap_or(Path::new(".")).join(mesh);
                let file = read_mesh_file(file).map_err(|error| Fault {
                    kind: error.fault.kind,
                    ..wrong(format!("has no mesh: {error}"))
                })?;
                let (mesh, _) = file.in_unit(machine.unit).with_consistent_faces();
                if mesh.triangles.is_empty() {
                    return Err(Fault {
                        kind: FaultKind::Empty,
                        ..wrong("has a mesh without a triangle".into())
                    });
                }
                if let Some(edges) = openings(&mesh) {
                    return Err(wrong(format!(
                        "has an open mesh ({edges} boundary edges), which does not say everywhere what is inside: close its holes, make it \
                         one closed solid, and export it again"
                    )));
                }
                SolidShape::Mesh(mesh)
            }
            _ => return Err(wrong("needs one shape: cylinder, box or mesh".into())),
        };
        Ok(MachineSolid { name: text.name.clone(), side, level, shape })
    }
}

/// A side, and how many of its rotary axes carry something.
fn carrier(on: &str, machine: &Machine) -> Option<(Side, usize)> {
    match on.to_ascii_lowercase().as_str() {
        "table" => return Some((Side::Table, 0)),
        "head" => return Some((Side::Head, 0)),
        _ => {}
    }
    let mut letters = on.chars();
    let place = machine.rotary_by_letter(letters.next()?).filter(|_| letters.next().is_none())?;
    let side = machine.rotary[place].side;
    let level = machine.chain(side).position(|(own, _)| own == place)? + 1;
    Some((side, level))
}

fn branch(text: &str, machine: &Machine) -> Option<PreferredBranch> {
    let mut letters = text.trim().chars();
    let axis = machine.rotary_by_letter(letters.next()?)?;
    match letters.as_str().trim() {
        "+" => Some(PreferredBranch { axis, positive: true }),
        "-" => Some(PreferredBranch { axis, positive: false }),
        _ => None,
    }
}
