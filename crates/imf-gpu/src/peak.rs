//! What a device does at most in f32 by its ordinary units: fused multiply-adds and nothing else.

use std::time::Instant;

use imf_core::field::EngineError;

use crate::device::Gpu;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::allocate;
use crate::shader::{LINEAR_GROUP, Shader};
use crate::uniforms::{Batch, Turns};

/// Invocations: several times what a large GPU holds at once.
const INVOCATIONS: usize = 1 << 20;
/// First number of turns of an invocation (some milliseconds on a software device), and the maximum (some tens of
/// milliseconds on a large GPU, and below the number at which Mesa's software Vulkan ends loops).
const TURNS: [u32; 2] = [1 << 3, 1 << 14];
/// Chains of an invocation, and multiply-adds of a turn.
const CHAINS: u32 = 32;
const MULTIPLY_ADDS: u32 = 64;
/// Operations of a multiply-add.
const OPERATIONS: f64 = 2.0;

/// Measures it.
pub struct Peak {
    gpu: Gpu,
    kernel: Dispatch,
    turns: wgpu::Buffer,
    sums: wgpu::Buffer,
}

impl Peak {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// [`EngineError::Device`] for too little memory, or a device that failed.
    pub fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        let [sums] = allocate(gpu, [("sums", INVOCATIONS)])?;
        let turns = uniform(gpu, "turns", &Turns::default())?;
        // One invocation for each, whatever the limit of a kernel that strides.
        let kernel =
            Kernel::new(gpu, Shader::MultiplyAdds)?.bind(Extent::Sliced(INVOCATIONS), &[&turns, &sums]);
        Ok(Self { gpu: gpu.clone(), kernel, turns, sums })
    }

    /// Operations a second, a multiply-add counting as two: the best of ever longer runs, for `seconds` seconds
    /// together. Waits for the device.
    ///
    /// # Errors
    /// A device that failed, or that did not do its work.
    pub fn measure(&mut self, seconds: f64) -> Result<f64, EngineError> {
        let [mut count, most] = TURNS;
        let (mut best, begun) = (0.0f64, Instant::now());
        while best == 0.0 || begun.elapsed().as_secs_f64() < seconds {
            let spent = self.run(&Turns { count, factor: 1.0, summand: 1.0 })?;
            self.require(count)?;
            let operations = INVOCATIONS as f64 * f64::from(count * MULTIPLY_ADDS) * OPERATIONS;
            best = best.max(operations / spent);
            count = (2 * count).min(most);
        }
        Ok(best)
    }

    /// Seconds that `turns` take.
    fn run(&mut self, turns: &Turns) -> Result<f64, EngineError> {
        self.gpu.write(&self.turns, &[*turns]);
        let begun = Instant::now();
        self.gpu.run([&self.kernel], Batch { slices: 1, ..Batch::default() })?;
        self.gpu.wait(None)?;
        Ok(begun.elapsed().as_secs_f64())
    }

    /// Refuses sums that are not those of `turns` turns.
    fn require(&self, turns: u32) -> Result<(), EngineError> {
        // Whole numbers below 2²⁴, which f32 has.
        let starts = CHAINS * (CHAINS - 1) / 2;
        let sum = |invocation: u32| starts + CHAINS * (invocation % LINEAR_GROUP) + turns * MULTIPLY_ADDS;
        let found = self.gpu.read::<f32>(&self.sums, INVOCATIONS)?;
        if found.iter().zip(0..).all(|(&found, invocation)| found == sum(invocation) as f32) {
            return Ok(());
        }
        Err(EngineError::Device(format!(
            "{} did not do its multiply-adds: update its driver or choose another adapter",
            self.gpu.adapter().name
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapter::DeviceChoice;

    #[test]
    #[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
    fn every_multiply_add_is_done() {
        let gpu = Gpu::open(&DeviceChoice::Any).unwrap();
        let mut peak = Peak::new(&gpu).unwrap();
        assert!(peak.measure(0.1).unwrap() > 0.0);
        peak.run(&Turns { count: 5, factor: 1.0, summand: 1.0 }).unwrap();
        peak.require(5).unwrap();
        assert!(peak.require(4).unwrap_err().to_string().contains("did not do its multiply-adds"));
        // Chains of one invocation start at 0 to 31, those of the next at 1 to 32; a factor acts on each.
        peak.run(&Turns { count: 0, factor: 1.0, summand: 1.0 }).unwrap();
        assert_eq!(peak.gpu.read::<f32>(&peak.sums, 2).unwrap(), [496.0, 528.0]);
        peak.run(&Turns { count: 1, factor: 2.0, summand: 0.0 }).unwrap();
        assert_eq!(peak.gpu.read::<f32>(&peak.sums, 2).unwrap(), [4.0 * 496.0, 4.0 * 528.0]);
    }
}
