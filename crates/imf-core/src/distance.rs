//! Exact Euclidean distance transforms of an occupancy, in voxels between voxel centres.
//!
//! Separable, as Meijster, Roerdink and Hesselink (2000) and Felzenszwalb and Huttenlocher (2012) have it: the nearest
//! solid voxel along x by two sweeps, then along y and z by lower envelopes of parabolas, in whole numbers. The nearest voxel
//! itself is stored: callers need the witness point as well as the distance.
//!
//! Space outside the grid is empty: for a point out there the distance to the obstacle is bounded from below through
//! the nearest point of the grid, and as seen from within the obstacle the outside is the nearest empty space.

mod change;
mod transform;

use glam::DVec3;

use crate::occupancy::Occupancy;
use crate::parallel;
use transform::{NONE, nearest_voxels};

/// For every voxel its nearest solid voxel and how far away that is.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceField {
    dims: [usize; 3],
    cells: Vec<Cell>,
    /// By voxel the nearest solid one of the same z, as x · ny + y; made at the first change.
    in_plane: Vec<u32>,
}

/// Index of the nearest solid voxel or [`NONE`], and the bits of its distance in voxels, rounded down to remain a
/// lower bound. The two are side by side because they are read together. An array, since zeroed memory of arrays is
/// not touched before it is written.
type Cell = [u32; 2];

/// That of every voxel where none is solid.
const EMPTY: Cell = [NONE, f32::INFINITY.to_bits()];

fn cell(nearest: u32, squared: u64) -> Cell {
    [nearest, ((squared as f64).sqrt() as f32).next_down().max(0.0).to_bits()]
}

impl DistanceField {
    /// The distance transform of an obstacle, on all threads of the current pool.
    #[must_use]
    pub fn new(obstacle: &Occupancy) -> Self {
        let dims = obstacle.grid.dims;
        let cells = nearest_voxels(obstacle, 1, EMPTY, cell);
        Self { dims, cells, in_plane: Vec::new() }
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// A closer bound than [`DistanceField::probe`]'s, by the eight centres c around the point p. With the weights w
    /// of linear interpolation, Σ w c = p, any solid centre s has |s − p|² = Σ w |s − c|² − Σ w |p − c|²: the squared
    /// distance at p is at least the interpolated one less the weighted |p − c|². Beside a flat wall d away that
    /// falls short by less than 1 / 4d.
    pub(crate) fn squared_around(&self, point: DVec3) -> f64 {
        let last = DVec3::from_array(self.dims.map(|d| (d - 1) as f64));
        let held = point.clamp(DVec3::ZERO, last);
        let low = held.floor().min(last);
        let (part, high) = (held - low, (low + 1.0).min(last));
        let (mut inside, mut spread) = (0.0, (part * (1.0 - part)).element_sum());
        for corner in 0..8 {
            let pick = |axis: usize| match corner >> axis & 1 {
                0 => (low[axis] as usize, 1.0 - part[axis]),
                _ => (high[axis] as usize, part[axis]),
            };
            let [(x, a), (y, b), (z, c)] = [pick(0), pick(1), pick(2)];
            let away = f64::from(self.to_solid((x * self.dims[1] + y) * self.dims[2] + z));
            let weight = a * b * c;
            if weight > 0.0 {
                inside += weight * away * away;
            }
        }
        // More than all rounding.
        spread += 1e-9 * inside.min(1e9);
        (point - held).length_squared() + (inside - spread).max(0.0)
    }

    /// Distance in voxels from a voxel's centre to the nearest solid one, rounded down; infinite where nothing is solid.
    #[inline]
    pub(crate) fn to_solid(&self, index: usize) -> f32 {
        f32::from_bits(self.cells[index][1])
    }

    #[inline]
    pub(crate) fn voxel(&self, index: usize) -> [f64; 3] {
        let [_, ny, nz] = self.dims.map(|n| n as u32);
        let (line, z) = (index as u32 / nz, index as u32 % nz);
        [f64::from(line / ny), f64::from(line % ny), f64::from(z)]
    }

    /// Index of the solid voxel nearest to a voxel; `u32::MAX` where nothing is solid.
    #[inline(always)]
    pub(crate) fn nearest_or_none(&self, index: usize) -> u32 {
        self.cells.get(index).map_or(NONE, |cell| cell[0])
    }

    /// [`DistanceField::voxel`] of several, each coordinate by itself.
    #[inline(always)]
    pub(crate) fn voxels_of<const N: usize>(&self, index: [u32; N]) -> [[f32; N]; 3] {
        /// Adding it rounds to whole numbers.
        const ROUND: f64 = 6_755_399_441_055_744.0;
        let [_, ny, nz] = self.dims.map(|n| n as f64);
        let (per_nz, per_ny) = (1.0 / nz, 1.0 / ny);
        let mut voxels = [[0.0; N]; 3];
        for lane in 0..N {
            // Half a voxel on, the quotient is no whole number: less one half, it is rounded down.
            let index = f64::from(index[lane]);
            let line = (index + 0.5) * per_nz - 0.5 + ROUND - ROUND;
            let x = (line + 0.5) * per_ny - 0.5 + ROUND - ROUND;
            voxels[0][lane] = x as f32;
            voxels[1][lane] = (line - x * ny) as f32;
            voxels[2][lane] = (index - line * nz) as f32;
        }
        voxels
    }

    /// The solid voxel nearest to a voxel (positions in C-ordered arrays); `None` where nothing is solid.
    #[must_use]
    pub fn nearest(&self, index: usize) -> Option<usize> {
        Some(self.cells[index][0]).filter(|&w| w != NONE).map(|w| w as usize)
    }

    /// Squared distance in voxels from a voxel's centre to the nearest solid voxel's; `None` where nothing is solid.
    #[must_use]
    pub fn squared(&self, index: usize) -> Option<u64> {
        self.nearest(index).map(|witness| squared_distance(self.dims, index, witness))
    }

    /// Nearest voxel and distance bound at a point in continuous voxel coordinates (whole numbers at centres), inside the grid or outside.
    #[inline]
    #[must_use]
    pub fn probe(&self, point: DVec3) -> Probe {
        let last = DVec3::from_array(self.dims.map(|d| (d - 1) as f64));
        let nearest = point.clamp(DVec3::ZERO, last);
        // For numbers of at least 0 a conversion to whole numbers is faster than `floor`.
        let [x, y, z] = [0, 1, 2].map(|axis| ((nearest[axis] + 0.5) as u32).min(last[axis] as u32));
        let centre = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        let [x, y, z] = [x, y, z].map(|at| at as usize);
        let index = (x * self.dims[1] + y) * self.dims[2] + z;
        let to_centre = f64::from(self.to_solid(index));
        // Every solid centre lies in the box of centres, and the angle at the box's nearest point is obtuse: the
        // squares of the way to the box and of the way on from there add up to a lower bound.
        let inside = (to_centre - (nearest - centre).length()).max(0.0);
        let outside = (point - nearest).length_squared();
        Probe { index, squared: outside + inside * inside }
    }
}

/// The result of [`DistanceField::probe`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The voxel nearest to the point.
    pub index: usize,
    /// Lower bound of the squared distance from the point to any solid voxel's centre, in voxels².
    pub squared: f64,
}

/// Squared distance in voxels from every solid voxel's centre to the nearest empty voxel's, the outside of the grid
/// being empty; 0 where empty.
#[must_use]
pub(crate) fn squared_depths(obstacle: &Occupancy) -> Vec<u64> {
    let dims = obstacle.grid.dims;
    let mut depths = nearest_voxels(obstacle, 0, u64::MAX, |_, squared| squared);
    parallel::for_each_chunk(
        &mut depths,
        dims[1] * dims[2],
        || (),
        |(), x, depths| {
            for (index, depth) in depths.iter_mut().enumerate() {
                let voxel = [x, index / dims[2], index % dims[2]];
                let face = (0..3).map(|axis| (voxel[axis] + 1).min(dims[axis] - voxel[axis]) as u64).min();
                *depth = face.map_or(0, |face| face * face).min(*depth);
            }
        },
    );
    depths
}

/// The solid voxels that lie deeper than `depth` (in the grid's unit) below the surface, and those in the middle of a wall of
/// even thickness, however thin: none around is deeper. The surface is taken to lie half-way between solid and empty centres: a solid
/// voxel is as deep below it as its centre's distance to the nearest empty centre, less half a pitch.
#[must_use]
pub(crate) fn deeper_than(part: &Occupancy, depth: f64) -> Occupancy {
    // Rounded to a billionth, so that a depth of whole pitches compares as exact.
    let limit = (depth / part.grid.pitch + 0.5 + 1e-9).powi(2);
    let depths = squared_depths(part);
    let [nx, ny, nz] = part.grid.dims;
    let solid = parallel::map(depths.len(), |voxel| {
        let squared = depths[voxel];
        let is_deepest = || {
            let [x, y, z] = part.grid.voxel(voxel);
            let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
            let mut near = around(x, nx).flat_map(|x| around(y, ny).map(move |y| (x, y)));
            near.all(|(x, y)| around(z, nz).all(|z| depths[part.grid.index([x, y, z])] <= squared))
        };
        u8::from(squared as f64 > limit || squared > 0 && is_deepest())
    });
    Occupancy { grid: part.grid, solid }
}

/// Squared distance in voxels between two voxels.
fn squared_distance(dims: [usize; 3], a: usize, b: usize) -> u64 {
    let split = |index: usize| [index / (dims[1] * dims[2]), index / dims[2] % dims[1], index % dims[2]];
    let (a, b) = (split(a), split(b));
    (0..3).map(|axis| a[axis].abs_diff(b[axis]) as u64).map(|d| d * d).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    pub(super) fn scattered(dims: [usize; 3], one_in: usize) -> Occupancy {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims };
        let hash = |voxel| grid.index(voxel).wrapping_mul(2_654_435_761) >> 9;
        Occupancy::of(grid, |voxel| hash(voxel).is_multiple_of(one_in))
    }

    /// Distance from a point to the nearest solid centre.
    fn to_nearest(obstacle: &Occupancy, point: DVec3) -> f64 {
        let centre = |index| DVec3::from_array(obstacle.grid.voxel(index).map(|v| v as f64));
        obstacle.solids().map(|index| centre(index).distance(point)).fold(f64::INFINITY, f64::min)
    }

    fn brute(obstacle: &Occupancy, wanted: u8, index: usize) -> Option<u64> {
        let chosen = (0..obstacle.solid.len()).filter(|&i| obstacle.solid[i] == wanted);
        chosen.map(|i| squared_distance(obstacle.grid.dims, index, i)).min()
    }

    #[test]
    fn the_middle_of_a_wall_counts_as_deep_however_thin_it_is() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 0.5, dims: [24, 20, 20] };
        for thick in 1..6 {
            // A rib on a plate.
            let part = Occupancy::of(grid, |[x, y, z]| {
                (1..7).contains(&x) && y > 0 && y < 19 && z > 0 && z < 19
                    || (7..22).contains(&x) && (8..8 + thick).contains(&y) && z > 0 && z < 19
            });
            let deep = deeper_than(&part, 2.0);
            for x in 10..18 {
                let across: Vec<u8> = (0..20).map(|y| deep.solid[grid.index([x, y, 10])]).collect();
                assert_eq!(
                    across.iter().map(|&d| usize::from(d)).sum::<usize>(),
                    2 - thick % 2,
                    "{thick} {x}"
                );
                assert!(across[8 + thick / 2] == 1, "{thick} {x}");
            }
            // The faces of what is thicker are not deep.
            assert!((1..19).all(|y| deep.solid[grid.index([1, y, 10])] == 0));
        }
    }

    #[test]
    fn distances_are_those_of_trying_every_voxel() {
        for (dims, one_in) in [([7, 9, 11], 3), ([7, 9, 11], 40), ([1, 13, 4], 9), ([12, 1, 1], 5)] {
            let obstacle = scattered(dims, one_in);
            let field = DistanceField::new(&obstacle);
            let depths = squared_depths(&obstacle);
            for index in 0..obstacle.solid.len() {
                assert_eq!(field.squared(index), brute(&obstacle, 1, index), "{dims:?} {index}");
                let voxel = obstacle.grid.voxel(index);
                let face =
                    (0..3).map(|a| (voxel[a] + 1).min(dims[a] - voxel[a]) as u64).min().unwrap().pow(2);
                let expected = brute(&obstacle, 0, index).map_or(face, |d| d.min(face));
                assert_eq!(depths[index], expected, "{dims:?} {index}");
            }
        }
    }

    #[test]
    fn several_voxels_have_the_coordinates_of_each() {
        for dims in [[1, 1, 1], [7, 9, 11], [3, 1, 200], [1400, 1500, 2000]] {
            let field = DistanceField { dims, cells: Vec::new(), in_plane: Vec::new() };
            let last = (dims.iter().product::<usize>() - 1) as u32;
            let [_, ny, nz] = dims.map(|n| n as u32);
            let some =
                [0, nz - 1, nz, ny * nz - 1, ny * nz, last / 2, last - last % nz, last].map(|i| i.min(last));
            let voxels = field.voxels_of(some);
            for (lane, &index) in some.iter().enumerate() {
                let voxel = [0, 1, 2].map(|axis| f64::from(voxels[axis][lane]));
                assert_eq!(voxel, field.voxel(index as usize), "{dims:?} {index}");
            }
        }
    }

    #[test]
    fn an_empty_obstacle_is_infinitely_far() {
        let empty = Occupancy::empty(Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 4, 5] });
        let field = DistanceField::new(&empty);
        assert_eq!((field.nearest(7), field.squared(7)), (None, None));
        assert_eq!(field.probe(DVec3::new(-9.0, 1.0, 2.0)).squared, f64::INFINITY);
        assert!(squared_depths(&empty).iter().all(|&d| d == 0));
    }

    #[test]
    fn probes_never_guarantee_more_than_the_true_distance() {
        let obstacle = scattered([9, 8, 10], 37);
        let field = DistanceField::new(&obstacle);
        let mut gap: f64 = 0.0;
        for i in 0..4000_u32 {
            let place = |factor, prime| f64::from(i.wrapping_mul(factor) % prime) / f64::from(prime);
            let unit = DVec3::new(place(40_503, 997), place(30_011, 991), place(20_021, 983));
            let point = unit * 30.0 - 10.0;
            let truth = to_nearest(&obstacle, point);
            let bound = field.probe(point).squared.sqrt();
            let closer = field.squared_around(point).sqrt();
            assert!(bound <= truth + 1e-9, "{point}: {bound} > {truth}");
            assert!(closer <= truth + 1e-9, "{point}: {closer} > {truth}");
            gap = gap.max(truth - bound);
        }
        // Outside, where the way bends, the bound is looser than the √3 of one rounding inside.
        assert!(gap < 12.0, "{gap}");
    }

    #[test]
    fn the_bound_from_all_centres_around_is_close_beside_walls() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [20, 17, 18] };
        let upright = |voxel: [usize; 3]| voxel[0] < 2;
        let oblique = |voxel: [usize; 3]| voxel[0] + voxel[1] + voxel[2] < 9;
        for wall in [&upright as &dyn Fn([usize; 3]) -> bool, &oblique] {
            let obstacle = Occupancy::of(grid, wall);
            let field = DistanceField::new(&obstacle);
            for i in 0..500_u32 {
                let unit =
                    [40_503, 30_011, 20_021].map(|prime| f64::from(i.wrapping_mul(prime) % 997) / 997.0);
                let point = DVec3::new(6.0, 6.0, 6.0) + DVec3::from_array(unit) * 5.0;
                let truth = to_nearest(&obstacle, point);
                let bound = field.squared_around(point).sqrt();
                // A wall of centres is not a plane: a second such term for its steps.
                assert!(bound <= truth && truth - bound < 2.0 * 0.25 / truth, "{point}: {bound} {truth}");
            }
        }
    }
}
