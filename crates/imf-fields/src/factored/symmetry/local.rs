//! Coefficients of harmonics in the frame of a place, and in the world's.
//!
//! A field's values at a place are `Σ w_k Y_k(d)` in the world and `Σ c_k Y_k(T d)` in the place's frame. T is a mirror, then the
//! order of axes that ends with the one of revolution, then a turn about that: signs of functions, a fixed matrix of each
//! degree, and a turn of the functions ±m by m times the angle.

use glam::DQuat;
use pulp::Arch;

use super::{Axis, Place, Symmetry};
use crate::harmonic::rotations::RotationBasis;
use crate::harmonic::sphere::all_that_change_sign;
use imf_core::vectorised::vectorised;

/// What takes coefficients of all harmonics up to a degree from one frame to the other.
pub struct LocalHarmonics {
    degree: usize,
    /// 0, 1 or 2: the axis that comes last.
    along: usize,
    /// M of every degree by columns, `[2l + 1][2l + 1]`, one behind the other, where the order of axes is not the world's.
    columns: Vec<f32>,
    /// By which of the axes in order are mirrored, the first one's bit the lowest: 1 or −1 of each function.
    signs: Vec<f32>,
    arch: Arch,
}

impl LocalHarmonics {
    /// Of harmonics up to a degree.
    #[must_use]
    pub fn new(symmetry: &Symmetry, degree: usize) -> Self {
        let along = symmetry.axis.map_or(2, |axis| axis.along);
        let mut columns = Vec::new();
        if along != 2 {
            let basis = RotationBasis::new(degree);
            let mut functions = vec![0.0; basis.len()];
            basis.values(DQuat::from_mat3(&Axis::permutation(along)), &mut functions);
            let mut start = 0;
            for l in 0..=degree {
                let size = 2 * l + 1;
                let rows = &functions[start..start + size * size];
                for column in 0..size {
                    let column = rows.iter().skip(column).step_by(size);
                    columns.extend(column.map(|v| (v / (size as f64).sqrt()) as f32));
                }
                start += size * size;
            }
        }
        let mirrored = (0..8).map(|bits: usize| [0, 1, 2].map(|axis| bits >> axis & 1 == 1));
        let changes = mirrored.flat_map(|axes| all_that_change_sign(degree, axes));
        let signs = changes.map(|changes| if changes { -1.0 } else { 1.0 }).collect();
        Self { degree, along, columns, signs, arch: Arch::new() }
    }

    /// Number of coefficients.
    pub(crate) fn len(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// The order of axes: the one of revolution comes last.
    pub(crate) fn order(&self) -> [usize; 3] {
        Axis::order(self.along)
    }

    /// From the world's frame to that with the axes in order: `out = M w`.
    pub fn in_order(&self, world: &[f32], out: &mut [f32]) {
        if self.columns.is_empty() {
            out.copy_from_slice(world);
            return;
        }
        out.fill(0.0);
        vectorised!(self.arch, {
            let mut matrices = &self.columns[..];
            for l in 0..=self.degree {
                let (size, own) = (2 * l + 1, l * l..(l + 1) * (l + 1));
                let (matrix, rest) = matrices.split_at(size * size);
                let out = &mut out[own.clone()];
                for (column, &w) in matrix.chunks_exact(size).zip(&world[own]) {
                    out.iter_mut().zip(column).for_each(|(out, m)| *out += m * w);
                }
                matrices = rest;
            }
        });
    }

    /// The functions of the frame with the axes in order as sums of the world's: `Mᵀ`, `[world's][ordered]`.
    pub fn functions_in_order(&self) -> Vec<f32> {
        let count = self.len();
        let mut functions = vec![0.0; count * count];
        let (mut world, mut ordered) = (vec![0.0; count], vec![0.0; count]);
        for place in 0..count {
            world.fill(0.0);
            world[place] = 1.0;
            self.in_order(&world, &mut ordered);
            functions[place * count..][..count].copy_from_slice(&ordered);
        }
        functions
    }

    /// In place, from the axes in order to the place's frame.
    pub fn to_local(&self, place: &Place, coefficients: &mut [f32]) {
        self.mirror(place, coefficients);
        self.turn(place, coefficients, -1.0);
    }

    /// In place, from the place's frame to the axes in order.
    pub fn to_world(&self, place: &Place, coefficients: &mut [f32]) {
        self.turn(place, coefficients, 1.0);
        self.mirror(place, coefficients);
    }

    /// Functions ±m turn by m times the angle, backwards where `sense` is −1.
    fn turn(&self, place: &Place, coefficients: &mut [f32], sense: f64) {
        let Some(angle) = place.angle else { return };
        let (step_cosine, step_sine) = (angle.cosine, sense * angle.sine);
        let (mut cosine, mut sine) = (step_cosine, step_sine);
        for m in 1..=self.degree {
            let (c, s) = (cosine as f32, sine as f32);
            for l in m..=self.degree {
                let middle = l * l + l;
                let (even, odd) = (coefficients[middle + m], coefficients[middle - m]);
                coefficients[middle + m] = c * even - s * odd;
                coefficients[middle - m] = s * even + c * odd;
            }
            (cosine, sine) =
                (cosine * step_cosine - sine * step_sine, sine * step_cosine + cosine * step_sine);
        }
    }

    /// Functions that are odd across what was mirrored change their sign.
    fn mirror(&self, place: &Place, coefficients: &mut [f32]) {
        let mirrored = self.order().map(|axis| usize::from(place.signs[axis] < 0.0));
        let count = self.len();
        let signs = &self.signs[(mirrored[0] + 2 * mirrored[1] + 4 * mirrored[2]) * count..][..count];
        coefficients.iter_mut().zip(signs).for_each(|(coefficient, sign)| *coefficient *= sign);
    }
}
