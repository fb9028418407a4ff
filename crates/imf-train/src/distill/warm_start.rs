//! Warm start for a changed part: a network distilled from one harmonic field as the start of another's.
//!
//! Nothing is lost in between: the network's value at a world position stays the same, except for what the other
//! field's components leave out. Positions are scaled by the grid, which the first layer takes back; coefficients are
//! along the axes and in units of the scale, which the last layer turns to the other's.

use super::output_layer::{IN_TRAINING, solve_output_layer};
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_fields::factored::targets::{ComponentBasis, Targets};
use imf_fields::factored::{FactoredField, FactoredShape, FactoredState, INPUTS};
use imf_fields::harmonic::HarmonicField;
use imf_fields::siren::{Layer, ShapeError};

/// Where fine-tuning starts: the network of another field, such as that of the part before it was changed, turned to
/// this harmonic field's grid and axes, with the best output layer for it. Its symmetry stays; `obstacle` is what that is of.
///
/// # Errors
/// Weights that do not fit their shape; mirror planes that the harmonic field does not have.
///
/// # Panics
/// If one field is over directions and the other over rotations.
pub fn start_from(
    from: &FactoredField,
    harmonic: &HarmonicField,
    obstacle: &Occupancy,
) -> Result<FactoredState, ShapeError> {
    let symmetry = from.shape.symmetry;
    if !symmetry.holds_in(harmonic, obstacle) {
        return Err(ShapeError::OtherSymmetry(symmetry.to_string()));
    }
    let targets = Targets::new(harmonic, symmetry)?;
    let shape = FactoredShape { components: targets.outputs(), folded: false, ..from.shape };
    let parameters = parameters_for(from, harmonic, &targets)?;
    let mut field = ComponentBasis::of(harmonic, &targets).field(shape, parameters)?;
    // Other voxels than those of a solution before the first step.
    solve_output_layer(&mut field, &targets, IN_TRAINING, 0.5);
    Ok(FactoredState::from_parameters(field.parameters))
}

/// A network's weights, turned to the grid, axes, mean and scale of `harmonic`: the same field where that has all
/// components of at least this field's degree.
///
/// # Errors
/// Weights that do not fit the shape.
///
/// # Panics
/// If one field is over directions and the other over rotations.
pub(super) fn parameters_for(
    field: &FactoredField,
    harmonic: &HarmonicField,
    targets: &Targets<'_>,
) -> Result<Vec<f32>, ShapeError> {
    assert_eq!(field.basis.domain(), harmonic.basis.domain(), "fields over the same orientations");
    field.shape.stack().check_parameters(&field.parameters)?;
    if field.shape.folded {
        return parameters_for(&field.unfolded(), harmonic, targets);
    }
    let components = targets.outputs();
    let shape = FactoredShape { components, ..field.shape };
    let mut parameters = vec![0.0; shape.parameter_count()];
    let (layers, new_layers) = (field.shape.layers(), shape.layers());
    let Some((last, hidden)) = layers.split_last() else { return Ok(parameters) };
    // Hidden layers stand at the same places in both.
    let end = hidden.last().map_or(0, |layer| layer.biases + layer.outputs);
    parameters[..end].copy_from_slice(&field.parameters[..end]);
    if let Some(first) = hidden.first() {
        let middle = |grid: &Grid| grid.origin + 0.5 * grid.size();
        let units = field.inverse_length();
        let ratio = units * 0.5 * harmonic.grid.size().max_element();
        let shift = ((middle(&harmonic.grid) - middle(&field.grid)) * units).to_array();
        for neuron in 0..first.outputs {
            let from = first.weights + neuron * first.inputs;
            let row: [f64; INPUTS] = std::array::from_fn(|axis| f64::from(field.parameters[from + axis]));
            let moved: f64 = row.iter().zip(shift).map(|(&w, t)| w * t).sum();
            for (axis, weight) in row.into_iter().enumerate() {
                parameters[from + axis] = (weight * ratio) as f32;
            }
            let bias = first.biases + neuron;
            parameters[bias] = (f64::from(field.parameters[bias]) + moved) as f32;
        }
    }
    turn_last(field, last, targets, &mut parameters[new_layers[hidden.len()].weights..]);
    Ok(parameters)
}

/// The linear layer: `g' = (U'ᵀ(μ + s U g − μ'))/s'`, its weights then its biases into `out`.
fn turn_last(field: &FactoredField, last: &Layer, targets: &Targets<'_>, out: &mut [f32]) {
    let (components, mean) = targets.functions();
    let (old, new) = (field.shape.components, components.len() / mean.len());
    let shared = field.basis.len().min(mean.len());
    let scale = f64::from(targets.scale);
    let along = |k: usize, axis: usize| f64::from(components[k * new + axis]);
    let (weights, biases) = out.split_at_mut(new * last.inputs);
    for (axis, (row, bias)) in weights.chunks_exact_mut(last.inputs).zip(biases).enumerate() {
        let mut shifted = 0.0;
        for (k, &mean) in mean.iter().enumerate() {
            let own = if k < shared { f64::from(field.mean[k]) } else { 0.0 };
            shifted += along(k, axis) * (own - f64::from(mean));
        }
        let mut sums = vec![0.0f64; last.inputs];
        for place in 0..old {
            let turn: f64 =
                (0..shared).map(|k| along(k, axis) * f64::from(field.components[k * old + place])).sum();
            let turn = turn * f64::from(field.scale);
            let own = &field.parameters[last.weights + place * last.inputs..][..last.inputs];
            sums.iter_mut().zip(own).for_each(|(sum, &weight)| *sum += turn * f64::from(weight));
            shifted += turn * f64::from(field.parameters[last.biases + place]);
        }
        row.iter_mut().zip(&sums).for_each(|(weight, sum)| *weight = (sum / scale) as f32);
        *bias = (shifted / scale) as f32;
    }
}
