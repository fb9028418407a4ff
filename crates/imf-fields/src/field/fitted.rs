//! A field from a file, whichever family it is of.

use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::calibration::Calibration;
use crate::factored::{AROUND_AXIS, Axis};
use crate::field::LoadError;
use crate::field::families::{Family, Kind, Scratch};
use crate::file::FieldFile;
use crate::harmonic::coefficients::StoragePrecision;
use crate::harmonic::file::HarmonicFile;
use crate::harmonic::{FitReport, FitSettings, minimum_over, sections_of};
use crate::siren::evaluator::CpuEvaluator;
use crate::siren::matrix::prefer_unpacked;
use crate::siren::over_grid;
use imf_core::control::Control;
use imf_core::field::minimum::{BLOCK, check_minimum, minimum_pose_by_pose};
use imf_core::field::{Best, Decision, FieldError, Gradient, GridField, PoseField, check_lengths};
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::section::{Imf, Quantity};
use imf_core::workspaces::Workspaces;

/// A field of every direction at once: a network of the paper's kind, a harmonic field, or a factored one.
///
/// Values are approximate. Decisions follow the field's calibration and are as good as that says
/// ([`Field::calibration`]); for results that are never wrong there is [`Planner`](super::Planner).
pub struct Field {
    family: Family,
    scene: Scene,
    calibration: Option<Calibration>,
    /// Of a symmetry-reduced field: around it nothing is decided.
    axis: Option<Axis>,
    /// The points at which the tool cuts, in its frame.
    pub(super) sharp_points: Vec<DVec3>,
    scratch: Workspaces<Scratch>,
}

impl Field {
    /// Reads a field of any family.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(FieldFile::read(path.as_ref())?)
    }

    /// A field of any family from a file in memory; errors call it `name`.
    ///
    /// # Errors
    /// Foreign, newer, truncated or damaged bytes.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self, LoadError> {
        Self::new(FieldFile::from_bytes(bytes, name)?)
    }

    /// A field that was read or made already.
    ///
    /// # Errors
    /// Weights that do not fit their network; a harmonic field of another grid than its scene's.
    pub fn new(file: FieldFile) -> Result<Self, LoadError> {
        let axis = match &file {
            FieldFile::Factored(file) => file.field.shape.symmetry.axis,
            FieldFile::Siren(_) | FieldFile::Harmonic(_) => None,
        };
        let (family, scene, calibration) = match file {
            FieldFile::Siren(model) => {
                let network = CpuEvaluator::new(model.shape, &model.state.parameters)?;
                (Family::Siren(network), model.scene, model.calibration)
            }
            FieldFile::Harmonic(file) => {
                file.check_grid()?;
                let (scene, calibration) = (file.scene.clone(), file.calibration);
                (Family::harmonic(file), scene, calibration)
            }
            FieldFile::Factored(file) => {
                (Family::Factored(Box::new(file.field.into_evaluator())), file.scene, file.calibration)
            }
        };
        prefer_unpacked();
        let sharp_points = scene.record.tool.sharp_point_positions(scene.record.grid.pitch);
        Ok(Self { family, scene, calibration, axis, sharp_points, scratch: Workspaces::default() })
    }

    /// The same field with products in `f32` on every CPU, as GPUs make them: AMX's are ten times as far from the definition.
    #[doc(hidden)]
    #[must_use]
    pub fn in_f32(mut self) -> Self {
        match &mut self.family {
            Family::Siren(network) => network.split = None,
            Family::Harmonic(_, split) => *split = None,
            Family::Factored(evaluator) => (evaluator.split, evaluator.split_functions) = (None, None),
        }
        self
    }

    /// What the field is of: part, grid, tool and clearance.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The same field with a factored field's coefficients of every voxel held in memory, 4 bytes a coefficient and
    /// voxel: for many calls over the whole grid. Other families are unchanged.
    #[must_use]
    pub fn expanded(self) -> Self {
        let Family::Factored(evaluator) = &self.family else { return self };
        let field = evaluator.expanded(StoragePrecision::F32, FitReport::default());
        let (scene, settings) = (self.scene.clone(), FitSettings::default());
        let file = HarmonicFile { field, scene, settings, calibration: None };
        Self { family: Family::harmonic(Arc::new(file)), ..self }
    }

    /// The calibration of its decisions, where measured.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// Decides by other thresholds.
    #[must_use]
    pub fn with_calibration(self, calibration: Option<Calibration>) -> Self {
        Self { calibration, ..self }
    }

    /// Values that are not clipped; NaN of invalid poses.
    ///
    /// # Errors
    /// Lengths that differ.
    pub fn values_unclipped(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        check_lengths(poses.len(), values.len())?;
        let grid = &self.scene.record.grid;
        self.scratch.with(|scratch| {
            for (poses, values) in poses.chunks(BLOCK).zip(values.chunks_mut(BLOCK)) {
                self.family.values(grid, poses, values, scratch);
            }
        });
        for (pose, value) in poses.iter().zip(values) {
            if !pose.is_valid() {
                *value = f32::NAN;
            }
        }
        Ok(())
    }

    /// [`Field::values_unclipped`], and what is decided by them.
    fn values_and_decisions(
        &self,
        poses: &[Pose],
        values: &mut [f32],
        decisions: &mut [Decision],
    ) -> Result<(), FieldError> {
        self.values_unclipped(poses, values)?;
        for ((pose, value), decision) in poses.iter().zip(values).zip(decisions) {
            *decision = self.decide(pose.position, *value);
        }
        Ok(())
    }

    /// Values as they are returned.
    pub(super) fn hold(&self, best: &mut [Best]) {
        let (quantity, pitch) = (self.quantity(), self.scene.record.grid.pitch);
        best.iter_mut().for_each(|best| best.value = quantity.clamp(best.value, pitch));
    }

    /// The decision of an unclipped value of this field with the tip at a point, for those who have values by other ways.
    pub fn decide(&self, position: DVec3, value: f32) -> Decision {
        match &self.calibration {
            _ if value.is_nan() => Decision::Colliding,
            Some(calibration) if self.decides_at(position) => calibration.decide(value),
            _ => Decision::Undecided,
        }
    }

    /// True with the tip among the voxels' centres, where a value may decide, and not around an axis.
    pub(super) fn decides_at(&self, position: DVec3) -> bool {
        let grid = &self.scene.record.grid;
        let is_apart = |axis: Axis| axis.distance(position) > AROUND_AXIS * grid.pitch;
        grid.is_between_centres(position) && self.axis.is_none_or(is_apart)
    }

    /// The line around which nothing is decided, as far as so many lengths.
    #[doc(hidden)]
    pub fn undecided_around(&self) -> Option<(Axis, f64)> {
        self.axis.map(|axis| (axis, AROUND_AXIS * self.scene.record.grid.pitch))
    }
}

impl PoseField for Field {
    fn quantity(&self) -> Quantity {
        self.family.quantity()
    }

    fn bounds(&self) -> Option<[DVec3; 2]> {
        Some(self.scene.record.grid.box_of_centres())
    }

    fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        self.values_unclipped(poses, values)?;
        let (quantity, pitch) = (self.quantity(), self.scene.record.grid.pitch);
        values.iter_mut().for_each(|value| *value = quantity.clamp(*value, pitch));
        Ok(())
    }

    fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError> {
        check_lengths(poses.len(), gradients.len())?;
        let grid = &self.scene.record.grid;
        self.scratch.with(|scratch| self.family.gradients(grid, poses, gradients, scratch));
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        check_lengths(poses.len(), decisions.len())?;
        let mut values = [0.0; BLOCK];
        for (poses, decisions) in poses.chunks(BLOCK).zip(decisions.chunks_mut(BLOCK)) {
            self.values_and_decisions(poses, &mut values[..poses.len()], decisions)?;
        }
        Ok(())
    }

    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError> {
        check_minimum(points, rotations, best)?;
        let grid = &self.scene.record.grid;
        let by_products = self.sharp_points == [DVec3::ZERO]
            && self.scratch.with(|scratch| {
                let decide = |point, value| self.decide(point, value);
                self.family.least(grid, points, rotations, best, scratch, decide)
            });
        if !by_products {
            minimum_pose_by_pose(points, rotations, &self.sharp_points, best, |poses, values, decisions| {
                self.values_and_decisions(poses, values, decisions)
            })?;
        }
        self.hold(best);
        Ok(())
    }
}

/// A factored field's network runs at every voxel for each call; for many calls expand it first ([`Field::expanded`]).
impl GridField for Field {
    fn grid(&self) -> &Grid {
        &self.scene.record.grid
    }

    fn sections(&self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), FieldError> {
        let voxels = self.grid().len();
        assert_eq!(values.len(), voxels * orientations.len(), "one section for each orientation");
        match self.family.kind() {
            Kind::Sum(source, _) => sections_of(source, &source.direction_weights(orientations), values),
            Kind::Network(mut network) => {
                for (orientation, section) in orientations.iter().zip(values.chunks_exact_mut(voxels)) {
                    over_grid::section(&mut network, self.grid(), orientation.angles(), section)?;
                }
            }
        }
        Ok(())
    }

    fn minimum(&self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, FieldError> {
        if orientations.is_empty() {
            return Err(FieldError::Orientations(0));
        }
        match self.family.kind() {
            Kind::Sum(source, _) => minimum_over(source, orientations, control),
            Kind::Network(mut network) => {
                let directions: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
                over_grid::minimum(&mut network, self.grid(), &directions, control)
            }
        }
    }
}
