//! A five-axis approach to a point among the bracket's walls, and the retract from it, by gradient descent with a field of
//! signed depth as penalty; then every piece of the way is proven free as a motion, and the way is drawn.
//!
//! The descent is that of CHOMP (Zucker et al. 2013): poses from the start to the goal are pulled straight, and pushed by
//! the field's gradients out of everything that they come closer to than a clearance; both by steps that are smooth along
//! the way.
//!
//! `cargo run --release -p imf-fields --example planner [planner.png]`

#[path = "chart/mod.rs"]
mod chart;

use std::error::Error;
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};
use imf_core::control::Control;
use imf_core::field::{Best, Decision, Gradient, PoseField};
use imf_core::grid::Grid;
use imf_core::motion::MotionResult;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, Quantity, SectionPlan};
use imf_core::tool::{Clearance, Tool};
use imf_fields::field::{Field, VerifiedField};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, fit};
use plotters::prelude::{
    BLACK, ChartBuilder, Circle, Color as _, LineSeries, PathElement, RGBColor, Rectangle,
};
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
/// The tool's length in millimetres, for the picture.
const LENGTH: f64 = 83.0;

/// A field of signed depth over the coarse bracket and as much space around it as its values reach.
fn field() -> Result<Field, Box<dyn Error>> {
    let part = ReferencePart::Bracket;
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let spec = SceneSpec::of_reference(part, &mesh, [33, 65, 45], &tool);
    let scene = SceneSpec { margin: 8, ..spec }.scene()?;
    let settings = FitSettings {
        quantity: Quantity::Depth,
        degree: 8,
        sections_per_function: 2.0,
        axes: 60,
        ..FitSettings::default()
    };
    let made =
        fit(&SectionPlan::of_scene(&scene, At::Tip)?, Domain::Directions, &settings, Control::quiet())?;
    let file = HarmonicFile { field: made, scene, settings, calibration: None };
    Ok(Field::new(FieldFile::Harmonic(Arc::new(file)))?)
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
    (0..NODES)
        .map(|k| {
            let time = k as f64 / (NODES - 1) as f64;
            let tip = from.tip.lerp(to.tip, time) + bow * (PI * time).sin();
            Node { tip, axis: from.axis.lerp(to.axis, time).normalize() }
        })
        .collect()
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

/// Pieces of a way that are proven free.
fn proven(tool: &VerifiedField, nodes: &[Node]) -> usize {
    let free = |pair: &&[Node]| {
        matches!(tool.check_motion(&pair[0].pose(), &pair[1].pose()), Ok(MotionResult::Free))
    };
    nodes.windows(2).filter(free).count()
}

/// A leg that is proven free, from the first of some guesses that leads to one.
fn leg(tool: &VerifiedField, from: Node, to: Node) -> Result<Option<Vec<Node>>, Box<dyn Error>> {
    let bows = [DVec3::ZERO, DVec3::Z, DVec3::NEG_Z, DVec3::Y, DVec3::NEG_Y];
    for bow in bows {
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

/// What was planned.
struct Plan {
    /// From home to the goal, and from the goal to the other side.
    approach: Vec<Node>,
    retract: Vec<Node>,
    /// Goals that were given up.
    given_up: usize,
    seconds: f64,
}

fn plan(tool: &VerifiedField, seed: u64) -> Result<Plan, Box<dyn Error>> {
    let begun = Instant::now();
    let grid = tool.model().scene().record.grid;
    let (low, size) = (grid.origin, grid.size());
    // Beside the part on either side, upright.
    let home = Node { tip: low + size * DVec3::new(-0.1, 0.5, 0.5), axis: DVec3::Z };
    let away = Node { tip: low + size * DVec3::new(1.1, 0.5, 0.5), axis: DVec3::Z };
    let set = OrientationSet::parse("cone:0,0,1:70:120")?.orientations;
    let axes: Vec<DVec3> = set.iter().map(imf_core::orientation::Orientation::direction).collect();
    let rotations: Vec<DQuat> = set.iter().map(imf_core::orientation::Orientation::quaternion).collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let blocked = |a: Node, b: Node| {
        matches!(tool.check_motion(&a.pose(), &b.pose()), Ok(MotionResult::Colliding { .. }))
    };
    let mut given_up = 0;
    for _ in 0..2000 {
        let tip = low + size * (0.2 + 0.6 * DVec3::new(number(), number(), number()));
        let mut best = [Best::NONE];
        tool.best(&[tip], &rotations, &mut best)?;
        let goal = Node { tip, axis: axes[best[0].orientation as usize] };
        // Free with some room, among walls that no straight motion passes from either side.
        let good = best[0].decision == Decision::Free && f64::from(best[0].value) < -0.5 * ROOM;
        if !good || !blocked(home, goal) || !blocked(goal, away) {
            continue;
        }
        if let Some(approach) = leg(tool, home, goal)?
            && let Some(retract) = leg(tool, goal, away)?
        {
            return Ok(Plan { approach, retract, given_up, seconds: begun.elapsed().as_secs_f64() });
        }
        given_up += 1;
    }
    Err("no goal was reached".into())
}

/// The part from two sides, with the tips' way and the tool's axis along it.
fn draw(path: &Path, part: &Occupancy, plan: &Plan) -> Result<(), Box<dyn Error>> {
    const BLUE: RGBColor = RGBColor(31, 119, 180);
    const ORANGE: RGBColor = RGBColor(214, 110, 20);
    chart::save(path, (1500, 760), |area| {
        let views: [(&str, [usize; 2], [&str; 2]); 2] = [
            ("along x: approach blue, retract orange, to the goal's dot", [1, 2], ["y, mm", "z, mm"]),
            ("along y", [0, 2], ["x, mm", "z, mm"]),
        ];
        for (area, (title, [u, v], [across, up])) in area.split_evenly((1, 2)).iter().zip(views) {
            let grid = &part.grid;
            // The tool stands above the part.
            let middle = (grid.origin + 0.5 * grid.size()) + 35.0 * DVec3::Z;
            let half = 110.0;
            let range = |axis: usize| middle[axis] - half..middle[axis] + half;
            let mut chart = ChartBuilder::on(area)
                .caption(title, ("sans-serif", 22))
                .margin(12)
                .x_label_area_size(42)
                .y_label_area_size(52)
                .build_cartesian_2d(range(u), range(v))?;
            chart
                .configure_mesh()
                .x_desc(across)
                .y_desc(up)
                .light_line_style(RGBColor(245, 245, 245))
                .bold_line_style(RGBColor(230, 230, 230))
                .draw()?;
            chart.draw_series(columns(part, u, v).into_iter().map(|Column { low, high, share }| {
                let grey = 215 - (130.0 * share) as u8;
                Rectangle::new([low, high], RGBColor(grey, grey, grey).filled())
            }))?;
            for (nodes, colour) in [(&plan.approach, BLUE), (&plan.retract, ORANGE)] {
                for node in nodes.iter().step_by(3) {
                    let end = node.tip + LENGTH * node.axis;
                    let line = vec![(node.tip[u], node.tip[v]), (end[u], end[v])];
                    chart.draw_series([PathElement::new(line, colour.mix(0.35))])?;
                }
                let way = nodes.iter().map(|node| (node.tip[u], node.tip[v]));
                chart.draw_series(LineSeries::new(way, colour.stroke_width(3)))?;
            }
            if let Some(goal) = plan.approach.last() {
                chart.draw_series([Circle::new((goal.tip[u], goal.tip[v]), 6, BLACK.filled())])?;
            }
        }
        Ok(())
    })
}

/// A column of voxels across the picture: its corners there, and the share of it that is solid.
struct Column {
    low: (f64, f64),
    high: (f64, f64),
    share: f64,
}

/// Columns of voxels along the axis that is left, those that hold any.
fn columns(part: &Occupancy, u: usize, v: usize) -> Vec<Column> {
    let Grid { origin, pitch, dims } = part.grid;
    let along = 3 - u - v;
    let mut found = Vec::new();
    for a in 0..dims[u] {
        for b in 0..dims[v] {
            let solid = |c: &usize| {
                let mut voxel = [0; 3];
                (voxel[u], voxel[v], voxel[along]) = (a, b, *c);
                part.solid[part.grid.index(voxel)] != 0
            };
            let count = (0..dims[along]).filter(solid).count();
            if count > 0 {
                let corner =
                    |a: usize, b: usize| (origin[u] + pitch * a as f64, origin[v] + pitch * b as f64);
                let share = count as f64 / dims[along] as f64;
                found.push(Column { low: corner(a, b), high: corner(a + 1, b + 1), share });
            }
        }
    }
    found
}

fn run(path: &Path, seed: u64) -> Result<Plan, Box<dyn Error>> {
    let tool = VerifiedField::with_clearance(field()?, Clearance::default())?;
    let found = plan(&tool, seed)?;
    draw(path, &tool.model().scene().obstacle, &found)?;
    Ok(found)
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "planner.png".into());
    let Plan { approach, retract, given_up, seconds } = run(Path::new(&path), 1)?;
    println!(
        "approach of {} poses and retract of {}, every piece proven free; {given_up} goals given up before, {seconds:.1} s; \
         wrote {path}",
        approach.len(),
        retract.len()
    );
    Ok(())
}

#[test]
fn both_legs_are_free_and_were_not_when_straight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("planner.png");
    let Plan { approach, retract, .. } = run(&path, 1).unwrap();
    let exact = VerifiedField::new(field().unwrap()).unwrap();
    for nodes in [&approach, &retract] {
        assert_eq!((nodes.len(), proven(&exact, nodes)), (NODES, NODES - 1));
        let straight = exact.check_motion(&nodes[0].pose(), &nodes[NODES - 1].pose()).unwrap();
        assert!(matches!(straight, MotionResult::Colliding { .. }), "{straight:?}");
        // The exact field finds no collision at poses between, asked one by one.
        for pair in nodes.windows(2) {
            for part in 0..20 {
                let time = f64::from(part) / 20.0;
                let tip = pair[0].tip.lerp(pair[1].tip, time);
                let axis = pair[0].axis.slerp(pair[1].axis, time);
                let mut decision = [Decision::Undecided];
                exact.classify(&[Pose::along(tip, axis)], &mut decision).unwrap();
                assert_eq!(decision, [Decision::Free], "{tip} {axis}");
            }
        }
    }
    let picture = image::open(&path).unwrap().into_rgb8();
    let coloured = picture.pixels().filter(|p| p.0[0].abs_diff(p.0[2]) > 60).count();
    assert!(coloured > 2000, "{coloured} pixels of the ways");
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
