//! What teaching changes, by which rule, and the CPU engine that does it.

use serde::{Deserialize, Serialize};

use super::last_layer::AT_THE_END;
use super::{FactoredField, FactoredShape};
use crate::harmonic::HarmonicField;
use crate::siren::ShapeError;
use crate::siren::engine::CpuTrainer;
use crate::siren::muon::MuonConfig;
use crate::training::run::{Cursor, TrainingPlan};
use crate::training::{EngineError, TrainingState};

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
    /// Where the plan stands.
    pub cursor: Cursor,
}

impl FactoredState {
    /// Random starting weights.
    #[must_use]
    pub fn new(shape: &FactoredShape, seed: u64) -> Self {
        Self::from_parameters(shape.initial_parameters(seed))
    }

    /// Where fine-tuning starts: the network of another field, such as that of the part before it was changed, turned to
    /// this teacher's grid and axes, with the best last layer for it.
    ///
    /// # Errors
    /// Weights that do not fit their shape.
    ///
    /// # Panics
    /// If one field is over directions and the other over rotations.
    pub fn of_another(from: &FactoredField, teacher: &HarmonicField) -> Result<Self, ShapeError> {
        let shape = FactoredShape { axes: teacher.axis_count(), folded: false, ..from.shape };
        let mut field = FactoredField::new(teacher, shape, from.parameters_for(teacher)?)?;
        field.solve_last_layer(teacher, AT_THE_END, 0.0);
        Ok(Self::from_parameters(field.parameters))
    }

    /// Given weights.
    #[must_use]
    pub fn from_parameters(parameters: Vec<f32>) -> Self {
        Self { training: TrainingState::from_parameters(parameters), cursor: Cursor::default() }
    }
}

/// The house's CPU engine for g's layers, for batches of up to `max_batch` points, that continues from `state`; it runs on
/// the rayon pool that its steps are called in.
///
/// # Errors
/// A shape or a batch out of range, or a state that does not fit.
pub(super) fn cpu_engine(
    shape: FactoredShape,
    plan: &TrainingPlan,
    optimiser: Optimiser,
    max_batch: usize,
    state: &FactoredState,
) -> Result<CpuTrainer, EngineError> {
    let (stack, state) = (shape.stack(), state.training.clone());
    let mut engine = CpuTrainer::of_stack(stack, plan.adam, plan.loss, max_batch, state)?;
    if let Optimiser::Muon(config) = optimiser {
        engine.use_muon(config);
    }
    Ok(engine)
}
