//! scipy's real FFTs on the very same voxels, where Python has it.

use std::process::Command;

use anyhow::{Context, Result};
use imf_cli::output::write_json;
use imf_cli::session::Session;
use imf_core::field_files::write_npy;
use serde::Deserialize;

use super::{ExactArguments, Rival, Trial};
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

/// The rival, or why there is none and what would help.
pub(super) fn measure(
    session: &Session,
    arguments: &ExactArguments,
    trial: &Trial,
    ours: f64,
) -> Result<Result<Rival, String>> {
    // Megabytes to be deleted, whatever becomes of the run.
    let folder = tempfile::tempdir_in(&arguments.out).context("cannot make a temporary folder")?;
    let folder = folder.path();
    let array = |dims: [usize; 3], solid: &[u8], name: &str| -> Result<()> {
        Ok(write_npy(folder.join(name), dims, solid)?)
    };
    let dims = trial.obstacle.grid.dims;
    array(dims, &trial.obstacle.solid, "obstacle.npy")?;
    for (index, (tool, counts)) in trial.tools.iter().zip(&trial.counts).enumerate() {
        array(tool.dims, &tool.solid, &format!("tool_{index}.npy"))?;
        write_npy(folder.join(format!("counts_{index}.npy")), dims, counts.as_slice())?;
    }
    let lower: Vec<[i32; 3]> = trial.tools.iter().map(|tool| tool.lower).collect();
    let workers = session.threads();
    let scene = serde_json::json!({ "lower": lower, "reach": trial.reach, "workers": workers });
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
