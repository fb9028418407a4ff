//! Which points of the obstacle's surface a tool holds.

use std::cell::Cell;

use glam::DVec3;

use super::lateral_separation::height_and_radius;
use super::point_tree::HalfSpace;
use super::segment::VoxelPose;
use super::{Shape, SolidField};
use crate::pose::Pose;
use crate::tool::Element;
use crate::vectorised::vectorised;

/// A surface lies in front of its solid centres by so many voxels or less, but for what is thin.
const IN_FRONT: f64 = 1.0;
/// A room that is not worth looking for, in voxels.
const SHORT: f64 = 0.25;

impl SolidField {
    /// Whether the tool is held against points of the obstacle's surface.
    pub(crate) fn knows_the_surface(&self) -> bool {
        !self.voxels.surfaces().is_empty() && !self.bodies().is_empty()
    }

    /// A distance in voxels, up to `most`, within which the tool meets neither a point of the surface nor what `room` knows of, up to a
    /// distance; 0 where it is short.
    pub(super) fn room_among_points(&self, placed: VoxelPose, most: f64, room: impl Fn(f64) -> f64) -> f64 {
        if self.voxels.surfaces().is_empty() {
            return room(most);
        }
        let room = room(most + IN_FRONT);
        let free = |room: &f64| self.first_point(placed, None, |_| -room, |_| true).is_none();
        let tries = [room - IN_FRONT, 0.5 * room].map(|room| room.min(most));
        tries.into_iter().find(|room| *room > SHORT && free(room)).unwrap_or(0.0)
    }

    /// Visits the points of the obstacle's surface in each body of the tool: the body's place, the point in voxels, its height on the
    /// tool's axis and its distance from it, in world units.
    pub(crate) fn visit_surface(&self, pose: &Pose, visit: impl Fn(usize, [f64; 3], f64, f64)) {
        let Some(axis) = pose.axis() else { return };
        let placed = self.voxel_pose(pose.position, axis);
        self.first_point(
            placed,
            None,
            |body| self.contact(body),
            |point| {
                let [height, away] = self.along_and_away(pose.position, axis, point);
                for body in (0..self.bodies().len()).filter(|&body| self.holds_point(body, placed, point)) {
                    visit(body, point, height, away);
                }
                false
            },
        );
    }

    /// The point of the obstacle's surface in the tool that is deepest, by the depth below the tool's surface of a height on its axis
    /// and a distance from it, in world units; the first found that is deeper than `enough`.
    pub(crate) fn deepest_surface_point(
        &self,
        tip: DVec3,
        axis: DVec3,
        depth: impl Fn(f64, f64) -> f64,
        enough: f64,
    ) -> Option<[f64; 3]> {
        let placed = self.voxel_pose(tip, axis);
        let depth = |point| {
            let [height, away] = height_and_radius(placed, point);
            self.holds(placed, point).then(|| depth(height, away))
        };
        let too_deep = |point| depth(point).is_some_and(|depth| depth > enough);
        let found = self.first_point(placed, None, |_| enough / placed.pitch, too_deep);
        found.or_else(|| self.deepest_point(placed, depth))
    }

    /// Whether a tool that is a closed mesh holds a point of the obstacle's surface; false of others.
    pub(crate) fn mesh_holds_a_point(&self, pose: &Pose) -> bool {
        let pitch = self.voxels.occupancy().grid.pitch;
        let (Shape::Definition(definition), Some(placed)) = (&self.shape, self.placed(pose)) else {
            return false;
        };
        let Some(mesh) = definition.closed(pitch) else { return false };
        self.voxels.surfaces().iter().any(|points| mesh.holds_point(points, placed, pose, self.arch))
    }

    /// The point of surfaces in the tool that is deepest, and deeper than it may.
    pub(crate) fn deepest_held_point(&self, tip: DVec3, axis: DVec3) -> Option<[f64; 3]> {
        let elements = self.touching.as_ref()?;
        let placed = self.voxel_pose(tip, axis);
        self.deepest_point(placed, |point| {
            let [height, away] = height_and_radius(placed, point);
            let held = (0..elements.len()).filter(|&body| self.holds_point(body, placed, point));
            held.map(|body| elements[body].0.depth(height, away, true)).max_by(f64::total_cmp)
        })
    }

    /// The deepest point by a depth in world units, which not every point has.
    fn deepest_point(&self, placed: VoxelPose, depth: impl Fn([f64; 3]) -> Option<f64>) -> Option<[f64; 3]> {
        let (deepest, found) = (Cell::new(0.0), Cell::new(None));
        self.first_point(
            placed,
            None,
            |_| deepest.get(),
            |point| {
                if let Some(depth) = depth(point).map(|depth| depth / placed.pitch)
                    && (found.get().is_none() || depth > deepest.get())
                {
                    deepest.set(depth);
                    found.set(Some(point));
                }
                false
            },
        );
        found.get()
    }

    /// How deep points may lie in a body, in voxels.
    pub(super) fn contact(&self, body: usize) -> f64 {
        let contact = self.touching.as_ref().map_or(0.0, |elements| elements[body].1);
        contact.max(0.0) / self.voxels.occupancy().grid.pitch
    }

    /// Whether a body holds a point of the surface, in voxels, and deeper than it may.
    #[inline]
    pub(super) fn holds_point(&self, body: usize, placed: VoxelPose, point: [f64; 3]) -> bool {
        let deeper = |elements: &Vec<(Element, f64)>| {
            let [height, away] = height_and_radius(placed, point);
            let (element, contact) = &elements[body];
            element.depth(height, away, true) > *contact
        };
        placed.contains(&self.bodies()[body].profile, point) && self.touching.as_ref().is_none_or(deeper)
    }

    /// A point of surfaces for which `counts`, of those that [`PointTree::first_near`] leaves.
    pub(super) fn first_point(
        &self,
        placed: VoxelPose,
        stays_in: Option<&HalfSpace>,
        deeper: impl Fn(usize) -> f64,
        counts: impl Fn([f64; 3]) -> bool,
    ) -> Option<[f64; 3]> {
        let (bodies, deeper, counts) = (self.bodies(), &deeper, &counts);
        let mut surfaces = self.voxels.surfaces().iter();
        surfaces.find_map(|points| {
            vectorised!(self.arch, points.first_near(bodies, placed, stays_in, deeper, counts))
        })
    }
}
