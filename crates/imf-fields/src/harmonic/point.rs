//! Values and gradients at single poses, between voxel centres and between orientations.

use glam::DVec3;
use pulp::Arch;

use super::HarmonicField;
use super::adjoint::product_and_adjoint;
use super::basis::{Basis, Facing};
use super::rotations::sum_with_turns;
use crate::siren::lanes::dot;
use imf_core::vectorised::vectorised;

/// What a pose's overlap is and how it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradient {
    /// The overlap, not clipped to [0, 1], or the depth.
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: DVec3,
    /// Change for a turn of the tool's direction by a radian, tangent to the sphere.
    pub direction: DVec3,
    /// Change for a turn of the tool by a radian about each axis of the world; across the tool's own axis, where it is one of
    /// revolution.
    pub rotation: DVec3,
}

impl Gradient {
    pub(crate) const ZERO: Self =
        Self { value: 0.0, position: DVec3::ZERO, direction: DVec3::ZERO, rotation: DVec3::ZERO };
}

/// Working memory of a thread that evaluates single poses.
#[derive(Default)]
pub struct PointScratch {
    /// The eight corners' mean coefficients, and their differences along x, y and z: `[4][components]`.
    pub(super) mixed: Vec<f32>,
    corner: Vec<f32>,
    turns: TurnScratch,
}

/// Working memory for what a direction adds to a point's coefficients.
#[derive(Default)]
pub(crate) struct TurnScratch {
    functions: Vec<f64>,
    /// The same in f32.
    narrow: Vec<f32>,
    /// `U z`, `[K]`.
    weights: Vec<f32>,
    /// `Uᵀ b`, `[components]`.
    along: Vec<f32>,
}

/// What turns a point's coefficients into overlaps.
#[derive(Clone, Copy)]
pub(crate) struct Functions<'a> {
    pub arch: Arch,
    pub basis: &'a Basis,
    /// U: `[K][components]`.
    pub components: &'a [f32],
    /// μ: `[K]`.
    pub mean: &'a [f32],
}

impl Functions<'_> {
    /// The overlap with its gradients, of coefficients `z` and their `slopes` along x, y and z, `[3][components]`, and what
    /// [`Basis::facing`] gave.
    pub(crate) fn gradient(
        self,
        facing: Facing,
        z: &[f32],
        slopes: &[f32],
        scratch: &mut TurnScratch,
    ) -> Gradient {
        scratch.functions.resize(self.basis.len(), 0.0);
        self.basis.values_facing(facing, &mut scratch.functions);
        let TurnScratch { functions, narrow, weights, along } = scratch;
        narrow.clear();
        narrow.extend(functions.iter().map(|&value| value as f32));
        weights.resize(functions.len(), 0.0);
        along.resize(z.len(), 0.0);
        product_and_adjoint(self.arch, self.components, z, narrow, weights, along);
        let (value, direction, rotation) = match facing {
            Facing::Direction(direction) => {
                let weight = |place: usize| f64::from(weights[place] + self.mean[place]);
                let (value, turn) = self.basis.sum_with_gradient(direction, weight);
                (value, turn, direction.cross(turn))
            }
            Facing::Rotation(rotation) => {
                weights.iter_mut().zip(self.mean).for_each(|(weight, mean)| *weight += mean);
                let degree = self.basis.degree();
                let (value, turns) =
                    vectorised!(self.arch, sum_with_turns(degree, &functions[..], &weights[..]));
                (value, turns.cross(rotation * DVec3::Z), turns)
            }
        };
        let mut position = [0.0; 3];
        vectorised!(self.arch, {
            for (slope, row) in position.iter_mut().zip(slopes.chunks_exact(z.len())) {
                *slope = f64::from(dot(row, along));
            }
        });
        Gradient { value: value as f32, position: position.into(), direction, rotation }
    }
}

impl HarmonicField {
    /// The overlap with its gradients in position and in how the tool stands. One-sided where a position lies on a voxel
    /// centre's plane: the slope of the cell towards higher indices. `None` outside the box of the voxel centres, and for a
    /// direction alone where the field is over rotations.
    pub fn overlap_with_gradient(
        &self,
        position: DVec3,
        facing: impl Into<Facing>,
        scratch: &mut PointScratch,
    ) -> Option<Gradient> {
        let facing = self.basis.facing(facing)?;
        self.mix(position, scratch)?;
        let (z, slopes) = scratch.mixed.split_at(self.component_count());
        let Self { basis, components, mean, .. } = self;
        let functions = Functions { arch: Arch::new(), basis, components, mean };
        let found = functions.gradient(facing, z, slopes, &mut scratch.turns);
        Some(Gradient { position: found.position / self.grid.pitch, ..found })
    }

    /// Fills `mixed` with four rows: the mean coefficients at a position and their differences along the axes.
    pub(super) fn mix(&self, position: DVec3, scratch: &mut PointScratch) -> Option<()> {
        let PointScratch { mixed, corner, .. } = scratch;
        mixed.resize(4 * self.component_count(), 0.0);
        self.coefficients_at(position, mixed, corner)
    }

    /// The coefficients at a position, `[components]`, and by as many of the weights' derivatives as `mixed` has further rows;
    /// `corner` is working memory. `None` outside the box of the voxel centres.
    pub(super) fn coefficients_at(
        &self,
        position: DVec3,
        mixed: &mut [f32],
        corner: &mut Vec<f32>,
    ) -> Option<()> {
        let cell = self.cell(position)?;
        let components = self.component_count();
        let corners = std::array::from_fn(|bits| {
            let (voxel, weights) = cell.corner(bits);
            (self.grid.index(voxel) * components, weights)
        });
        self.coefficients.mix(&corners, components, mixed, corner);
        Some(())
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
