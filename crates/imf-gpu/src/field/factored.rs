//! Poses through a factored field: its network gives a point's coefficients, `field/turns.rs` the value from them at
//! a direction or a rotation.
//!
//! ```text
//! poses → points → forward (keeps slopes) → coefficients → values, ∂/∂d → Δ → backward → ∂/∂x
//! ```

use imf_core::field::EngineError;
use imf_fields::factored::FactoredField;

use super::network::TwoWay;
use super::passes::Slot::{Gradients, Poses, Values};
use super::passes::{CallKernel, Frame, Passes, own};
use super::turns::{Coefficients, Functions, Turns};
use crate::kernel::{Extent, uniform};
use crate::shader::Shader;

pub(super) fn passes(frame: &Frame, field: &FactoredField) -> Result<Passes, EngineError> {
    let Frame { gpu, world, sweep } = frame;
    let field = &*field.unfolded();
    let FactoredField { basis, components, mean, scale, .. } = field;
    let (symmetry, blunt) = (field.shape.symmetry, field.blunt());
    let functions = Functions { basis, components, mean, scale: *scale, symmetry, blunt };
    let columns = functions.columns(gpu.matrix_kernel().padding());
    let two_way = TwoWay::new(gpu, field.shape.stack(), &field.parameters, columns)?;
    let descent = uniform(gpu, "descent", &two_way.descent().0)?;
    let TwoWay { network, rows, samples, results, deltas, mut forward, mut backward } = two_way;
    let (batch, last) = (&network.batch, network.layers.len() - 1);
    let components = network.layout.layers[last].outputs;
    let at = Coefficients { batch, rows, components, values: &results, slopes: &deltas[last] };
    let turns = Turns::new(frame, functions, &at)?;
    let place = [batch, world, sweep, &turns.symmetry];
    let points = place.map(own).into_iter().chain([Poses, own(&samples)]).collect();
    let slopes = place.into_iter().chain([&descent, &network.parameters, &deltas[0]]).map(own);
    let slopes = slopes.chain([Poses, Values, Gradients]).collect();
    forward.push(turns.weigh);
    backward.insert(0, turns.seed);
    Ok(Passes {
        batch: batch.clone(),
        rows,
        points: CallKernel::new(gpu, Shader::PosePoints, Extent::Rows(1), points)?,
        forward,
        values: turns.values,
        slopes: turns.slopes,
        backward,
        gradients: CallKernel::new(gpu, Shader::PoseDescent, Extent::Rows(1), slopes)?,
    })
}
