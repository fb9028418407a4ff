//! Training: the loss, the optimiser's settings, and the seam between the loop that feeds batches and the engine
//! that runs a step (CPU here, GPU in `imf-gpu`).

pub mod divergence;
pub mod online;
pub mod permutation;
pub mod run;
pub mod schedule;
pub mod streamed;

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::siren::{INPUTS, SirenShape};

/// What a step minimises, averaged over the batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// Mean absolute error, the paper's choice.
    #[default]
    L1,
    /// Mean squared error.
    L2,
}

impl Loss {
    /// Loss of one value.
    #[must_use]
    pub fn value(self, output: f64, target: f64) -> f64 {
        let error = output - target;
        match self {
            Self::L1 => error.abs(),
            Self::L2 => error * error,
        }
    }

    /// Derivative of the loss with respect to the output; 0 where L1 has a corner.
    #[must_use]
    pub fn slope(self, output: f64, target: f64) -> f64 {
        let error = output - target;
        match self {
            Self::L1 if error == 0.0 => 0.0,
            Self::L1 => error.signum(),
            Self::L2 => 2.0 * error,
        }
    }
}

/// What the products between hidden layers are computed in; everything else is `f32`, sums of products among it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// `f32`.
    #[default]
    F32,
    /// Factors rounded to bfloat16 (8 bits of mantissa), on CPUs that have instructions for them.
    Bf16,
    /// Factors rounded to binary16 (11 bits of mantissa), on GPUs that have it.
    F16,
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
            Self::F16 => "f16",
        })
    }
}

/// Adam's settings; the defaults are the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the root of the second moment.
    pub epsilon: f32,
    /// Coupled L2: `weight_decay · w` is added to the gradient before the moments see it.
    pub weight_decay: f32,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 1e-6 }
    }
}

/// Everything a step changes: enough to continue bit for bit on the same engine.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState {
    /// Weights and biases in the layout of [`SirenShape::layers`].
    pub parameters: Vec<f32>,
    /// Adam's first moments, same layout.
    pub first_moment: Vec<f32>,
    /// Adam's second moments, same layout.
    pub second_moment: Vec<f32>,
    /// What the optimiser keeps of matrices beside the moments: SOAP's means and axes ([`crate::siren::soap`]), of each matrix
    /// rows' mean and axes, then columns', `[size][size]` each. Empty by other optimisers, and before the first step.
    pub preconditioners: Vec<f32>,
    /// Steps done since the moments were zero.
    pub step: u64,
}

impl TrainingState {
    /// Random starting weights and zero moments.
    #[must_use]
    pub fn new(shape: &SirenShape, seed: u64) -> Self {
        Self::from_parameters(shape.initial_parameters(seed))
    }

    /// Given weights and zero moments: where fine-tuning starts.
    #[must_use]
    pub fn from_parameters(parameters: Vec<f32>) -> Self {
        let zeros = vec![0.0; parameters.len()];
        Self {
            first_moment: zeros.clone(),
            second_moment: zeros,
            parameters,
            preconditioners: Vec::new(),
            step: 0,
        }
    }

    /// True where every number is one that training can go on with.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        [&self.parameters, &self.first_moment, &self.second_moment, &self.preconditioners]
            .into_iter()
            .all(|array| array.iter().all(|value| value.is_finite()))
    }
}

/// Why an engine stopped; the state it had before is with the caller's last checkpoint.
#[derive(Debug, Error)]
pub enum EngineError {
    /// The device is gone or out of memory, or a call to it failed.
    #[error("{0}")]
    Device(String),
    /// A batch, a shape or a state that does not fit.
    #[error("{0}")]
    Shape(String),
}

/// Where a training step runs: one of the project's four seams.
///
/// The same state, batches and rates give the same bits on the same engine and machine.
pub trait TrainingEngine {
    /// The engine's name for people: device, driver, threads.
    fn describe(&self) -> String;

    /// Values that describe a sample.
    fn inputs(&self) -> usize {
        INPUTS
    }

    /// Values that are learnt of a sample.
    fn outputs(&self) -> usize {
        1
    }

    /// Announces the next step's batch of `batch` samples, and says which of its rows this engine wants as that step's
    /// input. The others are those of other processes that train together with this one; unless there are any, it
    /// wants all.
    fn share(&mut self, batch: usize) -> Range<usize> {
        0..batch
    }

    /// One step on a batch: forward, backward, update.
    ///
    /// `inputs` is `[batch][inputs]`, `targets` is `[batch][outputs]`; any batch size from 1 up to the one the engine was made
    /// for. Work may still be under way on the device when the call returns.
    ///
    /// # Errors
    /// A batch that does not fit, or a device that failed.
    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError>;

    /// Mean of the batches' mean losses since the last call of this function; 0 if there was no step. Waits for
    /// the device.
    ///
    /// # Errors
    /// A device that failed.
    fn take_mean_loss(&mut self) -> Result<f64, EngineError>;

    /// A copy of the weights, moments and step count. Waits for the device.
    ///
    /// # Errors
    /// A device that failed.
    fn state(&mut self) -> Result<TrainingState, EngineError>;

    /// A copy of the weights alone. Waits for the device.
    ///
    /// # Errors
    /// A device that failed.
    fn weights(&mut self) -> Result<Vec<f32>, EngineError> {
        Ok(self.state()?.parameters)
    }

    /// Replaces the weights, such as by better ones for the last layer; moments and step count stay.
    ///
    /// # Errors
    /// Weights that do not fit, or a device that failed.
    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError>;
}

/// Where a trained network is evaluated in batches.
pub trait EvaluationEngine {
    /// The engine's name for people: device, driver, threads.
    fn describe(&self) -> String;

    /// Values of the network at `inputs` (`[n][5]`, any n) into `outputs` (`[n]`).
    ///
    /// # Errors
    /// Lengths that do not fit, or a device that failed.
    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError>;

    /// About how many values to ask for between two looks at whether to go on: some seconds' work of a large network.
    fn values_at_once(&self) -> usize {
        1 << 18
    }

    /// For each point the least value over all directions and the index of the first direction that has it.
    ///
    /// `points` is `[n][3]` in unit coordinates of the grid, `directions` is `[m][2]` in degrees (θ, φ); `least` and
    /// `best` are `[n]`. The minimum is taken where the network runs: memory does not grow with n·m.
    ///
    /// # Errors
    /// Lengths that do not fit, no direction, or a device that failed.
    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError>;
}
