//! `imf field`: the exact field, as sections of the collision measure or as its least value over orientations.

mod approximate;
mod check;
mod counting;
mod elements;
pub mod harmonic;
mod inaccessibility;
mod saved;
mod sections;

use std::path::Path;

use anyhow::{Result, bail};
use imf_core::atomic_file::write_atomically;
use imf_core::obstacle::Obstacle;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::Scene;
use imf_core::section::{At, ElementPlans, SectionPlan};
use serde_json::{Value, json};

use self::approximate::Approximate;
use self::check::Check;
use self::counting::Streamed;
use super::calibrate;
use crate::arguments::field::FieldArguments;
use crate::arguments::harmonic::FieldMethod;
use crate::engine::Device;
use crate::output::{OutputFolder, SUMMARY, print, print_json, same_digits};
use crate::session::Session;

/// Estimates at most this count as accessible, as `imf eval` judges decisions by default.
const TAU: f32 = 1e-3;
/// The list of orientations beside the fields: their indices count its lines.
const ORIENTATIONS: &str = "orientations.csv";

pub(crate) fn run(session: &Session, arguments: &FieldArguments) -> Result<()> {
    if is_field(Path::new(&arguments.scene.part)) {
        return saved::run(session, arguments);
    }
    arguments.check()?;
    let asked = match (&arguments.orientations, &arguments.out) {
        (Some(set), Some(out)) => Some((OrientationSet::parse(set)?, OutputFolder::check(out)?)),
        _ => None,
    };
    // A harmonic field is kept with its scene, which must then hold every fixture.
    let (scene, bodies) = match arguments.harmonic.method {
        FieldMethod::Exact => {
            let (scene, bodies) =
                arguments.scene.scene_among(session, &arguments.contact, arguments.elements)?;
            (scene, Some(bodies))
        }
        FieldMethod::Harmonic => (arguments.scene.scene_with(session, &arguments.contact)?, None),
    };
    let tool = &scene.record.tool;
    if let Some((set, _)) = asked.as_ref().filter(|_| !scene.record.bare_tool().is_axisymmetric()) {
        note_of_rolls(session, set);
    }
    let device = Device::open(arguments.device_or("cpu"), session)?;
    let obstacle = match (&bodies, scene.record.contact) {
        (Some(bodies), Some(depth)) => Obstacle::with_cuttable(&bodies.obstacle(), bodies.layer(depth)),
        (Some(bodies), None) => bodies.obstacle().into(),
        (None, _) => Obstacle::from(&scene),
    };
    let assembly = scene.record.assembly()?;
    // A field that is saved is of the tip, which serves every sharp point; sections are of the minimum over all of them.
    let at = if asked.is_none() { At::Tip } else { At::SharpPoints };
    let plan = SectionPlan::with_query(&obstacle, &assembly, at, &scene.record.grid)?;
    let elements = arguments
        .elements
        .then(|| ElementPlans::new(&obstacle, &assembly, &scene.record.grid))
        .transpose()?;
    if elements.as_ref().is_some_and(|elements| elements.elements().next().is_none()) {
        bail!("--elements needs a tool of cutter, shank and holder, and the tool '{}' is a mesh", tool.name);
    }
    let harmonic = harmonic::make(session, &scene, &plan, arguments)?;
    let Some((set, folder)) = asked else {
        let told = harmonic.as_ref().map(|made| {
            let (family, summary) = made.summary();
            json!({ family: summary, "scene": scene.record })
        });
        let described = harmonic.as_ref().map(|made| made.describe().to_owned()).unwrap_or_default();
        drop(harmonic);
        calibrated(session, arguments)?;
        return if session.json { print_json(&told) } else { print(&format!("{described}\n")) };
    };
    let values = match &harmonic {
        Some(field) => Values::Approximate(field),
        None => Values::Counted(Counted {
            plan: &plan,
            elements: elements.as_ref(),
            check: Check::new(arguments.check),
        }),
    };
    Work { session, folder, scene: &scene, device: &device, values, set: &set }.run(arguments.imf)?;
    drop(harmonic);
    calibrated(session, arguments)
}

/// Whether a part is none, but looks like a saved field.
fn is_field(part: &Path) -> bool {
    part.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("safetensors"))
}

/// Says so where a tool whose roll matters is never rolled.
fn note_of_rolls(session: &Session, set: &OrientationSet) {
    if set.orientations.iter().all(|orientation| orientation.roll == 0.0) {
        session.note("the tool is not axisymmetric, and no orientation rolls it: see so3:N");
    }
}

/// Measures what the decisions of a field that was kept are worth; two of it need not be in memory at once.
fn calibrated(session: &Session, arguments: &FieldArguments) -> Result<()> {
    match &arguments.harmonic.save {
        Some(path) if !arguments.harmonic.no_calibrate => calibrate::afterwards(session, path),
        _ => Ok(()),
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
}

/// Where values come from.
enum Values<'a> {
    Counted(Counted<'a>),
    Approximate(&'a Approximate),
}

/// Exact sections.
struct Counted<'a> {
    plan: &'a SectionPlan,
    elements: Option<&'a ElementPlans>,
    check: Check,
}

impl Work<'_> {
    /// Computes, writes and reports sections, or the least of them.
    fn run(&self, imf: bool) -> Result<()> {
        self.session.detail(&self.computed_by());
        if imf { inaccessibility::run(self) } else { sections::run(self) }
    }

    /// What counts, where something does.
    fn counted(&self) -> Option<&Counted<'_>> {
        match &self.values {
            Values::Counted(counted) => Some(counted),
            Values::Approximate(_) => None,
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
            Values::Approximate(_) => TAU,
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
            "orientations": { "set": self.set.spec, "count": self.set.len(), "file": ORIENTATIONS },
            "computed_by": self.computed_by(),
            "guarantee": self.guarantee(),
            "tau": same_digits(self.tau()),
            "harmonic": null,
            "check": self.counted().map(|counted| counted.check.summary()),
        });
        if let (Some(all), Value::Object(own)) = (summary.as_object_mut(), own) {
            if let Values::Approximate(field) = self.values {
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
            Values::Approximate(field) => field.guarantee(),
            Values::Counted(_) => self.scene.record.guarantee().to_string(),
        }
    }

    /// What values are, for a note beside a picture.
    fn exactness(&self) -> &'static str {
        match self.values {
            Values::Counted(_) => "exact for voxel centres",
            Values::Approximate(field) => field.exactness(),
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
