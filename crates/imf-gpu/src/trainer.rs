//! Training on the GPU: weights and moments stay on the device, many steps are one submission that nobody waits for, and
//! only losses are read back.
//!
//! ```text
//! inputs → forward (keeps slopes) → loss, Δ → backward (slopes become Δ) → partial gradients → reduce → Adam; SOAP
//! ```
//!
//! A batch too large for the adapter's limits goes in parts whose gradients add up. The order of every sum depends on
//! the batch and the limits alone.

mod kernels;
mod plan;
mod soap;

use imf_core::field::EngineError;
use imf_fields::recipe::{AdamConfig, Loss, Optimiser, Precision, TrainingState};
use imf_fields::siren::SirenShape;
use imf_fields::siren::stack::Stack;
use imf_train::training::TrainingEngine;

use crate::device::Gpu;
use crate::forward::{Network, layout_for};
use crate::kernel::{Dispatch, uniform};
use crate::shader::{LOSS_L1, LOSS_L1_SMALL, LOSS_L2};
use crate::submit::Recorder;
use crate::uniforms::{Batch, Step};
use plan::{LOSS_SLOTS, plan, slice};
use soap::SoapStep;

/// How a trainer learns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrainerSettings {
    /// Of every weight that the optimiser of the matrices does not step.
    pub adam: AdamConfig,
    /// What a step minimises.
    pub loss: Loss,
    /// How the matrices between hidden layers follow the gradient.
    pub optimiser: Optimiser,
    /// What the products between hidden layers are computed in.
    pub precision: Precision,
}

/// A training engine on one GPU.
#[derive(Debug)]
pub struct GpuTrainer {
    gpu: Gpu,
    settings: TrainerSettings,
    max_batch: usize,
    /// Rows that one pass holds.
    part_rows: usize,
    max_slices: usize,
    network: Network,
    gradient: Vec<Dispatch>,
    adam: Vec<Dispatch>,
    /// The matrices between hidden layers, where Adam does not step them.
    soap: Option<SoapStep>,
    buffers: Buffers,
    recorder: Recorder,
    /// Steps since the moments were zero.
    step: u64,
    /// Steps whose losses are on the device.
    slot: usize,
    /// Sum and number of the losses that have been read.
    read_losses: (f64, u64),
}

/// The buffers of a step beside the parameters.
#[derive(Debug)]
struct Buffers {
    step: wgpu::Buffer,
    samples: wgpu::Buffer,
    targets: wgpu::Buffer,
    signals: Vec<wgpu::Buffer>,
    deltas: Vec<wgpu::Buffer>,
    results: wgpu::Buffer,
    row_losses: wgpu::Buffer,
    losses: wgpu::Buffer,
    partials: wgpu::Buffer,
    gradient: wgpu::Buffer,
    first_moment: wgpu::Buffer,
    second_moment: wgpu::Buffer,
}

impl GpuTrainer {
    /// Compiles the kernels, allocates the buffers for batches of up to `max_batch` samples, and uploads `state`. The moments of
    /// `state` mean what they mean on the CPU, whichever the optimiser, so that a training moves between the two.
    ///
    /// # Errors
    /// [`EngineError::Shape`] for a network, state, batch or Adam setting that cannot be; [`EngineError::Device`] for a precision
    /// that the adapter does not have, a network beyond its limits (with the estimate), too little memory, or a device that failed.
    pub fn new(
        gpu: &Gpu,
        stack: Stack,
        settings: &TrainerSettings,
        max_batch: usize,
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        let TrainerSettings { adam, optimiser, precision, .. } = *settings;
        Self::check_precision(gpu, precision)?;
        let layout = layout_for(gpu, stack)?;
        check_state(&stack, state)?;
        if max_batch == 0 {
            return Err(EngineError::Shape("a batch needs at least one sample".to_owned()));
        }
        if adam.epsilon <= 0.0 {
            return Err(EngineError::Shape(format!("Adam's epsilon must be positive, not {}", adam.epsilon)));
        }
        let (plan, part_rows, max_slices) = plan(&layout, gpu.limits(), max_batch);
        let mut allocated = plan.allocate(gpu)?.into_iter();
        let mut next = || allocated.next().expect("as many as are planned");
        let [parameters, first_moment, second_moment, gradient, partials, upload] = [(); 6].map(|()| next());
        let [samples, targets, row_losses, losses, results] = [(); 5].map(|()| next());
        let [signals, deltas] = [(); 2].map(|()| layout.layers.iter().map(|_| next()).collect());
        assert!(allocated.next().is_none(), "as many as are planned");
        let step = uniform(gpu, "step", &Step::default())?;
        let buffers = Buffers {
            step,
            samples,
            targets,
            signals,
            deltas,
            results,
            row_losses,
            losses,
            partials,
            gradient,
            first_moment,
            second_moment,
        };
        gpu.write(&buffers.first_moment, &layout.pad(&state.first_moment));
        gpu.write(&buffers.second_moment, &layout.pad(&state.second_moment));
        let network = Network::new(gpu, layout, parameters, &state.parameters)?;
        let soap = match optimiser {
            Optimiser::Adam => None,
            Optimiser::Soap(config) => {
                gpu.in_error_scope(|| SoapStep::new(gpu, &network, &buffers, config, state))??
            }
        };
        let half = precision == Precision::F16;
        let gradient = gpu.in_error_scope(|| kernels::gradient(gpu, &network, &buffers, half))??;
        Ok(Self {
            gpu: gpu.clone(),
            settings: *settings,
            max_batch,
            part_rows,
            max_slices,
            gradient,
            adam: kernels::adam(gpu, &network, &buffers, soap.is_some())?,
            network,
            soap,
            buffers,
            recorder: Recorder::new(gpu, upload),
            step: state.step,
            slot: 0,
            read_losses: (0.0, 0),
        })
    }

    /// Whether an adapter has the products of a precision.
    ///
    /// # Errors
    /// [`EngineError::Device`] naming the remedy: it has not.
    pub fn check_precision(gpu: &Gpu, precision: Precision) -> Result<(), EngineError> {
        let device = gpu.describe();
        Err(EngineError::Device(match precision {
            Precision::F32 => return Ok(()),
            Precision::F16 if gpu.adapter().half => return Ok(()),
            Precision::F16 => {
                format!("{device}: its shaders have no f16; train with precision f32, or on another adapter")
            }
            Precision::Bf16 => format!(
                "precision bf16 is computed on CPUs alone, not on {device}: train there, or with precision f32"
            ),
        }))
    }

    /// Bytes of device memory that a trainer by Adam needs, read-back and uniforms left out.
    ///
    /// # Errors
    /// As [`GpuTrainer::new`], without allocating anything.
    pub fn memory_bytes(gpu: &Gpu, shape: SirenShape, max_batch: usize) -> Result<u64, EngineError> {
        let plan = plan(&layout_for(gpu, shape.stack())?, gpu.limits(), max_batch).0;
        plan.check(gpu.limits())?;
        Ok(plan.bytes())
    }

    /// Mean loss of a batch and its gradient in the flat layout, without a step. Waits for the device.
    ///
    /// # Errors
    /// As [`TrainingEngine::step`].
    pub fn loss_and_gradient(
        &mut self,
        inputs: &[f32],
        targets: &[f32],
    ) -> Result<(f64, Vec<f32>), EngineError> {
        self.read_losses_if(self.slot == LOSS_SLOTS)?;
        self.run(inputs, targets, None)?;
        self.recorder.submit()?;
        let losses: Vec<f32> = self.gpu.read(&self.buffers.losses, self.slot + 1)?;
        let gradient = self.gpu.read(&self.buffers.gradient, self.network.layout.parameters)?;
        Ok((f64::from(losses[self.slot]), self.network.layout.unpad(&gradient)))
    }

    /// Fills all scratch memory of a step with `value`, on which no result may depend: for tests.
    ///
    /// # Errors
    /// A device that failed.
    pub fn fill_scratch(&mut self, value: f32) -> Result<(), EngineError> {
        self.recorder.submit()?;
        let Buffers { signals, deltas, results, row_losses, partials, gradient, .. } = &self.buffers;
        let scratch = [results, row_losses, partials, gradient].into_iter().chain(signals).chain(deltas);
        let of_soap = self.soap.iter().flat_map(|soap| &soap.scratch);
        scratch.chain(of_soap).for_each(|buffer| self.gpu.fill(buffer, value));
        Ok(())
    }

    /// Loss and gradient of a batch, followed by the update if there is a learning rate.
    fn run(&mut self, inputs: &[f32], targets: &[f32], rate: Option<f32>) -> Result<(), EngineError> {
        let Stack { inputs: of_sample, outputs: learnt, .. } = self.network.layout.stack;
        let count = targets.len() / learnt;
        if inputs.len() != of_sample * count || targets.len() != learnt * count {
            return Err(EngineError::Shape(format!(
                "{} targets, {learnt} of a sample, need {} inputs, but {} were given",
                targets.len(),
                of_sample * count,
                inputs.len()
            )));
        }
        if !(1..=self.max_batch).contains(&count) {
            let most = self.max_batch;
            return Err(EngineError::Shape(format!("a batch has 1 to {most} samples, not {count}")));
        }
        self.gpu.check()?;
        let mut step = self.step_uniform(count, rate.unwrap_or(0.0));
        let parts = inputs.chunks(of_sample * self.part_rows).zip(targets.chunks(learnt * self.part_rows));
        let last = count.div_ceil(self.part_rows) - 1;
        for (index, (inputs, targets)) in parts.enumerate() {
            let rows = targets.len() / learnt;
            let batch = self.gpu.batch_of(rows);
            let (slice_rows, slices) = slice(batch.padded_rows as usize, self.max_slices);
            let batch = Batch { slice_rows: slice_rows as u32, slices: slices as u32, ..batch };
            step.first = u32::from(index == 0);
            let writes = [
                (&self.network.batch, bytemuck::bytes_of(&batch)),
                (&self.buffers.step, bytemuck::bytes_of(&step)),
                (&self.buffers.samples, bytemuck::cast_slice(inputs)),
                (&self.buffers.targets, bytemuck::cast_slice(targets)),
            ];
            let updates = index == last && rate.is_some();
            self.recorder.pass(&writes, |pass| {
                self.gradient.iter().for_each(|dispatch| dispatch.record(pass, batch));
                if updates {
                    self.adam.iter().for_each(|dispatch| dispatch.record(pass, batch));
                    self.soap.iter().for_each(|soap| soap.record(pass, self.step + 1));
                }
            })?;
        }
        Ok(())
    }

    fn step_uniform(&self, count: usize, learning_rate: f32) -> Step {
        let TrainerSettings { adam, loss, optimiser, .. } = self.settings;
        let (beta1, beta2) = (f64::from(adam.beta1), f64::from(adam.beta2));
        let correction = |beta: f64| (1.0 / (1.0 - beta.powf((self.step + 1) as f64))) as f32;
        Step {
            inverse_count: (1.0 / count as f64) as f32,
            scale: count.next_power_of_two() as f32,
            learnt: self.network.layout.stack.outputs as u32,
            loss: match loss {
                Loss::L1 => LOSS_L1,
                Loss::L2 => LOSS_L2,
                Loss::L1Small => LOSS_L1_SMALL,
            },
            slot: self.slot as u32,
            first: 1,
            learning_rate,
            beta1: adam.beta1,
            one_minus_beta1: (1.0 - beta1) as f32,
            beta2: adam.beta2,
            one_minus_beta2: (1.0 - beta2) as f32,
            correction1: correction(beta1),
            correction2: correction(beta2),
            matrix_correction: match optimiser {
                // Before the first step is done there are no moments, and none are read.
                Optimiser::Soap(config) => {
                    (1.0 / (1.0 - f64::from(config.beta).powf(self.step as f64))) as f32
                }
                Optimiser::Adam => 1.0,
            },
            epsilon: adam.epsilon,
            weight_decay: adam.weight_decay,
        }
    }

    /// Adds the losses on the device to those read, if `wanted`.
    fn read_losses_if(&mut self, wanted: bool) -> Result<(), EngineError> {
        if wanted {
            self.recorder.submit()?;
            let losses: Vec<f32> = self.gpu.read(&self.buffers.losses, self.slot)?;
            self.read_losses.0 += losses.iter().map(|&loss| f64::from(loss)).sum::<f64>();
            self.read_losses.1 += losses.len() as u64;
            self.slot = 0;
        }
        Ok(())
    }

    /// An array of the device in the flat layout.
    fn unpadded(&self, buffer: &wgpu::Buffer) -> Result<Vec<f32>, EngineError> {
        let padded = self.gpu.read(buffer, self.network.layout.parameters)?;
        Ok(self.network.layout.unpad(&padded))
    }
}

/// Refuses a state that does not fit the network.
fn check_state(stack: &Stack, state: &TrainingState) -> Result<(), EngineError> {
    stack.trained_ending()?;
    for (name, values) in [
        ("parameters", &state.parameters),
        ("first moments", &state.first_moment),
        ("second moments", &state.second_moment),
    ] {
        stack.check_parameters(values).map_err(|error| EngineError::Shape(format!("{name}: {error}")))?;
    }
    Ok(())
}

impl TrainingEngine for GpuTrainer {
    fn describe(&self) -> String {
        match self.settings.precision {
            Precision::F32 => self.gpu.describe(),
            precision => format!("{}, products in {precision}", self.gpu.describe()),
        }
    }

    fn inputs(&self) -> usize {
        self.network.layout.stack.inputs
    }

    fn outputs(&self) -> usize {
        self.network.layout.stack.outputs
    }

    fn step(&mut self, inputs: &[f32], targets: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        self.read_losses_if(self.slot == LOSS_SLOTS)?;
        self.run(inputs, targets, Some(learning_rate))?;
        self.slot += 1;
        self.step += 1;
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        self.read_losses_if(true)?;
        let (sum, count) = std::mem::take(&mut self.read_losses);
        Ok(if count == 0 { 0.0 } else { sum / count as f64 })
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        let parameters = self.weights()?;
        let preconditioners = match &self.soap {
            Some(soap) => soap.kept(&self.gpu, &self.network.layout)?,
            None => Vec::new(),
        };
        Ok(TrainingState {
            parameters,
            first_moment: self.unpadded(&self.buffers.first_moment)?,
            second_moment: self.unpadded(&self.buffers.second_moment)?,
            preconditioners,
            step: self.step,
        })
    }

    fn weights(&mut self) -> Result<Vec<f32>, EngineError> {
        self.recorder.submit()?;
        self.unpadded(&self.network.parameters)
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.network.layout.stack.check_parameters(parameters)?;
        // Steps that were recorded see the weights before.
        self.recorder.submit()?;
        self.network.write_parameters(&self.gpu, parameters);
        Ok(())
    }
}
