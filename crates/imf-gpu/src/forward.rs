//! The network on the device and its forward pass, shared by training and evaluation.

use imf_core::field::EngineError;
use imf_fields::siren::stack::Stack;

use crate::device::{Gpu, GpuLimits};
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::shader::{Shader, TILE};
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
    stack.check()?;
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
        gpu.write(&self.parameters, &self.layout.pad(parameters));
    }

    /// The forward pass. Layer l reads `signals[l]` and writes `signals[l + 1]`, the last one `results`; where the
    /// kernels retain slopes, each hidden layer's go to `slopes[l]`. A layer's inputs, which `inputs` makes of its
    /// buffers, are written just before its activations, so that signals may share buffers in turns.
    pub(crate) fn forward(
        &self,
        gpu: &Gpu,
        kernels: &LayerKernels,
        (inputs, sources): (&Kernel, &[&wgpu::Buffer]),
        signals: &[wgpu::Buffer],
        results: &wgpu::Buffer,
        slopes: &[wgpu::Buffer],
    ) -> Result<Vec<Dispatch>, EngineError> {
        let last = self.layers.len() - 1;
        let mut pass = Vec::new();
        for (index, (padded, layer)) in self.layout.layers.iter().zip(&self.layers).enumerate() {
            // The first layer's inputs and those of the next come before it.
            let placed = if index == 0 { 0..2 } else { index + 1..index + 2 };
            for (padded, signal) in placed.filter_map(|l| self.layout.layers.get(l).zip(signals.get(l))) {
                let Some(offset) = padded.input_block else { continue };
                let block = Placement {
                    stride: padded.inputs as u32,
                    offset: offset as u32,
                    columns: self.layout.input_columns() as u32,
                    inputs: self.layout.stack.inputs as u32,
                };
                let placement = uniform(gpu, "placement", &block)?;
                let buffers = [&[&self.batch, &placement], sources, &[signal]].concat();
                pass.push(inputs.bind(Extent::PaddedRows, &buffers));
            }
            let target = if index == last { results } else { &signals[index + 1] };
            let mut buffers = vec![&self.batch, layer, &self.parameters, &signals[index], target];
            let kernel = match index {
                _ if index == last => &kernels.last,
                0 => &kernels.first,
                _ => &kernels.hidden,
            };
            if index < last {
                buffers.extend(slopes.get(index));
            }
            pass.push(kernel.bind(Extent::Product(padded.outputs), &buffers));
        }
        Ok(pass)
    }

    /// The way back from the last layer's Δ to the first one's: layer l reads `deltas[l]`, and in `deltas[l − 1]` its slopes become
    /// its Δ. The products between hidden layers have factors of f16 if `half`.
    pub(crate) fn backward(
        &self,
        gpu: &Gpu,
        deltas: &[wgpu::Buffer],
        half: bool,
    ) -> Result<Vec<Dispatch>, EngineError> {
        let last_kernel = Kernel::new(gpu, Shader::Backward)?;
        let hidden = last_kernel.rounded(Shader::Backward, half)?;
        let last = self.layers.len() - 1;
        let bind = |l: usize| {
            let buffers = [&self.batch, &self.layers[l], &self.parameters, &deltas[l], &deltas[l - 1]];
            let kernel = if l == last { &last_kernel } else { &hidden };
            kernel.bind(Extent::Product(self.layout.layers[l - 1].outputs), &buffers)
        };
        Ok((1..=last).rev().map(bind).collect())
    }
}

/// The kernels of a forward pass. The first layer's inputs and the output are f32 always.
#[derive(Debug)]
pub(crate) struct LayerKernels {
    first: Kernel,
    hidden: Kernel,
    last: Kernel,
}

impl LayerKernels {
    /// Of hidden layers by `shader`, whose factors are rounded to f16 between them if `half`.
    pub(crate) fn new(gpu: &Gpu, shader: Shader, half: bool) -> Result<Self, EngineError> {
        let first = Kernel::new(gpu, shader)?;
        Ok(Self { hidden: first.rounded(shader, half)?, first, last: Kernel::new(gpu, Shader::Linear)? })
    }
}
