//! The paper's network, `siren5`: a multilayer perceptron with sine activations from a pose to its collision
//! measure, with any width and number of hidden layers.
//!
//! One sample is five numbers in [−1, 1]: `2u − 1` for the point (`u` = [`imf_core::grid::Grid::unit`]),
//! `2·θ/360° − 1`, `2·φ/180° − 1`. A hidden layer computes `sin(ω·(W·a + b))`, ω = 30; the input is concatenated
//! again behind the activations of hidden layer `skip_after`; the output is a sigmoid of `W·a + b` that reaches a little
//! below 0 and is clamped there ([`output`]; the paper has a plain sigmoid).
//! The coordinates θ = 0° and 360° are one direction but two inputs, and at φ = 0° and 180°, where θ is idle, the network is
//! asked at θ = 180°: the learnt field may jump there, and its gradient is one-sided and finite.
//!
//! Parameters are one flat `f32` array; [`SirenShape::layers`] is the one place that knows its layout:
//!
//! ```text
//! | W₀ [out₀][in₀] | b₀ [out₀] | W₁ [out₁][in₁] | b₁ [out₁] | … | W_n [1][in_n] | b_n [1] |
//! in₀ = 5;  in_{skip_after} = width + 5 (activations first, then the input);  other in_l = width
//! ```
//!
//! Source: Harabin, Mirzendehdel, Behandish, arXiv 2409.02115 (network); Sitzmann et al. 2020 (initialisation).

pub(crate) mod adjoint;
pub mod evaluator;
#[doc(hidden)]
pub mod over_grid;
pub(crate) mod tangent;

// What the engines of imf-train and the twins of imf-gpu build on.
#[doc(hidden)]
pub mod bf16_kernel;
#[doc(hidden)]
pub mod forward;
#[doc(hidden)]
pub mod lanes;
#[doc(hidden)]
pub mod matrix;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod plan;
#[doc(hidden)]
pub mod reference;
#[doc(hidden)]
pub mod scratch;
mod sine;
pub(crate) mod split;
#[doc(hidden)]
pub mod stack;
#[doc(hidden)]
pub mod transpose;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use over_grid::EvaluationEngine;
// For the engines of the project's other crates.
#[doc(hidden)]
pub use over_grid::{check_evaluate, check_minimum};
use stack::{Ending, Stack};

/// Number of inputs of the network: three for the point, two for the tool's direction.
#[doc(hidden)]
pub const INPUTS: usize = 5;

/// The shape of a sine network; its weights are a flat array beside it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SirenShape {
    /// Neurons of every hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub hidden: usize,
    /// The input is concatenated again behind the activations of this hidden layer, counted from 1.
    /// `None`, or a value of at least `hidden`, means no skip.
    pub skip_after: Option<usize>,
    /// Frequency factor ω inside every sine.
    pub omega: f32,
}

impl Default for SirenShape {
    /// The paper's network with ω = 10: with the paper's 30 it errs more between orientations.
    fn default() -> Self {
        Self { omega: 10.0, ..Self::paper() }
    }
}

impl SirenShape {
    /// The paper's network: five hidden layers of 512 with ω = 30, the input again after the second.
    #[must_use]
    pub fn paper() -> Self {
        Self { width: 512, hidden: 5, skip_after: Some(2), omega: 30.0 }
    }

    /// The rate that Adam begins with by default, in steps of 1,024 samples.
    ///
    /// Every weight of a step moves by about the rate, and ω and the number of neurons multiply what a hidden layer makes of that:
    /// over their product the step of the field itself is the same for all networks. `imf-bench rates` has measured the constant.
    #[must_use]
    pub fn rate(&self) -> f32 {
        1.0 / (self.omega * self.width as f32)
    }
}

/// Where one layer's weights and biases stand in the flat parameter array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Layer {
    /// Inputs of the layer.
    pub inputs: usize,
    /// Outputs of the layer.
    pub outputs: usize,
    /// Offset of `W [outputs][inputs]`, row-major.
    pub weights: usize,
    /// Offset of `b [outputs]`.
    pub biases: usize,
    /// True where the network's input is appended to the layer's input activations.
    pub skip: bool,
}

/// Why a network's description is refused.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ShapeError {
    /// Width or depth is zero or absurd.
    #[error("a network needs 1 to 64 hidden layers of 1 to 8192 neurons, not {hidden} of {width}")]
    Size {
        /// Requested hidden layers.
        hidden: usize,
        /// Requested width.
        width: usize,
    },
    /// ω is not a positive number.
    #[error("the frequency factor must be a positive finite number, not {0}")]
    Omega(f32),
    /// The parameter array has another length than the description requires.
    #[error("the network has {expected} parameters, but {found} were given")]
    Parameters {
        /// Parameters that the description requires.
        expected: usize,
        /// Parameters found.
        found: usize,
    },
    /// State of an optimiser that does not fit the network.
    #[error("{found} numbers of SOAP's means and axes after {step} steps; {expected} belong to the network")]
    OptimiserState {
        /// Numbers given.
        found: usize,
        /// Steps done.
        step: u64,
        /// Numbers needed.
        expected: usize,
    },
    /// Training of a network whose last sines are its outputs.
    #[error("a network without a linear layer behind its sines is evaluated, not trained")]
    NoLastLayer,
    /// A symmetry-reduced network, and a field to distil that does not define the symmetry.
    #[error(
        "symmetry is defined by harmonic fields of a tool that is symmetric about its axis, not by fields over rotations: train \
         without it"
    )]
    Symmetry,
    /// A network reduced by mirror planes, and another field that is not its own image across them.
    #[error(
        "the network was trained for a part that is {0}, and this one is not: train it anew, or go on with a network without \
         symmetry"
    )]
    OtherSymmetry(String),
}

impl From<ShapeError> for imf_core::field::EngineError {
    fn from(error: ShapeError) -> Self {
        Self::Shape(error.to_string())
    }
}

impl SirenShape {
    /// The network as a stack of layers.
    pub fn stack(&self) -> Stack {
        let Self { width, hidden, skip_after, omega } = *self;
        Stack { inputs: INPUTS, width, hidden, skip_after, omega, outputs: 1, ending: Ending::Sigmoid }
    }

    /// Checks width, depth and ω.
    ///
    /// # Errors
    /// Names the value that is out of range.
    pub fn check(&self) -> Result<(), ShapeError> {
        self.stack().check()
    }

    /// The layers in order, hidden ones first, the output layer last: the one definition of the flat layout.
    pub fn layers(&self) -> Vec<Layer> {
        self.stack().layers()
    }

    /// Number of parameters, weights and biases together.
    pub fn parameter_count(&self) -> usize {
        self.stack().parameter_count()
    }

    /// Floating-point operations of one forward pass of one sample (products and sums of the layers).
    pub fn forward_flops(&self) -> usize {
        self.layers().iter().map(|layer| 2 * layer.inputs * layer.outputs).sum()
    }

    /// Starting weights: the first layer U(±1/inputs), the others U(±√(6/inputs)/ω); biases U(±1/√inputs), where
    /// the paper is silent. The same seed gives the same bits on every machine.
    pub fn initial_parameters(&self, seed: u64) -> Vec<f32> {
        self.stack().initial_parameters(seed)
    }
}

/// The five inputs of one pose: unit coordinates of the point in its grid and the angle pair in degrees. A vertical direction
/// has every θ; the network is asked at the middle one, as it errs more at the ends of the range.
#[doc(hidden)]
pub fn features(unit: [f32; 3], theta_degrees: f32, phi_degrees: f32) -> [f32; INPUTS] {
    let theta = if is_vertical(phi_degrees) { 180.0 } else { theta_degrees };
    named_features(unit, [theta, phi_degrees])
}

/// The same with θ as it is given, in whatever direction.
#[doc(hidden)]
pub fn named_features(unit: [f32; 3], [theta_degrees, phi_degrees]: [f32; 2]) -> [f32; INPUTS] {
    [
        2.0 * unit[0] - 1.0,
        2.0 * unit[1] - 1.0,
        2.0 * unit[2] - 1.0,
        theta_degrees / 180.0 - 1.0,
        phi_degrees / 90.0 - 1.0,
    ]
}

/// True where φ in degrees is that of a vertical direction, as the network reads it.
#[doc(hidden)]
pub fn is_vertical(phi_degrees: f32) -> bool {
    (phi_degrees / 90.0 - 1.0).abs() >= 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_network_has_its_parameters() {
        assert_eq!(SirenShape::default().parameter_count(), 1_056_769);
    }

    #[test]
    fn a_vertical_direction_is_asked_at_one_angle() {
        let unit = [0.25, 0.5, 1.0];
        for phi in [0.0, 180.0] {
            let asked = features(unit, 0.0, phi);
            assert_eq!(asked, [-0.5, 0.0, 1.0, 0.0, phi / 90.0 - 1.0]);
            assert_eq!(features(unit, 311.0, phi), asked);
            assert_ne!(named_features(unit, [311.0, phi]), asked);
        }
        for phi in [1e-4, 90.0, 179.9999] {
            assert_eq!(features(unit, 311.0, phi), named_features(unit, [311.0, phi]));
        }
    }

    #[test]
    fn starting_weights_keep_their_bounds_and_their_seed() {
        let shape = SirenShape { width: 32, ..SirenShape::paper() };
        let first = shape.initial_parameters(7);
        assert_eq!(first, shape.initial_parameters(7));
        assert_ne!(first, shape.initial_parameters(8));
        let layers = shape.layers();
        assert!(first[..layers[0].biases].iter().all(|w| w.abs() <= 0.2));
        let bound = (6.0f32 / 32.0).sqrt() / 30.0;
        assert!(first[layers[1].weights..layers[1].biases].iter().all(|w| w.abs() <= bound));
    }
}
