//! Poses through the paper's network.
//!
//! ```text
//! poses → inputs → forward (keeps slopes) → values, y·(1 − y) → backward → gradients by position and direction
//! ```

use imf_core::field::EngineError;
use imf_fields::model::Model;

use super::network::{Extent, Frame, Passes, TwoWay};
use super::work::Call;
use crate::device::Gpu;
use crate::evaluator::GpuEvaluator;
use crate::kernel::{Bound, Kernel, uniform};
use crate::shader::Shader;

/// A network of the paper's kind.
pub(super) struct SirenPasses {
    pub(super) two_way: TwoWay,
    /// Minima over directions.
    pub(super) evaluator: GpuEvaluator,
    inputs: Kernel,
    values: Kernel,
    gradient: Kernel,
    descent: wgpu::Buffer,
    /// The layer behind the skip, or the first one.
    skipped: usize,
}

/// The kernels bound to the buffers of a call.
pub(super) struct SirenCall {
    inputs: Bound,
    values: Bound,
    gradient: Option<Bound>,
}

impl SirenPasses {
    pub(super) fn new(gpu: &Gpu, model: &Model) -> Result<Self, EngineError> {
        let two_way = TwoWay::new(gpu, model.shape.stack(), &model.state.parameters, 0)?;
        let (descent, skipped) = two_way.descent();
        Ok(Self {
            evaluator: GpuEvaluator::new(gpu, model.shape, &model.state.parameters)?,
            inputs: Kernel::new(gpu, Shader::PoseInputs)?,
            values: Kernel::new(gpu, Shader::PoseValues)?,
            gradient: Kernel::new(gpu, Shader::PoseGradient)?,
            descent: uniform(gpu, "descent", &descent)?,
            skipped: skipped.unwrap_or(0),
            two_way,
        })
    }
}

impl Passes for SirenPasses {
    type Call = SirenCall;

    fn extent(&self) -> Extent<'_> {
        self.two_way.extent()
    }

    fn bind(&self, frame: &Frame, call: Call<'_>) -> Self::Call {
        let Frame { gpu, world, sweep } = frame;
        let Call { poses, values, gradients } = call;
        let TwoWay { network, samples, results, deltas, .. } = &self.two_way;
        let (batch, last) = (&network.batch, network.layers.len() - 1);
        let seeds = [batch, &network.layers[last], sweep, poses, results, &deltas[last], values];
        SirenCall {
            inputs: self.inputs.bind(gpu, &[batch, world, sweep, poses, samples]),
            values: self.values.bind(gpu, &seeds),
            gradient: gradients.map(|gradients| {
                let skipped = &deltas[self.skipped];
                let network = [&self.descent, &network.parameters, &deltas[0], skipped];
                let buffers = [&[batch, world, sweep][..], &network, &[poses, values, gradients]].concat();
                self.gradient.bind(gpu, &buffers)
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
        call.inputs.linear(pass, rows, limit);
        self.two_way.record_forward(pass, padded_rows, limit);
        call.values.linear(pass, padded_rows, limit);
        if let Some(gradient) = &call.gradient {
            self.two_way.record_backward(pass, padded_rows);
            gradient.linear(pass, rows, limit);
        }
    }
}
