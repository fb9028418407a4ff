//! The factored field: the harmonic field in a megabyte, differentiable in space.
//!
//! `CMF(x, d) ≈ clamp(mean(d) + ⟨g(x), h(d)⟩)`. h are a harmonic field's functions of the orientation, turned to their
//! principal axes and fixed; g is a sine network from the point to the coefficients along those axes. The axes are
//! orthonormal functions of mean square 1, so the squared error of the coefficients is the mean squared error over the
//! whole sphere (Parseval): every voxel gives all directions at once, and no direction is ever sampled.
//! Once g is known at a point every orientation costs one short dot product, by the harmonic field's own evaluation
//! ([`FactoredEvaluator`]), and derivatives by position and direction are exact.
//!
//! The network sees positions scaled alike along x, y and z: the longest edge of the grid is [−1, 1]. Its outputs
//! times one scale, the teacher's root mean square, are the coefficients. Outside the box of the voxel centres, where
//! nothing was trained, there is no value.
//!
//! Behind its sines g is linear, and what follows is too: once trained, the last layer is folded into the functions
//! ([`FactoredField::folded`]). The last sines are the coefficients then, along axes that training has found: the same
//! field with fewer weights.
//!
//! Where a network is symmetry-reduced all this is of the direction in the frame of the place ([`Symmetry`]).

mod evaluate;
pub mod file;
mod fold;
mod gradients;
mod point;
// The definition and the targets that imf-train trains and tests by.
#[doc(hidden)]
pub mod reference;
mod settings;
mod symmetry;
#[doc(hidden)]
pub mod targets;

pub use evaluate::FactoredEvaluator;
pub(crate) use gradients::{GradientScratch, ROWS};
pub use point::PointScratch;
pub use settings::{DistillSettings, FactoredState};
pub use symmetry::{Axis, Symmetry};
// For the trainer and the GPU twin.
#[doc(hidden)]
pub use symmetry::{ANGLE, AROUND_AXIS, Frame, Inputs, LocalHarmonics, Place};

use std::borrow::Cow;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::harmonic::basis::Basis;
use crate::harmonic::{DirectionWeights, HarmonicField};
use crate::siren::stack::{Ending, Stack};
use crate::siren::{Layer, ShapeError};
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::Quantity;
use targets::{ComponentBasis, Targets};

/// Inputs of g: the point. With an axis of revolution there are two more ([`Symmetry`]).
#[doc(hidden)]
pub const INPUTS: usize = 3;

/// The shape of g; its weights are a flat array beside it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactoredShape {
    /// Neurons of every hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub hidden: usize,
    /// Frequency factor ω inside every sine.
    pub omega: f32,
    /// Outputs: principal axes of the harmonic field, or as many as neurons in a folded network.
    pub components: usize,
    /// There is no layer behind the last sines, which are the outputs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub folded: bool,
    /// The obstacle's symmetry that it is reduced by.
    #[serde(default, skip_serializing_if = "Symmetry::is_none")]
    pub symmetry: Symmetry,
}

impl std::fmt::Display for FactoredShape {
    /// Inputs, hidden layers and, where there is a layer behind these, its outputs: `3→256×3→160`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}→{}×{}", self.symmetry.inputs(), self.width, self.hidden)?;
        if self.folded { Ok(()) } else { write!(f, "→{}", self.components) }
    }
}

impl FactoredShape {
    /// The network as a stack of layers.
    pub fn stack(&self) -> Stack {
        let Self { width, hidden, omega, components, folded, symmetry } = *self;
        Stack {
            inputs: symmetry.inputs(),
            width,
            hidden,
            skip_after: None,
            omega,
            outputs: components,
            ending: if folded { Ending::Sines } else { Ending::Linear },
        }
    }

    /// Checks width, depth and ω.
    ///
    /// # Errors
    /// Names the value that is out of range.
    pub fn check(&self) -> Result<(), ShapeError> {
        self.stack().check()
    }

    /// The layers in order, the linear one last where there is one: the layout of the flat parameters.
    pub fn layers(&self) -> Vec<Layer> {
        self.stack().layers()
    }

    /// The layers whose weights are matrices between hidden layers.
    pub fn between(&self) -> impl Iterator<Item = Layer> + use<> {
        let between = self.stack().between();
        self.layers().into_iter().take(between.end).skip(between.start)
    }

    /// The same network without its linear layer.
    #[must_use]
    pub fn folded(self) -> Self {
        Self { components: self.width, folded: true, ..self }
    }

    /// Number of parameters, weights and biases together.
    pub fn parameter_count(&self) -> usize {
        self.stack().parameter_count()
    }

    /// Random starting weights, in the ranges of the paper's network; the same seed gives the same bits everywhere.
    pub fn initial_parameters(&self, seed: u64) -> Vec<f32> {
        self.stack().initial_parameters(seed)
    }
}

/// The overlap of tool and obstacle at any point of a grid's box, in any orientation, or the depth of that.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredField {
    /// What its values are.
    pub quantity: Quantity,
    /// Where the voxels are that it was trained on.
    pub grid: Grid,
    /// The functions of the orientation, K of them.
    pub basis: Basis,
    /// U: `[K][components]`, orthonormal columns where the network is not folded.
    pub components: Vec<f32>,
    /// μ: `[K]`.
    pub mean: Vec<f32>,
    /// The shape of g.
    pub shape: FactoredShape,
    /// g's weights, in the layout of [`FactoredShape::layers`].
    pub parameters: Vec<f32>,
    /// Coefficients are g's outputs times this.
    pub scale: f32,
}

impl FactoredField {
    /// The field of a teacher's basis and a network distilled from it.
    ///
    /// # Errors
    /// Parameters that do not fit the shape, a shape of other axes than the teacher's, or a symmetry that it has not.
    pub fn new(
        teacher: &HarmonicField,
        shape: FactoredShape,
        parameters: Vec<f32>,
    ) -> Result<Self, ShapeError> {
        let targets = Targets::new(teacher, shape.symmetry)?;
        ComponentBasis::of(teacher, &targets).field(shape, parameters)
    }

    /// Prepares orientations for the coefficients of [`FactoredEvaluator`].
    pub fn direction_weights(&self, orientations: &[Orientation]) -> DirectionWeights {
        match self.local_harmonics() {
            None => DirectionWeights::new(&self.basis, &self.components, &self.mean, orientations),
            Some(local) => DirectionWeights::in_order(&self.basis, local.order(), orientations),
        }
    }

    /// U and μ of coefficients that are out of the frames of their places: the field's own where those are the world's.
    fn functions_in_world(&self) -> (Cow<'_, [f32]>, Cow<'_, [f32]>) {
        match self.local_harmonics() {
            None => (Cow::Borrowed(&self.components), Cow::Borrowed(&self.mean)),
            Some(local) => (Cow::Owned(local.functions_in_order()), Cow::Owned(vec![0.0; local.len()])),
        }
    }

    /// What takes coefficients out of the frames of their places, where those are not the world's.
    fn local_harmonics(&self) -> Option<LocalHarmonics> {
        let symmetry = &self.shape.symmetry;
        (!symmetry.is_none()).then(|| LocalHarmonics::new(symmetry, self.basis.degree()))
    }

    /// Coefficients of a point as [`FactoredEvaluator`] has them for [`Self::direction_weights`]: axes, or functions where the network is
    /// symmetry-reduced.
    pub fn coefficient_count(&self) -> usize {
        self.shape.symmetry.coefficients(self.shape.components, self.basis.len())
    }

    /// Numbers that the field consists of: weights, axes and mean.
    pub fn parameter_count(&self) -> usize {
        self.parameters.len() + self.components.len() + self.mean.len()
    }

    /// Bytes of these in f32.
    pub fn bytes(&self) -> u64 {
        4 * self.parameter_count() as u64
    }

    /// Nearer to an axis than this slopes do not grow.
    pub fn blunt(&self) -> f64 {
        0.5 * self.grid.pitch
    }

    /// Network units for one unit of length.
    pub fn inverse_length(&self) -> f64 {
        2.0 / self.grid.size().max_element()
    }

    /// What the network sees of a position.
    pub fn input(&self, position: DVec3) -> Inputs {
        let symmetry = &self.shape.symmetry;
        symmetry.inputs_at(&self.grid, &symmetry.place(position))
    }

    /// What the network sees of a position, and the frame that its coefficients there are in.
    pub fn seen(&self, position: DVec3) -> (Inputs, Frame) {
        let symmetry = &self.shape.symmetry;
        let place = symmetry.place(position);
        (symmetry.inputs_at(&self.grid, &place), symmetry.frame_of(&place))
    }
}
