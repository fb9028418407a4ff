//! Sections between sections: exact sections stored at a set of angles, and what lies between them by interpolation.
//! The simplest estimate at an orientation that was not counted, and what any learnt field has to beat.
//!
//! [`Periodic`] continues values at equal steps of one full turn, as weights of these values. [`grid_weights`] does so
//! over the `grid:N` of angle pairs: bilinear in θ and φ, periodic in θ; beyond the last φ, which lies one step before 180°,
//! over the pole to the opposite meridian. [`SectionTable`] holds sections at these pairs.

mod section_table;

pub(crate) use section_table::SectionTable;

use imf_core::orientation::Orientation;
use nalgebra::{DMatrix, DVector};

/// Weights below this are left out: an angle on a step of the grid has one weight, whatever the rounding.
const NO_WEIGHT: f64 = 1e-9;

/// How values at equal steps of a full turn are continued between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Periodic {
    /// Straight lines.
    Linear,
    /// Cubic pieces with two continuous derivatives all around.
    CubicSpline,
    /// The trigonometric polynomial of lowest degree; of an even number of values the highest one as a cosine.
    Trigonometric,
}

impl Periodic {
    /// Weights `[count]` of the values at 360°·i/count, i from 0, for the value at `degrees`.
    ///
    /// # Panics
    /// If there are fewer than three values.
    pub(crate) fn weights(self, count: usize, degrees: f64) -> Vec<f64> {
        assert!(count >= 3, "a turn in at least three steps");
        let place = (degrees / 360.0).rem_euclid(1.0) * count as f64;
        let (first, rest) = ((place.floor() as usize).min(count - 1), place - place.floor());
        let second = (first + 1) % count;
        let mut weights = vec![0.0; count];
        match self {
            Self::Linear => {
                weights[first] = 1.0 - rest;
                weights[second] += rest;
            }
            Self::CubicSpline => spline(&mut weights, first, second, rest),
            Self::Trigonometric => {
                for (index, weight) in weights.iter_mut().enumerate() {
                    *weight = cardinal(count, (place - index as f64) / count as f64);
                }
            }
        }
        weights
    }
}

/// With unit steps and second derivatives M, the piece from y₀ to y₁ is
/// `(1−t)y₀ + t·y₁ + ((1−t)³−(1−t))/6·M₀ + (t³−t)/6·M₁`, and `M₋ + 4M + M₊ = 6(y₋ − 2y + y₊)` all around. Both cyclic
/// matrices are symmetric, so the weights need one solution whatever the values are.
fn spline(weights: &mut [f64], first: usize, second: usize, t: f64) {
    let count = weights.len();
    let around = |index: usize| [(index + count - 1) % count, (index + 1) % count];
    let mut matrix = DMatrix::zeros(count, count);
    for row in 0..count {
        matrix[(row, row)] = 4.0;
        for column in around(row) {
            matrix[(row, column)] += 1.0;
        }
    }
    let mut right = DVector::zeros(count);
    let s = 1.0 - t;
    right[first] += (s * s * s - s) / 6.0;
    right[second] += (t * t * t - t) / 6.0;
    // The diagonal outweighs the rest of each row: the matrix has an inverse.
    let solution = matrix.lu().solve(&right).unwrap_or(right);
    for index in 0..count {
        let [before, after] = around(index);
        weights[index] = 6.0 * (solution[before] - 2.0 * solution[index] + solution[after]);
    }
    weights[first] += s;
    weights[second] += t;
}

/// The trigonometric polynomial through 1 at 0 and 0 at the other `count − 1` steps; `turns` is the angle in full turns.
fn cardinal(count: usize, turns: f64) -> f64 {
    let half = std::f64::consts::PI * turns;
    let n = count as f64;
    if half.sin().abs() < 1e-12 {
        return 1.0;
    }
    let denominator = if count.is_multiple_of(2) { half.tan() } else { half.sin() };
    (n * half).sin() / (n * denominator)
}

/// Which sections of `grid:n`, θ = 360°·i/n, φ = 180°·j/n, θ outermost, make up the one at `orientation`, and with which
/// weights; these sum to 1.
///
/// # Panics
/// If n is below 3.
fn grid_weights(n: usize, orientation: &Orientation) -> Vec<(usize, f64)> {
    let place = orientation.phi / 180.0 * n as f64;
    let row = (place.floor() as usize).min(n - 1);
    let theta = orientation.theta;
    let rows = if row + 1 < n {
        let t = place - row as f64;
        [(row, theta, 1.0 - t), (row + 1, theta, t)]
    } else {
        // Two steps from the last row over the pole to the same row of the opposite meridian.
        let t = (place - row as f64) / 2.0;
        [(row, theta, 1.0 - t), (row, theta + 180.0, t)]
    };
    let mut all = Vec::with_capacity(4);
    for (row, theta, weight) in rows {
        for (column, share) in Periodic::Linear.weights(n, theta).into_iter().enumerate() {
            if weight * share > NO_WEIGHT {
                all.push((column * n + row, weight * share));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use imf_core::orientation::OrientationSet;

    use super::*;

    const ALL: [Periodic; 3] = [Periodic::Linear, Periodic::CubicSpline, Periodic::Trigonometric];

    fn value(kind: Periodic, count: usize, degrees: f64, f: impl Fn(f64) -> f64) -> f64 {
        let weights = kind.weights(count, degrees);
        weights.iter().enumerate().map(|(i, w)| w * f(360.0 * i as f64 / count as f64)).sum()
    }

    #[test]
    fn every_kind_goes_through_its_values_and_keeps_constants() {
        for kind in ALL {
            for count in [3, 4, 9, 36] {
                for index in 0..=count {
                    let weights = kind.weights(count, 360.0 * index as f64 / count as f64);
                    for (other, weight) in weights.iter().enumerate() {
                        let expected = f64::from(u8::from(other == index % count));
                        assert!(
                            (weight - expected).abs() < 1e-9,
                            "{kind:?} {count} {index} {other}: {weight}"
                        );
                    }
                }
                for degrees in [0.1, 17.3, 123.4, 359.9, -20.0] {
                    let sum: f64 = kind.weights(count, degrees).iter().sum();
                    assert!((sum - 1.0).abs() < 1e-9, "{kind:?} {count} {degrees}: {sum}");
                }
            }
        }
    }

    #[test]
    fn a_trigonometric_polynomial_is_met_everywhere() {
        let f = |degrees: f64| {
            let a = degrees.to_radians();
            0.3 + a.cos() - 0.7 * (2.0 * a).sin() + 0.2 * (4.0 * a).cos()
        };
        for count in [9, 10] {
            for degrees in [1.0, 47.11, 200.5, 359.0] {
                let met = value(Periodic::Trigonometric, count, degrees, f);
                assert!((met - f(degrees)).abs() < 1e-9, "{count} values at {degrees}°: {met}");
            }
        }
    }

    #[test]
    fn linear_errs_as_the_square_of_the_step_and_a_spline_as_its_fourth_power() {
        let f = |degrees: f64| degrees.to_radians().sin();
        let error = |kind, count: usize| {
            (0..400)
                .map(|i| 0.9 * f64::from(i))
                .map(|d| (value(kind, count, d, f) - f(d)).abs())
                .fold(0.0, f64::max)
        };
        // Halving the step divides the error by 4 and by 16, up to higher orders.
        let ratio = |kind| error(kind, 18) / error(kind, 36);
        assert!((3.7..4.3).contains(&ratio(Periodic::Linear)), "{}", ratio(Periodic::Linear));
        assert!((14.5..17.5).contains(&ratio(Periodic::CubicSpline)), "{}", ratio(Periodic::CubicSpline));
    }

    #[test]
    fn pairs_of_the_grid_stand_for_themselves_and_others_for_their_neighbours() {
        let weights = |orientation: &Orientation| grid_weights(15, orientation);
        let set = OrientationSet::parse("grid:15").unwrap().orientations;
        for (index, orientation) in set.iter().enumerate() {
            let weights = weights(orientation);
            let own = weights.iter().find(|(other, _)| *other == index).unwrap();
            assert!((own.1 - 1.0).abs() < 1e-9 && weights.len() == 1, "{orientation:?}: {weights:?}");
        }
        // (12°, 6°): half way between θ = 0° and 24° and between φ = 0° and 12°.
        let mut between = weights(&Orientation::new(12.0, 6.0));
        between.sort_by_key(|w| w.0);
        let places: Vec<usize> = between.iter().map(|w| w.0).collect();
        assert_eq!(places, [0, 1, 15, 16]);
        assert!(between.iter().all(|(_, weight)| (weight - 0.25).abs() < 1e-12));
        // Across θ = 360°, and over the pole: at φ = 180° both sides count half, whatever θ is.
        assert!(weights(&Orientation::new(350.0, 12.0)).iter().any(|(index, _)| *index == 1));
        let pole = weights(&Orientation::new(24.0, 180.0));
        let share = |column: usize| pole.iter().filter(|w| w.0 == column * 15 + 14).map(|w| w.1).sum::<f64>();
        assert!(
            (share(1) - 0.5).abs() < 1e-9 && (share(8) - 0.25).abs() < 1e-9 && (share(9) - 0.25).abs() < 1e-9
        );
        for orientation in OrientationSet::parse("random:50:3").unwrap().orientations {
            let sum: f64 = weights(&orientation).iter().map(|w| w.1).sum();
            assert!((sum - 1.0).abs() < 1e-6);
        }
    }
}
