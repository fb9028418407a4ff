//! A field from a file, whichever family it is of.

use std::path::Path;

use glam::{DVec3, Quat, Vec3};

use crate::calibration::Calibration;
use crate::learnt::LoadError;
use crate::learnt::families::{Family, Scratch};
use crate::siren::evaluator::CpuEvaluator;
use crate::stored::StoredField;
use imf_core::planner::least::{BLOCK, check_minimum, least};
use imf_core::planner::{Best, Decision, Gradient, PlannerError, Pose, PoseField, check_lengths};
use imf_core::scene::Scene;
use imf_core::section::Quantity;
use imf_core::workspaces::Workspaces;

/// A learnt field: a network of the paper's kind, a harmonic field, or a factored one.
///
/// Values are approximate. Decisions follow the field's calibration and are as good as that says
/// ([`NeuralField::calibration`]); for answers that are never wrong there is [`GuardedField`](super::GuardedField).
pub struct NeuralField {
    family: Family,
    scene: Scene,
    calibration: Option<Calibration>,
    sharp_points: Vec<DVec3>,
    scratch: Workspaces<Scratch>,
}

impl NeuralField {
    /// Reads a field of any family.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(StoredField::read(path.as_ref())?)
    }

    /// A field that was read or made already.
    ///
    /// # Errors
    /// Weights that do not fit their network.
    pub fn new(stored: StoredField) -> Result<Self, LoadError> {
        let (family, scene, calibration) = match stored {
            StoredField::Siren(model) => {
                let network = CpuEvaluator::new(model.shape, &model.state.parameters)?;
                (Family::Siren(network), model.scene, model.calibration)
            }
            StoredField::Harmonic(file) => (Family::Harmonic(file.field), file.scene, file.calibration),
            StoredField::Factored(file) => {
                (Family::Factored(Box::new(file.field.into_evaluator())), file.scene, file.calibration)
            }
        };
        family.prepare();
        let sharp_points = scene.record.tool.sharp_point_positions(scene.record.grid.pitch);
        Ok(Self { family, scene, calibration, sharp_points, scratch: Workspaces::default() })
    }

    /// What the field is of: part, grid, tool and clearance.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What its values are.
    #[must_use]
    pub fn quantity(&self) -> Quantity {
        self.family.quantity()
    }

    /// What its decisions are worth, where that was measured.
    #[must_use]
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// The points at which the tool cuts, in its frame.
    pub(super) fn sharp_points(&self) -> &[DVec3] {
        &self.sharp_points
    }

    /// Decides by other thresholds.
    #[must_use]
    pub fn with_calibration(self, calibration: Option<Calibration>) -> Self {
        Self { calibration, ..self }
    }

    /// Values that are not clipped; NaN of what is no pose.
    ///
    /// # Errors
    /// Lengths that differ.
    pub fn query_unclipped(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), values.len())?;
        let grid = &self.scene.record.grid;
        self.scratch.with(|scratch| {
            for (poses, values) in poses.chunks(BLOCK).zip(values.chunks_mut(BLOCK)) {
                self.family.values(grid, poses, values, scratch);
            }
        });
        for (pose, value) in poses.iter().zip(values) {
            if !pose.is_pose() {
                *value = f32::NAN;
            }
        }
        Ok(())
    }

    /// Values as they are answered.
    pub(super) fn hold(&self, best: &mut [Best]) {
        let quantity = self.quantity();
        best.iter_mut().for_each(|best| best.value = quantity.held(best.value));
    }

    /// The decision of an unclipped value of this field with the tip at a point, for those who have values by other ways.
    #[must_use]
    pub fn decide(&self, position: Vec3, value: f32) -> Decision {
        if value.is_nan() {
            return Decision::Blocked;
        }
        let Some(calibration) = &self.calibration else { return Decision::Near };
        if !self.scene.record.grid.is_between_centres(position.as_dvec3()) {
            return Decision::Near;
        }
        if calibration.free_up_to.is_some_and(|free| value <= free) {
            Decision::Free
        } else if calibration.blocked_from.is_some_and(|blocked| value >= blocked) {
            Decision::Blocked
        } else {
            Decision::Near
        }
    }
}

impl PoseField for NeuralField {
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        self.query_unclipped(poses, values)?;
        let quantity = self.quantity();
        values.iter_mut().for_each(|value| *value = quantity.held(*value));
        Ok(())
    }

    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), gradients.len())?;
        let grid = &self.scene.record.grid;
        self.scratch.with(|scratch| {
            for (pose, out) in poses.iter().zip(gradients) {
                *out = self.family.gradient(grid, pose, scratch).unwrap_or(Gradient::NAN);
            }
        });
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), decisions.len())?;
        let mut values = [0.0; BLOCK];
        for (poses, decisions) in poses.chunks(BLOCK).zip(decisions.chunks_mut(BLOCK)) {
            let values = &mut values[..poses.len()];
            self.query_unclipped(poses, values)?;
            for ((pose, value), decision) in poses.iter().zip(values).zip(decisions) {
                *decision = self.decide(pose.position, *value);
            }
        }
        Ok(())
    }

    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError> {
        check_minimum(points, orientations, best)?;
        let grid = &self.scene.record.grid;
        let by_products = self.sharp_points == [DVec3::ZERO]
            && self.scratch.with(|scratch| {
                let decide = |point, value| self.decide(point, value);
                self.family.least(grid, points, orientations, best, scratch, decide)
            });
        if !by_products {
            least(points, orientations, &self.sharp_points, best, |poses, values, decisions| {
                self.query_unclipped(poses, values)?;
                for ((pose, value), decision) in poses.iter().zip(values.iter()).zip(decisions) {
                    *decision = self.decide(pose.position, *value);
                }
                Ok(())
            })?;
        }
        self.hold(best);
        Ok(())
    }
}
