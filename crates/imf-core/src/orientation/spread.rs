//! Orientations spread over the sphere, over a part of it and over all rotations.

use std::f64::consts::{PI, SQRT_2, TAU};

use glam::{DMat3, DQuat, DVec3};
#[cfg(feature = "random")]
use rand::{Rng, SeedableRng};
#[cfg(feature = "random")]
use rand_chacha::ChaCha8Rng;

use super::Orientation;

/// The orientation along a unit vector.
pub(super) fn direction_orientation(direction: DVec3) -> Orientation {
    Orientation::from_direction(direction).unwrap_or_default()
}

pub(super) fn grid(n: usize) -> Vec<Orientation> {
    let step = |i: usize, whole: f64| whole * i as f64 / n as f64;
    (0..n * n).map(|k| Orientation::new(step(k / n, 360.0), step(k % n, 180.0))).collect()
}

/// `n` directions on a golden spiral over the part of the unit sphere with z ≥ `lowest`: equal areas.
pub(super) fn fibonacci(n: usize, lowest: f64) -> impl Iterator<Item = DVec3> {
    let golden_angle = PI * (3.0 - 5.0f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (1.0 - lowest) * (i as f64 + 0.5) / n as f64;
        let flat = (1.0 - z * z).max(0.0).sqrt();
        let (sine, cosine) = (golden_angle * i as f64).sin_cos();
        DVec3::new(flat * cosine, flat * sine, z)
    })
}

#[cfg(feature = "random")]
pub(super) fn random(n: usize, seed: u64) -> Vec<Orientation> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (generator.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    (0..n)
        .map(|_| {
            let z = 2.0 * unit() - 1.0;
            Orientation::new(360.0 * unit(), z.acos().to_degrees())
        })
        .collect()
}

/// Super-Fibonacci spirals (Alexa 2022): low-discrepancy rotations.
pub(super) fn super_fibonacci(n: usize) -> Vec<Orientation> {
    // The positive root of ψ⁴ = ψ + 4.
    const PSI: f64 = 1.533_751_168_755_204_3;
    (0..n)
        .map(|i| {
            let s = i as f64 + 0.5;
            let (inner, outer) = ((s / n as f64).sqrt(), (1.0 - s / n as f64).sqrt());
            let (alpha, beta) = (TAU * s / SQRT_2, TAU * s / PSI);
            let turn = DQuat::from_xyzw(
                inner * alpha.sin(),
                inner * alpha.cos(),
                outer * beta.sin(),
                outer * beta.cos(),
            );
            Orientation::from_rotation(&DMat3::from_quat(turn.normalize()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::orientations;

    #[test]
    fn spirals_and_random_sets_are_balanced() {
        for spec in ["fibonacci:1000", "random:100000:1"] {
            let mean: DVec3 = orientations(spec).iter().map(Orientation::direction).sum::<DVec3>()
                / orientations(spec).len() as f64;
            assert!(mean.length() < 0.01, "{spec}: {mean}");
        }
        assert_eq!(orientations("random:9:4"), orientations("random:9:4"));
        assert_ne!(orientations("random:9:4"), orientations("random:9:5"));
        // The mean of uniform rotations is the zero matrix.
        let mean =
            orientations("so3:4000").iter().fold(DMat3::ZERO, |sum, o| sum + o.rotation()) * (1.0 / 4000.0);
        assert!(mean.to_cols_array().iter().all(|v| v.abs() < 0.01), "{mean:?}");
    }

    #[test]
    fn a_cone_stays_within_its_angle() {
        let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
        let cone = orientations("cone:1,-2,0.5:25:300");
        assert!(cone.len() == 300 && cone[0].direction().distance(axis) < 1e-12);
        for o in cone {
            assert!(o.direction().dot(axis) >= 25f64.to_radians().cos() - 1e-12);
        }
    }
}
