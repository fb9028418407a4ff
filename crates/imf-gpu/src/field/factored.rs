//! Poses through a factored field: its network gives a point's coefficients, `field/turns.rs` what they are worth at a
//! direction or a rotation.
//!
//! ```text
//! poses → points → forward (keeps slopes) → coefficients → values, ∂/∂d → Δ → backward → ∂/∂x
//! ```

use imf_core::field::EngineError;
use imf_fields::factored::FactoredField;

use super::network::{Extent, Frame, Passes, TwoWay};
use super::turns::{Coefficients, Functions, Turns};
use super::work::Call;
use crate::device::Gpu;
use crate::factored::GpuFactored;
use crate::kernel::{Bound, Kernel, uniform};
use crate::shader::Shader;

/// A factored field.
pub(super) struct FactoredPasses {
    pub(super) two_way: TwoWay,
    /// Minima over orientations.
    pub(super) minimum: GpuFactored,
    turns: Turns,
    points: Kernel,
    descend: Kernel,
    descent: wgpu::Buffer,
}

/// The kernels bound to the buffers of a call.
pub(super) struct FactoredCall {
    points: Bound,
    values: Bound,
    descend: Option<Bound>,
}

impl FactoredPasses {
    pub(super) fn new(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let field = &*field.unfolded();
        let FactoredField { basis, axes, mean, scale, .. } = field;
        let (symmetry, blunt) = (field.shape.symmetry, field.blunt());
        let functions = Functions { basis, axes, mean, scale: *scale, symmetry, blunt };
        let columns = functions.columns(gpu.matrix_kernel().padding());
        let two_way = TwoWay::new(gpu, field.shape.stack(), &field.parameters, columns)?;
        let TwoWay { network, rows, results, deltas, .. } = &two_way;
        let last = network.layout.layers.len() - 1;
        let at = Coefficients {
            batch: &network.batch,
            rows: *rows,
            axes: network.layout.layers[last].outputs,
            values: results,
            slopes: &deltas[last],
        };
        Ok(Self {
            minimum: GpuFactored::new(gpu, field)?,
            turns: Turns::new(gpu, functions, &at)?,
            points: Kernel::new(gpu, Shader::PosePoints)?,
            descend: Kernel::new(gpu, Shader::PoseDescent)?,
            descent: uniform(gpu, "descent", &two_way.descent().0)?,
            two_way,
        })
    }
}

impl Passes for FactoredPasses {
    type Call = FactoredCall;

    fn extent(&self) -> Extent<'_> {
        self.two_way.extent()
    }

    fn bind(&self, frame: &Frame, call: Call<'_>) -> Self::Call {
        let Frame { gpu, world, sweep } = frame;
        let Call { poses, values, gradients } = call;
        let TwoWay { network, samples, deltas, .. } = &self.two_way;
        let (batch, symmetry) = (&network.batch, &self.turns.symmetry);
        FactoredCall {
            points: self.points.bind(gpu, &[batch, world, sweep, symmetry, poses, samples]),
            values: self.turns.bind(frame, call),
            descend: gradients.map(|gradients| {
                let (parameters, first) = (&network.parameters, &deltas[0]);
                let front = [batch, world, sweep, symmetry, &self.descent, parameters, first];
                self.descend.bind(gpu, &[&front[..], &[poses, values, gradients]].concat())
            }),
        }
    }

    fn record(
        &self,
        call: &Self::Call,
        pass: &mut wgpu::ComputePass<'_>,
        rows: usize,
        padded_rows: usize,
        limit: u32,
    ) {
        call.points.linear(pass, rows, limit);
        self.two_way.record_forward(pass, padded_rows, limit);
        self.turns.record(&call.values, pass, rows, padded_rows, limit);
        if let Some(descend) = &call.descend {
            self.turns.record_slopes(pass, padded_rows);
            self.two_way.record_backward(pass, padded_rows);
            descend.linear(pass, rows, limit);
        }
    }
}
