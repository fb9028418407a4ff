//! The regular grid that every field lives on, and the conversions between world, grid and voxel.
//!
//! `origin` is the lower corner of voxel (0, 0, 0); the centre of voxel `i` is `origin + pitch·(i + ½)`.
//! Arrays are C-ordered `[x, y, z]`: `z` is contiguous.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Half the diagonal of a voxel, in pitches, rounded up.
pub(crate) const HALF_DIAGONAL: f64 = 0.866_025_403_784_438_7;

/// A grid of cubic voxels in the world frame, in the mesh's own unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Lower corner of voxel (0, 0, 0), in world units.
    pub origin: DVec3,
    /// Edge of a voxel, in world units.
    pub pitch: f64,
    /// Number of voxels along x, y and z.
    pub dims: [usize; 3],
}

/// Why a grid cannot be made.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum GridError {
    /// The pitch is zero, negative, infinite or NaN.
    #[error("the pitch must be a positive finite number, not {0}")]
    Pitch(f64),
    /// A dimension is zero, or the box is empty or not finite.
    #[error("the box to be gridded is empty or not finite: from {lower} to {upper}")]
    EmptyBox {
        /// Lower corner of the box.
        lower: DVec3,
        /// Upper corner of the box.
        upper: DVec3,
    },
    /// A requested number of voxels is zero.
    #[error("every dimension of the grid must be at least 1, not {0:?}")]
    Dims([usize; 3]),
    /// The margin leaves no voxel for the part.
    #[error("a margin of {margin} voxels on each side leaves nothing of {dims:?} for the part")]
    Margin {
        /// Requested margin in voxels.
        margin: usize,
        /// Requested dimensions.
        dims: [usize; 3],
    },
    /// A box where double precision does not resolve parts of a voxel.
    #[error(
        "the box to be gridded, from {lower} to {upper}, lies too far from the origin for voxels of {pitch}: double precision does not \
         tell their parts; move it nearer"
    )]
    TooFar {
        /// Lower corner of the box.
        lower: DVec3,
        /// Upper corner of the box.
        upper: DVec3,
        /// The pitch.
        pitch: f64,
    },
    /// More voxels than can be indexed.
    #[error("a grid of {0:?} voxels is too large: at most 2^31 voxels; choose a larger pitch")]
    TooLarge([usize; 3]),
}

impl Grid {
    /// The grid of the given pitch around the box `[lower, upper]`, the box centred, with `margin` empty voxels
    /// on each side.
    ///
    /// # Errors
    /// A pitch that is not positive, a box that is empty or not finite, or more than 2³¹ voxels.
    pub fn with_pitch(lower: DVec3, upper: DVec3, pitch: f64, margin: usize) -> Result<Self, GridError> {
        if !(pitch.is_finite() && pitch > 0.0) {
            return Err(GridError::Pitch(pitch));
        }
        let extent = checked_extent(lower, upper)?;
        // A box that is a whole number of voxels keeps that number, also where its corners were rounded to seven digits.
        let dims = (extent / pitch * (1.0 - 1e-6) - 1e-6).ceil().max(DVec3::ONE) + 2.0 * margin as f64;
        let most = dims.max_element();
        let dims = dims.to_array().map(|d| d as usize);
        if most > f64::from(i32::MAX) {
            return Err(GridError::TooLarge(dims));
        }
        Self::centred(lower, upper, pitch, dims)
    }

    /// The grid of exactly `dims` voxels with the smallest pitch at which the box fits between the margins,
    /// the box centred.
    ///
    /// # Errors
    /// A zero dimension, a margin that leaves nothing, a box that is empty or not finite, or more than 2³¹ voxels.
    pub fn with_dims(lower: DVec3, upper: DVec3, dims: [usize; 3], margin: usize) -> Result<Self, GridError> {
        if dims.contains(&0) {
            return Err(GridError::Dims(dims));
        }
        let extent = checked_extent(lower, upper)?;
        if dims.iter().any(|&d| d <= 2 * margin) {
            return Err(GridError::Margin { margin, dims });
        }
        let inner = DVec3::from_array(dims.map(|d| (d - 2 * margin) as f64));
        Self::centred(lower, upper, (extent / inner).max_element(), dims)
    }

    fn centred(lower: DVec3, upper: DVec3, pitch: f64, dims: [usize; 3]) -> Result<Self, GridError> {
        check_voxels(dims)?;
        check_place(lower, upper, pitch)?;
        let size = DVec3::from_array(dims.map(|d| d as f64)) * pitch;
        Ok(Self { origin: (lower + upper) * 0.5 - size * 0.5, pitch, dims })
    }

    /// Checks a grid that was not made by these functions, such as that of a file.
    ///
    /// # Errors
    /// A pitch that is not positive, an origin that is not finite, a zero dimension, or more than 2³¹ voxels.
    pub fn check(&self) -> Result<(), GridError> {
        let Self { origin, pitch, dims } = *self;
        if !(pitch.is_finite() && pitch > 0.0) {
            return Err(GridError::Pitch(pitch));
        }
        if dims.contains(&0) {
            return Err(GridError::Dims(dims));
        }
        check_voxels(dims)?;
        let upper = origin + DVec3::from_array(dims.map(|d| d as f64)) * pitch;
        checked_extent(origin, upper)?;
        check_place(origin, upper, pitch)
    }

    /// The grid padded by `before` voxels below and `after` above along x, y, z; negative numbers crop.
    /// Voxels keep their places in the world.
    ///
    /// # Errors
    /// Nothing left, or more than 2³¹ voxels.
    pub fn padded(&self, before: [i64; 3], after: [i64; 3]) -> Result<Self, GridError> {
        let sizes = [0, 1, 2].map(|axis| self.dims[axis] as i64 + before[axis] + after[axis]);
        let dims = sizes.map(|size| usize::try_from(size).unwrap_or(0));
        if dims.contains(&0) {
            return Err(GridError::Dims(dims));
        }
        check_voxels(dims)?;
        let shift = DVec3::from_array(before.map(|b| b as f64)) * self.pitch;
        Ok(Self { origin: self.origin - shift, pitch: self.pitch, dims })
    }

    /// The smallest grid of the same voxels that holds the box `[lower, upper]`, with `extra` voxels on each side.
    ///
    /// # Errors
    /// A box that is empty or not finite, or more than 2³¹ voxels.
    pub fn covering(&self, lower: DVec3, upper: DVec3, extra: i64) -> Result<Self, GridError> {
        checked_extent(lower, upper)?;
        // A face of the box on a face of voxels, up to rounding, needs no further voxel.
        let first = ((lower - self.origin) / self.pitch + 1e-6).floor();
        let last = ((upper - self.origin) / self.pitch - 1e-6).ceil().max(first + 1.0);
        if (last - first).max_element() > f64::from(i32::MAX) || first.abs().max_element() > 1e9 {
            return Err(GridError::TooLarge([usize::MAX; 3]));
        }
        let before = first.to_array().map(|v| extra - v as i64);
        let after = [0, 1, 2].map(|axis| last[axis] as i64 + extra - self.dims[axis] as i64);
        self.padded(before, after)
    }

    /// Where voxel (0, 0, 0) of `other` lies in this grid, in voxels; `None` where the voxels of the two do not
    /// coincide (another pitch, or an offset that is not a whole number of voxels to a millionth).
    #[must_use]
    pub fn offset_of(&self, other: &Self) -> Option<[i64; 3]> {
        let offset = (other.origin - self.origin) / self.pitch;
        let aligned = (other.pitch / self.pitch - 1.0).abs() < 1e-12
            && (offset - offset.round()).abs().max_element() < 1e-6
            && offset.abs().max_element() < 1e9;
        aligned.then(|| offset.round().to_array().map(|v| v as i64))
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// True for a grid without voxels (never made by the constructors).
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Edge lengths of the whole grid in world units.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        DVec3::from_array(self.dims.map(|d| d as f64)) * self.pitch
    }

    /// Position of voxel `[x, y, z]` in a C-ordered array.
    #[must_use]
    pub fn index(&self, voxel: [usize; 3]) -> usize {
        (voxel[0] * self.dims[1] + voxel[1]) * self.dims[2] + voxel[2]
    }

    /// The voxel at a position in a C-ordered array: the inverse of [`Grid::index`].
    #[must_use]
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        let row = index / self.dims[2];
        [row / self.dims[1], row % self.dims[1], index % self.dims[2]]
    }

    /// World position of the centre of a voxel.
    #[must_use]
    pub fn centre(&self, voxel: [usize; 3]) -> DVec3 {
        self.origin + (DVec3::from_array(voxel.map(|i| i as f64)) + 0.5) * self.pitch
    }

    /// Unit coordinates `u = (x − origin) / (pitch·dims)` of a world point: [0, 1]³ within the grid.
    #[must_use]
    pub fn unit(&self, point: DVec3) -> DVec3 {
        (point - self.origin) / self.size()
    }

    /// Continuous voxel coordinates of a world point: whole numbers at voxel centres.
    #[must_use]
    pub fn continuous(&self, point: DVec3) -> DVec3 {
        (point - self.origin) / self.pitch - 0.5
    }

    /// The world point of continuous voxel coordinates.
    #[must_use]
    pub(crate) fn world(&self, continuous: DVec3) -> DVec3 {
        self.origin + (continuous + 0.5) * self.pitch
    }

    /// Position in a C-ordered array of the voxel that holds a place in continuous voxel coordinates; `None` outside the grid.
    #[must_use]
    pub fn index_at(&self, continuous: DVec3) -> Option<usize> {
        let voxel = continuous.round();
        let within = (0..3).all(|axis| (0.0..self.dims[axis] as f64).contains(&voxel[axis]));
        within.then(|| self.index(voxel.to_array().map(|place| place as usize)))
    }

    /// True in the box of the voxel centres, where values given at centres can be interpolated; false for positions that
    /// are not finite. A centre's own coordinate may be off by rounding.
    #[must_use]
    pub fn is_between_centres(&self, point: DVec3) -> bool {
        let continuous = self.continuous(point);
        let size = point.abs().max_element().max(self.origin.abs().max_element());
        let slack = 1e-9 + 4.0 * f64::EPSILON * size / self.pitch;
        let within =
            |axis: usize| (-slack..=(self.dims[axis] - 1) as f64 + slack).contains(&continuous[axis]);
        point.is_finite() && (0..3).all(within)
    }

    /// The corners of the box of the voxel centres.
    #[must_use]
    pub fn box_of_centres(&self) -> [DVec3; 2] {
        [self.centre([0; 3]), self.centre(self.dims.map(|n| n - 1))]
    }

    /// Volume of one voxel in world units cubed.
    #[must_use]
    pub fn voxel_volume(&self) -> f64 {
        self.pitch.powi(3)
    }
}

fn check_voxels(dims: [usize; 3]) -> Result<(), GridError> {
    let voxels = dims.iter().try_fold(1usize, |product, &d| product.checked_mul(d));
    if voxels.is_some_and(|n| n <= 1 << 31) { Ok(()) } else { Err(GridError::TooLarge(dims)) }
}

/// Farther from the origin than this, in voxels, coordinates have less than a thousandth of a voxel.
const FARTHEST: f64 = (1_u64 << 42) as f64;

fn check_place(lower: DVec3, upper: DVec3, pitch: f64) -> Result<(), GridError> {
    let far = lower.abs().max(upper.abs()).max_element();
    if far <= FARTHEST * pitch { Ok(()) } else { Err(GridError::TooFar { lower, upper, pitch }) }
}

fn checked_extent(lower: DVec3, upper: DVec3) -> Result<DVec3, GridError> {
    let extent = upper - lower;
    if lower.is_finite() && upper.is_finite() && extent.min_element() >= 0.0 && extent.max_element() > 0.0 {
        Ok(extent)
    } else {
        Err(GridError::EmptyBox { lower, upper })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_where_voxels_have_no_parts_is_refused() {
        let far = DVec3::new(0.0, 1e16, 0.0);
        let found = Grid::with_pitch(far, far + 64.0, 1.0, 0);
        assert_eq!(found, Err(GridError::TooFar { lower: far, upper: far + 64.0, pitch: 1.0 }));
        let grid = Grid { origin: far, pitch: 0.5, dims: [2, 3, 4] };
        assert!(matches!(grid.check(), Err(GridError::TooFar { .. })));
        let near = DVec3::splat(f64::from(1 << 30));
        assert_eq!(Grid::with_pitch(near, near + 64.0, 1.0, 0).map(|grid| grid.dims), Ok([64; 3]));
    }

    #[test]
    fn a_grid_from_elsewhere_is_checked() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 0.5, dims: [2, 3, 4] };
        assert_eq!(grid.check(), Ok(()));
        let with = |pitch: f64, dims: [usize; 3]| Grid { pitch, dims, ..grid }.check();
        assert!(matches!(with(-1.0, grid.dims), Err(GridError::Pitch(_))));
        assert!(matches!(with(0.5, [2, 0, 4]), Err(GridError::Dims(_))));
        // Their product is 2^66.
        assert!(matches!(with(0.5, [1 << 32, 1 << 32, 4]), Err(GridError::TooLarge(_))));
        assert!(matches!(with(1e308, grid.dims), Err(GridError::EmptyBox { .. })));
    }

    #[test]
    fn dims_choose_the_smallest_pitch_and_centre_the_box() {
        let grid = Grid::with_dims(DVec3::ZERO, DVec3::new(58.0, 73.6, 118.5), [58, 76, 121], 0).unwrap();
        assert!((grid.pitch - 1.0).abs() < 1e-12);
        let middle = grid.origin + grid.size() * 0.5;
        assert!((middle - DVec3::new(29.0, 36.8, 59.25)).length() < 1e-12);
    }

    #[test]
    fn pitch_keeps_whole_boxes_and_adds_margins() {
        let grid = Grid::with_pitch(DVec3::ZERO, DVec3::new(3.0, 2.1, 0.4), 0.1, 2).unwrap();
        assert_eq!(grid.dims, [34, 25, 8]);
    }

    #[test]
    fn index_and_voxel_are_inverse_and_z_is_contiguous() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 4, 5] };
        for index in 0..grid.len() {
            assert_eq!(grid.index(grid.voxel(index)), index);
            assert_eq!(grid.index_at(grid.continuous(grid.centre(grid.voxel(index)) - 0.4)), Some(index));
        }
        assert_eq!(grid.index([0, 0, 1]), 1);
        for outside in [DVec3::new(-0.6, 0.0, 0.0), DVec3::new(0.0, 0.0, 4.6), DVec3::NAN] {
            assert_eq!(grid.index_at(outside), None);
        }
    }

    #[test]
    fn padded_grids_keep_their_voxels_in_place() {
        let grid = Grid { origin: DVec3::new(0.1, -7.3, 1e3), pitch: 0.3, dims: [3, 4, 5] };
        let padded = grid.padded([2, 0, -1], [1, 3, 0]).unwrap();
        assert_eq!(padded.dims, [6, 7, 4]);
        assert_eq!(grid.offset_of(&padded), Some([-2, 0, 1]));
        assert_eq!(padded.offset_of(&grid), Some([2, 0, -1]));
        assert!((padded.centre([2, 0, 0]) - grid.centre([0, 0, 1])).length() < 1e-9);
        assert!(grid.padded([-3, 0, 0], [0; 3]).is_err());
        let (lower, upper) = (grid.centre([1, 1, 1]), grid.origin + grid.size() + 0.31);
        let covering = grid.covering(lower, upper, 0).unwrap();
        assert_eq!((grid.offset_of(&covering), covering.dims), (Some([1, 1, 1]), [4, 5, 6]));
        assert_eq!(grid.covering(grid.origin, grid.origin + grid.size(), 0).unwrap().dims, grid.dims);
        assert_eq!(grid.covering(lower, upper, 2).unwrap().dims, [8, 9, 10]);
        let shifted = Grid { origin: grid.origin + 0.1, ..grid };
        assert_eq!(grid.offset_of(&shifted), None);
        assert_eq!(grid.offset_of(&Grid { pitch: 0.6, ..grid }), None);
    }

    #[test]
    fn bad_requests_name_the_cause() {
        let unit = DVec3::ONE;
        assert_eq!(Grid::with_pitch(DVec3::ZERO, unit, -1.0, 0), Err(GridError::Pitch(-1.0)));
        assert!(matches!(Grid::with_pitch(unit, DVec3::ZERO, 1.0, 0), Err(GridError::EmptyBox { .. })));
        assert!(matches!(Grid::with_pitch(DVec3::ZERO, unit, 1e-9, 0), Err(GridError::TooLarge(_))));
        assert!(matches!(Grid::with_dims(DVec3::ZERO, unit, [4, 4, 4], 2), Err(GridError::Margin { .. })));
    }

    #[test]
    fn the_box_of_the_centres_holds_its_corners_however_far_the_grid_lies() {
        for (far, pitch) in [(0.0, 0.3), (1e4, 0.1), (1e6, 0.01), (5.4e6, 0.1), (-5.4e6, 0.1)] {
            for step in 0..200 {
                let origin = DVec3::new(far + 0.37 * f64::from(step), far - 0.11 * f64::from(step), 1.0);
                let grid = Grid { origin, pitch, dims: [7, 40, 3] };
                let [low, high] = grid.box_of_centres();
                assert!(grid.is_between_centres(low) && grid.is_between_centres(high), "{grid:?}");
                assert!(!grid.is_between_centres(low - DVec3::X * 1e-4 * pitch.max(1e-2)), "{grid:?}");
            }
        }
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] };
        assert!(
            ![f64::INFINITY, f64::NAN].into_iter().any(|v| grid.is_between_centres(DVec3::new(1.0, v, 1.0)))
        );
    }
}
