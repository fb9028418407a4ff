//! Real spherical harmonics, orthonormal over the unit sphere, and their gradients.
//!
//! Order: `l` ascending, `m` from −l to l; place `l² + l + m`. `Y_l0 = Q_l0`, `Y_lm = √2 Q_lm(z) Re (x + iy)^m` for
//! m > 0 and `√2 Q_l|m|(z) Im (x + iy)^|m|` for m < 0, with `Q_lm` the normalised associated Legendre function over
//! `sin^m`: a polynomial in z without the Condon-Shortley sign. In these terms nothing is singular at the poles, and
//! the recurrence in l is the stable one.

use std::f64::consts::{FRAC_1_PI, SQRT_2};

use glam::DVec3;

/// Functions up to degree `degree`.
pub const fn function_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// Whether the functions of `cos mφ` and of `sin mφ` of a degree change their sign where these of x, y and z change theirs.
pub(crate) const fn change_sign(l: usize, m: usize, [x, y, z]: [bool; 3]) -> (bool, bool) {
    let by_x = x && m % 2 == 1;
    let by_z = z && (l + m) % 2 == 1;
    (by_x ^ by_z, x ^ by_x ^ y ^ by_z)
}

/// The same of every function up to a degree, in their order.
pub(crate) fn all_that_change_sign(degree: usize, coordinates: [bool; 3]) -> impl Iterator<Item = bool> {
    let of = move |l: usize, m: i64| {
        let (cosine, sine) = change_sign(l, m.unsigned_abs() as usize, coordinates);
        if m < 0 { sine } else { cosine }
    };
    (0..=degree).flat_map(move |l| (-(l as i64)..=l as i64).map(move |m| of(l, m)))
}

/// The harmonics up to a degree, with the constants of their recurrence.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereBasis {
    degree: usize,
    /// `Q_mm`, constants.
    sectoral: Vec<f64>,
    /// `(a, b)` of `Q_lm = a (z Q_(l−1)m − b Q_(l−2)m)` at place `l (l + 1)/2 + m`; unused where l = m.
    steps: Vec<(f64, f64)>,
}

impl SphereBasis {
    /// The harmonics of degrees 0 to `degree`.
    #[must_use]
    pub fn new(degree: usize) -> Self {
        let mut sectoral = vec![(0.25 * FRAC_1_PI).sqrt()];
        for m in 1..=degree {
            let m = m as f64;
            sectoral.push(sectoral[m as usize - 1] * ((2.0 * m + 1.0) / (2.0 * m)).sqrt());
        }
        let mut steps = Vec::with_capacity((degree + 1) * (degree + 2) / 2);
        for l in 0..=degree {
            for m in 0..=l {
                if m == l {
                    steps.push((0.0, 0.0));
                    continue;
                }
                let (l, m) = (l as f64, m as f64);
                let a = ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt();
                let before = (l - 1.0) * (l - 1.0);
                // Q_(m−1)m is zero, so b only matters from l = m + 2 on.
                let b = ((before - m * m).max(0.0) / (4.0 * before - 1.0).abs()).sqrt();
                steps.push((a, b));
            }
        }
        Self { degree, sectoral, steps }
    }

    /// Highest degree.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Number of functions, `(degree + 1)²`.
    pub fn len(&self) -> usize {
        function_count(self.degree)
    }

    /// Never: degree 0 already is one function.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// `Q_mm`.
    ///
    /// # Panics
    /// If m is beyond the degree.
    pub fn sectoral(&self, m: usize) -> f64 {
        self.sectoral[m]
    }

    /// `(a, b)` of `Q_lm = a (z Q_(l−1)m − b Q_(l−2)m)` for l > m.
    ///
    /// # Panics
    /// If l or m is beyond the degree.
    pub fn step(&self, l: usize, m: usize) -> (f64, f64) {
        self.steps[l * (l + 1) / 2 + m]
    }

    /// All functions at a unit vector into `values`.
    ///
    /// # Panics
    /// If `values` has not the length [`SphereBasis::len`].
    pub fn values(&self, direction: DVec3, values: &mut [f64]) {
        let DVec3 { x, y, z } = direction;
        // Re and Im of (x + iy)^m.
        let (mut cosine, mut sine) = (1.0, 0.0);
        for m in 0..=self.degree {
            let (mut before, mut value) = (0.0, self.sectoral[m]);
            for l in m..=self.degree {
                if l > m {
                    let (a, b) = self.steps[l * (l + 1) / 2 + m];
                    (before, value) = (value, a * (z * value - b * before));
                }
                let middle = l * l + l;
                if m == 0 {
                    values[middle] = value;
                } else {
                    let q = SQRT_2 * value;
                    (values[middle + m], values[middle - m]) = (q * cosine, q * sine);
                }
            }
            (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
        }
    }

    /// The sum of all functions, each by the weight that `weight` says of its place, and its gradient along the sphere: the
    /// derivative for a small turn of `direction`, tangent to it. Functions of one m share what depends on x and y.
    #[inline]
    pub fn sum_with_gradient(&self, direction: DVec3, weight: impl Fn(usize) -> f64) -> (f64, DVec3) {
        let DVec3 { x, y, z } = direction;
        let (mut cosine, mut sine) = (1.0, 0.0);
        let (mut cosine_before, mut sine_before) = (0.0, 0.0);
        let (mut sum, mut gradient) = (0.0, DVec3::ZERO);
        for m in 0..=self.degree {
            let (mut before, mut value) = (0.0, self.sectoral[m]);
            let (mut slope_before, mut slope) = (0.0, 0.0);
            // Of the functions with the cosine and with the sine: values and slopes in z.
            let (mut values, mut slopes) = ([0.0; 2], [0.0; 2]);
            for l in m..=self.degree {
                if l > m {
                    let (a, b) = self.steps[l * (l + 1) / 2 + m];
                    let next = a * (z * value - b * before);
                    let next_slope = a * (value + z * slope - b * slope_before);
                    (before, value) = (value, next);
                    (slope_before, slope) = (slope, next_slope);
                }
                let middle = l * l + l;
                for (side, place) in [middle + m, middle - m].into_iter().enumerate() {
                    values[side] += weight(place) * value;
                    slopes[side] += weight(place) * slope;
                }
            }
            if m == 0 {
                (sum, gradient.z) = (values[0], slopes[0]);
            } else {
                let ([c, s], turn) = (values.map(|v| SQRT_2 * v), m as f64);
                sum += c * cosine + s * sine;
                gradient.x += turn * (c * cosine_before + s * sine_before);
                gradient.y += turn * (s * cosine_before - c * sine_before);
                gradient.z += SQRT_2 * (slopes[0] * cosine + slopes[1] * sine);
            }
            (cosine_before, sine_before) = (cosine, sine);
            (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
        }
        (sum, gradient - direction * gradient.dot(direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::orientation::{Orientation, OrientationSet};
    use std::f64::consts::PI;

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

    /// Gauss-Legendre in z by equal steps is not needed: an even spiral integrates to a few parts in a thousand, and the
    /// addition theorem holds exactly at each point.
    #[test]
    fn squares_of_a_degree_add_up_at_every_direction_also_at_the_poles() {
        let degree = 40;
        let basis = SphereBasis::new(degree);
        let mut values = vec![0.0; basis.len()];
        let mut directions: Vec<DVec3> = OrientationSet::parse("random:20:3")
            .unwrap()
            .orientations
            .iter()
            .map(Orientation::direction)
            .collect();
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
        let set = OrientationSet::parse(&format!("fibonacci:{n}")).unwrap();
        let mut gram = vec![0.0; basis.len() * basis.len()];
        let mut values = vec![0.0; basis.len()];
        for o in &set.orientations {
            basis.values(o.direction(), &mut values);
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
                    let (value, gradient) = basis.sum_with_gradient(d, alone);
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
                let (sum, slope) = basis.sum_with_gradient(d, weight);
                let (mut value, mut gradient) = (0.0, DVec3::ZERO);
                for (place, of_place) in values.iter().enumerate() {
                    value += weight(place) * of_place;
                    let alone = |other: usize| f64::from(u8::from(other == place));
                    gradient += weight(place) * basis.sum_with_gradient(d, alone).1;
                }
                // Some hundred terms of up to a thousand in f64.
                assert!((sum - value).abs() < 1e-9, "degree {degree} at {d}: {sum}, {value}");
                assert!(slope.distance(gradient) < 1e-8, "degree {degree} at {d}: {slope}, {gradient}");
            }
        }
    }
}
