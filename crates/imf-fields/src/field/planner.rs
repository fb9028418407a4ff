//! A checker and a model: what planners need.

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::field::{Field, LoadError};
use imf_core::field::minimum::minimum_pose_by_pose;
use imf_core::field::{Best, Decision, FieldError, Gradient, PoseField, check_lengths};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::tool::Clearance;
use imf_core::world::Checker;

/// A checker, which decides, beside a model, which has values and gradients. Every pose is [`Decision::Free`] or
/// [`Decision::Colliding`], and `Free` only where the checker proves it. What the model itself would call free is a hint and
/// no more.
///
/// The two need not be of the same voxels: a model of the part alone steers well among fixtures that the checker knows. Their lengths are in one
/// unit and one frame.
pub struct Planner {
    /// What decides.
    pub checker: Checker,
    /// Gives values and gradients.
    pub model: Field,
}

impl Planner {
    /// Reads a field of any family, and checks the true tool of its scene.
    ///
    /// # Errors
    /// As [`Field::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(Field::load(path)?)
    }

    /// Checks the true tool of a model's scene.
    ///
    /// # Errors
    /// None for a tool without clearance.
    pub fn new(model: Field) -> Result<Self, LoadError> {
        Self::with_clearance(model, Clearance::default())
    }

    /// Checks the tool offset by a clearance in the scene's unit, such as the scene's own.
    ///
    /// # Errors
    /// A clearance that is not a length, or one around a mesh tool.
    pub fn with_clearance(model: Field, clearance: Clearance) -> Result<Self, LoadError> {
        Ok(Self { checker: Checker::of_scene(model.scene(), &clearance)?, model })
    }
}

impl PoseField for Planner {
    fn quantity(&self) -> Quantity {
        self.model.quantity()
    }

    fn bounds(&self) -> Option<[DVec3; 2]> {
        self.model.bounds()
    }

    fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        self.model.values(poses, values)
    }

    fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError> {
        self.model.gradients(poses, gradients)
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        self.checker.classify(poses, decisions)
    }

    /// Of the rotations proven free the one with the model's minimum; where none is free, the minimum of all.
    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError> {
        check_lengths(points.len(), best.len())?;
        let sharp_points = &self.model.sharp_points;
        minimum_pose_by_pose(points, rotations, sharp_points, best, |poses, values, decisions| {
            self.model.values_unclipped(poses, values)?;
            self.classify(poses, decisions)
        })?;
        self.model.hold(best);
        Ok(())
    }
}
