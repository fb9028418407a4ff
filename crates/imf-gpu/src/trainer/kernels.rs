//! The kernels of a gradient and of Adam's update, bound to the trainer's buffers, in the order in which they run.

use imf_core::field::EngineError;
use imf_fields::siren::stack::TrainedEnding;

use super::Buffers;
use crate::device::Gpu;
use crate::forward::{LayerKernels, Network};
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::shader::Shader;
use crate::uniforms::Span;

/// Forward, loss, backward and gradient of one part of a batch; factors of the products between hidden layers are rounded to f16 if
/// `half`.
pub(super) fn gradient(
    gpu: &Gpu,
    network: &Network,
    buffers: &Buffers,
    half: bool,
) -> Result<Vec<Dispatch>, EngineError> {
    let kernel = |shader| Kernel::new(gpu, shader);
    let Buffers { step, signals, deltas, results, row_losses, partials, .. } = buffers;
    let Network { layout, batch, layers, .. } = network;
    let last = layers.len() - 1;
    let inputs = kernel(Shader::Inputs)?;
    let hidden = LayerKernels::new(gpu, Shader::HiddenTrain, half)?;
    let mut pass = network.forward(gpu, &hidden, (&inputs, &[&buffers.samples]), signals, results, deltas)?;
    let ending = layout.stack.trained_ending()?;
    let loss = kernel(match ending {
        TrainedEnding::Sigmoid => Shader::Loss,
        TrainedEnding::Linear => Shader::LossLinear,
    })?;
    let of_loss = [batch, &layers[last], step, results, &buffers.targets, &deltas[last], row_losses];
    pass.push(loss.bind(Extent::PaddedRows, &of_loss));
    let loss_sum = kernel(Shader::LossSum)?;
    pass.push(loss_sum.bind(Extent::Single, &[batch, step, row_losses, &buffers.losses]));
    pass.extend(network.backward(gpu, deltas, half)?);
    let (weight, bias) = (kernel(Shader::WeightGradient)?, kernel(Shader::BiasGradient)?);
    let between = weight.rounded(Shader::WeightGradient, half)?;
    for (l, padded) in layout.layers.iter().enumerate() {
        let kernel = if l == 0 || l == last { &weight } else { &between };
        let extent = Extent::SlicedProduct(padded.outputs, padded.inputs);
        pass.push(kernel.bind(extent, &[batch, &layers[l], &deltas[l], &signals[l], partials]));
    }
    for (l, padded) in layout.layers.iter().enumerate() {
        let extent = Extent::Sliced(padded.outputs / 4);
        pass.push(bias.bind(extent, &[batch, &layers[l], &deltas[l], partials]));
    }
    let reduce = Extent::Elements(layout.parameters / 4);
    pass.push(kernel(Shader::Reduce)?.bind(reduce, &[batch, step, partials, &buffers.gradient]));
    Ok(pass)
}

/// Adam for all parameters, or for what lies outside the matrices between hidden layers.
pub(super) fn adam(
    gpu: &Gpu,
    network: &Network,
    buffers: &Buffers,
    spares_matrices: bool,
) -> Result<Vec<Dispatch>, EngineError> {
    let kernel = Kernel::new(gpu, Shader::Adam)?;
    let Buffers { step, gradient, first_moment, second_moment, .. } = buffers;
    let spared = if spares_matrices { network.layout.between() } else { &[] };
    let starts = [0].into_iter().chain(spared.iter().map(|layer| layer.biases));
    let ends = spared.iter().map(|layer| layer.weights).chain([network.layout.parameters]);
    let bind = |(first, end): (usize, usize)| {
        let span = uniform(gpu, "span", &Span { first: first as u32 / 4, end: end as u32 / 4 })?;
        let all = [step, &span, gradient, &network.parameters, first_moment, second_moment];
        Ok(kernel.bind(Extent::Elements((end - first) / 4), &all))
    };
    starts.zip(ends).map(bind).collect()
}
