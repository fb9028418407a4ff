//! `imf demo`: mesh, voxels, sections, a field of every direction, evaluation and pictures in one go, nothing to configure.

mod factored;
mod siren;

use std::time::Instant;

use anyhow::Result;
use imf_core::mesh::topology::MeshReport;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::tool::Tool;
use imf_fields::file::FieldFile;

use crate::arguments::{DemoArguments, NetworkFamily};
use crate::commands::calibrate::calibrate_written;
use crate::commands::eval;
use crate::engine::Device;
use crate::interrupt;
use crate::job::FIELD;
use crate::output::{prepare_folder, print_result};
use crate::progress::show_seconds;
use crate::report::{EvaluationSettings, PAPER_THRESHOLD, Report, forget};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &DemoArguments) -> Result<()> {
    let begun = Instant::now();
    prepare_folder(&arguments.out)?;
    let report = match arguments.family {
        NetworkFamily::Factored => {
            let scene = teapot(session, ReferencePart::Teapot.dims())?;
            factored::run(session, arguments, &scene)?
        }
        NetworkFamily::Siren5 => {
            let scene = teapot(session, siren::DIMS)?;
            siren::run(session, arguments, &scene)?
        }
    };
    let words = format!(
        "\n{}\n\n{} holds field.safetensors, report.md, report.json and pictures; {} in all.",
        report.table(),
        arguments.out.display(),
        show_seconds(begun.elapsed().as_secs_f64())
    );
    print_result(session, &report, &words)
}

/// The paper's teapot and tool at a resolution.
fn teapot(session: &Session, dims: [usize; 3]) -> Result<Scene> {
    let part = ReferencePart::Teapot;
    let (mesh, tool) = (part.mesh(), Tool::paper());
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

/// Calibrates the field that was just written and compares it with the exact one: at 64 random directions that were
/// not used for training, by the IMF over `imf`, and in the section `in_sample` of the training, if one is given.
fn make_report(
    session: &Session,
    device: &Device,
    arguments: &DemoArguments,
    in_sample: Option<Orientation>,
    imf: OrientationSet,
) -> Result<Report> {
    let DemoArguments { out, seed, .. } = arguments;
    let settings = EvaluationSettings {
        in_sample,
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
    eval::make_report(session, device, &FieldFile::read(&path)?, &settings, Some(out))
}
