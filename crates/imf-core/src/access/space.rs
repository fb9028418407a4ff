//! The space around the part, divided into what some pose reaches and what none does.

use serde::Serialize;

use super::{Component, Components, components};
use crate::occupancy::Occupancy;

/// A number of voxels and what they measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Volume {
    /// Voxels.
    pub voxels: usize,
    /// Volume in cubic units of the grid.
    pub volume: f64,
}

impl Volume {
    /// So many voxels of this volume each.
    #[must_use]
    pub fn new(voxels: usize, voxel_volume: f64) -> Self {
        Self { voxels, volume: voxels as f64 * voxel_volume }
    }
}

/// The empty voxels of a grid, reached and not reached, with their connected pieces.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Pieces of the empty voxels whose measure is at most τ.
    pub accessible: Components,
    /// Pieces of the other empty voxels.
    pub inaccessible: Components,
    /// Volume of one voxel.
    voxel_volume: f64,
}

impl Space {
    /// Divides the empty voxels of `obstacle` by the inaccessibility measure on its grid.
    ///
    /// # Panics
    /// If `imf` has not the grid's length.
    #[must_use]
    pub fn new(obstacle: &Occupancy, imf: &[f32], tau: f64) -> Self {
        assert_eq!(imf.len(), obstacle.grid.len(), "one value for each voxel of the grid");
        let empty = |v: usize| obstacle.solid[v] == 0;
        let reached = |v: usize| f64::from(imf[v]) <= tau;
        Self {
            accessible: components(&obstacle.grid, |v| empty(v) && reached(v)),
            inaccessible: components(&obstacle.grid, |v| empty(v) && !reached(v)),
            voxel_volume: obstacle.grid.voxel_volume(),
        }
    }

    /// What some pose reaches.
    #[must_use]
    pub fn accessible_volume(&self) -> Volume {
        self.volume(&self.accessible.pieces)
    }

    /// What none reaches.
    #[must_use]
    pub fn inaccessible_volume(&self) -> Volume {
        self.volume(&self.inaccessible.pieces)
    }

    fn volume(&self, pieces: &[Component]) -> Volume {
        Volume::new(pieces.iter().map(|piece| piece.voxels).sum(), self.voxel_volume)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::tests::slotted;

    #[test]
    fn solid_voxels_belong_to_neither_even_below_the_threshold() {
        let obstacle = slotted();
        let imf: Vec<f32> = (0..obstacle.grid.len()).map(|i| if i % 3 == 0 { 0.0 } else { 0.2 }).collect();
        let space = Space::new(&obstacle, &imf, 0.1);
        let empty = obstacle.grid.len() - obstacle.count();
        let (reached, not) = (space.accessible_volume(), space.inaccessible_volume());
        assert_eq!(reached.voxels + not.voxels, empty);
        assert_eq!(reached.volume, reached.voxels as f64);
        let either = space.accessible.labels.iter().zip(&space.inaccessible.labels);
        assert!(
            either
                .zip(&obstacle.solid)
                .all(|((a, b), &s)| u32::from(*a > 0) + u32::from(*b > 0) + u32::from(s) == 1)
        );
    }
}
