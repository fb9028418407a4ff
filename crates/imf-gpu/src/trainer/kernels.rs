//! Every kernel of a training step, bound to the trainer's buffers, and in which order they run.

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::ShapeError;
use imf_fields::siren::stack::TaughtEnding;

use super::Buffers;
use super::plan::Places;
use super::soap::SoapStep;
use crate::device::Gpu;
use crate::forward::{Forward, Network};
use crate::kernel::{Bound, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::shader::{Factors, Shader};
use crate::uniforms::Span;

/// Every kernel of a step, bound.
#[derive(Debug)]
pub(super) struct Kernels {
    inputs: Vec<Option<Bound>>,
    forward: Forward,
    loss: Bound,
    loss_sum: Bound,
    /// Layers 1 and up.
    backward: Vec<Bound>,
    weight_gradient: Vec<Bound>,
    bias_gradient: Vec<Bound>,
    reduce: Bound,
    /// Spans of the parameters, and their lengths in vec4.
    adam: Vec<(Bound, usize)>,
    /// What lies between the spans.
    matrices: Option<SoapStep>,
}

impl Kernels {
    /// Those of the gradient; [`Self::with_optimiser`] adds the update.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        signals: &[wgpu::Buffer],
        deltas: &[wgpu::Buffer],
        [results, row_losses, partials]: [&wgpu::Buffer; 3],
        factors: Factors,
    ) -> Result<Self, EngineError> {
        let kernel = |shader| Kernel::new(gpu, shader);
        let (backward, weight, bias) =
            (kernel(Shader::Backward)?, kernel(Shader::WeightGradient)?, kernel(Shader::BiasGradient)?);
        let hidden_backward = backward.between_layers(gpu, Shader::Backward, factors)?;
        let hidden_weight = weight.between_layers(gpu, Shader::WeightGradient, factors)?;
        let (batch, layers, parameters) = (&network.batch, &network.layers, &network.parameters);
        let last = layers.len() - 1;
        let refused = |error: ShapeError| EngineError::Shape(error.to_string());
        let ending = network.layout.stack.taught_ending().map_err(refused)?;
        let each = |bind: &dyn Fn(usize) -> Bound| (0..=last).map(bind).collect::<Vec<_>>();
        Ok(Self {
            inputs: network.bind_inputs(gpu, &kernel(Shader::Inputs)?, &[&host.samples], signals)?,
            forward: Forward::new(gpu, network, signals, results, Some(deltas), factors)?,
            loss: kernel(match ending {
                TaughtEnding::Sigmoid => Shader::Loss,
                TaughtEnding::Linear => Shader::LossLinear,
            })?
            .bind(
                gpu,
                &[batch, &layers[last], &host.step, results, &host.targets, &deltas[last], row_losses],
            ),
            loss_sum: kernel(Shader::LossSum)?.bind(gpu, &[batch, &host.step, row_losses, &host.losses]),
            backward: (1..=last)
                .map(|l| {
                    let backward = if l == last { &backward } else { &hidden_backward };
                    backward.bind(gpu, &[batch, &layers[l], parameters, &deltas[l], &deltas[l - 1]])
                })
                .collect(),
            weight_gradient: each(&|l| {
                let weight = if l == 0 || l == last { &weight } else { &hidden_weight };
                weight.bind(gpu, &[batch, &layers[l], &deltas[l], &signals[l], partials])
            }),
            bias_gradient: each(&|l| bias.bind(gpu, &[batch, &layers[l], &deltas[l], partials])),
            reduce: kernel(Shader::Reduce)?.bind(gpu, &[batch, &host.step, partials, &host.gradient]),
            adam: Vec::new(),
            matrices: None,
        })
    }

    /// With the kernels of the update: Adam for all parameters, or another optimiser for the matrices between hidden layers and
    /// Adam for the rest. `buffers` are those of the trainer's plan.
    pub(super) fn with_optimiser(
        mut self,
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        places: &Places,
        buffers: &[wgpu::Buffer],
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        let adam = Kernel::new(gpu, Shader::Adam)?;
        let moments = [&host.first_moment, &host.second_moment];
        let spared = if places.matrices.is_some() { network.layout.between() } else { &[] };
        let ends = spared.iter().map(|layer| layer.weights).chain([network.layout.parameters]);
        let starts = [0].into_iter().chain(spared.iter().map(|layer| layer.biases));
        for (first, end) in starts.zip(ends) {
            let span = Span { first: first as u32 / 4, end: end as u32 / 4 };
            let block = uniform(gpu, "span", &span)?;
            let front = [&host.step, &block, &host.gradient, &network.parameters];
            let bound = adam.bind(gpu, &[&front[..], &moments].concat());
            self.adam.push((bound, (end - first) / 4));
        }
        if let Some(places) = &places.matrices {
            self.matrices = Some(SoapStep::new(gpu, network, host, places, buffers, state)?);
        }
        Ok(self)
    }

    /// Forward, loss, backward and gradient of one part of a batch.
    pub(super) fn record_gradient(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        layout: &PaddedLayout,
        padded_rows: usize,
        slices: usize,
        workgroups: u32,
    ) {
        self.forward.record(pass, &self.inputs, padded_rows, workgroups);
        self.loss.linear(pass, padded_rows, workgroups);
        self.loss_sum.single(pass);
        for (below, backward) in self.backward.iter().enumerate().rev() {
            backward.product(pass, padded_rows, layout.layers[below].outputs, 1);
        }
        for (layer, weight) in layout.layers.iter().zip(&self.weight_gradient) {
            weight.product(pass, layer.outputs, layer.inputs, slices);
        }
        for (layer, bias) in layout.layers.iter().zip(&self.bias_gradient) {
            bias.sliced(pass, layer.outputs / 4, slices);
        }
        self.reduce.linear(pass, layout.parameters / 4, workgroups);
    }

    /// The update of step number `step`, counted from 1, by a gradient that is whole.
    pub(super) fn record_update(&self, pass: &mut wgpu::ComputePass<'_>, workgroups: u32, step: u64) {
        for (adam, length) in &self.adam {
            adam.linear(pass, *length, workgroups);
        }
        if let Some(matrices) = &self.matrices {
            matrices.record(pass, step);
        }
    }

    /// What the optimiser of the matrices keeps beside the moments, as a state has it.
    pub(super) fn kept(&self, gpu: &Gpu, layout: &PaddedLayout) -> Result<Vec<f32>, EngineError> {
        self.matrices.as_ref().map_or(Ok(Vec::new()), |matrices| matrices.kept(gpu, layout))
    }
}
