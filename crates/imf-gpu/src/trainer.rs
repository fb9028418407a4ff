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
mod matrices;
mod plan;
mod proof;
mod soap;

use imf_core::field::EngineError;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::{AdamConfig, Loss, Precision, TrainingState};
use imf_fields::siren::SirenShape;
use imf_fields::siren::stack::Stack;
use imf_train::training::TrainingEngine;

use crate::device::Gpu;
use crate::forward::{Network, layout_for};
use crate::kernel::uniform;
use crate::shader::{Factors, LOSS_L1, LOSS_L2};
use crate::submit::Recorder;
use crate::uniforms::{Batch, Step};
use kernels::Kernels;
use plan::{LOSS_SLOTS, plan, slice};
use soap::SoapPlaces;

/// How a trainer learns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrainerSettings {
    /// Of every weight that the optimiser of the matrices does not step.
    pub adam: AdamConfig,
    /// What a step minimises.
    pub loss: Loss,
    /// How the matrices between hidden layers follow the gradient.
    pub optimiser: Optimiser,
    /// Factors of the products between hidden layers; anything but [`Factors::Single`] needs a device
    /// [opened for it](Gpu::for_half).
    pub factors: Factors,
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
    kernels: Kernels,
    buffers: Buffers,
    recorder: Recorder,
    /// Steps since the moments were zero.
    step: u64,
    /// Steps whose losses are on the device.
    slot: usize,
    /// Sum and number of the losses read so far.
    read_losses: (f64, u64),
}

/// The buffers that the host writes or reads.
#[derive(Debug)]
struct Buffers {
    step: wgpu::Buffer,
    samples: wgpu::Buffer,
    targets: wgpu::Buffer,
    gradient: wgpu::Buffer,
    first_moment: wgpu::Buffer,
    second_moment: wgpu::Buffer,
    losses: wgpu::Buffer,
    /// Everything that a step writes before it reads it.
    scratch: Vec<wgpu::Buffer>,
}

impl GpuTrainer {
    /// Compiles the kernels, allocates the buffers for batches of up to `max_batch` samples, and uploads `state`.
    ///
    /// # Errors
    /// [`EngineError::Shape`] for a shape, state, batch or Adam setting that cannot be; [`EngineError::Device`] for a
    /// network beyond the adapter's limits (with the estimate), too little memory, or a device that failed.
    pub fn new(
        gpu: &Gpu,
        shape: SirenShape,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        let settings = TrainerSettings { adam, loss, ..TrainerSettings::default() };
        Self::of_stack(gpu, shape.stack(), &settings, max_batch, state)
    }

    /// As [`Self::new`], with the products between hidden layers in `precision`. For f16 the adapter is opened anew
    /// ([`Gpu::for_half`]); matrix units are used once their products have been found to be those of plain f16.
    ///
    /// # Errors
    /// As [`Self::new`]; an adapter without f16; bf16, which GPUs do not have here.
    pub fn with_precision(
        gpu: &Gpu,
        shape: SirenShape,
        adam: AdamConfig,
        loss: Loss,
        max_batch: usize,
        state: &TrainingState,
        precision: Precision,
    ) -> Result<Self, EngineError> {
        Self::check_precision(gpu, precision)?;
        if precision != Precision::F16 {
            return Self::new(gpu, shape, adam, loss, max_batch, state);
        }
        let gpu = proof::proven(gpu.for_half(None)?)?;
        let factors = gpu.half().unwrap_or_default();
        let settings = TrainerSettings { adam, loss, factors, ..TrainerSettings::default() };
        Self::of_stack(&gpu, shape.stack(), &settings, max_batch, state)
    }

    /// Whether an adapter has the products of a precision.
    ///
    /// # Errors
    /// [`EngineError::Device`] naming the remedy: it has not.
    pub fn check_precision(gpu: &Gpu, precision: Precision) -> Result<(), EngineError> {
        let device = gpu.describe();
        Err(EngineError::Device(match precision {
            Precision::F32 => return Ok(()),
            Precision::F16 if gpu.adapter().half.is_some() => return Ok(()),
            Precision::F16 => {
                format!("{device}: its shaders have no f16; train with precision f32, or on another adapter")
            }
            Precision::Bf16 => format!(
                "precision bf16 is computed on CPUs alone, not on {device}: train there, or with precision f32"
            ),
        }))
    }

    /// As [`Self::new`], of any stack of sine layers, factored fields' networks among them. The moments of `state` mean what
    /// they mean on the CPU, whichever the optimiser, so that a training moves between the two.
    ///
    /// # Errors
    /// As [`Self::new`]; factors that the device was not opened for.
    pub fn of_stack(
        gpu: &Gpu,
        stack: Stack,
        settings: &TrainerSettings,
        max_batch: usize,
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        let TrainerSettings { adam, optimiser, factors, .. } = *settings;
        let opened = match factors {
            Factors::Single => true,
            Factors::Half => gpu.half().is_some(),
            Factors::Fragments(_) => gpu.half() == Some(factors) && gpu.matrix_kernel().is_padded_to_tiles(),
        };
        if !opened {
            return Err(EngineError::Device(format!(
                "{} is not opened for {}",
                gpu.describe(),
                factors.name()
            )));
        }
        let layout = layout_for(gpu, stack)?;
        check_state(&stack, state)?;
        if max_batch == 0 {
            return Err(EngineError::Shape("a batch needs at least one sample".to_owned()));
        }
        if adam.epsilon <= 0.0 {
            return Err(EngineError::Shape(format!("Adam's epsilon must be positive, not {}", adam.epsilon)));
        }
        let (plan, places, part_rows, max_slices) = plan(&layout, gpu.limits(), max_batch, optimiser);
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let all = |places: &[usize]| places.iter().map(|&place| at(place)).collect::<Vec<_>>();
        for (place, moments) in
            [(places.first_moment, &state.first_moment), (places.second_moment, &state.second_moment)]
        {
            gpu.queue().write_buffer(&buffers[place], 0, bytemuck::cast_slice(&layout.pad(moments)));
        }
        let upload = at(places.upload);
        let network = Network::new(gpu, layout, at(places.parameters), &state.parameters)?;
        let mut scratch = all(&places.signals);
        scratch.extend(all(&places.deltas));
        scratch.extend([places.gradient, places.partials, places.row_losses, places.results].map(at));
        scratch.extend(places.matrices.iter().flat_map(SoapPlaces::scratch).map(at));
        let host = Buffers {
            step: uniform(gpu, "step", &Step::default())?,
            samples: at(places.samples),
            targets: at(places.targets),
            gradient: at(places.gradient),
            first_moment: at(places.first_moment),
            second_moment: at(places.second_moment),
            losses: at(places.losses),
            scratch,
        };
        let kernels = gpu.guarded(|| {
            Kernels::new(
                gpu,
                &network,
                &host,
                &all(&places.signals),
                &all(&places.deltas),
                [&at(places.results), &at(places.row_losses), &at(places.partials)],
                factors,
            )?
            .with_optimiser(gpu, &network, &host, &places, &buffers, state)
        })??;
        Ok(Self {
            gpu: gpu.clone(),
            settings: *settings,
            max_batch,
            part_rows,
            max_slices,
            network,
            kernels,
            buffers: host,
            recorder: Recorder::new(upload),
            step: state.step,
            slot: 0,
            read_losses: (0.0, 0),
        })
    }

    /// Bytes of device memory that a trainer by Adam needs, read-back and uniforms left out.
    ///
    /// # Errors
    /// As [`GpuTrainer::new`], without allocating anything.
    pub fn memory_bytes(gpu: &Gpu, shape: SirenShape, max_batch: usize) -> Result<u64, EngineError> {
        let plan = plan(&layout_for(gpu, shape.stack())?, gpu.limits(), max_batch, Optimiser::Adam).0;
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
        self.recorder.submit(&self.gpu)?;
        let losses: Vec<f32> = self.gpu.read(&self.buffers.losses, self.slot + 1)?;
        let gradient = self.gpu.read(&self.buffers.gradient, self.network.layout.parameters)?;
        Ok((f64::from(losses[self.slot]), self.network.layout.unpad(&gradient)))
    }

    /// Fills all scratch memory of a step with `value`, on which no result may depend: for tests.
    ///
    /// # Errors
    /// A device that failed.
    pub fn fill_scratch(&mut self, value: f32) -> Result<(), EngineError> {
        self.recorder.submit(&self.gpu)?;
        for buffer in &self.buffers.scratch {
            let values = vec![value; buffer.size() as usize / 4];
            self.gpu.queue().write_buffer(buffer, 0, bytemuck::cast_slice(&values));
        }
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
            return Err(EngineError::Shape(format!(
                "a batch has 1 to {} samples, not {count}",
                self.max_batch
            )));
        }
        self.gpu.check()?;
        let mut step = self.step_uniform(count, rate.unwrap_or(0.0));
        let parts = inputs.chunks(of_sample * self.part_rows).zip(targets.chunks(learnt * self.part_rows));
        let last = count.div_ceil(self.part_rows) - 1;
        for (index, (inputs, targets)) in parts.enumerate() {
            let rows = targets.len() / learnt;
            let padded_rows = rows.next_multiple_of(self.network.layout.padding);
            let (slice_rows, slices) = slice(padded_rows, self.max_slices);
            let batch = Batch {
                rows: rows as u32,
                padded_rows: padded_rows as u32,
                slice_rows: slice_rows as u32,
                slices: slices as u32,
            };
            step.first = u32::from(index == 0);
            let writes = [
                (&self.network.batch, bytemuck::bytes_of(&batch)),
                (&self.buffers.step, bytemuck::bytes_of(&step)),
                (&self.buffers.samples, bytemuck::cast_slice(inputs)),
                (&self.buffers.targets, bytemuck::cast_slice(targets)),
            ];
            let workgroups = self.gpu.limits().workgroups;
            let (kernels, layout, step) = (&self.kernels, &self.network.layout, self.step + 1);
            self.recorder.pass(&self.gpu, &writes, |pass| {
                kernels.record_gradient(pass, layout, padded_rows, slices, workgroups);
                if index == last && rate.is_some() {
                    kernels.record_update(pass, workgroups, step);
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
                    (1.0 / (1.0 - f64::from(config.kept).powf(self.step as f64))) as f32
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
            self.recorder.submit(&self.gpu)?;
            let losses: Vec<f32> = self.gpu.read(&self.buffers.losses, self.slot)?;
            self.read_losses.0 += losses.iter().map(|&loss| f64::from(loss)).sum::<f64>();
            self.read_losses.1 += losses.len() as u64;
            self.slot = 0;
        }
        Ok(())
    }
}

impl GpuTrainer {
    /// An array of the device in the flat layout.
    fn unpadded(&self, buffer: &wgpu::Buffer) -> Result<Vec<f32>, EngineError> {
        let padded = self.gpu.read(buffer, self.network.layout.parameters)?;
        Ok(self.network.layout.unpad(&padded))
    }
}

/// Refuses a state that does not fit the network.
fn check_state(stack: &Stack, state: &TrainingState) -> Result<(), EngineError> {
    stack.taught_ending().map_err(|error| EngineError::Shape(error.to_string()))?;
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
        match self.settings.factors {
            Factors::Single => self.gpu.describe(),
            factors => format!("{}, products in {}", self.gpu.describe(), factors.name()),
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
        Ok(TrainingState {
            parameters: self.weights()?,
            first_moment: self.unpadded(&self.buffers.first_moment)?,
            second_moment: self.unpadded(&self.buffers.second_moment)?,
            preconditioners: self.kernels.kept(&self.gpu, &self.network.layout)?,
            step: self.step,
        })
    }

    fn weights(&mut self) -> Result<Vec<f32>, EngineError> {
        self.recorder.submit(&self.gpu)?;
        self.unpadded(&self.network.parameters)
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        let refused = |error: imf_fields::siren::ShapeError| EngineError::Shape(error.to_string());
        self.network.layout.stack.check_parameters(parameters).map_err(refused)?;
        // Steps that were recorded see the weights before.
        self.recorder.submit(&self.gpu)?;
        self.network.write_parameters(&self.gpu, parameters);
        Ok(())
    }
}
