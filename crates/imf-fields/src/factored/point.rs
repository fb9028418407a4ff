//! Single poses: value and exact derivatives in position and direction.
//!
//! A point passes through the network with its three tangents beside it, four rows that share one reading of the
//! weights; what comes out are the coefficients and their derivatives by position, whatever the direction.

use glam::DVec3;

use super::symmetry::Place;
use super::{FactoredEvaluator, FactoredField};
use crate::harmonic::basis::Facing;
use crate::harmonic::{Functions, Gradient, TurnScratch};

/// A point and its three tangents.
const ROWS: usize = 4;

/// Working memory of a thread that evaluates single poses; nothing is allocated once it has its size.
#[derive(Default)]
pub struct PointScratch {
    /// `[rows][neuron]`, rows as long as the widest layer: activations, and their tangents.
    signal: Vec<f32>,
    next: Vec<f32>,
    /// `[rows][components]`: coefficients, and their derivatives along x, y and z.
    z: Vec<f32>,
    turns: TurnScratch,
}

impl FactoredEvaluator<'_> {
    /// The overlap, not clipped, with its gradients in position and in how the tool stands. `None` outside the box of the voxel
    /// centres, and for a direction alone where the field is over rotations.
    pub fn overlap_with_gradient(
        &self,
        position: DVec3,
        facing: impl Into<Facing>,
        scratch: &mut PointScratch,
    ) -> Option<Gradient> {
        let field = &*self.field;
        let facing = field.basis.facing(facing)?;
        let place = self.pass(position, scratch)?;
        let PointScratch { z, turns, .. } = scratch;
        let (z, slopes) = z.split_at(self.plan.stack.outputs);
        let FactoredField { basis, components, mean, .. } = field;
        let functions = Functions { arch: self.arch, basis, components, mean };
        let Facing::Direction(direction) = facing else {
            // Fields over rotations know no symmetry: the place's frame is the world's.
            return Some(functions.gradient(facing, z, slopes, turns));
        };
        let local = place.to_local(direction);
        let found = functions.gradient(Facing::Direction(local), z, slopes, turns);
        let [position, turn] = place.slopes_in_world(local, found.position, found.direction, field.blunt());
        Some(Gradient { position, direction: turn, rotation: direction.cross(turn), ..found })
    }

    /// Fills the rows of `z`: the coefficients in the frame of the place, then their derivatives by its position.
    fn pass(&self, position: DVec3, scratch: &mut PointScratch) -> Option<Place> {
        let field = &*self.field;
        if !field.grid.is_between_centres(position) {
            return None;
        }
        let stack = self.plan.stack;
        let place = field.shape.symmetry.place(position);
        let widest = stack.width.max(stack.outputs).max(stack.inputs);
        let PointScratch { signal, next, z, .. } = scratch;
        signal.resize(widest * ROWS, 0.0);
        next.resize(widest * ROWS, 0.0);
        signal[..stack.inputs].copy_from_slice(&field.shape.symmetry.inputs_at(&field.grid, &place));
        // Derivatives by the network's unit of length.
        let slopes = place
            .angle_slopes(field.blunt())
            .map(|slopes| slopes.map(|slope| slope / field.inverse_length()));
        for (axis, angle) in slopes.into_iter().enumerate().take(ROWS - 1) {
            let row = &mut signal[(axis + 1) * widest..][..stack.inputs];
            row.fill(0.0);
            row[axis] = 1.0;
            row[3..].iter_mut().zip(angle).for_each(|(input, slope)| *input = slope as f32);
        }
        let network = self.network(1);
        for layer in 0..self.plan.layers.len() {
            network.layer_of_point::<ROWS>(layer, widest, signal, next);
            std::mem::swap(signal, next);
        }
        let components = stack.outputs;
        z.resize(ROWS * components, 0.0);
        let slope = field.scale * field.inverse_length() as f32;
        for (row, (z, signal)) in z.chunks_exact_mut(components).zip(signal.chunks_exact(widest)).enumerate()
        {
            let scale = if row == 0 { field.scale } else { slope };
            z.iter_mut().zip(signal).for_each(|(z, &value)| *z = value * scale);
        }
        Some(place)
    }
}
