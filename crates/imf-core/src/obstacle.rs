//! The obstacle of every exact query: forbidden voxels, and a layer that the cutter may enter.

use std::sync::Arc;

use crate::grid::Grid;
use crate::occupancy::Occupancy;

/// Solid voxels: those that no point of the tool may enter, and a layer that its cutter may. Cloning it copies no voxel.
///
/// The overlap of a pose counts forbidden voxels in the whole tool, and cuttable ones in shank and holder
/// ([`Assembly`](crate::tool::Assembly)). Space outside the grid is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// What no point of the tool may enter.
    pub forbidden: Arc<Occupancy>,
    /// What the cutter may enter, and shank and holder may not: on the same grid, none of it forbidden.
    pub cuttable: Option<Arc<Occupancy>>,
}

impl Obstacle {
    /// A whole obstacle of which the cutter may enter a layer ([`Bodies::layer`](crate::scene::Bodies::layer)).
    #[must_use]
    pub fn with_cuttable(whole: &Occupancy, layer: Occupancy) -> Self {
        let mut forbidden = whole.clone();
        forbidden.solid.iter_mut().zip(&layer.solid).for_each(|(solid, &cuttable)| *solid &= 1 - cuttable);
        Self { forbidden: Arc::new(forbidden), cuttable: Some(Arc::new(layer)) }
    }

    /// True where both are bytes of 0 or 1 for each voxel of one grid.
    pub(crate) fn is_sound(&self) -> bool {
        let of_layer = |layer: &Occupancy| layer.is_sound() && layer.grid == *self.grid();
        self.forbidden.is_sound() && self.cuttable.as_deref().is_none_or(of_layer)
    }

    /// Forbidden and cuttable voxels together.
    #[must_use]
    pub fn whole(&self) -> Occupancy {
        let mut whole = Occupancy::clone(&self.forbidden);
        if let Some(cuttable) = &self.cuttable {
            whole.add(cuttable);
        }
        whole
    }

    /// The grid of its voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.forbidden.grid
    }
}

impl From<Arc<Occupancy>> for Obstacle {
    fn from(forbidden: Arc<Occupancy>) -> Self {
        Self { forbidden, cuttable: None }
    }
}

impl From<Occupancy> for Obstacle {
    fn from(forbidden: Occupancy) -> Self {
        Arc::new(forbidden).into()
    }
}

impl From<&Occupancy> for Obstacle {
    fn from(forbidden: &Occupancy) -> Self {
        forbidden.clone().into()
    }
}

impl From<&Self> for Obstacle {
    fn from(obstacle: &Self) -> Self {
        obstacle.clone()
    }
}
