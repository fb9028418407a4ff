//! The network on the device and its forward pass, shared by training and evaluation.

use imf_core::field::EngineError;
use imf_fields::siren::stack::Stack;

use crate::device::{Gpu, GpuLimits};
use crate::kernel::{Bound, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::shader::{Factors, Shader, TILE};
use crate::uniforms::{Batch, Layer, Placement};

/// The padded layout and the small buffers that describe it to the kernels.
#[derive(Debug)]
pub(crate) struct Network {
    pub(crate) layout: PaddedLayout,
    pub(crate) parameters: wgpu::Buffer,
    /// One [`Layer`] each.
    pub(crate) layers: Vec<wgpu::Buffer>,
    /// The [`Batch`] at hand.
    pub(crate) batch: wgpu::Buffer,
}

/// Layout of a network on a device, after its shape was checked.
pub(crate) fn layout_for(gpu: &Gpu, stack: Stack) -> Result<PaddedLayout, EngineError> {
    stack.check().map_err(|error| EngineError::Shape(error.to_string()))?;
    let layout = PaddedLayout::new(stack, gpu.matrix_kernel().padding());
    let columns = layout.layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max().unwrap_or(0);
    let groups = columns.div_ceil(TILE as usize);
    if groups > gpu.limits().workgroups as usize {
        return Err(EngineError::Device(format!(
            "a layer of {columns} neurons needs {groups} workgroups in one dimension, the adapter has {}. Take a \
             narrower network or the CPU engine",
            gpu.limits().workgroups
        )));
    }
    Ok(layout)
}

/// Rows that one pass can hold under the limits: at most `wanted`, a multiple of the padding, at least one padding.
pub(crate) fn rows_per_pass(layout: &PaddedLayout, limits: GpuLimits, wanted: usize) -> usize {
    let columns = layout.layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max().unwrap_or(1);
    let by_binding = limits.elements() / columns;
    let by_dispatch = limits.workgroups as usize * TILE as usize;
    let rows = by_binding.min(by_dispatch) / layout.padding * layout.padding;
    rows.min(wanted.next_multiple_of(layout.padding)).max(layout.padding)
}

impl Network {
    /// Uploads the uniforms of `layout`; `parameters` are flat.
    pub(crate) fn new(
        gpu: &Gpu,
        layout: PaddedLayout,
        buffer: wgpu::Buffer,
        parameters: &[f32],
    ) -> Result<Self, EngineError> {
        let mut layers = Vec::with_capacity(layout.layers.len());
        for (index, layer) in layout.layers.iter().enumerate() {
            let block = Layer {
                inputs: layer.inputs as u32,
                outputs: layer.outputs as u32,
                weights: layer.weights as u32,
                biases: layer.biases as u32,
                stride: layout.layers.get(index + 1).map_or(layer.outputs, |next| next.inputs) as u32,
                upstream: index.checked_sub(1).map_or(0, |below| layout.layers[below].outputs) as u32,
                parameters: layout.parameters as u32,
                omega: layout.stack.omega,
            };
            layers.push(uniform(gpu, "layer", &block)?);
        }
        let batch = uniform(gpu, "batch", &Batch::default())?;
        let network = Self { layout, parameters: buffer, layers, batch };
        network.write_parameters(gpu, parameters);
        Ok(network)
    }

    /// Uploads other weights, flat ones.
    pub(crate) fn write_parameters(&self, gpu: &Gpu, parameters: &[f32]) {
        gpu.queue().write_buffer(&self.parameters, 0, bytemuck::cast_slice(&self.layout.pad(parameters)));
    }

    /// Binds a kernel that writes inputs to every signal that takes them: `batch`, `placement`, `sources`, signal.
    pub(crate) fn bind_inputs(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        sources: &[&wgpu::Buffer],
        signals: &[wgpu::Buffer],
    ) -> Result<Vec<Option<Bound>>, EngineError> {
        let bind = |(layer, signal): (&crate::layout::PaddedLayer, &wgpu::Buffer)| {
            let Some(offset) = layer.input_block else { return Ok(None) };
            let block = Placement {
                stride: layer.inputs as u32,
                offset: offset as u32,
                columns: self.layout.input_columns() as u32,
                inputs: self.layout.stack.inputs as u32,
            };
            let placement = uniform(gpu, "placement", &block)?;
            let mut buffers = vec![&self.batch, &placement];
            buffers.extend(sources);
            buffers.push(signal);
            Ok(Some(kernel.bind(gpu, &buffers)))
        };
        self.layout.layers.iter().zip(signals).map(bind).collect()
    }
}

/// The layers of a forward pass, bound to their buffers.
#[derive(Debug)]
pub(crate) struct Forward {
    layers: Vec<(Bound, usize)>,
}

impl Forward {
    /// Layer l reads `signals[l]` and writes `signals[l + 1]`, the last one `results`. With `slopes` (one buffer for
    /// each hidden layer) the pass keeps what the backward pass needs. `factors` are those of the products between
    /// hidden layers; the first layer's inputs and the output are f32.
    pub(crate) fn new(
        gpu: &Gpu,
        network: &Network,
        signals: &[wgpu::Buffer],
        results: &wgpu::Buffer,
        slopes: Option<&[wgpu::Buffer]>,
        factors: Factors,
    ) -> Result<Self, EngineError> {
        let shader = if slopes.is_some() { Shader::HiddenTrain } else { Shader::HiddenEvaluate };
        let first = Kernel::new(gpu, shader)?;
        let hidden = first.between_layers(gpu, shader, factors)?;
        let linear = Kernel::new(gpu, Shader::Linear)?;
        let last = network.layers.len() - 1;
        let bind = |index: usize| {
            let target = if index == last { results } else { &signals[index + 1] };
            let mut buffers =
                vec![&network.batch, &network.layers[index], &network.parameters, &signals[index], target];
            if index == last {
                return linear.bind(gpu, &buffers);
            }
            buffers.extend(slopes.map(|slopes| &slopes[index]));
            if index == 0 { first.bind(gpu, &buffers) } else { hidden.bind(gpu, &buffers) }
        };
        let layers = (0..=last).map(|index| (bind(index), network.layout.layers[index].outputs)).collect();
        Ok(Self { layers })
    }

    /// Records the pass. A layer's inputs are written just before its activations, so that signals may share buffers
    /// in turns.
    pub(crate) fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        inputs: &[Option<Bound>],
        padded_rows: usize,
        workgroups: u32,
    ) {
        let place = |pass: &mut wgpu::ComputePass<'_>, index: usize| {
            if let Some(Some(bound)) = inputs.get(index) {
                bound.linear(pass, padded_rows, workgroups);
            }
        };
        place(pass, 0);
        for (index, (bound, outputs)) in self.layers.iter().enumerate() {
            place(pass, index + 1);
            bound.product(pass, padded_rows, *outputs, 1);
        }
    }
}
