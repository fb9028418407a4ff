//! The engine that distils on the CPU.

use crate::engine::CpuTrainer;
use crate::engine::soap::Soap;
use imf_core::field::EngineError;
use imf_fields::factored::{FactoredShape, FactoredState};
use imf_fields::recipe::{Optimiser, TrainingPlan};
use imf_fields::siren::Layer;

/// Bytes that an optimiser takes beside weights and moments: working memory, and its state in the engine, in the last
/// stop's copy and in its file.
#[must_use]
pub fn optimiser_bytes(optimiser: Optimiser, shape: FactoredShape) -> u64 {
    let of_matrix = |layer: Layer| {
        let working = match optimiser {
            Optimiser::Adam => 0,
            Optimiser::Soap(_) => Soap::bytes(layer.outputs, layer.inputs),
        };
        working + 2 * 4 * optimiser.state_count(layer.outputs, layer.inputs) as u64
    };
    shape.between().map(of_matrix).sum()
}

/// The CPU engine for g's layers, for batches of up to `max_batch` points, that continues from `state`; it runs on
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
