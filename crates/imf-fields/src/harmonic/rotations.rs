//! Functions on SO(3): the matrices by which rotations turn real spherical harmonics, and how they change with the rotation.
//!
//! `Y_l(R d) = M^l(R) Y_l(d)`, with the real harmonics of [`super::sphere`]; `√(2l+1) M^l_mn` are orthonormal over the
//! rotations (mean square 1). They span what Wigner's D of degree l spans, in real numbers. Order: l ascending, then m
//! and n from −l to l.
//!
//! Of a unit quaternion (x, y, z, w) let `A = w + iz`, `B = y − ix` and `c = |A|² − |B|²`. For m ≥ n ≥ 0 the four functions
//! ±m, ±n of a degree are sums of the parts of `f_l(c) A^(m+n) B^(m−n)` and `g_l(c) A^(m−n) B^(m+n)`; those with m and n
//! exchanged have the same f and g. Both are Wigner's d over its half angles' powers: polynomials in c, by the recurrence in
//! l, so that nothing is singular where Euler's angles are. Source: D. A. Varshalovich, A. N. Moskalev, V. K. Khersonskii,
//! Quantum Theory of Angular Momentum (1988), chapter 4.

use gemm::c64 as Complex64;
use glam::{DQuat, DVec3};

/// Functions up to degree `degree`: (L+1)(2L+1)(2L+3)/3.
pub const fn function_count(degree: usize) -> usize {
    (degree + 1) * (2 * degree + 1) * (2 * degree + 3) / 3
}

/// Where the functions of a degree begin.
const fn start(l: usize) -> usize {
    (4 * l * l * l - l) / 3
}

/// The functions up to a degree, with the constants of their recurrence.
#[derive(Clone, Debug, PartialEq)]
pub struct RotationBasis {
    degree: usize,
    steps: Vec<Step>,
}

/// `f_l = a ((c − b) f_(l−1) − e f_(l−2))`, and `g_l` with c + b. Where l = m, `a` is what both begin with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Factor of all, or the beginning.
    pub a: f64,
    /// What is taken from c.
    pub b: f64,
    /// Factor of the one before.
    pub e: f64,
}

/// The pairs m ≥ n ≥ 0 up to a degree, as their sum s and difference t: the order of the recurrences.
fn pairs(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..=2 * degree).flat_map(move |s| (s % 2..=s.min(2 * degree - s)).step_by(2).map(move |t| (s, t)))
}

impl Step {
    fn new(l: usize, m: usize, n: usize) -> Self {
        let [l, m, n] = [l, m, n].map(|number| number as f64);
        let left = |l: f64| ((l * l - m * m) * (l * l - n * n)).sqrt();
        let before = l - 1.0;
        Self {
            a: l * (4.0 * l * l - 1.0).sqrt() / left(l),
            b: if n > 0.0 { m * n / (before * l) } else { 0.0 },
            // f_(m−1) is zero, and so is what comes before degree 0.
            e: if before > m { left(before) / (before * (4.0 * before * before - 1.0).sqrt()) } else { 0.0 },
        }
    }

    /// Where the recurrence of a pair begins, at l = m: √((2m+1)·(2m over m+n)).
    fn first(m: usize, n: usize) -> Self {
        let binomial: f64 = (1..=m - n).map(|k| (m + n + k) as f64 / k as f64).product();
        // Two functions of four where one number is 0, one where both are; f and g are the same there, and add up.
        let share = match (m, n) {
            (0, _) => 0.25,
            (_, 0) => 0.5,
            _ => 1.0,
        };
        Self { a: ((2 * m + 1) as f64 * binomial * share).sqrt(), b: 0.0, e: 0.0 }
    }
}

impl RotationBasis {
    /// The functions of degrees 0 to `degree`.
    #[must_use]
    pub fn new(degree: usize) -> Self {
        let mut steps = Vec::new();
        for (s, t) in pairs(degree) {
            let (m, n) = (s.midpoint(t), (s - t) / 2);
            steps.push(Step::first(m, n));
            steps.extend((m + 1..=degree).map(|l| Step::new(l, m, n)));
        }
        Self { degree, steps }
    }

    /// Highest degree.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        function_count(self.degree)
    }

    /// Never: degree 0 already is one function.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The recurrences' constants in the order in which they are used: s = m + n ascending, then t = m − n, then l from m on.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// All functions at a rotation, a quaternion of length 1.
    ///
    /// # Panics
    /// If `values` has not the length [`RotationBasis::len`].
    pub fn values(&self, rotation: DQuat, values: &mut [f64]) {
        assert_eq!(values.len(), self.len(), "one place for each function");
        let (a, b) = (Complex64::new(rotation.w, rotation.z), Complex64::new(rotation.y, -rotation.x));
        let c = a.norm_sqr() - b.norm_sqr();
        let sign = |number: usize| if number.is_multiple_of(2) { 1.0 } else { -1.0 };
        let one = Complex64::new(1.0, 0.0);
        // A and B to the powers s and t.
        let (mut a_s, mut b_s, mut a_t, mut b_t) = (one, one, one, one);
        let mut steps = &self.steps[..];
        let mut sum = 0;
        for (s, t) in pairs(self.degree) {
            if s != sum {
                (sum, a_s, b_s) = (s, a_s * a, b_s * b);
            }
            (a_t, b_t) = match t {
                0 => (one, one),
                1 => (a, b),
                _ => (a_t * a * a, b_t * b * b),
            };
            let (m, n) = (s.midpoint(t), (s - t) / 2);
            let here = [a_s * b_t, a_t * b_s * sign(n)];
            let exchanged = [a_s * b_t.conj() * sign(t), a_t.conj() * b_s * sign(m)];
            let (own, rest) = steps.split_at(self.degree + 1 - m);
            let ([mut f, mut g], [mut f_before, mut g_before]) = ([own[0].a; 2], [0.0; 2]);
            for (l, step) in (m..).zip(own) {
                if l > m {
                    let Step { a, b, e } = *step;
                    (f, f_before) = (a * ((c - b) * f - e * f_before), f);
                    (g, g_before) = (a * ((c + b) * g - e * g_before), g);
                }
                put(values, l, [m, n], here, [f, g]);
                if m != n {
                    put(values, l, [n, m], exchanged, [f, g]);
                }
            }
            steps = rest;
        }
    }
}

/// The functions ±m, ±n of a degree.
#[inline(always)]
fn put(values: &mut [f64], l: usize, [m, n]: [usize; 2], powers: [Complex64; 2], [f, g]: [f64; 2]) {
    let size = 2 * l + 1;
    let own = &mut values[start(l)..][..size * size];
    let (f, g) = (powers[0] * f, powers[1] * g);
    own[(l + m) * size + l + n] = f.re + g.re;
    if n > 0 {
        own[(l + m) * size + l - n] = g.im - f.im;
    }
    if m > 0 {
        own[(l - m) * size + l + n] = f.im + g.im;
    }
    if m > 0 && n > 0 {
        own[(l - m) * size + l - n] = f.re - g.re;
    }
}

/// The sum of functions by their `weights`, of the functions' values at a rotation, and how it changes as the rotation is turned
/// about the axes of the world, by a radian.
///
/// A turn acts on the rows of the matrices alone, by the angular momentum in real harmonics: about z it exchanges ±m, about x and
/// y it takes m to its neighbours.
///
/// # Panics
/// If a slice has not the length of [`function_count`].
#[inline(always)]
pub fn sum_with_turns(degree: usize, values: &[f64], weights: &[f32]) -> (f64, DVec3) {
    let count = function_count(degree);
    assert_eq!((values.len(), weights.len()), (count, count), "one number for each function");
    let (mut sum, mut turns) = (0.0, DVec3::ZERO);
    for l in 0..=degree {
        let size = 2 * l + 1;
        let row = |order: usize| {
            let own = start(l) + order * size..start(l) + (order + 1) * size;
            (&values[own.clone()], &weights[own])
        };
        // Rows of the cosine and of the sine of m times the angle, and the same of m − 1.
        let (mut cosines_before, mut sines_before) = (row(l), row(l));
        sum += products(cosines_before.0, cosines_before.1);
        for m in 1..=l {
            let (cosines, sines) = (row(l + m), row(l - m));
            sum += products(cosines.0, cosines.1) + products(sines.0, sines.1);
            turns.z += m as f64 * (products(cosines.0, sines.1) - products(sines.0, cosines.1));
            let twice = if m == 1 { 2.0 } else { 1.0 };
            let by = 0.5 * (twice * ((l + m) * (l - m + 1)) as f64).sqrt();
            let across = |from: (&[f64], &[f32]), to: (&[f64], &[f32])| {
                by * (products(from.0, to.1) - products(to.0, from.1))
            };
            turns.y += across(cosines_before, cosines);
            turns.x += across(sines, cosines_before);
            if m > 1 {
                turns.y += across(sines_before, sines);
                turns.x += across(sines_before, cosines);
            }
            (cosines_before, sines_before) = (cosines, sines);
        }
    }
    (sum, turns)
}

#[inline(always)]
fn products(values: &[f64], weights: &[f32]) -> f64 {
    values.iter().zip(weights).map(|(value, &weight)| value * f64::from(weight)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harmonic::sphere::SphereBasis;
    use imf_core::orientation::{Orientation, OrientationSet};

    fn rotations(spec: &str) -> Vec<DQuat> {
        let mut all: Vec<DQuat> =
            OrientationSet::parse(spec).unwrap().orientations.iter().map(Orientation::quaternion).collect();
        // Where Euler's angles are singular: no turn, half turns, the exchange of axes.
        let half = 0.5;
        all.extend([
            DQuat::IDENTITY,
            DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            DQuat::from_xyzw(0.0, -1.0, 0.0, 0.0),
            DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0),
            DQuat::from_xyzw(half, half, -half, half),
            DQuat::from_rotation_y(1e-9),
        ]);
        all
    }

    #[test]
    fn they_turn_the_harmonics() {
        let degree = 24;
        let (sphere, basis) = (SphereBasis::new(degree), RotationBasis::new(degree));
        let directions = OrientationSet::parse("random:5:8").unwrap().orientations;
        let mut values = vec![f64::NAN; function_count(degree)];
        let (mut here, mut there) = (vec![0.0; sphere.len()], vec![0.0; sphere.len()]);
        for rotation in rotations("so3:9") {
            basis.values(rotation, &mut values);
            for d in &directions {
                let d = d.direction().normalize();
                sphere.values(d, &mut here);
                sphere.values((rotation * d).normalize(), &mut there);
                let mut start = 0;
                for l in 0..=degree {
                    let size = 2 * l + 1;
                    for m in 0..size {
                        let row = &values[start + m * size..][..size];
                        let turned: f64 = row.iter().zip(&here[l * l..]).map(|(a, b)| a * b).sum();
                        let expected = there[l * l + m] * (size as f64).sqrt();
                        // Some steps of f64 a degree.
                        assert!((turned - expected).abs() < 1e-11, "l {l}, m {m}: {turned}, {expected}");
                    }
                    start += size * size;
                }
            }
        }
    }

    #[test]
    fn a_sum_changes_by_its_turns() {
        for degree in [0, 1, 2, 7, 12] {
            let basis = RotationBasis::new(degree);
            let mut values = vec![0.0; basis.len()];
            let weights: Vec<f32> = (0..basis.len()).map(|k| ((k * 37 + 11) % 23) as f32 - 11.0).collect();
            let mut sum = |rotation: DQuat| {
                basis.values(rotation, &mut values);
                sum_with_turns(degree, &values, &weights)
            };
            let angle = 1e-5;
            for rotation in rotations("so3:20") {
                let (_, turns) = sum(rotation);
                let scale: f64 = weights.iter().map(|&w| f64::from(w).abs()).sum();
                for (axis, found) in DVec3::AXES.into_iter().zip(turns.to_array()) {
                    let mut turned =
                        |angle: f64| sum((DQuat::from_axis_angle(axis, angle) * rotation).normalize()).0;
                    let expected = (turned(angle) - turned(-angle)) / (2.0 * angle);
                    // Third derivatives of degree 12 are some 12³; times a sixth of the angle squared; and rounding.
                    assert!(
                        (found - expected).abs() <= 1e-7 * scale,
                        "degree {degree}, {rotation} about {axis}: {found}, {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn there_are_as_many_as_stated_and_their_mean_square_is_one() {
        assert_eq!((function_count(0), function_count(8), function_count(14)), (1, 969, 4495));
        assert!((0..20).all(|l| start(l + 1) == function_count(l)) && start(0) == 0);
        let basis = RotationBasis::new(3);
        let mut sums = vec![0.0; basis.len()];
        let mut values = sums.clone();
        let set = OrientationSet::parse("so3:4000").unwrap().orientations;
        for o in &set {
            basis.values(o.quaternion(), &mut values);
            sums.iter_mut().zip(&values).for_each(|(sum, v)| *sum += v * v / set.len() as f64);
        }
        for (place, mean) in sums.iter().enumerate() {
            // The spiral's own error at 4,000 rotations.
            assert!((mean - 1.0).abs() < 0.02, "function {place}: {mean}");
        }
    }
}
