//! One interface for every family of fields: values at poses, on the grid or off it.
//!
//! `query` answers "does the tool collide when its tip is *here*": `overlap(x, R)` in [0, 1]. The collision measure
//! of a tool with other sharp points is the least of `overlap(x − R k, R)` over them: [`collision_measures`].

mod exact;
mod scene;
mod whole;

pub use exact::ExactField;
pub use scene::SceneField;
pub use whole::WholeField;

use glam::DVec3;
use rayon::prelude::*;
use thiserror::Error;

use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::tool::ToolError;

/// Where the tool's tip is, in world units, and how the tool is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World position of the tip.
    pub position: DVec3,
    /// Orientation of the tool.
    pub orientation: Orientation,
}

impl Pose {
    /// True where every number is finite. An invalid pose is never free: its value is NaN, and it collides.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let Orientation { theta, phi, roll } = self.orientation;
        self.position.is_finite() && [theta, phi, roll].iter().all(|angle| angle.is_finite())
    }
}

/// Why an engine stopped; the state it had before is with the caller's last checkpoint.
#[derive(Debug, Error)]
pub enum EngineError {
    /// The device is gone or out of memory, or a call to it failed.
    #[error("{0}")]
    Device(String),
    /// A batch, a shape or a state that does not fit.
    #[error("{0}")]
    Shape(String),
}

/// Why poses cannot be answered.
#[derive(Debug, Error)]
pub enum QueryError {
    /// As many answers as poses are needed.
    #[error("{poses} poses need as many places for answers, not {answers}")]
    Length {
        /// Poses asked.
        poses: usize,
        /// Places given.
        answers: usize,
    },
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Cancelled,
}

/// A family of fields: exact, or learnt.
pub trait Field {
    /// `overlap(x, R)` of every pose into `answers`.
    ///
    /// # Errors
    /// Lengths that differ, or a family's own failure.
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError>;
}

/// Collision measures: the least overlap over sharp points `k` (tool frame) at `x − R k`.
///
/// # Errors
/// As [`Field::query`].
pub fn collision_measures(
    field: &mut dyn Field,
    sharp_points: &[DVec3],
    poses: &[Pose],
    answers: &mut [f32],
) -> Result<(), QueryError> {
    check_lengths(poses, answers)?;
    answers.fill(f32::INFINITY);
    let mut overlaps = vec![0.0; poses.len()];
    for &sharp in sharp_points {
        let shifted: Vec<Pose> = poses
            .iter()
            .map(|pose| Pose { position: pose.position - pose.orientation.rotation() * sharp, ..*pose })
            .collect();
        field.query(&shifted, &mut overlaps)?;
        for (answer, &overlap) in answers.iter_mut().zip(&overlaps) {
            *answer = answer.min(overlap);
        }
    }
    Ok(())
}

/// Poses that a thread answers at a time.
const CHUNK: usize = 256;

/// Answers poses of a field that is known between the voxel centres of `grid`: positions outside are answered as the
/// nearest point inside, without promise, and with no number where they are none.
pub fn answer_between_centres<S: Default>(
    grid: &Grid,
    poses: &[Pose],
    answers: &mut [f32],
    overlap: impl Fn(DVec3, &Orientation, &mut S) -> Option<f32> + Sync,
) -> Result<(), QueryError> {
    check_lengths(poses, answers)?;
    poses.par_chunks(CHUNK).zip(answers.par_chunks_mut(CHUNK)).for_each_init(
        S::default,
        |scratch, (poses, answers)| {
            for (pose, answer) in poses.iter().zip(answers) {
                let position = grid.nearest_between_centres(pose.position);
                *answer = overlap(position, &pose.orientation, scratch).unwrap_or(f32::NAN);
            }
        },
    );
    Ok(())
}

/// That there are as many places for answers as poses.
///
/// # Errors
/// [`QueryError::Length`]: there are not.
pub fn check_lengths(poses: &[Pose], answers: &[f32]) -> Result<(), QueryError> {
    if poses.len() == answers.len() {
        Ok(())
    } else {
        Err(QueryError::Length { poses: poses.len(), answers: answers.len() })
    }
}
