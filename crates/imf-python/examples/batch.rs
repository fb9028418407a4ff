//! A million poses classified in Rust: what `batch.py`, of the same poses, is compared with.
//!
//! ```sh
//! cargo run --release -p imf-python --example batch
//! python crates/imf-python/examples/batch.py 1000000
//! ```

use std::f64::consts::TAU;
use std::time::Instant;

use imf_core::field::Decision;
use imf_core::glam::DVec3;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::world::Checker;

/// Multiples of these spread evenly over [0, 1): powers of the real root of x⁶ = x + 1.
const STEPS: [f64; 5] = [0.881_271_616_6, 0.776_639_662_2, 0.684_430_492_7, 0.603_169_118_3, 0.531_555_824_5];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count: usize = std::env::args().nth(1).map_or(Ok(1_000_000), |text| text.parse())?;
    let scene = Scene::builder().reference(ReferencePart::Bracket).pitch(1.0).build()?.scene;
    let checker = Checker::of_scene(&scene, &scene.record.clearance)?;
    let pose = |index: usize| {
        let [x, y, z, a, b] = STEPS.map(|step| (index as f64 * step).fract());
        let up = 1.0 - 2.0 * b;
        let across = (1.0 - up * up).sqrt();
        let axis = DVec3::new(across * (TAU * a).cos(), across * (TAU * a).sin(), up);
        Pose::along(DVec3::new(49.0 * x, 147.0 * y, 87.0 * z), axis)
    };
    let poses: Vec<Pose> = (0..count).map(pose).collect();
    let mut best = f64::INFINITY;
    let mut decisions = vec![Decision::Undecided; count];
    for _ in 0..7 {
        let begun = Instant::now();
        checker.classify_on_all_threads(&poses, &mut decisions)?;
        best = best.min(begun.elapsed().as_secs_f64());
    }
    let free = decisions.iter().filter(|decision| **decision == Decision::Free).count();
    println!(
        "Rust: {count} poses, {free} free, {:.1} ms, {:.3} µs a pose",
        1e3 * best,
        1e6 * best / count as f64
    );
    Ok(())
}
