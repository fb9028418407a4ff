//! Which solid voxel lies deepest in a tool, and which is the nearest to one that holds none.

use glam::{DVec2, DVec3};

use super::{Shape, SolidField};
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Tool, ToolShape};

/// A solid voxel's centre and a tool's element, with what lies between them, in world units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Separation {
    pub(crate) distance: f64,
    pub(crate) element: ElementKind,
    pub(crate) centre: DVec3,
    /// The point of the element's surface that is nearest to it.
    pub(crate) foot: DVec3,
}

/// A solid voxel's centre in a tool, in world units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside<'a> {
    /// How far below the element's surface it lies; 0 of a mesh.
    pub(crate) depth: f64,
    /// The element that holds it; `None` of a mesh.
    pub(crate) element: Option<&'a Element>,
    pub(crate) centre: DVec3,
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
    /// The solid voxel that lies deepest in the element that holds it, of the tool that this field was made of. `None` where the tool
    /// is free, and at an invalid pose.
    pub(crate) fn deepest<'a>(&self, tool: &'a Tool, pose: &Pose) -> Option<Inside<'a>> {
        let placed = self.placed(pose)?;
        let mut deepest: Option<Inside<'a>> = None;
        let mut take = |depth: f64, element: Option<&'a Element>, centre: DVec3| {
            if deepest.as_ref().is_none_or(|deepest| depth > deepest.depth) {
                deepest = Some(Inside { depth, element, centre });
            }
            deepest.as_ref().map_or(f64::NEG_INFINITY, |deepest| deepest.depth)
        };
        let obstacle = self.voxels.occupancy();
        let centre = |index: usize| obstacle.grid.centre(obstacle.grid.voxel(index));
        match (&self.shape, &tool.shape) {
            (Shape::Bodies(bodies), ToolShape::Revolved(elements)) => {
                let mut most = f64::NEG_INFINITY;
                self.spheres(bodies).deepest(placed, &self.voxels, |voxel| {
                    let offset = (DVec3::from_array(voxel) - placed.tip) * placed.pitch;
                    for element in elements {
                        if let Some((height, radius)) = element.holds(offset, placed.direction, placed.pitch)
                        {
                            let depth = element.depth(height, radius, true);
                            most = take(depth, Some(element), pose.position + offset);
                        }
                    }
                    most / placed.pitch
                });
            }
            (_, ToolShape::Revolved(elements)) => {
                for element in elements {
                    element.visit_inside(obstacle, pose, |index, height, radius| {
                        take(element.depth(height, radius, true), Some(element), centre(index));
                    });
                }
            }
            (_, ToolShape::Mesh(_)) => {
                _ = tool.visit_inside_mesh(obstacle, pose, |_, index, _| {
                    take(0.0, None, centre(index));
                });
            }
        }
        deepest
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
