//! Poses through a harmonic field: coefficients between the eight voxels around a point, then `field/turns.rs`.
//!
//! ```text
//! poses → coefficients → values, ∂/∂d → slopes by the coefficients → ∂/∂x
//! ```
//!
//! All coefficients lie on the device in f32.

use imf_core::field::EngineError;
use imf_fields::factored::Symmetry;
use imf_fields::harmonic::HarmonicField;

use super::grid::upload;
use super::passes::Slot::{Gradients, Poses, Values};
use super::passes::{CallKernel, Frame, Passes, ROWS, own};
use super::turns::{Coefficients, Functions, Turns};
use crate::kernel::{Extent, uniform};
use crate::memory::allocate;
use crate::over_orientations::{CoefficientRows, rows_within};
use crate::shader::Shader;
use crate::uniforms::{Batch, Lattice};

/// Coefficients that go up together: 4 MiB.
const PIECE: usize = 1 << 20;

/// The kernels of a harmonic field, with how the coefficients of the points of a pass lie, and where.
pub(super) fn passes(
    frame: &Frame,
    field: &HarmonicField,
) -> Result<(Passes, CoefficientRows, wgpu::Buffer), EngineError> {
    let Frame { gpu, world, sweep } = frame;
    let functions = Functions {
        basis: &field.basis,
        components: &field.components,
        mean: &field.mean,
        scale: 1.0,
        symmetry: Symmetry::default(),
        blunt: 0.0,
    };
    let padding = gpu.matrix_kernel().padding();
    let (kept, stride) = (field.component_count(), field.component_count().next_multiple_of(4));
    let components = kept.next_multiple_of(padding);
    let rows = rows_within(gpu, components.max(functions.columns(padding)), ROWS);
    let sizes = [
        ("coefficients of all voxels", field.grid.len() * stride),
        ("coefficients", rows * components),
        ("slopes", rows * components),
    ];
    let [voxels, coefficients, slopes] = allocate(gpu, sizes)?;
    let (count, piece) = (field.grid.len(), (PIECE / stride).max(1));
    let mut padded = Vec::new();
    for first in (0..count).step_by(piece) {
        let part = first..(first + piece).min(count);
        upload(gpu, field, part, stride, (&voxels, first * stride), &mut padded)?;
    }
    let [nx, ny, nz] = field.grid.dims.map(|n| n as u32);
    let (stride, columns, pitch) = (stride as u32, components as u32, field.grid.pitch as f32);
    let lattice = uniform(gpu, "lattice", &Lattice { nx, ny, nz, stride, columns, pitch })?;
    let batch = uniform(gpu, "batch", &Batch::default())?;
    let at = Coefficients { batch: &batch, rows, components, values: &coefficients, slopes: &slopes };
    let turns = Turns::new(frame, functions, &at)?;
    let front = [own(&batch), own(world), own(sweep), own(&lattice), Poses, own(&voxels)];
    let mixed = [&front[..], &[own(&coefficients)]].concat();
    let descended = [&front[..], &[own(&slopes), Values, Gradients]].concat();
    let passes = Passes {
        batch: batch.clone(),
        rows,
        points: CallKernel::new(gpu, Shader::VoxelCoefficients, Extent::Rows(components / 4), mixed)?,
        forward: vec![turns.weigh],
        values: turns.values,
        slopes: turns.slopes,
        backward: vec![turns.seed],
        gradients: CallKernel::new(gpu, Shader::VoxelDescent, Extent::Rows(1), descended)?,
    };
    Ok((passes, CoefficientRows { batch, rows, columns: components }, coefficients))
}
