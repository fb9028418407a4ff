//! Values and derivatives of many poses: the network forwards, then backwards from the functions of each pose's direction.

use glam::DVec3;

use super::FactoredEvaluator;
use super::symmetry::Place;
use crate::harmonic::{Axes, Gradient};
use crate::siren::adjoint::AdjointScratch;
use crate::siren::stack::Ending;
use imf_core::vectorised::vectorised;

/// Poses that pass together.
pub(crate) const ROWS: usize = 128;

/// Working memory of a thread; nothing is allocated once it has its size.
#[derive(Default)]
pub(crate) struct GradientScratch {
    /// A position's place and the direction in its frame.
    places: Vec<(Place, DVec3)>,
    /// `[row][input]`.
    inputs: Vec<f32>,
    adjoint: AdjointScratch,
    /// `[row][components]`: the outputs of a last layer, and then the derivatives by them.
    outputs: Vec<f32>,
    /// `[row][K]`: functions, and the coefficients' weights of them.
    functions: Vec<f32>,
    weights: Vec<f32>,
    directions: Vec<DVec3>,
    side_by_side: Vec<f32>,
}

impl FactoredEvaluator<'_> {
    /// [`FactoredEvaluator::overlap_with_gradient`] of up to [`ROWS`] positions within the box and directions of length 1, to the rounding of `f32`.
    pub(crate) fn overlaps_with_gradients(
        &self,
        poses: &[(DVec3, DVec3)],
        found: &mut [Gradient],
        scratch: &mut GradientScratch,
    ) {
        assert!(poses.len() == found.len() && poses.len() <= ROWS, "a gradient for each of {ROWS} poses");
        let (field, rows) = (&*self.field, poses.len());
        let (stack, stride, network) = (self.plan.stack, self.plan.stride(), self.network(rows));
        let (components, count) = (stack.outputs, field.basis.len());
        let GradientScratch {
            places,
            inputs,
            adjoint,
            outputs,
            directions,
            side_by_side,
            functions,
            weights,
        } = scratch;
        places.clear();
        inputs.clear();
        for &(position, direction) in poses {
            let place = field.shape.symmetry.place(position);
            let local = place.to_local(direction);
            inputs.extend_from_slice(&field.shape.symmetry.inputs_at(&field.grid, &place));
            places.push((place, local));
        }
        directions.clear();
        directions.extend(places.iter().map(|(_, local)| *local));
        functions.resize(rows * count, 0.0);
        field.basis.values_of_directions(directions, functions, side_by_side);
        weights.resize(rows * count, 0.0);

        // The network's outputs are coefficients but for the scale, which weights and derivatives get in the end.
        let axes = Axes { u: &field.components, components, split: self.split_functions.as_ref() };
        let by_inputs = network.by_inputs(inputs, adjoint, |last| {
            if stack.ending == Ending::Sines {
                axes.weights((last, rows, stride), weights, false);
                axes.along(functions, rows, (last, stride));
            } else {
                outputs.resize(rows * components, 0.0);
                network.outputs(last, outputs);
                axes.weights((outputs, rows, components), weights, false);
                axes.along(functions, rows, (outputs, components));
                network.products_backwards(stack.hidden, (outputs, rows, components), None, last);
            }
        });

        vectorised!(self.arch, {
            for weights in weights.chunks_exact_mut(count) {
                for (weight, mean) in weights.iter_mut().zip(&field.mean) {
                    *weight = *weight * field.scale + mean;
                }
            }
        });
        field.basis.sums_with_gradients(directions, weights, side_by_side, |row, (value, turn)| {
            let ((place, local), by_inputs) = (&places[row], &by_inputs[row * stack.inputs..]);
            let by = |input: usize| f64::from(field.scale * by_inputs[input]);
            let angle = place.angle_slopes(field.blunt());
            let mut position = DVec3::from_array([0, 1, 2].map(by)) * field.inverse_length();
            for (axis, slopes) in angle.into_iter().enumerate() {
                position[axis] += slopes
                    .into_iter()
                    .zip(3..stack.inputs)
                    .map(|(slope, input)| slope * by(input))
                    .sum::<f64>();
            }
            let [position, direction] = place.slopes_in_world(*local, position, turn, field.blunt());
            let rotation = poses[row].1.cross(direction);
            found[row] = Gradient { value: value as f32, position, direction, rotation };
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factored::{Axis, PointScratch, Symmetry};
    use crate::field::scenes::{assert_gradients_agree, factored_file, scene, with_symmetry};
    use imf_core::tool::Tool;

    #[test]
    fn gradients_of_many_poses_are_those_of_each_by_itself() {
        let scene = scene(&Tool::paper(), 0.0);
        let through = scene.record.grid.origin + 0.5 * scene.record.grid.size();
        let axis = Some(Axis { along: 0, through });
        let turned = with_symmetry(&scene, Symmetry { mirrors: [None, Some(through.y), None], axis });
        let plain = factored_file(&scene);
        for field in [plain.field.clone(), plain.field.folded(), turned.field.clone(), turned.field.fold()] {
            let evaluator = field.evaluator();
            let (mut scratch, mut of_point) = (GradientScratch::default(), PointScratch::default());
            assert_gradients_agree(
                &scene,
                |poses, found| evaluator.overlaps_with_gradients(poses, found, &mut scratch),
                |at, facing| evaluator.overlap_with_gradient(at, facing, &mut of_point).unwrap(),
            );
        }
    }
}
