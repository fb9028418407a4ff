//! Real spherical harmonics, orthonormal over the unit sphere, and their gradients.
//!
//! Order: `l` ascending, `m` from −l to l; place `l² + l + m`. `Y_l0 = Q_l0`, `Y_lm = √2 Q_lm(z) Re (x + iy)^m` for
//! m > 0 and `√2 Q_l|m|(z) Im (x + iy)^|m|` for m < 0, with `Q_lm` the normalised associated Legendre function over
//! `sin^m`: a polynomial in z without the Condon-Shortley sign. In these terms nothing is singular at the poles, and
//! the recurrence in l is the stable one.

use std::f64::consts::{FRAC_1_PI, SQRT_2};

use glam::DVec3;
use imf_core::vectorised::vectorised;
use pulp::Arch;

use crate::siren::transpose::transpose;

/// Directions that are taken side by side: a side of the tiles of [`transpose`].
const TOGETHER: usize = 16;
/// Fewer are taken one by one.
const FEW: usize = 4;

/// Functions up to degree `degree`.
pub const fn function_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// Whether each function up to a degree, in their order, changes its sign where these of x, y and z change theirs.
pub(crate) fn all_that_change_sign(degree: usize, [x, y, z]: [bool; 3]) -> impl Iterator<Item = bool> {
    let of = move |l: i64, m: i64| (x && m % 2 != 0) ^ (z && (l + m) % 2 != 0) ^ (m < 0 && x != y);
    (0..=degree as i64).flat_map(move |l| (-l..=l).map(move |m| of(l, m)))
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
        self.values_side_by_side(&[direction], |place, [value]| values[place] = value);
    }

    /// All functions at several unit vectors: `take` gets the place of each function and its values.
    #[inline(always)]
    fn values_side_by_side<const N: usize>(
        &self,
        directions: &[DVec3; N],
        mut take: impl FnMut(usize, [f64; N]),
    ) {
        let z = directions.map(|direction| direction.z);
        // Re and Im of (x + iy)^m.
        let (mut cosine, mut sine) = ([1.0; N], [0.0; N]);
        for m in 0..=self.degree {
            let (mut before, mut value) = ([0.0; N], [self.sectoral[m]; N]);
            for l in m..=self.degree {
                if l > m {
                    let (a, b) = self.steps[l * (l + 1) / 2 + m];
                    let next = each(|lane| a * (z[lane] * value[lane] - b * before[lane]));
                    (before, value) = (value, next);
                }
                let middle = l * l + l;
                if m == 0 {
                    take(middle, value);
                } else {
                    let q = value.map(|value| SQRT_2 * value);
                    take(middle + m, each(|lane| q[lane] * cosine[lane]));
                    take(middle - m, each(|lane| q[lane] * sine[lane]));
                }
            }
            (cosine, sine) = turned(directions, &cosine, &sine);
        }
    }

    /// [`SphereBasis::values`] times a factor of any number of unit vectors, `[direction][function]`; `scratch` is working memory.
    pub(crate) fn values_of_all(
        &self,
        directions: &[DVec3],
        factor: f64,
        values: &mut [f32],
        scratch: &mut Vec<f32>,
    ) {
        let count = self.len();
        assert_eq!(values.len(), directions.len() * count, "{count} values of each direction");
        if directions.len() < FEW {
            for (direction, row) in directions.iter().zip(values.chunks_exact_mut(count)) {
                let take = |place, [value]: [f64; 1]| row[place] = (factor * value) as f32;
                self.values_side_by_side(&[*direction], take);
            }
            return;
        }
        let arch = Arch::new();
        scratch.resize(2 * TOGETHER * count, 0.0);
        // `[function][direction]`, and turned.
        let (columns, rows) = scratch.split_at_mut(TOGETHER * count);
        for (directions, values) in directions.chunks(TOGETHER).zip(values.chunks_mut(TOGETHER * count)) {
            let mut lanes = [DVec3::Z; TOGETHER];
            lanes[..directions.len()].copy_from_slice(directions);
            let places = columns.as_chunks_mut::<TOGETHER>().0;
            vectorised!(
                arch,
                self.values_side_by_side(&lanes, |place, found| {
                    places[place] = found.map(|value| (factor * value) as f32);
                })
            );
            transpose(columns, count, TOGETHER, rows);
            values.copy_from_slice(&rows[..values.len()]);
        }
    }

    /// At several unit vectors the sum of all functions, each by the weights that `weight` says of its place, and its gradient along the
    /// sphere: the derivative for a small turn of the direction, tangent to it. Functions of one m share what depends on x and y.
    #[inline(always)]
    pub fn sums_with_gradients<const N: usize>(
        &self,
        directions: &[DVec3; N],
        weight: impl Fn(usize) -> [f64; N],
    ) -> [(f64, DVec3); N] {
        let z = directions.map(|direction| direction.z);
        let (mut cosine, mut sine) = ([1.0; N], [0.0; N]);
        let (mut cosine_before, mut sine_before) = ([0.0; N], [0.0; N]);
        let mut found = [(0.0, DVec3::ZERO); N];
        for m in 0..=self.degree {
            let (mut before, mut value) = ([0.0; N], [self.sectoral[m]; N]);
            let (mut slope_before, mut slope) = ([0.0; N], [0.0; N]);
            // Of the functions with the cosine and with the sine: values and slopes in z.
            let (mut values, mut slopes) = ([[0.0; N]; 2], [[0.0; N]; 2]);
            for l in m..=self.degree {
                if l > m {
                    let (a, b) = self.steps[l * (l + 1) / 2 + m];
                    let next = each(|lane| a * (z[lane] * value[lane] - b * before[lane]));
                    let next_slope =
                        each(|lane| a * (value[lane] + z[lane] * slope[lane] - b * slope_before[lane]));
                    (before, value) = (value, next);
                    (slope_before, slope) = (slope, next_slope);
                }
                let middle = l * l + l;
                for (side, place) in [middle + m, middle - m].into_iter().enumerate() {
                    let weight = weight(place);
                    for lane in 0..N {
                        values[side][lane] += weight[lane] * value[lane];
                        slopes[side][lane] += weight[lane] * slope[lane];
                    }
                }
            }
            for (lane, (sum, gradient)) in found.iter_mut().enumerate() {
                if m == 0 {
                    (*sum, gradient.z) = (values[0][lane], slopes[0][lane]);
                    continue;
                }
                let ([c, s], turn) = (values.map(|v| SQRT_2 * v[lane]), m as f64);
                *sum += c * cosine[lane] + s * sine[lane];
                gradient.x += turn * (c * cosine_before[lane] + s * sine_before[lane]);
                gradient.y += turn * (s * cosine_before[lane] - c * sine_before[lane]);
                gradient.z += SQRT_2 * (slopes[0][lane] * cosine[lane] + slopes[1][lane] * sine[lane]);
            }
            (cosine_before, sine_before) = (cosine, sine);
            (cosine, sine) = turned(directions, &cosine, &sine);
        }
        each(|lane| {
            let (direction, (sum, gradient)) = (directions[lane], found[lane]);
            (sum, gradient - direction * gradient.dot(direction))
        })
    }

    /// [`SphereBasis::sums_with_gradients`] of any number of unit vectors, by `weights [direction][function]`; `scratch` is working
    /// memory.
    pub(crate) fn sums_of_all(
        &self,
        directions: &[DVec3],
        weights: &[f32],
        scratch: &mut Vec<f32>,
        mut take: impl FnMut(usize, (f64, DVec3)),
    ) {
        let count = self.len();
        assert_eq!(weights.len(), directions.len() * count, "{count} weights of each direction");
        let arch = Arch::new();
        scratch.resize(2 * TOGETHER * count, 0.0);
        let (columns, rows) = scratch.split_at_mut(TOGETHER * count);
        let blocks = directions.chunks(TOGETHER).zip(weights.chunks(TOGETHER * count));
        for (block, (directions, weights)) in blocks.enumerate() {
            let mut lanes = [DVec3::Z; TOGETHER];
            lanes[..directions.len()].copy_from_slice(directions);
            rows[..weights.len()].copy_from_slice(weights);
            transpose(rows, TOGETHER, count, columns);
            let places = columns.as_chunks::<TOGETHER>().0;
            let found =
                vectorised!(arch, self.sums_with_gradients(&lanes, |place| places[place].map(f64::from)));
            for (lane, found) in found.into_iter().take(directions.len()).enumerate() {
                take(block * TOGETHER + lane, found);
            }
        }
    }
}

/// A number of each lane.
#[inline(always)]
fn each<T, const N: usize>(of: impl FnMut(usize) -> T) -> [T; N] {
    std::array::from_fn(of)
}

/// Re and Im of (x + iy)^(m + 1) from those of (x + iy)^m.
#[inline(always)]
fn turned<const N: usize>(
    directions: &[DVec3; N],
    cosine: &[f64; N],
    sine: &[f64; N],
) -> ([f64; N], [f64; N]) {
    (
        each(|lane| directions[lane].x * cosine[lane] - directions[lane].y * sine[lane]),
        each(|lane| directions[lane].x * sine[lane] + directions[lane].y * cosine[lane]),
    )
}

#[cfg(test)]
mod tests;
