//! Which poses are held out of training.

use serde::{Deserialize, Serialize};

/// Which poses are held out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeldOutChoice {
    /// Number of poses.
    pub poses: usize,
    /// Random orientations that they are spread over.
    pub orientations: usize,
    /// Chooses orientations and voxels.
    pub seed: u64,
}

impl Default for HeldOutChoice {
    fn default() -> Self {
        Self { poses: 16_384, orientations: 64, seed: 0 }
    }
}
