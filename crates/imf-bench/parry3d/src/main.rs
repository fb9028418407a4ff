//! A rival of `imf-bench query`: does the tool's mesh meet the part's, and how far are they apart, by parry3d on one core.
//!
//! Reads the scene.json that `crates/imf-bench/python/query_rivals.py` reads, in the folder given, and prints the same line of JSON: a list of
//! `{name, question, seconds, overhead, colliding, how}`. `seconds` is the best of three rounds over the poses asked, batch by batch; `colliding` has
//! an answer for each of them. Nothing is lost to a call, so `overhead` is 0. Distances take so long that one
//! pose in ten is asked.

use std::error::Error;
use std::time::Instant;

use parry3d::math::{Pose, Rotation, Vector};
use parry3d::query::{distance, intersection_test};
use parry3d::shape::TriMesh;
use serde_json::{Value, json};

const ROUNDS: usize = 3;
const FEWER: usize = 10;
const BATCH: usize = 20;

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let list: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    list.try_into().ok()
}

fn mesh(value: &Value) -> Result<TriMesh, Box<dyn Error>> {
    let list = |name: &str| value[name].as_array().ok_or(format!("a mesh has no {name}"));
    let vertex = |v: &Value| numbers::<3>(v).map(|[x, y, z]| Vector::new(x as f32, y as f32, z as f32));
    let vertices: Option<Vec<Vector>> = list("vertices")?.iter().map(vertex).collect();
    let triangle = |t: &Value| numbers::<3>(t).map(|corners| corners.map(|c| c as u32));
    let triangles: Option<Vec<[u32; 3]>> = list("triangles")?.iter().map(triangle).collect();
    Ok(TriMesh::new(vertices.ok_or("not a vertex")?, triangles.ok_or("not a triangle")?)?)
}

fn pose(value: &Value) -> Option<Pose> {
    let [x, y, z, a, b, c, d] = numbers::<7>(value)?.map(|v| v as f32);
    Some(Pose::from_parts(Vector::new(x, y, z), Rotation::from_xyzw(a, b, c, d).normalize()))
}

/// The answers, and the seconds: the sum over batches of the least of some rounds, so that a busy machine disturbs few.
fn best<T>(poses: &[Pose], ask: impl Fn(&Pose) -> T) -> (f64, Vec<T>) {
    let (mut seconds, mut answers) = (0.0, Vec::new());
    for batch in poses.chunks(BATCH) {
        let mut least = f64::INFINITY;
        let mut found = Vec::new();
        for _ in 0..ROUNDS {
            let begun = Instant::now();
            found = batch.iter().map(&ask).collect();
            least = least.min(begun.elapsed().as_secs_f64());
        }
        seconds += least;
        answers.append(&mut found);
    }
    (seconds, answers)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder of scene.json")?;
    let scene: Value = serde_json::from_slice(&std::fs::read(format!("{folder}/scene.json"))?)?;
    let (part, tool, still) = (mesh(&scene["part"])?, mesh(&scene["tool"])?, Pose::identity());
    let poses: Option<Vec<Pose>> = scene["poses"].as_array().ok_or("no poses")?.iter().map(pose).collect();
    let poses = poses.ok_or("a pose is not seven numbers")?;
    let [of_part, of_tool] = [&part, &tool].map(|mesh| mesh.indices().len());
    let how = format!("parry3d 0.31.1, TriMesh, meshes of {of_part} and {of_tool} triangles");
    let (seconds, answers) =
        best(&poses, |pose| intersection_test(&still, &part, pose, &tool).map(|found| found.intersecting));
    let colliding = answers.into_iter().collect::<Result<Vec<bool>, _>>()?;
    let few = &poses[..poses.len().div_ceil(FEWER)];
    let (apart, answers) =
        best(few, |pose| distance(&still, &part, pose, &tool).map(|found| found.distance <= 0.0));
    let touching = answers.into_iter().collect::<Result<Vec<bool>, _>>()?;
    let entry = |question: &str, seconds: f64, colliding: &[bool]| {
        json!({
            "name": "parry3d", "question": question, "seconds": seconds, "overhead": 0.0, "colliding": colliding, "how": how,
        })
    };
    let found = [entry("surfaces", seconds, &colliding), entry("distance", apart, &touching)];
    println!("{}", json!({ "found": found, "missing": [] }));
    Ok(())
}
