//! The poses on the way to a location.

use glam::DVec3;

use super::CheckError;
use crate::toolpath::{Location, Motion};

/// More poses than this on one motion are a slip of units.
const MOST: f64 = 1e8;

/// Evenly spaced poses of one motion, its end included, its start left to the motion before.
pub(super) struct Poses {
    motion: Motion,
    line: usize,
    count: u64,
}

impl Poses {
    /// The way to location `index`; for the first, that location alone.
    pub(super) fn to(
        locations: &[Location],
        index: usize,
        reach: f64,
        tolerance: f64,
    ) -> Result<Self, CheckError> {
        let to = locations[index];
        let motion = Motion::new(locations[index.saturating_sub(1)], to)?;
        let poses = (motion.sweep(reach) / tolerance - 1e-9).ceil().max(1.0);
        if poses > MOST {
            return Err(CheckError::TooLong { line: to.line, poses, tolerance });
        }
        Ok(Self { motion, line: to.line, count: poses as u64 })
    }

    pub(super) fn line(&self) -> usize {
        self.line
    }

    pub(super) fn len(&self) -> u64 {
        self.count
    }

    /// Tip and axis of every pose.
    pub(super) fn iter(&self) -> impl Iterator<Item = (DVec3, DVec3)> {
        (1..=self.count).map(|step| self.motion.at(step as f64 / self.count as f64))
    }
}
