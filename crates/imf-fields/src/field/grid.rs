//! A field of any family at all voxel centres of its grid.

use imf_core::control::Control;
use imf_core::field::{FieldError, GridField};
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::Imf;

use super::Field;
use super::families::Kind;
use crate::harmonic::{minimum_over, sections_of};
use crate::siren::over_grid;

/// A factored field's network runs at every voxel for each call; for many calls expand it first ([`Field::expanded`]).
impl GridField for Field {
    fn grid(&self) -> &Grid {
        &self.scene().record.grid
    }

    fn sections(&self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), FieldError> {
        let voxels = self.grid().len();
        assert_eq!(values.len(), voxels * orientations.len(), "one section for each orientation");
        match self.family().kind() {
            Kind::Sum(source, _) => sections_of(source, &source.direction_weights(orientations), values),
            Kind::Network(mut network) => {
                for (orientation, section) in orientations.iter().zip(values.chunks_exact_mut(voxels)) {
                    over_grid::section(&mut network, self.grid(), orientation.angles(), section)?;
                }
            }
        }
        Ok(())
    }

    fn minimum(&self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, FieldError> {
        if orientations.is_empty() {
            return Err(FieldError::Orientations(0));
        }
        match self.family().kind() {
            Kind::Sum(source, _) => minimum_over(source, orientations, control),
            Kind::Network(mut network) => {
                let directions: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
                over_grid::minimum(&mut network, self.grid(), &directions, control)
            }
        }
    }
}
