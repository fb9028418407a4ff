//! A factored field answers poses as every family does.

use super::FactoredEvaluator;
use crate::field::{Field, Pose, QueryError, answer_between_centres};

/// A factored field asked for poses. Positions outside the box of the voxel centres, where nothing was taught, are
/// answered as the nearest point inside, without promise.
pub struct FactoredAnswers<'a>(pub FactoredEvaluator<'a>);

impl Field for FactoredAnswers<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let evaluator = &self.0;
        answer_between_centres(&evaluator.field.grid, poses, answers, |position, orientation, scratch| {
            evaluator.overlap(position, orientation, scratch)
        })
    }
}
