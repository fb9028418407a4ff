//! Submissions: never more under way than a few; and many small passes in one of them.

use std::sync::PoisonError;

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::kernel::Dispatch;
use crate::uniforms::Batch;

/// Submissions that may be under way: enough to keep the device busy while the host prepares the next, few enough that
/// staging memory stays small and an error shows soon.
const UNDER_WAY: usize = 8;
/// Passes of one submission: with thousands in one encoder every later submission becomes slow.
pub(crate) const PASSES_AT_ONCE: usize = 32;

impl Gpu {
    /// A batch of `rows` rows, rounded up to what the matrix kernel works in.
    pub(crate) fn batch_of(&self, rows: usize) -> Batch {
        Batch::of_rows(rows, self.matrix_kernel().padding())
    }

    /// Submits one pass of dispatches for the rows at hand.
    pub(crate) fn run<'a>(
        &self,
        dispatches: impl IntoIterator<Item = &'a Dispatch>,
        batch: Batch,
    ) -> Result<(), EngineError> {
        let mut encoder = self.encoder();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        dispatches.into_iter().for_each(|dispatch| dispatch.record(&mut pass, batch));
        drop(pass);
        self.submit(encoder)
    }

    /// Submits a copy from the beginning of one buffer to that of another, of as much as either holds.
    pub(crate) fn copy(&self, from: &wgpu::Buffer, to: &wgpu::Buffer) -> Result<(), EngineError> {
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size().min(to.size()));
        self.submit(encoder)
    }

    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Submits; waits for the oldest submission if too many are under way.
    fn submit(&self, encoder: wgpu::CommandEncoder) -> Result<(), EngineError> {
        let submission = self.queue().submit([encoder.finish()]);
        let oldest = {
            let mut under_way = self.under_way.lock().unwrap_or_else(PoisonError::into_inner);
            under_way.push_back(submission);
            if under_way.len() > UNDER_WAY { under_way.pop_front() } else { None }
        };
        match oldest {
            Some(_) => self.wait(oldest),
            None => self.check(),
        }
    }
}

/// Passes with what the host writes before each, gathered into one submission: the host's data goes up in one piece and
/// is copied to its buffers between the passes.
#[derive(Debug)]
pub(crate) struct Recorder {
    gpu: Gpu,
    upload: wgpu::Buffer,
    staged: Vec<u8>,
    passes: usize,
    encoder: Option<wgpu::CommandEncoder>,
}

impl Recorder {
    /// With a buffer for the host's data; it holds at least what one pass needs.
    pub(crate) fn new(gpu: &Gpu, upload: wgpu::Buffer) -> Self {
        Self { gpu: gpu.clone(), upload, staged: Vec::new(), passes: 0, encoder: None }
    }

    /// Adds a pass, before which `writes` stand at the beginning of their buffers. Lengths are multiples of four.
    pub(crate) fn pass(
        &mut self,
        writes: &[(&wgpu::Buffer, &[u8])],
        record: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) -> Result<(), EngineError> {
        let bytes: usize = writes.iter().map(|(_, data)| data.len()).sum();
        if self.passes == PASSES_AT_ONCE || (self.staged.len() + bytes) as u64 > self.upload.size() {
            self.submit()?;
        }
        let encoder = self.encoder.get_or_insert_with(|| self.gpu.encoder());
        for (buffer, data) in writes {
            let offset = self.staged.len() as u64;
            self.staged.extend_from_slice(data);
            encoder.copy_buffer_to_buffer(&self.upload, offset, buffer, 0, data.len() as u64);
        }
        record(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        self.passes += 1;
        Ok(())
    }

    /// Submits what was added, without waiting for it.
    pub(crate) fn submit(&mut self) -> Result<(), EngineError> {
        let Some(encoder) = self.encoder.take() else { return Ok(()) };
        // In the queue's order: what was submitted before has read its own data by then.
        self.gpu.write(&self.upload, &self.staged);
        self.staged.clear();
        self.passes = 0;
        self.gpu.submit(encoder)
    }
}
