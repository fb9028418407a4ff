//! What of the stock is left beside the part, and how far from it.

use super::StockReport;
use crate::distance::DistanceField;
use crate::occupancy::Occupancy;

/// The stock that is still to be cut. Lengths in the grid's unit, places in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StockLeft {
    /// Voxels of it.
    pub voxels: u64,
    /// How far from the part its farthest centre is from the nearest centre of the part; `None` where the part has no voxel, or
    /// nothing is left.
    pub farthest: Option<f64>,
    /// That centre; the first of equals.
    pub place: [f64; 3],
}

impl StockReport {
    /// Compares what is left with the part.
    ///
    /// # Panics
    /// If the part's voxels are not those that the stock was followed with.
    #[must_use]
    pub fn left_beside(&self, part: &Occupancy) -> StockLeft {
        let grid = &self.remaining.grid;
        let part = part.on(grid).expect("the part lies on the voxels of the stock");
        let distances = DistanceField::new(&part);
        let beside = (0..grid.len()).filter(|&v| self.remaining.solid[v] == 1 && part.solid[v] == 0);
        let mut left = StockLeft { voxels: 0, farthest: None, place: [f64::NAN; 3] };
        let mut most = None;
        for voxel in beside {
            left.voxels += 1;
            let squared = distances.squared(voxel);
            if squared > most {
                most = squared;
                left.place = grid.centre(grid.voxel(voxel)).to_array();
            }
        }
        left.farthest = most.map(|squared| (squared as f64).sqrt() * grid.pitch);
        left
    }
}
