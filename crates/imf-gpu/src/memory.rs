//! Device memory: everything an engine needs is planned, compared with the limits, and only then allocated.

use bytemuck::Pod;
use imf_core::field::EngineError;

use crate::device::{Gpu, GpuLimits};
use crate::layout::PaddedLayout;

/// Buffers to be, in the order they were added.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    items: Vec<(&'static str, u64)>,
}

impl Plan {
    /// Adds a storage buffer of `elements` 4-byte elements.
    pub(crate) fn add(&mut self, name: &'static str, elements: usize) {
        self.items.push((name, 4 * elements.max(4) as u64));
    }

    /// Adds the signals of every layer's inputs and, behind them all, the deltas of its outputs.
    pub(crate) fn add_layers(&mut self, layout: &PaddedLayout, rows: usize) {
        layout.layers.iter().for_each(|layer| self.add("signal", rows * layer.inputs));
        layout.layers.iter().for_each(|layer| self.add("delta", rows * layer.outputs));
    }

    /// All buffers together, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.items.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Refuses a plan with a buffer beyond the limits.
    pub(crate) fn check(&self, limits: GpuLimits) -> Result<(), EngineError> {
        let limit = limits.binding();
        match self.items.iter().max_by_key(|(_, bytes)| *bytes) {
            Some((name, bytes)) if *bytes > limit => Err(EngineError::Device(format!(
                "this needs {} of GPU memory, {} of it in one buffer ({name}), but this adapter binds at most {}. Take a \
                 narrower network or a larger pitch, or the CPU",
                mebibytes(self.bytes()),
                mebibytes(*bytes),
                mebibytes(limit),
            ))),
            _ => Ok(()),
        }
    }

    pub(crate) fn allocate(&self, gpu: &Gpu) -> Result<Vec<wgpu::Buffer>, EngineError> {
        self.check(gpu.limits())?;
        gpu.in_error_scope(|| self.items.iter().map(|&(name, bytes)| storage(gpu, name, bytes)).collect())
            .map_err(|error| {
                EngineError::Device(format!("{error} ({} were requested)", mebibytes(self.bytes())))
            })
    }
}

/// Allocates storage buffers of the given numbers of 4-byte elements.
pub(crate) fn allocate<const N: usize>(
    gpu: &Gpu,
    buffers: [(&'static str, usize); N],
) -> Result<[wgpu::Buffer; N], EngineError> {
    let mut plan = Plan::default();
    buffers.iter().for_each(|&(name, elements)| plan.add(name, elements));
    Ok(plan.allocate(gpu)?.try_into().expect("as many as are planned"))
}

fn storage(gpu: &Gpu, name: &str, size: u64) -> wgpu::Buffer {
    gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some(name),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// A storage buffer of 4-byte elements that grows when more is wanted.
#[derive(Debug)]
pub(crate) struct Room {
    name: &'static str,
    buffer: Option<wgpu::Buffer>,
}

impl Room {
    pub(crate) fn new(name: &'static str) -> Self {
        Self { name, buffer: None }
    }

    /// The buffer, with room for `elements` elements. A new one has lost the contents of the old.
    pub(crate) fn fit(&mut self, gpu: &Gpu, elements: usize) -> Result<wgpu::Buffer, EngineError> {
        let wanted = 4 * elements as u64;
        if let Some(buffer) = self.buffer.as_ref().filter(|buffer| buffer.size() >= wanted) {
            return Ok(buffer.clone());
        }
        let limits = gpu.limits();
        let limit = limits.binding() / 4 * 4;
        if wanted > limit {
            return Err(EngineError::Device(format!(
                "{} take {} of GPU memory, but this adapter binds at most {}. Ask for less at a time, take a larger pitch, or \
                 the CPU",
                self.name,
                mebibytes(wanted),
                mebibytes(limit),
            )));
        }
        let size = wanted.max(256).next_power_of_two().min(limit.max(wanted));
        // The old one is not needed beside the new one.
        self.buffer = None;
        let buffer = gpu.in_error_scope(|| storage(gpu, self.name, size))?;
        Ok(self.buffer.insert(buffer).clone())
    }

    /// The buffer, beginning with these values.
    pub(crate) fn upload<T: Pod>(&mut self, gpu: &Gpu, values: &[T]) -> Result<wgpu::Buffer, EngineError> {
        let buffer = self.fit(gpu, size_of_val(values) / 4)?;
        gpu.write(&buffer, values);
        Ok(buffer)
    }

    pub(crate) fn fill(&self, gpu: &Gpu, value: u32) {
        self.buffer.iter().for_each(|buffer| gpu.fill(buffer, value));
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
