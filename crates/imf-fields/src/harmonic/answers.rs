//! A harmonic field answers poses and whole grids as every family does.

use super::{HarmonicField, least_of};
use imf_core::control::Control;
use imf_core::field::{Field, Pose, QueryError, WholeField, answer_between_centres};
use imf_core::orientation::Orientation;
use imf_core::section::Imf;

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

impl WholeField for HarmonicAnswers<'_> {
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError> {
        self.sections_at(&[*orientation], values)
    }

    fn sections_at(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), QueryError> {
        self.0.sections(&self.0.heads(orientations), values);
        Ok(())
    }

    fn least_over(&mut self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, QueryError> {
        least_of(self.0, |some| self.0.heads(some), orientations, control)
    }
}
