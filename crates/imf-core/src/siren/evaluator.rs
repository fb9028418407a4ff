//! The CPU evaluation engine: values of a network at any number of poses, and minima over directions, on the current
//! rayon pool. A block of samples at a time, so that memory does not grow with the number of poses.

use pulp::Arch;
use rayon::prelude::*;

use super::forward::{Network, sigmoid};
use super::matrix::prefer_unpacked;
use super::plan::{BLOCK, Plan, transpose_all};
use super::scratch::{ScratchPool, describe};
use crate::siren::{INPUTS, SirenShape, features};
use crate::training::{EngineError, EvaluationEngine};

/// Samples of the points that one thread takes the minimum for without pause: 32 blocks.
const MINIMUM_SAMPLES: usize = 32 * BLOCK;

/// Evaluates a network on the CPU; runs on the rayon pool that it is called in.
pub struct CpuEvaluator {
    arch: Arch,
    plan: Plan,
    parameters: Vec<f32>,
    panels: Vec<f32>,
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
        shape.check_parameters(parameters).map_err(refused)?;
        prefer_unpacked();
        let plan = Plan::new(shape.stack());
        let mut panels = vec![0.0; parameters.len()];
        transpose_all(&plan, parameters, &mut panels);
        let scratch = ScratchPool::new(BLOCK * (2 * plan.stride() + INPUTS + 1));
        Ok(Self { arch: Arch::new(), plan, parameters: parameters.to_vec(), panels, scratch })
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
        Ok(())
    }

    /// Values of at most one block. `scratch` holds two layers of a block.
    fn block(&self, inputs: &[f32], outputs: &mut [f32], scratch: &mut [f32]) {
        let network =
            Network { arch: self.arch, plan: &self.plan, parameters: &self.parameters, panels: &self.panels };
        let (first, second) = scratch.split_at_mut(BLOCK * self.plan.stride());
        let last = network.hidden_layers(inputs, first, second);
        network.outputs(last, outputs);
        for output in outputs {
            *output = sigmoid(*output) as f32;
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
            self.block(&inputs[..count * INPUTS], &mut outputs[..count], layers);
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

impl EvaluationEngine for CpuEvaluator {
    fn describe(&self) -> String {
        describe(self.arch)
    }

    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError> {
        if inputs.len() != outputs.len() * INPUTS {
            let (inputs, outputs) = (inputs.len(), outputs.len());
            return Err(EngineError::Shape(format!(
                "{inputs} inputs for {outputs} values; {INPUTS} belong to each"
            )));
        }
        let blocks = inputs.par_chunks(BLOCK * INPUTS).zip(outputs.par_chunks_mut(BLOCK));
        blocks
            .for_each(|(inputs, outputs)| self.scratch.with(|scratch| self.block(inputs, outputs, scratch)));
        Ok(())
    }

    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError> {
        if least.len() != points.len() || best.len() != points.len() {
            let (points, least, best) = (points.len(), least.len(), best.len());
            return Err(EngineError::Shape(format!(
                "{points} points, but room for {least} minima and {best} indices"
            )));
        }
        if directions.is_empty() || u32::try_from(directions.len()).is_err() {
            let count = directions.len();
            return Err(EngineError::Shape(format!(
                "a minimum over {count} directions; it takes 1 to 2^32 − 1"
            )));
        }
        let group = MINIMUM_SAMPLES.div_ceil(directions.len());
        points.par_chunks(group).zip(least.par_chunks_mut(group)).zip(best.par_chunks_mut(group)).for_each(
            |((points, least), best)| {
                self.scratch.with(|scratch| self.block_minimum(points, directions, least, best, scratch));
            },
        );
        Ok(())
    }
}
