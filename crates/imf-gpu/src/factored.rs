//! A factored field on the GPU: its network once at every point, then one product with all orientations, whose minimum is
//! taken on the device. The field over points × orientations is never stored.
//!
//! ```text
//! points → inputs → hidden layers → coefficients [points][axes]
//!                                    └─ × heads [axes][orientations of a chunk] → values → running minimum
//! ```
//!
//! The product with the heads is the shader of a linear layer, whose weights are an orientation's functions and whose
//! bias is its mean. Where the field is told of a symmetry, the coefficients are those of the functions one by one, turned out of
//! the frames of their places before that product. Its twin is [`imf_core::factored::FactoredEvaluator`].

use std::collections::VecDeque;

use glam::DVec3;
use imf_core::factored::FactoredField;
use imf_core::orientation::Orientation;
use imf_core::training::EngineError;
use rayon::prelude::*;

use crate::device::Gpu;
use crate::forward::{Forward, Network, layout_for, rows_per_pass};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::shader::{Factors, Shader};
use crate::submit::Submissions;
use crate::uniforms::{Batch, Harmonics, Layer, PlaceFrame, Sweep};

/// Points that pass through the network together, at most.
const ROWS: usize = 1 << 14;
/// Orientations of one product, at most: values of [`ROWS`] points are 32 MiB.
const CHUNK: usize = 512;
/// Points that one thread of the host prepares at a time, at least.
const ROWS_OF_A_THREAD: usize = 512;
/// Passes whose minima wait to be read while the next is prepared.
const READINGS: usize = 4;

/// A factored field on one GPU.
#[derive(Debug)]
pub struct GpuFactored {
    gpu: Gpu,
    field: FactoredField,
    network: Network,
    inputs: Vec<Option<Bound>>,
    forward: Forward,
    /// Points that one pass holds, and orientations of a chunk.
    rows: usize,
    chunk: usize,
    samples: wgpu::Buffer,
    coefficients: wgpu::Buffer,
    values: wgpu::Buffer,
    least: wgpu::Buffer,
    best: wgpu::Buffer,
    local: Option<LocalFrames>,
    product: Kernel,
    minimum: Kernel,
    submissions: Submissions,
    /// What goes up for the points of a pass, kept from one to the next.
    inputs_up: Vec<f32>,
    frames_up: Vec<PlaceFrame>,
}

/// What takes coefficients out of the frames of their places.
#[derive(Debug)]
struct LocalFrames {
    /// [`PlaceFrame`] of every row.
    frames: wgpu::Buffer,
    turn: Bound,
    /// Pairs ±m of functions that a row has.
    orders: usize,
}

/// Some orientations on the device.
struct Chunk {
    product: Bound,
    minimum: Bound,
    sweep: Sweep,
    /// Orientations, padding among them.
    columns: usize,
}

impl GpuFactored {
    /// Compiles the kernels, allocates the buffers and uploads the weights.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a network beyond the adapter's limits, too little memory, or a device that failed.
    pub fn new(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let symmetric = !field.shape.symmetry.is_none();
        let field = if symmetric { field.by_function() } else { field.unfolded().into_owned() };
        let stack = field.shape.stack();
        let layout = layout_for(gpu, stack)?;
        let limits = gpu.limits();
        let binding = limits.storage_binding.min(limits.buffer) as usize / 4;
        let chunk = CHUNK.next_multiple_of(layout.padding);
        let rows = rows_per_pass(&layout, limits, ROWS.min(binding / chunk));
        let columns = layout.layers.iter().map(|layer| layer.inputs).max().unwrap_or(1);
        let axes = layout.layers.last().map_or(0, |layer| layer.outputs);
        let mut plan = Plan::default();
        let parameters = plan.add("parameters", layout.parameters);
        let samples = plan.add("points", rows * stack.inputs);
        let signals = [0, 1].map(|_| plan.add("signal", rows * columns));
        let coefficients = plan.add("coefficients", rows * axes);
        let values = plan.add("values", rows * chunk);
        let least = plan.add("least values", rows);
        let best = plan.add("best orientations", rows);
        let frames = symmetric.then(|| plan.add("frames", rows * size_of::<PlaceFrame>() / 4));
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let network = Network::new(gpu, layout, at(parameters), &field.parameters)?;
        let turns: Vec<wgpu::Buffer> =
            (0..network.layers.len()).map(|layer| at(signals[layer % 2])).collect();
        let (samples, coefficients) = (at(samples), at(coefficients));
        let local = frames.map(|frames| {
            LocalFrames::new(gpu, field.basis.degree(), axes, &network.batch, at(frames), &coefficients)
        });
        Ok(Self {
            local: local.transpose()?,
            inputs: network.bind_inputs(gpu, &Kernel::new(gpu, Shader::Inputs)?, &[&samples], &turns)?,
            forward: Forward::new(gpu, &network, &turns, &coefficients, None, Factors::Single)?,
            product: Kernel::new(gpu, Shader::Linear)?,
            minimum: Kernel::new(gpu, Shader::RowMinimum)?,
            gpu: gpu.clone(),
            field,
            network,
            rows,
            chunk,
            samples,
            coefficients,
            values: at(values),
            least: at(least),
            best: at(best),
            submissions: Submissions::default(),
            inputs_up: Vec::new(),
            frames_up: Vec::new(),
        })
    }

    /// The least value over the orientations at every point, an overlap in [0, 1], with the first orientation that has it before
    /// values are clipped, as [`imf_core::factored::FactoredEvaluator::minimum`]. Waits for the device.
    ///
    /// # Errors
    /// No orientation, too many for the adapter's memory, or a device that failed.
    pub fn minimum(
        &mut self,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<(Vec<f32>, Vec<u32>), EngineError> {
        let (mut least, best) = self.minimum_unclipped(points, orientations)?;
        least.iter_mut().for_each(|value| *value = self.field.quantity.held(*value));
        Ok((least, best))
    }

    /// As [`Self::minimum`], of values that are not clipped.
    pub(crate) fn minimum_unclipped(
        &mut self,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<(Vec<f32>, Vec<u32>), EngineError> {
        let chunks = self.chunks(orientations)?;
        let (mut least, mut best) = (Vec::with_capacity(points.len()), Vec::with_capacity(points.len()));
        let mut take = |(of_least, of_best), gpu: &Gpu| {
            least.extend(gpu.finish_read::<f32>(of_least)?);
            best.extend(gpu.finish_read::<u32>(of_best)?);
            Ok::<_, EngineError>(())
        };
        let mut readings = VecDeque::new();
        for points in points.chunks(self.rows) {
            self.coefficients_of(points)?;
            for chunk in &chunks {
                self.product_with(chunk, points.len(), true)?;
            }
            let read = |buffer| self.gpu.begin_read(buffer, points.len());
            readings.push_back((read(&self.least)?, read(&self.best)?));
            // The device goes on to these points while the host takes what was found of others, and prepares the next.
            if readings.len() > READINGS {
                readings.pop_front().map_or(Ok(()), |oldest| take(oldest, &self.gpu))?;
            }
        }
        readings.into_iter().try_for_each(|reading| take(reading, &self.gpu))?;
        Ok((least, best))
    }

    /// Overlaps in [0, 1], or depths, at every point in every orientation, `[orientation][point]`. Waits for the device.
    ///
    /// # Errors
    /// As [`Self::minimum`].
    pub fn sections(
        &mut self,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<Vec<f32>, EngineError> {
        let chunks = self.chunks(orientations)?;
        let mut sections = vec![0.0; points.len() * orientations.len()];
        for (block, part) in points.chunks(self.rows).enumerate() {
            self.coefficients_of(part)?;
            for chunk in &chunks {
                self.product_with(chunk, part.len(), false)?;
                let values = self.gpu.read::<f32>(&self.values, part.len() * chunk.columns)?;
                for (row, values) in values.chunks_exact(chunk.columns).enumerate() {
                    let point = block * self.rows + row;
                    for (column, value) in values[..chunk.sweep.directions as usize].iter().enumerate() {
                        let orientation = chunk.sweep.first_direction as usize + column;
                        sections[orientation * points.len() + point] = self.field.quantity.held(*value);
                    }
                }
            }
        }
        Ok(sections)
    }

    /// Uploads what orientations are multiplied with: `[column][axes]` and their means, a chunk behind the other.
    fn chunks(&self, orientations: &[Orientation]) -> Result<Vec<Chunk>, EngineError> {
        if orientations.is_empty() {
            return Err(EngineError::Shape("a factored field needs at least one orientation".to_owned()));
        }
        let heads = self.field.heads(orientations);
        let (axes, count) = (self.field.shape.axes, orientations.len());
        let layout = &self.network.layout;
        let inputs = layout.layers.last().map_or(0, |layer| layer.outputs);
        let mut weights = Vec::new();
        let mut places = Vec::new();
        for first in (0..count).step_by(self.chunk) {
            let directions = self.chunk.min(count - first);
            let columns = directions.next_multiple_of(layout.padding);
            let at = weights.len();
            weights.resize(at + columns * (inputs + 1), 0.0);
            let (rows, biases) = weights[at..].split_at_mut(columns * inputs);
            for (column, row) in rows.chunks_exact_mut(inputs).take(directions).enumerate() {
                for (axis, weight) in row[..axes].iter_mut().enumerate() {
                    *weight = heads.along()[axis * count + first + column] * self.field.scale;
                }
            }
            biases[..directions].copy_from_slice(&heads.constants()[first..first + directions]);
            places.push((at, first, directions, columns));
        }
        let mut plan = Plan::default();
        plan.add("orientations", weights.len());
        let buffer = plan.allocate(&self.gpu)?.remove(0);
        self.gpu.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(&weights));
        let chunk = |(at, first, directions, columns): (usize, usize, usize, usize)| {
            let layer = Layer {
                inputs: inputs as u32,
                outputs: columns as u32,
                weights: at as u32,
                biases: (at + columns * inputs) as u32,
                stride: columns as u32,
                ..Layer::default()
            };
            let layer = uniform(&self.gpu, "orientations", &layer)?;
            let sweep =
                Sweep { directions: directions as u32, first_direction: first as u32, ..Sweep::default() };
            let sweep_buffer = uniform(&self.gpu, "sweep", &sweep)?;
            let batch = &self.network.batch;
            Ok(Chunk {
                product: self
                    .product
                    .bind(&self.gpu, &[batch, &layer, &buffer, &self.coefficients, &self.values]),
                minimum: self
                    .minimum
                    .bind(&self.gpu, &[batch, &layer, &sweep_buffer, &self.values, &self.least, &self.best]),
                sweep,
                columns,
            })
        };
        places.into_iter().map(chunk).collect()
    }

    /// Submits the network at some points.
    fn coefficients_of(&mut self, points: &[DVec3]) -> Result<(), EngineError> {
        let Self { field, local, inputs_up, frames_up, .. } = self;
        let inputs = field.shape.symmetry.inputs();
        inputs_up.resize(points.len() * inputs, 0.0);
        let rows = inputs_up.par_chunks_exact_mut(inputs).zip(points).with_min_len(ROWS_OF_A_THREAD);
        if local.is_some() {
            frames_up.resize(points.len(), PlaceFrame::default());
            rows.zip(frames_up.par_iter_mut()).for_each(|((inputs, &point), frame)| {
                let (seen, in_frame) = field.seen(point);
                inputs.copy_from_slice(&seen);
                *frame = in_frame.into();
            });
        } else {
            rows.for_each(|(inputs, &point)| inputs.copy_from_slice(&field.input(point)));
        }
        let padded_rows = points.len().next_multiple_of(self.network.layout.padding);
        let batch = Batch { rows: points.len() as u32, padded_rows: padded_rows as u32, ..Batch::default() };
        self.gpu.queue().write_buffer(&self.samples, 0, bytemuck::cast_slice(inputs_up));
        self.gpu.queue().write_buffer(&self.network.batch, 0, bytemuck::bytes_of(&batch));
        if let Some(local) = local {
            self.gpu.queue().write_buffer(&local.frames, 0, bytemuck::cast_slice(frames_up));
        }
        let (forward, bound, local) = (&self.forward, &self.inputs, &self.local);
        let workgroups = self.gpu.limits().workgroups;
        self.submissions.pass(&self.gpu, |pass| {
            forward.record(pass, bound, padded_rows, workgroups);
            if let Some(local) = local {
                local.turn.linear(pass, points.len() * local.orders, workgroups);
            }
        })
    }

    /// Submits the product with a chunk of orientations, and its part of the minimum.
    fn product_with(&mut self, chunk: &Chunk, rows: usize, minimum: bool) -> Result<(), EngineError> {
        let padded_rows = rows.next_multiple_of(self.network.layout.padding);
        let workgroups = self.gpu.limits().workgroups;
        self.submissions.pass(&self.gpu, |pass| {
            chunk.product.product(pass, padded_rows, chunk.columns, 1);
            if minimum {
                chunk.minimum.linear(pass, rows, workgroups);
            }
        })
    }
}

impl LocalFrames {
    /// Of rows of `columns` coefficients.
    fn new(
        gpu: &Gpu,
        degree: usize,
        columns: usize,
        batch: &wgpu::Buffer,
        frames: wgpu::Buffer,
        coefficients: &wgpu::Buffer,
    ) -> Result<Self, EngineError> {
        let harmonics = Harmonics { degree: degree as u32, stride: columns as u32 };
        let harmonics = uniform(gpu, "harmonics", &harmonics)?;
        let turn =
            Kernel::new(gpu, Shader::LocalFrames)?.bind(gpu, &[batch, &harmonics, &frames, coefficients]);
        Ok(Self { frames, turn, orders: degree + 1 })
    }
}
