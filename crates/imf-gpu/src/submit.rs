//! Submissions: never more under way than a few; and many small passes in one of them.

use std::collections::VecDeque;

use imf_core::field::EngineError;

use crate::device::Gpu;

/// Submissions that may be under way: enough to keep the device busy while the host prepares the next, few enough that
/// staging memory stays small and an error shows soon.
const UNDER_WAY: usize = 8;
/// Passes of one submission: with thousands in one encoder every later submission becomes slow.
pub(crate) const PASSES_AT_ONCE: usize = 32;

/// What has been submitted and not been waited for.
#[derive(Debug, Default)]
pub(crate) struct Submissions {
    under_way: VecDeque<wgpu::SubmissionIndex>,
}

impl Submissions {
    /// Records one pass and submits it; waits for the oldest submission if too many are under way.
    pub(crate) fn pass(
        &mut self,
        gpu: &Gpu,
        record: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) -> Result<(), EngineError> {
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        record(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        self.submit(gpu, encoder)
    }

    /// Submits a copy from the beginning of one buffer to that of another, of as much as either holds.
    pub(crate) fn copy(
        &mut self,
        gpu: &Gpu,
        from: &wgpu::Buffer,
        to: &wgpu::Buffer,
    ) -> Result<(), EngineError> {
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size().min(to.size()));
        self.submit(gpu, encoder)
    }

    fn submit(&mut self, gpu: &Gpu, encoder: wgpu::CommandEncoder) -> Result<(), EngineError> {
        self.under_way.push_back(gpu.queue().submit([encoder.finish()]));
        if self.under_way.len() > UNDER_WAY {
            let oldest = self.under_way.pop_front();
            gpu.wait(oldest)?;
        }
        gpu.check()
    }
}

/// Passes with what the host writes before each, gathered into one submission: the host's data goes up in one piece and
/// is copied to its buffers between the passes.
#[derive(Debug)]
pub(crate) struct Recorder {
    submissions: Submissions,
    upload: wgpu::Buffer,
    staged: Vec<u8>,
    passes: usize,
    encoder: Option<wgpu::CommandEncoder>,
}

impl Recorder {
    /// With a buffer for the host's data; it holds at least what one pass needs.
    pub(crate) fn new(upload: wgpu::Buffer) -> Self {
        Self { submissions: Submissions::default(), upload, staged: Vec::new(), passes: 0, encoder: None }
    }

    /// Adds a pass, before which `writes` stand at the beginning of their buffers. Lengths are multiples of four.
    pub(crate) fn pass(
        &mut self,
        gpu: &Gpu,
        writes: &[(&wgpu::Buffer, &[u8])],
        record: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) -> Result<(), EngineError> {
        let bytes: usize = writes.iter().map(|(_, data)| data.len()).sum();
        if self.passes == PASSES_AT_ONCE || (self.staged.len() + bytes) as u64 > self.upload.size() {
            self.submit(gpu)?;
        }
        let encoder = self.encoder.get_or_insert_with(|| {
            gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
        });
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
    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), EngineError> {
        let Some(encoder) = self.encoder.take() else { return Ok(()) };
        // In the queue's order: what was submitted before has read its own data by then.
        gpu.queue().write_buffer(&self.upload, 0, &self.staged);
        self.staged.clear();
        self.passes = 0;
        self.submissions.submit(gpu, encoder)
    }
}
