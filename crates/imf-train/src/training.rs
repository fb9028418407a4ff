//! Training: the interface between the loop that feeds batches ([`run`]) and the engine that runs a step (CPU here, GPU in
//! `imf-gpu`), and where batches come from: memory, or files ([`streamed`]).

pub mod permutation;
pub mod run;
pub mod streamed;

use std::ops::Range;

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::INPUTS;

/// Bytes of this machine's memory for each parameter, beside the engine's: the state that was saved last (weights and two
/// moments), the same as it is written to a checkpoint (twice: as tensors, and as a file), and the weights of the evaluator
/// at held-out poses (as rows, and transposed).
pub const BYTES_BESIDE_ENGINE: u64 = 4 * (3 + 2 * 3 + 2);

/// Where a training step runs: one of the project's extension points.
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

    /// Announces the next step's batch of `batch` samples; returns the rows that this process must supply: all of
    /// them, unless several processes train together.
    fn rows_of_batch(&mut self, batch: usize) -> Range<usize> {
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
