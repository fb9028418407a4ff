//! The network, its loss and one Adam step in f64, written as the mathematics: the definition that every fast
//! engine is tested against. Slow on purpose.

use super::output::Output;
use super::stack::Stack;
use super::{INPUTS, SirenShape};
use crate::recipe::{AdamConfig, Loss};

/// Value of the network at one sample.
///
/// # Panics
/// If `parameters` does not fit `shape`.
pub fn forward(shape: &SirenShape, parameters: &[f64], input: &[f64; INPUTS]) -> f64 {
    output(&activations(&shape.stack(), parameters, input)).value()
}

/// What a forward pass retains for the backward pass.
pub(crate) struct Activations {
    /// Input of every layer, the skip's input appended.
    inputs: Vec<Vec<f64>>,
    /// Pre-activation `W·a + b` of every layer; the last one's are the stack's outputs.
    pub(crate) sums: Vec<Vec<f64>>,
}

/// A stack's forward pass for one sample.
pub(crate) fn activations(stack: &Stack, parameters: &[f64], input: &[f64]) -> Activations {
    let omega = f64::from(stack.omega);
    let mut kept = Activations { inputs: Vec::new(), sums: Vec::new() };
    let mut signal = input.to_vec();
    for layer in stack.layers() {
        if layer.skip {
            signal.extend_from_slice(input);
        }
        let sums: Vec<f64> = (0..layer.outputs)
            .map(|row| {
                let weights = &parameters[layer.weights + row * layer.inputs..][..layer.inputs];
                let product: f64 = weights.iter().zip(&signal).map(|(w, a)| w * a).sum();
                product + parameters[layer.biases + row]
            })
            .collect();
        kept.inputs.push(std::mem::replace(&mut signal, sums.iter().map(|s| (omega * s).sin()).collect()));
        kept.sums.push(sums);
    }
    kept
}

/// A stack's backward pass for one sample, from `delta` of its outputs: adds to `gradient`, the parameters', and returns
/// the inputs'.
pub(crate) fn backward(
    stack: &Stack,
    parameters: &[f64],
    kept: &Activations,
    mut delta: Vec<f64>,
    gradient: &mut [f64],
) -> Vec<f64> {
    let omega = f64::from(stack.omega);
    let mut of_inputs = vec![0.0; stack.inputs];
    // δ = ∂loss/∂(W·a + b) of the layer at hand, from the output backwards.
    for (index, layer) in stack.layers().iter().enumerate().rev() {
        let signal = &kept.inputs[index];
        let mut upstream = vec![0.0; layer.inputs];
        for row in 0..layer.outputs {
            for column in 0..layer.inputs {
                gradient[layer.weights + row * layer.inputs + column] += delta[row] * signal[column];
                upstream[column] += delta[row] * parameters[layer.weights + row * layer.inputs + column];
            }
            gradient[layer.biases + row] += delta[row];
        }
        let neurons = layer.inputs - if layer.skip || index == 0 { stack.inputs } else { 0 };
        of_inputs.iter_mut().zip(&upstream[neurons..]).for_each(|(slope, up)| *slope += up);
        if index > 0 {
            delta = kept.sums[index - 1]
                .iter()
                .zip(&upstream)
                .map(|(sum, up)| up * omega * (omega * sum).cos())
                .collect();
        }
    }
    of_inputs
}

fn output(kept: &Activations) -> Output {
    Output::of_sum(kept.sums.last().map_or(0.0, |sums| sums[0]))
}

/// Mean loss of a batch and its gradient with respect to every parameter, each sample counted by [`Loss::weight`] in that.
///
/// # Panics
/// If the lengths of `inputs`, `targets` or `parameters` do not fit.
pub fn loss_and_gradient(
    shape: &SirenShape,
    parameters: &[f64],
    inputs: &[[f64; INPUTS]],
    targets: &[f64],
    loss: Loss,
) -> (f64, Vec<f64>) {
    assert_eq!(inputs.len(), targets.len(), "one target for each input");
    let stack = shape.stack();
    let mut gradient = vec![0.0; parameters.len()];
    let mut total = 0.0;
    let count = inputs.len() as f64;
    for (input, &target) in inputs.iter().zip(targets) {
        let kept = activations(&stack, parameters, input);
        let (output, slope) = output(&kept).learnt(target);
        total += loss.value(output, target) / count;
        let delta = loss.slope(output, target) / count * slope;
        backward(&stack, parameters, &kept, vec![delta], &mut gradient);
    }
    (total, gradient)
}

/// Gradient of the network's value with respect to its five inputs at one sample.
///
/// # Panics
/// If `parameters` does not fit `shape`.
pub fn input_gradient(shape: &SirenShape, parameters: &[f64], input: &[f64; INPUTS]) -> [f64; INPUTS] {
    let stack = shape.stack();
    let kept = activations(&stack, parameters, input);
    let delta = vec![output(&kept).slope()];
    let slopes = backward(&stack, parameters, &kept, delta, &mut vec![0.0; parameters.len()]);
    std::array::from_fn(|axis| slopes[axis])
}

/// One Adam step with coupled L2: the gradient grows by `weight_decay · w` before the moments see it.
/// `step` counts from 1.
pub fn adam_step(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    parameters: &mut [f64],
    gradient: &[f64],
    first_moment: &mut [f64],
    second_moment: &mut [f64],
) {
    let (beta1, beta2) = (f64::from(config.beta1), f64::from(config.beta2));
    let correction1 = 1.0 - beta1.powf(step as f64);
    let correction2 = 1.0 - beta2.powf(step as f64);
    for index in 0..parameters.len() {
        let slope = gradient[index] + f64::from(config.weight_decay) * parameters[index];
        first_moment[index] = beta1 * first_moment[index] + (1.0 - beta1) * slope;
        second_moment[index] = beta2 * second_moment[index] + (1.0 - beta2) * slope * slope;
        let denominator = (second_moment[index] / correction2).sqrt() + f64::from(config.epsilon);
        parameters[index] -= learning_rate * (first_moment[index] / correction1) / denominator;
    }
}

/// What the definition takes of an engine's numbers.
pub fn as_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// Rows of so many numbers, as [`as_f64`].
pub fn rows<const N: usize>(values: &[f32]) -> Vec<[f64; N]> {
    values.chunks_exact(N).map(|row| std::array::from_fn(|i| f64::from(row[i]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: SirenShape = SirenShape { width: 6, hidden: 4, skip_after: Some(2), omega: 3.0 };
    const INPUT: [f64; INPUTS] = [0.3, -0.2, 0.7, -0.9, 0.1];

    /// A bias of the output that puts it below 0, where it is clamped.
    const BELOW: f64 = -6.0;

    fn parameters(bias: f64) -> Vec<f64> {
        let mut parameters: Vec<f64> = SHAPE.initial_parameters(3).into_iter().map(f64::from).collect();
        *parameters.last_mut().unwrap() = bias;
        parameters
    }

    /// Central differences have an error of h²·|f‴|/6 + ε/h: about 1e-9 here at h = 1e-5, with room for |f‴| ~ 100.
    const TOLERANCE: f64 = 2e-8;

    #[test]
    fn parameter_gradient_agrees_with_central_differences() {
        let inputs = [INPUT, [0.9, 0.4, -0.6, 0.2, -0.8], [-0.4, 0.1, 0.8, -0.2, 0.5]];
        let targets = [0.1, 0.9, 0.0];
        for (loss, bias) in
            [Loss::L1, Loss::L2, Loss::L1Small].into_iter().flat_map(|loss| [(loss, 0.2), (loss, BELOW)])
        {
            let weights = parameters(bias);
            let (_, gradient) = loss_and_gradient(&SHAPE, &weights, &inputs, &targets, loss);
            let one = |w: &[f64], input, target| {
                loss.weight(target) * loss_and_gradient(&SHAPE, w, &[input], &[target], loss).0
            };
            let value =
                |w: &[f64]| inputs.into_iter().zip(targets).map(|(x, t)| one(w, x, t)).sum::<f64>() / 3.0;
            let mut failures = Vec::new();
            for index in 0..weights.len() {
                let mut probe = weights.clone();
                probe[index] += 1e-5;
                let above = value(&probe);
                probe[index] -= 2e-5;
                let slope = (above - value(&probe)) / 2e-5;
                if (slope - gradient[index]).abs() > TOLERANCE {
                    failures.push(format!("{loss:?} {index}: {slope} against {}", gradient[index]));
                }
            }
            assert!(failures.is_empty(), "{}", failures.join("\n"));
        }
    }

    #[test]
    fn input_gradient_agrees_with_central_differences() {
        let clamped = parameters(BELOW);
        assert_eq!(
            (forward(&SHAPE, &clamped, &INPUT), input_gradient(&SHAPE, &clamped, &INPUT)),
            (0.0, [0.0; INPUTS])
        );
        let weights = parameters(0.2);
        let gradient = input_gradient(&SHAPE, &weights, &INPUT);
        for axis in 0..INPUTS {
            let mut probe = INPUT;
            probe[axis] += 1e-5;
            let above = forward(&SHAPE, &weights, &probe);
            probe[axis] -= 2e-5;
            let slope = (above - forward(&SHAPE, &weights, &probe)) / 2e-5;
            assert!((slope - gradient[axis]).abs() < TOLERANCE, "{axis}: {slope} against {}", gradient[axis]);
        }
    }

    #[test]
    fn the_first_adam_step_is_the_learning_rate_against_the_gradients_sign() {
        let config = AdamConfig { weight_decay: 0.0, ..AdamConfig::default() };
        let (mut weights, mut first, mut second) = ([1.0, 1.0], [0.0; 2], [0.0; 2]);
        adam_step(&config, 0.1, 1, &mut weights, &[5.0, -0.5], &mut first, &mut second);
        assert!((weights[0] - 0.9).abs() < 1e-6 && (weights[1] - 1.1).abs() < 1e-6);
    }
}
