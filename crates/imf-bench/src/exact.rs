//! `imf-bench exact`: the exact sections beside what one would write oneself, and how their cost grows.

mod growth;
mod scipy;

use std::f64::consts::PI;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use glam::DVec3;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::section::{SectionPlan, ToolPoints, imf, stream_sections};
use imf_core::tool::Tool;
use imf_core::voxelize::voxelize;
use serde::Serialize;

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::{Machine, ROUNDS, minimum_seconds};
use growth::Growth;

/// Exact sections against scipy, and how their cost grows
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench exact --out bench-exact\n\n\
                        Writes exact.json, exact.md and how time and memory grow as pictures. About a minute without --full.")]
pub(crate) struct ExactArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// All sizes up to 384³, all 225 sections of the rival, 10,000 orientations
    #[arg(long)]
    full: bool,
    /// Python with numpy and scipy
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    python: String,
}

/// Orientations of the comparison.
pub(crate) const SECTIONS: usize = 225;
/// Sections of the rival without `--full`; its time does not depend on the orientation.
const RIVAL_SECTIONS: usize = 12;

/// One way to compute sections.
#[derive(Serialize)]
pub(crate) struct Rival {
    pub(crate) name: String,
    pub(crate) sections: usize,
    pub(crate) milliseconds_per_section: f64,
    /// Its time divided by ours.
    pub(crate) ratio: f64,
    /// Whether its whole numbers are ours; it is not compared of ourselves.
    pub(crate) equal: Option<bool>,
    pub(crate) how: String,
}

/// What is measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    method: String,
    /// Seconds for all sections, and for their minimum over orientations.
    sections_seconds: f64,
    imf_seconds: f64,
    rivals: Vec<Rival>,
    /// Why a rival is missing.
    missing: Vec<String>,
    sphere_voxels_milliseconds: f64,
    growth: Growth,
}

pub(crate) fn run(session: &Session, arguments: &ExactArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(session.threads());
    session.note("voxelising the teapot");
    let (scene, tool) = (reference_scene(ReferencePart::Teapot, 1.0)?, Tool::paper());
    let plan = SectionPlan::new(&scene.obstacle, &tool, ToolPoints::SharpPoints)?;
    let orientations = OrientationSet::parse(&format!("fibonacci:{SECTIONS}"))?.orientations;
    session.note(&format!("sections: {}", plan.describe()));
    let control = session.control(&|_| {});
    let [sections_seconds, imf_seconds] = minimum_seconds(
        ROUNDS,
        [
            &mut || Ok(stream_sections(&plan, &orientations, control, || (), |(), _, _| {}).map(drop)?),
            &mut || Ok(imf(&plan, &orientations, control).map(drop)?),
        ],
    )?;
    let ours = sections_seconds / SECTIONS as f64;

    // First what shows the memory that sections take: the rival's counts would hide it.
    let growth = growth::measure(session, arguments)?;
    // Evenly spaced orientations of the set, so that all directions are represented.
    let step = if arguments.full { 1 } else { SECTIONS / RIVAL_SECTIONS };
    let compared: Vec<Orientation> = orientations.iter().copied().step_by(step).collect();
    let mut rivals = vec![Rival {
        name: "imf".into(),
        sections: SECTIONS,
        milliseconds_per_section: ours * 1e3,
        ratio: 1.0,
        equal: None,
        how: plan.describe(),
    }];
    let mut missing = Vec::new();
    session.note("scipy");
    match scipy::measure(session, arguments, &plan, &compared, ours)? {
        Ok(rival) => rivals.push(rival),
        Err(advice) => missing.push(advice),
    }
    let sphere_voxels_milliseconds = 1e3 * voxels_of_a_sphere()?;
    machine.finish();
    let [x, y, z] = scene.record.grid.dims;
    let report = Report {
        machine,
        scene: format!("teapot {x}×{y}×{z}, tool paper (29×29×83 voxels), fibonacci:{SECTIONS}"),
        method: plan.describe(),
        sections_seconds,
        imf_seconds,
        rivals,
        missing,
        sphere_voxels_milliseconds,
        growth,
    };
    let document = report.document();
    document.write(&arguments.out, "exact", &report)?;
    for (name, chart) in report.growth.charts() {
        chart.save(&arguments.out.join(name))?;
    }
    document.show(session, &report)
}

/// The unit sphere with 40 meridians and 17 bands: 1,280 triangles with shared vertices.
fn sphere() -> Mesh {
    let outline: Vec<[f64; 2]> = (0..=17)
        .map(|band| {
            let height = -(PI * f64::from(band) / 17.0).cos();
            [height, (1.0 - height * height).sqrt()]
        })
        .collect();
    Mesh::revolved(&outline, 40)
}

/// Seconds for the voxels of a sphere of 1,280 triangles on 128³.
fn voxels_of_a_sphere() -> Result<f64> {
    let mesh = sphere();
    let grid = Grid { origin: DVec3::splat(-1.01), pitch: 2.02 / 128.0, dims: [128; 3] };
    let [seconds] = minimum_seconds(
        2 * ROUNDS,
        [&mut || {
            ensure!(voxelize(&mesh, &grid, false).count() > 0, "a sphere has an inside");
            Ok(())
        }],
    )?;
    Ok(seconds)
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("Exact sections");
        document.paragraph(format!("{}\n{}", self.scene, self.machine));
        document.paragraph(format!(
            "{SECTIONS} sections {:.2} s, IMF {:.2} s, by {}",
            self.sections_seconds, self.imf_seconds, self.method
        ));
        let rows = self.rivals.iter().map(|rival| {
            vec![
                rival.name.clone(),
                format!("{:.2}", rival.milliseconds_per_section),
                format!("{:.1}", rival.ratio),
                rival.equal.map_or("", |equal| if equal { "yes" } else { "NO" }).into(),
                rival.how.clone(),
            ]
        });
        document.table(&["", "ms a section", "times ours", "same counts", "how"], rows.collect());
        self.missing.iter().for_each(|advice| document.paragraph(advice));
        document.paragraph(format!(
            "Voxels of a sphere of 1,280 triangles on 128³: {:.1} ms",
            self.sphere_voxels_milliseconds
        ));
        self.growth.describe(&mut document);
        document
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_closed_round_and_faces_outwards() {
        let mesh = sphere();
        assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (1280, 642));
        assert!((mesh.signed_volume() / (4.0 / 3.0 * PI) - 1.0).abs() < 0.02);
    }
}
