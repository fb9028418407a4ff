//! A harmonic field answers poses as every family does.

use super::HarmonicField;
use crate::field::{Field, Pose, QueryError, answer_between_centres};

/// A harmonic field asked for poses. Positions outside the box of the voxel centres, where it knows nothing, are answered
/// as the nearest point inside, without promise.
pub struct HarmonicAnswers<'a>(pub &'a HarmonicField);

impl Field for HarmonicAnswers<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let field = self.0;
        answer_between_centres(&field.grid, poses, answers, |position, orientation, scratch| {
            field.overlap(position, orientation, scratch)
        })
    }
}
