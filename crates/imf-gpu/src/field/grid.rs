//! A field over its whole grid on the GPU: the coefficients of all voxels stay there, and sections and minima over any orientations
//! are products with them. Coefficients are a harmonic field's own, or what a factored field's network says of every voxel, once.
//!
//! Functions of orientations are computed by the host, so that fields over rotations, of tools that are not symmetric about their axis,
//! are answered as well. The twins are [`HarmonicField::sections`] and [`HarmonicField::minimum`].

use std::ops::Range;

use imf_core::control::Control;
use imf_core::field::{EngineError, FieldError};
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, Quantity};
use imf_fields::factored::FactoredField;
use imf_fields::harmonic::HarmonicField;
use rayon::prelude::*;

use crate::device::Gpu;
use crate::factored::{GpuFactored, ROWS_OF_A_THREAD};
use crate::kernel::uniform;
use crate::memory::Plan;
use crate::over_orientations::{CoefficientRows, OverOrientations, ROWS, Scaled, rows_within};
use crate::submit::Submissions;
use crate::uniforms::Batch;

/// The coefficients of all voxels on one GPU, in 4 bytes each of its memory.
pub(super) struct GridCoefficients {
    voxels: Voxels,
    over: OverOrientations,
    /// A factored field in the form that its network answers in.
    evaluated: Option<FactoredField>,
}

/// What says what orientations are worth.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    Harmonic(&'a HarmonicField),
    Factored(&'a FactoredField),
}

/// The coefficients of all voxels, some in each buffer.
struct Voxels {
    gpu: Gpu,
    count: usize,
    kept: Vec<wgpu::Buffer>,
    rows: CoefficientRows,
}

impl GridCoefficients {
    /// Uploads a harmonic field's, or runs a factored field's network at every voxel centre.
    ///
    /// # Errors
    /// As the two below.
    pub(super) fn new(gpu: &Gpu, source: Source<'_>) -> Result<Self, EngineError> {
        match source {
            Source::Harmonic(field) => Self::of_harmonic(gpu, field),
            Source::Factored(field) => Self::of_factored(gpu, field),
        }
    }

    /// Uploads a field.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a field beyond the adapter's memory, or a device that failed.
    fn of_harmonic(gpu: &Gpu, field: &HarmonicField) -> Result<Self, EngineError> {
        let padding = gpu.matrix_kernel().padding();
        let columns = field.axis_count().next_multiple_of(padding);
        let rows = rows_within(gpu, columns, ROWS.min(field.grid.len().next_multiple_of(padding)));
        let batch = uniform(gpu, "batch", &Batch::default())?;
        let voxels = Voxels::new(gpu, field.grid.len(), CoefficientRows { batch, rows, columns })?;
        let mut padded = Vec::new();
        for (place, buffer) in voxels.kept.iter().enumerate() {
            upload(gpu, field, voxels.part(place), columns, (buffer, 0), &mut padded)?;
        }
        let over = OverOrientations::new(gpu, voxels.rows.clone())?;
        Ok(Self { voxels, over, evaluated: None })
    }

    /// Runs a field's network at every voxel centre, and keeps what it says.
    ///
    /// # Errors
    /// As [`Self::of_harmonic`], and for a network beyond the adapter's limits.
    fn of_factored(gpu: &Gpu, field: &FactoredField) -> Result<Self, EngineError> {
        let grid = field.grid;
        let mut network = GpuFactored::new(gpu, field)?;
        let voxels = Voxels::new(gpu, grid.len(), network.rows().clone())?;
        let mut submissions = Submissions::default();
        for (place, buffer) in voxels.kept.iter().enumerate() {
            let part = voxels.part(place);
            let points: Vec<_> = part.map(|voxel| grid.centre(grid.voxel(voxel))).collect();
            let made = network.coefficients_of(&points, &mut submissions)?;
            submissions.copy(gpu, &made, buffer)?;
        }
        let (field, over) = network.into_parts();
        Ok(Self { voxels, over, evaluated: Some(field) })
    }

    /// The sections of some orientations, `[orientation][voxel]` into `sections`; overlaps in [0, 1], or depths. Waits for the device.
    ///
    /// # Errors
    /// No orientation, too many for the adapter's memory, or a device that failed.
    ///
    /// # Panics
    /// If `sections` has not that length.
    pub(super) fn sections(
        &mut self,
        source: Source<'_>,
        orientations: &[Orientation],
        sections: &mut [f32],
    ) -> Result<(), EngineError> {
        let Self { voxels, over, evaluated } = self;
        let source = evaluated.as_ref().map_or(source, Source::Factored);
        assert_eq!(
            sections.len(),
            voxels.count * orientations.len(),
            "one value for each orientation and voxel"
        );
        let out = (source.quantity(), sections);
        over.sections(
            voxels.count,
            orientations,
            |some| source.scaled(some),
            out,
            |part, _| Ok(voxels.hold(&part)),
        )
    }

    /// The least value over the orientations at every voxel, an overlap in [0, 1], with the first orientation that has it before
    /// clipping. One unit of progress is one value. Waits for the device.
    ///
    /// # Errors
    /// As [`Self::sections`]; [`FieldError::Cancelled`] when the control asks to stop.
    pub(super) fn minimum(
        &mut self,
        source: Source<'_>,
        orientations: &[Orientation],
        control: Control<'_>,
    ) -> Result<Imf, FieldError> {
        let Self { voxels, over, evaluated } = self;
        let source = evaluated.as_ref().map_or(source, Source::Factored);
        let scaled = |some: &[Orientation]| source.scaled(some);
        let mut found = over.minimum(voxels.count, orientations, scaled, |part, count, _| {
            if control.is_cancelled() {
                return Err(FieldError::Cancelled);
            }
            (control.progress)((part.len() * count) as u64);
            Ok(voxels.hold(&part))
        })?;
        found.hold(source.quantity());
        Ok(found)
    }
}

/// Writes the coefficients of some voxels into a buffer from an element on, in rows of `columns` with zeros behind them; `padded` is
/// kept from call to call.
pub(crate) fn upload(
    gpu: &Gpu,
    field: &HarmonicField,
    voxels: Range<usize>,
    columns: usize,
    (buffer, first): (&wgpu::Buffer, usize),
    padded: &mut Vec<f32>,
) -> Result<(), EngineError> {
    let axes = field.axis_count();
    padded.clear();
    padded.resize(voxels.len() * columns, 0.0);
    let rows = padded.par_chunks_exact_mut(columns).zip(voxels).with_min_len(ROWS_OF_A_THREAD);
    rows.for_each_init(Vec::new, |scratch, (row, voxel)| {
        let own = field.coefficients.read(voxel * axes, (voxel + 1) * axes, scratch);
        row[..axes].copy_from_slice(own);
    });
    gpu.queue().write_buffer(buffer, 4 * first as u64, bytemuck::cast_slice(padded));
    // The interface's own copy goes before the next one is made.
    gpu.queue().submit(std::iter::empty());
    gpu.wait(None)
}

impl Source<'_> {
    fn scaled(&self, orientations: &[Orientation]) -> Scaled {
        match self {
            Self::Harmonic(field) => Scaled { heads: field.direction_weights(orientations), scale: 1.0 },
            Self::Factored(field) => Scaled::of(field, orientations),
        }
    }

    fn quantity(&self) -> Quantity {
        match self {
            Self::Harmonic(field) => field.quantity,
            Self::Factored(field) => field.quantity,
        }
    }
}

impl Voxels {
    /// Memory for so many.
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
