//! The harmonic field: every orientation at once, from exact sections, without training.
//!
//! At each voxel the collision measure is a function of the orientation alone, and a smooth one: `CMF(x, R) = Σ_k c_k(x)
//! b_k(R)` with a few hundred harmonics b (`basis`). The coefficients come from exact sections by least squares
//! (`fit`); their definition by the tool's radial profile is `radial`. They are held along their principal components,
//! `c = μ + U z`, so that a section is `⟨z(x), Uᵀ b(R)⟩ + μ·b(R)`: one product for any number of orientations
//! (`evaluate`), with exact gradients in the direction.
//!
//! A field of the overlap at the tip serves every sharp point, read at x − R k: files hold this kind alone
//! (`SectionPlan::of_scene(scene, ToolPoints::Tip)`). It is the same at every roll where the tool is a body of
//! revolution, wherever its sharp points are. A fit may also be of the minimum over the sharp points itself, for
//! sections: that one bends more sharply, needs a higher degree, and depends on the roll where the sharp points do.
//! Values are for voxel centres and trilinear between them; outside the box of the voxel centres there is no value
//! ([`HarmonicField::overlap_with_gradient`]).

mod adjoint;
pub mod basis;
mod batch_gradients;
pub mod coefficients;
mod corners;
mod evaluate;
pub mod file;
#[cfg(feature = "fit")]
mod fit;
pub(crate) mod mirror;
mod point;
#[cfg(test)]
mod radial;
mod settings;

// The functions' recurrences, for the GPU twin.
#[doc(hidden)]
pub mod rotations;
#[doc(hidden)]
pub mod sphere;

pub(crate) use batch_gradients::{Axes, BatchScratch};
pub use evaluate::DirectionWeights;
#[doc(hidden)]
pub use evaluate::{DIRECTIONS_AT_ONCE, VoxelCoefficients};
pub(crate) use evaluate::{minimum_of, minimum_over, sections_of};
#[cfg(feature = "fit")]
pub use fit::fit;
// What a fit would take.
#[cfg(feature = "fit")]
#[doc(hidden)]
pub use fit::section_count;
pub(crate) use mirror::{Mirrors, Planes};
pub(crate) use point::{Functions, TurnScratch};
pub use point::{Gradient, PointScratch};
#[doc(hidden)]
pub use settings::Sizes;
pub use settings::{FitReport, FitSettings};

use thiserror::Error;

use basis::Basis;
use coefficients::Coefficients;
use imf_core::grid::Grid;
use imf_core::orientation::OrientationSetError;
use imf_core::section::{Quantity, SectionError};

/// Why a harmonic field cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum HarmonicError {
    /// A setting out of range.
    #[error("harmonic field: {0}")]
    Settings(String),
    /// Too few orientations for the number of basis functions.
    #[error("the sections do not determine every coefficient: more sections a function, or a lower degree")]
    Singular,
    /// A section failed, or the work was interrupted.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// The set of orientations cannot be made.
    #[error(transparent)]
    Orientations(#[from] OrientationSetError),
}

/// The overlap of tool and obstacle at every voxel as a function of the orientation, or the depth of that.
#[derive(Clone, Debug, PartialEq)]
pub struct HarmonicField {
    /// What its values are.
    pub quantity: Quantity,
    /// Where the voxels are.
    pub grid: Grid,
    /// The functions of the orientation, K of them.
    pub basis: Basis,
    /// U: `[K][components]`, orthonormal columns.
    pub components: Vec<f32>,
    /// μ: `[K]`.
    pub mean: Vec<f32>,
    /// z: `[voxel][components]`.
    pub coefficients: Coefficients,
    /// Its measured errors.
    pub report: FitReport,
}

impl HarmonicField {
    /// Number of principal components.
    pub fn component_count(&self) -> usize {
        self.components.len() / self.basis.len()
    }

    /// Bytes of the coefficients and axes.
    pub fn bytes(&self) -> u64 {
        self.coefficients.len() as u64 * self.coefficients.precision().bytes()
            + 4 * (self.components.len() + self.mean.len()) as u64
    }
}

#[cfg(test)]
mod tests;
