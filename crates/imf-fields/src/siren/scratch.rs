//! What the CPU engines share beside the network: their name, and buffers for whichever thread works.

use pulp::Arch;

use crate::parallel::threads;
use imf_core::workspaces::Workspaces;

/// The CPU engine's name for people.
pub fn describe(arch: Arch) -> String {
    let set = format!("{arch:?}");
    let set = match set.split(['(', ' ']).next() {
        Some("V4") => "AVX-512",
        Some("V3") => "AVX2 and FMA",
        Some("Neon") => "NEON",
        _ => "scalar",
    };
    let threads = threads();
    format!("CPU, {threads} thread{}, {set} vectors", if threads == 1 { "" } else { "s" })
}

/// Buffers of one length, handed to whichever thread needs one; as many as threads ever worked at once.
pub struct ScratchPool {
    length: usize,
    buffers: Workspaces<Vec<f32>>,
}

impl ScratchPool {
    /// For buffers of this length.
    #[must_use]
    pub fn new(length: usize) -> Self {
        Self { length, buffers: Workspaces::default() }
    }

    /// Runs `work` with a buffer whose content is left over from earlier work.
    pub fn with<T>(&self, work: impl FnOnce(&mut [f32]) -> T) -> T {
        self.buffers.with(|buffer| {
            buffer.resize(self.length, 0.0);
            work(buffer)
        })
    }
}
