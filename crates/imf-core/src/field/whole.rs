//! A field at all voxel centres of its grid at once: what comparing it with exact sections takes of it.

use super::{LearntField, QueryError};
use crate::orientation::Orientation;
use crate::section::Imf;

/// A family of fields over a whole grid.
pub trait WholeField {
    /// The collision measure at every voxel centre in one orientation, C-ordered into `values`.
    ///
    /// # Errors
    /// A family's own failure.
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError>;

    /// The least over some orientations at every voxel centre, with the index of the first orientation that has it.
    ///
    /// # Errors
    /// A family's own failure.
    fn least_over(&mut self, orientations: &[Orientation]) -> Result<Imf, QueryError>;
}

impl WholeField for LearntField<'_> {
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError> {
        self.section(orientation.angles(), values)
    }

    fn least_over(&mut self, orientations: &[Orientation]) -> Result<Imf, QueryError> {
        let directions: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
        let (value, best) = self.imf(&directions)?;
        Ok(Imf { value, best })
    }
}
