//! Poses through a harmonic field: coefficients between the eight voxels around a point, then `planner/turns.rs`.
//!
//! ```text
//! poses → coefficients → values, ∂/∂d → slopes by the coefficients → ∂/∂x
//! ```
//!
//! All coefficients lie on the device in f32.

use imf_core::factored::Symmetry;
use imf_core::harmonic::HarmonicField;
use imf_core::training::EngineError;

use super::Asked;
use super::network::{Extent, Frame, Passes, ROWS};
use super::turns::{Coefficients, Functions, Turns};
use crate::device::Gpu;
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::shader::{Shader, TILE};
use crate::uniforms::{Batch, Lattice};

/// Coefficients that go up together: 4 MiB.
const PIECE: usize = 1 << 20;

/// A harmonic field of a tool of revolution.
pub(super) struct HarmonicPasses {
    /// The [`Batch`] at hand.
    batch: wgpu::Buffer,
    /// Poses of one pass, at most.
    rows: usize,
    padding: usize,
    turns: Turns,
    mix: Kernel,
    descend: Kernel,
    lattice: wgpu::Buffer,
    /// `[voxel][stride]`
    voxels: wgpu::Buffer,
    /// `[rows][axes]`: coefficients, and the values' slopes by them.
    coefficients: wgpu::Buffer,
    slopes: wgpu::Buffer,
    axes: usize,
}

/// The kernels bound to the buffers of a call.
pub(super) struct HarmonicCall {
    mix: Bound,
    values: Bound,
    descend: Option<Bound>,
}

impl HarmonicPasses {
    pub(super) fn new(gpu: &Gpu, field: &HarmonicField) -> Result<Self, EngineError> {
        let functions = Functions {
            basis: &field.basis,
            axes: &field.axes,
            mean: &field.mean,
            scale: 1.0,
            symmetry: Symmetry::default(),
            blunt: 0.0,
        };
        functions.check()?;
        let padding = gpu.matrix_kernel().padding();
        let (kept, stride) = (field.axis_count(), field.axis_count().next_multiple_of(4));
        let axes = kept.next_multiple_of(padding);
        let limits = gpu.limits();
        let binding = limits.storage_binding.min(limits.buffer) as usize / 4;
        let rows = ROWS.min(binding / axes.max(functions.columns(padding)));
        let rows = rows.min(limits.workgroups as usize * TILE as usize) / padding * padding;
        let rows = rows.max(padding);
        let mut plan = Plan::default();
        let places = [
            plan.add("coefficients of all voxels", field.grid.len() * stride),
            plan.add("coefficients", rows * axes),
            plan.add("slopes", rows * axes),
        ];
        let buffers = plan.allocate(gpu)?;
        let [voxels, coefficients, slopes] = places.map(|place| buffers[place].clone());
        upload(gpu, field, &voxels, kept, stride)?;
        let dims = field.grid.dims.map(|n| n as u32);
        let lattice = Lattice {
            nx: dims[0],
            ny: dims[1],
            nz: dims[2],
            stride: stride as u32,
            columns: axes as u32,
            pitch: field.grid.pitch as f32,
        };
        let batch = uniform(gpu, "batch", &Batch::default())?;
        let at = Coefficients { batch: &batch, rows, axes, values: &coefficients, slopes: &slopes };
        Ok(Self {
            turns: Turns::new(gpu, functions, &at)?,
            mix: Kernel::new(gpu, Shader::VoxelCoefficients)?,
            descend: Kernel::new(gpu, Shader::VoxelDescent)?,
            lattice: uniform(gpu, "lattice", &lattice)?,
            batch,
            rows,
            padding,
            voxels,
            coefficients,
            slopes,
            axes,
        })
    }
}

impl Passes for HarmonicPasses {
    type Call = HarmonicCall;

    fn extent(&self) -> Extent<'_> {
        Extent { batch: &self.batch, rows: self.rows, padding: self.padding }
    }

    fn bind(&self, frame: &Frame, asked: Asked<'_>) -> Self::Call {
        let Frame { gpu, world, sweep } = frame;
        let Asked { poses, values, gradients } = asked;
        let front = [&self.batch, world, sweep, &self.lattice, poses, &self.voxels];
        HarmonicCall {
            mix: self.mix.bind(gpu, &[&front[..], &[&self.coefficients]].concat()),
            values: self.turns.bind(frame, asked),
            descend: gradients.map(|gradients| {
                self.descend.bind(gpu, &[&front[..], &[&self.slopes, values, gradients]].concat())
            }),
        }
    }

    fn record(
        &self,
        call: &Self::Call,
        pass: &mut wgpu::ComputePass<'_>,
        rows: usize,
        padded_rows: usize,
        limit: u32,
    ) {
        call.mix.linear(pass, rows * self.axes / 4, limit);
        self.turns.record(&call.values, pass, rows, padded_rows, limit);
        if let Some(descend) = &call.descend {
            self.turns.record_slopes(pass, padded_rows);
            descend.linear(pass, rows, limit);
        }
    }
}

/// The coefficients of all voxels, `kept` of each in rows of `stride`, some voxels at a time.
fn upload(
    gpu: &Gpu,
    field: &HarmonicField,
    buffer: &wgpu::Buffer,
    kept: usize,
    stride: usize,
) -> Result<(), EngineError> {
    let piece = (PIECE / stride).max(1);
    let (mut scratch, mut padded) = (Vec::new(), Vec::new());
    for first in (0..field.grid.len()).step_by(piece) {
        let end = (first + piece).min(field.grid.len());
        let values = field.coefficients.read(first * kept, end * kept, &mut scratch);
        padded.clear();
        padded.resize((end - first) * stride, 0.0);
        for (row, values) in padded.chunks_exact_mut(stride).zip(values.chunks_exact(kept)) {
            row[..kept].copy_from_slice(values);
        }
        gpu.queue().write_buffer(buffer, 4 * (first * stride) as u64, bytemuck::cast_slice(&padded));
        // The interface's own copy goes before the next one is made.
        gpu.queue().submit(std::iter::empty());
        gpu.wait(None)?;
    }
    Ok(())
}
