//! A network that poses pass through, forward to its results and back to its first layer, whatever family it is of.

use imf_core::field::EngineError;
use imf_fields::siren::stack::Stack;

use super::passes::ROWS;
use crate::device::Gpu;
use crate::forward::{LayerKernels, Network, layout_for, rows_per_pass};
use crate::kernel::{Dispatch, Kernel};
use crate::memory::Plan;
use crate::shader::Shader;
use crate::uniforms::Descent;

/// A network with room for the poses of one pass.
pub(super) struct TwoWay {
    pub(super) network: Network,
    /// Poses of one pass, at most.
    pub(super) rows: usize,
    /// The network's inputs `[rows][inputs]`.
    pub(super) samples: wgpu::Buffer,
    /// Its results `[rows][outputs]`, padding among them.
    pub(super) results: wgpu::Buffer,
    /// Every layer's Δ on the way back; the last one's is where it begins.
    pub(super) deltas: Vec<wgpu::Buffer>,
    /// From samples to results; retains what the backward pass needs.
    pub(super) forward: Vec<Dispatch>,
    /// From the last layer's Δ to the first one's.
    pub(super) backward: Vec<Dispatch>,
}

impl TwoWay {
    /// Allocates and uploads; passes leave room for rows of `columns` values beside the network's own.
    pub(super) fn new(
        gpu: &Gpu,
        stack: Stack,
        parameters: &[f32],
        columns: usize,
    ) -> Result<Self, EngineError> {
        let layout = layout_for(gpu, stack)?;
        stack.check_parameters(parameters)?;
        let limits = gpu.limits();
        let rows = rows_per_pass(&layout, limits, ROWS.min(limits.elements() / columns.max(1)));
        let mut plan = Plan::default();
        plan.add("parameters", layout.parameters);
        plan.add("samples", rows * stack.inputs);
        plan.add("results", rows * layout.layers.last().map_or(0, |layer| layer.outputs));
        plan.add_layers(&layout, rows);
        let mut buffers = plan.allocate(gpu)?.into_iter();
        let mut next = || buffers.next().expect("as many as are planned");
        let [weights, samples, results] = [(); 3].map(|()| next());
        let [signals, deltas]: [Vec<_>; 2] = [(); 2].map(|()| layout.layers.iter().map(|_| next()).collect());
        let network = Network::new(gpu, layout, weights, parameters)?;
        let kernels = LayerKernels::new(gpu, Shader::HiddenTrain, false)?;
        let inputs = (&Kernel::new(gpu, Shader::Inputs)?, &[&samples][..]);
        Ok(Self {
            forward: network.forward(gpu, &kernels, inputs, &signals, &results, &deltas)?,
            backward: network.backward(gpu, &deltas, false)?,
            network,
            rows,
            samples,
            results,
            deltas,
        })
    }

    /// The weights that the network's inputs meet, and the layer behind the skip, if there is one.
    pub(super) fn descent(&self) -> (Descent, Option<usize>) {
        let layers = &self.network.layout.layers;
        let mut descent = Descent {
            first_weights: layers[0].weights as u32,
            first_stride: layers[0].inputs as u32,
            neurons: layers[0].outputs as u32,
            ..Descent::default()
        };
        for (index, layer) in layers.iter().enumerate().skip(1) {
            if let Some(block) = layer.input_block {
                descent.skip_weights = (layer.weights + block) as u32;
                descent.skip_stride = layer.inputs as u32;
                descent.skip_neurons = layer.outputs as u32;
                return (descent, Some(index));
            }
        }
        (descent, None)
    }
}
