//! The CPU training engine: forward, backward and Adam in `f32` on the current rayon pool.
//!
//! A step walks over the batch in windows (see `plan.rs`). In each window blocks of samples pass forward and
//! backward, one core a block; then every panel of neurons multiplies its δ with the activations before it, adds the
//! blocks' partial sums in their order, and in the last window takes its Adam step while its gradient is in cache.
//! All pieces and all orders of addition are fixed by the network and the batch: the number of threads changes nothing,
//! and no memory of ours is allocated in a step.

mod bf16;
mod matrices;
pub mod ranks;
mod update;

use pulp::Arch;

use super::adam::AdamFactors;
use super::backward::scratch_length;
use super::bf16::Kernel;
use super::forward::{Network, sigmoid};
use super::matrix::prefer_unpacked;
use super::muon::{Muon, MuonConfig};
use super::plan::{BLOCK, Plan, WINDOW, transpose_all};
use super::scratch::{ScratchPool, describe};
use super::stack::{Stack, TaughtEnding};
use crate::siren::SirenShape;
use crate::training::{AdamConfig, EngineError, Loss, Precision, TrainingEngine, TrainingState};

use bf16::Pairs;
use matrices::Matrices;
use update::{Arrays, Step, Update};

pub use super::evaluator::CpuEvaluator;

/// Most hidden layers of a network ([`SirenShape::check`]).
const MAX_HIDDEN: usize = 64;

/// Trains a network on the CPU; runs on the rayon pool that `step` is called in.
pub struct CpuTrainer {
    arch: Arch,
    plan: Plan,
    adam: AdamConfig,
    loss: Loss,
    ending: TaughtEnding,
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
    /// For each matrix between hidden layers, where Adam does not serve them.
    muon: Option<Vec<Muon>>,
    /// For products in bfloat16; the arrays of a window above are then empty, but for the outputs.
    pairs: Option<Pairs>,
    loss_sum: f64,
    loss_steps: u64,
}

impl CpuTrainer {
    /// Memory for each parameter: weights, weights transposed, gradient, both moments.
    pub const BYTES_PER_PARAMETER: u64 = 4 * 5;

    /// Bytes that an engine takes for batches of up to `max_batch` samples: those of the parameters, and for a window of
    /// samples, whatever the batch, the activations and slopes of every layer.
    #[must_use]
    pub fn memory_bytes(shape: SirenShape, max_batch: usize, precision: Precision) -> u64 {
        let plan = Plan::new(shape.stack());
        let window = WINDOW.min(max_batch);
        let blocks = window.div_ceil(BLOCK);
        let parameters = Self::BYTES_PER_PARAMETER * shape.parameter_count() as u64;
        let partials = 4 * (blocks * plan.partial_length()) as u64;
        let window = match precision {
            // f16 is refused by `check_precision`.
            Precision::F32 | Precision::F16 => {
                let layers = 2 * shape.hidden * window * plan.stride();
                let scratch = rayon::current_num_threads() * scratch_length(plan.widest_panel());
                4 * (layers + scratch) as u64
            }
            Precision::Bf16 => Pairs::memory_bytes(&plan, blocks),
        };
        parameters + partials + window
    }

    /// An engine for batches of up to `max_batch` samples that continues from `state`.
    ///
    /// Memory: [`Self::memory_bytes`].
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
    ///
    /// # Errors
    /// As [`CpuTrainer::new`].
    pub fn of_stack(
        stack: Stack,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: TrainingState,
    ) -> Result<Self, EngineError> {
        let refused = |error: crate::siren::ShapeError| EngineError::Shape(error.to_string());
        let ending = stack.taught_ending().map_err(refused)?;
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
            ending,
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
            pairs: None,
            loss_sum: 0.0,
            loss_steps: 0,
            plan,
            state,
        })
    }

    /// The same engine with the products between hidden layers in this precision.
    ///
    /// # Errors
    /// A CPU without bfloat16 products, or a network whose end is none of [`SirenShape`]'s.
    pub fn with_precision(self, precision: Precision) -> Result<Self, EngineError> {
        Self::check_precision(precision)?;
        match (precision, Kernel::of_this_machine()) {
            (Precision::Bf16, Some(kernel)) => self.with_kernel(kernel),
            _ => Ok(self),
        }
    }

    /// Whether this CPU has the products of a precision.
    ///
    /// # Errors
    /// It has not.
    pub fn check_precision(precision: Precision) -> Result<(), EngineError> {
        let why = match precision {
            Precision::Bf16 if Kernel::of_this_machine().is_none() => {
                "this CPU has no bfloat16 products (AVX-512 BF16)"
            }
            Precision::F16 => {
                return Err(EngineError::Device(
                    "precision f16 is computed on GPUs alone: choose one (--device; a resumed training keeps its \
                     precision), or begin a training with precision f32"
                        .to_owned(),
                ));
            }
            Precision::F32 | Precision::Bf16 => return Ok(()),
        };
        Err(EngineError::Device(format!("{why}; train with precision f32")))
    }

    /// As [`Self::with_precision`], by a kernel that is there.
    fn with_kernel(mut self, kernel: Kernel) -> Result<Self, EngineError> {
        if self.ending != TaughtEnding::Sigmoid || self.muon.is_some() {
            return Err(EngineError::Shape(
                "bfloat16 products are made for the paper's network alone".into(),
            ));
        }
        self.pairs = Some(Pairs::new(kernel, &self.plan, self.window.div_ceil(BLOCK)));
        (self.activations, self.slopes) = (Vec::new(), Vec::new());
        Ok(self)
    }

    /// Leaves the matrices between hidden layers to Muon, whose momentum stands in the place of their first moments.
    pub fn use_muon(&mut self, config: MuonConfig) {
        let between = &self.plan.layers[self.plan.stack.between()];
        self.muon =
            Some(between.iter().map(|layer| Muon::new(config, layer.outputs, layer.inputs)).collect());
    }

    /// Muon's part of a step, once the gradient is whole: every matrix for itself.
    fn step_matrices(&mut self, learning_rate: f32) {
        let Some(muons) = &mut self.muon else { return };
        let Some(first) = self.plan.layers.get(1) else { return };
        let from = first.weights;
        let matrices = Matrices { plan: &self.plan, learning_rate };
        matrices.step(
            1,
            muons,
            [
                &mut self.state.parameters[from..],
                &mut self.state.first_moment[from..],
                &mut self.panels[from..],
            ],
            &self.gradient,
        );
    }

    /// The last step's gradient.
    #[cfg(test)]
    pub(crate) fn last_gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// The weights as they are now, in the layout of the network's layers.
    #[must_use]
    pub fn parameters(&self) -> &[f32] {
        &self.state.parameters
    }

    /// The gradient of some samples of a batch, for training with others: that of the mean loss over all `batch`
    /// samples, as far as these contribute to it. Returns their summed loss and the gradient in the layout of the
    /// parameters, which the caller may change before [`Self::update`]. No samples have a gradient of zeros.
    ///
    /// # Errors
    /// More samples than the engine was made for, or inputs that do not fit.
    pub fn gradient(
        &mut self,
        inputs: &[f32],
        targets: &[f32],
        batch: usize,
    ) -> Result<(f64, &mut [f32]), EngineError> {
        self.check(inputs, targets)?;
        if targets.is_empty() {
            self.gradient.fill(0.0);
        }
        let loss = self.accumulate(inputs, targets, batch, None);
        Ok((loss, &mut self.gradient))
    }

    /// Adam's step by the gradient that [`Self::gradient`] left, or that the caller made of it.
    pub fn update(&mut self, learning_rate: f32) {
        self.state.step += 1;
        let factors = AdamFactors::new(self.adam, learning_rate, self.state.step);
        let spare_matrices = self.muon.is_some();
        let step = Step { arch: self.arch, plan: &self.plan, factors, spare_matrices };
        step.run(
            &self.plan.pieces,
            Arrays {
                parameters: &mut self.state.parameters,
                first_moment: &mut self.state.first_moment,
                second_moment: &mut self.state.second_moment,
                gradient: &mut self.gradient,
                panels: &mut self.panels,
            },
        );
        self.step_matrices(learning_rate);
    }

    fn refusal(&self, batch: usize) -> EngineError {
        let most = self.max_batch;
        EngineError::Shape(format!("a batch of {batch} samples; this engine takes 1 to {most}"))
    }

    /// Checks that the engine has room for the samples, and that there are as many inputs as targets.
    fn check(&self, inputs: &[f32], targets: &[f32]) -> Result<(), EngineError> {
        let Stack { inputs: axes, outputs, .. } = self.plan.stack;
        let batch = targets.len() / outputs;
        if batch > self.max_batch {
            return Err(self.refusal(batch));
        }
        if inputs.len() != batch * axes || targets.len() != batch * outputs {
            let (inputs, targets) = (inputs.len(), targets.len());
            return Err(EngineError::Shape(format!(
                "{inputs} inputs for {targets} targets; {axes} belong to {outputs}"
            )));
        }
        Ok(())
    }

    /// Sums loss and gradient over the samples, window after window; `batch` is what the loss is averaged over. With
    /// `factors` every piece takes its Adam step as soon as its gradient is whole.
    fn accumulate(
        &mut self,
        inputs: &[f32],
        targets: &[f32],
        batch: usize,
        factors: Option<AdamFactors>,
    ) -> f64 {
        let Stack { inputs: axes, outputs, .. } = self.plan.stack;
        let windows = (targets.len() / outputs).div_ceil(self.window);
        let mut total = 0.0;
        if let Some(pairs) = &mut self.pairs {
            pairs.pack(&self.plan, &self.state.parameters, &self.panels);
        }
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
                pairs: self.pairs.as_ref(),
                accumulate: index > 0,
                factors: factors.filter(|_| index + 1 == windows),
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
        total
    }

    /// Summed loss of one window; leaves its activations, δ and partials behind.
    fn forward_backward(&mut self, inputs: &[f32], targets: &[f32], batch: usize) -> f64 {
        let blocks = (inputs.len() / self.plan.stack.inputs).div_ceil(BLOCK);
        let layer_length = self.window * self.plan.stride();
        let network = Network {
            arch: self.arch,
            plan: &self.plan,
            parameters: &self.state.parameters,
            panels: &self.panels,
        };
        let loss = BlockLoss { loss: self.loss, batch: batch as f64, ending: self.ending };
        let outputs = &mut self.outputs[..targets.len()];
        let partials = &mut self.partials[..blocks * self.plan.partial_length()];
        let losses = &mut self.losses[..blocks];
        if let Some(pairs) = &mut self.pairs {
            pairs.forward_backward(network, loss, inputs, targets, outputs, partials, losses);
        } else {
            let activations = Layers::new(&mut self.activations, layer_length);
            let slopes = Layers::new(&mut self.slopes, layer_length);
            let pass = BlockPass { network, loss, scratch: &self.scratch };
            pass.run(inputs, targets, activations, slopes, outputs, partials, losses);
        }
        self.losses[..blocks].iter().sum()
    }
}

impl TrainingEngine for CpuTrainer {
    fn describe(&self) -> String {
        let engine = describe(self.arch);
        if self.pairs.is_some() { format!("{engine}, products in bfloat16") } else { engine }
    }

    fn inputs(&self) -> usize {
        self.plan.stack.inputs
    }

    fn outputs(&self) -> usize {
        self.plan.stack.outputs
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let batch = targets.len() / self.plan.stack.outputs;
        if batch == 0 {
            return Err(self.refusal(0));
        }
        self.check(inputs, targets)?;
        self.state.step += 1;
        let factors = AdamFactors::new(self.adam, learning_rate, self.state.step);
        let total = self.accumulate(inputs, targets, batch, Some(factors));
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

    fn weights(&mut self) -> Result<Vec<f32>, EngineError> {
        Ok(self.state.parameters.clone())
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        let refused = |error: crate::siren::ShapeError| EngineError::Shape(error.to_string());
        self.plan.stack.check_parameters(parameters).map_err(refused)?;
        self.state.parameters.copy_from_slice(parameters);
        transpose_all(&self.plan, parameters, &mut self.panels);
        Ok(())
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

/// The loss at the end of a network.
#[derive(Clone, Copy)]
struct BlockLoss {
    loss: Loss,
    /// Samples of the whole batch, which the loss is averaged over.
    batch: f64,
    ending: TaughtEnding,
}

impl BlockLoss {
    /// The summed loss of some samples; the output layer's sums become its δ.
    fn take(self, outputs: &mut [f32], targets: &[f32]) -> f64 {
        let mut loss = 0.0;
        for (delta, &target) in outputs.iter_mut().zip(targets) {
            let target = f64::from(target);
            let (output, slope) = match self.ending {
                TaughtEnding::Sigmoid => {
                    let output = sigmoid(*delta);
                    (output, output * (1.0 - output))
                }
                TaughtEnding::Linear => (f64::from(*delta), 1.0),
            };
            loss += self.loss.value(output, target);
            *delta = (self.loss.slope(output, target) / self.batch * slope) as f32;
        }
        loss
    }
}

/// Takes blocks of samples through the network and back.
struct BlockPass<'a> {
    network: Network<'a>,
    loss: BlockLoss,
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
        let Stack { inputs: axes, hidden, .. } = network.plan.stack;
        let values = inputs.len() / axes * network.plan.stride();
        let (Layers(mut activations), Layers(mut slopes)) = (activations, slopes);
        for layer in 0..hidden {
            let (before, from) = activations.split_at_mut(layer);
            let previous = before.last().map_or(&[][..], |previous| &previous[..values]);
            network.hidden_layer(layer, inputs, previous, from[0], Some(slopes[layer]));
        }
        let last = &activations[hidden - 1][..values];
        network.outputs(last, outputs);
        let loss = self.loss.take(outputs, targets);
        let front = match self.loss.ending {
            TaughtEnding::Sigmoid => {
                network.output_backward(inputs, outputs, last, slopes[hidden - 1], partial);
                hidden - 1
            }
            TaughtEnding::Linear => {
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

#[cfg(test)]
mod tests;
