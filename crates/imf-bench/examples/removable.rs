//! Measures the maximal removable volume: a box of stock around a part, the paper's tool, all threads.
//!
//! `cargo run --release -p imf-bench --example removable [part [orientations]]`

use std::time::Instant;

use imf_core::access::{cutter_of, position_grid, removable};
use imf_core::control::Control;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::tool::Tool;

/// The least time of so many rounds counts.
const ROUNDS: usize = 3;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let part = arguments.next().map_or(ReferencePart::Teapot, |name| name.parse().expect("a reference part"));
    let count: usize = arguments.next().map_or(64, |n| n.parse().expect("a number of orientations"));
    let tool = Tool::paper();
    let cutter = cutter_of(&tool).expect("the paper's tool has a cutter");
    let mesh = part.mesh();
    let spec = SceneSpec::of_reference(part, &mesh, part.dims(), &tool);
    let obstacle = spec.scene().expect("a scene").obstacle;
    let mut stock = Occupancy { grid: obstacle.grid, solid: Vec::new() };
    stock.solid = obstacle.solid.iter().map(|&s| 1 - s).collect();
    let orientations = OrientationSet::parse(&format!("fibonacci:{count}")).expect("a set").orientations;
    let positions = position_grid(&stock.grid, &tool).expect("a grid of positions");
    let mut least = f64::INFINITY;
    let mut covered = 0;
    for _ in 0..ROUNDS {
        let begun = Instant::now();
        let found = removable(&obstacle, &tool, &stock, &cutter, &orientations, 0.0, Control::quiet());
        covered = found.expect("removable stock").iter().map(|&v| usize::from(v)).sum();
        least = least.min(begun.elapsed().as_secs_f64());
    }
    println!(
        "imf-core {}: {part} {:?}, at most {:?} positions, {} voxels of stock, {covered} removable; {count} \
         orientations in {least:.3} s on {} threads, {:.2} ms an orientation",
        env!("CARGO_PKG_VERSION"),
        stock.grid.dims,
        positions.dims,
        stock.count(),
        rayon::current_num_threads(),
        1e3 * least / count as f64
    );
}
