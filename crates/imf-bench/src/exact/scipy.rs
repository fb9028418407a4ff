//! scipy's real FFTs on the very same voxels, where Python has it.

use std::process::Command;

use anyhow::{Context, Result};
use imf_cli::output::write_json;
use imf_cli::session::Session;
use imf_core::field_files::write_npy;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionPlan, SectionScratch};
use imf_core::tool::ToolVoxels;
use serde::Deserialize;

use super::{ExactArguments, Rival};
use crate::rivals;

const SCRIPT: &str = include_str!("../../python/exact_scipy.py");
const REQUIREMENTS: &str = "Install: python3 -m pip install -r crates/imf-bench/python/requirements.txt, or name another by --python";

#[derive(Deserialize)]
struct Answer {
    seconds: Vec<f64>,
    equal: bool,
    size: [usize; 3],
    versions: String,
}

/// The rival, or why there is none and what would help. It is given the voxels of obstacle and tools, and what we counted.
pub(super) fn measure(
    session: &Session,
    arguments: &ExactArguments,
    plan: &SectionPlan,
    orientations: &[Orientation],
    ours: f64,
) -> Result<Result<Rival, String>> {
    // Megabytes to be deleted, whatever becomes of the run.
    let folder = tempfile::tempdir_in(&arguments.out).context("cannot make a temporary folder")?;
    let folder = folder.path();
    let grid = plan.grid();
    write_npy(folder.join("obstacle.npy"), grid.dims, plan.obstacle().forbidden.solid.as_slice())?;
    let (mut lower, mut scratch) = (Vec::new(), SectionScratch::default());
    for (index, orientation) in orientations.iter().enumerate() {
        let (_, counts) = plan.counts_in(orientation, grid, &mut scratch)?;
        write_npy(folder.join(format!("counts_{index}.npy")), grid.dims, counts)?;
        let tool = ToolVoxels::new(plan.tool(), orientation, grid.pitch)?;
        write_npy(folder.join(format!("tool_{index}.npy")), tool.dims, tool.solid.as_slice())?;
        lower.push(tool.lower);
    }
    let workers = session.threads();
    let reach = (plan.tool().reach() / grid.pitch).ceil() as usize;
    let scene = serde_json::json!({ "lower": lower, "reach": reach, "workers": workers });
    write_json(&folder.join("scene.json"), &scene)?;
    let mut command = Command::new(&arguments.python);
    let answer = rivals::ask("scipy", command.args(["-c", SCRIPT]).arg(folder), REQUIREMENTS);
    Ok(answer.map(|Answer { seconds, equal, size: [x, y, z], versions }| {
        let each = seconds.iter().sum::<f64>() / seconds.len().max(1) as f64;
        Rival {
            name: "scipy".into(),
            sections: seconds.len(),
            milliseconds_per_section: each * 1e3,
            ratio: each / ours,
            equal: Some(equal),
            how: format!("rfftn/irfftn f32, {x}×{y}×{z}, workers={workers}, {versions}"),
        }
    }))
}
