//! One tool against one set of solid voxels at single poses: any position, any rotation, no grid of poses.
//!
//! The definition is [`Tool::count_inside`]: solid voxel centres inside the analytic tool. Here the same whole numbers
//! come from the tool's exact run on every line of voxels and the obstacle's running sums along it; whether it
//! collides is first decided by a sphere tree and the obstacle's distance transform, and only what these leave open
//! is counted, up to the first voxel found. Tools that are meshes are counted by the definition.

mod batch;
mod closed_mesh;
mod decision;
mod definition;
mod held_points;
mod inscribed;
mod lateral_separation;
mod lines;
mod nearest;
mod point_tree;
mod runs;
mod segment;
mod sphere_tree;
mod voxels;

use std::cell::Cell;
use std::sync::OnceLock;

use glam::{DQuat, DVec3};
use pulp::Arch;

use crate::parallel::make_once;
use crate::pose::{Pose, axis_of};
use crate::tool::{Element, Segment, Tool, ToolError, ToolShape, snapped};
use crate::workspaces::Workspaces;
use batch::{BatchSpheres, Scratch};
use definition::Definition;
use inscribed::InscribedSpheres;
pub(crate) use lines::{BodyLines, LineVisitor};
pub(crate) use nearest::Separation;
pub(crate) use point_tree::{HalfSpace, PointTree};
use runs::{Lines, Within, count};
use segment::{PlacedSegment, VoxelPose};
pub(crate) use sphere_tree::FreeBall;
use sphere_tree::SphereTree;
pub(crate) use voxels::{OutsidePlane, SolidVoxels};

/// One tool around one set of solid voxels. As in an [`ExactField`](super::ExactField), lengths are in the grid's unit,
/// nothing is allocated for tools of revolution, and an invalid pose is never free.
pub(crate) struct SolidField {
    voxels: SolidVoxels,
    /// The tool's, for messages.
    name: String,
    shape: Shape,
    /// The shape as elements, each with how deep in it points of surfaces may lie.
    touching: Option<Vec<(Element, f64)>>,
    /// Largest distance of any of the tool's points from its tip.
    reach: f64,
    arch: Arch,
    /// Made at the first decision.
    spheres: OnceLock<SphereTree>,
    /// Made at the first bound of a penetration.
    inscribed: OnceLock<InscribedSpheres>,
    /// Made at the first batch.
    batch: OnceLock<BatchSpheres>,
    workspaces: Workspaces<Scratch>,
}

enum Shape {
    Bodies(Vec<Body>),
    /// Counted by the definition.
    Definition(Box<Definition>),
}

/// An element as the fast paths read it.
struct Body {
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

/// What is known of a tool at a pose.
#[derive(Clone, Copy, Default)]
pub(crate) struct Known<'a> {
    /// No solid centre in it lies in the tool.
    pub(crate) free_ball: Option<&'a FreeBall>,
    /// The tool lies in it.
    pub(crate) stays_in: Option<&'a HalfSpace>,
}

/// Bodies with more segments than this are counted by the definition.
const MAX_SEGMENTS: usize = 64;

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
        (convex && profile.len() <= MAX_SEGMENTS).then_some(Self { profile, parts })
    }
}

impl SolidField {
    pub(crate) fn of_tool(obstacle: impl Into<SolidVoxels>, tool: &Tool) -> Self {
        let voxels = obstacle.into();
        let bodies = match &tool.shape {
            ToolShape::Revolved(elements) => bodies_of(elements, voxels.occupancy().grid.pitch),
            ToolShape::Mesh(_) => None,
        };
        let definition = || Shape::Definition(Box::new(Definition::new(tool)));
        let shape = bodies.map_or_else(definition, Shape::Bodies);
        Self::new(voxels, &tool.name, shape, tool.reach())
    }

    /// Of bodies that may overlap, such as [`Tool::offset_elements`]: each is counted by itself, and
    /// the count of all is the sum. `None` for an outline with an arc around a centre
    /// beyond the axis, or with more than 64 segments.
    pub(crate) fn of_elements(obstacle: impl Into<SolidVoxels>, elements: &[Element]) -> Option<Self> {
        let voxels = obstacle.into();
        let shape = Shape::Bodies(bodies_of(elements, voxels.occupancy().grid.pitch)?);
        let farthest = |s: &Segment| s.max_radius().hypot(s.range().0.abs().max(s.range().1.abs()));
        let reach = elements.iter().flat_map(|e| &e.profile).map(farthest).fold(0.0, f64::max);
        Some(Self::new(voxels, "elements", shape, reach))
    }

    /// The same, whose elements, those that the field was made of, may each hold points of surfaces so deep: what touches a surface
    /// does, by rounding. None at all at minus infinity.
    pub(crate) fn touching(self, elements: impl IntoIterator<Item = (Element, f64)>) -> Self {
        Self { touching: Some(elements.into_iter().collect()), ..self }
    }

    fn new(voxels: SolidVoxels, name: &str, shape: Shape, reach: f64) -> Self {
        Self {
            voxels,
            name: name.to_owned(),
            shape,
            touching: None,
            reach,
            arch: Arch::new(),
            spheres: OnceLock::new(),
            inscribed: OnceLock::new(),
            batch: OnceLock::new(),
            workspaces: Workspaces::default(),
        }
    }

    /// None where the tool is counted by the definition.
    fn bodies(&self) -> &[Body] {
        match &self.shape {
            Shape::Bodies(bodies) => bodies,
            Shape::Definition(..) => &[],
        }
    }

    /// Solid voxels whose centres lie in the tool; `None` for an invalid pose.
    pub(crate) fn count(&self, pose: &Pose) -> Option<u32> {
        let placed = self.placed(pose)?;
        Some(match &self.shape {
            Shape::Bodies(bodies) => bodies.iter().map(|body| self.body_count(body, placed, false)).sum(),
            Shape::Definition(definition) => definition.count(self.voxels.occupancy(), pose),
        })
    }

    /// Solid voxels, and points of the surface, in each element, in the order they were given; 0 at an invalid pose.
    ///
    /// # Panics
    /// If `counts` has not as many places as there are elements.
    pub(crate) fn element_counts(&self, pose: &Pose, counts: &mut [u32]) {
        let bodies = self.bodies();
        assert_eq!(counts.len(), bodies.len(), "one count for each element");
        let Some(placed) = self.placed(pose) else { return counts.fill(0) };
        for (count, body) in counts.iter_mut().zip(bodies) {
            *count = self.body_count(body, placed, false);
        }
        let counts = Cell::from_mut(counts).as_slice_of_cells();
        self.visit_surface(pose, |body, _, _, _| counts[body].set(counts[body].get() + 1));
    }

    /// The tool's own count in a rotation with its tip on a voxel centre: what overlaps are divided by.
    pub(crate) fn normaliser(&self, rotation: DQuat) -> Result<u32, ToolError> {
        let pitch = self.voxels.occupancy().grid.pitch;
        let too_small = || ToolError::TooSmall { name: self.name.clone(), pitch };
        let direction = axis_of(rotation).ok_or_else(too_small)?;
        if let Shape::Definition(definition) = &self.shape {
            let orientation = Pose::new(DVec3::ZERO, rotation).orientation();
            return Ok(definition.of(&orientation, pitch)?.count);
        }
        let placed = VoxelPose { tip: DVec3::ZERO, direction, pitch };
        let all = |body: &Body| -> u32 {
            let reach = |p: &Part| p.segment.range().1.abs().max(p.segment.range().0.abs()) + p.widest;
            let reach = body.parts.iter().map(reach).fold(0.0, f64::max);
            let within = Within::Everything(reach.ceil() as i64 + 2);
            body_segments(body, placed).map(|segment| count(self.arch, &segment, within, false)).sum()
        };
        match self.bodies().iter().map(all).sum() {
            0 => Err(too_small()),
            count => Ok(count),
        }
    }

    /// True where the tool holds any solid voxel's centre, equal to a count above 0, or a point of the surface, and at an invalid pose.
    #[inline]
    pub(crate) fn collides(&self, pose: &Pose) -> bool {
        let Some(axis) = pose.axis() else { return true };
        match &self.shape {
            Shape::Bodies(_) => self.meets(pose.position, axis, Known::default(), None),
            Shape::Definition(definition) => definition.collides(self.voxels.occupancy(), pose),
        }
    }

    /// [`SolidField::collides`] with the tip at a position and the axis along a unit vector, for poses that follow one
    /// another: `last` is what collided before, and is tried first. True as well where the tool holds a point of the obstacle's
    /// surface.
    #[inline]
    pub(crate) fn meets(
        &self,
        tip: DVec3,
        axis: DVec3,
        known: Known<'_>,
        last: Option<&mut Option<[f64; 3]>>,
    ) -> bool {
        match &self.shape {
            Shape::Bodies(bodies) => {
                let pieces = self.spheres(bodies).roots();
                let placed = self.voxel_pose(tip, axis);
                let mut found = last.as_ref().and_then(|last| **last);
                if !self.voxels.surfaces().is_empty() {
                    // A known centre that is no deeper than a point may be is searched for anew.
                    let counts = |point| (0..bodies.len()).any(|body| self.holds_point(body, placed, point));
                    if found.take().is_some_and(counts) {
                        return true;
                    }
                    if let Some(held) =
                        self.first_point(placed, known.stays_in, |body| self.contact(body), counts)
                    {
                        if let Some(last) = last {
                            *last = Some(held);
                        }
                        return true;
                    }
                }
                let wanted = last.is_some().then_some(&mut found);
                let collides =
                    self.bodies_collide(bodies, placed, known.free_ball, pieces, |_| Lines::ALL, wanted);
                if let Some(last) = last {
                    *last = found.or(*last);
                }
                collides
            }
            Shape::Definition(definition) => {
                definition.collides(self.voxels.occupancy(), &Pose::along(tip, axis))
            }
        }
    }

    /// True where the tool holds a point, given in continuous voxel coordinates; false of a mesh.
    #[inline]
    pub(crate) fn contains(&self, tip: DVec3, axis: DVec3, point: [f64; 3]) -> bool {
        self.holds(self.voxel_pose(tip, axis), point)
    }

    #[inline]
    fn holds(&self, placed: VoxelPose, point: [f64; 3]) -> bool {
        self.bodies().iter().any(|body| placed.contains(&body.profile, point))
    }

    /// A point of the world in continuous voxel coordinates.
    pub(crate) fn voxel_of(&self, point: DVec3) -> [f64; 3] {
        self.voxels.occupancy().grid.continuous(point).to_array()
    }

    pub(crate) fn voxels(&self) -> &SolidVoxels {
        &self.voxels
    }

    #[inline]
    fn voxel_pose(&self, tip: DVec3, direction: DVec3) -> VoxelPose {
        let grid = &self.voxels.occupancy().grid;
        VoxelPose { tip: snapped(grid, tip), direction, pitch: grid.pitch }
    }

    /// [`ExactField::clearance_bound`](super::ExactField::clearance_bound) of this obstacle, and no more than `most`: the less that
    /// is, the sooner it is known.
    pub(crate) fn clearance_up_to(&self, pose: &Pose, most: f64) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let Some(placed) = self.placed(pose) else { return Some(0.0) };
        let most = most / placed.pitch;
        let room = |most: f64| self.spheres(bodies).clearance(placed, self.voxels.distances(), most);
        Some(self.room_among_points(placed, most, room) * placed.pitch)
    }

    /// [`ExactField::penetration_bound`](super::ExactField::penetration_bound) of this obstacle.
    pub(crate) fn penetration_bound(&self, pose: &Pose) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let Some(placed) = self.placed(pose) else { return Some(0.0) };
        let inscribed = make_once(&self.inscribed, || InscribedSpheres::new(bodies));
        Some(inscribed.bound(placed, &self.voxels) * placed.pitch)
    }

    fn spheres(&self, bodies: &[Body]) -> &SphereTree {
        make_once(&self.spheres, || SphereTree::new(bodies))
    }

    /// `None` for an invalid pose.
    #[inline]
    fn placed(&self, pose: &Pose) -> Option<VoxelPose> {
        Some(self.voxel_pose(pose.position, pose.axis()?))
    }

    /// Largest distance of any of the tool's points from its tip, in world units.
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    fn body_count(&self, body: &Body, placed: VoxelPose, stop: bool) -> u32 {
        if !placed.tip.is_finite() {
            return 0;
        }
        let within = Within::Obstacle(self.voxels.columns(), Lines::ALL);
        body_segments(body, placed).map(|segment| count(self.arch, &segment, within, stop)).sum()
    }
}

/// `None` where one of them must be counted by the definition.
fn bodies_of(elements: &[Element], pitch: f64) -> Option<Vec<Body>> {
    elements.iter().map(|element| Body::new(element, pitch)).collect()
}

fn body_segments(body: &Body, placed: VoxelPose) -> impl Iterator<Item = PlacedSegment<'_>> {
    body.profile.iter().zip(&body.parts).map(move |(world, part)| part.placed(world, placed))
}

impl Part {
    /// All of it in a pose; `world` is the same segment in world units.
    fn placed<'a>(&self, world: &'a Segment, placed: VoxelPose) -> PlacedSegment<'a> {
        let (from, to) = self.segment.range();
        PlacedSegment::new(placed, world, &self.segment, self.widest, from, to)
    }
}

#[cfg(test)]
mod batch_tests;
#[cfg(test)]
pub(crate) mod tests;
