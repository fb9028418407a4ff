//! Submissions: one compute pass each, and never more under way than a few.

use std::collections::VecDeque;

use imf_core::training::EngineError;

use crate::device::Gpu;

/// Submissions that may be under way: enough to keep the device busy while the host prepares the next, few enough that
/// staging memory stays small and an error shows soon.
const UNDER_WAY: usize = 8;

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
        self.under_way.push_back(gpu.queue().submit([encoder.finish()]));
        if self.under_way.len() > UNDER_WAY {
            let oldest = self.under_way.pop_front();
            gpu.wait(oldest)?;
        }
        gpu.check()
    }
}
