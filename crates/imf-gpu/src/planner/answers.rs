//! A field on the GPU answers poses as every family does, in single precision.

use glam::Quat;
use imf_core::field::EngineError;
use imf_core::field::{self, Field, QueryError};
use imf_core::planner::{PlannerError, Pose, PoseField};

use super::GpuField;

/// Positions outside the box of the voxel centres are answered as the nearest point inside, without promise.
impl Field for &GpuField {
    fn query(&mut self, poses: &[field::Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let single = |pose: &field::Pose| {
            let rotation = Quat::from_mat3(&pose.orientation.rotation().as_mat3());
            Pose::new(pose.position.as_vec3(), rotation)
        };
        let poses: Vec<Pose> = poses.iter().map(single).collect();
        PoseField::query(*self, &poses, answers).map_err(|error| match error {
            PlannerError::Length { asked, answers } => QueryError::Length { poses: asked, answers },
            PlannerError::Tool(error) => error.into(),
            PlannerError::Device(error) => error.into(),
            PlannerError::Orientations(_) => EngineError::Shape(error.to_string()).into(),
        })
    }
}
