//! Collision libraries on meshes of the same part and tool, where they are installed.

use std::process::Command;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use imf_cli::output::write_json;
use imf_core::field::Decision;
use imf_core::mesh::Mesh;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::SceneRecord;
use serde::Deserialize;
use serde_json::json;

use super::Row;
use crate::arguments::query::QueryArguments;
use crate::revolved::tool_mesh;
use crate::rivals;

const SCRIPT: &str = include_str!("../../python/query_rivals.py");
const INSTALL: &str = "Install: python3 -m pip install -r crates/imf-bench/python/requirements-query.txt";
const BUILD: &str = "Build: cargo build --release --manifest-path crates/imf-bench/parry3d/Cargo.toml, or name it by --parry3d";

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

/// The meshes of a scene's part, where it is built in, and of its tool.
pub(super) fn meshes(record: &SceneRecord) -> Option<[Mesh; 2]> {
    let part = ReferencePart::from_str(&record.part).ok()?;
    Some([part.mesh().transformed(&record.transform), tool_mesh(record.bare_tool())])
}

/// The libraries' rows, and why others are missing.
pub(super) fn measure(
    arguments: &QueryArguments,
    [part, tool]: [&Mesh; 2],
    poses: &[Pose],
    truth: &[Decision],
) -> Result<(Vec<Row>, Vec<String>)> {
    // Megabytes that nobody wants to keep, whatever becomes of the run.
    let folder = tempfile::tempdir_in(&arguments.out).context("cannot make a temporary folder")?;
    let folder = folder.path();
    let listed = |mesh: &Mesh| {
        let vertices: Vec<[f64; 3]> = mesh.vertices.iter().map(glam::DVec3::to_array).collect();
        json!({ "vertices": vertices, "triangles": mesh.triangles })
    };
    let asked: Vec<[f64; 7]> = poses
        .iter()
        .map(|pose| {
            let ([x, y, z], [a, b, c, d]) = (pose.position.to_array(), pose.rotation.to_array());
            [x, y, z, a, b, c, d]
        })
        .collect();
    let scene = json!({ "part": listed(part), "tool": listed(tool), "poses": asked });
    write_json(&folder.join("scene.json"), &scene)?;
    let (mut rows, mut missing) = (Vec::new(), Vec::new());
    let mut python = Command::new(&arguments.python);
    python.args(["-c", SCRIPT]).arg(folder);
    let mut parry3d = Command::new(&arguments.parry3d);
    parry3d.arg(folder);
    for (who, command, remedy) in [("Coal and FCL", python, INSTALL), ("parry3d", parry3d, BUILD)] {
        match rivals::ask::<Answer>(who, &mut { command }, remedy) {
            Ok(answer) => {
                missing.extend(answer.missing.iter().map(|reason| format!("{reason}. {remedy}")));
                for found in answer.found {
                    rows.push(row(found, truth, [part, tool])?);
                }
            }
            Err(why) => missing.push(why),
        }
    }
    Ok((rows, missing))
}

/// What a library's answers come to; it may have answered the first of the poses alone.
fn row(found: Found, truth: &[Decision], [part, tool]: [&Mesh; 2]) -> Result<Row> {
    let count = found.colliding.len();
    ensure!((1..=truth.len()).contains(&count), "{} answered {count} poses", found.name);
    let colliding = found.colliding.iter().filter(|&&c| c).count() as f64 / count as f64;
    let same = |(c, t): &(&bool, &Decision)| **c == (**t == Decision::Colliding);
    let agree = found.colliding.iter().zip(truth).filter(same).count() as f64 / count as f64;
    let distance = found.name.ends_with("distance");
    Ok(Row {
        answers: if distance { "distance of the surfaces" } else { "do the surfaces meet" }.into(),
        poses: count,
        // What the call from Python costs is not the library's.
        poses_per_second: count as f64 / (found.seconds - found.overhead).max(f64::MIN_POSITIVE),
        free: Some(1.0 - colliding),
        colliding: Some(colliding),
        agree: Some(agree),
        how: format!(
            "{}, meshes of {} and {} triangles; {:.1} µs a call left out",
            found.how,
            part.triangles.len(),
            tool.triangles.len(),
            found.overhead / count as f64 * 1e6
        ),
        name: found.name,
    })
}
