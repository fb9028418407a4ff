//! Where a rotated tool can be: a box that holds it, and the part of a line in the cylinder around it.

use glam::{DMat4, DVec3};

use super::{Tool, ToolShape};
use crate::orientation::Orientation;

/// A box of voxels: the offset of its first from the tip's, and how many there are along each axis.
#[derive(Clone, Copy)]
pub(super) struct Span {
    pub(super) lower: [i32; 3],
    pub(super) dims: [usize; 3],
}

impl Span {
    /// What lies from the offset `first` to `last`; empty along all axes where that is nothing.
    pub(super) fn within(self, first: [i64; 3], last: [i64; 3]) -> Self {
        let lower = [0, 1, 2].map(|axis| i64::from(self.lower[axis]).max(first[axis]));
        let end = [0, 1, 2].map(|axis| {
            (i64::from(self.lower[axis]) + self.dims[axis] as i64).min(last[axis].saturating_add(1))
        });
        if (0..3).any(|axis| lower[axis] >= end[axis]) {
            return Self { dims: [0; 3], ..self };
        }
        Self {
            lower: lower.map(|v| v as i32),
            dims: [0, 1, 2].map(|axis| (end[axis] - lower[axis]) as usize),
        }
    }
}

/// Offsets (whole numbers of voxels) of a box that surely holds the rotated tool.
pub(super) fn bounds(tool: &Tool, orientation: &Orientation, pitch: f64) -> (DVec3, DVec3) {
    let (lower, upper) = match &tool.shape {
        ToolShape::Revolved(_) => {
            let d = orientation.direction();
            let (mut lower, mut upper) = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
            for segment in tool.segments() {
                // A disc of radius ρ around the axis spans ρ·√(1 − dᵢ²) along axis i.
                let spread = (1.0 - d * d).max(DVec3::ZERO).map(f64::sqrt) * segment.max_radius();
                for height in [segment.range().0, segment.range().1] {
                    lower = lower.min(d * height - spread);
                    upper = upper.max(d * height + spread);
                }
            }
            (lower, upper)
        }
        ToolShape::Mesh(mesh) => {
            mesh.transformed(&DMat4::from_mat3(orientation.rotation())).bounds().unwrap_or_default()
        }
    };
    ((lower / pitch).floor() - 1.0, (upper / pitch).ceil() + 1.0)
}

/// Range of voxel offsets along z within which the line over (x, y) can meet the cylinder of radius `widest` between
/// two heights along `direction`; one voxel generous at either end.
pub(super) fn line_through_cylinder(
    x: f64,
    y: f64,
    direction: DVec3,
    widest: f64,
    (bottom, top): (f64, f64),
    pitch: f64,
) -> (f64, f64) {
    let flat = x * direction.x + y * direction.y;
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    // bottom ≤ flat + z·d_z < top
    if direction.z.abs() > 1e-9 {
        let (a, b) = ((bottom - flat) / direction.z, (top - flat) / direction.z);
        (low, high) = (a.min(b), a.max(b));
    } else if flat < bottom - pitch || flat > top + pitch {
        return (0.0, -2.0);
    }
    // |p|² − (p·d)² ≤ widest²: a quadratic in z.
    let a = 1.0 - direction.z * direction.z;
    if a > 1e-9 {
        let half_b = -flat * direction.z;
        let c = x * x + y * y - flat * flat - widest * widest - pitch * pitch;
        let discriminant = half_b * half_b - a * c;
        if discriminant < 0.0 {
            return (0.0, -2.0);
        }
        let root = discriminant.sqrt();
        low = low.max((-half_b - root) / a);
        high = high.min((-half_b + root) / a);
    }
    ((low / pitch).floor() - 1.0, (high / pitch).ceil() + 1.0)
}
