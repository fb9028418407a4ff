//! Closed forms, integrals and differences.

use super::*;
use imf_core::orientation::{Orientation, OrientationSet};
use std::f64::consts::PI;

fn directions(set: &str) -> Vec<DVec3> {
    OrientationSet::parse(set).unwrap().orientations.iter().map(Orientation::direction).collect()
}

/// The sum of all functions by their weights, and its gradient.
fn weighted(basis: &SphereBasis, direction: DVec3, weight: impl Fn(usize) -> f64) -> (f64, DVec3) {
    let [found] = basis.sums_with_gradients(&[direction], |place| [weight(place)]);
    found
}

#[test]
fn low_degrees_have_their_closed_forms() {
    let d = DVec3::new(0.48, -0.6, 0.64);
    let basis = SphereBasis::new(2);
    let mut values = [0.0; 9];
    basis.values(d, &mut values);
    let DVec3 { x, y, z } = d;
    let c = |number: f64| (number / PI).sqrt();
    let expected = [
        0.5 * c(1.0),
        c(0.75) * y,
        c(0.75) * z,
        c(0.75) * x,
        0.5 * c(15.0) * x * y,
        0.5 * c(15.0) * y * z,
        0.25 * c(5.0) * (3.0 * z * z - 1.0),
        0.5 * c(15.0) * x * z,
        0.25 * c(15.0) * (x * x - y * y),
    ];
    for (place, (found, expected)) in values.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() < 1e-14, "function {place}: {found} against {expected}");
    }
}

#[test]
fn directions_side_by_side_have_the_values_of_each() {
    let basis = SphereBasis::new(9);
    let scratch = &mut Vec::new();
    for count in [1, TOGETHER, 21] {
        let directions = directions(&format!("random:{count}:5"));
        let mut all = vec![f32::NAN; count * basis.len()];
        basis.values_of_all(&directions, 3.0, &mut all, scratch);
        let mut values = vec![0.0; basis.len()];
        for (direction, row) in directions.iter().zip(all.chunks_exact(basis.len())) {
            basis.values(*direction, &mut values);
            assert!(row.iter().zip(&values).all(|(found, value)| *found == (3.0 * value) as f32));
        }
        // Any weights: the functions themselves.
        let mut asked = 0..count;
        basis.sums_of_all(&directions, &all, scratch, |index, found| {
            let weights = &all[index * basis.len()..];
            assert_eq!(asked.next(), Some(index));
            assert_eq!(found, weighted(&basis, directions[index], |place| f64::from(weights[place])));
        });
        assert_eq!(asked.next(), None);
    }
}

/// Gauss-Legendre in z by equal steps is not needed: an even spiral integrates to a few parts in a thousand, and the
/// addition theorem holds exactly at each point.
#[test]
fn squares_of_a_degree_add_up_at_every_direction_also_at_the_poles() {
    let degree = 40;
    let basis = SphereBasis::new(degree);
    let mut values = vec![0.0; basis.len()];
    let mut directions = directions("random:20:3");
    directions.extend([DVec3::Z, -DVec3::Z, DVec3::X, -DVec3::Y]);
    for d in directions {
        basis.values(d.normalize(), &mut values);
        for l in 0..=degree {
            let sum: f64 = values[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
            let expected = (2 * l + 1) as f64 / (4.0 * PI);
            assert!((sum / expected - 1.0).abs() < 1e-11, "degree {l} at {d}: {sum} against {expected}");
        }
    }
}

#[test]
fn the_functions_are_orthonormal() {
    let basis = SphereBasis::new(6);
    let n = 20_000;
    let mut gram = vec![0.0; basis.len() * basis.len()];
    let mut values = vec![0.0; basis.len()];
    for direction in directions(&format!("fibonacci:{n}")) {
        basis.values(direction, &mut values);
        for i in 0..basis.len() {
            for j in 0..basis.len() {
                gram[i * basis.len() + j] += values[i] * values[j] * 4.0 * PI / f64::from(n);
            }
        }
    }
    for i in 0..basis.len() {
        for j in 0..basis.len() {
            let expected = f64::from(u8::from(i == j));
            // The spiral's own error at 20,000 points.
            assert!((gram[i * basis.len() + j] - expected).abs() < 2e-3, "({i}, {j})");
        }
    }
}

#[test]
fn gradients_of_sums_are_central_differences_also_at_the_poles() {
    let basis = SphereBasis::new(12);
    let n = basis.len();
    let (mut values, mut ahead, mut behind) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let step = 1e-5;
    for d in [DVec3::Z, -DVec3::Z, DVec3::new(0.3, -0.5, 0.2).normalize(), DVec3::X] {
        basis.values(d, &mut values);
        let (u, v) = d.any_orthonormal_pair();
        for tangent in [u, v] {
            basis.values((d + tangent * step).normalize(), &mut ahead);
            basis.values((d - tangent * step).normalize(), &mut behind);
            for place in 0..n {
                let alone = |other: usize| f64::from(u8::from(other == place));
                let (value, gradient) = weighted(&basis, d, alone);
                let expected = (ahead[place] - behind[place]) / (2.0 * step);
                let found = gradient.dot(tangent);
                // Third derivatives of degree 12 are some 12³; times step².
                assert!((found - expected).abs() < 1e-6, "function {place} at {d}: {found}, {expected}");
                assert!(gradient.dot(d).abs() < 1e-10 && (value - values[place]).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn a_sum_is_that_of_its_functions() {
    for degree in [0, 1, 5, 20] {
        let basis = SphereBasis::new(degree);
        let mut values = vec![0.0; basis.len()];
        let weight = |place: usize| ((place * 37 + 11) % 23) as f64 - 11.0;
        for d in [DVec3::Z, -DVec3::Z, DVec3::X, DVec3::new(0.3, -0.5, 0.2).normalize()] {
            basis.values(d, &mut values);
            let (sum, slope) = weighted(&basis, d, weight);
            let (mut value, mut gradient) = (0.0, DVec3::ZERO);
            for (place, of_place) in values.iter().enumerate() {
                value += weight(place) * of_place;
                let alone = |other: usize| f64::from(u8::from(other == place));
                gradient += weight(place) * weighted(&basis, d, alone).1;
            }
            // Some hundred terms of up to a thousand in f64.
            assert!((sum - value).abs() < 1e-9, "degree {degree} at {d}: {sum}, {value}");
            assert!(slope.distance(gradient) < 1e-8, "degree {degree} at {d}: {slope}, {gradient}");
        }
    }
}
