//! Device memory: everything an engine needs is planned, compared with the limits, and only then allocated.

use imf_core::training::EngineError;

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
            "the network needs {} of GPU memory, {} of it in one buffer ({name}), but this adapter binds at most {}. \
             Take a narrower network or the CPU engine",
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
