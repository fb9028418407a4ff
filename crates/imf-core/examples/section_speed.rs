//! Where the time of a section goes.
use std::time::Instant;

use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::section::{SectionPlan, SectionScratch, imf};
use imf_core::tool::{RotatedTool, Tool};
use imf_core::voxelize::voxelize;

fn main() {
    let part = ReferencePart::Teapot;
    let mesh = part.mesh();
    let (lower, upper) = mesh.bounds().unwrap();
    let dims = part.dims();
    let size = glam::DVec3::from_array(dims.map(|d| d as f64));
    let grid = Grid { origin: (lower + upper) / 2.0 - size / 2.0, pitch: 1.0, dims };
    let start = Instant::now();
    let obstacle = match std::fs::read("/tmp/teapot.bin") {
        Ok(packed) => imf_core::occupancy::Occupancy::from_packed(grid, &packed).unwrap(),
        Err(_) => {
            let o = voxelize(&mesh, &grid, false);
            std::fs::write("/tmp/teapot.bin", o.packed()).unwrap();
            o
        }
    };
    println!("voxelize {:?}: {} solid", start.elapsed(), obstacle.count());
    let tool = Tool::paper();
    let start = Instant::now();
    let plan = SectionPlan::new(&obstacle, &tool).unwrap();
    println!("plan {:?}: {}", start.elapsed(), plan.describe());
    let set = OrientationSet::parse("fibonacci:225").unwrap().orientations;
    let mut scratch = SectionScratch::default();
    let mut counts = vec![0; grid.len()];
    let mut cmf = vec![0.0; grid.len()];
    let mode = std::env::args().nth(1).unwrap_or_default();
    if mode == "counts" {
        for _ in 0..4 {
            for o in &set {
                plan.counts(o, &mut scratch, &mut counts).unwrap();
            }
        }
        return;
    }
    for round in 0..3 {
        let start = Instant::now();
        let solid: usize = set.iter().map(|o| RotatedTool::new(&tool, o, 1.0).unwrap().count as usize).sum();
        let tools = start.elapsed();
        let start = Instant::now();
        let mut hash = 0u64;
        for o in &set {
            plan.counts(o, &mut scratch, &mut counts).unwrap();
            if round == 0 {
                hash = counts.iter().fold(hash, |h, &c| h.wrapping_mul(31).wrapping_add(u64::from(c)));
            }
        }
        let all = start.elapsed();
        let start = Instant::now();
        for o in &set {
            plan.cmf(o, &mut scratch, &mut cmf).unwrap();
        }
        let fields = start.elapsed();
        let start = Instant::now();
        let least = imf(&plan, &set, Control::quiet()).unwrap();
        let whole = start.elapsed();
        let sum: f64 = least.value.iter().map(|&v| f64::from(v)).sum();
        println!(
            "round {round}: tools {:.3} ms, counts {:.3} ms, cmf {:.3} ms a section; imf {:.3} s; {solid} {hash:x} {sum}",
            tools.as_secs_f64() * 1e3 / 225.0,
            all.as_secs_f64() * 1e3 / 225.0,
            fields.as_secs_f64() * 1e3 / 225.0,
            whole.as_secs_f64()
        );
    }
}
