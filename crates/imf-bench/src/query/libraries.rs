//! Collision libraries at the same poses, where they are installed: on meshes of the same part and tool, or with the tool as balls
//! among the solid voxels' centres.

use std::process::Command;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use imf_cli::output::{write_json, write_text};
use imf_core::field::Decision;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::tool::{Segment, Tool, ToolShape};
use serde::Deserialize;
use serde_json::json;

use super::{QueryArguments, Row};
use crate::rivals;

const SCRIPT: &str = include_str!("../../python/query_rivals.py");
/// Compiled by the script, with the headers that the package installs.
const VAMP: &str = include_str!("../../python/vamp_rival.cc");
const INSTALL: &str = "Install: python3 -m pip install -r crates/imf-bench/python/requirements-query.txt; and vamp-planner==0.6.4 by \
                       itself, which is compiled";
const BUILD: &str = "Build: cargo build --release --manifest-path crates/imf-bench/parry3d/Cargo.toml, or name it by --parry3d";

/// Longest stretch of the axis in a ball, in radii of the tool there.
const STRETCH: f64 = 0.8;
/// Sampled heights of a stretch, and steps to the middle of its ball.
const STEPS: u32 = 16;
const THIRDS: u32 = 60;
/// Sides of the tool as a mesh.
const SIDES: usize = 48;

#[derive(Deserialize)]
struct Answer {
    found: Vec<LibraryResult>,
    missing: Vec<String>,
}

#[derive(Deserialize)]
struct LibraryResult {
    name: String,
    question: QueryKind,
    seconds: f64,
    overhead: f64,
    colliding: Vec<bool>,
    how: String,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum QueryKind {
    Surfaces,
    Distance,
    Balls,
}

impl QueryKind {
    fn answers(self) -> &'static str {
        match self {
            Self::Surfaces => "do the surfaces meet",
            Self::Distance => "distance of the surfaces",
            Self::Balls => "is a centre in balls around the tool",
        }
    }
}

/// The libraries' rows, and why others are missing.
pub(super) fn measure(
    arguments: &QueryArguments,
    scene: &Scene,
    poses: &[Pose],
    truth: &[Decision],
) -> Result<(Vec<Row>, Vec<String>)> {
    let Ok(part) = ReferencePart::from_str(&scene.record.part) else {
        return Ok((Vec::new(), vec!["the libraries need a built-in part, whose mesh is at hand".into()]));
    };
    let part = part.mesh().transformed(&scene.record.transform);
    let tool = scene.record.bare_tool();
    // Megabytes to be deleted, whatever becomes of the run.
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
    let Occupancy { grid, solid } = &scene.obstacle;
    let voxels = (0..solid.len()).filter(|&index| solid[index] != 0);
    let centres: Vec<[f64; 3]> = voxels.map(|index| grid.centre(grid.voxel(index)).to_array()).collect();
    let scene = json!({
        "part": listed(&part),
        "tool": listed(&tool.surface(SIDES)),
        "centres": centres,
        "balls": balls(tool),
        "poses": asked,
    });
    write_json(&folder.join("scene.json"), &scene)?;
    write_text(&folder.join("vamp_rival.cc"), VAMP)?;
    let (mut rows, mut missing) = (Vec::new(), Vec::new());
    let mut python = Command::new(&arguments.python);
    python.args(["-c", SCRIPT]).arg(folder);
    let mut parry3d = Command::new(&arguments.parry3d);
    parry3d.arg(folder);
    for (who, command, remedy) in [("Coal, FCL and vamp", python, INSTALL), ("parry3d", parry3d, BUILD)] {
        match rivals::ask::<Answer>(who, &mut { command }, remedy) {
            Ok(answer) => {
                missing.extend(answer.missing.iter().map(|reason| format!("{reason}. {remedy}")));
                for found in answer.found {
                    rows.push(row(found, truth)?);
                }
            }
            Err(why) => missing.push(why),
        }
    }
    Ok((rows, missing))
}

/// Summary of a library's results; it may have evaluated the first poses only.
fn row(found: LibraryResult, truth: &[Decision]) -> Result<Row> {
    let count = found.colliding.len();
    ensure!((1..=truth.len()).contains(&count), "{} answered {count} poses", found.name);
    let colliding = found.colliding.iter().filter(|&&c| c).count() as f64 / count as f64;
    let differ = |called: bool| {
        let pairs = found.colliding.iter().zip(truth);
        pairs.filter(|&(&c, &t)| c == called && c != (t == Decision::Colliding)).count()
    };
    let (missed, invented) = (differ(false), differ(true));
    Ok(Row {
        name: found.name,
        answers: found.question.answers().into(),
        poses: count,
        batch: 1,
        // What the call from Python costs is not the library's.
        poses_per_second: count as f64 / (found.seconds - found.overhead).max(f64::MIN_POSITIVE),
        free: Some(1.0 - colliding),
        colliding: Some(colliding),
        agree: Some(1.0 - (missed + invented) as f64 / count as f64),
        how: format!(
            "{}; {missed} colliding poses called free, {invented} free ones colliding; {:.1} µs a call left out",
            found.how,
            found.overhead / count as f64 * 1e6
        ),
    })
}

/// Balls that together hold a tool of revolution, heights of their middles and radii: the smallest around every short stretch of
/// its axis. None of a mesh tool.
fn balls(tool: &Tool) -> Vec<[f64; 2]> {
    let ToolShape::Revolved(elements) = &tool.shape else { return Vec::new() };
    let mut balls = Vec::new();
    for segment in elements.iter().flat_map(|element| &element.profile) {
        let (low, high) = segment.range();
        // One ball is a ball end.
        let pieces = match segment {
            Segment::Line { .. } => ((high - low) / (STRETCH * segment.max_radius())).ceil(),
            Segment::Arc { .. } => 1.0,
        };
        for piece in 0..pieces as u32 {
            let at = |part: f64| low + (high - low) * (f64::from(piece) + part) / pieces;
            let radius = |middle: f64| {
                let heights = (0..=STEPS).map(|step| at(f64::from(step) / f64::from(STEPS)));
                heights.map(|h| (h - middle).hypot(segment.radius(h))).fold(0.0, f64::max)
            };
            // The radius is convex in the height of the middle.
            let (mut from, mut to) = (at(0.0), at(1.0));
            for _ in 0..THIRDS {
                let third = (to - from) / 3.0;
                if radius(from + third) < radius(to - third) { to -= third } else { from += third }
            }
            balls.push([to, radius(to)]);
        }
    }
    balls
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_balls_hold_the_tool_and_little_more() {
        let tool = Tool::paper();
        let ToolShape::Revolved(elements) = &tool.shape else { panic!("not revolved") };
        let balls = balls(&tool);
        for segment in elements.iter().flat_map(|element| &element.profile) {
            let (low, high) = segment.range();
            for height in (0..=1000).map(|step| low + (high - low) * f64::from(step) / 1000.0) {
                let radius = segment.radius(height);
                let holds = |&[middle, r]: &[f64; 2]| (height - middle).hypot(radius) <= r + 1e-6;
                assert!(balls.iter().any(holds), "{height}");
            }
        }
        // The ball end is a ball, and no ball is much wider than the tool.
        assert!(balls.iter().all(|&[_, radius]| radius < 1.1 * 14.5), "{balls:?}");
        assert!(balls.iter().all(|[middle, radius]| middle - radius > -1e-6), "{balls:?}");
    }
}
