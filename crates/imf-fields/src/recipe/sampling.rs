//! How many voxels of a section are sampled, and from where.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How many voxels of each section are sampled, and from where. The defaults are the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampling {
    /// Share of a section's voxels that is sampled, in (0, 1].
    pub density: f64,
    /// Share of the samples that is drawn where CMF > 0, in [0, 1].
    pub positive_share: f64,
    /// Share of the samples that is drawn at the boundary, in [0, 1]; `positive_share` divides the rest, and 0 is the
    /// paper's sampling.
    #[serde(skip_serializing_if = "is_zero")]
    pub boundary_share: f64,
    /// How far from the boundary still counts as at it, in voxels; idle where `boundary_share` is 0.
    #[serde(skip_serializing_if = "is_one")]
    pub boundary_width: usize,
    /// Seed; with the section's index it fixes the section's samples.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { density: 0.35, positive_share: 0.75, boundary_share: 0.0, boundary_width: 1, seed: 0 }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_one(width: &usize) -> bool {
    *width == 1
}

/// Widest boundary: beyond it the window is larger than any grid that can be sampled.
const WIDEST: usize = 4096;

/// A share that is out of range.
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
    /// Checks the shares.
    ///
    /// # Errors
    /// The share that is out of range.
    pub fn check(&self) -> Result<(), SamplingError> {
        if !(self.density > 0.0 && self.density <= 1.0) {
            return Err(SamplingError {
                name: "density",
                range: "above 0 and at most 1",
                value: self.density,
            });
        }
        for (name, value) in
            [("positive share", self.positive_share), ("boundary share", self.boundary_share)]
        {
            if !(0.0..=1.0).contains(&value) {
                return Err(SamplingError { name, range: "from 0 to 1", value });
            }
        }
        if !(1..=WIDEST).contains(&self.boundary_width) {
            let value = self.boundary_width as f64;
            return Err(SamplingError { name: "boundary width", range: "from 1 to 4096 voxels", value });
        }
        Ok(())
    }

    /// How many samples a section of that many voxels gives.
    #[must_use]
    pub fn count(&self, voxels: usize) -> usize {
        ((voxels as f64 * self.density).round() as usize).clamp(1, voxels.max(1))
    }
}
