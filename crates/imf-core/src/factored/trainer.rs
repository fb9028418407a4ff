//! The CPU engine that trains g: the house's engine of sine stacks, and a running average of the weights beside it.

use serde::{Deserialize, Serialize};

use super::FactoredShape;
use crate::siren::engine::CpuTrainer;
use crate::siren::muon::MuonConfig;
use crate::training::run::Cursor;
use crate::training::{AdamConfig, EngineError, Loss, TrainingEngine, TrainingState};

/// How the weights follow the gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimiser {
    /// Adam for every weight.
    #[default]
    Adam,
    /// Orthogonalised momentum for the matrices between hidden layers, Adam for the rest.
    Muon(MuonConfig),
}

/// Everything that teaching changes: enough to go on to the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredState {
    /// Weights, moments and steps.
    pub training: TrainingState,
    /// Running average of the weights; empty where none is kept.
    pub averaged: Vec<f32>,
    /// Where the plan stands.
    pub cursor: Cursor,
}

impl FactoredState {
    /// Random starting weights; `averaging` says whether an average is kept.
    #[must_use]
    pub fn new(shape: &FactoredShape, seed: u64, averaging: bool) -> Self {
        Self::from_parameters(shape.initial_parameters(seed), averaging)
    }

    /// Given weights: where fine-tuning starts.
    #[must_use]
    pub fn from_parameters(parameters: Vec<f32>, averaging: bool) -> Self {
        Self {
            averaged: if averaging { parameters.clone() } else { Vec::new() },
            training: TrainingState::from_parameters(parameters),
            cursor: Cursor::default(),
        }
    }

    /// The weights to use: the average where there is one.
    #[must_use]
    pub fn best(&self) -> &[f32] {
        if self.averaged.is_empty() { &self.training.parameters } else { &self.averaged }
    }
}

/// Trains g on the CPU; runs on the rayon pool that `step` is called in.
pub struct FactoredTrainer {
    engine: CpuTrainer,
    averaged: Vec<f32>,
    /// Share of the average that a step leaves.
    decay: f32,
}

impl FactoredTrainer {
    /// An engine for batches of up to `max_batch` points that continues from `state`. `decay` is the share of the average
    /// that a step leaves, of no effect where the state keeps none.
    ///
    /// # Errors
    /// A shape or a batch out of range, or a state that does not fit.
    pub fn new(
        shape: FactoredShape,
        adam: AdamConfig,
        loss: Loss,
        optimiser: Optimiser,
        decay: f32,
        max_batch: usize,
        state: &FactoredState,
    ) -> Result<Self, EngineError> {
        if !state.averaged.is_empty() && state.averaged.len() != state.training.parameters.len() {
            let (found, expected) = (state.averaged.len(), state.training.parameters.len());
            return Err(EngineError::Shape(format!("an average of {found} weights for {expected}")));
        }
        let mut engine = CpuTrainer::of_stack(shape.stack(), adam, loss, max_batch, state.training.clone())?;
        if let Optimiser::Muon(config) = optimiser {
            engine.use_muon(config);
        }
        Ok(Self { engine, averaged: state.averaged.clone(), decay })
    }

    /// Where training stands, at a cursor that the loop knows.
    ///
    /// # Errors
    /// None on the CPU.
    pub fn state_at(&mut self, cursor: Cursor) -> Result<FactoredState, EngineError> {
        Ok(FactoredState { training: self.engine.state()?, averaged: self.averaged.clone(), cursor })
    }

    #[cfg(test)]
    pub(super) fn gradient(&self) -> &[f32] {
        self.engine.gradient()
    }
}

impl TrainingEngine for FactoredTrainer {
    fn describe(&self) -> String {
        self.engine.describe()
    }

    fn inputs(&self) -> usize {
        self.engine.inputs()
    }

    fn outputs(&self) -> usize {
        self.engine.outputs()
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        self.engine.step(inputs, targets, learning_rate)?;
        // Early averages forget faster, so that the random start leaves no trace.
        let steps = self.engine.steps() as f32;
        let kept = self.decay.min((1.0 + steps) / (10.0 + steps));
        for (average, &weight) in self.averaged.iter_mut().zip(self.engine.parameters()) {
            *average += (1.0 - kept) * (weight - *average);
        }
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        self.engine.take_mean_loss()
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        self.engine.state()
    }
}
