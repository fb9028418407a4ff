//! The families behind a [`Field`](super::Field): blocks of poses to values, by whole products.

mod network_pose;

use std::sync::Arc;

use glam::{DQuat, DVec3};
use pulp::Arch;

use crate::factored::{self, FactoredEvaluator};
use crate::harmonic::basis::{Basis, Facing};
use crate::harmonic::file::HarmonicFile;
use crate::harmonic::{self, VoxelCoefficients};
use crate::siren::INPUTS;
use crate::siren::evaluator::{CpuEvaluator, ROWS, SlopesScratch, TangentScratch};
use crate::siren::lanes::dot;
use crate::siren::matrix::{Matrix, multiply};
use crate::siren::split::{SplitBoth, where_many};
use imf_core::field::minimum::{BLOCK, is_better};
use imf_core::field::{Best, Decision, Gradient};
use imf_core::grid::Grid;
use imf_core::pose::{Pose, axis_of};
use imf_core::section::Quantity;
use imf_core::vectorised::vectorised;
use network_pose::{siren_gradient, siren_input};

/// Points whose coefficients are retained while all orientations are evaluated.
const POINTS: usize = 16 * BLOCK;

/// A field of any family, ready for queries.
pub(super) enum Family {
    /// The paper's network.
    Siren(CpuEvaluator),
    /// Coefficients at voxels, and the axes of their functions for products by tiles.
    Harmonic(Arc<HarmonicFile>, Option<SplitBoth>),
    /// Coefficients by a network.
    Factored(Box<FactoredEvaluator<'static>>),
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    inputs: Vec<f32>,
    tangents: TangentScratch,
    slopes: SlopesScratch,
    harmonic: harmonic::PointScratch,
    factored: factored::PointScratch,
    gradients: factored::GradientScratch,
    sums: harmonic::BatchScratch,
    /// One orientation's functions.
    functions: Vec<f64>,
    directions: Vec<DVec3>,
    side_by_side: Vec<f32>,
    /// `[orientation][K]`.
    rows: Vec<f32>,
    /// `[orientation][components]`.
    weights: Vec<f32>,
    /// `[orientation]`.
    constants: Vec<f32>,
    /// `[point][components]`.
    coefficients: Vec<f32>,
    corner: Vec<f32>,
    /// `[point][orientation]`.
    products: Vec<f32>,
}

/// How a family's values come about.
pub(super) enum Kind<'a> {
    /// By a network of the whole pose.
    Network(&'a CpuEvaluator),
    /// As a sum of functions of the orientation, by coefficients of the point; the functions' axes for products by tiles.
    Sum(&'a dyn VoxelCoefficients, Option<&'a SplitBoth>),
}

impl Family {
    /// Of a harmonic field.
    pub(super) fn harmonic(file: Arc<HarmonicFile>) -> Self {
        let split =
            SplitBoth::new(&file.field.components, file.field.basis.len(), file.field.component_count());
        Self::Harmonic(file, split)
    }

    /// What its values are.
    pub(super) fn quantity(&self) -> Quantity {
        match self.kind() {
            Kind::Network(_) => Quantity::Overlap,
            Kind::Sum(source, _) => source.quantity(),
        }
    }

    /// How its values come about.
    pub(super) fn kind(&self) -> Kind<'_> {
        match self {
            Self::Siren(network) => Kind::Network(network),
            Self::Harmonic(file, split) => Kind::Sum(&file.field, split.as_ref()),
            Self::Factored(evaluator) => Kind::Sum(&**evaluator, evaluator.split_functions.as_ref()),
        }
    }

    /// Values of up to [`BLOCK`] poses, not clipped; those of invalid poses mean nothing.
    pub(super) fn values(&self, grid: &Grid, poses: &[Pose], values: &mut [f32], scratch: &mut Scratch) {
        match self.kind() {
            Kind::Sum(source, split) => values_of((source, split), grid, poses, values, scratch),
            Kind::Network(network) => {
                scratch.inputs.resize(poses.len() * INPUTS, 0.0);
                for (input, pose) in scratch.inputs.as_chunks_mut::<INPUTS>().0.iter_mut().zip(poses) {
                    *input = siren_input(grid, pose).0;
                }
                network.evaluate_here(&scratch.inputs, values);
            }
        }
    }

    /// Values and derivatives of any number of poses, their positions held in the box; NaN of invalid ones.
    pub(super) fn gradients(
        &self,
        grid: &Grid,
        poses: &[Pose],
        found: &mut [Gradient],
        scratch: &mut Scratch,
    ) {
        let together = match self.kind() {
            Kind::Network(_) => true,
            Kind::Sum(source, _) => matches!(source.functions().0, Basis::Directions(_)),
        };
        for (poses, found) in poses.chunks(factored::ROWS).zip(found.chunks_mut(factored::ROWS)) {
            if together && poses.len() >= FEW && poses.iter().all(Pose::is_valid) {
                self.gradients_together(grid, poses, found, scratch);
            } else {
                for (pose, found) in poses.iter().zip(found) {
                    *found = self.gradient(grid, pose, scratch).unwrap_or(Gradient::NAN);
                }
            }
        }
    }

    /// The same of up to [`factored::ROWS`] valid poses, by products of all of them.
    fn gradients_together(&self, grid: &Grid, poses: &[Pose], found: &mut [Gradient], scratch: &mut Scratch) {
        let [low, high] = grid.box_of_centres();
        let mut asked = [(DVec3::ZERO, DVec3::Z); factored::ROWS];
        let asked = &mut asked[..poses.len()];
        for (asked, pose) in asked.iter_mut().zip(poses) {
            *asked = (pose.position.clamp(low, high), pose.axis().unwrap_or(DVec3::Z));
        }
        let mut slopes = [harmonic::Gradient::ZERO; factored::ROWS];
        let slopes = &mut slopes[..poses.len()];
        match self {
            Self::Siren(network) => {
                let (mut inputs, mut angles) = ([[0.0; INPUTS]; factored::ROWS], [[0.0; 2]; factored::ROWS]);
                for ((input, angles), pose) in inputs.iter_mut().zip(&mut angles).zip(poses) {
                    (*input, *angles) = siren_input(grid, pose);
                }
                let mut rows = [[0.0; ROWS]; factored::ROWS];
                let rows = &mut rows[..poses.len()];
                network.values_and_slopes(&inputs[..poses.len()], rows, &mut scratch.slopes);
                for (((found, row), angles), asked) in slopes.iter_mut().zip(rows).zip(angles).zip(&*asked) {
                    *found = siren_gradient(grid, *row, angles, asked.1);
                }
            }
            Self::Factored(evaluator) => {
                evaluator.overlaps_with_gradients(asked, slopes, &mut scratch.gradients);
            }
            Self::Harmonic(file, split) => {
                let scratch = &mut scratch.sums;
                file.field.overlaps_with_gradients(split.as_ref(), asked, slopes, scratch);
            }
        }
        for (((found, slopes), pose), (held, _)) in found.iter_mut().zip(slopes).zip(poses).zip(asked) {
            *found = within_box(slopes, pose.position, *held);
        }
    }

    /// Value and derivatives of one pose, its position held in the box; `None` for an invalid one.
    fn gradient(&self, grid: &Grid, pose: &Pose, scratch: &mut Scratch) -> Option<Gradient> {
        let [low, high] = grid.box_of_centres();
        let (direction, tip) = (pose.axis()?, pose.position);
        let held = tip.clamp(low, high);
        let found = match self {
            Self::Siren(network) => {
                let (input, angles) = siren_input(grid, pose);
                let slopes = network.value_and_slopes(&input, &mut scratch.tangents);
                siren_gradient(grid, slopes, angles, direction)
            }
            Self::Harmonic(file, _) => {
                let facing = facing(pose.rotation, direction, &file.field.basis);
                file.field.overlap_with_gradient(held, facing, &mut scratch.harmonic)?
            }
            Self::Factored(evaluator) => {
                let facing = facing(pose.rotation, direction, &evaluator.field().basis);
                evaluator.overlap_with_gradient(held, facing, &mut scratch.factored)?
            }
        };
        Some(within_box(&found, tip, held))
    }

    /// The minimum, not clipped, over orientations at every point inside the box, for a tool with its tip alone, by
    /// products of all points with all orientations; `false` where the family has none. `decide` gives the decision
    /// of a value.
    pub(super) fn least(
        &self,
        grid: &Grid,
        points: &[DVec3],
        rotations: &[DQuat],
        best: &mut [Best],
        scratch: &mut Scratch,
        decide: impl Fn(DVec3, f32) -> Decision,
    ) -> bool {
        let Kind::Sum(source, split) = self.kind() else { return false };
        for (points, best) in points.chunks(POINTS).zip(best.chunks_mut(POINTS)) {
            minimum_at((source, split), grid, points, rotations, best, scratch, &decide);
        }
        true
    }
}

/// What a family's functions read of a pose whose direction is known.
fn facing(rotation: DQuat, direction: DVec3, basis: &Basis) -> Facing {
    match basis {
        Basis::Directions(_) => Facing::Direction(direction),
        Basis::Rotations(_) => Facing::Rotation(rotation.normalize()),
    }
}

/// Fewer poses are taken one by one: products of four take a quarter longer where the network is narrow.
const FEW: usize = 8;

/// A gradient as it is returned: across the faces at which the tip was clamped to the box nothing changes.
fn within_box(found: &harmonic::Gradient, tip: DVec3, held: DVec3) -> Gradient {
    let inside = |axis: usize| if tip[axis] == held[axis] { found.position[axis] } else { 0.0 };
    Gradient {
        value: found.value,
        position: DVec3::new(inside(0), inside(1), inside(2)).as_vec3(),
        direction: found.direction.as_vec3(),
        rotation: found.rotation.as_vec3(),
    }
}

/// A position held in the box; what is not finite becomes the box's corner.
fn held(position: DVec3, low: DVec3, high: DVec3) -> DVec3 {
    if position.is_nan() { low } else { position.clamp(low, high) }
}

/// The weights of up to [`BLOCK`] rotations into the scratch: `[orientation][components]` and constants.
fn direction_weights(
    (source, split): (&dyn VoxelCoefficients, Option<&SplitBoth>),
    rotations: impl ExactSizeIterator<Item = DQuat>,
    scratch: &mut Scratch,
) {
    let (basis, components, mean) = source.functions();
    let (count, functions, width) = (rotations.len(), basis.len(), source.components());
    let order = source.order();
    let Scratch { functions: row, directions, side_by_side, rows, weights, constants, .. } = scratch;
    row.resize(functions, 0.0);
    rows.resize(count * functions, 0.0);
    constants.resize(count, 0.0);
    weights.resize(count * width, 0.0);
    if let Basis::Directions(_) = basis {
        directions.clear();
        directions.extend(rotations.map(|rotation| {
            let direction = axis_of(rotation).unwrap_or(DVec3::NAN);
            order.map_or(direction, |order| order.map(|axis| direction[axis]).into())
        }));
        // Where there is an order of directions the functions are the weights.
        let out = if order.is_some() { &mut *weights } else { &mut *rows };
        basis.values_of_directions(directions, out, side_by_side);
    } else {
        for (rotation, out) in rotations.zip(rows.chunks_exact_mut(functions)) {
            match axis_of(rotation) {
                Some(direction) => basis.values_facing(facing(rotation, direction, basis), row),
                None => row.fill(f64::NAN),
            }
            out.iter_mut().zip(row.iter()).for_each(|(out, &value)| *out = value as f32);
        }
    }
    if order.is_some() {
        return constants.fill(0.0);
    }
    vectorised!(Arch::new(), {
        for (constant, row) in constants.iter_mut().zip(rows.chunks_exact(functions)) {
            *constant = dot(row, mean);
        }
    });
    match where_many(split, count) {
        Some(split) => {
            split.multiply(|both| &both.forward, (rows, count, functions), (weights, width), false);
        }
        None => {
            multiply(weights, width, Matrix::dense(rows, functions), Matrix::dense(components, width), false);
        }
    }
}

fn values_of(
    (source, split): (&dyn VoxelCoefficients, Option<&SplitBoth>),
    grid: &Grid,
    poses: &[Pose],
    values: &mut [f32],
    scratch: &mut Scratch,
) {
    let [low, high] = grid.box_of_centres();
    let components = source.components();
    direction_weights((source, split), poses.iter().map(|pose| pose.rotation), scratch);
    let Scratch { weights, constants, coefficients, corner, .. } = scratch;
    coefficients.resize(poses.len() * components, 0.0);
    source.at(&mut poses.iter().map(|pose| held(pose.position, low, high)), coefficients, corner);
    let each = coefficients.chunks_exact(components).zip(weights.chunks_exact(components));
    vectorised!(Arch::new(), {
        for ((value, (z, weight)), constant) in values.iter_mut().zip(each).zip(constants) {
            *value = *constant + dot(z, weight);
        }
    });
}

fn minimum_at(
    (source, split): (&dyn VoxelCoefficients, Option<&SplitBoth>),
    grid: &Grid,
    points: &[DVec3],
    rotations: &[DQuat],
    best: &mut [Best],
    scratch: &mut Scratch,
    decide: &impl Fn(DVec3, f32) -> Decision,
) {
    let [low, high] = grid.box_of_centres();
    let components = source.components();
    let place = |point: &DVec3| held(*point, low, high);
    scratch.coefficients.resize(points.len() * components, 0.0);
    for (points, z) in points.chunks(BLOCK).zip(scratch.coefficients.chunks_mut(BLOCK * components)) {
        source.at(&mut points.iter().map(place), z, &mut scratch.corner);
    }
    best.fill(Best::NONE);
    for first in (0..rotations.len()).step_by(BLOCK) {
        let rotations = &rotations[first..(first + BLOCK).min(rotations.len())];
        direction_weights((source, split), rotations.iter().copied(), scratch);
        let Scratch { weights, constants, coefficients, products, .. } = scratch;
        let columns = rotations.len();
        let blocks = points.chunks(BLOCK).zip(best.chunks_mut(BLOCK));
        for ((points, best), z) in blocks.zip(coefficients.chunks(BLOCK * components)) {
            products.resize(points.len() * columns, 0.0);
            products.chunks_exact_mut(columns).for_each(|row| row.copy_from_slice(constants));
            let weights = Matrix::dense(weights, components).transposed();
            multiply(products, columns, Matrix::dense(z, components), weights, true);
            for ((best, &point), row) in best.iter_mut().zip(points).zip(products.chunks_exact(columns)) {
                if !point.is_finite() {
                    continue;
                }
                for (at, &value) in row.iter().enumerate() {
                    // Of one point's decisions only the best value's matters: they follow the value.
                    if best.value.is_nan() || value < best.value {
                        let decision = decide(point, value);
                        if is_better(value, decision, best) {
                            *best = Best { value, orientation: (first + at) as u32, decision };
                        }
                    }
                }
            }
        }
    }
}
