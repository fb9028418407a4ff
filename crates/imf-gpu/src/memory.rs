//! Device memory: everything an engine needs is planned, compared with the limits, and only then allocated.

use bytemuck::Pod;
use imf_core::field::EngineError;

use crate::device::{Gpu, GpuLimits};

/// Buffers to be, in the order they were added.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    items: Vec<(String, u64)>,
}

impl Plan {
    /// Adds a storage buffer of so many 4-byte elements and returns its place in what [`Plan::allocate`] returns.
    pub(crate) fn add(&mut self, name: impl Into<String>, elements: usize) -> usize {
        self.items.push((name.into(), 4 * elements.max(4) as u64));
        self.items.len() - 1
    }

    /// All buffers together, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.items.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Refuses a plan with a buffer beyond the limits.
    pub(crate) fn check(&self, limits: GpuLimits) -> Result<(), EngineError> {
        let limit = limits.buffer.min(limits.storage_binding);
        let Some((name, bytes)) = self.items.iter().max_by_key(|(_, bytes)| *bytes) else {
            return Ok(());
        };
        if *bytes <= limit {
            return Ok(());
        }
        Err(EngineError::Device(format!(
            "this needs {} of GPU memory, {} of it in one buffer ({name}), but this adapter binds at most {}. Take a narrower \
             network or a larger pitch, or the CPU (--device cpu)",
            mebibytes(self.bytes()),
            mebibytes(*bytes),
            mebibytes(limit),
        )))
    }

    /// Allocates every buffer.
    pub(crate) fn allocate(&self, gpu: &Gpu) -> Result<Vec<wgpu::Buffer>, EngineError> {
        self.check(gpu.limits())?;
        let allocate = |(name, bytes): &(String, u64)| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(name),
                size: *bytes,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        gpu.guarded(|| self.items.iter().map(allocate).collect()).map_err(|error| {
            EngineError::Device(format!("{error} ({} were asked for)", mebibytes(self.bytes())))
        })
    }
}

/// A storage buffer of 4-byte elements that grows when more is wanted.
#[derive(Debug)]
pub(crate) struct Room {
    name: &'static str,
    buffer: Option<wgpu::Buffer>,
}

impl Room {
    /// Nothing yet.
    pub(crate) fn new(name: &'static str) -> Self {
        Self { name, buffer: None }
    }

    /// The buffer, with room for so many elements. A new one has lost the contents of the old.
    pub(crate) fn fit(&mut self, gpu: &Gpu, elements: usize) -> Result<wgpu::Buffer, EngineError> {
        let wanted = 4 * elements as u64;
        if let Some(buffer) = self.buffer.as_ref().filter(|buffer| buffer.size() >= wanted) {
            return Ok(buffer.clone());
        }
        let limits = gpu.limits();
        let limit = limits.buffer.min(limits.storage_binding) / 4 * 4;
        if wanted > limit {
            return Err(EngineError::Device(format!(
                "{} take {} of GPU memory, but this adapter binds at most {}. Ask for less at a time, take a larger pitch, or \
                 the CPU (--device cpu)",
                self.name,
                mebibytes(wanted),
                mebibytes(limit),
            )));
        }
        let size = wanted.max(256).next_power_of_two().min(limit.max(wanted));
        // The old one is not needed beside the new one.
        self.buffer = None;
        let buffer = gpu.guarded(|| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(self.name),
                size,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })?;
        Ok(self.buffer.insert(buffer).clone())
    }

    /// The buffer, beginning with these values.
    pub(crate) fn upload<T: Pod>(&mut self, gpu: &Gpu, values: &[T]) -> Result<wgpu::Buffer, EngineError> {
        let buffer = self.fit(gpu, size_of_val(values) / 4)?;
        gpu.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(values));
        Ok(buffer)
    }

    /// Overwrites everything.
    pub(crate) fn fill(&self, gpu: &Gpu, value: u32) {
        if let Some(buffer) = &self.buffer {
            let values = vec![value; buffer.size() as usize / 4];
            gpu.queue().write_buffer(buffer, 0, bytemuck::cast_slice(&values));
        }
    }
}

/// A buffer that the host reads others by, kept from reading to reading; it grows when more is wanted.
#[derive(Debug, Default)]
pub(crate) struct ReadBack {
    buffer: Option<wgpu::Buffer>,
}

impl ReadBack {
    /// Hands over the first `count` elements of `source` with their places; waits for the device.
    pub(crate) fn read<T: Pod>(
        &mut self,
        gpu: &Gpu,
        source: &wgpu::Buffer,
        count: usize,
        mut take: impl FnMut(usize, T),
    ) -> Result<(), EngineError> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(());
        }
        // Taken out: after a failure it may still be mapped, and is not used again.
        let buffer = match self.buffer.take().filter(|buffer| buffer.size() >= bytes) {
            Some(buffer) => buffer,
            None => gpu.guarded(|| {
                gpu.device().create_buffer(&wgpu::BufferDescriptor {
                    label: Some("read-back"),
                    size: bytes.max(256).next_power_of_two(),
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })?,
        };
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes);
        gpu.queue().submit([encoder.finish()]);
        // A failed mapping shows in `mapped`.
        buffer.map_async(wgpu::MapMode::Read, ..bytes, |_| ());
        gpu.wait(None)?;
        let view = gpu.mapped(&buffer, bytes)?;
        for (place, element) in view.chunks_exact(size_of::<T>()).enumerate() {
            take(place, bytemuck::pod_read_unaligned(element));
        }
        drop(view);
        buffer.unmap();
        self.buffer = Some(buffer);
        Ok(())
    }

    /// The buffer that is kept.
    #[cfg(test)]
    pub(crate) fn buffer(&self) -> Option<&wgpu::Buffer> {
        self.buffer.as_ref()
    }
}

/// Bytes as mebibytes, with two digits.
fn mebibytes(bytes: u64) -> String {
    format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_refusal_names_the_estimate_the_buffer_and_the_limit() {
        let mut plan = Plan::default();
        plan.add("weights", 1 << 18);
        plan.add("signal", 1 << 19);
        let limits = |binding| GpuLimits { storage_binding: binding, buffer: 1 << 30, workgroups: 65_535 };
        assert!(plan.check(limits(2 << 20)).is_ok());
        let message = plan.check(limits((2 << 20) - 1)).unwrap_err().to_string();
        for part in ["3.00 MiB", "2.00 MiB", "signal"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
