//! Lateral separation: the step across the tool's axis that moves it off a solid voxel.

use glam::DVec3;

use super::runs::Lines;
use super::segment::VoxelPose;
use super::{Part, Shape, SolidField};
use crate::pose::Pose;

/// Heights are tried in steps of this many voxels.
const STEP: f64 = 0.5;
/// A step goes this many voxels past contact, where a centre still counts.
const BEYOND: f64 = 1e-3;

impl SolidField {
    /// The solid centre that is deepest in the tool, measured across its axis, among those nearest to the voxels around the axis,
    /// in voxels; and the lateral step, in world units, that separates the tool from it. `None` where none of these is in the
    /// tool, at an invalid pose, and of mesh tools.
    pub(crate) fn lateral_separation(&self, pose: &Pose) -> Option<([f64; 3], DVec3)> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let placed = self.placed(pose)?;
        // What holds no centre at all is sooner known.
        let pieces = self.spheres(bodies).roots();
        if !self.bodies_collide(bodies, placed, None, pieces, |_| Lines::ALL, None) {
            return None;
        }
        let distances = self.voxels.distances();
        let dims = distances.dims();
        let mut deepest = (0.0, DVec3::ZERO, [0.0; 3]);
        let mut last = [usize::MAX; 8];
        for body in bodies {
            for part in &body.parts {
                let (from, to) = part.segment.range();
                let steps = ((to - from) / STEP).ceil().clamp(1.0, 1e5) as usize;
                for step in 0..=steps {
                    let height = from + (to - from) * step as f64 / steps as f64;
                    let at = placed.on_axis(height);
                    let beside = [0, 1, 2].map(|axis| voxels_beside(at[axis], dims[axis]));
                    for (corner, last) in last.iter_mut().enumerate() {
                        let [x, y, z] = [0, 1, 2].map(|axis| beside[axis][corner >> (2 - axis) & 1]);
                        let witness = distances.nearest((x * dims[1] + y) * dims[2] + z);
                        let Some(witness) = witness.filter(|w| w != last) else { continue };
                        *last = witness;
                        let voxel = self.voxels.occupancy().grid.voxel(witness).map(|v| v as f64);
                        if placed.contains(&body.profile, voxel) {
                            let (height, away) = seen_from_the_side(placed, voxel);
                            let depth = radius(&body.parts, height) - away.length();
                            if depth > deepest.0 {
                                deepest = (depth, away, voxel);
                            }
                        }
                    }
                }
            }
        }
        let (depth, away, voxel) = deepest;
        Some((voxel, away.try_normalize()? * (-(depth + BEYOND) * placed.pitch)))
    }

    /// Height of a voxel along the axis of a tool, and its distance from it, in world units.
    #[inline]
    pub(crate) fn along_and_away(&self, tip: DVec3, axis: DVec3, voxel: [f64; 3]) -> [f64; 2] {
        height_and_radius(self.voxel_pose(tip, axis), voxel)
    }

    /// The lateral step that separates the tool from one voxel, in world units; `None` where it lies on the axis, and of a mesh.
    pub(crate) fn lateral_separation_from(&self, tip: DVec3, axis: DVec3, voxel: [f64; 3]) -> Option<DVec3> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let placed = self.voxel_pose(tip, axis);
        let (height, away) = seen_from_the_side(placed, voxel);
        let deepest = bodies.iter().map(|body| radius(&body.parts, height)).fold(0.0, f64::max);
        Some(away.try_normalize()? * (-(deepest - away.length() + BEYOND) * placed.pitch))
    }
}

/// The voxels on both sides of a coordinate, of `count` in all.
fn voxels_beside(at: f64, count: usize) -> [usize; 2] {
    if at < 0.0 {
        return [0; 2];
    }
    let low = at as usize;
    [low.min(count - 1), low.saturating_add(1).min(count - 1)]
}

/// Height of a voxel along the axis of a placed tool, and its distance from it, in world units.
#[inline]
pub(super) fn height_and_radius(placed: VoxelPose, voxel: [f64; 3]) -> [f64; 2] {
    let (height, away) = seen_from_the_side(placed, voxel);
    [height * placed.pitch, away.length() * placed.pitch]
}

/// Height of a voxel along the axis, and the way from the axis to it.
fn seen_from_the_side(placed: VoxelPose, voxel: [f64; 3]) -> (f64, DVec3) {
    let offset = DVec3::from_array(voxel) - placed.tip;
    let height = offset.dot(placed.direction);
    (height, offset - placed.direction * height)
}

/// Largest radius of the segments that reach a height.
fn radius(parts: &[Part], height: f64) -> f64 {
    let reaching = parts.iter().filter(|part| {
        let (from, to) = part.segment.range();
        from <= height && height <= to
    });
    reaching.map(|part| part.segment.radius(height)).fold(0.0, f64::max)
}
