//! Whether a device's matrix units multiply as they should, found out before anything is trained with them.
//!
//! The interface to them is experimental, drivers differ in it, and no test of this project runs on every card. So the
//! gradient of a small network is taken both ways first: by matrix units, and by plain products of the same f16.

use imf_core::field::EngineError;
use imf_fields::recipe::{Loss, TrainingState};
use imf_fields::siren::{INPUTS, SirenShape};

use super::{GpuTrainer, TrainerSettings};
use crate::device::Gpu;
use crate::shader::Factors;

/// Two layers whose products are done by matrix units, with a skip; two tiles of rows, two of neurons.
const SHAPE: SirenShape = SirenShape { width: 128, hidden: 3, skip_after: Some(1), omega: 10.0 };
const ROWS: usize = 128;

/// Largest difference of the gradients, of the largest entry. Both ways sum the same products in another order, f32's
/// rounding of 6e-8 in sums of 128; a rounding to f16 that falls the other way for it, 5e-4, moves one term of many. A
/// fragment in the wrong place moves entries by their whole size.
const AGREE: f32 = 0.01;

/// The device as it is if its matrix units agree with plain products, else opened anew for plain products in f16.
///
/// # Errors
/// The device fails.
pub(super) fn proven(gpu: Gpu) -> Result<Gpu, EngineError> {
    let Some(units @ Factors::Fragments(_)) = gpu.half() else { return Ok(gpu) };
    if !gpu.matrix_kernel().is_padded_to_tiles() || !agree(&gpu, units)? {
        return gpu.for_half(Some(Factors::Half));
    }
    Ok(gpu)
}

/// Whether both ways have the same gradient.
fn agree(gpu: &Gpu, units: Factors) -> Result<bool, EngineError> {
    let state = TrainingState::new(&SHAPE, 1);
    // Points and directions spread over the box: multiples of the golden section, modulo 1.
    let inputs: Vec<f32> = (0..INPUTS * ROWS).map(|i| (i as f32 * 0.618_034).fract() * 2.0 - 1.0).collect();
    let targets: Vec<f32> = (0..ROWS).map(|i| (i as f32 * 0.618_034).fract()).collect();
    let gradient = |factors| {
        let settings = TrainerSettings { loss: Loss::L2, factors, ..TrainerSettings::default() };
        let mut trainer = GpuTrainer::of_stack(gpu, SHAPE.stack(), &settings, ROWS, &state)?;
        Ok::<_, EngineError>(trainer.loss_and_gradient(&inputs, &targets)?.1)
    };
    let (plain, found) = (gradient(Factors::Half)?, gradient(units)?);
    let scale = plain.iter().fold(0.0f32, |most, value| most.max(value.abs()));
    Ok(plain.iter().zip(&found).all(|(a, b)| (a - b).abs() <= AGREE * scale))
}
