//! What one tool reaches of a whole surface, on all threads.

use glam::{DQuat, DVec3};

use super::places::map_alike;
use super::sample_query::{Outcome, SampleQuery};
use super::{SampleReach, SurfaceError, SurfaceSample, SurfaceTool};
use crate::control::Control;
use crate::orientation::{Orientation, repeats};
use crate::pose::axis_of;

/// A direction: the tool's axis, and its rotation.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToolDirection {
    pub(super) axis: DVec3,
    pub(super) rotation: DQuat,
}

impl ToolDirection {
    pub(super) fn new(orientation: &Orientation) -> Self {
        let rotation = orientation.quaternion();
        // An orientation's quaternion has a length.
        Self { axis: axis_of(rotation).unwrap_or(DVec3::Z), rotation }
    }
}

impl SurfaceTool {
    /// Where the tip is as the tool touches the sample from a direction, clear and brought there; `None` where it cannot.
    #[must_use]
    pub fn free_tip(&self, sample: &SurfaceSample, direction: &Orientation) -> Option<DVec3> {
        let (query, turn) = (SampleQuery::new(self, sample, None), ToolDirection::new(direction));
        match self.at_best(&query, &turn, &mut [None; 2]) {
            Outcome::Good(tip) => Some(tip),
            _ => None,
        }
    }
}

/// What one tool reaches of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAccess {
    /// By sample.
    pub reach: Vec<SampleReach>,
    /// 64 directions a word, the lowest first, words of one sample side by side: set where the sample is reached.
    free: Vec<u64>,
    directions: usize,
}

impl SurfaceAccess {
    /// True where a sample is reached from a direction.
    ///
    /// # Panics
    /// If there is no such sample or direction.
    #[must_use]
    pub fn is_free(&self, sample: usize, direction: usize) -> bool {
        assert!(direction < self.directions, "no direction {direction}");
        self.free[sample * self.directions.div_ceil(64) + direction / 64] >> (direction % 64) & 1 == 1
    }

    /// True where a sample is reached from any of these directions.
    ///
    /// # Panics
    /// If there is no such sample or direction.
    #[must_use]
    pub fn is_free_from_any(&self, sample: usize, directions: &[usize]) -> bool {
        directions.iter().any(|&direction| self.is_free(sample, direction))
    }

    /// True where a sample is reached from any of these directions, 64 a word, the lowest first.
    pub(crate) fn is_free_within(&self, sample: usize, directions: &[u64]) -> bool {
        let words = self.directions.div_ceil(64);
        let own = &self.free[sample * words..(sample + 1) * words];
        own.iter().zip(directions).any(|(own, asked)| own & asked != 0)
    }

    /// Number of directions.
    #[must_use]
    pub fn directions(&self) -> usize {
        self.directions
    }
}

/// Places that share a working memory.
const CHUNK: usize = 64;

/// What a tool reaches of every sample from every direction, on all threads of the current pool; the result does not
/// depend on their number. One unit of progress is one sample.
///
/// # Errors
/// [`SurfaceError::Cancelled`] when the control asks to stop.
pub fn surface_access(
    tool: &SurfaceTool,
    samples: &[SurfaceSample],
    directions: &[Orientation],
    control: Control<'_>,
) -> Result<SurfaceAccess, SurfaceError> {
    let words = directions.len().div_ceil(64);
    let turns: Vec<ToolDirection> = directions.iter().map(ToolDirection::new).collect();
    let last = || vec![[None; 2]; turns.len()];
    let again = repeats(directions, tool.revolved().is_some());
    let found = map_alike(samples, SurfaceSample::is_tried_with, (CHUNK, control), last, |last, sample| {
        let mut free = vec![0u64; words];
        let reach = tool.reach(sample, (&turns, &again), last, |turn| free[turn / 64] |= 1 << (turn % 64));
        (reach, free)
    })?;
    let (reach, free): (Vec<SampleReach>, Vec<Vec<u64>>) = found.into_iter().unzip();
    Ok(SurfaceAccess { reach, free: free.concat(), directions: directions.len() })
}

/// Bytes that [`surface_access`] takes at the most: by sample the outcome and a row of bits with its header, twice while they are put
/// together.
#[must_use]
pub fn surface_memory_estimate(samples: usize, directions: usize) -> u64 {
    (samples as u64).saturating_mul(2 * (64 + 8 * directions.div_ceil(64) as u64))
}
