//! A sampling planner from another crate (dual RRT-connect) finds a way for the tool around the bracket, asking a checker
//! whether poses are free; then every piece of the way is proven free as a motion.
//!
//! `cargo run --release -p imf-fields --example rrt`

use std::cell::RefCell;
use std::error::Error;
use std::time::Instant;

use glam::DVec3;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::tool::{Clearance, Tool};
use imf_core::world::{MotionOptions, ObstacleMesh, World};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rrt::dual_rrt_connect;

/// A tilt of a radian is as far as this many millimetres.
const RADIAN: f64 = 50.0;
/// Between two poses of the way no point of the tool, 84 mm long, moves farther than √(1 + (84/50)²) < 2 of these.
const STEP: f64 = 1.0;
/// So a pose that keeps this clearance is free half a step in every direction.
const CLEARANCE: f64 = 1.0;

/// Tip, and tilt from upright along x and y.
type State = [f64; 5];

fn pose(state: &[f64]) -> Pose {
    let axis = DVec3::new(state[3] / RADIAN, state[4] / RADIAN, 1.0);
    Pose::along(DVec3::new(state[0], state[1], state[2]), axis)
}

/// A way found, and what finding it took.
struct PlannedPath {
    way: Vec<Pose>,
    asked: usize,
    seconds: f64,
    /// Pieces proven free, of all pieces.
    proven: usize,
}

fn plan(seed: u64) -> Result<PlannedPath, Box<dyn Error>> {
    let mesh = ReferencePart::Bracket.mesh();
    let (lower, upper) = mesh.bounds().ok_or("the bracket has no triangle")?;
    let world = World::builder().pitch(3.0).obstacle(ObstacleMesh::new("bracket", mesh)).build()?;
    let room = Clearance { holder: CLEARANCE, shank: CLEARANCE, cutter: CLEARANCE };
    // Poses are asked with the clearance, motions are proven of the tool itself.
    let field = world.checker(&Tool::paper(), &room)?;
    let tool = world.checker(&Tool::paper(), &Clearance::default())?;
    let random = RefCell::new(ChaCha8Rng::seed_from_u64(seed));
    let number = || f64::from(random.borrow_mut().next_u32()) / f64::from(u32::MAX);
    let (low, size) = (lower - 40.0, upper - lower + 80.0);
    let sample = || -> Vec<f64> {
        let tip = low + size * DVec3::new(number(), number(), number());
        vec![tip.x, tip.y, tip.z, 80.0 * (number() - 0.5), 80.0 * (number() - 0.5)]
    };
    let options = MotionOptions::default();
    let seconds = RefCell::new((0, 0.0));
    let is_free = |state: &[f64]| {
        let begun = Instant::now();
        let free = field.is_free(&pose(state));
        let mut spent = seconds.borrow_mut();
        spent.0 += 1;
        spent.1 += begun.elapsed().as_secs_f64();
        free
    };
    // From beside the part to a free pose low among its walls that no straight motion reaches.
    let middle = 0.5 * (lower + upper);
    let start: State = [low.x, middle.y, middle.z, 0.0, 0.0];
    let goal = (0..100_000).map(|_| sample()).find(|state| {
        let tip = pose(state).position;
        let inside = tip.cmpge(lower).all() && tip.cmple(upper).all();
        let straight = || tool.check_motion(&pose(&start), &pose(state), &options);
        inside && state[2] < middle.z && is_free(state) && straight().is_ok_and(|motion| !motion.is_free())
    });
    let goal = goal.ok_or("no pose among the walls is free")?;
    let found = dual_rrt_connect(&start, &goal, is_free, sample, STEP, 20_000)?;
    let way: Vec<Pose> = found.iter().map(|state| pose(state)).collect();
    let free = |pair: &&[Pose]| {
        tool.check_motion(&pair[0], &pair[1], &options).is_ok_and(|motion| motion.is_proven())
    };
    let proven = way.windows(2).filter(free).count();
    let (asked, seconds) = seconds.into_inner();
    Ok(PlannedPath { way, asked, seconds, proven })
}

fn main() -> Result<(), Box<dyn Error>> {
    let PlannedPath { way, asked, seconds, proven } = plan(1)?;
    println!(
        "a way of {} poses; {asked} poses asked one by one, {:.0} poses/s; {proven} of {} pieces proven free",
        way.len(),
        asked as f64 / seconds,
        way.len() - 1
    );
    Ok(())
}

#[test]
fn the_way_is_proven_free() {
    let found = plan(1).unwrap();
    assert!(found.way.len() > 20 && found.asked > found.way.len());
    assert_eq!(found.proven, found.way.len() - 1);
}
