//! The CPU evaluation engine: values of a network at any number of poses, and minima over directions, on the current
//! rayon pool. A block of samples at a time, so that memory does not grow with the number of poses.

use std::borrow::Borrow;

use crate::parallel::*;
use pulp::Arch;

use super::adjoint::AdjointScratch;
use super::forward::Network;
use super::matrix::prefer_unpacked;
use super::output::Output;
use super::plan::{BLOCK, Plan, transpose_all};
use super::scratch::{ScratchPool, describe};
use super::split::{GRID, SplitWeights, where_many};
use crate::siren::{EvaluationEngine, INPUTS, SirenShape, check_evaluate, check_minimum, features};
use imf_core::field::EngineError;

/// Samples of the points that one thread takes the minimum for without pause: 32 blocks.
const MINIMUM_SAMPLES: usize = 32 * BLOCK;

/// A value and its derivatives by the five inputs.
pub(crate) const ROWS: usize = 1 + INPUTS;

/// Working memory of a thread that computes derivatives: `[ROWS][neuron]` before and behind a layer, rows as long as
/// the widest input.
#[derive(Default)]
pub(crate) struct TangentScratch {
    signal: Vec<f32>,
    next: Vec<f32>,
}

/// Working memory of a thread that computes derivatives of many samples.
#[derive(Default)]
pub(crate) struct SlopesScratch {
    adjoint: AdjointScratch,
    /// `[row]`.
    sums: Vec<f32>,
}

/// Evaluates a network on the CPU; runs on the rayon pool that it is called in.
pub struct CpuEvaluator {
    arch: Arch,
    plan: Plan,
    parameters: Vec<f32>,
    panels: Vec<f32>,
    pub(crate) split: Option<SplitWeights>,
    scratch: ScratchPool,
}

impl CpuEvaluator {
    /// An engine for the network with these parameters.
    ///
    /// # Errors
    /// A shape out of range, or parameters that do not fit it.
    pub fn new(shape: SirenShape, parameters: &[f32]) -> Result<Self, EngineError> {
        let refused = |error: crate::siren::ShapeError| EngineError::Shape(error.to_string());
        shape.check().map_err(refused)?;
        shape.stack().check_parameters(parameters).map_err(refused)?;
        prefer_unpacked();
        let plan = Plan::new(shape.stack());
        let mut panels = vec![0.0; parameters.len()];
        transpose_all(&plan, parameters, &mut panels);
        let scratch = ScratchPool::new(BLOCK * (2 * plan.stride() + INPUTS + 1));
        let split = SplitWeights::new(&plan, parameters);
        Ok(Self { arch: Arch::new(), plan, parameters: parameters.to_vec(), panels, split, scratch })
    }

    /// Replaces the network's parameters, as training goes on.
    ///
    /// # Errors
    /// Parameters that do not fit the shape.
    pub fn set_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.plan
            .stack
            .check_parameters(parameters)
            .map_err(|error| EngineError::Shape(error.to_string()))?;
        self.parameters.copy_from_slice(parameters);
        transpose_all(&self.plan, &self.parameters, &mut self.panels);
        self.split = SplitWeights::new(&self.plan, &self.parameters);
        Ok(())
    }

    /// Values of any number of samples on the calling thread alone; nothing is allocated but a thread's first buffer.
    pub(crate) fn evaluate_here(&self, inputs: &[f32], outputs: &mut [f32]) {
        assert_eq!(inputs.len(), outputs.len() * INPUTS, "{INPUTS} inputs for each value");
        let asked = outputs.len();
        self.scratch.with(|scratch| {
            for (inputs, outputs) in inputs.chunks(BLOCK * INPUTS).zip(outputs.chunks_mut(BLOCK)) {
                self.block(inputs, outputs, asked, scratch);
            }
        });
    }

    /// The value at one sample and its derivatives by the five inputs, forwards: the sample and five tangents pass
    /// through the network side by side.
    pub(crate) fn value_and_slopes(
        &self,
        input: &[f32; INPUTS],
        scratch: &mut TangentScratch,
    ) -> [f32; ROWS] {
        let (stack, network) = (self.plan.stack, self.network(1));
        let TangentScratch { signal, next } = scratch;
        let widest = stack.width + INPUTS;
        signal.resize(widest * ROWS, 0.0);
        next.resize(widest * ROWS, 0.0);
        let write = |signal: &mut [f32], from: usize| {
            for (row, signal) in signal.chunks_exact_mut(widest).enumerate() {
                for (axis, value) in signal[from..from + INPUTS].iter_mut().enumerate() {
                    *value = if row == 0 { input[axis] } else { f32::from(row == axis + 1) };
                }
            }
        };
        write(signal, 0);
        for index in 0..stack.hidden {
            if self.plan.layers[index].skip {
                write(signal, stack.width);
            }
            network.layer_of_point::<ROWS>(index, widest, signal, next);
            std::mem::swap(signal, next);
        }
        let last = &self.plan.layers[stack.hidden];
        let weights = &self.parameters[last.weights..last.biases];
        let sums: [f64; ROWS] = std::array::from_fn(|row| {
            let bias = if row == 0 { f64::from(self.parameters[last.biases]) } else { 0.0 };
            weights.iter().zip(&signal[row * widest..]).fold(bias, |sum, (w, v)| sum + f64::from(w * v))
        });
        let output = Output::of_sum(sums[0]);
        std::array::from_fn(
            |r| if r == 0 { output.value() as f32 } else { (output.slope() * sums[r]) as f32 },
        )
    }

    /// [`Self::value_and_slopes`] of a few samples, backwards, to the rounding of `f32`.
    pub(crate) fn values_and_slopes(
        &self,
        inputs: &[[f32; INPUTS]],
        found: &mut [[f32; ROWS]],
        scratch: &mut SlopesScratch,
    ) {
        let SlopesScratch { adjoint, sums } = scratch;
        sums.resize(inputs.len(), 0.0);
        let network = self.network(inputs.len());
        let layer = &self.plan.layers[self.plan.stack.hidden];
        let weights = &self.parameters[layer.weights..layer.biases];
        let by_inputs = network.by_inputs(inputs.as_flattened(), adjoint, |last| {
            network.outputs(last, sums);
            let deltas = last.chunks_exact_mut(self.plan.stride());
            for ((found, &sum), delta) in found.iter_mut().zip(&*sums).zip(deltas) {
                let output = Output::of_sum(f64::from(sum));
                found[0] = output.value() as f32;
                let slope = output.slope() as f32;
                delta.iter_mut().zip(weights).for_each(|(delta, weight)| *delta = slope * weight);
            }
        });
        for (found, slopes) in found.iter_mut().zip(by_inputs.as_chunks::<INPUTS>().0) {
            found[1..].copy_from_slice(slopes);
        }
    }

    /// For a call with the given number of samples.
    fn network(&self, asked: usize) -> Network<'_> {
        let network = Network::new(self.arch, &self.plan, &self.parameters, &self.panels);
        Network { split: where_many(self.split.as_ref(), asked), ..network }
    }

    /// Values of at most one block of a larger call. `scratch` holds two layers of a block.
    fn block(&self, inputs: &[f32], outputs: &mut [f32], asked: usize, scratch: &mut [f32]) {
        let network = self.network(asked);
        let (first, second) = scratch.split_at_mut(BLOCK * self.plan.stride());
        let last = network.hidden_layers(inputs, first, second);
        network.outputs(last, outputs);
        for output in outputs {
            *output = Output::of_sum(f64::from(*output)).value() as f32;
        }
    }

    /// Minima of a few points over all directions.
    fn block_minimum(
        &self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
        scratch: &mut [f32],
    ) {
        let (layers, rest) = scratch.split_at_mut(2 * BLOCK * self.plan.stride());
        let (inputs, outputs) = rest.split_at_mut(BLOCK * INPUTS);
        let poses = points.len() * directions.len();
        for first in (0..poses).step_by(BLOCK) {
            let count = BLOCK.min(poses - first);
            for (sample, pose) in inputs.chunks_exact_mut(INPUTS).zip(first..first + count) {
                let [theta, phi] = directions[pose % directions.len()];
                sample.copy_from_slice(&features(points[pose / directions.len()], theta, phi));
            }
            self.block(&inputs[..count * INPUTS], &mut outputs[..count], GRID, layers);
            for (&value, pose) in outputs[..count].iter().zip(first..) {
                let (point, direction) = (pose / directions.len(), pose % directions.len());
                if direction == 0 || value < least[point] {
                    least[point] = value;
                    best[point] = direction as u32;
                }
            }
        }
    }
}

/// An evaluator, or a reference to one.
impl<E: Borrow<CpuEvaluator>> EvaluationEngine for E {
    fn describe(&self) -> String {
        describe((*self).borrow().arch)
    }

    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError> {
        let network = (*self).borrow();
        check_evaluate(inputs, outputs)?;
        let blocks = inputs.par_chunks(BLOCK * INPUTS).zip(outputs.par_chunks_mut(BLOCK));
        blocks.for_each(|(inputs, outputs)| {
            network.scratch.with(|scratch| network.block(inputs, outputs, GRID, scratch));
        });
        Ok(())
    }

    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError> {
        check_minimum(points, directions, least, best)?;
        let network = (*self).borrow();
        let group = MINIMUM_SAMPLES.div_ceil(directions.len());
        points.par_chunks(group).zip(least.par_chunks_mut(group)).zip(best.par_chunks_mut(group)).for_each(
            |((points, least), best)| {
                network
                    .scratch
                    .with(|scratch| network.block_minimum(points, directions, least, best, scratch));
            },
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::siren::lanes::archs;
    use crate::siren::reference::{forward, input_gradient};

    #[test]
    fn slopes_and_values_of_one_thread_are_the_definitions() {
        for (width, skip_after) in [(37, Some(2)), (64, None), (130, Some(1))] {
            let shape = SirenShape { width, hidden: 3, skip_after, omega: 4.0 };
            let parameters = shape.initial_parameters(5);
            let exact: Vec<f64> = parameters.iter().copied().map(f64::from).collect();
            let mut engine = CpuEvaluator::new(shape, &parameters).unwrap();
            let inputs: Vec<[f32; INPUTS]> = (0..150_u32)
                .map(|i| std::array::from_fn(|a| ((i * 37 + a as u32 * 61) % 101) as f32 / 50.5 - 1.0))
                .collect();
            let mut values = vec![f32::NAN; inputs.len()];
            engine.evaluate_here(inputs.as_flattened(), &mut values);
            let (mut scratch, mut found_together) =
                (TangentScratch::default(), vec![[f32::NAN; ROWS]; inputs.len()]);
            // On every instruction set; the best one last.
            for arch in archs().into_iter().rev() {
                let of_plain = found_together.clone();
                engine.arch = arch;
                engine.values_and_slopes(&inputs, &mut found_together, &mut SlopesScratch::default());
                let apart = of_plain.as_flattened().iter().zip(found_together.as_flattened());
                assert!(
                    apart.map(|(one, other)| (one - other).abs()).all(|apart| apart.is_nan() || apart < 1e-4)
                );
            }
            for ((input, value), together) in inputs.iter().zip(values).zip(found_together) {
                let wide = input.map(f64::from);
                let found = engine.value_and_slopes(input, &mut scratch);
                let slopes = input_gradient(&shape, &exact, &wide);
                // Single precision through four layers, each of which multiplies by ω.
                assert!((f64::from(value) - forward(&shape, &exact, &wide)).abs() < 1e-5);
                assert!((value - found[0]).abs() < 1e-5);
                assert!((value - together[0]).abs() < 1e-5);
                for axis in 0..INPUTS {
                    assert!((f64::from(together[1 + axis]) - slopes[axis]).abs() < 1e-4, "{width} {axis}");
                    assert!((f64::from(found[1 + axis]) - slopes[axis]).abs() < 1e-4, "{width} {axis}");
                }
            }
        }
    }
}
