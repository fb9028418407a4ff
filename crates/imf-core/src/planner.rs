//! What a planner embeds: fields that answer poses in single precision, with gradients and with decisions.
//!
//! [`PoseField`] is the one interface. [`ExactField`](crate::field::ExactField) counts voxels; the crate `imf-fields` has fields
//! from files of any family, and verified ones, which have a model's values and gradients and decide by proof. All are
//! `Send + Sync` and answer batches of any size on the thread that calls; threads share one field.
//!
//! Once a thread's working memory has grown, single poses, gradients, proofs and motions allocate nothing (but for tools that
//! are meshes, which are voxelised). Batches of a model's values are matrix products, for which the library that
//! multiplies takes some buffers of a few kilobytes a block of 256 poses, and gives them back.
//!
//! # What is answered
//! - Values are `overlap(x, R)`: the share of the tool's volume that lies in the obstacle with the tool's tip at x. Those of
//!   a field of signed depth ([`Quantity`](crate::section::Quantity)) are lengths: how far the tool must be moved to be free, below 0 how
//!   far it may be moved. Decisions by depth are the sharper ones by far; either falls towards freedom.
//! - [`Decision::Free`] and [`Decision::Blocked`] are decisions by a field's calibration; [`Decision::Near`] is for an
//!   exact check to decide. A field without calibration answers `Near` everywhere. Exact and verified fields
//!   decide every pose.
//! - Outside the box of the grid's voxel centres a model knows nothing: values and gradients are those of the nearest
//!   point inside (the slope across the face is 0), and the decision is `Near`. Exact answers hold everywhere, space
//!   outside the grid being empty.
//! - What is no pose ([`Pose`]) has the value NaN, a gradient of NaN, and is `Blocked`.
//! - `siren5` jumps at θ = 0°/360° and knows several values at the poles: gradients there are those of one side and finite
//!   ([`Gradient`]). Harmonic and factored fields are smooth in every direction.
//!
//! # Example
//! ```
//! use glam::Vec3;
//! use imf_core::field::ExactField;
//! use imf_core::parts::ReferencePart;
//! use imf_core::planner::{Decision, Pose, PoseField};
//! use imf_core::scene::SceneSpec;
//! use imf_core::tool::Tool;
//!
//! let (part, tool) = (ReferencePart::Bracket, Tool::paper());
//! let scene = SceneSpec::of_reference(part, &part.mesh(), [12, 36, 22], &tool).scene()?;
//! let field = ExactField::of_tool(&scene.obstacle, &tool);
//! let mut decisions = [Decision::Near];
//! field.classify(&[Pose::along(Vec3::new(10.0, 20.0, 300.0), Vec3::Z)], &mut decisions)?;
//! assert_eq!(decisions, [Decision::Free]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[doc(hidden)]
pub mod differences;
#[doc(hidden)]
pub mod exact;
#[doc(hidden)]
pub mod guard;
#[doc(hidden)]
pub mod least;
#[doc(hidden)]
pub mod motion;
mod pose;

pub use motion::{MotionError, Passage};
pub use pose::{Pose, rotation_along};

use glam::{Quat, Vec3};
use thiserror::Error;

use crate::field::EngineError;
use crate::tool::ToolError;

/// Whether the tool collides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// It does not.
    Free,
    /// It does.
    Blocked,
    /// Too close to tell: an exact field must decide.
    Near,
}

/// A value and how it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradient {
    /// The overlap, not clipped: a model's may lie a little outside [0, 1]. Of a field of depth the depth.
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: Vec3,
    /// Change for a turn of the tool's axis by a radian: tangent to the sphere at the axis d.
    pub direction: Vec3,
    /// Change for a turn of the whole tool by a radian, as a vector ω in the world frame (`R → exp([ω]×) R`). For a tool of
    /// revolution it is `d × direction`, since ω moves d by ω × d; for others `direction` is its part that turns the axis.
    pub rotation: Vec3,
}

impl Gradient {
    /// Of what is no pose.
    pub const NAN: Self =
        Self { value: f32::NAN, position: Vec3::NAN, direction: Vec3::NAN, rotation: Vec3::NAN };
}

/// The best way to reach a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Best {
    /// The least collision measure, in [0, 1], or the least depth; NaN for a point that is not finite.
    pub value: f32,
    /// Its orientation, by its place in the list: the first of equals, one that is decided free before all others.
    pub orientation: u32,
    /// What is decided there.
    pub decision: Decision,
}

impl Best {
    /// Of what cannot be reached, or is no point.
    pub const NONE: Self = Self { value: f32::NAN, orientation: 0, decision: Decision::Blocked };
}

/// Why poses are not answered.
#[derive(Debug, Error)]
pub enum PlannerError {
    /// As many answers as questions are needed.
    #[error("{asked} questions need as many places for answers, not {answers}")]
    Length {
        /// Poses or points asked.
        asked: usize,
        /// Places given.
        answers: usize,
    },
    /// A minimum over nothing.
    #[error("the least over {0} orientations: give at least one, and fewer than 2^32")]
    Orientations(usize),
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The device that answers failed.
    #[error(transparent)]
    Device(#[from] EngineError),
}

/// A field that answers poses.
///
/// # Errors
/// All methods: as many answers as questions are needed; an exact field may find that a tool holds no voxel.
pub trait PoseField: Send + Sync {
    /// `overlap(x, R)` in [0, 1] of every pose, or its depth.
    ///
    /// # Errors
    /// See the trait.
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError>;

    /// Values with their derivatives by position and by direction.
    ///
    /// Those of `ExactField`, whose values are steps, are differences over a voxel's width; see its
    /// implementation.
    ///
    /// # Errors
    /// See the trait.
    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError>;

    /// Whether the tool collides.
    ///
    /// # Errors
    /// See the trait.
    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError>;

    /// The least collision measure over some orientations at every point, that is over the tool's sharp points k the least
    /// `overlap(x − R k, R)`: the inaccessibility measure, with the best orientation.
    ///
    /// # Errors
    /// See the trait; no orientation.
    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError>;
}

/// That there are as many places for answers as questions: what every [`PoseField`] checks first.
///
/// # Errors
/// [`PlannerError::Length`]: there are not.
pub fn check_lengths(asked: usize, answers: usize) -> Result<(), PlannerError> {
    if asked == answers { Ok(()) } else { Err(PlannerError::Length { asked, answers }) }
}
