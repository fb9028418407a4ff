//! Connected components of a set of voxels under face adjacency (6-connectivity).

use serde::Serialize;

use crate::grid::Grid;
use crate::occupancy::Occupancy;

/// One connected component.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Component {
    /// Number of its voxels.
    pub voxels: usize,
    /// Lowest voxel of its box along each axis.
    pub lower: [usize; 3],
    /// Highest voxel of its box along each axis.
    pub upper: [usize; 3],
}

impl Component {
    /// Whether it stays clear of the border of a grid of these dimensions.
    #[must_use]
    pub fn is_inside(&self, dims: [usize; 3]) -> bool {
        (0..3).all(|axis| self.lower[axis] > 0 && self.upper[axis] + 1 < dims[axis])
    }
}

/// The pieces of a set, the largest first (of equals the one that holds the lowest voxel index).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Components {
    /// The pieces; label `n` is entry `n − 1`.
    pub pieces: Vec<Component>,
    /// For every voxel 0 outside the set, else its piece's label from 1.
    pub labels: Vec<u32>,
}

impl Components {
    /// Number of voxels in all pieces.
    #[must_use]
    pub fn voxels(&self) -> usize {
        self.pieces.iter().map(|piece| piece.voxels).sum()
    }
}

/// Finds the pieces of the voxels for which `inside` is true, by index.
#[must_use]
pub fn components(grid: &Grid, inside: impl Fn(usize) -> bool) -> Components {
    const WAITING: u32 = u32::MAX;
    let mut labels: Vec<u32> = (0..grid.len()).map(|v| if inside(v) { WAITING } else { 0 }).collect();
    let [nx, ny, nz] = grid.dims;
    let mut pieces = Vec::new();
    let mut stack = Vec::new();
    for seed in 0..labels.len() {
        if labels[seed] != WAITING {
            continue;
        }
        let label = pieces.len() as u32 + 1;
        let first = grid.voxel(seed);
        let mut piece = Component { voxels: 0, lower: first, upper: first };
        labels[seed] = label;
        stack.push(seed);
        while let Some(index) = stack.pop() {
            let voxel = grid.voxel(index);
            piece.voxels += 1;
            for axis in 0..3 {
                piece.lower[axis] = piece.lower[axis].min(voxel[axis]);
                piece.upper[axis] = piece.upper[axis].max(voxel[axis]);
            }
            let [x, y, z] = voxel;
            let neighbours = [
                (x > 0).then(|| index - ny * nz),
                (x + 1 < nx).then(|| index + ny * nz),
                (y > 0).then(|| index - nz),
                (y + 1 < ny).then(|| index + nz),
                (z > 0).then(|| index - 1),
                (z + 1 < nz).then(|| index + 1),
            ];
            for next in neighbours.into_iter().flatten() {
                if labels[next] == WAITING {
                    labels[next] = label;
                    stack.push(next);
                }
            }
        }
        pieces.push(piece);
    }
    // Largest first; the sort is stable, so equals stay in the order of their seeds.
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|&piece| std::cmp::Reverse(pieces[piece].voxels));
    let mut rank = vec![0u32; pieces.len() + 1];
    order.iter().enumerate().for_each(|(place, &piece)| rank[piece + 1] = place as u32 + 1);
    labels.iter_mut().for_each(|label| *label = rank[*label as usize]);
    Components { pieces: order.iter().map(|&piece| pieces[piece]).collect(), labels }
}

/// The empty voxels to which no way leads from the grid's border across faces of empty ones; `None` where there is none.
#[must_use]
pub fn cavities(solid: &Occupancy) -> Option<Occupancy> {
    let empty = components(&solid.grid, |voxel| solid.solid[voxel] == 0);
    let closed: Vec<bool> = empty.pieces.iter().map(|piece| piece.is_inside(solid.grid.dims)).collect();
    let is_closed = |&label: &u32| u8::from(label > 0 && closed[label as usize - 1]);
    let voxels = || empty.labels.iter().map(is_closed).collect();
    closed.contains(&true).then(|| Occupancy { grid: solid.grid, solid: voxels() })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn cavities_are_closed_on_all_sides_and_pockets_are_not() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 2.0, dims: [9, 8, 7] };
        let made = |empty: &dyn Fn([usize; 3]) -> bool| Occupancy::of(grid, |voxel| !empty(voxel));
        let cavity = |[x, y, z]: [usize; 3]| x == 4 && (2..5).contains(&y) && z == 3;
        let pocket = |[x, y, z]: [usize; 3]| x == 4 && y == 2 && z >= 3;
        let hollow = Some(Occupancy::of(grid, cavity));
        assert_eq!(cavities(&made(&cavity)), hollow);
        assert_eq!(cavities(&made(&|v| cavity(v) || pocket(v))), None);
        // One that a pocket meets along an edge alone.
        let beside = |[x, y, z]: [usize; 3]| x == 5 && y == 1 && z >= 4;
        assert_eq!(cavities(&made(&|v| cavity(v) || beside(v))), hollow);
        assert_eq!((cavities(&made(&|_| false)), cavities(&Occupancy::empty(grid))), (None, None));
    }
    #[test]
    fn pieces_touch_by_faces_alone_and_come_largest_first() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 4, 5] };
        let mut inside = vec![false; grid.len()];
        // One voxel; diagonal to it an L of three; far away a pair.
        for voxel in [[0, 0, 0], [1, 1, 0], [1, 2, 0], [2, 2, 0], [2, 3, 4], [2, 3, 3]] {
            inside[grid.index(voxel)] = true;
        }
        let found = components(&grid, |v| inside[v]);
        assert_eq!(found.pieces.iter().map(|p| p.voxels).collect::<Vec<_>>(), [3, 2, 1]);
        assert_eq!((found.pieces[0].lower, found.pieces[0].upper), ([1, 1, 0], [2, 2, 0]));
        assert_eq!(found.labels[grid.index([2, 3, 3])], 2);
        assert_eq!(found.labels[grid.index([0, 0, 0])], 3);
        assert_eq!((found.labels.iter().filter(|&&l| l > 0).count(), found.voxels()), (6, 6));
        assert!(components(&grid, |_| false).pieces.is_empty());
        assert_eq!(components(&grid, |_| true).pieces[0].voxels, 60);
    }
}
