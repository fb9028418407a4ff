//! A trained network as a field.

use crate::siren::EvaluationEngine;
use crate::siren::{INPUTS, features};
use imf_core::control::Control;
use imf_core::field::{Field, Pose, QueryError, WholeField, check_lengths};
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::Imf;

/// Poses that are turned into inputs at a time.
const CHUNK: usize = 1 << 16;

/// Directions that a minimum is taken over in one call of an engine, at most.
const DIRECTIONS: usize = 1024;

/// A network evaluated by an engine, CPU or GPU. Positions outside the box of the voxel centres, where nothing was trained, are
/// answered as the nearest point inside, without promise.
pub struct LearntField<'a> {
    grid: Grid,
    engine: &'a mut dyn EvaluationEngine,
    inputs: Vec<f32>,
}

impl<'a> LearntField<'a> {
    /// The field of a network that was trained on `grid`.
    #[must_use]
    pub fn new(grid: Grid, engine: &'a mut dyn EvaluationEngine) -> Self {
        Self { grid, engine, inputs: Vec::new() }
    }

    /// Values at all voxel centres for one angle pair in degrees, C-ordered into `values`.
    ///
    /// # Errors
    /// A device that failed.
    ///
    /// # Panics
    /// If `values` has not the grid's length.
    pub fn section(&mut self, angles: [f32; 2], values: &mut [f32]) -> Result<(), QueryError> {
        assert_eq!(values.len(), self.grid.len(), "one value for each voxel");
        for (chunk, out) in values.chunks_mut(CHUNK).enumerate() {
            self.inputs.clear();
            for index in chunk * CHUNK..chunk * CHUNK + out.len() {
                let unit = self.grid.unit(self.grid.centre(self.grid.voxel(index))).as_vec3().to_array();
                self.inputs.extend_from_slice(&features(unit, angles[0], angles[1]));
            }
            self.engine.evaluate(&self.inputs, out)?;
        }
        Ok(())
    }

    /// Least value and index of the first orientation that has it, at all voxel centres. One unit of progress is one value.
    ///
    /// # Errors
    /// A device that failed, or no direction; [`QueryError::Cancelled`] when the control asks to stop.
    pub fn imf(&mut self, directions: &[[f32; 2]], control: Control<'_>) -> Result<Imf, QueryError> {
        let points: Vec<[f32; 3]> = (0..self.grid.len())
            .map(|index| self.grid.unit(self.grid.centre(self.grid.voxel(index))).as_vec3().to_array())
            .collect();
        let mut found = Imf::new(points.len());
        let some = self.engine.values_at_once().div_ceil(directions.len().clamp(1, DIRECTIONS));
        let (mut least, mut best) = (vec![0.0; some.min(points.len())], vec![0; some.min(points.len())]);
        let parts = points.chunks(some).zip(found.value.chunks_mut(some)).zip(found.best.chunks_mut(some));
        for ((points, lowest), chosen) in parts {
            let (least, best) = (&mut least[..points.len()], &mut best[..points.len()]);
            // Without any the engine says so.
            let groups = directions.chunks(DIRECTIONS).chain(directions.is_empty().then_some(directions));
            for (first, directions) in (0..).step_by(DIRECTIONS).zip(groups) {
                if control.is_cancelled() {
                    return Err(QueryError::Cancelled);
                }
                self.engine.minimum(points, directions, least, best)?;
                for ((lowest, chosen), (least, best)) in
                    lowest.iter_mut().zip(chosen.iter_mut()).zip(least.iter().zip(best.iter()))
                {
                    if first == 0 || least < lowest {
                        (*lowest, *chosen) = (*least, first + best);
                    }
                }
                (control.progress)((points.len() * directions.len()) as u64);
            }
        }
        Ok(found)
    }
}

impl Field for LearntField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        check_lengths(poses, answers)?;
        for (poses, out) in poses.chunks(CHUNK).zip(answers.chunks_mut(CHUNK)) {
            self.inputs.clear();
            self.inputs.reserve(poses.len() * INPUTS);
            for pose in poses {
                let held = self.grid.nearest_between_centres(pose.position);
                let unit = self.grid.unit(held).as_vec3().to_array();
                let [theta, phi] = pose.orientation.angles();
                self.inputs.extend_from_slice(&features(unit, theta, phi));
            }
            self.engine.evaluate(&self.inputs, out)?;
        }
        Ok(())
    }
}

impl WholeField for LearntField<'_> {
    fn section_at(&mut self, orientation: &Orientation, values: &mut [f32]) -> Result<(), QueryError> {
        self.section(orientation.angles(), values)
    }

    fn least_over(&mut self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, QueryError> {
        let directions: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
        self.imf(&directions, control)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::learnt::scenes::{scene, siren, siren_model};
    use crate::siren::evaluator::CpuEvaluator;
    use imf_core::planner::{Pose as PlannerPose, PoseField};
    use imf_core::tool::Tool;

    #[test]
    fn positions_outside_are_answered_as_the_nearest_inside_and_as_planners_are() {
        let scene = scene(&Tool::paper(), 0.0);
        let (model, grid) = (siren_model(&scene), scene.record.grid);
        let [low, high] = grid.box_of_centres();
        let middle = 0.5 * (low + high);
        let beyond = |room: f64| {
            let axes = (0..3).flat_map(move |axis| {
                let mut away = [middle; 2];
                (away[0][axis], away[1][axis]) = (low[axis] - room, high[axis] + room);
                away
            });
            axes.chain([low - room, high + room])
        };
        // In the outer half of a voxel, beyond the grid, and far from all.
        let outside: Vec<DVec3> =
            [0.3 * grid.pitch, 2.0 * grid.pitch, 1e4].into_iter().flat_map(beyond).collect();
        let asked: Vec<PlannerPose> = outside
            .iter()
            .map(|position| PlannerPose::along(position.as_vec3(), Vec3::new(0.3, -0.5, 0.8)))
            .collect();
        let poses = |positions: Vec<DVec3>| -> Vec<Pose> {
            let orientation = asked[0].orientation();
            positions.into_iter().map(|position| Pose { position, orientation }).collect()
        };
        let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
        let mut field = LearntField::new(grid, &mut engine);
        let mut answers = |poses: &[Pose]| {
            let mut values = vec![f32::NAN; poses.len()];
            field.query(poses, &mut values).unwrap();
            values
        };
        let found = answers(&poses(outside.clone()));
        assert_eq!(found, answers(&poses(outside.iter().map(|p| p.clamp(low, high)).collect())));
        let mut expected = vec![f32::NAN; asked.len()];
        PoseField::query(&siren(&scene), &asked, &mut expected).unwrap();
        for ((found, expected), position) in found.iter().zip(&expected).zip(&outside) {
            // Positions and directions rounded to single precision.
            assert!((found - expected).abs() < 2e-5, "{position}: {found} against {expected}");
        }
        assert!(answers(&poses(vec![DVec3::new(middle.x, f64::NAN, middle.z)]))[0].is_nan());
    }
}
