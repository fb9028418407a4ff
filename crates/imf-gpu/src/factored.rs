//! A factored field on the GPU: its network once at every point, then one product with all orientations, whose minimum is
//! taken on the device (`over_orientations.rs`). The field over points × orientations is never stored.
//!
//! ```text
//! points → inputs → hidden layers → coefficients [points][axes] → over orientations
//! ```
//!
//! Where the field is told of a symmetry, the coefficients are those of the functions one by one, turned out of
//! the frames of their places before that product. Its twin is [`imf_fields::factored::FactoredEvaluator`].

use glam::DVec3;
use imf_core::field::EngineError;
use imf_core::orientation::Orientation;
use imf_core::section::Imf;
use imf_fields::factored::FactoredField;
use rayon::prelude::*;

use crate::device::Gpu;
use crate::forward::{Forward, Network, layout_for, rows_per_pass};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::over_orientations::{CoefficientRows, OverOrientations, ROWS, Scaled, rows_within};
use crate::shader::{Factors, Shader};
use crate::submit::Submissions;
use crate::uniforms::{Harmonics, PlaceFrame};

/// Points that one thread of the host prepares at a time, at least.
pub(crate) const ROWS_OF_A_THREAD: usize = 512;

/// A factored field on one GPU.
#[derive(Debug)]
pub struct GpuFactored {
    field: FactoredField,
    network: NetworkPoints,
    over: OverOrientations,
}

/// The network, which puts the coefficients of points in their place.
#[derive(Debug)]
struct NetworkPoints {
    gpu: Gpu,
    network: Network,
    inputs: Vec<Option<Bound>>,
    forward: Forward,
    samples: wgpu::Buffer,
    coefficients: wgpu::Buffer,
    rows: CoefficientRows,
    local: Option<LocalFrames>,
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

impl GpuFactored {
    /// Compiles the kernels, allocates the buffers and uploads the weights.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a network beyond the adapter's limits, too little memory, or a device that failed.
    pub fn new(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let symmetric = !field.shape.symmetry.is_none();
        let field = if symmetric { field.by_function() } else { field.unfolded().into_owned() };
        let network = NetworkPoints::new(gpu, &field)?;
        Ok(Self { over: OverOrientations::new(gpu, network.rows.clone())?, field, network })
    }

    /// The least value over the orientations at every point, an overlap in [0, 1], with the first orientation that has it before
    /// values are clipped, as [`imf_fields::factored::FactoredEvaluator::minimum`]. Waits for the device.
    ///
    /// # Errors
    /// No orientation, too many for the adapter's memory, or a device that failed.
    pub fn minimum(&mut self, points: &[DVec3], orientations: &[Orientation]) -> Result<Imf, EngineError> {
        let mut found = self.minimum_unclipped(points, orientations)?;
        found.hold(self.field.quantity);
        Ok(found)
    }

    /// As [`Self::minimum`], of values that are not clipped.
    pub(crate) fn minimum_unclipped(
        &mut self,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<Imf, EngineError> {
        let Self { field, network, over } = self;
        over.minimum(
            points.len(),
            orientations,
            |some| Scaled::of(field, some),
            |part, _, submissions| network.coefficients_of(field, &points[part], submissions),
        )
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
        let Self { field, network, over } = self;
        let mut sections = vec![0.0; points.len() * orientations.len()];
        let out = (field.quantity, &mut sections[..]);
        over.sections(
            points.len(),
            orientations,
            |some| Scaled::of(field, some),
            out,
            |part, submissions| network.coefficients_of(field, &points[part], submissions),
        )?;
        Ok(sections)
    }

    /// Submits the network at up to [`CoefficientRows::rows`] points, and says where their coefficients come to lie.
    pub(crate) fn coefficients_of(
        &mut self,
        points: &[DVec3],
        submissions: &mut Submissions,
    ) -> Result<wgpu::Buffer, EngineError> {
        self.network.coefficients_of(&self.field, points, submissions)
    }

    /// The field as it is evaluated, and what its coefficients are multiplied by; the network is given up.
    pub(crate) fn into_parts(self) -> (FactoredField, OverOrientations) {
        (self.field, self.over)
    }

    pub(crate) fn rows(&self) -> &CoefficientRows {
        &self.network.rows
    }
}

impl NetworkPoints {
    fn new(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let symmetric = !field.shape.symmetry.is_none();
        let stack = field.shape.stack();
        let layout = layout_for(gpu, stack)?;
        let axes = layout.layers.last().map_or(0, |layer| layer.outputs);
        let rows = rows_per_pass(&layout, gpu.limits(), rows_within(gpu, axes, ROWS));
        let columns = layout.layers.iter().map(|layer| layer.inputs).max().unwrap_or(1);
        let mut plan = Plan::default();
        let parameters = plan.add("parameters", layout.parameters);
        let samples = plan.add("points", rows * stack.inputs);
        let signals = [0, 1].map(|_| plan.add("signal", rows * columns));
        let coefficients = plan.add("coefficients", rows * axes);
        let frames = symmetric.then(|| plan.add("frames", rows * size_of::<PlaceFrame>() / 4));
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let network = Network::new(gpu, layout, at(parameters), &field.parameters)?;
        let turns: Vec<wgpu::Buffer> =
            (0..network.layers.len()).map(|layer| at(signals[layer % 2])).collect();
        let samples = at(samples);
        let coefficients = at(coefficients);
        let lying = CoefficientRows { batch: network.batch.clone(), rows, columns: axes };
        let local = frames
            .map(|frames| LocalFrames::new(gpu, field.basis.degree(), &lying, &coefficients, at(frames)));
        Ok(Self {
            local: local.transpose()?,
            inputs: network.bind_inputs(gpu, &Kernel::new(gpu, Shader::Inputs)?, &[&samples], &turns)?,
            forward: Forward::new(gpu, &network, &turns, &coefficients, None, Factors::Single)?,
            gpu: gpu.clone(),
            network,
            samples,
            coefficients,
            rows: lying,
            inputs_up: Vec::new(),
            frames_up: Vec::new(),
        })
    }

    /// Submits the network at some points.
    fn coefficients_of(
        &mut self,
        field: &FactoredField,
        points: &[DVec3],
        submissions: &mut Submissions,
    ) -> Result<wgpu::Buffer, EngineError> {
        let Self { gpu, local, inputs_up, frames_up, .. } = self;
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
        self.rows.hold(gpu, points.len());
        gpu.queue().write_buffer(&self.samples, 0, bytemuck::cast_slice(inputs_up));
        if let Some(local) = local {
            gpu.queue().write_buffer(&local.frames, 0, bytemuck::cast_slice(frames_up));
        }
        let padded_rows = points.len().next_multiple_of(self.network.layout.padding);
        let (forward, bound) = (&self.forward, &self.inputs);
        let workgroups = gpu.limits().workgroups;
        submissions.pass(gpu, |pass| {
            forward.record(pass, bound, padded_rows, workgroups);
            if let Some(local) = local {
                local.turn.linear(pass, points.len() * local.orders, workgroups);
            }
        })?;
        Ok(self.coefficients.clone())
    }
}

impl LocalFrames {
    fn new(
        gpu: &Gpu,
        degree: usize,
        CoefficientRows { batch, columns, .. }: &CoefficientRows,
        coefficients: &wgpu::Buffer,
        frames: wgpu::Buffer,
    ) -> Result<Self, EngineError> {
        let harmonics = Harmonics { degree: degree as u32, stride: *columns as u32 };
        let harmonics = uniform(gpu, "harmonics", &harmonics)?;
        let turn =
            Kernel::new(gpu, Shader::LocalFrames)?.bind(gpu, &[batch, &harmonics, &frames, coefficients]);
        Ok(Self { frames, turn, orders: degree + 1 })
    }
}
