//! How poses pass through a field, whatever family it is of: kernels that read and write the buffers of a call, and what lies
//! between them.
//!
//! ```text
//! poses → points → forward → values → backward → gradients
//! ```

use glam::DVec3;
use imf_core::field::EngineError;
use imf_core::grid::Grid;

use super::device_types::{DeviceGradient, DevicePose};
use crate::device::Gpu;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::shader::Shader;
use crate::uniforms::{Sweep, World};

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
        let [low, high] = grid.box_of_centres().map(four);
        let world = World { low, high, origin: four(grid.origin), size: four(grid.size()) };
        Ok(Self {
            gpu: gpu.clone(),
            world: uniform(gpu, "world", &world)?,
            sweep: uniform(gpu, "sweep", &Sweep::default())?,
        })
    }
}

pub(super) struct Call {
    pub(super) poses: wgpu::Buffer,
    pub(super) values: wgpu::Buffer,
    pub(super) gradients: Option<wgpu::Buffer>,
}

impl Call {
    pub(super) fn new(poses: &wgpu::Buffer, values: &wgpu::Buffer, gradients: Option<&wgpu::Buffer>) -> Self {
        Self { poses: poses.clone(), values: values.clone(), gradients: gradients.cloned() }
    }
}

/// A buffer of a kernel: its own, or one of a call.
#[derive(Clone)]
pub(super) enum Slot {
    Own(wgpu::Buffer),
    Poses,
    Values,
    Gradients,
}

pub(super) fn own(buffer: &wgpu::Buffer) -> Slot {
    Slot::Own(buffer.clone())
}

/// A kernel that is bound anew for every call.
#[derive(Clone)]
pub(super) struct CallKernel {
    kernel: Kernel,
    extent: Extent,
    slots: Vec<Slot>,
}

impl CallKernel {
    pub(super) fn new(
        gpu: &Gpu,
        shader: Shader,
        extent: Extent,
        slots: Vec<Slot>,
    ) -> Result<Self, EngineError> {
        Ok(Self { kernel: Kernel::new(gpu, shader)?, extent, slots })
    }

    pub(super) fn bind(&self, call: &Call) -> Dispatch {
        let buffers = self.slots.iter().filter_map(|slot| match slot {
            Slot::Own(buffer) => Some(buffer),
            Slot::Poses => Some(&call.poses),
            Slot::Values => Some(&call.values),
            Slot::Gradients => call.gradients.as_ref(),
        });
        self.kernel.bind(self.extent, &buffers.collect::<Vec<_>>())
    }
}

pub(super) struct Passes {
    /// The rows at hand.
    pub(super) batch: wgpu::Buffer,
    /// Poses that pass together, at most.
    pub(super) rows: usize,
    /// From poses to what the way forward begins with.
    pub(super) points: CallKernel,
    pub(super) forward: Vec<Dispatch>,
    pub(super) values: CallKernel,
    /// Values with what the way back begins with.
    pub(super) slopes: CallKernel,
    pub(super) backward: Vec<Dispatch>,
    /// Derivatives by the position.
    pub(super) gradients: CallKernel,
}

impl Passes {
    /// Submits `count` poses, as many at a time as there is room for.
    pub(super) fn submit(&self, frame: &Frame, call: &Call, count: usize) -> Result<(), EngineError> {
        check_size("poses", &call.poses, count, size_of::<DevicePose>())?;
        check_size("values", &call.values, count, size_of::<f32>())?;
        let points = self.points.bind(call);
        let (values, gradients) = match &call.gradients {
            None => (self.values.bind(call), None),
            Some(gradients) => {
                check_size("gradients", gradients, count, size_of::<DeviceGradient>())?;
                (self.slopes.bind(call), Some(self.gradients.bind(call)))
            }
        };
        let mut pass = [&points].into_iter().chain(&self.forward).chain([&values]).collect::<Vec<_>>();
        if let Some(gradients) = &gradients {
            pass.extend(self.backward.iter().chain([gradients]));
        }
        for base in (0..count).step_by(self.rows) {
            let batch = frame.gpu.batch_of(self.rows.min(count - base));
            frame.gpu.write(&self.batch, &[batch]);
            frame.gpu.write(&frame.sweep, &[Sweep { base: base as u32, ..Sweep::default() }]);
            frame.gpu.run(pass.iter().copied(), batch)?;
        }
        Ok(())
    }
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
