//! g and its loss in f64, written as the mathematics: the definition that the fast engine is tested against.

use glam::DVec3;

use super::{Axis, FactoredShape, INPUTS, Symmetry};
use crate::recipe::Loss;
use crate::siren::reference::{activations, backward};

/// The network's outputs at one sample.
///
/// # Panics
/// If `parameters` does not fit `shape`.
pub fn forward(shape: &FactoredShape, parameters: &[f64], input: &[f64]) -> Vec<f64> {
    let mut outputs = activations(&shape.stack(), parameters, input).sums.pop().unwrap_or_default();
    if shape.folded {
        outputs.iter_mut().for_each(|sum| *sum = (f64::from(shape.omega) * *sum).sin());
    }
    outputs
}

/// Mean over a batch of the loss summed over outputs, and its gradient with respect to every parameter; `targets` is
/// `[sample][components]`.
///
/// # Panics
/// If lengths do not fit.
pub fn loss_and_gradient(
    shape: &FactoredShape,
    parameters: &[f64],
    inputs: &[[f64; INPUTS]],
    targets: &[f64],
    loss: Loss,
) -> (f64, Vec<f64>) {
    let stack = shape.stack();
    assert_eq!(targets.len(), inputs.len() * shape.components, "one row of targets for each input");
    let mut gradient = vec![0.0; parameters.len()];
    let mut total = 0.0;
    let count = inputs.len() as f64;
    for (input, targets) in inputs.iter().zip(targets.chunks_exact(shape.components)) {
        let kept = activations(&stack, parameters, input);
        let outputs = &kept.sums[shape.hidden];
        let pairs = outputs.iter().zip(targets);
        total += pairs.clone().map(|(&output, &target)| loss.value(output, target)).sum::<f64>() / count;
        let delta = pairs.map(|(&output, &target)| loss.slope(output, target) / count).collect();
        backward(&stack, parameters, &kept, delta, &mut gradient);
    }
    (total, gradient)
}

/// The derivatives of every output by the three inputs: `[components][3]`.
///
/// # Panics
/// If `parameters` does not fit `shape`, or the network is folded.
pub fn jacobian(shape: &FactoredShape, parameters: &[f64], input: &[f64; INPUTS]) -> Vec<[f64; INPUTS]> {
    assert!(!shape.folded, "a network with a linear layer");
    let stack = shape.stack();
    let kept = activations(&stack, parameters, input);
    let mut unused = vec![0.0; parameters.len()];
    (0..shape.components)
        .map(|axis| {
            let delta = (0..shape.components).map(|output| f64::from(u8::from(output == axis))).collect();
            let slopes = backward(&stack, parameters, &kept, delta, &mut unused);
            std::array::from_fn(|input| slopes[input])
        })
        .collect()
}

/// Mirrors, axes along x, y and z, and both, at a point, for tests.
pub fn symmetries(at: DVec3) -> [Symmetry; 4] {
    let [x, y, z] = at.to_array();
    let axis = |along| Some(Axis { along, through: at });
    [
        Symmetry { mirrors: [Some(x), None, Some(z)], axis: None },
        Symmetry { mirrors: [None; 3], axis: axis(0) },
        Symmetry { mirrors: [Some(x), Some(y), Some(z)], axis: axis(1) },
        Symmetry { mirrors: [None, Some(y), None], axis: axis(2) },
    ]
}
