//! A field at all voxel centres of its grid at once: what comparing it with exact sections takes of it.

use super::QueryError;
use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::Imf;

/// A family of fields over a whole grid.
pub trait WholeField {
    /// The collision measure at every voxel centre in one orientation, C-ordered into `values`.
    ///
    /// # Errors
    /// A family's own failure.
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError>;

    /// The same in some orientations, `[orientation][voxel]` into `values`; families that have a faster way than one by one take it.
    ///
    /// # Errors
    /// A family's own failure.
    ///
    /// # Panics
    /// If `values` has not as many sections.
    fn sections_at(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), QueryError> {
        let Some(voxels) = values.len().checked_div(orientations.len()) else { return Ok(()) };
        assert_eq!(voxels * orientations.len(), values.len(), "one section for each orientation");
        let mut sections = values.chunks_exact_mut(voxels.max(1));
        orientations
            .iter()
            .zip(&mut sections)
            .try_for_each(|(orientation, section)| self.section_at(orientation, section))
    }

    /// The least over some orientations at every voxel centre, with the index of the first orientation that has it. One unit of progress
    /// is one value, of a voxel in an orientation.
    ///
    /// # Errors
    /// A family's own failure; [`QueryError::Cancelled`] when the control asks to stop.
    fn least_over(&mut self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, QueryError>;
}
