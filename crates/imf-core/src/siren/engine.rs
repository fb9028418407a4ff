//! The CPU training engine: forward, backward and Adam in `f32` on the current rayon pool.
//!
//! A step walks over the batch in windows (see `plan.rs`). In each window blocks of samples pass forward and
//! backward, one core a block; then every panel of neurons multiplies its δ with the activations before it, adds the
//! blocks' partial sums in their order, and in the last window takes its Adam step while its gradient is in cache.
//! All pieces and all orders of addition are fixed by the network and the batch: the number of threads changes nothing,
//! and no memory of ours is allocated in a step.

use pulp::Arch;

use super::adam::AdamFactors;
use super::backward::scratch_length;
use super::forward::{Network, sigmoid};
use super::matrix::{Matrix, multiply, prefer_unpacked};
use super::muon::{Muon, MuonConfig};
use super::plan::{BLOCK, Part, Piece, Plan, WINDOW, transpose, transpose_all};
use super::scratch::{ScratchPool, describe};
use super::stack::{Ending, Stack};
use crate::siren::SirenShape;
use crate::training::{AdamConfig, EngineError, Loss, TrainingEngine, TrainingState};

pub use super::evaluator::CpuEvaluator;

/// Most hidden layers of a network ([`SirenShape::check`]).
const MAX_HIDDEN: usize = 64;

/// Trains a network on the CPU; runs on the rayon pool that `step` is called in.
pub struct CpuTrainer {
    arch: Arch,
    plan: Plan,
    adam: AdamConfig,
    loss: Loss,
    max_batch: usize,
    /// Samples that `activations` and `slopes` hold for each layer.
    window: usize,
    state: TrainingState,
    gradient: Vec<f32>,
    panels: Vec<f32>,
    /// `[hidden][window][stride]` ([`Plan::stride`]).
    activations: Vec<f32>,
    /// `[hidden][window][stride]`: derivatives of the sines after the forward pass, δ after the backward pass.
    slopes: Vec<f32>,
    /// `[window][outputs]`: the output layer's sums, then its δ.
    outputs: Vec<f32>,
    /// One for each block of a window.
    partials: Vec<f32>,
    /// Summed loss of each block of a window.
    losses: Vec<f64>,
    scratch: ScratchPool,
    /// For the matrices between hidden layers, where Adam does not serve them.
    muon: Option<Muon>,
    loss_sum: f64,
    loss_steps: u64,
}

impl CpuTrainer {
    /// An engine for batches of up to `max_batch` samples that continues from `state`.
    ///
    /// Memory: 5 floats a parameter, and about `2·hidden·width` floats a sample of a window (at most 1024 samples),
    /// whatever the batch.
    ///
    /// # Errors
    /// A shape out of range, a batch of zero, or a state whose arrays do not fit the shape.
    pub fn new(
        shape: SirenShape,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: TrainingState,
    ) -> Result<Self, EngineError> {
        Self::of_stack(shape.stack(), adam, loss, max_batch, state)
    }

    /// As [`CpuTrainer::new`], of any stack.
    pub(crate) fn of_stack(
        stack: Stack,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: TrainingState,
    ) -> Result<Self, EngineError> {
        let refused = |error: crate::siren::ShapeError| EngineError::Shape(error.to_string());
        stack.check().map_err(refused)?;
        for array in [&state.parameters, &state.first_moment, &state.second_moment] {
            stack.check_parameters(array).map_err(refused)?;
        }
        if max_batch == 0 {
            return Err(EngineError::Shape("a batch needs at least one sample".into()));
        }
        prefer_unpacked();
        let plan = Plan::new(stack);
        let window = WINDOW.min(max_batch);
        let blocks = window.div_ceil(BLOCK);
        let mut panels = vec![0.0; state.parameters.len()];
        transpose_all(&plan, &state.parameters, &mut panels);
        Ok(Self {
            arch: Arch::new(),
            adam,
            loss,
            max_batch,
            window,
            gradient: vec![0.0; state.parameters.len()],
            panels,
            activations: vec![0.0; stack.hidden * window * plan.stride()],
            slopes: vec![0.0; stack.hidden * window * plan.stride()],
            outputs: vec![0.0; window * stack.outputs],
            partials: vec![0.0; blocks * plan.partial_length()],
            losses: vec![0.0; blocks],
            scratch: ScratchPool::new(scratch_length(plan.widest_panel())),
            muon: None,
            loss_sum: 0.0,
            loss_steps: 0,
            plan,
            state,
        })
    }

    /// Leaves the matrices between hidden layers to Muon.
    pub(crate) fn use_muon(&mut self, config: MuonConfig) {
        let Stack { inputs, width, .. } = self.plan.stack;
        self.muon = Some(Muon::new(config, width, width + inputs));
    }

    /// Muon's part of a step, once the gradient is whole.
    fn step_matrices(&mut self, learning_rate: f32) {
        let Some(muon) = &mut self.muon else { return };
        for (index, layer) in self.plan.layers.iter().enumerate() {
            if !is_between(&self.plan, index) {
                continue;
            }
            let range = layer.weights..layer.biases;
            let gradient = &self.gradient[range.clone()];
            let momentum = &mut self.state.first_moment[range.clone()];
            let weights = &mut self.state.parameters[range];
            muon.step(learning_rate, layer.outputs, weights, gradient, momentum);
            for neurons in self.plan.panels(index) {
                let range = self.plan.panel_range(index, &neurons);
                let rows = &self.state.parameters[range.clone()];
                transpose(rows, neurons.len(), layer.inputs, &mut self.panels[range]);
            }
        }
    }

    /// Steps since the moments were zero.
    pub(crate) fn steps(&self) -> u64 {
        self.state.step
    }

    /// The last step's gradient.
    #[cfg(test)]
    pub(crate) fn gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// The weights as they are now, in the layout of the network's layers.
    #[must_use]
    pub fn parameters(&self) -> &[f32] {
        &self.state.parameters
    }

    /// Summed loss of one window; leaves its activations, δ and partials behind.
    fn forward_backward(&mut self, inputs: &[f32], targets: &[f32], batch: usize) -> f64 {
        let blocks = (inputs.len() / self.plan.stack.inputs).div_ceil(BLOCK);
        let layer_length = self.window * self.plan.stride();
        let pass = BlockPass {
            network: Network {
                arch: self.arch,
                plan: &self.plan,
                parameters: &self.state.parameters,
                panels: &self.panels,
            },
            loss: self.loss,
            batch: batch as f64,
            scratch: &self.scratch,
        };
        pass.run(
            inputs,
            targets,
            Layers::new(&mut self.activations, layer_length),
            Layers::new(&mut self.slopes, layer_length),
            &mut self.outputs[..targets.len()],
            &mut self.partials[..blocks * self.plan.partial_length()],
            &mut self.losses[..blocks],
        );
        self.losses[..blocks].iter().sum()
    }
}

impl TrainingEngine for CpuTrainer {
    fn describe(&self) -> String {
        describe(self.arch)
    }

    fn inputs(&self) -> usize {
        self.plan.stack.inputs
    }

    fn outputs(&self) -> usize {
        self.plan.stack.outputs
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let Stack { inputs: axes, outputs, .. } = self.plan.stack;
        let batch = targets.len() / outputs;
        if batch == 0 || batch > self.max_batch {
            let most = self.max_batch;
            return Err(EngineError::Shape(format!(
                "a batch of {batch} samples; this engine takes 1 to {most}"
            )));
        }
        if inputs.len() != batch * axes || targets.len() != batch * outputs {
            let (inputs, targets) = (inputs.len(), targets.len());
            return Err(EngineError::Shape(format!(
                "{inputs} inputs for {targets} targets; {axes} belong to {outputs}"
            )));
        }
        self.state.step += 1;
        let factors = AdamFactors::new(self.adam, learning_rate, self.state.step);
        let windows = batch.div_ceil(self.window);
        let mut total = 0.0;
        for (index, (inputs, targets)) in
            inputs.chunks(self.window * axes).zip(targets.chunks(self.window * outputs)).enumerate()
        {
            total += self.forward_backward(inputs, targets, batch);
            let samples = inputs.len() / axes;
            let blocks = samples.div_ceil(BLOCK);
            let update = Update {
                arch: self.arch,
                plan: &self.plan,
                samples,
                layer_length: self.window * self.plan.stride(),
                activations: &self.activations,
                deltas: &self.slopes,
                outputs: &self.outputs,
                partials: &self.partials[..blocks * self.plan.partial_length()],
                accumulate: index > 0,
                factors: (index + 1 == windows).then_some(factors),
                spare_matrices: self.muon.is_some(),
            };
            update.run(
                &self.plan.pieces,
                Arrays {
                    parameters: &mut self.state.parameters,
                    first_moment: &mut self.state.first_moment,
                    second_moment: &mut self.state.second_moment,
                    gradient: &mut self.gradient,
                    panels: &mut self.panels,
                },
            );
        }
        self.step_matrices(learning_rate);
        self.loss_sum += total / batch as f64;
        self.loss_steps += 1;
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        let mean = if self.loss_steps == 0 { 0.0 } else { self.loss_sum / self.loss_steps as f64 };
        (self.loss_sum, self.loss_steps) = (0.0, 0);
        Ok(mean)
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        Ok(self.state.clone())
    }
}

/// A `[hidden][samples][stride]` array as one slice for each layer, so that it can be split between samples.
struct Layers<'a>([&'a mut [f32]; MAX_HIDDEN]);

impl<'a> Layers<'a> {
    fn new(array: &'a mut [f32], layer_length: usize) -> Self {
        let mut layers = array.chunks_mut(layer_length);
        Self(std::array::from_fn(|_| layers.next().unwrap_or_default()))
    }

    /// The first `middle` values of every layer, and the others.
    fn split(self, middle: usize) -> (Self, Self) {
        let mut tails = Self(std::array::from_fn(|_| <&mut [f32]>::default()));
        let mut heads = self;
        for (head, tail) in heads.0.iter_mut().zip(&mut tails.0) {
            if !head.is_empty() {
                (*head, *tail) = std::mem::take(head).split_at_mut(middle);
            }
        }
        (heads, tails)
    }
}

/// Takes blocks of samples through the network and back.
struct BlockPass<'a> {
    network: Network<'a>,
    loss: Loss,
    /// Samples of the whole batch, which the loss is averaged over.
    batch: f64,
    scratch: &'a ScratchPool,
}

impl BlockPass<'_> {
    /// Splits the samples between blocks until one block is left.
    fn run(
        &self,
        inputs: &[f32],
        targets: &[f32],
        activations: Layers<'_>,
        slopes: Layers<'_>,
        outputs: &mut [f32],
        partials: &mut [f32],
        losses: &mut [f64],
    ) {
        let blocks = losses.len();
        if blocks == 1 {
            losses[0] = self
                .scratch
                .with(|scratch| self.block(inputs, targets, activations, slopes, outputs, partials, scratch));
            return;
        }
        let stack = self.network.plan.stack;
        let middle = blocks / 2;
        let samples = middle * BLOCK;
        let values = samples * self.network.plan.stride();
        let inputs = inputs.split_at(samples * stack.inputs);
        let targets = targets.split_at(samples * stack.outputs);
        let outputs = outputs.split_at_mut(samples * stack.outputs);
        let activations = activations.split(values);
        let slopes = slopes.split(values);
        let partials = partials.split_at_mut(middle * self.network.plan.partial_length());
        let losses = losses.split_at_mut(middle);
        rayon::join(
            || self.run(inputs.0, targets.0, activations.0, slopes.0, outputs.0, partials.0, losses.0),
            || self.run(inputs.1, targets.1, activations.1, slopes.1, outputs.1, partials.1, losses.1),
        );
    }

    /// One block forward and backward; its summed loss.
    fn block(
        &self,
        inputs: &[f32],
        targets: &[f32],
        activations: Layers<'_>,
        slopes: Layers<'_>,
        outputs: &mut [f32],
        partial: &mut [f32],
        scratch: &mut [f32],
    ) -> f64 {
        let network = &self.network;
        let Stack { inputs: axes, hidden, ending, .. } = network.plan.stack;
        let values = inputs.len() / axes * network.plan.stride();
        let (Layers(mut activations), Layers(mut slopes)) = (activations, slopes);
        for layer in 0..hidden {
            let (before, from) = activations.split_at_mut(layer);
            let previous = before.last().map_or(&[][..], |previous| &previous[..values]);
            network.hidden_layer(layer, inputs, previous, from[0], Some(slopes[layer]));
        }
        let last = &activations[hidden - 1][..values];
        network.outputs(last, outputs);
        let mut loss = 0.0;
        for (delta, &target) in outputs.iter_mut().zip(targets) {
            let target = f64::from(target);
            let (output, slope) = match ending {
                Ending::Sigmoid => {
                    let output = sigmoid(*delta);
                    (output, output * (1.0 - output))
                }
                Ending::Linear => (f64::from(*delta), 1.0),
            };
            loss += self.loss.value(output, target);
            *delta = (self.loss.slope(output, target) / self.batch * slope) as f32;
        }
        let front = match ending {
            Ending::Sigmoid => {
                network.output_backward(inputs, outputs, last, slopes[hidden - 1], partial);
                hidden - 1
            }
            Ending::Linear => {
                network.output_biases(outputs, partial);
                hidden
            }
        };
        for layer in (0..front).rev() {
            let (before, behind) = slopes.split_at_mut(layer + 1);
            let next = if layer + 1 == hidden { &*outputs } else { &behind[0][..values] };
            network.hidden_backward(layer, inputs, next, before[layer], partial, scratch);
        }
        loss
    }
}

/// What the update writes, all in the layout of the flat parameters.
struct Arrays<'a> {
    parameters: &'a mut [f32],
    first_moment: &'a mut [f32],
    second_moment: &'a mut [f32],
    gradient: &'a mut [f32],
    panels: &'a mut [f32],
}

impl<'a> Arrays<'a> {
    fn split(self, middle: usize) -> (Self, Self) {
        let parameters = self.parameters.split_at_mut(middle);
        let first_moment = self.first_moment.split_at_mut(middle);
        let second_moment = self.second_moment.split_at_mut(middle);
        let gradient = self.gradient.split_at_mut(middle);
        let panels = self.panels.split_at_mut(middle);
        (
            Arrays {
                parameters: parameters.0,
                first_moment: first_moment.0,
                second_moment: second_moment.0,
                gradient: gradient.0,
                panels: panels.0,
            },
            Arrays {
                parameters: parameters.1,
                first_moment: first_moment.1,
                second_moment: second_moment.1,
                gradient: gradient.1,
                panels: panels.1,
            },
        )
    }
}

/// Gradient of one window and, in the batch's last one, the Adam step.
struct Update<'a> {
    arch: Arch,
    plan: &'a Plan,
    samples: usize,
    /// Values of one layer in `activations` and `deltas`.
    layer_length: usize,
    activations: &'a [f32],
    deltas: &'a [f32],
    /// δ of the output layer.
    outputs: &'a [f32],
    partials: &'a [f32],
    /// An earlier window has left its gradient.
    accumulate: bool,
    factors: Option<AdamFactors>,
    /// Leave the matrices between hidden layers as they are, but for their gradient.
    spare_matrices: bool,
}

/// True for a hidden layer behind another one.
fn is_between(plan: &Plan, layer: usize) -> bool {
    (1..plan.stack.hidden).contains(&layer)
}

impl Update<'_> {
    fn run(&self, pieces: &[Piece], arrays: Arrays<'_>) {
        if let [piece] = pieces {
            return self.piece(piece, arrays);
        }
        let (first, second) = pieces.split_at(pieces.len() / 2);
        let (head, tail) = arrays.split(second[0].range.start - first[0].range.start);
        rayon::join(|| self.run(first, head), || self.run(second, tail));
    }

    fn piece(&self, piece: &Piece, arrays: Arrays<'_>) {
        let plan = self.plan;
        let gradient = arrays.gradient;
        match &piece.part {
            Part::Biases => self.sum_partials(plan.partial_biases(piece.layer), gradient, 1),
            Part::Output => self.sum_partials(plan.partial_output(), gradient, 1),
            Part::Panel(neurons) => {
                let (width, inputs) = (plan.stack.width, plan.layers[piece.layer].inputs);
                let neurons_in = plan.neurons_in(piece.layer);
                if piece.layer > 0 {
                    let deltas = if piece.layer == plan.stack.hidden {
                        self.outputs
                    } else {
                        &self.deltas[piece.layer * self.layer_length..]
                    };
                    let stride = plan.row_stride(piece.layer);
                    let deltas =
                        Matrix::row_major(&deltas[neurons.start..], self.samples, neurons.len(), stride);
                    let before = &self.activations[(piece.layer - 1) * self.layer_length..];
                    let before = Matrix::row_major(before, self.samples, width, plan.stride());
                    multiply(gradient, inputs, deltas.transposed(), before, self.accumulate);
                }
                if plan.sees_input(piece.layer) {
                    for axis in 0..plan.stack.inputs {
                        let sums = plan.partial_inputs(piece.layer) + axis * width + neurons.start;
                        self.sum_partials(sums, &mut gradient[neurons_in + axis..], inputs);
                    }
                }
            }
        }
        let spared = self.spare_matrices && is_between(plan, piece.layer);
        if let Some(factors) = self.factors.filter(|_| !(spared && matches!(piece.part, Part::Panel(_)))) {
            factors.apply(self.arch, arrays.parameters, gradient, arrays.first_moment, arrays.second_moment);
            if let Part::Panel(neurons) = &piece.part {
                transpose(arrays.parameters, neurons.len(), plan.layers[piece.layer].inputs, arrays.panels);
            }
        }
    }

    /// Adds up the blocks' partial sums from `first` on, in the order of the blocks, into every `stride`-th value.
    fn sum_partials(&self, first: usize, gradient: &mut [f32], stride: usize) {
        for (index, value) in gradient.iter_mut().step_by(stride).enumerate() {
            let sum: f32 =
                self.partials.chunks_exact(self.plan.partial_length()).map(|p| p[first + index]).sum();
            *value = if self.accumulate { *value + sum } else { sum };
        }
    }
}

#[cfg(test)]
mod tests;
