//! `U z` and `Uᵀ b` in one reading of U: the cost of one direction at a point.

use pulp::{Arch, Simd, WithSimd};

use crate::siren::lanes::{load, store};

/// `weights = U z` and `along = Uᵀ b` of `u` `[functions][components]`.
pub(crate) fn product_and_adjoint(
    arch: Arch,
    u: &[f32],
    z: &[f32],
    functions: &[f32],
    weights: &mut [f32],
    along: &mut [f32],
) {
    assert_eq!(u.len(), functions.len() * z.len(), "a row for each function, a column for each axis");
    assert_eq!((weights.len(), along.len()), (functions.len(), z.len()), "one result each");
    arch.dispatch(ProductAndAdjoint { u, z, functions, weights, along });
}

struct ProductAndAdjoint<'a> {
    u: &'a [f32],
    z: &'a [f32],
    functions: &'a [f32],
    weights: &'a mut [f32],
    along: &'a mut [f32],
}

/// Rows taken together, so that their sums hide each other's latency.
const ROWS: usize = 4;

impl ProductAndAdjoint<'_> {
    /// Some registers of columns, from column `first` on: their z and the sums of their `along` stay in registers. `WHOLE`
    /// ones are all within the columns: only loops without a way out for ends are unrolled, and take half the time.
    #[inline(always)]
    fn columns<S: Simd, const N: usize, const WHOLE: bool>(&mut self, simd: S, first: usize) {
        let components = self.z.len();
        let taken = (N * S::F32_LANES).min(components - first);
        let z: [S::f32s; N] = registers::<S, N, WHOLE>(simd, &self.z[first..][..taken]);
        let mut along = [simd.splat_f32s(0.0); N];
        let mut rows = self.u.chunks_exact(ROWS * components);
        let mut functions = self.functions.chunks_exact(ROWS);
        let mut weights = self.weights.chunks_exact_mut(ROWS);
        for ((rows, functions), weights) in rows.by_ref().zip(functions.by_ref()).zip(weights.by_ref()) {
            let mut sums = [simd.splat_f32s(0.0); ROWS];
            for row in 0..ROWS {
                let factor = simd.splat_f32s(functions[row]);
                let u = registers::<S, N, WHOLE>(simd, &rows[row * components + first..][..taken]);
                for place in 0..N {
                    sums[row] = simd.mul_add_e_f32s(u[place], z[place], sums[row]);
                    along[place] = simd.mul_add_e_f32s(u[place], factor, along[place]);
                }
            }
            for (weight, sum) in weights.iter_mut().zip(sums) {
                *weight += simd.reduce_sum_f32s(sum);
            }
        }
        let rest = rows.remainder().chunks_exact(components).zip(functions.remainder());
        for ((row, &function), weight) in rest.zip(weights.into_remainder()) {
            let factor = simd.splat_f32s(function);
            let u = registers::<S, N, WHOLE>(simd, &row[first..][..taken]);
            let mut sum = simd.splat_f32s(0.0);
            for place in 0..N {
                sum = simd.mul_add_e_f32s(u[place], z[place], sum);
                along[place] = simd.mul_add_e_f32s(u[place], factor, along[place]);
            }
            *weight += simd.reduce_sum_f32s(sum);
        }
        for (place, sum) in along.into_iter().enumerate() {
            store(simd, self.along, first + place * S::F32_LANES, sum);
        }
    }

    /// As [`Self::columns`]; returns the columns taken.
    #[inline(always)]
    fn group<S: Simd, const N: usize>(&mut self, simd: S, first: usize) -> usize {
        let taken = N * S::F32_LANES;
        if first + taken <= self.z.len() {
            self.columns::<S, N, true>(simd, first);
        } else {
            self.columns::<S, N, false>(simd, first);
        }
        taken
    }
}

/// A line in registers: `WHOLE` ones, or the last one filled up with zeros.
#[inline(always)]
fn registers<S: Simd, const N: usize, const WHOLE: bool>(simd: S, line: &[f32]) -> [S::f32s; N] {
    if WHOLE {
        let (whole, _) = S::as_simd_f32s(line);
        let whole = &whole[..N];
        std::array::from_fn(|place| whole[place])
    } else {
        std::array::from_fn(|place| load(simd, line, place * S::F32_LANES))
    }
}

impl WithSimd for ProductAndAdjoint<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.weights.fill(0.0);
        let components = self.z.len();
        let mut first = 0;
        while first < components {
            let left = (components - first) / S::F32_LANES;
            first += match left {
                8.. => self.group::<S, 8>(simd, first),
                4.. => self.group::<S, 4>(simd, first),
                _ => self.group::<S, 1>(simd, first),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::siren::lanes::archs;

    #[test]
    fn both_products_are_their_definitions() {
        for (functions, components) in [(1, 1), (9, 7), (81, 30), (50, 64), (67, 225), (289, 160)] {
            let filled = |length: usize, seed: usize| -> Vec<f32> {
                (0..length).map(|i| ((i * 37 + seed * 11) % 23) as f32 - 11.0).collect()
            };
            let (u, z, b) = (filled(functions * components, 1), filled(components, 2), filled(functions, 3));
            for arch in archs() {
                let (mut weights, mut along) = (vec![f32::NAN; functions], vec![f32::NAN; components]);
                product_and_adjoint(arch, &u, &z, &b, &mut weights, &mut along);
                // Small whole numbers: exact in any order.
                for (weight, row) in weights.iter().zip(u.chunks_exact(components)) {
                    assert_eq!(*weight, row.iter().zip(&z).map(|(u, z)| u * z).sum::<f32>());
                }
                for (axis, along) in along.iter().enumerate() {
                    let column = u[axis..].iter().step_by(components);
                    assert_eq!(*along, column.zip(&b).map(|(u, b)| u * b).sum::<f32>());
                }
            }
        }
    }
}
