//! `imf field`: sections of the collision measure, or their minimum over orientations, of a part or of a saved field.

mod check;
mod counting;
mod elements;
mod inaccessibility;
mod saved;
mod sections;

use std::path::Path;

use anyhow::{Result, bail};
use glam::DMat4;
use imf_core::atomic_file::write_atomically;
use imf_core::mesh::MachiningDirection;
use imf_core::obstacle::Obstacle;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::Scene;
use imf_core::section::{At, ElementPlans, Quantity, SectionPlan};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use serde_json::{Value, json};

use self::check::Check;
use self::counting::Streamed;
use self::saved::Saved;
use super::notes;
use crate::arguments::field::FieldArguments;
use crate::arguments::fixture::Part;
use crate::arguments::orientations::{Directions, default_set};
use crate::engine::Device;
use crate::output::{OutputFolder, SUMMARY, same_digits};
use crate::session::Session;

/// Estimates at most this count as accessible, as `imf eval` judges decisions by default.
const TAU: f32 = 1e-3;
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
    let part = Part::read(&arguments.scene.part, arguments.scene.unit, None)?.scaled(arguments.scene.scale);
    let transform = arguments.scene.transform.unwrap_or(DMat4::IDENTITY);
    let directions =
        |text: &str| Directions::of_part(text, || part.mesh.transformed(&transform).machining_directions());
    let named = arguments.orientations.as_deref().map(directions).transpose()?;
    let (scene, bodies) = arguments.scene.scene_among(session, &arguments.contact, arguments.elements)?;
    let round = scene.record.bare_tool().is_axisymmetric();
    let Directions { set, suggested } = match named {
        Some(named) => named,
        None => directions(default_set(round, true))?,
    };
    if !round {
        note_of_rolls(session, &set);
    }
    let device = Device::open(arguments.device_or("cpu"), session)?;
    let obstacle = match scene.record.contact {
        Some(depth) => Obstacle::with_cuttable(&bodies.obstacle(), bodies.layer(depth)),
        None => bodies.obstacle().into(),
    };
    let assembly = scene.record.assembly()?;
    let plan = SectionPlan::with_query(&obstacle, &assembly, At::SharpPoints, &scene.record.grid)?;
    let elements = arguments
        .elements
        .then(|| ElementPlans::new(&obstacle, &assembly, &scene.record.grid))
        .transpose()?;
    if elements.as_ref().is_some_and(|elements| elements.elements().next().is_none()) {
        let name = &scene.record.tool.name;
        bail!("--elements needs a tool of cutter, shank and holder, and the tool '{name}' is a mesh");
    }
    let (elements, check) = (elements.as_ref(), Check::new(arguments.check));
    let values = Values::Counted(Counted { plan: &plan, elements, check });
    let work =
        Work { session, folder, scene: &scene, device: &device, values, set: &set, suggested: &suggested };
    work.run(arguments.imf)
}

fn of_saved(session: &Session, arguments: &FieldArguments, path: &Path, folder: OutputFolder) -> Result<()> {
    let stored = FieldFile::read(path)?;
    if stored.quantity() == Quantity::Depth {
        bail!(
            "{} is a field of depth, which is asked for poses: see imf query and imf check",
            path.display()
        );
    }
    let scene = stored.scene().clone();
    let text = arguments.orientations.as_deref();
    let text = text.unwrap_or_else(|| default_set(scene.record.bare_tool().is_axisymmetric(), false));
    let set = OrientationSet::parse(text)?;
    if stored.basis().is_some_and(|basis| basis.domain() == Domain::Rotations) {
        note_of_rolls(session, &set);
    }
    let field = Saved::new(stored, arguments.refine)?;
    notes::of_scene(session, &scene.record);
    if let FieldFile::Siren(model) = field.stored() {
        notes::of_training(session, path, model);
    }
    let device = Device::for_field(arguments.device_or("auto"), session, field.stored())?;
    let values = Values::Saved(&field);
    Work { session, folder, scene: &scene, device: &device, values, set: &set, suggested: &[] }
        .run(arguments.imf)
}

/// Whether a part is none, but looks like a saved field.
pub(super) fn is_field(part: &Path) -> bool {
    part.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("safetensors"))
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

/// Where values come from.
enum Values<'a> {
    Counted(Counted<'a>),
    Saved(&'a Saved),
}

/// Exact sections.
struct Counted<'a> {
    plan: &'a SectionPlan,
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
    fn counted(&self) -> Option<&Counted<'_>> {
        match &self.values {
            Values::Counted(counted) => Some(counted),
            Values::Saved(_) => None,
        }
    }

    /// Sections of elements, where they are asked for.
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

    /// Largest value of what counts as accessible: estimates are hardly ever 0.
    fn tau(&self) -> f32 {
        match self.values {
            Values::Saved(_) => TAU,
            Values::Counted(_) => 0.0,
        }
    }

    /// Voxels outside the part where `values` is at most [`Work::tau`], and the others.
    fn accessible_outside(&self, values: &[f32]) -> Outside {
        let (solid, tau) = (&self.scene.obstacle.solid, self.tau());
        let empty = || values.iter().zip(solid).filter(|&(_, &solid)| solid == 0);
        let accessible = empty().filter(|&(&value, _)| value <= tau).count();
        Outside { accessible, inaccessible: empty().count() - accessible }
    }

    /// Everything that is needed to know what the fields are; `kind` adds its own.
    fn summary(&self, kind: &str, own: Value) -> Value {
        let mut summary = json!({
            "program": concat!("imf ", env!("CARGO_PKG_VERSION")),
            "kind": kind,
            "scene": self.scene.record,
            "solid_voxels": self.scene.obstacle.count(),
            "orientations": { "set": self.set.spec, "count": self.set.len(), "file": ORIENTATIONS,
                "suggested_by_the_part": self.suggested },
            "computed_by": self.computed_by(),
            "guarantee": self.guarantee(),
            "tau": same_digits(self.tau()),
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

    /// Which guarantee holds for the values.
    fn guarantee(&self) -> String {
        match self.values {
            Values::Saved(field) => field.guarantee(),
            Values::Counted(_) => self.scene.record.guarantee().to_string(),
        }
    }

    /// What values are, for a note beside a picture.
    fn exactness(&self) -> &'static str {
        match self.values {
            Values::Counted(_) => "exact for voxel centres",
            Values::Saved(field) => field.exactness(),
        }
    }

    /// Name of part and tool for titles.
    fn title(&self) -> String {
        format!("{}, tool {}", self.scene.record.part, self.scene.record.tool.name)
    }
}

/// Voxels outside the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Outside {
    accessible: usize,
    inaccessible: usize,
}

impl Outside {
    fn percent(self) -> f64 {
        100.0 * self.accessible as f64 / (self.accessible + self.inaccessible).max(1) as f64
    }
}

/// An orientation for people.
fn angles_text(orientation: &Orientation) -> String {
    let Orientation { theta, phi, roll } = orientation;
    let roll = if *roll == 0.0 { String::new() } else { format!(", ψ = {roll:.1}°") };
    format!("θ = {theta:.1}°, φ = {phi:.1}°{roll}")
}
