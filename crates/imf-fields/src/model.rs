//! The paper's network on disk (`tensor_file` has what all share): one file that serves query, evaluation, fine-tuning and
//! resuming, with these tensors:
//!
//! ```text
//! layers.0.weight  f32 [width, 5]     layers.0.bias  f32 [width]     … one pair for each layer, the output's last
//! adam.first, adam.second  f32 [parameters]   only in checkpoints: the optimiser's moments, flat
//! ```

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::calibration::Calibration;
use crate::recipe::divergence::Watch;
use crate::recipe::{Cursor, HeldOutChoice, Sampling, TrainingPlan, TrainingState};
use crate::siren::SirenShape;
use crate::tensor_file::{FieldFileError, Format, description_of_damaged};
use imf_core::orientation::OrientationSet;
use imf_core::scene::Scene;

pub(crate) const FORMAT: Format = Format { id: "imf-model", name: "model" };

/// One point of the loss curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossPoint {
    /// Steps done.
    pub step: u64,
    /// Mean loss since the point before.
    pub loss: f64,
}

/// The error at held-out poses after some steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutPoint {
    /// Steps done.
    pub step: u64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean absolute error.
    pub mae: f64,
}

/// Which poses are held out of training, and how well the network does there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutRecord {
    /// How many poses, and the seed that chose them.
    pub choice: HeldOutChoice,
    /// Steps between two evaluations.
    pub every: u64,
    /// Error over time.
    pub errors: Vec<HeldOutPoint>,
}

/// What a model was trained on, how, and how far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingRecord {
    /// Version of the program that trained last.
    pub program: String,
    /// The plan in force.
    pub plan: TrainingPlan,
    /// Where the plan stands.
    pub cursor: Cursor,
    /// Watches the losses for divergence.
    #[serde(default, skip_serializing_if = "Watch::is_new")]
    pub watch: Watch,
    /// True once the plan is done.
    pub finished: bool,
    /// Steps done under the plan.
    pub steps: u64,
    /// Seconds spent in training, all runs together; 0 in a model from a file, since equal trainings make equal files: the log
    /// beside it has the times.
    #[serde(skip)]
    pub seconds: f64,
    /// Engine that trained last.
    pub engine: String,
    /// The sections that training saw.
    pub orientations: OrientationSet,
    /// How they were sampled.
    pub sampling: Sampling,
    /// Samples of the dataset.
    pub samples: u64,
    /// CRC-32 over the checksums of the dataset's shards, to know it again.
    pub dataset_crc32: u32,
    /// Groups that an epoch is read in, which decides the order of the samples; nothing where all were in memory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub groups_per_epoch: Option<usize>,
    /// Part of the model that fine-tuning started from.
    pub fine_tuned_from: Option<String>,
    /// CRC-32 of that model's weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fine_tuned_weights: Option<u32>,
    /// Training loss over time.
    pub losses: Vec<LossPoint>,
    /// Sum of the steps' losses since the last point of the curve, and how many: the curve goes on from there.
    #[serde(default)]
    pub pending_loss: (f64, u64),
    /// Error at poses that training never sees, where it is watched.
    pub held_out: Option<HeldOutRecord>,
}

impl TrainingRecord {
    /// Of a network of which no step is done, by no samples of these orientations.
    #[doc(hidden)]
    #[must_use]
    pub fn untrained(orientations: OrientationSet) -> Self {
        Self {
            program: env!("CARGO_PKG_VERSION").into(),
            plan: TrainingPlan::default(),
            cursor: Cursor::default(),
            watch: Watch::default(),
            finished: false,
            steps: 0,
            seconds: 0.0,
            engine: String::new(),
            orientations,
            sampling: Sampling::default(),
            samples: 0,
            dataset_crc32: 0,
            groups_per_epoch: None,
            fine_tuned_from: None,
            fine_tuned_weights: None,
            losses: Vec::new(),
            pending_loss: (0.0, 0),
            held_out: None,
        }
    }
}

/// A network with everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// The network's description.
    pub shape: SirenShape,
    /// What it represents.
    pub scene: Scene,
    /// How it came about.
    pub record: TrainingRecord,
    /// Weights; with moments where training can be resumed, else moments are empty.
    pub state: TrainingState,
    /// The calibration of its decisions, where measured with these weights.
    pub calibration: Option<Calibration>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    network: SirenShape,
    training: TrainingRecord,
    optimiser_step: u64,
}

impl Model {
    /// True where the file holds what training needs to go on.
    pub fn is_resumable(&self) -> bool {
        !self.state.first_moment.is_empty()
    }

    /// The same model without the optimiser's moments: a third of the size.
    #[must_use]
    pub fn without_moments(mut self) -> Self {
        self.state.first_moment = Vec::new();
        self.state.second_moment = Vec::new();
        self
    }

    /// Writes the model whole or not at all. Equal models give equal bytes.
    ///
    /// # Errors
    /// A file that cannot be written.
    #[cfg(feature = "fit")]
    pub fn write(&self, path: &Path) -> Result<(), FieldFileError> {
        use crate::tensor_file::{Contents, tensor};
        let TrainingState { parameters, first_moment, second_moment, step, .. } = &self.state;
        let mut tensors = Vec::new();
        for (index, layer) in self.shape.layers().iter().enumerate() {
            let (weights, biases) = (layer.weights..layer.biases, layer.biases..layer.biases + layer.outputs);
            let shape = [layer.outputs, layer.inputs];
            tensors.push(tensor(format!("layers.{index}.weight"), &shape, &parameters[weights]));
            tensors.push(tensor(format!("layers.{index}.bias"), &shape[..1], &parameters[biases]));
        }
        if self.is_resumable() {
            for (name, moment) in [("adam.first", first_moment), ("adam.second", second_moment)] {
                tensors.push(tensor(name, &[moment.len()], moment));
            }
        }
        let description =
            Description { network: self.shape, training: self.record.clone(), optimiser_step: *step };
        FORMAT
            .write(path, Contents { scene: &self.scene, calibration: self.calibration, description, tensors })
    }

    /// Reads and checks a model.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it and what is wrong.
    pub fn read(path: &Path) -> Result<Self, FieldFileError> {
        Self::from_bytes(&FORMAT.bytes(path)?, path)
    }

    /// Checks a file in memory, which errors call `name`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, FieldFileError> {
        let file = FORMAT.open(bytes, name)?;
        let Description { network: shape, training: record, optimiser_step: step } = file.description()?;
        shape.check().map_err(|e| file.damaged(&e))?;
        // No more than the file can hold, whatever it says of its network.
        let mut parameters = Vec::with_capacity(shape.parameter_count().min(bytes.len() / 4));
        for (index, layer) in shape.layers().iter().enumerate() {
            let weights = [layer.outputs, layer.inputs];
            parameters.extend(file.floats(&format!("layers.{index}.weight"), &weights)?);
            parameters.extend(file.floats(&format!("layers.{index}.bias"), &[layer.outputs])?);
        }
        let (mut first_moment, mut second_moment) = (Vec::new(), Vec::new());
        if file.has("adam.first") {
            first_moment = file.floats("adam.first", &[parameters.len()])?;
            second_moment = file.floats("adam.second", &[parameters.len()])?;
        }
        let state =
            TrainingState { parameters, first_moment, second_moment, preconditioners: Vec::new(), step };
        Ok(Self { shape, scene: file.scene, record, state, calibration: file.calibration })
    }
}

/// Steps that a checkpoint says were done, as far as its description can be read, whatever else is damaged.
#[doc(hidden)]
pub fn steps_said(path: &Path) -> Option<u64> {
    description_of_damaged::<Description>(path).map(|description| description.training.steps)
}
