//! `imf field`: sections of the collision measure, or their minimum over orientations, of a part or of a saved field.

mod check;
mod counting;
mod elements;
mod inaccessibility;
mod saved;
mod sections;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Result, bail};
use imf_core::atomic_file::write_atomically;
use imf_core::mesh::MachiningDirection;
use imf_core::obstacle::Obstacle;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::Scene;
use imf_core::section::{DepthPlan, ElementPlans, Quantity, SectionPlan, ToolPoints};
use imf_core::unit::LengthUnit;
use imf_fields::calibration::Calibration;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use serde_json::{Value, json};

use self::check::Check;
use self::saved::SavedField;
use super::calibrate::threshold_text;
use super::notes;
use crate::arguments::clearance::title;
use crate::arguments::field::FieldArguments;
use crate::arguments::orientations::Directions;
use crate::engine::{Device, read_field};
use crate::output::{OutputFolder, PROGRAM, SUMMARY, same_digits, short};
use crate::picture::MaskStyle;
use crate::session::Session;
use crate::slices::{MidPlaneSheet, MidPlanes};

/// The list of orientations beside the fields: their indices count its lines.
const ORIENTATIONS: &str = "orientations.csv";

pub(crate) fn run(session: &Session, arguments: &FieldArguments) -> Result<()> {
    let subject = Path::new(&arguments.scene.part);
    let is_saved = is_field(subject);
    arguments.check(is_saved)?;
    let folder = OutputFolder::check(&arguments.out)?;
    if is_saved { of_saved(session, arguments, subject, folder) } else { of_part(session, arguments, folder) }
}

fn of_part(session: &Session, arguments: &FieldArguments, folder: OutputFolder) -> Result<()> {
    // Before anything is voxelised, a part's own directions from its surface as it is set up.
    let inputs = arguments.scene.read(session, true)?;
    let of_part = || inputs.part.mesh.transformed(&inputs.transform).machining_directions();
    let directions = |text: &str| Directions::of_part(text, of_part);
    let named = arguments.orientations.as_deref().map(directions).transpose()?;
    let quantity = arguments.quantity;
    let (scene, bodies) =
        arguments.scene.scene_among(session, &inputs, &arguments.contact, arguments.elements, quantity)?;
    let round = scene.record.bare_tool().is_axisymmetric();
    let Directions { set, suggested } = match named {
        Some(named) => named,
        None => directions(OrientationSet::usual(round, true))?,
    };
    if !round {
        note_of_rolls(session, &set);
    }
    let device = Device::open(arguments.device.as_deref().unwrap_or("cpu"), session)?;
    let obstacle = match scene.record.contact {
        Some(depth) => Obstacle::with_cuttable(&bodies.obstacle(), bodies.layer(depth)),
        None => bodies.obstacle().into(),
    };
    let assembly = scene.record.assembly()?;
    let plan = SectionPlan::with_query(&obstacle, &assembly, ToolPoints::SharpPoints, &scene.record.grid)?;
    if let (Device::Gpu(_), Quantity::Depth) = (&device, quantity) {
        bail!("depths of a part are counted by the CPU: leave --device out");
    }
    let depth = if quantity.is_overlap() { None } else { Some(DepthPlan::of(&plan)?) };
    let elements = arguments
        .elements
        .then(|| ElementPlans::new(&obstacle, &assembly, &scene.record.grid))
        .transpose()?;
    if elements.as_ref().is_some_and(|elements| elements.elements().next().is_none()) {
        let name = &scene.record.tool.name;
        bail!("--elements needs a tool of cutter, shank and holder, and the tool '{name}' is a mesh");
    }
    let (elements, check) = (elements.as_ref(), Check::new(arguments.check));
    let values = Values::Exact(ExactSections { plan: &plan, depth: depth.as_ref(), elements, check });
    let work =
        Work { session, folder, scene: &scene, device: &device, values, set: &set, suggested: &suggested };
    work.run(arguments.imf)
}

fn of_saved(session: &Session, arguments: &FieldArguments, path: &Path, folder: OutputFolder) -> Result<()> {
    let saved = read_field(session, path)?;
    let scene = saved.scene().clone();
    let text = arguments.orientations.as_deref();
    let text =
        text.unwrap_or_else(|| OrientationSet::usual(scene.record.bare_tool().is_axisymmetric(), false));
    let set = OrientationSet::parse(text)?;
    if saved.basis().is_some_and(|basis| basis.domain() == Domain::Rotations) {
        note_of_rolls(session, &set);
    }
    let field = SavedField::new(saved)?;
    notes::of_scene(session, &scene.record);
    if let FieldFile::Siren(model) = &field.saved {
        notes::of_training(session, path, model);
    }
    let device = Device::for_field(arguments.device.as_deref().unwrap_or("auto"), session, &field.saved)?;
    let values = Values::Saved(&field);
    Work { session, folder, scene: &scene, device: &device, values, set: &set, suggested: &[] }
        .run(arguments.imf)
}

/// True where a file is not a mesh but looks like a saved field. One without an ending begins as its format does: the
/// length of its header in eight bytes, and a brace.
pub(super) fn is_field(part: &Path) -> bool {
    let begins_so = || {
        let mut start = [0; 9];
        File::open(part).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start[8] == b'{'
    };
    part.extension().map_or_else(begins_so, |ending| ending.eq_ignore_ascii_case("safetensors"))
}

/// Says so where a tool whose roll matters is never rolled.
fn note_of_rolls(session: &Session, set: &OrientationSet) {
    if set.orientations.iter().all(|orientation| orientation.roll == 0.0) {
        session.note("the tool is not axisymmetric, and no orientation rolls it: see so3:N");
    }
}

/// What both kinds of field are made from.
struct Work<'a> {
    session: &'a Session,
    folder: OutputFolder,
    scene: &'a Scene,
    device: &'a Device,
    values: Values<'a>,
    set: &'a OrientationSet,
    /// What the part suggested, where the set names it.
    suggested: &'a [MachiningDirection],
}

enum Values<'a> {
    Exact(ExactSections<'a>),
    Saved(&'a SavedField),
}

struct ExactSections<'a> {
    plan: &'a SectionPlan,
    /// Where depths are requested, not overlaps.
    depth: Option<&'a DepthPlan>,
    elements: Option<&'a ElementPlans>,
    check: Check,
}

impl Work<'_> {
    /// Computes, writes and reports sections, or their minimum.
    fn run(&self, imf: bool) -> Result<()> {
        self.session.detail(&self.computed_by());
        if imf { inaccessibility::run(self) } else { sections::run(self) }
    }

    /// What counts, where something does.
    fn counted(&self) -> Option<&ExactSections<'_>> {
        match &self.values {
            Values::Exact(counted) => Some(counted),
            Values::Saved(_) => None,
        }
    }

    fn elements(&self) -> Option<&ElementPlans> {
        self.counted().and_then(|counted| counted.elements)
    }

    /// What was compared with direct sums, in words.
    fn checked(&self) -> Option<String> {
        self.counted().and_then(|counted| counted.check.describe())
    }

    /// Writes the orientations as `index,theta,phi,roll` in degrees.
    fn write_orientations(&self) -> Result<()> {
        Ok(write_atomically(self.folder.file(ORIENTATIONS), |out| {
            use std::io::Write as _;
            writeln!(out, "index,theta,phi,roll")?;
            for (index, Orientation { theta, phi, roll }) in self.set.orientations.iter().enumerate() {
                writeln!(out, "{index},{theta},{phi},{roll}")?;
            }
            Ok(())
        })?)
    }

    /// What the values are, and how they are called.
    fn measure(&self) -> Measure {
        let quantity = match &self.values {
            Values::Saved(field) => field.saved.quantity(),
            Values::Exact(ExactSections { depth: None, .. }) => Quantity::Overlap,
            Values::Exact(_) => Quantity::Depth,
        };
        Measure::of(quantity, self.scene.record.unit, self.scene.record.grid.pitch)
    }

    /// Largest value of what counts as accessible: 0 where values are counted; of a saved field its calibrated threshold, if it has
    /// one.
    fn tau(&self) -> Option<f32> {
        match self.values {
            Values::Saved(field) => field.saved.calibration().and_then(|known| known.free_up_to),
            Values::Exact(_) => Some(0.0),
        }
    }

    /// What [`Work::tau`] is and why, of a saved field.
    fn threshold_text(&self, field: &SavedField) -> String {
        match (field.saved.calibration(), self.tau()) {
            (None, _) => {
                "not calibrated, so that nothing is called accessible: imf calibrate chooses a threshold"
                    .to_owned()
            }
            (Some(_), None) => "no value of this field is low enough to be called free".to_owned(),
            (Some(_), Some(tau)) => {
                let tau = threshold_text(tau.into(), field.saved.quantity(), self.scene.record.unit);
                format!("at most {tau} counts as free, the field's calibrated threshold")
            }
        }
    }

    /// Threshold and verdict of a saved field, as text.
    fn trust(&self) -> Option<String> {
        let Values::Saved(field) = self.values else { return None };
        let verdict = field.saved.calibration().map_or_else(String::new, |known| {
            format!(
                "verdict       {}; the minimum over many directions picks the field's errors out\n",
                known.verdict()
            )
        });
        Some(format!("threshold     {}\n{verdict}", self.threshold_text(field)))
    }

    /// Voxels outside the part where `values` is at most [`Work::tau`], and the others; nothing where there is no threshold.
    fn accessible_outside(&self, values: &[f32]) -> Option<Outside> {
        let (solid, tau) = (&self.scene.obstacle.solid, self.tau()?);
        let empty = || values.iter().zip(solid).filter(|&(_, &solid)| solid == 0);
        let accessible = empty().filter(|&(&value, _)| value <= tau).count();
        Some(Outside { accessible, inaccessible: empty().count() - accessible })
    }

    /// Everything that is needed to know what the fields are; `kind` adds its own.
    fn summary(&self, kind: &str, own: Value) -> Value {
        // What a saved field may be used for, where that was measured.
        let verdict = match self.values {
            Values::Saved(field) => field.saved.calibration().map(Calibration::verdict),
            Values::Exact(_) => None,
        };
        let mut summary = json!({
            "program": PROGRAM,
            "kind": kind,
            "scene": self.scene.record,
            "solid_voxels": self.scene.obstacle.count(),
            "orientations": { "set": self.set.spec, "count": self.set.len(), "file": ORIENTATIONS,
                "suggested_by_the_part": self.suggested },
            "computed_by": self.computed_by(),
            "guarantee": self.guarantee(),
            "quantity": self.measure().quantity,
            "clamped_within": (!self.measure().quantity.is_overlap()).then(|| self.measure().most),
            "tau": self.tau().map(same_digits),
            "verdict": verdict,
            "harmonic": null,
            "check": self.counted().map(|counted| counted.check.summary()),
        });
        if let (Some(all), Value::Object(own)) = (summary.as_object_mut(), own) {
            if let Values::Saved(field) = self.values {
                let (family, made) = field.summary();
                all.insert(family.to_owned(), made);
            }
            all.extend(own);
        }
        summary
    }

    fn guarantee(&self) -> String {
        match self.values {
            Values::Saved(field) => field.guarantee(),
            Values::Exact(_) => self.scene.record.guarantee().to_string(),
        }
    }

    /// What values are, for a note beside a picture.
    fn exactness(&self) -> &'static str {
        match self.values {
            Values::Exact(_) => "exact for voxel centres",
            Values::Saved(field) => field.exactness(),
        }
    }

    /// Draws mid-planes with the part's outline into a file of the folder.
    fn draw(&self, label: &str, planes: &[MidPlanes], notes: Vec<String>, file: &str) -> Result<()> {
        let sheet = MidPlaneSheet {
            title: title(&self.scene.record),
            label,
            part: &self.scene.obstacle,
            style: Some(MaskStyle::Outline),
            unit: self.scene.record.unit,
            // A fitted value is not exactly 0.
            free: matches!(self.values, Values::Exact(_)) && self.measure().quantity.is_overlap(),
            notes,
        };
        sheet.save(planes, &self.folder.file(file))
    }
}

/// Values of a quantity and their names, lengths with their unit.
struct Measure {
    quantity: Quantity,
    /// Of sections: files and arrays begin with it.
    section: String,
    /// Of the minimum over orientations.
    minimum: String,
    /// Beside colour bars.
    section_label: String,
    minimum_label: String,
    /// Before the largest value.
    short: String,
    /// How large values can be.
    most: f64,
    pitch: f64,
}

impl Measure {
    fn of(quantity: Quantity, unit: LengthUnit, pitch: f64) -> Self {
        let [_, most] = quantity.bounds(pitch);
        let [section, minimum, section_label, minimum_label, short] = match quantity {
            Quantity::Overlap => {
                ["cmf", "imf", "collision measure CMF", "inaccessibility measure IMF", "CMF"]
                    .map(str::to_owned)
            }
            Quantity::Depth => [
                format!("depth-{unit}"),
                format!("minimum-depth-{unit}"),
                format!("signed penetration depth, {unit}"),
                format!("minimum of the depth, {unit}"),
                format!("depth, {unit}"),
            ],
        };
        Self { quantity, section, minimum, section_label, minimum_label, short, most, pitch }
    }

    /// The largest value in words: depths end at a bound, and what is as deep as that may be deeper.
    fn largest(&self, value: f32) -> String {
        let is_held = !self.quantity.is_overlap() && value >= self.most as f32;
        format!("{}{value:.4}", if is_held { "at least " } else { "" })
    }

    /// What a reader of depths must know; nothing of overlaps.
    fn held(&self, unit: LengthUnit) -> Option<String> {
        let [pitches, most] = [self.most / self.pitch, self.most].map(short);
        (!self.quantity.is_overlap()).then(|| {
            format!("depths are known within {pitches} voxels, {most} {unit}: what is deeper, or farther away, has that bound")
        })
    }
}

/// Voxels outside the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Outside {
    accessible: usize,
    inaccessible: usize,
}

impl Outside {
    /// How many of the voxels, that are at a place, are accessible.
    fn text(self, place: &str) -> String {
        match self.accessible + self.inaccessible {
            0 => "no voxel of the grid is outside the part".into(),
            all => {
                let percent = 100.0 * self.accessible as f64 / all as f64;
                format!("{} of {all} voxels{place} ({percent:.1} %)", self.accessible)
            }
        }
    }
}

fn angles_text(orientation: &Orientation) -> String {
    let Orientation { theta, phi, roll } = orientation;
    let roll = if *roll == 0.0 { String::new() } else { format!(", ψ = {roll:.1}°") };
    format!("θ = {theta:.1}°, φ = {phi:.1}°{roll}")
}
