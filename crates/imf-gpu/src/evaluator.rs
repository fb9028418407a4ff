//! Evaluation on the GPU in parts that fit the adapter's limits, and the minimum over directions taken there.
//!
//! Two signals take turns from layer to layer, so memory does not grow with the number of layers, of samples or of
//! points × directions.

use imf_core::field::EngineError;
use imf_fields::siren::EvaluationEngine;
use imf_fields::siren::{INPUTS, SirenShape, features};

use crate::device::{Gpu, GpuLimits};
use crate::forward::{Forward, Network, layout_for, rows_per_pass};
use crate::kernel::{Bound, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::memory::Plan;
use crate::shader::{DIRECTION_INPUTS, Factors, POINT_INPUTS, Shader};
use crate::submit::Submissions;
use crate::uniforms::{Batch, Sweep};

/// Elements of one signal: 16 MiB, 8192 rows of the paper's 512 neurons.
const SIGNAL_ELEMENTS: usize = 1 << 22;
/// Values that gather on the device before the host reads them.
const GATHERED: usize = 1 << 20;

/// An evaluation engine on one GPU.
#[derive(Debug)]
pub struct GpuEvaluator {
    gpu: Gpu,
    network: Network,
    /// Rows that one pass holds.
    part_rows: usize,
    /// Values that `outputs` holds.
    gathered: usize,
    from_samples: Vec<Option<Bound>>,
    from_poses: Vec<Option<Bound>>,
    forward: Forward,
    values: Bound,
    minimum: Bound,
    sweep: wgpu::Buffer,
    samples: wgpu::Buffer,
    points: wgpu::Buffer,
    directions: wgpu::Buffer,
    outputs: wgpu::Buffer,
    least: wgpu::Buffer,
    best: wgpu::Buffer,
    /// Everything that a part writes before it reads it.
    scratch: Vec<wgpu::Buffer>,
    submissions: Submissions,
}

/// Places of an evaluator's buffers in its plan.
struct Places {
    parameters: usize,
    samples: usize,
    points: usize,
    directions: usize,
    signals: [usize; 2],
    results: usize,
    outputs: usize,
    least: usize,
    best: usize,
}

/// What an evaluator allocates, rows of one pass, and values gathered before they are read.
fn plan(layout: &PaddedLayout, limits: GpuLimits) -> (Plan, Places, usize, usize) {
    let columns = layout.layers.iter().map(|layer| layer.inputs).max().unwrap_or(1);
    let rows = rows_per_pass(layout, limits, (SIGNAL_ELEMENTS / columns).clamp(1024, 1 << 16));
    let binding = limits.elements();
    let gathered = (GATHERED.min(binding) / rows).max(1) * rows;
    let mut plan = Plan::default();
    let places = Places {
        parameters: plan.add("parameters", layout.parameters),
        samples: plan.add("samples", rows * INPUTS),
        points: plan.add("points", rows * POINT_INPUTS as usize),
        directions: plan.add("directions", rows * DIRECTION_INPUTS as usize),
        signals: [0, 1].map(|_| plan.add("signal", rows * columns)),
        results: plan.add("results", rows * layout.layers.last().map_or(0, |layer| layer.outputs)),
        outputs: plan.add("outputs", gathered),
        least: plan.add("least values", rows),
        best: plan.add("best directions", rows),
    };
    (plan, places, rows, gathered)
}

impl GpuEvaluator {
    /// Compiles the kernels, allocates the buffers and uploads the weights (flat layout).
    ///
    /// # Errors
    /// [`EngineError::Shape`] if `parameters` do not fit `shape`; [`EngineError::Device`] for a network beyond the
    /// adapter's limits (with the estimate), too little memory, or a device that failed.
    pub fn new(gpu: &Gpu, shape: SirenShape, parameters: &[f32]) -> Result<Self, EngineError> {
        let layout = layout_for(gpu, shape.stack())?;
        shape.check_parameters(parameters).map_err(|error| EngineError::Shape(error.to_string()))?;
        let (plan, places, part_rows, gathered) = plan(&layout, gpu.limits());
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let network = Network::new(gpu, layout, at(places.parameters), parameters)?;
        let turns: Vec<wgpu::Buffer> =
            (0..network.layers.len()).map(|layer| at(places.signals[layer % 2])).collect();
        let (results, outputs) = (at(places.results), at(places.outputs));
        let (samples, points, directions) = (at(places.samples), at(places.points), at(places.directions));
        let (least, best) = (at(places.least), at(places.best));
        let sweep = uniform(gpu, "sweep", &Sweep::default())?;
        let last = &network.layers[network.layers.len() - 1];
        let kernel = |shader| Kernel::new(gpu, shader);
        Ok(Self {
            from_samples: network.bind_inputs(gpu, &kernel(Shader::Inputs)?, &[&samples], &turns)?,
            from_poses: network.bind_inputs(
                gpu,
                &kernel(Shader::Poses)?,
                &[&sweep, &points, &directions],
                &turns,
            )?,
            forward: Forward::new(gpu, &network, &turns, &results, None, Factors::Single)?,
            values: kernel(Shader::Outputs)?.bind(gpu, &[&network.batch, last, &sweep, &results, &outputs]),
            minimum: kernel(Shader::Minimum)?.bind(gpu, &[&sweep, &outputs, &least, &best]),
            scratch: [places.signals[0], places.signals[1], places.results, places.outputs].map(at).to_vec(),
            gpu: gpu.clone(),
            network,
            part_rows,
            gathered,
            sweep,
            samples,
            points,
            directions,
            outputs,
            least,
            best,
            submissions: Submissions::default(),
        })
    }

    /// Bytes of device memory that an evaluator needs, read-back and uniforms left out.
    ///
    /// # Errors
    /// As [`GpuEvaluator::new`], without allocating anything.
    pub fn memory_bytes(gpu: &Gpu, shape: SirenShape) -> Result<u64, EngineError> {
        let plan = plan(&layout_for(gpu, shape.stack())?, gpu.limits()).0;
        plan.check(gpu.limits())?;
        Ok(plan.bytes())
    }

    /// Fills all scratch memory with `value`, on which no result may depend: for tests.
    pub fn fill_scratch(&mut self, value: f32) {
        for buffer in &self.scratch {
            let values = vec![value; buffer.size() as usize / 4];
            self.gpu.queue().write_buffer(buffer, 0, bytemuck::cast_slice(&values));
        }
    }

    /// Submits one part: its inputs are already written; its values go to `outputs` from `sweep.base`.
    fn part(&mut self, rows: usize, sweep: Sweep, minimum: bool) -> Result<(), EngineError> {
        let padded_rows = rows.next_multiple_of(self.network.layout.padding);
        let batch = Batch { rows: rows as u32, padded_rows: padded_rows as u32, ..Batch::default() };
        self.gpu.queue().write_buffer(&self.network.batch, 0, bytemuck::bytes_of(&batch));
        self.gpu.queue().write_buffer(&self.sweep, 0, bytemuck::bytes_of(&sweep));
        let workgroups = self.gpu.limits().workgroups;
        let inputs = if minimum { &self.from_poses } else { &self.from_samples };
        self.submissions.pass(&self.gpu, |pass| {
            self.forward.record(pass, inputs, padded_rows, workgroups);
            self.values.linear(pass, rows, workgroups);
            if minimum {
                self.minimum.linear(pass, sweep.points as usize, workgroups);
            }
        })
    }
}

impl EvaluationEngine for GpuEvaluator {
    fn describe(&self) -> String {
        self.gpu.describe()
    }

    fn values_at_once(&self) -> usize {
        if self.gpu.adapter().is_software() { 1 << 18 } else { 1 << 24 }
    }

    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError> {
        if inputs.len() != INPUTS * outputs.len() {
            return Err(EngineError::Shape(format!(
                "{} outputs need {} inputs, but {} were given",
                outputs.len(),
                INPUTS * outputs.len(),
                inputs.len()
            )));
        }
        self.gpu.check()?;
        for (inputs, outputs) in inputs.chunks(INPUTS * self.gathered).zip(outputs.chunks_mut(self.gathered))
        {
            let mut base = 0;
            for part in inputs.chunks(INPUTS * self.part_rows) {
                let rows = part.len() / INPUTS;
                self.gpu.queue().write_buffer(&self.samples, 0, bytemuck::cast_slice(part));
                self.part(rows, Sweep { base: base as u32, ..Sweep::default() }, false)?;
                base += rows;
            }
            outputs.copy_from_slice(&self.gpu.read::<f32>(&self.outputs, base)?);
        }
        Ok(())
    }

    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError> {
        if least.len() != points.len() || best.len() != points.len() {
            return Err(EngineError::Shape(format!(
                "{} points need as many least values and best directions, not {} and {}",
                points.len(),
                least.len(),
                best.len()
            )));
        }
        if directions.is_empty() {
            return Err(EngineError::Shape("a minimum needs at least one direction".to_owned()));
        }
        self.gpu.check()?;
        // Features are made here, as for single samples, so that both give the same bits.
        let of_direction = |&[theta, phi]: &[f32; 2]| {
            let all = features([0.0; 3], theta, phi);
            [all[3], all[4]]
        };
        let of_point = |&point: &[f32; 3]| {
            let all = features(point, 0.0, 0.0);
            [all[0], all[1], all[2]]
        };
        let blocks = least.chunks_mut(self.part_rows).zip(best.chunks_mut(self.part_rows));
        for (points, (least, best)) in points.chunks(self.part_rows).zip(blocks) {
            let block: Vec<[f32; 3]> = points.iter().map(of_point).collect();
            self.gpu.queue().write_buffer(&self.points, 0, bytemuck::cast_slice(&block));
            let at_once = self.part_rows / points.len();
            for (index, part) in directions.chunks(at_once).enumerate() {
                let block: Vec<[f32; 2]> = part.iter().map(of_direction).collect();
                self.gpu.queue().write_buffer(&self.directions, 0, bytemuck::cast_slice(&block));
                let sweep = Sweep {
                    base: 0,
                    points: points.len() as u32,
                    directions: part.len() as u32,
                    first_direction: (index * at_once) as u32,
                };
                self.part(points.len() * part.len(), sweep, true)?;
            }
            least.copy_from_slice(&self.gpu.read::<f32>(&self.least, points.len())?);
            best.copy_from_slice(&self.gpu.read::<u32>(&self.best, points.len())?);
        }
        Ok(())
    }
}
