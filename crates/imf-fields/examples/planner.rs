//! A five-axis approach to a point among the bracket's walls, and the retract from it, by gradient descent with a field of
//! signed depth as penalty; then every piece of the way is proven free as a motion.
//!
//! The descent is that of CHOMP (Zucker et al. 2013): poses from the start to the goal are pulled straight, and pushed by
//! the field's gradients out of everything that they come closer to than a clearance; both by steps that are smooth along
//! the way.
//!
//! `cargo run --release -p imf-fields --example planner`

#[path = "bracket/mod.rs"]
mod bracket;

use std::error::Error;
use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use imf_core::field::{Best, Decision, Gradient, PoseField};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::world::{MotionOptions, MotionResult, QueryError};
use imf_fields::field::Planner;
use imf_fields::harmonic::FitSettings;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A turn by a radian is as far as this many millimetres: half the tool's length.
const RADIAN: f64 = 42.0;
/// What the way is pushed to keep, in millimetres; its ends keep half of it.
const ROOM: f64 = 3.0;
/// Poses of a leg, ends included.
const NODES: usize = 32;
/// Steps of a descent.
const STEPS: usize = 150;
/// No pose moves farther in a step, in millimetres.
const LONGEST: f64 = 3.0;
/// Weight of the penalty beside the pull to be straight.
const PUSH: f64 = 0.5;
/// Ways begin straight, or bowed by so many millimetres to a side.
const BOW: f64 = 45.0;

/// A field of signed depth over the coarse bracket and as much space around it as its values reach.
fn tool() -> Result<Planner, Box<dyn Error>> {
    let (quantity, components) = (Quantity::Depth, 60);
    let settings =
        FitSettings { quantity, degree: 8, sections_per_function: 2.0, components, ..FitSettings::default() };
    Ok(Planner::new(bracket::field(0.0, 8, settings)?)?)
}

/// Tip and axis; the axis a unit vector.
#[derive(Clone, Copy, Debug)]
struct Node {
    tip: DVec3,
    axis: DVec3,
}

impl Node {
    fn pose(&self) -> Pose {
        Pose::along(self.tip, self.axis)
    }
}

/// The straight way, bowed to a side.
fn first_guess(from: Node, to: Node, bow: DVec3) -> Vec<Node> {
    let at = |time: f64| Node {
        tip: from.tip.lerp(to.tip, time) + bow * (PI * time).sin(),
        axis: from.axis.lerp(to.axis, time).normalize(),
    };
    (0..NODES).map(|k| at(k as f64 / (NODES - 1) as f64)).collect()
}

/// Solves `2 x_k − x_(k−1) − x_(k+1) = b_k` with 0 at both ends, in place: Thomas's algorithm for that matrix.
fn smoothed(values: &mut [DVec3]) {
    let mut factors = Vec::with_capacity(values.len());
    let (mut factor, mut before) = (0.0, DVec3::ZERO);
    for value in values.iter_mut() {
        factor = 1.0 / (2.0 - factor);
        *value = (*value + before) * factor;
        before = *value;
        factors.push(factor);
    }
    let mut after = DVec3::ZERO;
    for (value, factor) in values.iter_mut().zip(factors).rev() {
        *value += after * factor;
        after = *value;
    }
}

/// One step of the descent; `gradients` are the field's at the nodes. The ends stay.
fn descend(nodes: &mut [Node], gradients: &[Gradient]) {
    let pull =
        |at: &dyn Fn(&Node) -> DVec3, k: usize| 2.0 * at(&nodes[k]) - at(&nodes[k - 1]) - at(&nodes[k + 1]);
    let (mut tips, mut axes): (Vec<DVec3>, Vec<DVec3>) = (1..nodes.len() - 1)
        .map(|k| {
            let Gradient { value, position, direction, .. } = gradients[k];
            let push = PUSH * (f64::from(value) + ROOM).max(0.0);
            // A turn counts as the way of the tool's middle.
            (
                pull(&|node| node.tip, k) + push * position.as_dvec3(),
                pull(&|node| node.axis, k) + push * direction.as_dvec3() / (RADIAN * RADIAN),
            )
        })
        .unzip();
    smoothed(&mut tips);
    smoothed(&mut axes);
    let farthest =
        tips.iter().zip(&axes).map(|(tip, axis)| tip.length() + RADIAN * axis.length()).fold(0.0, f64::max);
    let rate = (LONGEST / farthest.max(f64::MIN_POSITIVE)).min(0.5);
    for (node, (tip, axis)) in nodes[1..].iter_mut().zip(tips.into_iter().zip(axes)) {
        node.tip -= rate * tip;
        node.axis = (node.axis - rate * axis).normalize();
    }
}

fn motion(tool: &Planner, from: Node, to: Node) -> Result<MotionResult, QueryError> {
    tool.checker.check_motion(&from.pose(), &to.pose(), &MotionOptions::default())
}

/// Pieces of a way that are proven free.
fn proven(tool: &Planner, nodes: &[Node]) -> usize {
    let free = |pair: &&[Node]| motion(tool, pair[0], pair[1]).is_ok_and(|motion| motion.is_proven());
    nodes.windows(2).filter(free).count()
}

/// A leg that is proven free, from the first of some guesses that leads to one.
fn leg(tool: &Planner, from: Node, to: Node) -> Result<Option<Vec<Node>>, Box<dyn Error>> {
    for bow in [DVec3::ZERO, DVec3::Z, DVec3::NEG_Z, DVec3::Y, DVec3::NEG_Y] {
        let mut nodes = first_guess(from, to, BOW * bow);
        let mut gradients = vec![Gradient::NAN; NODES];
        for step in 0..STEPS {
            let poses: Vec<Pose> = nodes.iter().map(Node::pose).collect();
            tool.gradients(&poses, &mut gradients)?;
            let clear = gradients[1..NODES - 1].iter().all(|g| f64::from(g.value) < -0.3 * ROOM);
            if (clear || step + 1 == STEPS) && proven(tool, &nodes) == NODES - 1 {
                return Ok(Some(nodes));
            }
            descend(&mut nodes, &gradients);
        }
    }
    Ok(None)
}

/// From beside the part to a goal among its walls, and from there to the other side.
fn plan(tool: &Planner, seed: u64) -> Result<[Vec<Node>; 2], Box<dyn Error>> {
    let grid = tool.model.scene().record.grid;
    let (low, size) = (grid.origin, grid.size());
    let beside = |x: f64| Node { tip: low + size * DVec3::new(x, 0.5, 0.5), axis: DVec3::Z };
    let (home, away) = (beside(-0.1), beside(1.1));
    let set = OrientationSet::parse("cone:0,0,1:70:120")?.orientations;
    let rotations: Vec<DQuat> = set.iter().map(Orientation::quaternion).collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let collides = |a: Node, b: Node| motion(tool, a, b).is_ok_and(|motion| !motion.is_free());
    for _ in 0..2000 {
        let tip = low + size * (0.2 + 0.6 * DVec3::new(number(), number(), number()));
        let mut best = [Best::NONE];
        tool.best(&[tip], &rotations, &mut best)?;
        let goal = Node { tip, axis: set[best[0].orientation as usize].direction() };
        // Free with some room, among walls that no straight motion passes from either side.
        let good = best[0].decision == Decision::Free && f64::from(best[0].value) < -0.5 * ROOM;
        if !good || !collides(home, goal) || !collides(goal, away) {
            continue;
        }
        if let Some(approach) = leg(tool, home, goal)?
            && let Some(retract) = leg(tool, goal, away)?
        {
            return Ok([approach, retract]);
        }
    }
    Err("no goal was reached".into())
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("x,y,z,i,j,k");
    for Node { tip, axis } in plan(&tool()?, 1)?.concat() {
        println!("{:.3},{:.3},{:.3},{:.4},{:.4},{:.4}", tip.x, tip.y, tip.z, axis.x, axis.y, axis.z);
    }
    Ok(())
}

#[test]
fn both_legs_are_free_and_were_not_when_straight() {
    let tool = tool().unwrap();
    for nodes in plan(&tool, 1).unwrap() {
        assert_eq!((nodes.len(), proven(&tool, &nodes)), (NODES, NODES - 1));
        let straight = motion(&tool, nodes[0], nodes[NODES - 1]).unwrap();
        assert!(!straight.is_free(), "{straight:?}");
        // No pose between collides, asked one by one.
        for pair in nodes.windows(2) {
            for part in 0..20 {
                let time = f64::from(part) / 20.0;
                let tip = pair[0].tip.lerp(pair[1].tip, time);
                let axis = pair[0].axis.slerp(pair[1].axis, time);
                assert!(tool.checker.is_free(&Pose::along(tip, axis)), "{tip} {axis}");
            }
        }
    }
}

#[test]
fn smoothing_solves_its_equations() {
    let given: Vec<DVec3> = (0..7).map(|k| DVec3::new(f64::from(k), f64::from(k * k) - 9.0, 1.0)).collect();
    let mut solved = given.clone();
    smoothed(&mut solved);
    for k in 0..7 {
        let before = if k == 0 { DVec3::ZERO } else { solved[k - 1] };
        let after = if k == 6 { DVec3::ZERO } else { solved[k + 1] };
        assert!((2.0 * solved[k] - before - after - given[k]).length() < 1e-3);
    }
}
