//! How many voxels of a section are sampled, and from where.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How many voxels of each section are sampled, and from where. The defaults are the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampling {
    /// Fraction of a section's voxels that is sampled, in (0, 1].
    pub density: f64,
    /// Fraction of the samples that is drawn where CMF > 0, in [0, 1].
    pub positive_fraction: f64,
    /// Seed; with the section's index it fixes the section's samples.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { density: 0.35, positive_fraction: 0.75, seed: 0 }
    }
}

/// A fraction that is out of range.
#[derive(Debug, Error, PartialEq)]
#[error("the sampling {name} must be {range}, not {value}")]
pub struct SamplingError {
    /// Which number.
    pub name: &'static str,
    /// What it may be.
    pub range: &'static str,
    /// What it is.
    pub value: f64,
}

impl Sampling {
    /// Checks the fractions.
    ///
    /// # Errors
    /// The fraction that is out of range.
    pub fn check(&self) -> Result<(), SamplingError> {
        let refuse = |name, range, value| Err(SamplingError { name, range, value });
        if !(self.density > 0.0 && self.density <= 1.0) {
            return refuse("density", "above 0 and at most 1", self.density);
        }
        if !(0.0..=1.0).contains(&self.positive_fraction) {
            return refuse("positive fraction", "from 0 to 1", self.positive_fraction);
        }
        Ok(())
    }

    /// How many samples a section of that many voxels gives.
    #[must_use]
    pub fn count(&self, voxels: usize) -> usize {
        ((voxels as f64 * self.density).round() as usize).clamp(1, voxels.max(1))
    }
}
