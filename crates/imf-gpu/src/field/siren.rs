//! Poses through the paper's network.
//!
//! ```text
//! poses → inputs → forward (keeps slopes) → values, y·(1 − y) → backward → gradients by position and direction
//! ```

use imf_core::field::EngineError;
use imf_fields::model::Model;

use super::network::TwoWay;
use super::passes::Slot::{Gradients, Poses, Values};
use super::passes::{CallKernel, Frame, Passes, own};
use crate::kernel::{Extent, uniform};
use crate::shader::Shader;

pub(super) fn passes(frame: &Frame, model: &Model) -> Result<Passes, EngineError> {
    let Frame { gpu, world, sweep } = frame;
    let two_way = TwoWay::new(gpu, model.shape.stack(), &model.state.parameters, 0)?;
    let (descent, skipped) = two_way.descent();
    let TwoWay { network, rows, samples, results, deltas, forward, backward } = two_way;
    let (batch, last) = (&network.batch, network.layers.len() - 1);
    let inputs = vec![own(batch), own(world), own(sweep), Poses, own(&samples)];
    let (layer, delta) = (&network.layers[last], &deltas[last]);
    let seeds = vec![own(batch), own(layer), own(sweep), Poses, own(&results), own(delta), Values];
    let values = CallKernel::new(gpu, Shader::PoseValues, Extent::PaddedRows, seeds)?;
    let descent = uniform(gpu, "descent", &descent)?;
    let seen = [&network.parameters, &deltas[0], &deltas[skipped.unwrap_or(0)]].map(own);
    let slopes = [batch, world, sweep, &descent].map(own).into_iter().chain(seen);
    let slopes = slopes.chain([Poses, Values, Gradients]).collect();
    Ok(Passes {
        batch: batch.clone(),
        rows,
        points: CallKernel::new(gpu, Shader::PoseInputs, Extent::Rows(1), inputs)?,
        forward,
        slopes: values.clone(),
        values,
        backward,
        gradients: CallKernel::new(gpu, Shader::PoseGradient, Extent::Rows(1), slopes)?,
    })
}
