//! What the calls of a field work with: how poses pass through it, in parts that fit the device.

use imf_core::field::EngineError;
use imf_fields::calibration::Calibration;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;

use super::device_types::{DeviceGradient, DevicePose};
use super::factored::FactoredPasses;
use super::harmonic::HarmonicPasses;
use super::host::HostBuffers;
use super::network::{Frame, Passes};
use super::siren::SirenPasses;
use crate::device::Gpu;
use crate::kernel::{Kernel, uniform};
use crate::shader::Shader;
use crate::submit::Submissions;
use crate::uniforms::{Batch, Sweep, Thresholds};

/// What calls work with.
pub(super) struct Work {
    pub(super) frame: Frame,
    pub(super) family: Family,
    pub(super) host: HostBuffers,
    decisions: Kernel,
    thresholds: wgpu::Buffer,
    /// The poses that are decided at once.
    decided: wgpu::Buffer,
    submissions: Submissions,
}

/// How poses pass through a field.
pub(super) enum Family {
    Siren(Box<SirenPasses>),
    Factored(Box<FactoredPasses>),
    Harmonic(Box<HarmonicPasses>),
}

/// Buffers of a call.
#[derive(Clone, Copy)]
pub(super) struct Call<'a> {
    pub(super) poses: &'a wgpu::Buffer,
    pub(super) values: &'a wgpu::Buffer,
    pub(super) gradients: Option<&'a wgpu::Buffer>,
}

impl Work {
    pub(super) fn new(gpu: &Gpu, file: &FieldFile, field: &Field) -> Result<Self, EngineError> {
        let family = match file {
            FieldFile::Siren(model) => Family::Siren(Box::new(SirenPasses::new(gpu, model)?)),
            FieldFile::Factored(file) => Family::Factored(Box::new(FactoredPasses::new(gpu, &file.field)?)),
            FieldFile::Harmonic(file) => Family::Harmonic(Box::new(HarmonicPasses::new(gpu, &file.field)?)),
        };
        let threshold = |found: fn(&Calibration) -> Option<f32>, none: f32| {
            field.calibration().and_then(found).unwrap_or(none)
        };
        let thresholds = Thresholds {
            free_up_to: threshold(|calibration| calibration.free_up_to, f32::MIN),
            colliding_from: threshold(|calibration| calibration.colliding_from, f32::MAX),
        };
        Ok(Self {
            frame: Frame::new(gpu, &field.scene().record.grid)?,
            family,
            host: HostBuffers::new(),
            decisions: Kernel::new(gpu, Shader::PoseDecisions)?,
            thresholds: uniform(gpu, "thresholds", &thresholds)?,
            decided: uniform(gpu, "decided", &Batch::default())?,
            submissions: Submissions::default(),
        })
    }

    /// Submits the poses of a buffer in parts.
    pub(super) fn submit(&mut self, call: Call<'_>, count: usize) -> Result<(), EngineError> {
        check_size("poses", call.poses, count, size_of::<DevicePose>())?;
        check_size("values", call.values, count, size_of::<f32>())?;
        if let Some(gradients) = call.gradients {
            check_size("gradients", gradients, count, size_of::<DeviceGradient>())?;
        }
        let Self { frame, family, submissions, .. } = self;
        match family {
            Family::Siren(passes) => in_parts(frame, &**passes, submissions, call, count),
            Family::Harmonic(passes) => in_parts(frame, &**passes, submissions, call, count),
            Family::Factored(passes) => in_parts(frame, &**passes, submissions, call, count),
        }
    }

    /// Submits what is decided of poses by values that were asked before.
    pub(super) fn decide(
        &mut self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        decisions: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        let gpu = &self.frame.gpu;
        let block = Batch { rows: count as u32, ..Batch::default() };
        gpu.queue().write_buffer(&self.decided, 0, bytemuck::bytes_of(&block));
        let buffers = [&self.decided, &self.frame.world, &self.thresholds, poses, values, decisions];
        let bound = self.decisions.bind(gpu, &buffers);
        let workgroups = gpu.limits().workgroups;
        self.submissions.pass(gpu, |pass| bound.linear(pass, count, workgroups))
    }
}

/// Submits `count` poses, as many at a time as there is room for.
fn in_parts<P: Passes>(
    frame: &Frame,
    passes: &P,
    submissions: &mut Submissions,
    call: Call<'_>,
    count: usize,
) -> Result<(), EngineError> {
    let (bound, extent) = (passes.bind(frame, call), passes.extent());
    let gpu = &frame.gpu;
    for base in (0..count).step_by(extent.rows) {
        let rows = extent.rows.min(count - base);
        let padded_rows = rows.next_multiple_of(extent.padding);
        let block = Batch { rows: rows as u32, padded_rows: padded_rows as u32, ..Batch::default() };
        let part = Sweep { base: base as u32, ..Sweep::default() };
        gpu.queue().write_buffer(extent.batch, 0, bytemuck::bytes_of(&block));
        gpu.queue().write_buffer(&frame.sweep, 0, bytemuck::bytes_of(&part));
        let limit = gpu.limits().workgroups;
        submissions.pass(gpu, |pass| passes.record(&bound, pass, rows, padded_rows, limit))?;
    }
    Ok(())
}

/// Refuses a buffer that is too small for `count` elements of `each` bytes.
pub(super) fn check_size(
    name: &str,
    buffer: &wgpu::Buffer,
    count: usize,
    each: usize,
) -> Result<(), EngineError> {
    let size = buffer.size();
    if size / (each as u64) < count as u64 {
        return Err(EngineError::Shape(format!("a buffer of {size} bytes for {count} {name}")));
    }
    Ok(())
}
