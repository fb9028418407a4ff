//! The exact field: whole numbers of voxels at any pose, and over the whole grid.

use std::sync::{Arc, OnceLock};

use glam::{DQuat, DVec3, Vec3};

use super::minimum::minimum_pose_by_pose;
use super::solid::{SolidField, SolidVoxels};
use super::{Best, Decision, FieldError, Gradient, GridField, PoseField, check_lengths, classify_blocks};
use crate::control::Control;
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::scene::Scene;
use crate::section::{Imf, Quantity, SectionPlan, SectionScratch, ToolPoints, imf};
use crate::tool::{Assembly, Clearance, ClearanceError, Tool, ToolError};
use crate::workspaces::Workspaces;

/// An obstacle with what every tool around it shares: running sums and distances. Cloning it copies nothing.
#[derive(Clone)]
pub(crate) struct PreparedObstacle {
    obstacle: Obstacle,
    forbidden: SolidVoxels,
    cuttable: Option<SolidVoxels>,
}

impl PreparedObstacle {
    pub(crate) fn obstacle(&self) -> &Obstacle {
        &self.obstacle
    }

    /// Makes voxels forbidden, or empty; those that are so already are skipped. The indices are of the obstacle's
    /// grid. What no other obstacle shares is changed in place.
    pub(crate) fn change(&mut self, forbidden: &[usize], empty: &[usize]) {
        let Self { obstacle, forbidden: solid, cuttable } = self;
        let mut changed: Vec<usize> =
            forbidden.iter().filter(|&&index| obstacle.forbidden.solid[index] == 0).copied().collect();
        changed.extend(empty.iter().filter(|&&index| obstacle.forbidden.solid[index] == 1));
        // The obstacle itself must not share what is to be changed in place.
        let nothing = Arc::new(Occupancy::empty(Grid { dims: [0; 3], ..*obstacle.grid() }));
        let layer = obstacle.cuttable.take();
        obstacle.forbidden = nothing;
        sort_and_change(solid, changed);
        obstacle.forbidden = solid.shared();
        if let Some((cuttable, layer)) = cuttable.as_mut().zip(layer) {
            let gone: Vec<usize> =
                forbidden.iter().chain(empty).filter(|&&index| layer.solid[index] == 1).copied().collect();
            drop(layer);
            sort_and_change(cuttable, gone);
            obstacle.cuttable = Some(cuttable.shared());
        }
    }

    /// True where both are of the same voxels in memory.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let layer = |of: &Self| of.obstacle.cuttable.as_ref().map(Arc::as_ptr);
        Arc::ptr_eq(&self.obstacle.forbidden, &other.obstacle.forbidden) && layer(self) == layer(other)
    }
}

impl From<Obstacle> for PreparedObstacle {
    fn from(obstacle: Obstacle) -> Self {
        let forbidden = obstacle.forbidden.clone().into();
        let cuttable = obstacle.cuttable.clone().map(SolidVoxels::from);
        Self { obstacle, forbidden, cuttable }
    }
}

fn sort_and_change(voxels: &mut SolidVoxels, mut changed: Vec<usize>) {
    changed.sort_unstable();
    changed.dedup();
    if !changed.is_empty() {
        voxels.change(&changed);
    }
}

/// Counts the obstacle's voxel centres in the analytic tool at any pose, divided by the tool's own count in that
/// orientation with its tip on a voxel centre. Equal to the section at voxel centres.
///
/// Cuttable voxels count in shank and holder alone. Every method takes `&self` and allocates nothing for tools of revolution;
/// threads share one field. Lengths are in the unit of the obstacle's grid. An invalid pose is never free.
pub struct ExactField {
    obstacle: PreparedObstacle,
    assembly: Assembly,
    /// The whole tool against what is forbidden.
    whole: SolidField,
    /// Shank and holder against what the cutter may enter.
    noncutting: Option<SolidField>,
    /// In the tool's frame.
    sharp_points: Vec<DVec3>,
    /// Made at the first section.
    plan: OnceLock<SectionPlan>,
    scratch: Workspaces<SectionScratch>,
}

impl ExactField {
    /// Of a tool, as it is or offset by a clearance ([`Tool::offset`](crate::tool::Tool::offset)), around an obstacle, both in one unit.
    ///
    /// # Errors
    /// A tool that makes no sense; voxels that are none.
    pub fn new(obstacle: impl Into<Obstacle>, assembly: impl Into<Assembly>) -> Result<Self, FieldError> {
        let (obstacle, assembly) = (obstacle.into(), assembly.into());
        if !obstacle.is_sound() {
            return Err(FieldError::Voxels);
        }
        assembly.tool().check()?;
        Ok(Self::around(&obstacle.into(), assembly))
    }

    /// Of a tool around an obstacle that other tools share.
    pub(crate) fn around(obstacle: &PreparedObstacle, assembly: impl Into<Assembly>) -> Self {
        let (obstacle, assembly) = (obstacle.clone(), assembly.into());
        let noncutting = obstacle.cuttable.clone().zip(assembly.noncutting());
        Self {
            whole: SolidField::of_tool(obstacle.forbidden.clone(), assembly.whole()),
            noncutting: noncutting.map(|(cuttable, tool)| SolidField::of_tool(cuttable, tool)),
            sharp_points: assembly.tool().sharp_point_positions(obstacle.obstacle.grid().pitch),
            obstacle,
            assembly,
            plan: OnceLock::new(),
            scratch: Workspaces::default(),
        }
    }

    /// Of a scene's true tool, offset by a clearance in the scene's unit: the scene's own, another, or none.
    ///
    /// # Errors
    /// A clearance that is not a length, or one around a mesh tool.
    pub fn of_scene(scene: &Scene, clearance: &Clearance) -> Result<Self, ClearanceError> {
        let obstacle = Obstacle::from(scene);
        Ok(Self::around(&obstacle.into(), scene.record.bare_tool().offset(clearance)?))
    }

    /// What the tool must stay out of.
    #[must_use]
    pub fn obstacle(&self) -> &Obstacle {
        &self.obstacle.obstacle
    }

    /// What it must stay out of, with what tools around it share.
    pub(crate) fn prepared(&self) -> &PreparedObstacle {
        &self.obstacle
    }

    /// The tool.
    #[must_use]
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// Solid voxels that count, forbidden ones in the whole tool and cuttable ones in shank and holder; `None` for an invalid pose.
    #[must_use]
    pub fn count(&self, pose: &Pose) -> Option<u32> {
        self.solids().map(|solid| solid.count(pose)).sum()
    }

    /// The overlap: voxels that count over the tool's own, in [0, 1]; NaN for an invalid pose.
    ///
    /// # Errors
    /// A tool that holds no voxel centre, or a mesh tool too large to be voxelised.
    pub fn overlap(&self, pose: &Pose) -> Result<f64, ToolError> {
        match self.count(pose) {
            None => Ok(f64::NAN),
            Some(0) => Ok(0.0),
            Some(count) => Ok(ratio(count, self.whole.normaliser(pose.rotation)?)),
        }
    }

    /// True where a voxel counts, equal to `count(pose) > 0`, and at an invalid pose.
    #[inline]
    #[must_use]
    pub fn collides(&self, pose: &Pose) -> bool {
        self.solids().any(|solid| solid.collides(pose))
    }

    /// [`ExactField::collides`] of every pose; those for which `colliding` is true already are skipped.
    pub(crate) fn collide_all(&self, poses: &[Pose], colliding: &mut [bool]) {
        self.solids().for_each(|solid| solid.collide_all(poses, colliding));
    }

    /// Lower bound of the distance from the tool's surface to the nearest solid voxel's centre that it must stay out of, in world
    /// units, from the tool's bounding spheres: loose by the rounding of points on the axis to voxels (up to 0.87 voxels) and
    /// by the balls' excess. At most 0 where the tool may hold a centre, and at an invalid pose. `None` for mesh tools.
    #[must_use]
    pub fn clearance_bound(&self, pose: &Pose) -> Option<f64> {
        let bounds = self.solids().map(|solid| solid.clearance_up_to(pose, f64::INFINITY));
        bounds.reduce(|a, b| Some(a?.min(b?)))?
    }

    /// Lower bound of the length of any translation that frees the tool, in world units, by spheres inscribed in the tool; 0
    /// where none is proven, which a free pose always has. How good it is depends on the spheres: of a cylinder deep in
    /// a block it falls short of the truth by about 1.7 voxels. `None` for mesh tools.
    #[must_use]
    pub fn penetration_bound(&self, pose: &Pose) -> Option<f64> {
        let bounds = self.solids().map(|solid| solid.penetration_bound(pose));
        bounds.reduce(|a, b| Some(a?.max(b?)))?
    }

    /// Signed clearance in world units, as far as the distance transform proves it. Above 0 the tool is free, and no
    /// solid centre is nearer to it ([`ExactField::clearance_bound`]); below 0 it collides, and no translation shorter
    /// than its amount frees it ([`ExactField::penetration_bound`]). 0 where neither is proven: shallow contact and near
    /// misses, which [`ExactField::collides`] decides. `None` for mesh tools.
    #[must_use]
    pub fn signed_clearance(&self, pose: &Pose) -> Option<f64> {
        let clearance = self.clearance_bound(pose)?;
        // At contact 0, not −0.
        if clearance > 0.0 { Some(clearance) } else { Some(0.0 - self.penetration_bound(pose)?) }
    }

    /// Largest distance of any of the tool's points from its tip, in world units.
    pub(crate) fn reach(&self) -> f64 {
        self.solids().map(SolidField::reach).fold(0.0, f64::max)
    }

    /// What counts, with the tool that counts it: the whole tool first, then shank and holder among what the cutter may enter.
    pub(crate) fn solids_with_tools(&self) -> impl Iterator<Item = (&SolidField, &Tool)> {
        let noncutting = self.noncutting.as_ref().zip(self.assembly.noncutting());
        [Some((&self.whole, self.assembly.whole())), noncutting].into_iter().flatten()
    }

    fn solids(&self) -> impl Iterator<Item = &SolidField> {
        [Some(&self.whole), self.noncutting.as_ref()].into_iter().flatten()
    }

    /// A gradient by central differences, over `step` either way in position and `angle` either way in rotation.
    fn gradient(&self, pose: &Pose, step: f64, angle: f64) -> Result<Gradient, FieldError> {
        let Some(axis) = pose.axis() else { return Ok(Gradient::NAN) };
        let mut found = [0.0; POSES];
        self.values(&neighbours(pose, step, angle), &mut found)?;
        let slopes = |first: usize, width: f64| {
            Vec3::from_array(std::array::from_fn(|a| {
                (found[first + 2 * a] - found[first + 2 * a + 1]) / width as f32
            }))
        };
        let rotation = slopes(7, 2.0 * angle);
        Ok(Gradient {
            value: found[0],
            position: slopes(1, 2.0 * step),
            direction: rotation.cross(axis.as_vec3()),
            rotation,
        })
    }

    fn plan(&self) -> Result<&SectionPlan, FieldError> {
        if let Some(plan) = self.plan.get() {
            return Ok(plan);
        }
        let plan = SectionPlan::new(self.obstacle(), &self.assembly, ToolPoints::Tip)?;
        Ok(self.plan.get_or_init(|| plan))
    }
}

/// Off the grid more centres may fall into the tool than on it.
fn ratio(inside: u32, whole: u32) -> f64 {
    (f64::from(inside) / f64::from(whole)).min(1.0)
}

/// Values are counts over the tool's own count in that rotation. They are steps, so that derivatives are differences:
/// over half a pitch either way in position, and over the angle either way that moves the tool's far end by a pitch.
/// Decisions are exact for voxel centres, and never [`Decision::Undecided`].
impl PoseField for ExactField {
    fn quantity(&self) -> Quantity {
        Quantity::Overlap
    }

    fn bounds(&self) -> Option<[DVec3; 2]> {
        None
    }

    fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        check_lengths(poses.len(), values.len())?;
        // Poses of one rotation tend to stand together.
        let mut last: Option<(DQuat, u32)> = None;
        for (pose, value) in poses.iter().zip(values) {
            let Some(count) = self.count(pose) else {
                *value = f32::NAN;
                continue;
            };
            if count == 0 {
                *value = 0.0;
                continue;
            }
            let whole = match last {
                Some((rotation, whole)) if rotation == pose.rotation => whole,
                _ => self.whole.normaliser(pose.rotation)?,
            };
            last = Some((pose.rotation, whole));
            *value = ratio(count, whole) as f32;
        }
        Ok(())
    }

    fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError> {
        check_lengths(poses.len(), gradients.len())?;
        let pitch = self.grid().pitch;
        let (step, angle) = (0.5 * pitch, (pitch / self.reach()).min(1.0));
        for (pose, out) in poses.iter().zip(gradients) {
            *out = self.gradient(pose, step, angle)?;
        }
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        classify_blocks(poses, decisions, |poses, colliding| self.collide_all(poses, colliding))
    }

    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError> {
        minimum_pose_by_pose(points, rotations, &self.sharp_points, best, |poses, values, decisions| {
            self.values(poses, values)?;
            for (value, decision) in values.iter().zip(decisions) {
                *decision = if *value == 0.0 { Decision::Free } else { Decision::Colliding };
            }
            Ok(())
        })
    }
}

/// Sections count by the faster of several methods, equal to counting pose by pose.
impl GridField for ExactField {
    fn grid(&self) -> &Grid {
        self.obstacle().grid()
    }

    fn sections(&self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), FieldError> {
        let (plan, voxels) = (self.plan()?, self.grid().len());
        assert_eq!(values.len(), voxels * orientations.len(), "one section for each orientation");
        self.scratch.with(|scratch| {
            let each = orientations.iter().zip(values.chunks_exact_mut(voxels.max(1)));
            each.into_iter().try_for_each(|(orientation, section)| plan.cmf(orientation, scratch, section))
        })?;
        Ok(())
    }

    fn minimum(&self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, FieldError> {
        if orientations.is_empty() {
            return Err(FieldError::Orientations(0));
        }
        let voxels = self.grid().len() as u64;
        let progress = |units: u64| (control.progress)(units * voxels);
        Ok(imf(self.plan()?, orientations, Control { progress: &progress, cancelled: control.cancelled })?)
    }
}

/// Poses of one gradient: the pose itself, then a pair for each axis of position and of rotation.
const POSES: usize = 13;

/// The pose with its neighbours, `step` away in position and `angle` in rotation about each axis of the world.
fn neighbours(pose: &Pose, step: f64, angle: f64) -> [Pose; POSES] {
    std::array::from_fn(|index| {
        let Some(pair) = index.checked_sub(1) else { return *pose };
        let axis = DVec3::AXES[pair / 2 % 3];
        let side = if pair % 2 == 0 { 1.0 } else { -1.0 };
        if pair < 6 {
            Pose { position: pose.position + axis * (side * step), ..*pose }
        } else {
            // Of any length, as the pose's own.
            let turn = DQuat::from_axis_angle(axis, side * angle);
            Pose { rotation: turn.mul_quat(pose.rotation), ..*pose }
        }
    })
}

#[cfg(test)]
mod tests;
