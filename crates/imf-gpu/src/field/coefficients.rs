//! A factored field's network at points: their coefficients on the device, `[point][components]`, to be multiplied with orientations
//! (`over_orientations.rs`).
//!
//! Of a symmetry-reduced field the coefficients are those of the functions one by one, turned out of
//! the frames of their places before that product. Its twin is [`imf_fields::factored::FactoredEvaluator`].

use std::sync::Arc;

use glam::DVec3;
use imf_core::field::EngineError;
use imf_fields::factored::FactoredField;
use rayon::prelude::*;

use crate::device::Gpu;
use crate::forward::{LayerKernels, Network, layout_for, rows_per_pass};
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::allocate;
use crate::over_orientations::{CoefficientRows, ROWS, rows_within};
use crate::shader::Shader;
use crate::uniforms::{Harmonics, PlaceFrame};

/// Points that one thread of the host prepares at a time, at least.
pub(super) const ROWS_OF_A_THREAD: usize = 512;

/// The network, which puts the coefficients of points in their place.
pub(super) struct PointCoefficients {
    /// In the form that the network is evaluated in.
    pub(super) field: Arc<FactoredField>,
    pub(super) rows: CoefficientRows,
    gpu: Gpu,
    network: Network,
    pass: Vec<Dispatch>,
    samples: wgpu::Buffer,
    /// [`PlaceFrame`] of every row; idle without symmetry.
    frames: wgpu::Buffer,
    coefficients: wgpu::Buffer,
    /// What is uploaded for the points of a pass, reused from one to the next.
    inputs_up: Vec<f32>,
    frames_up: Vec<PlaceFrame>,
}

impl PointCoefficients {
    /// Compiles the kernels, allocates the buffers and uploads the weights.
    pub(super) fn new(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let symmetric = !field.shape.symmetry.is_none();
        let field = if symmetric { field.by_function() } else { field.unfolded().into_owned() };
        let stack = field.shape.stack();
        let layout = layout_for(gpu, stack)?;
        let components = layout.layers.last().map_or(0, |layer| layer.outputs);
        let rows = rows_per_pass(&layout, gpu.limits(), rows_within(gpu, components, ROWS));
        let columns = layout.layers.iter().map(|layer| layer.inputs).max().unwrap_or(1);
        let [parameters, samples, even, odd, coefficients, frames] = allocate(
            gpu,
            [
                ("parameters", layout.parameters),
                ("points", rows * stack.inputs),
                ("signal", rows * columns),
                ("signal", rows * columns),
                ("coefficients", rows * components),
                ("frames", if symmetric { rows * size_of::<PlaceFrame>() / 4 } else { 0 }),
            ],
        )?;
        let network = Network::new(gpu, layout, parameters, &field.parameters)?;
        let in_turns: Vec<wgpu::Buffer> =
            [&even, &odd].into_iter().cycle().take(network.layers.len()).cloned().collect();
        let layers = LayerKernels::new(gpu, Shader::HiddenEvaluate, false)?;
        let inputs = Kernel::new(gpu, Shader::Inputs)?;
        let inputs = (&inputs, &[&samples][..]);
        let mut pass = network.forward(gpu, &layers, inputs, &in_turns, &coefficients, &[])?;
        if symmetric {
            let degree = field.basis.degree();
            let harmonics = Harmonics { degree: degree as u32, stride: components as u32 };
            let harmonics = uniform(gpu, "harmonics", &harmonics)?;
            // For every pair ±m of functions of a row.
            let buffers = [&network.batch, &harmonics, &frames, &coefficients];
            pass.push(Kernel::new(gpu, Shader::LocalFrames)?.bind(Extent::Rows(degree + 1), &buffers));
        }
        Ok(Self {
            rows: CoefficientRows { batch: network.batch.clone(), rows, columns: components },
            gpu: gpu.clone(),
            field: Arc::new(field),
            network,
            pass,
            samples,
            frames,
            coefficients,
            inputs_up: Vec::new(),
            frames_up: Vec::new(),
        })
    }

    /// Submits the network at up to [`CoefficientRows::rows`] points, and returns the buffer of their coefficients.
    pub(super) fn of_points(&mut self, points: &[DVec3]) -> Result<wgpu::Buffer, EngineError> {
        let Self { gpu, field, inputs_up, frames_up, .. } = self;
        let inputs = field.shape.symmetry.inputs();
        inputs_up.resize(points.len() * inputs, 0.0);
        let rows = inputs_up.par_chunks_exact_mut(inputs).zip(points).with_min_len(ROWS_OF_A_THREAD);
        if field.shape.symmetry.is_none() {
            rows.for_each(|(inputs, &point)| inputs.copy_from_slice(&field.input(point)));
        } else {
            frames_up.resize(points.len(), PlaceFrame::default());
            rows.zip(frames_up.par_iter_mut()).for_each(|((inputs, &point), frame)| {
                let (seen, in_frame) = field.seen(point);
                inputs.copy_from_slice(&seen);
                *frame = in_frame.into();
            });
            gpu.write(&self.frames, frames_up);
        }
        gpu.write(&self.samples, inputs_up);
        let batch = gpu.batch_of(points.len());
        gpu.write(&self.network.batch, &[batch]);
        gpu.run(&self.pass, batch)?;
        Ok(self.coefficients.clone())
    }
}
