//! A factored field answers poses as every family does.

use rayon::prelude::*;

use super::{FactoredEvaluator, PointScratch};
use crate::field::{Field, Pose, QueryError, check_lengths};

/// Poses that a thread answers at a time.
const CHUNK: usize = 256;

/// A factored field asked for poses. Positions outside the box of the voxel centres, where nothing was taught, are
/// answered as the nearest point inside, without promise.
pub struct FactoredAnswers<'a>(pub FactoredEvaluator<'a>);

impl Field for FactoredAnswers<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        check_lengths(poses, answers)?;
        let evaluator = &self.0;
        let grid = &evaluator.field.grid;
        let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
        poses.par_chunks(CHUNK).zip(answers.par_chunks_mut(CHUNK)).for_each_init(
            PointScratch::default,
            |scratch, (poses, answers)| {
                for (pose, answer) in poses.iter().zip(answers) {
                    let inside = pose.position.clamp(low, high);
                    let overlap = evaluator.overlap(inside, &pose.orientation, scratch);
                    // `clamp` makes a number of what is none.
                    *answer = overlap.filter(|_| !pose.position.is_nan()).unwrap_or(f32::NAN);
                }
            },
        );
        Ok(())
    }
}
