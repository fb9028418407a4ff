//! How a field was trained: everything that a field's file says of its training, and that a trainer reads.
//!
//! Plain data with checks. What acts on it is in the crate that trains.

#[doc(hidden)]
pub mod divergence;
mod sampling;
pub mod schedule;

pub use sampling::{Sampling, SamplingError};

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::siren::SirenShape;
use schedule::{Schedule, is_default};

/// A setting of a training that is out of range, by name.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("training plan: {0}")]
pub struct RecipeError(pub String);

/// What a step minimises, averaged over the batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Mean absolute error, the paper's choice.
    #[default]
    L1,
    /// Mean squared error.
    L2,
    /// Mean absolute error whose gradient weights a sample more the smaller its target is, up to `1 +`
    /// [`Loss::SMALL_MORE`] times: the minimum over directions consists of small values. For the paper's network
    /// where it is wide and trained long. The reported loss is the plain mean.
    L1Small,
}

impl Loss {
    /// What a target of 0 counts beyond a large one.
    pub const SMALL_MORE: f64 = 6.0;
    /// The target at which that has fallen to 1/e.
    pub const SMALL_BELOW: f64 = 0.03;

    /// What a sample counts in the gradient.
    #[must_use]
    pub fn weight(self, target: f64) -> f64 {
        match self {
            Self::L1 | Self::L2 => 1.0,
            Self::L1Small => 1.0 + Self::SMALL_MORE * (-target.max(0.0) / Self::SMALL_BELOW).exp(),
        }
    }

    /// Loss of one value.
    #[must_use]
    pub fn value(self, output: f64, target: f64) -> f64 {
        let error = output - target;
        match self {
            Self::L1 | Self::L1Small => error.abs(),
            Self::L2 => error * error,
        }
    }

    /// Derivative of the loss with respect to the output, times [`Self::weight`]; 0 where L1 has a corner.
    #[must_use]
    pub fn slope(self, output: f64, target: f64) -> f64 {
        let error = output - target;
        match self {
            Self::L1 | Self::L1Small if error == 0.0 => 0.0,
            Self::L1 | Self::L1Small => self.weight(target) * error.signum(),
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

/// Settings of SOAP.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoapConfig {
    /// Exponential decay of moments and Gram matrices (the paper's β).
    pub beta: f32,
    /// Steps between two updates of the eigenvectors (the paper's f).
    pub precondition_every: u64,
    /// Learning rate over that of the other weights.
    pub rate: f32,
}

impl Default for SoapConfig {
    fn default() -> Self {
        Self { beta: 0.95, precondition_every: 10, rate: 1.0 }
    }
}

/// How the weights follow the gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimiser {
    /// Adam for every weight.
    #[default]
    Adam,
    /// Adam along the axes of their gradients for the matrices between hidden layers, Adam for the rest.
    Soap(SoapConfig),
}

impl Optimiser {
    /// Numbers that a state holds for a matrix between hidden layers beside weights and moments, after the first
    /// step: SOAP's means and axes of both sides.
    #[must_use]
    pub fn state_count(self, rows: usize, columns: usize) -> usize {
        match self {
            Self::Adam => 0,
            Self::Soap(_) => 2 * (rows * rows + columns * columns),
        }
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
    /// State of the optimiser beside the moments: for each matrix SOAP's mean and axes of the rows, then of the
    /// columns, `[size][size]` each. Empty with other optimisers, and before the first step.
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

/// How long to train.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TrainingLength {
    /// Passes over all samples.
    Epochs(u64),
    /// Steps, whatever the number of samples; the last epoch may be cut short.
    Steps(u64),
}

/// Everything that decides a training run beside the network, its starting state and the samples.
///
/// The default is the paper's preset `single`: L1, Adam at 5e-4 · 0.93^epoch with weight decay 1e-6, batches of 1024,
/// 50 epochs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingPlan {
    /// How long to train.
    pub length: TrainingLength,
    /// Samples of a step.
    pub batch: usize,
    /// Learning rate.
    pub schedule: Schedule,
    /// The optimiser's settings; they belong to the engine and stand here to be recorded with the rest.
    pub adam: AdamConfig,
    /// What a step minimises; as `adam`.
    pub loss: Loss,
    /// What products are computed in; as `adam`.
    #[serde(skip_serializing_if = "is_default")]
    pub precision: Precision,
    /// Decides the order of the samples.
    pub seed: u64,
    /// Steps between two reports.
    pub report_every: u64,
}

impl Default for TrainingPlan {
    /// The paper's: 50 epochs, a rate of 5e-4 that falls by 7 % an epoch.
    fn default() -> Self {
        Self {
            length: TrainingLength::Epochs(50),
            batch: 1024,
            schedule: Schedule::default(),
            adam: AdamConfig::default(),
            loss: Loss::default(),
            precision: Precision::default(),
            seed: 0,
            report_every: 50,
        }
    }
}

impl TrainingPlan {
    /// How `siren5` is trained by default, from random weights: a few minutes on two cores for the paper's width.
    #[must_use]
    pub fn siren5(shape: &SirenShape) -> Self {
        Self {
            length: TrainingLength::Steps(12_000),
            schedule: Schedule::cosine_from(shape.rate()),
            ..Self::default()
        }
    }

    /// How `siren5` is trained by default from the weights of another part's network: a tenth of the steps and of the rate. A higher
    /// rate shakes off what a small change leaves as it was (`imf-bench edits`).
    #[must_use]
    pub fn fine_tuning(shape: &SirenShape) -> Self {
        Self {
            length: TrainingLength::Steps(1_200),
            schedule: Schedule::cosine_from(0.1 * shape.rate()),
            ..Self::default()
        }
    }

    /// Steps of one epoch over `samples` samples.
    #[must_use]
    pub fn steps_per_epoch(&self, samples: usize) -> u64 {
        samples.div_ceil(self.batch.max(1)) as u64
    }

    /// Steps of the whole run over `samples` samples.
    #[must_use]
    pub fn total_steps(&self, samples: usize) -> u64 {
        match self.length {
            TrainingLength::Epochs(epochs) => epochs.saturating_mul(self.steps_per_epoch(samples)),
            TrainingLength::Steps(steps) => steps,
        }
    }

    /// Checks the ranges that types do not ensure.
    ///
    /// # Errors
    /// [`RecipeError`], naming the value.
    pub fn check(&self) -> Result<(), RecipeError> {
        if self.batch == 0 || self.report_every == 0 {
            let name = if self.batch == 0 { "batch" } else { "report_every" };
            return Err(RecipeError(format!("`{name}` must be at least 1")));
        }
        let decay = self.adam.weight_decay;
        if !(decay.is_finite() && decay >= 0.0) {
            return Err(RecipeError(format!(
                "the weight decay must be a finite number of at least 0, not {decay}"
            )));
        }
        self.schedule.check().map_err(RecipeError)
    }
}

/// Where training stands: the next step to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cursor {
    /// Epoch, from 0.
    pub epoch: u64,
    /// Step in the epoch, from 0.
    pub step: u64,
}

/// Which poses are held out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeldOutChoice {
    /// Number of poses.
    pub poses: usize,
    /// Random orientations that they are spread over.
    pub orientations: usize,
    /// Chooses orientations and voxels.
    pub seed: u64,
}

impl Default for HeldOutChoice {
    fn default() -> Self {
        Self { poses: 16_384, orientations: 64, seed: 0 }
    }
}
