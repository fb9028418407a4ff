//! The CPU training engine: forward, backward and Adam in `f32` on the current rayon pool.
//!
//! A step walks over the batch in windows (see `plan.rs`). In each window blocks of samples pass forward and
//! backward, one core a block; then every panel of neurons multiplies its δ with the activations before it, adds the
//! blocks' partial sums in their order, and in the last window takes its Adam step while its gradient is in cache.
//! All pieces and all orders of addition are fixed by the network and the batch: the number of threads changes nothing,
//! and no memory of ours is allocated in a step.

mod adam;
mod backward;
mod bf16;
mod matrices;
mod orthonormal;
mod pass;
pub mod ranks;
pub mod soap;
mod step;
mod update;

use pulp::Arch;

use crate::engine::adam::AdamFactors;
use imf_core::field::EngineError;
use imf_fields::recipe::{AdamConfig, Loss, Precision, SoapConfig, TrainingState};
use imf_fields::siren::SirenShape;
use imf_fields::siren::bf16_kernel::Kernel;
use imf_fields::siren::forward::Network;
use imf_fields::siren::matrix::prefer_unpacked;
use imf_fields::siren::plan::{BLOCK, Plan, WINDOW, transpose_all};
use imf_fields::siren::scratch::ScratchPool;
use imf_fields::siren::stack::{Stack, TrainedEnding};

use bf16::Pairs;
use matrices::Matrices;
use pass::{BlockLoss, BlockPass, Layers};
use update::{Arrays, Step, Update};

pub use imf_fields::siren::evaluator::CpuEvaluator;

/// Trains a network on the CPU; runs on the rayon pool that `step` is called in.
pub struct CpuTrainer {
    arch: Arch,
    plan: Plan,
    adam: AdamConfig,
    loss: Loss,
    ending: TrainedEnding,
    max_batch: usize,
    /// Samples that `activations` and `slopes` hold for each layer.
    window: usize,
    state: TrainingState,
    /// Whole where the caller wants it, or summed over windows, or left to the matrices' own optimiser.
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
    /// For the gradient of a piece.
    gradients: ScratchPool,
    /// For the matrices between hidden layers, where Adam does not serve them.
    matrices: Option<Matrices>,
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
        let gradients = rayon::current_num_threads() * plan.longest_piece();
        let partials = 4 * (blocks * plan.partial_length() + gradients) as u64;
        let window = match precision {
            // f16 is refused by `check_precision`.
            Precision::F32 | Precision::F16 => {
                let layers = 2 * shape.hidden * window * plan.stride();
                let scratch = rayon::current_num_threads() * BLOCK * plan.widest_panel();
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
        stack: Stack,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: TrainingState,
    ) -> Result<Self, EngineError> {
        let ending = stack.trained_ending()?;
        for array in [&state.parameters, &state.first_moment, &state.second_moment] {
            stack.check_parameters(array)?;
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
            scratch: ScratchPool::new(BLOCK * plan.widest_panel()),
            gradients: ScratchPool::new(plan.longest_piece()),
            matrices: None,
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
    /// A CPU without bfloat16 products, or a network whose output is not one of [`SirenShape`]'s.
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
            Precision::F32 => return Ok(()),
            Precision::Bf16 if Kernel::of_this_machine().is_some() => return Ok(()),
            Precision::Bf16 => "this CPU has no bfloat16 products (AVX-512 BF16); train with precision f32",
            Precision::F16 => {
                "precision f16 is computed on GPUs alone: train on one, as a resumed training keeps its precision, or \
                 begin a training with precision f32"
            }
        };
        Err(EngineError::Device(why.to_owned()))
    }

    /// As [`Self::with_precision`], by a kernel that is there.
    fn with_kernel(mut self, kernel: Kernel) -> Result<Self, EngineError> {
        if self.ending != TrainedEnding::Sigmoid || self.matrices.is_some() {
            return Err(EngineError::Shape(
                "bfloat16 products are made for the paper's network alone".into(),
            ));
        }
        self.pairs = Some(Pairs::new(kernel, &self.plan, self.window.div_ceil(BLOCK)));
        (self.activations, self.slopes) = (Vec::new(), Vec::new());
        Ok(self)
    }

    /// Leaves the matrices between hidden layers to SOAP, which goes on from what the state has of it.
    ///
    /// # Errors
    /// A state that has something else, or nothing after its first step.
    pub fn use_soap(&mut self, config: SoapConfig) -> Result<(), EngineError> {
        let kept = std::mem::take(&mut self.state.preconditioners);
        self.matrices = Some(Matrices::new(config, &self.plan, self.state.step, &kept)?);
        Ok(())
    }

    /// What the matrices' own optimiser does of a step, once the gradient is whole.
    fn step_matrices(&mut self, learning_rate: f32) {
        let Some(matrices) = &mut self.matrices else { return };
        let step = self.state.step;
        let arrays = Arrays::of(&mut self.state, &mut self.gradient, &mut self.panels);
        matrices.step(&self.plan, step, learning_rate, arrays);
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
        let spare_matrices = self.matrices.is_some();
        let step = Step { arch: self.arch, plan: &self.plan, factors, spare_matrices };
        step.run(Arrays::of(&mut self.state, &mut self.gradient, &mut self.panels));
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
                gradients: &self.gradients,
                pairs: self.pairs.as_ref(),
                accumulate: index > 0,
                factors: factors.filter(|_| index + 1 == windows),
                spare_matrices: self.matrices.is_some(),
            };
            update.run(Arrays::of(&mut self.state, &mut self.gradient, &mut self.panels));
        }
        total
    }

    /// Summed loss of one window; leaves its activations, δ and partials behind.
    fn forward_backward(&mut self, inputs: &[f32], targets: &[f32], batch: usize) -> f64 {
        let blocks = (inputs.len() / self.plan.stack.inputs).div_ceil(BLOCK);
        let layer_length = self.window * self.plan.stride();
        let network = Network::new(self.arch, &self.plan, &self.state.parameters, &self.panels);
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

#[cfg(test)]
mod tests;
