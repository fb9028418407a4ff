//! The interface of whatever evaluates a network in batches: the CPU, or a GPU.

use imf_core::field::EngineError;

/// Where a trained network is evaluated in batches.
pub trait EvaluationEngine {
    /// The engine's name for people: device, driver, threads.
    fn describe(&self) -> String;

    /// Values of the network at `inputs` (`[n][5]`, any n) into `outputs` (`[n]`).
    ///
    /// # Errors
    /// Lengths that do not fit, or a device that failed.
    fn evaluate(&mut self, inputs: &[f32], outputs: &mut [f32]) -> Result<(), EngineError>;

    /// About how many values to compute between two checks for cancellation: some seconds' work of a large network.
    fn values_at_once(&self) -> usize {
        1 << 18
    }

    /// For each point the minimum over all directions and the index of the first direction that attains it.
    ///
    /// `points` is `[n][3]` in unit coordinates of the grid, `directions` is `[m][2]` in degrees (θ, φ); `least` and
    /// `best` are `[n]`. The minimum is taken where the network runs: memory does not grow with n·m.
    ///
    /// # Errors
    /// Lengths that do not fit, no direction, or a device that failed.
    fn minimum(
        &mut self,
        points: &[[f32; 3]],
        directions: &[[f32; 2]],
        least: &mut [f32],
        best: &mut [u32],
    ) -> Result<(), EngineError>;
}
