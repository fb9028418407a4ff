//! A factored field answers poses and whole grids as every family does.

use super::FactoredEvaluator;
use crate::harmonic::least_of;
use imf_core::control::Control;
use imf_core::field::{Field, Pose, QueryError, WholeField, answer_between_centres};
use imf_core::orientation::Orientation;
use imf_core::section::Imf;

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

/// The network runs at every voxel for each call; whoever calls often has the coefficients of all voxels kept
/// ([`FactoredEvaluator::expanded`]).
impl WholeField for FactoredAnswers<'_> {
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError> {
        self.sections_at(&[*orientation], values)
    }

    fn sections_at(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), QueryError> {
        self.0.sections(&self.0.field().heads(orientations), values);
        Ok(())
    }

    fn least_over(&mut self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, QueryError> {
        least_of(&self.0, |some| self.0.field().heads(some), orientations, control)
    }
}
