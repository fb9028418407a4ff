//! Cavities that part and fixtures close off on all sides: no tool reaches their walls.

use glam::DVec3;
use imf_core::access::{Components, components};
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;

/// How far outside the surface its empty voxel is looked up, in pitches.
const OUTSIDE: f64 = 0.75;

/// The pieces of the empty voxels.
pub(super) struct Cavities<'a> {
    solid: &'a Occupancy,
    empty: Components,
}

impl<'a> Cavities<'a> {
    pub(super) fn of(solid: &'a Occupancy) -> Self {
        Self { solid, empty: components(&solid.grid, |voxel| solid.solid[voxel] == 0) }
    }

    /// Whether the surface at a point, with its outward normal, is a wall of a closed one: of the empty voxels before it each is.
    pub(super) fn closes_off(&self, point: DVec3, normal: DVec3) -> bool {
        let grid = &self.solid.grid;
        let before = voxels_around(grid, point + OUTSIDE * grid.pitch * normal);
        let labels = before.map(|voxel| self.empty.labels[voxel]);
        let mut pieces = labels.filter(|&label| label > 0).peekable();
        pieces.peek().is_some() && pieces.all(|label| self.is_closed(label))
    }

    /// Whether a piece stays clear of the grid's border.
    fn is_closed(&self, label: u32) -> bool {
        self.empty.pieces[label as usize - 1].is_inside(self.solid.grid.dims)
    }
}

/// The voxel that holds a point, and the 26 around it, as far as they lie in the grid.
pub(super) fn voxels_around(grid: &Grid, point: DVec3) -> impl Iterator<Item = usize> {
    let middle = grid.continuous(point).round();
    let around = (0..27).map(move |n| middle + DVec3::from([n / 9, n / 3 % 3, n % 3].map(f64::from)) - 1.0);
    around.filter_map(move |voxel| grid.index_at(voxel))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_inside_is_closed_off_and_a_pocket_is_not() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 2.0, dims: [10; 3] };
        let at = |pocket: bool| {
            let mut solid = Occupancy::empty(grid);
            for index in 0..grid.len() {
                let [x, y, z] = grid.voxel(index);
                let block = [x, y, z].iter().all(|v| (1..9).contains(v));
                let hollow = [x, y].iter().all(|v| (4..6).contains(v))
                    && (4..if pocket { 10 } else { 6 }).contains(&z);
                solid.solid[index] = u8::from(block && !hollow);
            }
            Cavities::of(&solid).closes_off(DVec3::new(10.0, 10.0, 8.0), DVec3::Z)
        };
        assert!(at(false) && !at(true));
    }
}
