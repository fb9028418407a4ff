//! One interface for every family of fields, on CPU and GPU: values, gradients and decisions at poses, and whole grids.
//!
//! [`ExactField`] counts voxels; the crate `imf-fields` has fields from files of any family. [`world`](mod@crate::world) has checkers, which
//! decide exactly among several obstacles. [`PoseField`] is for planners; [`GridField`] adds the values at all
//! voxel centres at once. Both are object-safe, every method takes `&self`, and threads share one field.
//!
//! # Results
//! - Values are `overlap(x, R)`: the fraction of the tool's volume that lies in the obstacle with the tool's tip at x. Those of
//!   a field of signed penetration depth ([`Quantity`]) are lengths: how far the tool must be moved to be free, below 0 how
//!   far it may be moved. Depths decide far more poses than overlaps do; both decrease towards free space.
//! - [`Decision::Free`] and [`Decision::Colliding`] are decisions by a field's calibration; [`Decision::Undecided`] is for an
//!   exact check to decide. A field without calibration returns `Undecided` everywhere. Exact fields and checkers
//!   decide every pose.
//! - Outside [`PoseField::bounds`] a model is not defined: values and gradients are those of the nearest point inside
//!   (the slope across the face is 0), and the decision is `Undecided`. Exact results hold everywhere, space outside
//!   the grid being empty.
//! - An invalid pose ([`Pose`]) has the value NaN, a gradient of NaN, and is `Colliding`.
//! - `siren5` jumps at θ = 0°/360° and at vertical directions: gradients there are those of one side (θ = 180° of a vertical
//!   one) and finite ([`Gradient`]). Harmonic and factored fields are smooth in every direction.
//!
//! Once a thread's working memory has grown, single poses, proofs and motions allocate nothing, except for mesh
//! tools, which are voxelised. Batches of a model's values and gradients are matrix products, for which the matrix
//! library allocates a few kilobytes for each block of 256 or 64 poses; minima allocate as much for each call.
//! Results may therefore differ in the last bits between batch sizes.
//!
//! # Example
//! ```
//! use imf_core::field::{Decision, ExactField, PoseField};
//! use imf_core::glam::DVec3;
//! use imf_core::parts::ReferencePart;
//! use imf_core::pose::Pose;
//! use imf_core::scene::Scene;
//!
//! let scene = Scene::builder().reference(ReferencePart::Bracket).dims([12, 36, 22]).build()?.scene;
//! let field = ExactField::new(&scene, scene.record.bare_tool())?;
//! let mut decisions = [Decision::Undecided];
//! field.classify(&[Pose::along(DVec3::new(10.0, 20.0, 300.0), DVec3::Z)], &mut decisions)?;
//! assert_eq!(decisions, [Decision::Free]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod descent;
mod exact;
mod exact_depth;
#[doc(hidden)]
pub mod minimum;
pub(crate) mod solid;

pub use descent::{BestPose, DescentSettings, best_orientation};
pub use exact::ExactField;
pub(crate) use exact::PreparedObstacle;

use glam::{DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::control::{Cancelled, Control};
use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::parallel;
use crate::pose::Pose;
use crate::section::{Imf, Quantity, SectionError};
use crate::tool::{ClearanceError, ToolError};
use minimum::with_sharp_point_at;

/// Whether the tool collides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// It does not.
    Free,
    /// It does.
    Colliding,
    /// Too close to tell: an exact field must decide.
    Undecided,
}

impl Decision {
    /// Of what is decided exactly.
    pub(crate) fn of(collides: bool) -> Self {
        if collides { Self::Colliding } else { Self::Free }
    }
}

/// A value and how it changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gradient {
    /// The overlap, not clipped: a model's may lie a little outside [0, 1]. Of a field of depth the depth, not clamped either.
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
    /// Of an invalid pose.
    pub const NAN: Self =
        Self { value: f32::NAN, position: Vec3::NAN, direction: Vec3::NAN, rotation: Vec3::NAN };

    /// The same about another point of the tool than its tip, given in the tool's frame, such as the centre of its ball: turns leave that
    /// point where it is. `pose` is the one that the gradient is of.
    #[must_use]
    pub fn about(&self, pose: &Pose, pivot: DVec3) -> Self {
        let Some(axis) = pose.axis() else { return Self::NAN };
        // A turn about the pivot moves the tip by −ω × R·pivot.
        let rotation =
            self.rotation.as_dvec3() - (pose.rotation.normalize() * pivot).cross(self.position.as_dvec3());
        Self { rotation: rotation.as_vec3(), direction: rotation.cross(axis).as_vec3(), ..*self }
    }
}

/// The best orientation at a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// The minimum of the collision measure, in [0, 1], or of the depth; NaN for a point that is not finite.
    pub value: f32,
    /// Its orientation, by its place in the list: the first of equals, one that is decided free before all others.
    pub orientation: u32,
    /// The decision there.
    pub decision: Decision,
}

impl Best {
    /// The result at an invalid point, or before any orientation is tried.
    pub const NONE: Self = Self { value: f32::NAN, orientation: 0, decision: Decision::Colliding };
}

/// Why an engine of training or evaluation failed: its device, or what it was given.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The device is gone or out of memory, or a call to it failed.
    #[error("{0}")]
    Device(String),
    /// A batch, a shape or a state that does not fit.
    #[error("{0}")]
    Shape(String),
}

/// Why a query failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FieldError {
    /// The output slice and the queries differ in length.
    #[error("{queries} queries need an output slice as long, not of {results}")]
    Length {
        /// Poses or points.
        queries: usize,
        /// Length of the output slice.
        results: usize,
    },
    /// An obstacle that is none.
    #[error("the obstacle's voxels must be a byte for each voxel of its grid, 0 or 1")]
    Voxels,
    /// A minimum over no orientation, or over too many.
    #[error("the minimum over {0} orientations: give at least one, and fewer than 2^32")]
    Orientations(usize),
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A clearance that is not a length, or that the tool cannot have.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// An exact section failed.
    #[error(transparent)]
    Section(SectionError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

impl From<SectionError> for FieldError {
    fn from(error: SectionError) -> Self {
        match error {
            SectionError::Cancelled(stop) => Self::Cancelled(stop),
            SectionError::Tool(error) => Self::Tool(error),
            SectionError::Clearance(error) => Self::Clearance(error),
            error => Self::Section(error),
        }
    }
}

/// A field that is evaluated at poses, on the calling thread or on its device.
///
/// # Errors
/// All methods: an output slice of another length than the queries; an exact field may find that a tool holds no voxel; a
/// device may fail.
pub trait PoseField: Send + Sync {
    /// What the values are: a fraction, or a length.
    fn quantity(&self) -> Quantity;

    /// The field's domain: lower and upper corner of its box, in world units; `None` where it is all of space.
    fn bounds(&self) -> Option<[DVec3; 2]>;

    /// `overlap(x, R)` in [0, 1] of every pose, or its depth.
    fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError>;

    /// Values with their derivatives by position and by rotation.
    ///
    /// Those of [`ExactField`], whose values are steps, are differences over a voxel's width; see its
    /// implementation.
    fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError>;

    /// Whether the tool collides.
    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError>;

    /// The minimum of the collision measure over some rotations at every point, that is over the tool's sharp points k the minimum of
    /// `overlap(x − R k, R)`: the inaccessibility measure, with the best rotation.
    ///
    /// # Errors
    /// See the trait; no rotation.
    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError>;
}

/// A field that gives the values at all voxel centres of a grid at once.
pub trait GridField: PoseField {
    /// The grid.
    fn grid(&self) -> &Grid;

    /// The values at every voxel centre in one orientation, C-ordered.
    ///
    /// # Errors
    /// A family's own failure.
    ///
    /// # Panics
    /// If `values` has not the grid's length.
    fn section(&self, orientation: &Orientation, values: &mut [f32]) -> Result<(), FieldError> {
        self.sections(std::slice::from_ref(orientation), values)
    }

    /// The same in some orientations, `[orientation][voxel]`.
    ///
    /// # Errors
    /// A family's own failure.
    ///
    /// # Panics
    /// If `values` has not as many sections.
    fn sections(&self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), FieldError>;

    /// The minimum of the values over some orientations at every voxel centre, with the index of the first orientation that has it.
    /// One unit of progress is one value, of a voxel in an orientation.
    ///
    /// # Errors
    /// A family's own failure; [`FieldError::Cancelled`] when the control asks to stop.
    fn minimum(&self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, FieldError>;
}

/// Collision measures: the minimum of the overlap over sharp points `k` (tool frame) at `x − R k`; `values` gives overlaps, as
/// [`PoseField::values`] does.
///
/// # Errors
/// As `values`.
pub fn collision_measures(
    mut values: impl FnMut(&[Pose], &mut [f32]) -> Result<(), FieldError>,
    sharp_points: &[DVec3],
    poses: &[Pose],
    measures: &mut [f32],
) -> Result<(), FieldError> {
    check_lengths(poses.len(), measures.len())?;
    measures.fill(f32::INFINITY);
    let mut overlaps = vec![0.0; poses.len()];
    for &sharp in sharp_points {
        let shifted = poses.iter().map(|pose| with_sharp_point_at(pose.position, sharp, pose.rotation));
        let shifted: Vec<Pose> = shifted.collect();
        values(&shifted, &mut overlaps)?;
        for (measure, &overlap) in measures.iter_mut().zip(&overlaps) {
            // NaN of an invalid pose stays.
            *measure = if overlap.is_nan() { overlap } else { measure.min(overlap) };
        }
    }
    Ok(())
}

/// Poses that are decided together: the fewer there are, the emptier are the later passes' lanes of a batch.
pub(crate) const BLOCK: usize = 512;

/// Decides poses a block at a time: `collide` notes which of them collide, of which none is known to before.
pub(crate) fn classify_blocks(
    poses: &[Pose],
    decisions: &mut [Decision],
    collide: impl Fn(&[Pose], &mut [bool]),
) -> Result<(), FieldError> {
    check_lengths(poses.len(), decisions.len())?;
    for (poses, decisions) in poses.chunks(BLOCK).zip(decisions.chunks_mut(BLOCK)) {
        let mut colliding = [false; BLOCK];
        collide(poses, &mut colliding[..poses.len()]);
        for (decision, colliding) in decisions.iter_mut().zip(colliding) {
            *decision = Decision::of(colliding);
        }
    }
    Ok(())
}

/// Poses that a thread evaluates at a time.
const CHUNK: usize = 256;

/// The values of many poses on all threads of the current pool: for fields that evaluate on the calling thread.
///
/// # Errors
/// As [`PoseField::values`].
pub fn values_on_all_threads(
    field: &dyn PoseField,
    poses: &[Pose],
    values: &mut [f32],
) -> Result<(), FieldError> {
    check_lengths(poses.len(), values.len())?;
    parallel::try_for_each_chunk(values, CHUNK, |index, values| {
        field.values(&poses[index * CHUNK..][..values.len()], values)
    })
}

/// Checks that the output slice is as long as the queries; every field does so first.
///
/// # Errors
/// [`FieldError::Length`]: it has not.
pub fn check_lengths(queries: usize, results: usize) -> Result<(), FieldError> {
    if queries == results { Ok(()) } else { Err(FieldError::Length { queries, results }) }
}
