//! Values and gradients at single poses, between voxel centres and between orientations.

use glam::DVec3;

use super::HarmonicField;
use super::basis::Domain;
use crate::orientation::Orientation;

/// What a pose's overlap is and how it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradient {
    /// The overlap, not clipped to [0, 1].
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: DVec3,
    /// Change for a turn of the tool's direction by a radian, tangent to the sphere.
    pub direction: DVec3,
}

/// Working memory of a thread that asks for single poses.
#[derive(Default)]
pub struct PointScratch {
    functions: Vec<f64>,
    gradients: Vec<DVec3>,
    /// The eight corners' mean coefficients, and their differences along x, y and z: `[4][axes]`.
    mixed: Vec<f32>,
    corner: Vec<f32>,
    /// `[4][K]`: U times `mixed`, with μ in the first.
    spread: Vec<f32>,
}

impl HarmonicField {
    /// The overlap with the tool's tip at a world position, clipped to [0, 1]; trilinear between voxel centres.
    /// `None` outside the box of the voxel centres.
    #[must_use]
    pub fn overlap(
        &self,
        position: DVec3,
        orientation: &Orientation,
        scratch: &mut PointScratch,
    ) -> Option<f32> {
        self.mix(position, 1, scratch)?;
        scratch.functions.resize(self.basis.len(), 0.0);
        self.basis.values(orientation, &mut scratch.functions);
        let sum: f64 = scratch.spread.iter().zip(&scratch.functions).map(|(&w, &b)| f64::from(w) * b).sum();
        Some((sum as f32).clamp(0.0, 1.0))
    }

    /// The overlap with its gradients in position and direction. One-sided where a position lies on a voxel centre's
    /// plane: the slope of the cell towards higher indices. `None` outside the box of the voxel centres, and for fields
    /// over rotations.
    #[must_use]
    pub fn overlap_with_gradient(
        &self,
        position: DVec3,
        direction: DVec3,
        scratch: &mut PointScratch,
    ) -> Option<Gradient> {
        if self.basis.domain() != Domain::Directions {
            return None;
        }
        let direction = direction.try_normalize()?;
        self.mix(position, 4, scratch)?;
        let functions = self.basis.len();
        let PointScratch { functions: values, gradients, spread, .. } = scratch;
        values.resize(functions, 0.0);
        gradients.resize(functions, DVec3::ZERO);
        self.basis.gradients_of_direction(direction, values, gradients);
        let mut sums = [0.0; 4];
        for (sum, weights) in sums.iter_mut().zip(spread.chunks_exact(functions)) {
            *sum = weights.iter().zip(values.iter()).map(|(&w, &b)| f64::from(w) * b).sum();
        }
        let turn = spread.iter().zip(gradients.iter()).map(|(&w, &g)| f64::from(w) * g).sum();
        Some(Gradient {
            value: sums[0] as f32,
            position: DVec3::new(sums[1], sums[2], sums[3]) / self.grid.pitch,
            direction: turn,
        })
    }

    /// Fills the first `rows` of `spread`: the mean coefficients at a position and their differences along the axes.
    fn mix(&self, position: DVec3, rows: usize, scratch: &mut PointScratch) -> Option<()> {
        let cell = self.cell(position)?;
        let (axes, functions) = (self.axis_count(), self.basis.len());
        let PointScratch { mixed, corner, spread, .. } = scratch;
        mixed.clear();
        mixed.resize(rows * axes, 0.0);
        self.add_corners(&cell, mixed, corner);
        spread.clear();
        spread.resize(rows * functions, 0.0);
        spread[..functions].copy_from_slice(&self.mean);
        for (spread, mixed) in spread.chunks_exact_mut(functions).zip(mixed.chunks_exact(axes)) {
            for (out, row) in spread.iter_mut().zip(self.axes.chunks_exact(axes)) {
                *out += row.iter().zip(mixed).map(|(&u, &z)| u * z).sum::<f32>();
            }
        }
        Some(())
    }

    /// The coefficients z at a position, `[axes]`; `corner` is working memory. `None` outside the box of the voxel
    /// centres.
    pub(crate) fn coefficients_at(
        &self,
        position: DVec3,
        z: &mut [f32],
        corner: &mut Vec<f32>,
    ) -> Option<()> {
        let cell = self.cell(position)?;
        z.fill(0.0);
        self.add_corners(&cell, z, corner);
        Some(())
    }

    /// Adds the eight corners' coefficients by their weights, and by as many of the weights' derivatives as `mixed`
    /// has further rows.
    fn add_corners(&self, cell: &Cell, mixed: &mut [f32], corner: &mut Vec<f32>) {
        let axes = self.axis_count();
        let rows = mixed.len() / axes;
        for bits in 0..8 {
            let (voxel, weights) = cell.corner(bits);
            if weights[..rows].iter().all(|&w| w == 0.0) {
                continue;
            }
            let from = self.grid.index(voxel) * axes;
            let z = self.coefficients.read(from, from + axes, corner);
            for (mixed, weight) in mixed.chunks_exact_mut(axes).zip(weights) {
                mixed.iter_mut().zip(z).for_each(|(m, &z)| *m += weight * z);
            }
        }
    }

    /// `None` outside the box of the voxel centres, and for positions that are not finite.
    fn cell(&self, position: DVec3) -> Option<Cell> {
        if !self.grid.is_between_centres(position) {
            return None;
        }
        let continuous = self.grid.continuous(position);
        let mut cell = Cell { low: [0; 3], high: [0; 3], fraction: [0.0; 3] };
        for axis in 0..3 {
            let last = self.grid.dims[axis] - 1;
            let at = continuous[axis];
            let low = (at.max(0.0) as usize).min(last.saturating_sub(1));
            cell.low[axis] = low;
            cell.high[axis] = (low + 1).min(last);
            cell.fraction[axis] = (at - low as f64).clamp(0.0, 1.0) as f32;
        }
        Some(cell)
    }
}

/// Eight voxels around a position.
struct Cell {
    low: [usize; 3],
    high: [usize; 3],
    fraction: [f32; 3],
}

impl Cell {
    /// A corner's voxel, its weight, and the derivatives of the weight along x, y and z in voxels.
    fn corner(&self, bits: usize) -> ([usize; 3], [f32; 4]) {
        let up = [bits >> 2 & 1 == 1, bits >> 1 & 1 == 1, bits & 1 == 1];
        let voxel = std::array::from_fn(|axis| if up[axis] { self.high[axis] } else { self.low[axis] });
        let weight = |axis: usize| if up[axis] { self.fraction[axis] } else { 1.0 - self.fraction[axis] };
        let slope = |axis: usize| if up[axis] { 1.0 } else { -1.0 };
        let [x, y, z] = [0, 1, 2].map(weight);
        (voxel, [x * y * z, slope(0) * y * z, x * slope(1) * z, x * y * slope(2)])
    }
}
