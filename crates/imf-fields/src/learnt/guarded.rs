//! A model whose decisions are proven.

use std::path::Path;

use glam::{Quat, Vec3};

use crate::learnt::{LoadError, NeuralField};
use imf_core::field;
use imf_core::planner::guard::Guard;
use imf_core::planner::least::least;
use imf_core::planner::motion::{Growths, MotionError, Passage, free_along};
use imf_core::planner::{Best, Decision, Gradient, PlannerError, Pose, PoseField, check_lengths};
use imf_core::scene::Scene;
use imf_core::tool::Clearance;

/// The values and gradients of a model, and decisions by proof: every pose is [`Decision::Free`] or
/// [`Decision::Blocked`], and `Free` only where the obstacle's distance transform or an exact count shows that no solid
/// voxel's centre lies in the tool. What the model itself would call free is a hint and no more.
///
/// The promise is about the scene's true tool, unless it was made by [`GuardedField::keeping`].
pub struct GuardedField {
    model: NeuralField,
    /// What decisions are about.
    scene: Scene,
    guard: Guard,
    clearance: Clearance,
    growths: Growths,
}

impl GuardedField {
    /// Reads a field of any family, and guards the true tool of its scene.
    ///
    /// # Errors
    /// As [`NeuralField::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(NeuralField::load(path)?)
    }

    /// Guards the true tool of a model's scene.
    ///
    /// # Errors
    /// None for a tool without clearance.
    pub fn new(model: NeuralField) -> Result<Self, LoadError> {
        Self::keeping(model, Clearance::default())
    }

    /// Guards the tool grown by a clearance in the scene's unit, such as the scene's own.
    ///
    /// # Errors
    /// A clearance that is no length, or one around a mesh tool.
    pub fn keeping(model: NeuralField, clearance: Clearance) -> Result<Self, LoadError> {
        let scene = model.scene().clone();
        Self::of_scene(model, &scene, clearance)
    }

    /// Guards the true tool, grown by a clearance, against the voxels of another scene than the model's, such as one
    /// without contact: decisions are about that scene.
    ///
    /// # Errors
    /// As [`GuardedField::keeping`].
    pub fn of_scene(model: NeuralField, scene: &Scene, clearance: Clearance) -> Result<Self, LoadError> {
        let guard = Guard::new(scene, &clearance)?;
        Ok(Self { model, scene: scene.clone(), guard, clearance, growths: Growths::default() })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &NeuralField {
        &self.model
    }

    /// True where it is proven that the guarded tool holds no solid voxel's centre, at a pose in double precision; false
    /// for an invalid pose.
    #[must_use]
    pub fn is_free(&self, pose: &field::Pose) -> bool {
        pose.is_valid() && self.guard.bodies.iter().all(|body| !body.collides(pose))
    }

    /// Whether the guarded tool may move from `a` to `b`: the tip along the straight line, the axis along the great circle,
    /// both evenly. Proven free, or blocked, or unknown where the tool passes by closer than a thirtieth of a voxel.
    /// The first call makes the tools that proofs need.
    ///
    /// # Errors
    /// An end that is no pose, axes that are opposite, a mesh tool.
    pub fn free_along(&self, a: &Pose, b: &Pose) -> Result<Passage, MotionError> {
        free_along(&self.scene, &self.guard, &self.growths, &self.clearance, a, b)
    }

    /// The clearance that decisions keep.
    #[must_use]
    pub fn clearance(&self) -> &Clearance {
        &self.clearance
    }
}

impl PoseField for GuardedField {
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        self.model.query(poses, values)
    }

    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError> {
        self.model.query_with_gradient(poses, gradients)
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), decisions.len())?;
        for (pose, decision) in poses.iter().zip(decisions) {
            *decision = if self.guard.touches(pose) { Decision::Blocked } else { Decision::Free };
        }
        Ok(())
    }

    /// Of the orientations proven free the one with the model's least value; where none is free, the least of all.
    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError> {
        let sharp_points = self.model.sharp_points();
        least(points, orientations, sharp_points, best, |poses, values, decisions| {
            self.model.query_unclipped(poses, values)?;
            self.classify(poses, decisions)
        })?;
        self.model.hold(best);
        Ok(())
    }
}
