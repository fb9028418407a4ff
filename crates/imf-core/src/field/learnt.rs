//! A trained network as a field.

use super::{Field, Pose, QueryError, check_lengths};
use crate::grid::Grid;
use crate::siren::{INPUTS, features};
use crate::training::EvaluationEngine;

/// Poses that are turned into inputs at a time.
const CHUNK: usize = 1 << 16;

/// A network evaluated by an engine, CPU or GPU. Points outside the grid it was trained on are answered by
/// extrapolation, without promise.
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

    /// Least value and index of the first orientation that has it, at all voxel centres.
    ///
    /// # Errors
    /// A device that failed, or no direction.
    pub fn imf(&mut self, directions: &[[f32; 2]]) -> Result<(Vec<f32>, Vec<u32>), QueryError> {
        let points: Vec<[f32; 3]> = (0..self.grid.len())
            .map(|index| self.grid.unit(self.grid.centre(self.grid.voxel(index))).as_vec3().to_array())
            .collect();
        let (mut least, mut best) = (vec![0.0; points.len()], vec![0; points.len()]);
        self.engine.minimum(&points, directions, &mut least, &mut best)?;
        Ok((least, best))
    }
}

impl Field for LearntField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        check_lengths(poses, answers)?;
        for (poses, out) in poses.chunks(CHUNK).zip(answers.chunks_mut(CHUNK)) {
            self.inputs.clear();
            self.inputs.reserve(poses.len() * INPUTS);
            for pose in poses {
                let unit = self.grid.unit(pose.position).as_vec3().to_array();
                let [theta, phi] = pose.orientation.angles();
                self.inputs.extend_from_slice(&features(unit, theta, phi));
            }
            self.engine.evaluate(&self.inputs, out)?;
        }
        Ok(())
    }
}
