//! What distillation changes: enough to go on to the same bits.

use super::FactoredShape;
use crate::recipe::divergence::Watch;
use crate::recipe::{Cursor, TrainingState};

/// Everything that training changes: enough to go on to the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredState {
    /// Weights, moments and steps.
    pub training: TrainingState,
    /// Where the plan stands.
    pub cursor: Cursor,
    /// Watches the losses for divergence.
    pub watch: Watch,
}

impl FactoredState {
    /// Random starting weights.
    #[must_use]
    pub fn new(shape: &FactoredShape, seed: u64) -> Self {
        Self::from_parameters(shape.initial_parameters(seed))
    }

    /// Given weights.
    #[must_use]
    pub fn from_parameters(parameters: Vec<f32>) -> Self {
        Self {
            training: TrainingState::from_parameters(parameters),
            cursor: Cursor::default(),
            watch: Watch::default(),
        }
    }
}
