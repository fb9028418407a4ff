//! For each point of a line over the part's surface the tool's best axis, then a smooth sequence of axes along the line:
//! the least sum of turns and of closeness among axes that are all proven free.
//!
//! `cargo run --release -p imf-fields --example orientation`

#[path = "bracket/mod.rs"]
mod bracket;

use std::error::Error;

use glam::{DQuat, DVec3};
use imf_core::field::{Best, Decision, PoseField};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_fields::field::Planner;

/// Axes to choose from.
const AXES: usize = 300;
/// What an overlap of the offset tool, all of it, costs beside a turn of a radian squared.
const CLOSENESS: f64 = 20.0;

/// Axes at points: the best at each, and the smooth sequence.
struct Axes {
    points: Vec<DVec3>,
    best: Vec<DVec3>,
    smooth: Vec<DVec3>,
}

fn field() -> Result<Planner, Box<dyn Error>> {
    // Holder 3 mm away, or the model says how close.
    Ok(Planner::new(bracket::field(3.0, 0, bracket::overlaps())?)?)
}

fn choose(field: &Planner) -> Result<Axes, Box<dyn Error>> {
    let scene = field.model.scene();
    let grid = scene.record.grid;
    // Just above the highest voxel of each column of the part's middle plane.
    let mut points = Vec::new();
    for y in 0..grid.dims[1] {
        let solid = |z: &usize| scene.obstacle.solid[grid.index([grid.dims[0] / 2, y, *z])] != 0;
        if let Some(z) = (0..grid.dims[2]).rev().find(solid) {
            points.push(grid.centre([grid.dims[0] / 2, y, z]) + DVec3::Z * 1.5 * grid.pitch);
        }
    }
    let set = OrientationSet::parse(&format!("fibonacci:{AXES}"))?.orientations;
    let axes: Vec<DVec3> = set.iter().map(Orientation::direction).collect();
    let rotations: Vec<DQuat> = set.iter().map(Orientation::quaternion).collect();
    let mut best = vec![Best::NONE; points.len()];
    field.best(&points, &rotations, &mut best)?;
    // Points that no axis reaches are left out.
    let reached: Vec<usize> = (0..points.len()).filter(|&i| best[i].decision == Decision::Free).collect();
    let mut cost = vec![0.0; axes.len()];
    let mut from: Vec<Vec<usize>> = Vec::new();
    for (place, &point) in reached.iter().enumerate() {
        let poses: Vec<Pose> = rotations.iter().map(|&r| Pose::new(points[point], r)).collect();
        let (mut values, mut decisions) = (vec![0.0; AXES], vec![Decision::Undecided; AXES]);
        field.values(&poses, &mut values)?;
        field.classify(&poses, &mut decisions)?;
        let mut next = vec![f64::INFINITY; AXES];
        let mut came = vec![0; AXES];
        for to in (0..AXES).filter(|&to| decisions[to] == Decision::Free) {
            let turned = |before: usize| {
                let turn = axes[before].angle_between(axes[to]);
                if place == 0 { 0.0 } else { cost[before] + turn * turn }
            };
            let (least, before) = (0..AXES)
                .map(|before| (turned(before), before))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or((f64::INFINITY, 0));
            (next[to], came[to]) = (least + CLOSENESS * f64::from(values[to]), before);
        }
        cost = next;
        from.push(came);
    }
    let mut last = (0..AXES).min_by(|&a, &b| cost[a].total_cmp(&cost[b])).unwrap_or(0);
    let mut smooth = Vec::new();
    for came in from.iter().rev() {
        smooth.push(axes[last]);
        last = came[last];
    }
    smooth.reverse();
    Ok(Axes {
        best: reached.iter().map(|&i| axes[best[i].orientation as usize]).collect(),
        points: reached.into_iter().map(|i| points[i]).collect(),
        smooth,
    })
}

/// Sum of the turns from one axis to the next, in degrees.
fn turning(axes: &[DVec3]) -> f64 {
    axes.windows(2).map(|pair| pair[0].angle_between(pair[1])).sum::<f64>().to_degrees()
}

fn main() -> Result<(), Box<dyn Error>> {
    let field = field()?;
    let Axes { points, best, smooth } = choose(&field)?;
    println!("x,y,z,i,j,k");
    for (p, d) in points.iter().zip(&smooth) {
        println!("{:.3},{:.3},{:.3},{:.4},{:.4},{:.4}", p.x, p.y, p.z, d.x, d.y, d.z);
    }
    eprintln!(
        "{} points; the best axes turn by {:.0}° in all, the smooth ones by {:.0}°",
        points.len(),
        turning(&best),
        turning(&smooth)
    );
    Ok(())
}

#[test]
fn smooth_axes_are_free_and_turn_less() {
    let field = field().unwrap();
    let Axes { points, best, smooth } = choose(&field).unwrap();
    assert!(points.len() > 20 && points.len() == smooth.len());
    for (&point, &axis) in points.iter().zip(&smooth) {
        assert!(field.checker.is_free(&Pose::along(point, axis)), "{point} {axis}");
    }
    assert!(turning(&smooth) < turning(&best), "{} against {}", turning(&smooth), turning(&best));
}
