//! One open device: queue, limits, and what went wrong on it.
//!
//! wgpu reports most failures through callbacks, some time after the call that caused them. They are collected here,
//! and the next call that can return an error returns them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use imf_core::field::EngineError;
use wgpu::DeviceType;

use crate::adapter::{self, AdapterSummary, DeviceChoice};
use crate::shader::MatrixKernel;

/// Limits of buffers and dispatches: the adapter's, or smaller ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuLimits {
    /// Largest storage binding, in bytes.
    pub storage_binding: u64,
    /// Largest buffer, in bytes.
    pub buffer: u64,
    /// Workgroups in one dimension of a dispatch.
    pub workgroups: u32,
}

impl GpuLimits {
    /// 4-byte elements that one buffer can hold and one binding show.
    pub(crate) fn elements(self) -> usize {
        self.binding() as usize / 4
    }

    /// Bytes that one buffer can hold and one binding show: no more than shaders can index, who count 4-byte elements by `u32`.
    pub(crate) fn binding(self) -> u64 {
        self.storage_binding.min(self.buffer).min(4 * u64::from(u32::MAX) / 256 * 256)
    }
}

/// One open device. Clones share it.
#[derive(Clone, Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    adapter: Arc<AdapterSummary>,
    limits: GpuLimits,
    matrix: MatrixKernel,
    faults: Faults,
    /// Submissions that nobody waited for.
    pub(crate) under_way: Arc<Mutex<VecDeque<wgpu::SubmissionIndex>>>,
    /// The buffer that was last read by; see `transfer.rs`.
    pub(crate) staging: Arc<Mutex<Option<wgpu::Buffer>>>,
}

/// The first failure that a callback reported.
#[derive(Clone, Debug, Default)]
struct Faults(Arc<Mutex<Option<String>>>);

impl Faults {
    fn report(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }

    fn check(&self) -> Result<(), EngineError> {
        match &*self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(message) => Err(EngineError::Device(message.clone())),
            None => Ok(()),
        }
    }
}

impl Gpu {
    /// Opens the adapter that `choice` means.
    ///
    /// # Errors
    /// [`EngineError::Device`] naming cause and remedy: no such adapter, no driver or loader, or a driver that refuses.
    pub fn open(choice: &DeviceChoice) -> Result<Self, EngineError> {
        let (summary, adapter) = adapter::choose(choice)?;
        let limits = adapter.limits();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("imf"),
            required_features: adapter.features() & wgpu::Features::SHADER_F16,
            required_limits: limits.clone(),
            experimental_features: wgpu::ExperimentalFeatures::disabled(),
            memory_hints: wgpu::MemoryHints::Performance,
            trace: wgpu::Trace::Off,
        }))
        .map_err(|error| {
            EngineError::Device(format!(
                "{} could not be opened: {error}. Update its driver, choose another adapter, or use the CPU engine",
                summary.name
            ))
        })?;
        let faults = Faults::default();
        let (uncaptured, lost, name) = (faults.clone(), faults.clone(), summary.name.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| uncaptured.report(explain(&error))));
        device.set_device_lost_callback(move |reason, message| {
            // Our own closing of the device is not a failure.
            if reason != wgpu::DeviceLostReason::Destroyed {
                lost.report(explain_loss(&name, &message));
            }
        });
        let matrix = match summary.kind {
            DeviceType::Cpu => MatrixKernel::Register,
            _ => MatrixKernel::Tiled,
        };
        let limits = GpuLimits {
            storage_binding: limits.max_storage_buffer_binding_size,
            buffer: limits.max_buffer_size,
            workgroups: limits.max_compute_workgroups_per_dimension,
        };
        Ok(Self {
            device,
            queue,
            adapter: Arc::new(summary),
            limits,
            matrix,
            faults,
            under_way: Arc::default(),
            staging: Arc::default(),
        })
    }

    /// The same device held to smaller limits where `limits` has smaller ones.
    #[must_use]
    #[doc(hidden)]
    pub fn with_limits(mut self, limits: GpuLimits) -> Self {
        self.limits.storage_binding = self.limits.storage_binding.min(limits.storage_binding);
        self.limits.buffer = self.limits.buffer.min(limits.buffer);
        self.limits.workgroups = self.limits.workgroups.min(limits.workgroups);
        self
    }

    /// The same device with the given matrix kernel instead of the one that suits its kind.
    #[must_use]
    #[doc(hidden)]
    pub fn with_matrix_kernel(mut self, matrix: MatrixKernel) -> Self {
        self.matrix = matrix;
        self
    }

    /// Name, backend, driver, limits and matrix kernel in one line, for people.
    #[must_use]
    pub fn describe(&self) -> String {
        format!("{}, {} matrix kernel", self.adapter, self.matrix.name())
    }

    /// What the adapter is and can do.
    #[must_use]
    pub fn adapter(&self) -> &AdapterSummary {
        &self.adapter
    }

    /// The limits of buffers and dispatches.
    #[must_use]
    pub fn limits(&self) -> GpuLimits {
        self.limits
    }

    /// The matrix kernel in use.
    #[must_use]
    pub fn matrix_kernel(&self) -> MatrixKernel {
        self.matrix
    }

    /// The device, for kernels of one's own.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue, for kernels of one's own.
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Returns an error of the device, if there was one; it stays for good.
    pub(crate) fn check(&self) -> Result<(), EngineError> {
        self.faults.check()
    }

    /// Runs `work`, and returns what the device reports about it at once, out of memory above all.
    pub(crate) fn in_error_scope<T>(&self, work: impl FnOnce() -> T) -> Result<T, EngineError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        let errors = [validation, internal, memory].map(|scope| pollster::block_on(scope.pop()));
        match errors.into_iter().flatten().next() {
            Some(error) => Err(EngineError::Device(explain(&error))),
            None => self.check().map(|()| result),
        }
    }

    /// Waits for one submission, or for all.
    pub(crate) fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), EngineError> {
        let outcome = self.device.poll(wgpu::PollType::Wait { submission_index: submission, timeout: None });
        self.check()?;
        outcome.map(|_| ()).map_err(|error| {
            EngineError::Device(format!("waiting for {} failed: {error}", self.adapter.name))
        })
    }
}

/// A wgpu error as cause and remedy.
fn explain(error: &wgpu::Error) -> String {
    match error {
        wgpu::Error::OutOfMemory { .. } => {
            "the GPU ran out of memory. Close other programs that use it, take a smaller batch, network or grid, or use \
             the CPU"
                .to_owned()
        }
        wgpu::Error::Validation { description, .. } => format!(
            "the graphics interface refused a call, which is a fault of this program: {description}. Please report \
             it; the CPU engine is not concerned"
        ),
        wgpu::Error::Internal { description, .. } => format!(
            "the graphics driver failed: {description}. Update the driver, choose another adapter, or use the CPU \
             engine"
        ),
    }
}

/// The loss of a device as cause and remedy.
fn explain_loss(name: &str, message: &str) -> String {
    format!(
        "the connection to {name} was lost ({message}): the driver was reset or updated, a dispatch ran into its time \
         limit, or the device was removed. Continue from the last checkpoint, with a smaller batch or on the CPU engine \
         if it happens again"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_fault_stays() {
        let faults = Faults::default();
        assert!(faults.check().is_ok());
        faults.report("first".to_owned());
        faults.report("second".to_owned());
        assert_eq!(faults.check().unwrap_err().to_string(), "first");
        assert!(faults.check().is_err());
    }

    #[test]
    fn out_of_memory_names_a_remedy() {
        let error = wgpu::Error::OutOfMemory { source: "no room".into() };
        assert!(explain(&error).contains("smaller batch"));
    }

    #[test]
    fn a_lost_device_names_itself_and_a_remedy() {
        let text = explain_loss("GeForce", "reset");
        assert!(text.contains("GeForce was lost (reset)") && text.contains("last checkpoint"), "{text}");
    }
}
