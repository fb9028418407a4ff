//! What a set-up may do to a part: turn, move, and scale it evenly, as from one unit to another.

use glam::{DMat4, DVec3, DVec4, Vec4Swizzles as _};
use thiserror::Error;

/// Why a matrix is no place for a part or a fixture.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TransformFault {
    /// Numbers that are none.
    #[error("it must be of finite numbers, and one of them is not")]
    NotFinite,
    /// The last row of a transform that moves points is 0 0 0 1.
    #[error(
        "it must have the last row 0 0 0 1 and the translation in the last column, not with the last row {} {} {} {}{}",
        row.x, row.y, row.z, row.w,
        if *transposed { ": it is transposed" } else { "" }
    )]
    LastRow {
        /// The last row.
        row: DVec4,
        /// Its transpose has the right last row.
        transposed: bool,
    },
    /// Another scale along each axis.
    #[error("the matrix scales by {}, {} and {} along its axes: scale by one factor above 0", .0.x, .0.y, .0.z)]
    Uneven(DVec3),
    /// Axes that are not at right angles.
    #[error("the matrix shears: its axes must be at right angles to each other")]
    Shear,
    /// Left hands become right hands.
    #[error("the matrix mirrors: a set-up turns and moves; mirror the mesh itself")]
    Mirror,
}

/// Relative rounding errors of matrices that are written with seven digits.
const EPSILON: f64 = 1e-6;

impl TransformFault {
    /// Refuses matrices that do more than turn, move, and scale by one factor.
    ///
    /// # Errors
    /// What else the matrix does.
    pub fn check(transform: &DMat4) -> Result<(), Self> {
        if !transform.is_finite() {
            return Err(Self::NotFinite);
        }
        let row = transform.row(3);
        // Rounding errors of an inverse count as 0.
        let is_last = |row: DVec4| row.abs_diff_eq(DVec4::W, 1e-9);
        if !is_last(row) {
            return Err(Self::LastRow { row, transposed: is_last(transform.w_axis) });
        }
        let [x, y, z] = [transform.x_axis, transform.y_axis, transform.z_axis].map(DVec4::xyz);
        let scales = DVec3::new(x.length(), y.length(), z.length());
        let scale = scales.element_sum() / 3.0;
        let is_even = |own: f64| (own / scale - 1.0).abs() < EPSILON;
        if !(scale > 0.0 && scales.to_array().into_iter().all(is_even)) {
            return Err(Self::Uneven(scales));
        }
        if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|own| own.abs() >= EPSILON * scale * scale) {
            return Err(Self::Shear);
        }
        if x.cross(y).dot(z) <= 0.0 {
            return Err(Self::Mirror);
        }
        Ok(())
    }
}
