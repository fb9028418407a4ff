//! A model whose decisions are proven.

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::field::{Field, LoadError};
use imf_core::field::minimum::minimum_pose_by_pose;
use imf_core::field::{Best, Decision, ExactField, FieldError, Gradient, PoseField, check_lengths};
use imf_core::motion::{MotionChecker, MotionError, MotionResult};
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::section::Quantity;
use imf_core::tool::Clearance;

/// The values and gradients of a model, and decisions by proof: every pose is [`Decision::Free`] or
/// [`Decision::Colliding`], and `Free` only where the obstacle's distance transform or an exact count shows that no solid
/// voxel's centre lies in the tool. What the model itself would call free is a hint and no more.
///
/// The guarantee is about the scene's true tool, unless it was made by [`VerifiedField::with_clearance`].
pub struct VerifiedField {
    model: Field,
    checker: MotionChecker,
}

impl VerifiedField {
    /// Reads a field of any family, and verifies for the true tool of its scene.
    ///
    /// # Errors
    /// As [`Field::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(Field::load(path)?)
    }

    /// Verifies for the true tool of a model's scene.
    ///
    /// # Errors
    /// None for a tool without clearance.
    pub fn new(model: Field) -> Result<Self, LoadError> {
        Self::with_clearance(model, Clearance::default())
    }

    /// Verifies for the tool offset by a clearance in the scene's unit, such as the scene's own.
    ///
    /// # Errors
    /// A clearance that is no length, or one around a mesh tool.
    pub fn with_clearance(model: Field, clearance: Clearance) -> Result<Self, LoadError> {
        let exact = ExactField::of_scene(model.scene(), &clearance)?;
        Ok(Self { model, checker: MotionChecker::new(exact) })
    }

    /// Verifies for the true tool, offset by a clearance, against the voxels of another scene than the model's, such as one
    /// without contact: decisions are about that scene.
    ///
    /// # Errors
    /// As [`VerifiedField::with_clearance`].
    pub fn of_scene(model: Field, scene: &Scene, clearance: Clearance) -> Result<Self, LoadError> {
        let exact = ExactField::of_scene(scene, &clearance)?;
        Ok(Self { model, checker: MotionChecker::new(exact) })
    }

    /// The model.
    pub fn model(&self) -> &Field {
        &self.model
    }

    /// What decides.
    pub fn exact(&self) -> &ExactField {
        self.checker.field()
    }

    /// True where it is proven that the tool holds no solid voxel's centre; false for an invalid pose.
    pub fn is_free(&self, pose: &Pose) -> bool {
        !self.exact().collides(pose)
    }

    /// As [`MotionChecker::check_motion`].
    ///
    /// # Errors
    /// An end that is an invalid pose, axes that are opposite, a mesh tool.
    pub fn check_motion(&self, a: &Pose, b: &Pose) -> Result<MotionResult, MotionError> {
        self.checker.check_motion(a, b)
    }

    /// The clearance that decisions keep.
    pub fn clearance(&self) -> &Clearance {
        self.exact().assembly().clearance()
    }
}

impl PoseField for VerifiedField {
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
        self.exact().classify(poses, decisions)
    }

    /// Of the rotations proven free the one with the model's minimum; where none is free, the minimum of all.
    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError> {
        check_lengths(points.len(), best.len())?;
        let sharp_points = self.model.sharp_points();
        minimum_pose_by_pose(points, rotations, sharp_points, best, |poses, values, decisions| {
            self.model.values_unclipped(poses, values)?;
            self.classify(poses, decisions)
        })?;
        self.model.hold(best);
        Ok(())
    }
}
