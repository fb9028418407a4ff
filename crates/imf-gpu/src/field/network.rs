//! A network that poses pass through, forward to its results and back to its first layer, whatever family it is of; and what all
//! passes read beside it.

use glam::DVec3;
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_fields::siren::stack::Stack;

use super::work::Call;
use crate::device::Gpu;
use crate::forward::{Forward, Network, layout_for, rows_per_pass};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::shader::{Factors, Shader};
use crate::uniforms::{Descent, Sweep, World};

/// Poses that pass through a field together, at most.
pub(super) const ROWS: usize = 1 << 13;

/// Device, box of the field, and where the part at hand begins.
pub(super) struct Frame {
    pub(super) gpu: Gpu,
    /// [`World`]
    pub(super) world: wgpu::Buffer,
    /// [`Sweep`], of which only the base is used.
    pub(super) sweep: wgpu::Buffer,
}

impl Frame {
    pub(super) fn new(gpu: &Gpu, grid: &Grid) -> Result<Self, EngineError> {
        let four = |v: DVec3| v.as_vec3().extend(0.0).to_array();
        let world = World {
            low: four(grid.centre([0; 3])),
            high: four(grid.centre(grid.dims.map(|n| n - 1))),
            origin: four(grid.origin),
            size: four(grid.size()),
        };
        Ok(Self {
            gpu: gpu.clone(),
            world: uniform(gpu, "world", &world)?,
            sweep: uniform(gpu, "sweep", &Sweep::default())?,
        })
    }
}

/// How many poses pass together.
#[derive(Clone, Copy)]
pub(super) struct Extent<'a> {
    /// The [`crate::uniforms::Batch`] at hand.
    pub(super) batch: &'a wgpu::Buffer,
    /// At most so many.
    pub(super) rows: usize,
    /// Rounded up to this.
    pub(super) padding: usize,
}

/// The kernels of a family, which answer the poses of a buffer in parts.
pub(super) trait Passes {
    /// The kernels bound to the buffers of a call.
    type Call;

    /// How many poses pass together.
    fn extent(&self) -> Extent<'_>;

    /// Binds the kernels to what is asked.
    fn bind(&self, frame: &Frame, call: Call<'_>) -> Self::Call;

    /// Records a part of `rows` poses, `padded_rows` with padding; a dispatch may have `limit` workgroups.
    fn record(
        &self,
        call: &Self::Call,
        pass: &mut wgpu::ComputePass<'_>,
        rows: usize,
        padded_rows: usize,
        limit: u32,
    );
}

/// A network with room for the poses of one pass.
pub(super) struct TwoWay {
    pub(super) network: Network,
    /// Poses of one pass, at most.
    pub(super) rows: usize,
    /// The network's inputs `[rows][inputs]`.
    pub(super) samples: wgpu::Buffer,
    /// Its results `[rows][outputs]`, padding among them.
    pub(super) results: wgpu::Buffer,
    /// Every layer's Δ on the way back; the last one's is where it begins.
    pub(super) deltas: Vec<wgpu::Buffer>,
    inputs: Vec<Option<Bound>>,
    forward: Forward,
    backward: Vec<Bound>,
}

impl TwoWay {
    /// Allocates and uploads; passes leave room for rows of `columns` values beside the network's own.
    pub(super) fn new(
        gpu: &Gpu,
        stack: Stack,
        parameters: &[f32],
        columns: usize,
    ) -> Result<Self, EngineError> {
        let layout = layout_for(gpu, stack)?;
        stack.check_parameters(parameters).map_err(|error| EngineError::Shape(error.to_string()))?;
        let binding = gpu.limits().elements();
        let rows = rows_per_pass(&layout, gpu.limits(), ROWS.min(binding / columns.max(1)));
        let mut plan = Plan::default();
        let weights = plan.add("parameters", layout.parameters);
        let samples = plan.add("samples", rows * stack.inputs);
        let results = plan.add("results", rows * layout.layers.last().map_or(0, |layer| layer.outputs));
        let signals: Vec<usize> =
            layout.layers.iter().map(|layer| plan.add("signal", rows * layer.inputs)).collect();
        let deltas: Vec<usize> =
            layout.layers.iter().map(|layer| plan.add("delta", rows * layer.outputs)).collect();
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let all = |places: &[usize]| places.iter().map(|&place| at(place)).collect::<Vec<_>>();
        let (samples, results, signals, deltas) = (at(samples), at(results), all(&signals), all(&deltas));
        let network = Network::new(gpu, layout, at(weights), parameters)?;
        let backward = Kernel::new(gpu, Shader::Backward)?;
        let backward = (1..network.layers.len())
            .map(|l| {
                let buffers =
                    [&network.batch, &network.layers[l], &network.parameters, &deltas[l], &deltas[l - 1]];
                backward.bind(gpu, &buffers)
            })
            .collect();
        Ok(Self {
            inputs: network.bind_inputs(gpu, &Kernel::new(gpu, Shader::Inputs)?, &[&samples], &signals)?,
            forward: Forward::new(gpu, &network, &signals, &results, Some(&deltas), Factors::Single)?,
            backward,
            network,
            rows,
            samples,
            results,
            deltas,
        })
    }

    pub(super) fn extent(&self) -> Extent<'_> {
        Extent { batch: &self.network.batch, rows: self.rows, padding: self.network.layout.padding }
    }

    /// The weights that the network's inputs meet, and the layer behind the skip, if there is one.
    pub(super) fn descent(&self) -> (Descent, Option<usize>) {
        let layers = &self.network.layout.layers;
        let skipped = (1..layers.len()).find(|&layer| layers[layer].input_block.is_some());
        let behind = skipped.map(|layer| (layers[layer], layers[layer].input_block.unwrap_or(0)));
        let descent = Descent {
            first_weights: layers[0].weights as u32,
            first_stride: layers[0].inputs as u32,
            neurons: layers[0].outputs as u32,
            skip_weights: behind.map_or(0, |(layer, block)| layer.weights + block) as u32,
            skip_stride: behind.map_or(0, |(layer, _)| layer.inputs) as u32,
            skip_neurons: behind.map_or(0, |(layer, _)| layer.outputs) as u32,
        };
        (descent, skipped)
    }

    /// From samples to results; keeps what the way back needs.
    pub(super) fn record_forward(&self, pass: &mut wgpu::ComputePass<'_>, padded_rows: usize, limit: u32) {
        self.forward.record(pass, &self.inputs, padded_rows, limit);
    }

    /// From the last layer's Δ to the first one's.
    pub(super) fn record_backward(&self, pass: &mut wgpu::ComputePass<'_>, padded_rows: usize) {
        for (below, backward) in self.backward.iter().enumerate().rev() {
            backward.product(pass, padded_rows, self.network.layout.layers[below].outputs, 1);
        }
    }
}
