//! A harmonic or factored field over its whole grid on the GPU: the coefficients of all voxels stay there, and sections and minima
//! over any orientations are products with them. Coefficients are a harmonic field's own, or what a factored field's network says of every voxel, once.
//!
//! Functions of orientations are computed by the host, so that fields over rotations, of tools that are not symmetric about their axis,
//! are evaluated as well. The twins are [`HarmonicField::sections`] and [`HarmonicField::minimum`].

use std::ops::Range;
use std::sync::Arc;

use imf_core::control::Control;
use imf_core::field::{EngineError, FieldError};
use imf_core::orientation::Orientation;
use imf_core::section::Imf;
use imf_fields::factored::FactoredField;
use imf_fields::harmonic::HarmonicField;
use rayon::prelude::*;

use super::coefficients::{PointCoefficients, ROWS_OF_A_THREAD};
use crate::device::Gpu;
use crate::kernel::uniform;
use crate::memory::Plan;
use crate::over_orientations::{CoefficientRows, OverOrientations, ROWS, Source, rows_within};
use crate::uniforms::Batch;

/// The coefficients of all voxels on one GPU, in 4 bytes each of its memory.
pub(super) struct GridCoefficients {
    voxels: Voxels,
    over: OverOrientations,
    /// A factored field in the form that its network is evaluated in.
    evaluated: Option<Arc<FactoredField>>,
}

/// The coefficients of all voxels, some in each buffer.
struct Voxels {
    gpu: Gpu,
    count: usize,
    kept: Vec<wgpu::Buffer>,
    rows: CoefficientRows,
}

impl GridCoefficients {
    /// Uploads a harmonic field's, or runs a factored field's network at every voxel centre and retains its outputs.
    pub(super) fn new(gpu: &Gpu, source: Source<'_>) -> Result<Self, EngineError> {
        let (voxels, evaluated) = match source {
            Source::Harmonic(field) => (Voxels::of_harmonic(gpu, field)?, None),
            Source::Factored(field) => {
                let mut network = PointCoefficients::new(gpu, field)?;
                (Voxels::of_network(gpu, &mut network)?, Some(network.field))
            }
        };
        Ok(Self { over: OverOrientations::new(gpu, voxels.rows.clone())?, voxels, evaluated })
    }

    /// The sections of some orientations, `[orientation][voxel]` into `sections`; overlaps in [0, 1], or depths. Waits for the device.
    pub(super) fn sections(
        &mut self,
        source: Source<'_>,
        orientations: &[Orientation],
        sections: &mut [f32],
    ) -> Result<(), EngineError> {
        let Self { voxels, over, evaluated } = self;
        let source = evaluated.as_deref().map_or(source, Source::Factored);
        over.sections(voxels.count, orientations, source, sections, |part| Ok(voxels.hold(&part)))
    }

    /// The minimum over the orientations at every voxel, an overlap in [0, 1], with the first orientation that has it before
    /// clipping. One unit of progress is one value. Waits for the device.
    pub(super) fn minimum(
        &mut self,
        source: Source<'_>,
        orientations: &[Orientation],
        control: Control<'_>,
    ) -> Result<Imf, FieldError> {
        let Self { voxels, over, evaluated } = self;
        let source = evaluated.as_deref().map_or(source, Source::Factored);
        let mut found = over.minimum(voxels.count, orientations, source, |part, count| {
            control.check()?;
            (control.progress)((part.len() * count) as u64);
            Ok::<_, FieldError>(voxels.hold(&part))
        })?;
        let (quantity, pitch) = source.quantity();
        found.clamp(quantity, pitch);
        Ok(found)
    }
}

/// Writes the coefficients of some voxels into a buffer from an element on, in rows of `columns` with zeros behind
/// them; `padded` is reused from call to call.
pub(super) fn upload(
    gpu: &Gpu,
    field: &HarmonicField,
    voxels: Range<usize>,
    columns: usize,
    (buffer, first): (&wgpu::Buffer, usize),
    padded: &mut Vec<f32>,
) -> Result<(), EngineError> {
    let components = field.component_count();
    padded.clear();
    padded.resize(voxels.len() * columns, 0.0);
    let rows = padded.par_chunks_exact_mut(columns).zip(voxels).with_min_len(ROWS_OF_A_THREAD);
    rows.for_each_init(Vec::new, |scratch, (row, voxel)| {
        let own = field.coefficients.read(voxel * components, (voxel + 1) * components, scratch);
        row[..components].copy_from_slice(own);
    });
    gpu.queue().write_buffer(buffer, 4 * first as u64, bytemuck::cast_slice(padded));
    // The interface's own copy goes before the next one is made.
    gpu.queue().submit(std::iter::empty());
    gpu.wait(None)
}

impl Voxels {
    /// A field's own.
    fn of_harmonic(gpu: &Gpu, field: &HarmonicField) -> Result<Self, EngineError> {
        let padding = gpu.matrix_kernel().padding();
        let columns = field.component_count().next_multiple_of(padding);
        let rows = rows_within(gpu, columns, ROWS.min(field.grid.len().next_multiple_of(padding)));
        let batch = uniform(gpu, "batch", &Batch::default())?;
        let voxels = Self::new(gpu, field.grid.len(), CoefficientRows { batch, rows, columns })?;
        let mut padded = Vec::new();
        for (place, buffer) in voxels.kept.iter().enumerate() {
            upload(gpu, field, voxels.part(place), columns, (buffer, 0), &mut padded)?;
        }
        Ok(voxels)
    }

    /// Those of every voxel centre.
    fn of_network(gpu: &Gpu, network: &mut PointCoefficients) -> Result<Self, EngineError> {
        let grid = network.field.grid;
        let voxels = Self::new(gpu, grid.len(), network.rows.clone())?;
        for (place, buffer) in voxels.kept.iter().enumerate() {
            let part = voxels.part(place);
            let points: Vec<_> = part.map(|voxel| grid.centre(grid.voxel(voxel))).collect();
            gpu.copy(&network.of_points(&points)?, buffer)?;
        }
        Ok(voxels)
    }

    /// Memory for `count` points.
    fn new(gpu: &Gpu, count: usize, rows: CoefficientRows) -> Result<Self, EngineError> {
        let padding = gpu.matrix_kernel().padding();
        let mut plan = Plan::default();
        for first in (0..count).step_by(rows.rows) {
            // Products read whole paddings.
            let padded = rows.rows.min(count - first).next_multiple_of(padding);
            plan.add("coefficients of voxels", padded * rows.columns);
        }
        Ok(Self { gpu: gpu.clone(), count, kept: plan.allocate(gpu)?, rows })
    }

    /// Which of them a buffer has.
    fn part(&self, place: usize) -> Range<usize> {
        let first = place * self.rows.rows;
        first..(first + self.rows.rows).min(self.count)
    }

    /// Makes a buffer's voxels those at hand.
    fn hold(&self, part: &Range<usize>) -> wgpu::Buffer {
        self.rows.hold(&self.gpu, part.len());
        self.kept[part.start / self.rows.rows].clone()
    }
}
