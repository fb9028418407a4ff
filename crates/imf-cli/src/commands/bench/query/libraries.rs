//! Collision libraries on meshes of the same part and tool, where Python has them.

use std::process::Command;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use imf_core::mesh::Mesh;
use imf_core::parts::ReferencePart;
use imf_core::planner::{Decision, Pose};
use imf_core::scene::Scene;
use serde::Deserialize;
use serde_json::json;

use super::{Row, turned};
use crate::arguments::query_bench::QueryBenchArguments;
use crate::output::write_json;
use crate::session::Session;

const SCRIPT: &str = include_str!("../../../../../../bench/query_rivals.py");
const REQUIREMENTS: &str = "python3 -m pip install -r bench/requirements-query.txt";

#[derive(Deserialize)]
struct Answer {
    found: Vec<Found>,
    missing: Vec<String>,
}

#[derive(Deserialize)]
struct Found {
    name: String,
    seconds: f64,
    overhead: f64,
    colliding: Vec<bool>,
    how: String,
}

/// The libraries' rows, and why others are missing.
pub(super) fn measure(
    session: &Session,
    arguments: &QueryBenchArguments,
    scene: &Scene,
    poses: &[Pose],
    truth: &[Decision],
) -> Result<(Vec<Row>, Vec<String>)> {
    let record = &scene.record;
    let Ok(part) = ReferencePart::from_str(&record.part) else {
        return Ok((Vec::new(), vec!["the libraries need a built-in part, whose mesh is at hand".into()]));
    };
    session.note("Coal and FCL");
    let python = &arguments.python;
    let folder = arguments.out.join("query-meshes");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let part = part.mesh().transformed(&record.transform);
    let tool = turned::mesh(record.bare_tool());
    let listed = |mesh: &Mesh| {
        let vertices: Vec<[f64; 3]> = mesh.vertices.iter().map(glam::DVec3::to_array).collect();
        json!({ "vertices": vertices, "triangles": mesh.triangles })
    };
    let asked: Vec<[f32; 7]> = poses
        .iter()
        .map(|pose| {
            let ([x, y, z], [a, b, c, d]) = (pose.position.to_array(), pose.rotation.to_array());
            [x, y, z, a, b, c, d]
        })
        .collect();
    let scene = json!({ "part": listed(&part), "tool": listed(&tool), "poses": asked });
    write_json(&folder.join("scene.json"), &scene)?;
    let script = folder.join("query_rivals.py");
    std::fs::write(&script, SCRIPT)?;
    let output = Command::new(python).arg(&script).arg(&folder).output();
    // Megabytes that nobody wants to keep, whatever became of the run.
    let _ = std::fs::remove_dir_all(&folder);
    let output = match output {
        Ok(output) if output.status.success() => output,
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr);
            let last = said.trim().lines().last().unwrap_or_default().to_owned();
            return Ok((
                Vec::new(),
                vec![format!("Coal and FCL were not asked: {last}. Install: {REQUIREMENTS}")],
            ));
        }
        Err(error) => {
            return Ok((Vec::new(), vec![format!("Coal and FCL were not asked: {python}: {error}")]));
        }
    };
    let answer: Answer = serde_json::from_slice(&output.stdout).context("the libraries answered no JSON")?;
    let row = |found: Found| {
        ensure!(found.colliding.len() == poses.len(), "{} did not answer every pose", found.name);
        let blocked = found.colliding.iter().filter(|&&c| c).count() as f64 / poses.len() as f64;
        let same = |(c, t): &(&bool, &Decision)| **c == (**t == Decision::Blocked);
        let agree = found.colliding.iter().zip(truth).filter(same).count() as f64 / poses.len() as f64;
        let distance = found.name.ends_with("distance");
        Ok(Row {
            answers: if distance { "distance of the surfaces" } else { "do the surfaces meet" },
            poses: poses.len(),
            // What the call from Python costs is not the library's.
            poses_per_second: poses.len() as f64 / (found.seconds - found.overhead).max(f64::MIN_POSITIVE),
            free: Some(1.0 - blocked),
            blocked: Some(blocked),
            agree: Some(agree),
            how: format!(
                "{}, meshes of {} and {} triangles; {:.1} µs a call for Python left out",
                found.how,
                part.triangles.len(),
                tool.triangles.len(),
                found.overhead / poses.len() as f64 * 1e6
            ),
            name: found.name,
        })
    };
    let rows = answer.found.into_iter().map(row).collect::<Result<_>>()?;
    let advice = |m: &String| format!("{m}. Install: {REQUIREMENTS}");
    Ok((rows, answer.missing.iter().map(advice).collect()))
}
