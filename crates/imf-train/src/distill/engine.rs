//! The engine that distils on the CPU, and the weights that it begins with where another field's network is adapted.

use super::adapt::parameters_for;
use super::last_layer::{WHILE_TEACHING, solve_last_layer};
use crate::engine::CpuTrainer;
use crate::engine::soap::Soap;
use imf_core::field::EngineError;
use imf_core::occupancy::Occupancy;
use imf_fields::factored::targets::{Targets, TeacherFunctions};
use imf_fields::factored::{FactoredField, FactoredShape, FactoredState};
use imf_fields::harmonic::HarmonicField;
use imf_fields::recipe::{Optimiser, TrainingPlan};
use imf_fields::siren::{Layer, ShapeError};

/// Bytes that an optimiser takes beside weights and moments: working memory, and what it keeps in the engine, in the state of the
/// last stop and in its file.
#[must_use]
pub fn optimiser_bytes(optimiser: Optimiser, shape: FactoredShape) -> u64 {
    let of_matrix = |layer: Layer| {
        let working = match optimiser {
            Optimiser::Adam => 0,
            Optimiser::Soap(_) => Soap::bytes(layer.outputs, layer.inputs),
        };
        working + 2 * 4 * optimiser.kept_count(layer.outputs, layer.inputs) as u64
    };
    shape.between().map(of_matrix).sum()
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
pub fn start_from(
    from: &FactoredField,
    teacher: &HarmonicField,
    obstacle: &Occupancy,
) -> Result<FactoredState, ShapeError> {
    let symmetry = from.shape.symmetry;
    if !symmetry.holds_in(teacher, obstacle) {
        return Err(ShapeError::OtherSymmetry(symmetry.to_string()));
    }
    let targets = Targets::new(teacher, symmetry)?;
    let shape = FactoredShape { axes: targets.outputs(), folded: false, ..from.shape };
    let parameters = parameters_for(from, teacher, &targets)?;
    let mut field = TeacherFunctions::of(teacher, &targets).field(shape, parameters)?;
    // Other voxels than those of a solution before the first step.
    solve_last_layer(&mut field, &targets, WHILE_TEACHING, 0.5);
    Ok(FactoredState::from_parameters(field.parameters))
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
        Optimiser::Soap(config) => engine.use_soap(config)?,
    }
    Ok(engine)
}
