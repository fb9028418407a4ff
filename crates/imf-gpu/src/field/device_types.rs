//! Poses, gradients and decisions as the device reads and writes them.

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};
use imf_core::field::Decision;
use imf_core::pose::Pose;

use crate::shader::{COLLIDING, FREE};

/// A pose as the device reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DevicePose {
    /// World position of the tip; the last number is idle.
    pub position: [f32; 4],
    /// Quaternion x, y, z, w from the tool's frame into the world, of any length but 0.
    pub rotation: [f32; 4],
}

impl From<Pose> for DevicePose {
    fn from(pose: Pose) -> Self {
        // Of length 1 in double precision, so that no length is lost by rounding.
        let DQuat { x, y, z, w } = pose.rotation.normalize();
        let rotation = [x, y, z, w].map(|v| v as f32);
        // What is beyond single precision lies beyond every grid on the same side; NaN stays NaN.
        let held = match pose.position.is_finite() {
            true => pose.position.clamp(DVec3::splat(-FARTHEST), DVec3::splat(FARTHEST)),
            false => DVec3::NAN,
        };
        Self { position: held.as_vec3().extend(0.0).to_array(), rotation }
    }
}

/// Beyond this a coordinate is held: far beyond every grid, and far from where single precision ends.
const FARTHEST: f64 = 1e30;

/// A value and its derivatives as the device writes them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DeviceGradient {
    /// The overlap, not clipped.
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: [f32; 3],
    /// Change for a turn of the tool's axis by a radian: tangent to the sphere at the axis.
    pub direction: [f32; 3],
    /// Change for a turn of the tool about its axis by a radian; 0 for tools of revolution.
    pub roll: f32,
}

/// A decision as the device writes it, `FREE`, `COLLIDING` or `UNDECIDED` of the shaders; any
/// other number is undecided.
#[must_use]
pub fn decision_of(code: u32) -> Decision {
    match code {
        FREE => Decision::Free,
        COLLIDING => Decision::Colliding,
        _ => Decision::Undecided,
    }
}
