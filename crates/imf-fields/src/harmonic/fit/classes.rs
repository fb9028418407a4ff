//! The fit class by class, where all functions of directions are kept.
//!
//! With the set in fours, `z = W t − μ`: t are a class's sums and differences of the four images' values, a quarter as
//! many as sections, and W is `(G + R)⁻¹ Bᵀ` of that class's functions alone. Both halves of the work, products and solving,
//! are as those of a quarter of the functions. The twin is the fit in two passes, which knows nothing of classes.

use nalgebra::DMatrix;
use pulp::Arch;

use super::kept::KeptSections;
use super::solve::{factored, ridge};
use super::source::UNIT;
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::Basis;
use crate::harmonic::fours::{IMAGES, classes};
use crate::siren::matrix::{Matrix, multiply};
use imf_core::orientation::Orientation;
use imf_core::vectorised::vectorised;

/// The functions of directions up to a degree, of each class.
fn by_class(degree: usize) -> [Vec<usize>; IMAGES] {
    let mut all = [const { Vec::new() }; IMAGES];
    for (function, class) in classes(degree).into_iter().enumerate() {
        all[class].push(function);
    }
    all
}

/// The same, one class after the other: the axes where all functions are kept.
pub(super) fn class_order(degree: usize) -> Vec<usize> {
    by_class(degree).concat()
}

/// What turns sections to coefficients.
pub(super) struct ClassWeights {
    /// Directions, without their images.
    directions: usize,
    /// The function that each axis is: those of class 0 first.
    pub(super) order: Vec<usize>,
    /// W of every class, `[direction][function of the class]`, for values in [`UNIT`]s.
    weights: [Vec<f32>; IMAGES],
}

impl ClassWeights {
    /// For functions of directions and the set that they are fitted to.
    pub(super) fn new(basis: &Basis, set: &[Orientation]) -> Result<Self, HarmonicError> {
        let (directions, functions) = (set.len() / IMAGES, basis.len());
        let mut values = DMatrix::zeros(functions, directions);
        for (mut column, fours) in values.column_iter_mut().zip(set.chunks_exact(IMAGES)) {
            basis.values(&fours[0], column.as_mut_slice());
        }
        let ridge = ridge(basis);
        let mut weights = [const { Vec::new() }; IMAGES];
        for (own, weights) in by_class(basis.degree()).iter().zip(&mut weights) {
            if own.is_empty() {
                continue;
            }
            let values = values.select_rows(own);
            let gram = || &values * values.transpose() * IMAGES as f64;
            let ridge: Vec<f64> = own.iter().map(|&function| ridge[function]).collect();
            let solved = factored(gram, &ridge)?.solve(&values);
            // Column by column: each direction's weights side by side.
            *weights = solved.iter().map(|&w| w as f32 * UNIT).collect();
        }
        Ok(Self { directions, order: class_order(basis.degree()), weights })
    }

    /// Adds to the coefficients `z` `[voxel][axis]` of a block of voxels what its sections say; `sums` is working memory.
    pub(super) fn add(
        &self,
        arch: Arch,
        sections: &KeptSections,
        block: usize,
        z: &mut [f32],
        sums: &mut Vec<f32>,
    ) {
        let functions = self.order.len();
        let voxels = z.len() / functions;
        let part = self.directions * voxels;
        sums.resize(IMAGES * part, 0.0);
        let mut parts = sums.chunks_exact_mut(part);
        let mut rows: [_; IMAGES] =
            std::array::from_fn(|_| parts.next().unwrap_or_default().chunks_exact_mut(voxels));
        for four in sections.block(block) {
            let mut images = four.chunks_exact(voxels);
            let images: [&[u16]; IMAGES] = std::array::from_fn(|_| images.next().unwrap_or_default());
            let sums: [&mut [f32]; IMAGES] =
                std::array::from_fn(|class| rows[class].next().unwrap_or_default());
            vectorised!(arch, add_and_subtract(images, sums));
        }
        let mut axis = 0;
        for (weights, sums) in self.weights.iter().zip(sums.chunks_exact(part)) {
            let own = weights.len() / self.directions;
            if own == 0 {
                continue;
            }
            multiply(
                &mut z[axis..],
                functions,
                Matrix::row_major(sums, self.directions, voxels, voxels).transposed(),
                Matrix::row_major(weights, self.directions, own, own),
                true,
            );
            axis += own;
        }
    }
}

/// The sums of four images' values with each class's signs.
#[inline(always)]
fn add_and_subtract([a, b, c, d]: [&[u16]; IMAGES], [s0, s1, s2, s3]: [&mut [f32]; IMAGES]) {
    let count = a.len();
    let (b, c, d) = (&b[..count], &c[..count], &d[..count]);
    let (s0, s1, s2, s3) = (&mut s0[..count], &mut s1[..count], &mut s2[..count], &mut s3[..count]);
    for place in 0..count {
        let [a, b, c, d] = [a[place], b[place], c[place], d[place]].map(i32::from);
        s0[place] = (a + b + c + d) as f32;
        s1[place] = (a - b - c + d) as f32;
        s2[place] = (a + b - c - d) as f32;
        s3[place] = (a - b + c - d) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harmonic::basis::Domain;
    use crate::harmonic::fit::kept::KEPT_BLOCK;
    use crate::harmonic::fours::SIGNS;

    impl ClassWeights {
        /// The coefficients of one voxel from its values, `[orientation]`, in [`UNIT`]s: the definition.
        fn of_values(&self, values: &[f64]) -> Vec<f64> {
            let mut z = Vec::with_capacity(self.order.len());
            for (signs, weights) in SIGNS.iter().zip(&self.weights) {
                let own = weights.len() / self.directions;
                let from = z.len();
                z.resize(from + own, 0.0);
                for (images, row) in values.chunks_exact(IMAGES).zip(weights.chunks_exact(own.max(1))) {
                    let sum: f64 = images.iter().zip(signs).map(|(value, sign)| value * sign).sum();
                    z[from..].iter_mut().zip(row).for_each(|(z, &weight)| *z += sum * f64::from(weight));
                }
            }
            z
        }
    }

    #[test]
    fn blocks_of_voxels_have_the_coefficients_of_their_definition() {
        let basis = Basis::new(Domain::Directions, 3);
        let set = basis.fitted_set(20).unwrap();
        let weights = ClassWeights::new(&basis, &set).unwrap();
        let mut order = weights.order.clone();
        order.sort_unstable();
        assert_eq!(order, (0..16).collect::<Vec<_>>());
        // The last block is short.
        let (voxels, first) = (KEPT_BLOCK + 37, KEPT_BLOCK);
        let values: Vec<u16> = (0..set.len() * voxels).map(|i| (i * 7919 % 65536) as u16).collect();
        let sections = KeptSections::of_overlaps(voxels, &values);
        let mut z = vec![0.25; (voxels - first) * 16];
        weights.add(Arch::new(), &sections, 1, &mut z, &mut Vec::new());
        for (voxel, z) in z.chunks_exact(16).enumerate() {
            let own: Vec<f64> =
                values.iter().skip(first + voxel).step_by(voxels).map(|&v| f64::from(v)).collect();
            for (&found, expected) in z.iter().zip(weights.of_values(&own)) {
                // Sums of five products of order one in f32.
                assert!((f64::from(found) - 0.25 - expected).abs() < 2e-6, "{found} {expected}");
            }
        }
    }

    #[test]
    fn degree_0_has_one_class_and_is_the_mean() {
        let basis = Basis::new(Domain::Directions, 0);
        let set = basis.fitted_set(4).unwrap();
        let weights = ClassWeights::new(&basis, &set).unwrap();
        let z = weights.of_values(&[65535.0, 0.0, 65535.0, 0.0]);
        assert!((z[0] - 0.5).abs() < 1e-6 && z.len() == 1);
    }
}
