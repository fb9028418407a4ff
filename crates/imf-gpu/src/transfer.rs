//! Between host and device: writing, and reading back.

use std::sync::PoisonError;

use bytemuck::Pod;
use imf_core::field::EngineError;

use crate::device::Gpu;

/// A buffer for readback is reused by the next one up to this size: gradients of 2¹⁸ poses.
const KEPT_BYTES: u64 = 8 << 20;

/// A copy to the host that is under way.
#[derive(Debug)]
pub(crate) struct Reading {
    staging: wgpu::Buffer,
    bytes: u64,
    submission: wgpu::SubmissionIndex,
}

impl Gpu {
    /// Writes to the beginning of a buffer, before whatever is submitted next.
    pub(crate) fn write<T: Pod>(&self, buffer: &wgpu::Buffer, values: &[T]) {
        self.queue().write_buffer(buffer, 0, bytemuck::cast_slice(values));
    }

    /// Overwrites a whole buffer with one number.
    pub(crate) fn fill<T: Pod>(&self, buffer: &wgpu::Buffer, value: T) {
        self.write(buffer, &vec![value; buffer.size() as usize / size_of::<T>()]);
    }

    /// Copies the first `count` elements of a buffer to the host; waits for the device.
    pub(crate) fn read<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, EngineError> {
        if count == 0 {
            return Ok(Vec::new());
        }
        self.finish_read(self.begin_read(buffer, count * size_of::<T>() / 4)?)
    }

    /// Hands over the first `count` elements of a buffer with their places; waits for the device.
    pub(crate) fn read_each<T: Pod>(
        &self,
        buffer: &wgpu::Buffer,
        count: usize,
        mut take: impl FnMut(usize, T),
    ) -> Result<(), EngineError> {
        if count == 0 {
            return Ok(());
        }
        let reading = self.begin_read(buffer, count * size_of::<T>() / 4)?;
        self.finish(reading, |bytes| {
            for (place, element) in bytes.chunks_exact(size_of::<T>()).enumerate() {
                take(place, bytemuck::pod_read_unaligned(element));
            }
        })
    }

    /// Submits a copy of the first `count` 4-byte elements of a buffer, of which there is at least one.
    pub(crate) fn begin_read(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Reading, EngineError> {
        let bytes = 4 * count as u64;
        let kept = self.staging.lock().unwrap_or_else(PoisonError::into_inner).take();
        let staging = match kept.filter(|kept| kept.size() >= bytes) {
            Some(kept) => kept,
            None => self.in_error_scope(|| {
                self.device().create_buffer(&wgpu::BufferDescriptor {
                    label: Some("read-back"),
                    size: if bytes > KEPT_BYTES { bytes } else { bytes.max(256).next_power_of_two() },
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })?,
        };
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
        let submission = self.queue().submit([encoder.finish()]);
        // A failed mapping shows in `get_mapped_range`.
        staging.map_async(wgpu::MapMode::Read, ..bytes, |_| ());
        Ok(Reading { staging, bytes, submission })
    }

    /// What was copied; waits for the copy, and not for what was submitted after it.
    pub(crate) fn finish_read<T: Pod>(&self, reading: Reading) -> Result<Vec<T>, EngineError> {
        self.finish(reading, bytemuck::pod_collect_to_vec)
    }

    fn finish<R>(&self, reading: Reading, take: impl FnOnce(&[u8]) -> R) -> Result<R, EngineError> {
        let Reading { staging, bytes, submission } = reading;
        self.wait(Some(submission))?;
        let view = staging.get_mapped_range(..bytes).map_err(|error| {
            EngineError::Device(format!("reading back from {} failed: {error}", self.adapter().name))
        })?;
        let taken = take(&view);
        drop(view);
        staging.unmap();
        // After a failure it may still be mapped, and is not used again.
        if staging.size() <= KEPT_BYTES {
            *self.staging.lock().unwrap_or_else(PoisonError::into_inner) = Some(staging);
        }
        Ok(taken)
    }
}
