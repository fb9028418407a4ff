//! How deep an element is in a body at a pose: its deepest solid centre, or point of the body's surface.

use std::cell::Cell;

use glam::DVec3;

use super::elements::Body;
use super::{Collision, HitBody};
use crate::field::solid::SolidField;
use crate::grid::Grid;
use crate::mesh::distance::distance_to_mesh;
use crate::pose::Pose;
use crate::tool::{Element, Tool, ToolShape};

/// An element with its shape, for measuring depths.
#[derive(Clone)]
pub(super) struct DepthElement {
    pub(super) name: String,
    pub(super) clearance: f64,
    /// How deep in it centres and points of surfaces are accepted.
    pub(super) accepted: f64,
    pub(super) shape: Shape,
}

#[derive(Clone)]
pub(super) enum Shape {
    /// Bodies of revolution, and whether the upper end of each is surface.
    Revolved(Vec<(Element, bool)>),
    Mesh(Tool),
}

impl DepthElement {
    /// An element of a tool, offset by its clearance; `exposed` where its upper end is surface.
    pub(super) fn new(element: Element, exposed: bool, clearance: f64) -> Self {
        let name = element.kind.to_string();
        Self { name, clearance, accepted: 0.0, shape: Shape::Revolved(vec![(element, exposed)]) }
    }

    /// A tool whose elements cannot be distinguished.
    pub(super) fn whole(tool: &Tool) -> Self {
        let shape = match &tool.shape {
            ToolShape::Mesh(_) => Shape::Mesh(tool.clone()),
            ToolShape::Revolved(elements) => {
                Shape::Revolved(elements.iter().map(|e| (e.clone(), true)).collect())
            }
        };
        Self { name: "tool".into(), clearance: 0.0, accepted: 0.0, shape }
    }
}

/// The deepest solid centre in an element, or point of the body's surface.
pub(super) struct DeepestCentre {
    pub(super) depth: f64,
    in_tool: f64,
    voxel: usize,
    /// Where a point of the surface is deeper than any centre, in voxels.
    point: Option<DVec3>,
    voxels: u32,
}

impl DepthElement {
    /// `None` where it holds no solid centre that is not accepted, and its body in the field, by index, no point of the surface.
    pub(super) fn deepest(
        &self,
        (field, index): (&SolidField, usize),
        body: &Body,
        pose: &Pose,
    ) -> Option<DeepestCentre> {
        let mut found = DeepestCentre::default();
        match &self.shape {
            Shape::Revolved(elements) => {
                for (element, exposed) in elements {
                    element.visit_inside(body.voxels.occupancy(), pose, |voxel, height, radius| {
                        let in_tool = element.depth(height, radius, *exposed);
                        if self.accepted == 0.0 || in_tool > self.accepted {
                            found.take(voxel, in_tool, body.depth(voxel));
                        }
                    });
                }
                let (deepest, in_tool) = (Cell::new((found.depth, None)), Cell::new(found.in_tool));
                field.visit_surface(pose, |own, point, height, radius| {
                    if own != index {
                        return;
                    }
                    let depth =
                        |(element, exposed): &(Element, bool)| element.depth(height, radius, *exposed);
                    let depth = elements.iter().map(depth).fold(0.0, f64::max);
                    if depth <= self.accepted {
                        return;
                    }
                    in_tool.set(in_tool.get().max(depth));
                    if depth > deepest.get().0 {
                        deepest.set((depth, Some(DVec3::from_array(point))));
                    }
                });
                found.in_tool = in_tool.get();
                if let (depth, Some(point)) = deepest.get() {
                    found = DeepestCentre { depth, point: Some(point), ..found };
                }
            }
            Shape::Mesh(tool) => {
                // The distance to a mesh changes no faster than the point moves.
                let mut known = (DVec3::ZERO, f64::INFINITY);
                let visited = tool.visit_inside_mesh(body.voxels.occupancy(), pose, |mesh, voxel, place| {
                    let in_body = body.depth(voxel);
                    if known.1 + known.0.distance(place) + in_body > found.depth {
                        known = (place, distance_to_mesh(mesh, place));
                        found.take(voxel, known.1, in_body);
                    } else {
                        found.voxels += 1;
                    }
                });
                visited?;
            }
        }
        (found.voxels > 0 || found.point.is_some()).then_some(found)
    }
}

impl Default for DeepestCentre {
    fn default() -> Self {
        Self { depth: -1.0, in_tool: 0.0, voxel: 0, point: None, voxels: 0 }
    }
}

impl DeepestCentre {
    pub(super) fn take(&mut self, voxel: usize, in_tool: f64, in_body: f64) {
        self.voxels += 1;
        self.in_tool = self.in_tool.max(in_tool);
        if in_tool + in_body > self.depth {
            (self.depth, self.voxel) = (in_tool + in_body, voxel);
        }
    }

    /// The collision that is reported, except for the number of poses.
    pub(super) fn collision(
        &self,
        element: &DepthElement,
        against: &HitBody,
        grid: &Grid,
        fraction: f64,
        pose: &Pose,
    ) -> Collision {
        let centre = || DVec3::from_array(grid.voxel(self.voxel).map(|v| v as f64));
        let contact = grid.world(self.point.unwrap_or_else(centre));
        Collision {
            element: element.name.clone(),
            against: against.clone(),
            clearance: element.clearance,
            depth: self.depth,
            depth_in_tool: self.in_tool,
            contact: contact.to_array(),
            position: pose.position.to_array(),
            axis: pose.axis().unwrap_or(DVec3::NAN).to_array(),
            roll: matches!(element.shape, Shape::Mesh(_)).then(|| pose.orientation().roll),
            joints: None,
            fraction,
            voxels: self.voxels,
            volume: f64::from(self.voxels) * grid.voxel_volume(),
            poses: 0,
        }
    }
}
