//! Functions on SO(3): the matrices by which rotations turn real spherical harmonics.
//!
//! `Y_l(R d) = M^l(R) Y_l(d)`, with the real harmonics of [`super::sphere`]; `√(2l+1) M^l_mn` are orthonormal over the
//! rotations (mean square 1). They span what Wigner's D of degree l spans, in real numbers. Order: l ascending, then m
//! and n from −l to l.
//!
//! Source of the recurrence: J. Ivanic and K. Ruedenberg, J. Phys. Chem. 100 (1996) 6342, with the corrections of
//! 102 (1998) 9099.

use glam::DMat3;

/// Functions up to degree `degree`: (L+1)(2L+1)(2L+3)/3.
#[must_use]
pub const fn function_count(degree: usize) -> usize {
    (degree + 1) * (2 * degree + 1) * (2 * degree + 3) / 3
}

/// Writes `√(2l+1) M^l_mn(rotation)` for l = 0 to `degree`.
///
/// # Panics
/// If `values` has not the length [`function_count`].
pub fn rotation_functions(rotation: &DMat3, degree: usize, values: &mut [f64]) {
    assert_eq!(values.len(), function_count(degree), "one place for each function");
    // First the bare matrices, each made from the one before; the factors come last.
    values[0] = 1.0;
    let first = first_matrix(rotation);
    let mut start = 1;
    let mut before_start = 0;
    for l in 1..=degree as i64 {
        let size = (2 * l + 1) as usize;
        let (before, rest) = values.split_at_mut(start);
        let matrix = Matrix { l, first: &first, before: &before[before_start..] };
        for m in -l..=l {
            for n in -l..=l {
                rest[(m + l) as usize * size + (n + l) as usize] =
                    if l == 1 { first[(m + 1) as usize][(n + 1) as usize] } else { matrix.element(m, n) };
            }
        }
        before_start = start;
        start += size * size;
    }
    let mut start = 0;
    for l in 0..=degree {
        let size = 2 * l + 1;
        let factor = (size as f64).sqrt();
        values[start..start + size * size].iter_mut().for_each(|v| *v *= factor);
        start += size * size;
    }
}

/// M¹: the rotation itself in the order y, z, x.
fn first_matrix(rotation: &DMat3) -> [[f64; 3]; 3] {
    let axes = [1, 2, 0];
    axes.map(|row| axes.map(|column| rotation.col(column)[row]))
}

/// One degree of the recurrence.
struct Matrix<'a> {
    l: i64,
    first: &'a [[f64; 3]; 3],
    /// M^(l−1), bare.
    before: &'a [f64],
}

impl Matrix<'_> {
    fn one(&self, i: i64, j: i64) -> f64 {
        self.first[(i + 1) as usize][(j + 1) as usize]
    }

    fn less(&self, a: i64, b: i64) -> f64 {
        let l = self.l - 1;
        self.before[((a + l) * (2 * l + 1) + b + l) as usize]
    }

    /// The paper's P.
    fn product(&self, i: i64, a: i64, b: i64) -> f64 {
        let l = self.l;
        if b == -l {
            self.one(i, 1) * self.less(a, 1 - l) + self.one(i, -1) * self.less(a, l - 1)
        } else if b == l {
            self.one(i, 1) * self.less(a, l - 1) - self.one(i, -1) * self.less(a, 1 - l)
        } else {
            self.one(i, 0) * self.less(a, b)
        }
    }

    fn element(&self, m: i64, n: i64) -> f64 {
        let l = self.l;
        let size = m.abs();
        let divisor = if n.abs() < l { (l + n) * (l - n) } else { 2 * l * (2 * l - 1) } as f64;
        let root = |product: i64| (product as f64 / divisor).sqrt();
        let mut sum = 0.0;
        if size < l {
            sum += root((l + m) * (l - m)) * self.product(0, m, n);
        }
        if m == 0 {
            let v = -0.5 * root(2 * (l - 1) * l);
            return sum + v * (self.product(1, 1, n) + self.product(-1, -1, n));
        }
        let v = 0.5 * root((l + size - 1) * (l + size));
        let (toward, away) = if m > 0 {
            (self.product(1, m - 1, n), if m == 1 { 0.0 } else { -self.product(-1, 1 - m, n) })
        } else {
            (self.product(-1, -m - 1, n), if m == -1 { 0.0 } else { self.product(1, m + 1, n) })
        };
        sum += v * (if size == 1 { 2f64.sqrt() } else { 1.0 } * toward + away);
        if size < l - 1 {
            let w = -0.5 * root((l - size - 1) * (l - size));
            let pair = if m > 0 {
                self.product(1, m + 1, n) + self.product(-1, -m - 1, n)
            } else {
                self.product(1, m - 1, n) - self.product(-1, 1 - m, n)
            };
            sum += w * pair;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harmonic::sphere::SphereBasis;
    use crate::orientation::OrientationSet;

    #[test]
    fn they_turn_the_harmonics() {
        let degree = 9;
        let basis = SphereBasis::new(degree);
        let rotations = OrientationSet::parse("so3:7").unwrap().orientations;
        let directions = OrientationSet::parse("random:5:8").unwrap().orientations;
        let mut values = vec![0.0; function_count(degree)];
        let (mut here, mut there) = (vec![0.0; basis.len()], vec![0.0; basis.len()]);
        for o in &rotations {
            let rotation = o.rotation();
            rotation_functions(&rotation, degree, &mut values);
            for d in &directions {
                let d = d.direction().normalize();
                basis.values(d, &mut here);
                basis.values((rotation * d).normalize(), &mut there);
                let mut start = 0;
                for l in 0..=degree {
                    let size = 2 * l + 1;
                    for m in 0..size {
                        let row = &values[start + m * size..][..size];
                        let turned: f64 = row.iter().zip(&here[l * l..]).map(|(a, b)| a * b).sum();
                        let expected = there[l * l + m] * (size as f64).sqrt();
                        assert!((turned - expected).abs() < 1e-10, "l {l}, m {m}: {turned}, {expected}");
                    }
                    start += size * size;
                }
            }
        }
    }

    #[test]
    fn there_are_as_many_as_stated_and_their_mean_square_is_one() {
        assert_eq!((function_count(0), function_count(8), function_count(14)), (1, 969, 4495));
        let degree = 3;
        let mut sums = vec![0.0; function_count(degree)];
        let mut values = sums.clone();
        let set = OrientationSet::parse("so3:4000").unwrap().orientations;
        for o in &set {
            rotation_functions(&o.rotation(), degree, &mut values);
            sums.iter_mut().zip(&values).for_each(|(sum, v)| *sum += v * v / set.len() as f64);
        }
        for (place, mean) in sums.iter().enumerate() {
            // The spiral's own error at 4,000 rotations.
            assert!((mean - 1.0).abs() < 0.02, "function {place}: {mean}");
        }
    }
}
