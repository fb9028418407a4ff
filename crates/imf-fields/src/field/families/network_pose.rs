//! A pose as the paper's network reads it, and what its slopes say of the pose.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::held;
use crate::harmonic;
use crate::siren::evaluator::ROWS;
use crate::siren::{INPUTS, features, is_vertical};
use imf_core::grid::Grid;
use imf_core::pose::Pose;

/// Below this sine of φ the slope in θ is not divided further.
const POLE: f64 = 1e-3;

/// What the paper's network says by its inputs, by the pose.
pub(super) fn siren_gradient(
    grid: &Grid,
    slopes: [f32; ROWS],
    [theta, phi]: [f64; 2],
    direction: DVec3,
) -> harmonic::Gradient {
    let [_, x, y, z, by_theta, by_phi] = slopes.map(f64::from);
    // From inputs, which are θ/180° − 1 and φ/90° − 1, to radians. A vertical direction is asked at one θ whatever it is.
    let by_theta = if is_vertical(phi.to_degrees() as f32) { 0.0 } else { by_theta / PI };
    let by_phi = by_phi / FRAC_PI_2;
    let (sin_theta, cos_theta) = theta.sin_cos();
    let (sin_phi, cos_phi) = phi.sin_cos();
    let along_theta = DVec3::new(-sin_theta, cos_theta, 0.0);
    let along_phi = DVec3::new(cos_phi * cos_theta, cos_phi * sin_theta, -sin_phi);
    // Beside the poles the network's θ means little: the slope is held finite.
    let turn = along_theta * (by_theta / sin_phi.max(POLE)) + along_phi * by_phi;
    let turn = turn - direction * turn.dot(direction);
    harmonic::Gradient {
        value: slopes[0],
        position: DVec3::new(x, y, z) * 2.0 / grid.size(),
        direction: turn,
        rotation: direction.cross(turn),
    }
}

/// What the network reads of a pose, its position held in the box, and its angles in radians.
pub(super) fn siren_input(grid: &Grid, pose: &Pose) -> ([f32; INPUTS], [f64; 2]) {
    let [low, high] = grid.box_of_centres();
    let [theta, phi] = angles(pose);
    let unit = grid.unit(held(pose.position, low, high)).as_vec3().to_array();
    (features(unit, theta.to_degrees() as f32, phi.to_degrees() as f32), [theta, phi])
}

/// θ and φ in radians; of a vertical direction the θ at which it is asked; of an invalid pose any numbers.
fn angles(pose: &Pose) -> [f64; 2] {
    let axis = pose.axis().unwrap_or(DVec3::Z);
    let (theta, phi) = (axis.y.atan2(axis.x), axis.x.hypot(axis.y).atan2(axis.z));
    if is_vertical(phi.to_degrees() as f32) {
        return [PI, phi];
    }
    [if theta < 0.0 { theta + TAU } else { theta }, phi]
}
