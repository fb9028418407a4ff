//! The CPU engine as the training loop sees it.

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::plan::transpose_all;
use imf_fields::siren::scratch::describe;

use super::CpuTrainer;
use super::adam::AdamFactors;
use super::matrices::Matrices;
use crate::training::TrainingEngine;

impl TrainingEngine for CpuTrainer {
    fn describe(&self) -> String {
        let engine = describe(self.arch);
        match &self.pairs {
            Some(pairs) => format!("{engine}, products in bfloat16 ({})", pairs.kernel().name()),
            None => engine,
        }
    }

    fn inputs(&self) -> usize {
        self.plan.stack.inputs
    }

    fn outputs(&self) -> usize {
        self.plan.stack.outputs
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let batch = targets.len() / self.plan.stack.outputs;
        if batch == 0 {
            return Err(self.refusal(0));
        }
        self.check(inputs, targets)?;
        self.state.step += 1;
        let factors = AdamFactors::new(self.adam, learning_rate, self.state.step);
        let total = self.accumulate(inputs, targets, batch, Some(factors));
        self.step_matrices(learning_rate);
        self.loss_sum += total / batch as f64;
        self.loss_steps += 1;
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        let mean = if self.loss_steps == 0 { 0.0 } else { self.loss_sum / self.loss_steps as f64 };
        (self.loss_sum, self.loss_steps) = (0.0, 0);
        Ok(mean)
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        let matrices = self.matrices.as_ref().filter(|_| self.state.step > 0);
        let preconditioners = matrices.map_or(Vec::new(), Matrices::kept);
        Ok(TrainingState { preconditioners, ..self.state.clone() })
    }

    fn weights(&mut self) -> Result<Vec<f32>, EngineError> {
        Ok(self.state.parameters.clone())
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.plan.stack.check_parameters(parameters)?;
        self.state.parameters.copy_from_slice(parameters);
        transpose_all(&self.plan, parameters, &mut self.panels);
        Ok(())
    }
}
