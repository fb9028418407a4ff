//! A factored field of a scene: a harmonic field of all functions of a degree, then the network that is taught it. As
//! `imf field --method harmonic` and `imf compress`; `imf demo` makes its field so too.

use anyhow::Result;
use imf_core::scene::Scene;
use imf_core::section::{At, SectionPlan};
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, Symmetry};
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_train::distill::SectionTeacher;

use crate::arguments::harmonic::DEFAULT_SECTIONS;
use crate::arguments::train::TrainArguments;
use crate::commands::compress::{self, Beginning, Extent, Lesson, Sections, Settings, Teacher};
use crate::commands::field::harmonic;
use crate::engine::Device;
use crate::output::{OutputFolder, claim};
use crate::session::Session;

/// A degree that leaves the teapot an error of a few millionths.
const DEGREE: usize = 16;
/// Of whole rotations: nearly as many functions, and so as much memory and time.
const DEGREE_OF_ROTATIONS: usize = 5;

pub(super) fn run(session: &Session, arguments: &TrainArguments, teach: DistillSettings) -> Result<()> {
    let device = Device::open(arguments.device_or("cpu"), session)?;
    let folder = OutputFolder::check(&arguments.out)?;
    let _before = claim(folder.path())?;
    let beginning = Beginning::at(folder.path(), arguments.resume)?;
    let symmetry = match teach.online {
        // Sections cannot tell of it.
        Some(_) => Some(Symmetry::default()),
        None => beginning.symmetry(arguments.factored.teaching.symmetry()),
    };
    let teach = DistillSettings {
        symmetry: symmetry.unwrap_or_default(),
        ..beginning.settled(arguments.length.rate, arguments.factored.teaching.optimiser(), teach)
    };
    beginning.require_settings(&teach)?;
    let scene = arguments.scene.scene_with(session, &arguments.contact)?;
    folder.create()?;
    let _claim = claim(folder.path())?;
    let settings = Settings {
        teach,
        precision: arguments.factored.teaching.precision(),
        checkpoint_every: arguments.length.checkpoint_every,
        go_on: "add --resume to go on",
        smaller: "use a lower --degree, a smaller --batch or --online, or a larger --pitch",
    };
    let degree = arguments.factored.degree;
    let asked = Asked { degree, find_symmetry: symmetry.is_none() };
    let taught = made(session, &device, &scene, asked, settings, &beginning)?;
    compress::concluded(session, folder.path(), taught, arguments.no_calibrate)
}

/// What the harmonic field decides.
pub(in crate::commands) struct Asked {
    /// Its degree; by default that of its kind of functions.
    pub(in crate::commands) degree: Option<usize>,
    /// The network is told of what symmetry the field has.
    pub(in crate::commands) find_symmetry: bool,
}

/// The field of a scene by harmonics of a degree, written to the folder, with the last loss. Where a teaching is resumed that
/// has steps left, the harmonic field is fitted, or the functions are chosen, once more. What cannot be is refused before.
pub(in crate::commands) fn made(
    session: &Session,
    device: &Device,
    scene: &Scene,
    Asked { degree, find_symmetry }: Asked,
    mut settings: Settings,
    beginning: &Beginning<'_>,
) -> Result<(FactoredFile, f64)> {
    let domain = harmonic::domain(&scene.record.bare_tool().with_tip_only());
    let usual = match domain {
        Domain::Directions => DEGREE,
        Domain::Rotations => DEGREE_OF_ROTATIONS,
    };
    let fit = FitSettings {
        degree: degree.unwrap_or(usual),
        axes: usize::MAX,
        precision: Precision::F32,
        sections_per_function: DEFAULT_SECTIONS,
        ..FitSettings::default()
    };
    beginning.require_teacher(scene, &fit)?;
    if let Some(file) = beginning.finished(session, settings.precision)? {
        return Ok((file, f64::NAN));
    }
    let voxels = scene.record.grid.len();
    let extent = match settings.teach.online {
        Some(_) => Extent::of_sections(fit, domain, voxels),
        None => Extent::of_field(fit, domain, voxels),
    };
    extent.require(session, &settings)?;
    let plan = SectionPlan::of_scene(scene, At::Tip)?;
    if settings.teach.online.is_some() {
        let teacher = functions_of(session, &plan, domain, &fit)?;
        let teacher = Teacher::Sections(Box::new(Sections { teacher, scene, fit }));
        return Lesson { teacher, settings, beginning }.taught(session, device, None);
    }
    let teacher = harmonic::fitted(session, scene, &plan, domain, fit, settings.smaller)?;
    drop(plan);
    if find_symmetry {
        settings.teach.symmetry = compress::symmetry_of(session, &teacher);
    }
    Lesson { teacher: Teacher::Harmonic(&teacher), settings, beginning }.taught(session, device, None)
}

/// The functions that sections teach along, chosen by a sample of voxels.
fn functions_of<'a>(
    session: &Session,
    plan: &'a SectionPlan,
    domain: Domain,
    fit: &FitSettings,
) -> Result<SectionTeacher<'a>> {
    let sections = fit.sizes(domain).sections + fit.held_out;
    let stage = session.stage("functions", "sections", sections as u64);
    let advance = |sections| stage.advance(sections);
    let teacher = SectionTeacher::new(plan, domain, fit, session.control(&advance));
    let teacher = teacher.map_err(|error| harmonic::interruption(error, "a choice of functions"))?;
    stage.finish("");
    Ok(teacher)
}
