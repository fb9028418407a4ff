//! `imf demo`: mesh, voxels, sections, a field of every direction, evaluation and pictures in one go, nothing to configure.

use std::time::Instant;

use anyhow::Result;
use imf_core::mesh::topology::MeshReport;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::tool::Tool;
use imf_fields::factored::DistillSettings;
use imf_fields::factored::file::FactoredFile;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::recipe::{TrainingLength, TrainingPlan};

use crate::arguments::DemoArguments;
use crate::commands::calibrate::calibrate_written;
use crate::commands::eval;
use crate::commands::eval::IMF_ORIENTATIONS;
use crate::commands::train::factored::{beside, of_scene};
use crate::engine::Device;
use crate::interrupt;
use crate::job::{self, Distillation, FIELD, FactoredStart};
use crate::output::{OutputFolder, lock_folder, print_written};
use crate::progress::show_seconds;
use crate::report::{EvaluationSettings, PAPER_THRESHOLD, Report, forget};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &DemoArguments) -> Result<()> {
    let begun = Instant::now();
    let folder = OutputFolder::check(&arguments.out)?;
    folder.create()?;
    let (report, written) = report(session, arguments, &folder, &teapot(session)?)?;
    let mut words = format!("\n{}\n", report.table());
    if written.is_ok() {
        words += &format!(
            "\n{} holds field.safetensors, report.md, report.json and pictures; {} in all.",
            arguments.out.display(),
            show_seconds(begun.elapsed().as_secs_f64())
        );
    }
    print_written(session, &report, &words, written)
}

/// The paper's teapot and tool.
fn teapot(session: &Session) -> Result<Scene> {
    let part = ReferencePart::Teapot;
    let (dims, mesh, tool) = (part.dims(), part.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(part, &mesh, dims, &tool).scene()?;
    let [x, y, z] = dims;
    session.note(&format!(
        "teapot: {} triangles, {x}×{y}×{z} voxels of {:.1} mm, {} solid; tool: {}",
        MeshReport::new(&mesh).triangles,
        scene.record.grid.pitch,
        scene.obstacle.count(),
        tool.name
    ));
    Ok(scene)
}

/// Seconds between checkpoints.
const CHECKPOINT_EVERY: f64 = 30.0;

/// A harmonic field of the full teapot from a few hundred exact sections, then the network of a megabyte that is distilled from it: as
/// `imf train` and `imf eval`.
fn report(
    session: &Session,
    arguments: &DemoArguments,
    folder: &OutputFolder,
    scene: &Scene,
) -> Result<(Report, Result<()>)> {
    let device = Device::open(&arguments.device.device, session)?;
    let _lock = lock_folder(&arguments.out)?;
    let start = FactoredStart::at(&arguments.out, job::is_unfinished::<FactoredFile>(&arguments.out))?;
    let defaults = DistillSettings::of_length(TrainingLength::Steps(arguments.steps));
    let defaults = start.resolve_settings(None, None, defaults);
    let symmetry = start.symmetry(true);
    let settings = DistillSettings {
        plan: TrainingPlan { seed: arguments.seed, ..defaults.plan },
        symmetry: symmetry.unwrap_or_default(),
        ..defaults
    };
    start.require_settings(&settings)?;
    let distillation = Distillation {
        settings,
        find_symmetry: symmetry.is_none(),
        precision: StoragePrecision::F32,
        beside: beside(CHECKPOINT_EVERY, "run the same command again"),
        smaller: "raise --memory",
        start: &start,
    };
    let (file, _) = of_scene(session, &device, distillation, scene, (Quantity::Overlap, None), None)?;

    let imf = file.field.basis.even_set(IMF_ORIENTATIONS)?;
    drop(file);
    make_report(session, &device, arguments, folder, imf)
}

/// Calibrates the field that was just written and compares it with the exact one: at 64 random directions that were
/// not used for training, and by the IMF over `imf`.
fn make_report(
    session: &Session,
    device: &Device,
    arguments: &DemoArguments,
    folder: &OutputFolder,
    imf: OrientationSet,
) -> Result<(Report, Result<()>)> {
    let DemoArguments { out, seed, .. } = arguments;
    let settings = EvaluationSettings {
        in_sample: None,
        out_of_sample: Some(Orientation::new(12.0, 6.0)),
        random: OrientationSet::parse(&format!("random:64:{}", seed.wrapping_add(1)))?,
        imf,
        // For fractions of the tool, as the paper compares; the verdict beside the table goes by the calibrated one.
        threshold: Some(PAPER_THRESHOLD),
    };
    let path = out.join(FIELD);
    forget(out);
    calibrate_written(session, &path, true)?;
    interrupt::leave(
        format!("{} is written and calibrated; imf eval makes its report", path.display()).into(),
    );
    eval::make_report(session, device, &FieldFile::read(&path)?, &settings, Some(folder))
}
