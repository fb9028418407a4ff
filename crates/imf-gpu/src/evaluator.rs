//! Evaluation on the GPU in parts that fit the adapter's limits, and the minimum over directions taken there.
//!
//! Two signals take turns from layer to layer, so memory does not grow with the number of layers, of samples or of
//! points × directions.

use imf_core::field::EngineError;
use imf_fields::siren::{EvaluationEngine, INPUTS, SirenShape, check_evaluate, check_minimum, features};

use crate::device::Gpu;
use crate::forward::{LayerKernels, Network, layout_for, rows_per_pass};
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::allocate;
use crate::shader::{DIRECTION_INPUTS, POINT_INPUTS, Shader};
use crate::uniforms::Sweep;

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
    /// From samples to values.
    of_samples: Vec<Dispatch>,
    /// From points × directions to the minimum.
    of_poses: Vec<Dispatch>,
    sweep: wgpu::Buffer,
    samples: wgpu::Buffer,
    points: wgpu::Buffer,
    directions: wgpu::Buffer,
    outputs: wgpu::Buffer,
    least: wgpu::Buffer,
    best: wgpu::Buffer,
    /// Everything that a part writes before it reads it.
    scratch: [wgpu::Buffer; 4],
}

impl GpuEvaluator {
    /// Compiles the kernels, allocates the buffers and uploads the weights (flat layout).
    ///
    /// # Errors
    /// [`EngineError::Shape`] if `parameters` do not fit `shape`; [`EngineError::Device`] for a network beyond the
    /// adapter's limits (with the estimate), too little memory, or a device that failed.
    pub fn new(gpu: &Gpu, shape: SirenShape, parameters: &[f32]) -> Result<Self, EngineError> {
        let layout = layout_for(gpu, shape.stack())?;
        shape.stack().check_parameters(parameters)?;
        let columns = layout.layers.iter().map(|layer| layer.inputs).max().unwrap_or(1);
        let part_rows =
            rows_per_pass(&layout, gpu.limits(), (SIGNAL_ELEMENTS / columns).clamp(1024, 1 << 16));
        let gathered = (GATHERED.min(gpu.limits().elements()) / part_rows).max(1) * part_rows;
        let outputs = layout.layers.last().map_or(0, |layer| layer.outputs);
        let [weights, samples, points, directions, even, odd, results, outputs, least, best] = allocate(
            gpu,
            [
                ("parameters", layout.parameters),
                ("samples", part_rows * INPUTS),
                ("points", part_rows * POINT_INPUTS as usize),
                ("directions", part_rows * DIRECTION_INPUTS as usize),
                ("signal", part_rows * columns),
                ("signal", part_rows * columns),
                ("results", part_rows * outputs),
                ("outputs", gathered),
                ("minima", part_rows),
                ("best directions", part_rows),
            ],
        )?;
        let network = Network::new(gpu, layout, weights, parameters)?;
        let in_turns: Vec<wgpu::Buffer> =
            [&even, &odd].into_iter().cycle().take(network.layers.len()).cloned().collect();
        let sweep = uniform(gpu, "sweep", &Sweep::default())?;
        let last = &network.layers[network.layers.len() - 1];
        let layers = LayerKernels::new(gpu, Shader::HiddenEvaluate, false)?;
        let values = Kernel::new(gpu, Shader::Outputs)?;
        let pass = |shader, sources: &[&wgpu::Buffer]| {
            let inputs = Kernel::new(gpu, shader)?;
            let mut pass = network.forward(gpu, &layers, (&inputs, sources), &in_turns, &results, &[])?;
            pass.push(values.bind(Extent::Rows(1), &[&network.batch, last, &sweep, &results, &outputs]));
            Ok::<_, EngineError>(pass)
        };
        let of_samples = pass(Shader::Inputs, &[&samples])?;
        let mut of_poses = pass(Shader::Poses, &[&sweep, &points, &directions])?;
        let minimum = Kernel::new(gpu, Shader::Minimum)?;
        of_poses.push(minimum.bind(Extent::Elements(part_rows), &[&sweep, &outputs, &least, &best]));
        Ok(Self {
            gpu: gpu.clone(),
            of_samples,
            of_poses,
            network,
            part_rows,
            gathered,
            sweep,
            samples,
            points,
            directions,
            scratch: [even, odd, results, outputs.clone()],
            outputs,
            least,
            best,
        })
    }

    /// Fills all scratch memory with `value`, on which no result may depend: for tests.
    pub fn fill_scratch(&mut self, value: f32) {
        self.scratch.iter().for_each(|buffer| self.gpu.fill(buffer, value));
    }

    /// Submits one part: its inputs are already written; its values go to `outputs` from `sweep.base`.
    fn part(&self, pass: &[Dispatch], rows: usize, sweep: Sweep) -> Result<(), EngineError> {
        let batch = self.gpu.batch_of(rows);
        self.gpu.write(&self.network.batch, &[batch]);
        self.gpu.write(&self.sweep, &[sweep]);
        self.gpu.run(pass, batch)
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
        check_evaluate(inputs, outputs)?;
        self.gpu.check()?;
        for (inputs, outputs) in inputs.chunks(INPUTS * self.gathered).zip(outputs.chunks_mut(self.gathered))
        {
            let mut base = 0;
            for part in inputs.chunks(INPUTS * self.part_rows) {
                let rows = part.len() / INPUTS;
                self.gpu.write(&self.samples, part);
                self.part(&self.of_samples, rows, Sweep { base: base as u32, ..Sweep::default() })?;
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
        check_minimum(points, directions, least, best)?;
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
            self.gpu.write(&self.points, &block);
            let at_once = self.part_rows / points.len();
            for (index, part) in directions.chunks(at_once).enumerate() {
                let block: Vec<[f32; 2]> = part.iter().map(of_direction).collect();
                self.gpu.write(&self.directions, &block);
                let sweep = Sweep {
                    base: 0,
                    points: points.len() as u32,
                    directions: part.len() as u32,
                    first_direction: (index * at_once) as u32,
                };
                self.part(&self.of_poses, points.len() * part.len(), sweep)?;
            }
            least.copy_from_slice(&self.gpu.read::<f32>(&self.least, points.len())?);
            best.copy_from_slice(&self.gpu.read::<u32>(&self.best, points.len())?);
        }
        Ok(())
    }
}
