//! What the CPU engines share beside the network: their name, and buffers for whichever thread works.

use std::ops::{Deref, DerefMut, Range};

use pulp::Arch;

use crate::parallel::threads;
use imf_core::workspaces::Workspaces;

/// Bytes of a cache line.
const LINE: usize = 64;

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
    buffers: Workspaces<Lines<f32>>,
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
            buffer.resize(self.length);
            work(buffer)
        })
    }
}

/// Values that begin at a cache line, as vectors and tiles of the CPU are fastest there.
#[derive(Default)]
pub struct Lines<T> {
    values: Vec<T>,
    range: Range<usize>,
}

impl<T: Copy + Default> Lines<T> {
    /// `length` zeros.
    #[must_use]
    pub fn new(length: usize) -> Self {
        let mut lines = Self::default();
        lines.resize(length);
        lines
    }

    /// Makes them as many where they are fewer.
    pub(crate) fn resize_to_at_least(&mut self, length: usize) {
        if self.range.len() < length {
            self.resize(length);
        }
    }

    /// Resizes to `length`; all are zeros where it changes.
    fn resize(&mut self, length: usize) {
        if self.range.len() != length {
            self.values = vec![T::default(); length + LINE];
            let start = self.values.as_ptr().align_offset(LINE);
            self.range = start..start + length;
        }
    }
}

impl<T> Deref for Lines<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[self.range.clone()]
    }
}

impl<T> DerefMut for Lines<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.range.clone()]
    }
}
