//! Which solid voxels lie in a tool, and which is the nearest to one that holds none.

use glam::{DVec2, DVec3};

use super::{Shape, SolidField};
use crate::mesh::Mesh;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Tool, ToolShape};

/// A solid voxel's centre and a tool's element, with what lies between them, in world units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Separation {
    pub(crate) distance: f64,
    pub(crate) element: ElementKind,
    /// The centre.
    pub(crate) centre: DVec3,
    /// The point of the element's surface that is nearest to it.
    pub(crate) foot: DVec3,
}

impl Separation {
    /// Of an element with the tip at a position and the axis along a unit vector; the distance is that to its surface.
    pub(crate) fn of(element: &Element, tip: DVec3, axis: DVec3, centre: DVec3) -> Self {
        let offset = centre - tip;
        let height = offset.dot(axis);
        let across = offset - axis * height;
        let radius = across.length();
        let foot = element.foot(height, radius, true);
        // On the axis any direction is as near.
        let outwards = across.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        let point = tip + axis * foot.x + outwards * foot.y;
        let distance = DVec2::new(height, radius).distance(foot);
        Self { distance, element: element.kind, centre, foot: point }
    }
}

impl SolidField {
    /// Visits the solid voxels in the tool, which is the one that this field was made of: how deep each lies in its element, which that
    /// is, and its centre. Of a mesh neither depth nor element is known. Nothing at an invalid pose.
    pub(crate) fn visit_inside(
        &self,
        tool: &Tool,
        pose: &Pose,
        mut visit: impl FnMut(f64, Option<&Element>, DVec3),
    ) {
        let obstacle = self.voxels.occupancy();
        let centre = |index: usize| obstacle.grid.centre(obstacle.grid.voxel(index));
        let ToolShape::Revolved(elements) = &tool.shape else {
            let visited = |_: &Mesh, index: usize, _: DVec3| visit(0.0, None, centre(index));
            _ = tool.visit_inside_mesh(obstacle, pose, visited);
            return;
        };
        for element in elements {
            element.visit_inside(obstacle, pose, |index, height, radius| {
                visit(element.depth(height, radius, true), Some(element), centre(index));
            });
        }
    }

    /// The distance from the tool, which is the one that this field was made of, to the nearest solid voxel's centre, where it holds none.
    /// `None` where nothing is solid, at an invalid pose, and of tools that are counted by the definition.
    pub(crate) fn separation(&self, tool: &Tool, pose: &Pose) -> Option<Separation> {
        let (Shape::Bodies(bodies), ToolShape::Revolved(elements)) = (&self.shape, &tool.shape) else {
            return None;
        };
        let placed = self.placed(pose)?;
        let mut nearest: Option<Separation> = None;
        self.spheres(bodies).nearest(placed, &self.voxels, |voxel| {
            let offset = (DVec3::from_array(voxel) - placed.tip) * placed.pitch;
            let centre = pose.position + offset;
            for element in elements {
                let found = Separation::of(element, pose.position, placed.direction, centre);
                if nearest.as_ref().is_none_or(|nearest| found.distance < nearest.distance) {
                    nearest = Some(found);
                }
            }
            nearest.as_ref().map_or(f64::INFINITY, |nearest| nearest.distance / placed.pitch)
        });
        nearest
    }
}
