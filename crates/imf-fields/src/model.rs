//! The model file: one safetensors file that serves query, evaluation, fine-tuning and resuming.
//!
//! Its metadata has one key, `imf`: JSON with the format's name and version, a checksum, the network's description, the
//! scene and the training record. Its tensors:
//!
//! ```text
//! layers.0.weight  f32 [width, 5]     layers.0.bias  f32 [width]     … one pair for each layer, the output's last
//! obstacle         u8  [⌈voxels/8⌉]   the scene's solid voxels, eight a byte, first voxel in the lowest bit
//! adam.first, adam.second  f32 [parameters]   only in checkpoints: the optimiser's moments, flat
//! ```
//!
//! The obstacle travels along, so that a model can be evaluated without the part's mesh.
//!
//! The checksum is the CRC-32 of the whole file, taken while its own eight hexadecimal digits are zeros: whatever byte is
//! damaged, reading says so.

use std::collections::HashMap;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::calibration::Calibration;
use crate::recipe::HeldOutChoice;
use crate::recipe::Sampling;
use crate::recipe::TrainingState;
use crate::recipe::divergence::Watch;
use crate::recipe::{Cursor, TrainingPlan};
use crate::siren::SirenShape;
use imf_core::atomic_file::{AtomicFileError, write_atomically, write_keeping_previous};
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Scene, SceneRecord};

const FORMAT: &str = "imf-model";
const VERSION: u32 = 1;
/// What stands before the checksum's digits, as the file's header quotes the JSON.
const CHECKSUM_KEY: &[u8] = br#"\"crc32\":\""#;
const NO_CHECKSUM: &str = "00000000";

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
    /// What the losses so far look like.
    #[serde(default, skip_serializing_if = "Watch::is_new")]
    pub watch: Watch,
    /// True once the plan is done.
    pub finished: bool,
    /// Steps done under the plan.
    pub steps: u64,
    /// Seconds spent in training, all runs together.
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
    /// Training loss over time.
    pub losses: Vec<LossPoint>,
    /// Sum of the steps' losses since the last point of the curve, and how many: the curve goes on from there.
    #[serde(default)]
    pub pending_loss: (f64, u64),
    /// Error at poses that training never sees, where it is watched.
    pub held_out: Option<HeldOutRecord>,
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
    /// What its decisions are worth, where that was measured of these weights.
    pub calibration: Option<Calibration>,
}

/// Why a model cannot be read or written. Every message names the file.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The file cannot be read.
    #[error("cannot read the model {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No model, or a damaged one.
    #[error("{path} is no intact model: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error(
        "{path} is a model of version {found}, and this program reads version {VERSION}: use a newer imf"
    )]
    Newer {
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
}

#[derive(Serialize, Deserialize)]
struct Description {
    format: String,
    version: u32,
    crc32: Option<String>,
    family: String,
    network: SirenShape,
    scene: SceneRecord,
    training: TrainingRecord,
    optimiser_step: u64,
    /// Nothing where the field was never calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    calibration: Option<Calibration>,
}

/// The part of the description that can be read whatever its version.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl Model {
    /// True where the file holds what training needs to go on.
    #[must_use]
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
    pub fn write(&self, path: &Path) -> Result<(), ModelError> {
        let bytes = self.bytes(path)?;
        Ok(write_atomically(path, |file| file.write_all(&bytes))?)
    }

    /// As [`Model::write`]; the file that is replaced stays as `previous` ([`write_keeping_previous`]).
    ///
    /// # Errors
    /// A file that cannot be written; then neither changes.
    pub fn write_keeping_previous(&self, path: &Path, previous: &Path) -> Result<(), ModelError> {
        let bytes = self.bytes(path)?;
        Ok(write_keeping_previous(path, previous, |file| file.write_all(&bytes))?)
    }

    /// The content of the file `path`.
    fn bytes(&self, path: &Path) -> Result<Vec<u8>, ModelError> {
        let damaged = |what: String| ModelError::Damaged { path: path.display().to_string(), what };
        let description = Description {
            format: FORMAT.into(),
            version: VERSION,
            crc32: Some(NO_CHECKSUM.into()),
            family: "siren5".into(),
            network: self.shape,
            scene: self.scene.record.clone(),
            training: self.record.clone(),
            optimiser_step: self.state.step,
            calibration: self.calibration,
        };
        let json = serde_json::to_string(&description).map_err(|e| damaged(e.to_string()))?;
        let voxels = self.scene.packed_voxels();
        let mut tensors: Vec<(String, Vec<usize>, &[f32])> = Vec::new();
        for (index, layer) in self.shape.layers().iter().enumerate() {
            let weights = &self.state.parameters[layer.weights..layer.biases];
            let biases = &self.state.parameters[layer.biases..layer.biases + layer.outputs];
            tensors.push((format!("layers.{index}.weight"), vec![layer.outputs, layer.inputs], weights));
            tensors.push((format!("layers.{index}.bias"), vec![layer.outputs], biases));
        }
        if self.is_resumable() {
            for (name, moment) in
                [("adam.first", &self.state.first_moment), ("adam.second", &self.state.second_moment)]
            {
                tensors.push((name.into(), vec![moment.len()], moment));
            }
        }
        let little_endian: Vec<Vec<u8>> = tensors
            .iter()
            .map(|(_, _, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect())
            .collect();
        let serialized = || {
            let mut views = Vec::with_capacity(tensors.len() + voxels.len());
            for ((name, shape, _), bytes) in tensors.iter().zip(&little_endian) {
                views.push((name.clone(), TensorView::new(Dtype::F32, shape.clone(), bytes)?));
            }
            for (name, bits) in &voxels {
                views.push(((*name).to_owned(), TensorView::new(Dtype::U8, vec![bits.len()], bits)?));
            }
            safetensors::serialize(views, Some(HashMap::from([("imf".to_owned(), json.clone())])))
        };
        let mut bytes = serialized().map_err(|e| damaged(e.to_string()))?;
        let digits = checksum_digits(&bytes).ok_or_else(|| damaged("no place for its checksum".into()))?;
        let checksum = format!("{:08x}", crc32fast::hash(&bytes));
        bytes[digits].copy_from_slice(checksum.as_bytes());
        Ok(bytes)
    }

    /// Reads and checks a model.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it and what is wrong.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let shown = || path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| ModelError::Read { path: shown(), source })?;
        Self::from_bytes(&bytes, path)
    }

    /// Checks a file in memory, which errors call `name`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, ModelError> {
        let shown = name.display().to_string();
        let damaged = |what: String| ModelError::Damaged { path: shown.clone(), what };
        let (_, metadata) = SafeTensors::read_metadata(bytes)
            .map_err(|e| damaged(format!("{e}; it was cut short, or is no safetensors file")))?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("imf"));
        let json = json.ok_or_else(|| damaged("it is a safetensors file, but not one of imf's".into()))?;
        let header: Header = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        if header.format != FORMAT {
            return Err(damaged(format!("its format is '{}', not '{FORMAT}'", header.format)));
        }
        if header.version > VERSION {
            return Err(ModelError::Newer { path: shown, found: header.version });
        }
        if header.version != VERSION {
            return Err(damaged(format!("there is no version {}", header.version)));
        }
        let description: Description = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        let found = whole_checksum(bytes).ok_or_else(|| damaged("it has no checksum".into()))?;
        if description.crc32 != Some(found) {
            return Err(damaged("its checksum is wrong: it was changed after it was written".into()));
        }
        if let Some(fault) = description.calibration.and_then(|c| c.fault()) {
            return Err(damaged(fault.into()));
        }
        let shape = description.network;
        shape.check().map_err(|e| damaged(e.to_string()))?;
        let tensors =
            SafeTensors::deserialize(bytes).map_err(|e| damaged(format!("{e}; it was cut short")))?;
        let floats = |name: &str, dims: &[usize]| -> Result<Vec<f32>, ModelError> {
            let view = tensors.tensor(name).map_err(|e| damaged(e.to_string()))?;
            if view.dtype() != Dtype::F32 || view.shape() != dims {
                return Err(damaged(format!(
                    "'{name}' is {:?} {:?}, not F32 {dims:?}",
                    view.dtype(),
                    view.shape()
                )));
            }
            let values: Vec<f32> =
                view.data().as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
            if values.iter().all(|v| v.is_finite()) {
                Ok(values)
            } else {
                Err(damaged(format!("'{name}' holds a value that is not a finite number")))
            }
        };
        let mut parameters = Vec::with_capacity(shape.parameter_count());
        for (index, layer) in shape.layers().iter().enumerate() {
            parameters.extend(floats(&format!("layers.{index}.weight"), &[layer.outputs, layer.inputs])?);
            parameters.extend(floats(&format!("layers.{index}.bias"), &[layer.outputs])?);
        }
        let (mut first_moment, mut second_moment) = (Vec::new(), Vec::new());
        if tensors.names().contains(&"adam.first") {
            first_moment = floats("adam.first", &[parameters.len()])?;
            second_moment = floats("adam.second", &[parameters.len()])?;
        }
        let bits = |name: &str| tensors.tensor(name).ok().map(|view| view.data());
        let scene = Scene::from_packed_voxels(description.scene, bits).map_err(|e| damaged(e.to_string()))?;
        Ok(Self {
            shape,
            scene,
            record: description.training,
            state: TrainingState {
                parameters,
                first_moment,
                second_moment,
                preconditioners: Vec::new(),
                step: description.optimiser_step,
            },
            calibration: description.calibration,
        })
    }
}

/// Where the checksum's digits stand in a file.
fn checksum_digits(bytes: &[u8]) -> Option<Range<usize>> {
    let header = bytes.first_chunk::<8>().map(|length| u64::from_le_bytes(*length))?;
    let end = usize::try_from(header).ok()?.checked_add(8).filter(|&end| end <= bytes.len())?;
    let key = bytes[..end].windows(CHECKSUM_KEY.len()).position(|window| window == CHECKSUM_KEY)?;
    let start = key + CHECKSUM_KEY.len();
    Some(start..start + NO_CHECKSUM.len()).filter(|digits| digits.end <= end)
}

/// The checksum that a file should have.
fn whole_checksum(bytes: &[u8]) -> Option<String> {
    let digits = checksum_digits(bytes)?;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..digits.start]);
    hasher.update(NO_CHECKSUM.as_bytes());
    hasher.update(&bytes[digits.end..]);
    Some(format!("{:08x}", hasher.finalize()))
}

/// Steps that a checkpoint says were done, as far as its description can be read, whatever else is damaged.
#[must_use]
pub fn steps_said(path: &Path) -> Option<u64> {
    let bytes = std::fs::read(path).ok()?;
    let (_, metadata) = SafeTensors::read_metadata(&bytes).ok()?;
    let json = metadata.metadata().as_ref()?.get("imf")?;
    serde_json::from_str::<Description>(json).ok().map(|description| description.training.steps)
}

#[cfg(test)]
mod tests;
