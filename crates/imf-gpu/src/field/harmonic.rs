//! Poses through a harmonic field: coefficients between the eight voxels around a point, then `field/turns.rs`.
//!
//! ```text
//! poses → coefficients → values, ∂/∂d → slopes by the coefficients → ∂/∂x
//! ```
//!
//! All coefficients lie on the device in f32. Minima over orientations are products of the points' with these.

use glam::{DQuat, DVec3};
use imf_core::field::EngineError;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::section::Imf;
use imf_fields::factored::Symmetry;
use imf_fields::harmonic::basis::Basis;
use imf_fields::harmonic::{DirectionWeights, HarmonicField};

use super::grid::upload;
use super::host::HostBuffers;
use super::network::{Extent, Frame, Passes, ROWS};
use super::turns::{Coefficients, Functions, Turns};
use super::work::Call;
use crate::device::Gpu;
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::over_orientations::{CoefficientRows, OverOrientations, Scaled, rows_within};
use crate::shader::Shader;
use crate::uniforms::{Batch, Lattice, Sweep};

/// Coefficients that go up together: 4 MiB.
const PIECE: usize = 1 << 20;

/// A harmonic field.
pub(super) struct HarmonicPasses {
    padding: usize,
    mixing: Mixing,
    turns: Turns,
    descend: Kernel,
    /// The values' slopes by the coefficients, as many.
    slopes: wgpu::Buffer,
    over: OverOrientations,
    basis: Basis,
    axes: Vec<f32>,
    mean: Vec<f32>,
}

/// What puts the coefficients of the points of poses in their place.
struct Mixing {
    kernel: Kernel,
    lattice: wgpu::Buffer,
    /// `[voxel][stride]`
    voxels: wgpu::Buffer,
    rows: CoefficientRows,
    coefficients: wgpu::Buffer,
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
        let padding = gpu.matrix_kernel().padding();
        let (kept, stride) = (field.axis_count(), field.axis_count().next_multiple_of(4));
        let axes = kept.next_multiple_of(padding);
        let rows = rows_within(gpu, axes.max(functions.columns(padding)), ROWS);
        let mut plan = Plan::default();
        let places = [
            plan.add("coefficients of all voxels", field.grid.len() * stride),
            plan.add("coefficients", rows * axes),
            plan.add("slopes", rows * axes),
        ];
        let buffers = plan.allocate(gpu)?;
        let [voxels, coefficients, slopes] = places.map(|place| buffers[place].clone());
        let (count, piece) = (field.grid.len(), (PIECE / stride).max(1));
        let mut padded = Vec::new();
        for first in (0..count).step_by(piece) {
            let part = first..(first + piece).min(count);
            upload(gpu, field, part, stride, (&voxels, first * stride), &mut padded)?;
        }
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
        let turns = Turns::new(gpu, functions, &at)?;
        let rows = CoefficientRows { batch, rows, columns: axes };
        Ok(Self {
            turns,
            over: OverOrientations::new(gpu, rows.clone())?,
            descend: Kernel::new(gpu, Shader::VoxelDescent)?,
            mixing: Mixing {
                kernel: Kernel::new(gpu, Shader::VoxelCoefficients)?,
                lattice: uniform(gpu, "lattice", &lattice)?,
                voxels,
                rows,
                coefficients,
            },
            padding,
            slopes,
            basis: field.basis.clone(),
            axes: field.axes.clone(),
            mean: field.mean.clone(),
        })
    }

    /// The least value over orientations at points of the box, not clipped.
    pub(super) fn minimum(
        &mut self,
        frame: &Frame,
        host: &mut HostBuffers,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<Imf, EngineError> {
        let gpu = &frame.gpu;
        gpu.queue().write_buffer(&frame.sweep, 0, bytemuck::bytes_of(&Sweep::default()));
        let Self { mixing, over, basis, axes, mean, .. } = self;
        let heads = |some: &[Orientation]| Scaled {
            heads: DirectionWeights::new(basis, axes, mean, some),
            scale: 1.0,
        };
        over.minimum(points.len(), orientations, heads, |part, _, submissions| {
            let poses: Vec<Pose> =
                points[part].iter().map(|point| Pose::new(*point, DQuat::IDENTITY)).collect();
            let uploaded = host.upload(gpu, &poses, false)?;
            let mix = mixing.bind(frame, uploaded.call().poses);
            mixing.rows.hold(gpu, poses.len());
            let limit = gpu.limits().workgroups;
            submissions.pass(gpu, |pass| mixing.record(&mix, pass, poses.len(), limit))?;
            Ok(mixing.coefficients.clone())
        })
    }
}

impl Mixing {
    /// What the kernels that read voxels read first, up to these.
    fn front<'a>(&'a self, frame: &'a Frame, poses: &'a wgpu::Buffer) -> [&'a wgpu::Buffer; 6] {
        [&self.rows.batch, &frame.world, &frame.sweep, &self.lattice, poses, &self.voxels]
    }

    fn bind(&self, frame: &Frame, poses: &wgpu::Buffer) -> Bound {
        let front = self.front(frame, poses);
        self.kernel.bind(&frame.gpu, &[&front[..], &[&self.coefficients]].concat())
    }

    fn record(&self, bound: &Bound, pass: &mut wgpu::ComputePass<'_>, rows: usize, limit: u32) {
        bound.linear(pass, rows * self.rows.columns / 4, limit);
    }
}

impl Passes for HarmonicPasses {
    type Call = HarmonicCall;

    fn extent(&self) -> Extent<'_> {
        let CoefficientRows { batch, rows, .. } = &self.mixing.rows;
        Extent { batch, rows: *rows, padding: self.padding }
    }

    fn bind(&self, frame: &Frame, call: Call<'_>) -> Self::Call {
        let Call { poses, values, gradients } = call;
        let front = self.mixing.front(frame, poses);
        HarmonicCall {
            mix: self.mixing.bind(frame, poses),
            values: self.turns.bind(frame, call),
            descend: gradients.map(|gradients| {
                self.descend.bind(&frame.gpu, &[&front[..], &[&self.slopes, values, gradients]].concat())
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
        self.mixing.record(&call.mix, pass, rows, limit);
        self.turns.record(&call.values, pass, rows, padded_rows, limit);
        if let Some(descend) = &call.descend {
            self.turns.record_slopes(pass, padded_rows);
            descend.linear(pass, rows, limit);
        }
    }
}
