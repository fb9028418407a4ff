//! Values and derivatives of many poses: the coefficients of each, and products of all with the functions of their directions.

use glam::DVec3;
use imf_core::vectorised::vectorised;
use pulp::Arch;

use super::{Gradient, HarmonicField, PointScratch};
use crate::siren::lanes::dot;
use crate::siren::matrix::{Matrix, multiply};
use crate::siren::split::{SplitBoth, where_many};

/// Working memory of a thread; nothing is allocated once it has its size.
#[derive(Default)]
pub(crate) struct BatchScratch {
    point: PointScratch,
    /// `[row][components]`: coefficients, and the derivatives by them.
    z: Vec<f32>,
    along: Vec<f32>,
    /// `[row][3][components]`: differences of the coefficients along x, y and z.
    slopes: Vec<f32>,
    /// `[row][K]`: functions, and the coefficients' weights of them.
    functions: Vec<f32>,
    weights: Vec<f32>,
    directions: Vec<DVec3>,
    side_by_side: Vec<f32>,
}

impl HarmonicField {
    /// [`HarmonicField::overlap_with_gradient`] of positions within the box and directions of length 1, to the rounding of `f32`;
    /// `split` is of the functions' axes.
    pub(crate) fn overlaps_with_gradients(
        &self,
        split: Option<&SplitBoth>,
        poses: &[(DVec3, DVec3)],
        found: &mut [Gradient],
        scratch: &mut BatchScratch,
    ) {
        assert_eq!(poses.len(), found.len(), "a gradient for each pose");
        let (rows, components, count) = (poses.len(), self.component_count(), self.basis.len());
        let BatchScratch { point, z, along, slopes, functions, weights, directions, side_by_side } = scratch;
        z.clear();
        slopes.clear();
        for &(position, _) in poses {
            if self.mix(position, point).is_some() {
                let (mean, differences) = point.mixed.split_at(components);
                z.extend_from_slice(mean);
                slopes.extend_from_slice(differences);
            } else {
                // Far from the origin rounding leads out of the box.
                z.resize(z.len() + components, f32::NAN);
                slopes.resize(slopes.len() + 3 * components, f32::NAN);
            }
        }
        directions.clear();
        directions.extend(poses.iter().map(|(_, direction)| *direction));
        functions.resize(rows * count, 0.0);
        self.basis.values_of_directions(directions, functions, side_by_side);
        along.resize(rows * components, 0.0);
        weights.clear();
        (0..rows).for_each(|_| weights.extend_from_slice(&self.mean));
        let axes = Axes { u: &self.components, components, split };
        axes.weights((z, rows, components), weights, true);
        axes.along(functions, rows, (along, components));

        let arch = Arch::new();
        self.basis.sums_with_gradients(directions, weights, side_by_side, |row, (value, turn)| {
            let (along, slopes) =
                (&along[row * components..][..components], &slopes[3 * row * components..][..3 * components]);
            let mut position = [0.0; 3];
            vectorised!(arch, {
                for (position, slopes) in position.iter_mut().zip(slopes.chunks_exact(components)) {
                    *position = f64::from(dot(slopes, along));
                }
            });
            found[row] = Gradient {
                value: value as f32,
                position: DVec3::from_array(position) / self.grid.pitch,
                direction: turn,
                rotation: poses[row].1.cross(turn),
            };
        });
    }
}

/// The axes U `[K][components]` of coefficients.
#[derive(Clone, Copy)]
pub(crate) struct Axes<'a> {
    pub(crate) u: &'a [f32],
    pub(crate) components: usize,
    /// U for products by tiles.
    pub(crate) split: Option<&'a SplitBoth>,
}

impl Axes<'_> {
    /// `U z`, or adds it, into `weights [row][K]`, of rows of coefficients and their distance.
    pub(crate) fn weights(
        self,
        (z, rows, stride): (&[f32], usize, usize),
        weights: &mut [f32],
        accumulate: bool,
    ) {
        let Self { u, components, split } = self;
        let count = u.len() / components;
        match where_many(split, rows) {
            Some(split) => {
                split.multiply(|of| &of.transposed, (z, rows, stride), (weights, count), accumulate);
            }
            None => {
                let z = Matrix::row_major(z, rows, components, stride);
                multiply(weights, count, z, Matrix::dense(u, components).transposed(), accumulate);
            }
        }
    }

    /// `Uᵀ b` of rows of functions `[row][K]`, into rows at their distance.
    pub(crate) fn along(self, functions: &[f32], rows: usize, (along, stride): (&mut [f32], usize)) {
        let Self { u, components, split } = self;
        let count = u.len() / components;
        match where_many(split, rows) {
            Some(split) => split.multiply(|of| &of.forward, (functions, rows, count), (along, stride), false),
            None => {
                multiply(along, stride, Matrix::dense(functions, count), Matrix::dense(u, components), false);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::scenes::{assert_gradients_agree, harmonic_file, scene};
    use imf_core::tool::Tool;

    #[test]
    fn gradients_of_many_poses_are_those_of_each_by_itself() {
        let scene = scene(&Tool::paper(), 0.0);
        let field = harmonic_file(&scene, 8).field;
        let (mut scratch, mut of_point) = (BatchScratch::default(), PointScratch::default());
        assert_gradients_agree(
            &scene,
            |poses, found| field.overlaps_with_gradients(None, poses, found, &mut scratch),
            |at, facing| field.overlap_with_gradient(at, facing, &mut of_point).unwrap(),
        );
    }
}
