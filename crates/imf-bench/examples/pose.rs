//! Measures exact answers for single poses on one core: uniformly random positions in the part's box, uniformly random
//! directions, the paper's tool.
//!
//! `cargo run --release -p imf-bench --example pose [part [poses]]`

use std::time::Instant;

use glam::DVec3;
use imf_core::field::ExactField;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::tool::Tool;

/// Each figure is the best of this many rounds.
const ROUNDS: usize = 5;
/// Poses measured at a time.
const BATCH: usize = 500;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let part = arguments.next().map_or(ReferencePart::Teapot, |name| name.parse().expect("a reference part"));
    let poses = arguments.next().map_or(100_000, |n| n.parse().expect("a number of poses"));
    let scene = scene(part);
    let poses = random_poses(&scene, poses);
    let begun = Instant::now();
    let field = ExactField::new(&scene.obstacle, &scene.record.tool);
    let made = begun.elapsed();
    let first = field.collides(&poses[0]);
    println!(
        "imf-core {}: {part} {:?}, {} poses on one core; made in {:.1} ms, first answer ({first}) after {:.1} ms",
        env!("CARGO_PKG_VERSION"),
        scene.record.grid.dims,
        poses.len(),
        1e3 * made.as_secs_f64(),
        1e3 * begun.elapsed().as_secs_f64(),
    );
    let blocked = poses.iter().filter(|p| field.collides(p)).count();
    println!("{:.1} % of the poses collide", 100.0 * blocked as f64 / poses.len() as f64);
    report("axis alone", &poses, |p| p.axis().is_some_and(|axis| axis.x > 0.0));
    report("yes or no", &poses, |p| field.collides(p));
    report("volume", &poses, |p| field.count(p) > Some(0));
    report("overlap", &poses, |p| field.overlap(p).is_ok_and(|v| v > 0.0));
    report("clearance bound", &poses, |p| field.clearance_bound(p).is_some_and(|v| v <= 0.0));
}

/// The sum over batches of the best time of each: short batches, so that a busy machine disturbs few of them.
fn report(name: &str, poses: &[Pose], answer: impl Fn(&Pose) -> bool) {
    let (mut seconds, mut yes) = (0.0, 0);
    for batch in poses.chunks(BATCH) {
        let mut best = f64::INFINITY;
        let mut found = 0;
        for _ in 0..ROUNDS {
            let begun = Instant::now();
            found = batch.iter().filter(|pose| answer(pose)).count();
            best = best.min(begun.elapsed().as_secs_f64());
        }
        seconds += best;
        yes += found;
    }
    println!("{name:<16} {:>12.0} poses/s   ({yes} yes)", poses.len() as f64 / seconds);
}

fn random_poses(scene: &Scene, count: usize) -> Vec<Pose> {
    let directions = OrientationSet::parse(&format!("random:{count}:1")).expect("a set").orientations;
    let mut state = 1_u64;
    let mut number = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let grid = &scene.record.grid;
    directions
        .into_iter()
        .map(|orientation| {
            let unit = DVec3::new(number(), number(), number());
            Pose::oriented(grid.origin + unit * grid.size(), &orientation)
        })
        .collect()
}

fn scene(part: ReferencePart) -> Scene {
    let mesh = part.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(part, &mesh, part.dims(), &tool);
    spec.scene().expect("a reference scene")
}
