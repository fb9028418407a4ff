//! One tool against one set of solid voxels at single poses: any position, any rotation, no grid of poses.
//!
//! The definition is [`Tool::count_inside`]: solid voxel centres inside the analytic tool. Here the same whole numbers
//! come from the tool's exact run on every line of voxels and the obstacle's running sums along it; a yes/no answer is
//! first sought with balls along the tool's axis and the obstacle's distance transform, and only what these leave open
//! is counted, up to the first voxel found. Tools that are meshes are counted by the definition.

mod columns;
mod depth;
mod runs;
mod spine;
mod sweep;
mod turned;

use std::sync::{Arc, OnceLock};

use glam::{DQuat, DVec3};
use pulp::Arch;

use crate::distance::DistanceField;
use crate::occupancy::Occupancy;
use crate::pose::{Pose, axis_of};
use crate::tool::{Element, ElementKind, Segment, Tool, ToolError, ToolShape, snapped};
use columns::Columns;
use depth::Depths;
use runs::{Within, count};
use spine::{OPEN, Spine, Verdict};
use sweep::{Placed, Sweep};
use turned::TurnedTools;

/// Counts an obstacle's voxel centres in one analytic tool at any pose, divided by the tool's own count in that
/// orientation with its tip on a voxel centre.
///
/// Every method takes `&self` and allocates nothing for tools of revolution; threads share one field. Lengths are in
/// the unit of the obstacle's grid. An invalid pose is never free.
pub(crate) struct SolidField {
    obstacle: Arc<Occupancy>,
    /// The tool's, for messages.
    name: String,
    shape: Shape,
    columns: Columns,
    /// Largest distance of any of the tool's points from its tip.
    reach: f64,
    arch: Arch,
    /// Made at the first yes/no question.
    proof: OnceLock<(DistanceField, Spine)>,
    /// Made at the first question of depth.
    depths: OnceLock<Depths>,
}

enum Shape {
    Bodies(Vec<Body>),
    /// Counted by the definition.
    Definition(Box<Tool>, TurnedTools),
}

/// An element as the fast paths read it.
struct Body {
    kind: ElementKind,
    /// In world units: the predicate.
    profile: Vec<Segment>,
    /// The profile's segments in voxels.
    parts: Vec<Part>,
}

struct Part {
    segment: Segment,
    /// Largest radius, a little generous.
    widest: f64,
}

/// Voxels from the grid beyond which a tip is not counted by whole voxels.
const FARTHEST: f64 = 1e12;

/// Bodies with more segments than this are counted by the definition.
const MOST_SEGMENTS: usize = 64;

impl Body {
    /// `None` for a profile that the runs cannot solve: one that is not convex piece by piece, or has too many.
    fn new(element: &Element, pitch: f64) -> Option<Self> {
        let profile: Vec<Segment> =
            element.profile.iter().copied().filter(|s| s.range().0 < s.range().1).collect();
        let convex = profile.iter().all(|segment| match *segment {
            Segment::Line { radius_from, radius_to, .. } => radius_from >= 0.0 && radius_to >= 0.0,
            Segment::Arc { from, to, centre_height, centre_radius, arc_radius } => {
                let slip = 1e-9 * arc_radius;
                centre_radius >= 0.0
                    && from >= centre_height - arc_radius - slip
                    && to <= centre_height + arc_radius + slip
            }
        });
        let parts = profile
            .iter()
            .map(|s| s.scaled(1.0 / pitch))
            .map(|segment| Part { segment, widest: segment.max_radius() + 1e-4 })
            .collect();
        (convex && profile.len() <= MOST_SEGMENTS).then_some(Self { kind: element.kind, profile, parts })
    }
}

impl SolidField {
    /// Of a tool around an obstacle.
    pub(crate) fn of_tool(obstacle: Arc<Occupancy>, tool: &Tool) -> Self {
        let bodies = match &tool.shape {
            ToolShape::Revolved(elements) => {
                elements.iter().map(|e| Body::new(e, obstacle.grid.pitch)).collect::<Option<Vec<_>>>()
            }
            ToolShape::Mesh(_) => None,
        };
        let definition = || Shape::Definition(Box::new(tool.clone()), TurnedTools::default());
        let shape = bodies.map_or_else(definition, Shape::Bodies);
        Self { reach: tool.reach(), ..Self::with_shape(obstacle, &tool.name, shape) }
    }

    /// Of bodies that may overlap, such as [`Tool::inflated_elements`]: each is counted by itself, and
    /// the count of all is the sum. `None` for an outline with an arc around a centre
    /// beyond the axis, or with more than 64 segments.
    pub(crate) fn of_elements(obstacle: Arc<Occupancy>, elements: &[Element]) -> Option<Self> {
        let bodies =
            elements.iter().map(|e| Body::new(e, obstacle.grid.pitch)).collect::<Option<Vec<_>>>()?;
        let farthest = |s: &Segment| s.max_radius().hypot(s.range().0.abs().max(s.range().1.abs()));
        let reach = elements.iter().flat_map(|e| &e.profile).map(farthest).fold(0.0, f64::max);
        Some(Self { reach, ..Self::with_shape(obstacle, "elements", Shape::Bodies(bodies)) })
    }

    fn with_shape(obstacle: Arc<Occupancy>, name: &str, shape: Shape) -> Self {
        Self {
            columns: Columns::new(&obstacle),
            obstacle,
            name: name.to_owned(),
            shape,
            reach: 0.0,
            arch: Arch::new(),
            proof: OnceLock::new(),
            depths: OnceLock::new(),
        }
    }

    /// The elements that are told apart, from the tip upwards; none for a mesh.
    pub(crate) fn elements(&self) -> impl Iterator<Item = ElementKind> {
        match &self.shape {
            Shape::Bodies(bodies) => bodies.as_slice(),
            Shape::Definition(..) => &[],
        }
        .iter()
        .map(|body| body.kind)
    }

    /// Solid voxels whose centres lie in the tool; `None` for an invalid pose.
    pub(crate) fn count(&self, pose: &Pose) -> Option<u32> {
        let axis = pose.axis()?;
        Some(match &self.shape {
            Shape::Bodies(bodies) => self.bodies_count(bodies, self.placed(pose.position, axis)),
            Shape::Definition(tool, turned) => self.definition_count(tool, turned, pose),
        })
    }

    /// By the tool's voxels where the tip is on a voxel centre, and by the definition elsewhere.
    fn definition_count(&self, tool: &Tool, turned: &TurnedTools, pose: &Pose) -> u32 {
        let grid = &self.obstacle.grid;
        let (tip, orientation) = (snapped(grid, pose.position), pose.orientation());
        if tip == tip.round()
            && tip.abs().max_element() < FARTHEST
            && let Ok(turned) = turned.of(tool, &orientation, grid.pitch)
        {
            return turned.count_in(&self.obstacle, tip.to_array().map(|v| v as i64));
        }
        tool.count_inside(&self.obstacle, pose.position, &orientation)
    }

    fn bodies_count(&self, bodies: &[Body], placed: Placed) -> u32 {
        bodies.iter().map(|body| self.body_count(body, placed, false)).sum()
    }

    /// Solid voxels in each element, in the order of [`SolidField::elements`]; 0 at an invalid pose.
    ///
    /// # Panics
    /// If `counts` has not as many places as there are elements.
    pub(crate) fn element_counts(&self, pose: &Pose, counts: &mut [u32]) {
        let bodies = match &self.shape {
            Shape::Bodies(bodies) => bodies.as_slice(),
            Shape::Definition(..) => &[],
        };
        assert_eq!(counts.len(), bodies.len(), "one count for each element");
        let Some(axis) = pose.axis() else { return counts.fill(0) };
        let placed = self.placed(pose.position, axis);
        for (count, body) in counts.iter_mut().zip(bodies) {
            *count = self.body_count(body, placed, false);
        }
    }

    /// The tool's own count in a rotation with its tip on a voxel centre: what overlaps are divided by.
    ///
    /// # Errors
    /// A tool that holds no voxel centre, or a mesh tool too large to be voxelised.
    pub(crate) fn normaliser(&self, rotation: DQuat) -> Result<u32, ToolError> {
        let too_small = || ToolError::TooSmall { name: self.name.clone(), pitch: self.obstacle.grid.pitch };
        let axis = axis_of(rotation).ok_or_else(too_small)?;
        match &self.shape {
            Shape::Definition(tool, turned) => {
                let orientation = Pose::new(DVec3::ZERO, rotation).orientation();
                Ok(turned.of(tool, &orientation, self.obstacle.grid.pitch)?.count)
            }
            Shape::Bodies(bodies) => self.bodies_normaliser(bodies, axis),
        }
    }

    fn bodies_normaliser(&self, bodies: &[Body], direction: DVec3) -> Result<u32, ToolError> {
        let pitch = self.obstacle.grid.pitch;
        let placed = Placed { tip: DVec3::ZERO, direction, pitch };
        let all = |body: &Body| -> u32 {
            let reach = |p: &Part| p.segment.range().1.abs().max(p.segment.range().0.abs()) + p.widest;
            let reach = body.parts.iter().map(reach).fold(0.0, f64::max);
            body_segments(body, placed)
                .map(|sweep| count(self.arch, &sweep, Within::Everything(reach.ceil() as i64 + 2), false))
                .sum()
        };
        match bodies.iter().map(all).sum() {
            0 => Err(ToolError::TooSmall { name: self.name.clone(), pitch }),
            count => Ok(count),
        }
    }

    /// True where the tool holds any solid voxel's centre, equal to a count above 0, and at an invalid pose.
    #[inline]
    pub(crate) fn collides(&self, pose: &Pose) -> bool {
        let Some(axis) = pose.axis() else { return true };
        match &self.shape {
            Shape::Bodies(bodies) => self.bodies_collide(bodies, self.placed(pose.position, axis)),
            Shape::Definition(tool, turned) => self.definition_count(tool, turned, pose) > 0,
        }
    }

    fn bodies_collide(&self, bodies: &[Body], placed: Placed) -> bool {
        if !placed.tip.is_finite() {
            return true;
        }
        let (distances, spine) = self.proof(bodies);
        let mut open = [0; OPEN];
        match spine.prove(placed, bodies, distances, &mut open) {
            Verdict::Free => false,
            Verdict::Colliding => true,
            Verdict::Undecided => bodies.iter().any(|body| self.body_count(body, placed, true) > 0),
            Verdict::Open(found) => open[..found].iter().any(|&index| {
                let piece = spine.piece(index);
                let body = &bodies[piece.body];
                let (world, part) = (&body.profile[piece.segment], &body.parts[piece.segment]);
                // A little over either end, as far as the segment reaches: the next piece's ball covers its own heights
                // only up to rounding.
                let (lowest, highest) = part.segment.range();
                let (from, to) = ((piece.from - 1e-4).max(lowest), (piece.to + 1e-4).min(highest));
                let sweep = Sweep::new(placed, world, &part.segment, part.widest, from, to);
                count(self.arch, &sweep, Within::Obstacle(&self.columns), true) > 0
            }),
        }
    }

    /// Lower bound of the distance from the tool's surface to the nearest solid voxel's centre, in world units, from the
    /// balls that cover the tool: loose by the rounding of points on the axis to voxels (up to 0.87 voxels) and
    /// by the balls' excess. At most 0 where the tool may hold a centre, and at an invalid pose. `None` for mesh tools.
    pub(crate) fn clearance_bound(&self, pose: &Pose) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let Some(axis) = pose.axis() else { return Some(0.0) };
        let (distances, spine) = self.proof(bodies);
        let placed = self.placed(pose.position, axis);
        Some(spine.clearance(placed, distances) * self.obstacle.grid.pitch)
    }

    /// Lower bound of the length of any translation that frees the tool, in world units, by balls inside the tool; 0
    /// where none is proven, which a free pose always has, and an invalid one. How good it is depends on the balls: of a
    /// cylinder deep in a block it falls short of the truth by about 1.7 voxels. `None` for mesh tools.
    pub(crate) fn penetration_bound(&self, pose: &Pose) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let Some(axis) = pose.axis() else { return Some(0.0) };
        let (distances, _) = self.proof(bodies);
        let depths = self.depths.get_or_init(|| Depths::new(bodies, &self.obstacle));
        let placed = self.placed(pose.position, axis);
        Some(depths.bound(placed, distances, &self.obstacle) * self.obstacle.grid.pitch)
    }

    fn proof(&self, bodies: &[Body]) -> &(DistanceField, Spine) {
        self.proof.get_or_init(|| (DistanceField::new(&self.obstacle), Spine::new(bodies)))
    }

    fn placed(&self, position: DVec3, direction: DVec3) -> Placed {
        let grid = &self.obstacle.grid;
        Placed { tip: snapped(grid, position), direction, pitch: grid.pitch }
    }

    /// Largest distance of any of the tool's points from its tip, in world units.
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    fn body_count(&self, body: &Body, placed: Placed, stop: bool) -> u32 {
        if !placed.tip.is_finite() {
            return 0;
        }
        body_segments(body, placed)
            .map(|sweep| count(self.arch, &sweep, Within::Obstacle(&self.columns), stop))
            .sum()
    }
}

/// Every segment of a body in a pose.
fn body_segments(body: &Body, placed: Placed) -> impl Iterator<Item = Sweep<'_>> {
    body.profile.iter().zip(&body.parts).map(move |(world, part)| {
        let (from, to) = part.segment.range();
        Sweep::new(placed, world, &part.segment, part.widest, from, to)
    })
}

#[cfg(test)]
mod tests;
