//! What teaching changes, by which rule, and the CPU engine that does it.

use serde::{Deserialize, Serialize};

use super::last_layer::WHILE_TEACHING;
use super::targets::Targets;
use super::{FactoredField, FactoredShape, TeacherFunctions};
use crate::harmonic::HarmonicField;
use crate::occupancy::Occupancy;
use crate::siren::engine::CpuTrainer;
use crate::siren::muon::{Muon, MuonConfig};
use crate::siren::soap::{Soap, SoapConfig};
use crate::siren::{Layer, ShapeError};
use crate::training::divergence::Watch;
use crate::training::run::{Cursor, Start, TrainingPlan};
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
    /// Adam along the axes of their gradients for the matrices between hidden layers, Adam for the rest.
    Soap(SoapConfig),
}

impl Optimiser {
    /// Numbers that a state keeps beside weights and moments, once there was a step.
    pub(super) fn kept_count(self, shape: FactoredShape) -> usize {
        match self {
            Self::Adam | Self::Muon(_) => 0,
            Self::Soap(_) => shape.between().map(|layer| Soap::kept_count(layer.outputs, layer.inputs)).sum(),
        }
    }

    /// Bytes that it takes beside weights and moments: working memory, and what it keeps in the engine, in the state of the
    /// last stop and in its file.
    #[must_use]
    pub fn bytes(self, shape: FactoredShape) -> u64 {
        let of_matrix = |layer: Layer| match self {
            Self::Adam => 0,
            Self::Muon(_) => Muon::bytes(layer.outputs, layer.inputs),
            Self::Soap(_) => Soap::bytes(layer.outputs, layer.inputs),
        };
        shape.between().map(of_matrix).sum::<u64>() + 2 * 4 * self.kept_count(shape) as u64
    }
}

/// Everything that teaching changes: enough to go on to the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredState {
    /// Weights, moments and steps.
    pub training: TrainingState,
    /// Where the plan stands.
    pub cursor: Cursor,
    /// What the losses so far look like.
    pub watch: Watch,
}

impl FactoredState {
    /// Where a teaching goes on.
    pub(super) fn start(&self) -> Start {
        Start { cursor: self.cursor, watch: self.watch }
    }

    /// Random starting weights.
    #[must_use]
    pub fn new(shape: &FactoredShape, seed: u64) -> Self {
        Self::from_parameters(shape.initial_parameters(seed))
    }

    /// Where fine-tuning starts: the network of another field, such as that of the part before it was changed, turned to
    /// this teacher's grid and axes, with the best last layer for it. What that was told of symmetry stands; `obstacle` is what
    /// the teacher is of.
    ///
    /// # Errors
    /// Weights that do not fit their shape; mirror planes that the teacher does not have.
    ///
    /// # Panics
    /// If one field is over directions and the other over rotations.
    pub fn of_another(
        from: &FactoredField,
        teacher: &HarmonicField,
        obstacle: &Occupancy,
    ) -> Result<Self, ShapeError> {
        let symmetry = from.shape.symmetry;
        if !symmetry.holds_in(teacher, obstacle) {
            return Err(ShapeError::OtherSymmetry(symmetry.to_string()));
        }
        let targets = Targets::new(teacher, symmetry)?;
        let shape = FactoredShape { axes: targets.outputs(), folded: false, ..from.shape };
        let parameters = from.parameters_for(teacher, &targets)?;
        let mut field = TeacherFunctions::of(teacher, &targets).field(shape, parameters)?;
        // Other voxels than those of a solution before the first step.
        field.solve_last_layer(&targets, WHILE_TEACHING, 0.5);
        Ok(Self::from_parameters(field.parameters))
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
    match optimiser {
        Optimiser::Adam => {}
        Optimiser::Muon(config) => engine.use_muon(config),
        Optimiser::Soap(config) => engine.use_soap(config)?,
    }
    Ok(engine)
}
