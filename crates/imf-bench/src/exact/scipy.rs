//! scipy's real FFTs on the very same voxels, where Python has it.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result};
use imf_cli::output::write_json;
use imf_cli::session::Session;
use imf_core::field_files::write_npy;
use ndarray::ArrayView3;
use serde::Deserialize;

use super::{Rival, Trial};
use crate::arguments::ExactArguments;
use crate::python::lacks;

const SCRIPT: &str = include_str!("../../python/exact_scipy.py");
const REQUIREMENTS: &str =
    "python3 -m pip install numpy==2.4.6 scipy==1.17.1 (crates/imf-bench/python/requirements.txt)";

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
    let python = &arguments.python;
    if let Some(why) = lacks(python, "import numpy, scipy.fft", REQUIREMENTS) {
        return Ok(Err(format!("scipy was not compared: {why}")));
    }
    // Megabytes that nobody wants to keep, whatever becomes of the run.
    let folder = tempfile::tempdir_in(&arguments.out).context("cannot make a temporary folder")?;
    let answer = run(python, folder.path(), session.threads(), trial)?;
    let each = answer.seconds.iter().sum::<f64>() / answer.seconds.len().max(1) as f64;
    let [x, y, z] = answer.size;
    Ok(Ok(Rival {
        name: "scipy".into(),
        sections: answer.seconds.len(),
        milliseconds_per_section: each * 1e3,
        ratio: each / ours,
        equal: Some(answer.equal),
        how: format!("rfftn/irfftn f32, {x}×{y}×{z}, workers={}, {}", session.threads(), answer.versions),
    }))
}

fn run(python: &str, folder: &Path, workers: usize, trial: &Trial) -> Result<Answer> {
    let array = |dims: [usize; 3], solid: &[u8], name: &str| -> Result<()> {
        Ok(write_npy(folder.join(name), ArrayView3::from_shape(dims, solid)?)?)
    };
    let dims = trial.obstacle.grid.dims;
    array(dims, &trial.obstacle.solid, "obstacle.npy")?;
    for (index, (tool, counts)) in trial.tools.iter().zip(&trial.counts).enumerate() {
        array(tool.dims, &tool.solid, &format!("tool_{index}.npy"))?;
        write_npy(
            folder.join(format!("counts_{index}.npy")),
            ArrayView3::from_shape(dims, counts.as_slice())?,
        )?;
    }
    let lower: Vec<[i32; 3]> = trial.tools.iter().map(|tool| tool.lower).collect();
    let scene = serde_json::json!({ "lower": lower, "reach": trial.reach, "workers": workers });
    write_json(&folder.join("scene.json"), &scene)?;
    let script = folder.join("exact_scipy.py");
    std::fs::write(&script, SCRIPT)?;
    let output = Command::new(python)
        .arg(&script)
        .arg(folder)
        .output()
        .with_context(|| format!("cannot start {python}"))?;
    anyhow::ensure!(
        output.status.success(),
        "the comparison with scipy failed: {}",
        String::from_utf8_lossy(&output.stderr).trim()
    );
    serde_json::from_slice(&output.stdout).context("the comparison with scipy answered no JSON")
}
