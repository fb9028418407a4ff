//! The cost model against the clock: seconds of a section by run-length counting and by real FFTs, and what was estimated.
//!
//! ```sh
//! cargo run --release -p imf-bench --example methods -- 256
//! ```
//! Sections of the screw gear on n³ voxels up to the side given (192 by default), on one thread, with the paper's tool and
//! with that tool scaled with the grid; the least time of three directions each.

use std::time::Instant;

use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, Method, SectionPlan, SectionScratch};
use imf_core::tool::Tool;

/// The side at which the paper's tool and the scaled one are the same.
const PAPER_SIDE: f64 = 121.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let most: usize = std::env::args().nth(1).map_or(Ok(192), |side| side.parse())?;
    let part = ReferencePart::ScrewGear;
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let orientations = OrientationSet::parse("fibonacci:3")?.orientations;
    for side in [32, 64, 96, 128, 192, 224, 256, 288, 320, 384].into_iter().filter(|&side| side <= most) {
        let spec = SceneSpec::of_reference(part, &mesh, [side; 3], &tool);
        let mut obstacle = spec.scene()?.obstacle;
        for scaled in [false, true] {
            // In a grid of another pitch the same tool spans as many voxels as are asked for.
            obstacle.grid.pitch = if scaled { PAPER_SIDE / side as f64 } else { 1.0 };
            println!("{side}³, tool {}", if scaled { "scaled" } else { "29×29×83" });
            println!("  chosen    {}", SectionPlan::new(&obstacle, &tool, At::SharpPoints)?.describe());
            for (method, name) in [(Method::RunLength, "run-length"), (Method::Fft, "real FFT")] {
                let plan = SectionPlan::new(&obstacle, &tool, At::SharpPoints)?.with_method(method);
                let (mut scratch, mut counts) = (SectionScratch::default(), vec![0; obstacle.grid.len()]);
                // The first section also makes the plan's tables.
                plan.counts(&orientations[0], &mut scratch, &mut counts)?;
                let mut least = f64::INFINITY;
                for orientation in &orientations {
                    let start = Instant::now();
                    plan.counts(orientation, &mut scratch, &mut counts)?;
                    least = least.min(start.elapsed().as_secs_f64());
                }
                println!("  {name}  {:.1} ms", least * 1e3);
            }
        }
    }
    Ok(())
}
