//! The exact field at single poses: any position, any rotation, no grid of poses.
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

use std::borrow::Cow;
use std::sync::OnceLock;

use glam::DVec3;
use pulp::Arch;
use rayon::prelude::*;

use super::{Field, Pose, QueryError, check_lengths};
use crate::distance::DistanceField;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Element, ElementKind, Segment, Tool, ToolError, ToolShape, snapped};
use columns::Columns;
use depth::Depths;
use runs::{Within, count};
use spine::{OPEN, Spine, Verdict};
use sweep::{Placed, Sweep};
use turned::TurnedTools;

/// Counts the obstacle's voxel centres in the analytic tool at any pose, divided by the tool's own count in that
/// orientation with its tip on a voxel centre. Equal to the section at voxel centres.
///
/// Every method takes `&self` and allocates nothing for tools of revolution; threads share one field. Lengths are in
/// the unit of the obstacle's grid. A tool of
/// revolution or not, an invalid pose is never free.
pub struct ExactField<'a> {
    obstacle: Cow<'a, Occupancy>,
    /// The tool's, for messages.
    name: String,
    shape: Shape<'a>,
    columns: Columns,
    /// Largest distance of any of the tool's points from its tip.
    reach: f64,
    /// In the tool's frame.
    sharp_points: Vec<DVec3>,
    arch: Arch,
    /// Made at the first yes/no question.
    proof: OnceLock<(DistanceField, Spine)>,
    /// Made at the first question of depth.
    depths: OnceLock<Depths>,
}

enum Shape<'a> {
    Bodies(Vec<Body>),
    /// Counted by the definition.
    Definition(Cow<'a, Tool>, TurnedTools),
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

impl<'a> ExactField<'a> {
    /// The exact field of a tool around an obstacle.
    #[must_use]
    pub fn of_tool(obstacle: &'a Occupancy, tool: &'a Tool) -> Self {
        Self::with_tool(Cow::Borrowed(obstacle), Cow::Borrowed(tool))
    }

    /// As [`ExactField::of_tool`], of an obstacle and a tool of its own: it outlives what it was made from.
    #[must_use]
    pub fn owned(obstacle: Occupancy, tool: Tool) -> ExactField<'static> {
        ExactField::with_tool(Cow::Owned(obstacle), Cow::Owned(tool))
    }

    fn with_tool(obstacle: Cow<'a, Occupancy>, tool: Cow<'a, Tool>) -> Self {
        let bodies = match &tool.shape {
            ToolShape::Revolved(elements) => {
                elements.iter().map(|e| Body::new(e, obstacle.grid.pitch)).collect::<Option<Vec<_>>>()
            }
            ToolShape::Mesh(_) => None,
        };
        let (name, reach, sharp_points) =
            (tool.name.clone(), tool.reach(), tool.sharp_point_positions(obstacle.grid.pitch));
        let shape = bodies.map_or_else(|| Shape::Definition(tool, TurnedTools::default()), Shape::Bodies);
        Self { reach, sharp_points, ..Self::with_shape(obstacle, &name, shape) }
    }

    /// The exact field of bodies that may overlap, such as [`Tool::inflated_elements`]: each is counted by itself, and
    /// the count of all is the sum. `None` for an outline with an arc around a centre
    /// beyond the axis, or with more than 64 segments.
    #[must_use]
    pub fn of_elements(obstacle: &'a Occupancy, elements: &[Element]) -> Option<Self> {
        let bodies =
            elements.iter().map(|e| Body::new(e, obstacle.grid.pitch)).collect::<Option<Vec<_>>>()?;
        let farthest = |s: &Segment| s.max_radius().hypot(s.range().0.abs().max(s.range().1.abs()));
        let reach = elements.iter().flat_map(|e| &e.profile).map(farthest).fold(0.0, f64::max);
        Some(Self { reach, ..Self::with_shape(Cow::Borrowed(obstacle), "elements", Shape::Bodies(bodies)) })
    }

    fn with_shape(obstacle: Cow<'a, Occupancy>, name: &str, shape: Shape<'a>) -> Self {
        Self {
            columns: Columns::new(&obstacle),
            obstacle,
            name: name.to_owned(),
            shape,
            reach: 0.0,
            sharp_points: vec![DVec3::ZERO],
            arch: Arch::new(),
            proof: OnceLock::new(),
            depths: OnceLock::new(),
        }
    }

    /// The elements that are told apart, from the tip upwards; none for a mesh.
    pub fn elements(&self) -> impl Iterator<Item = ElementKind> {
        match &self.shape {
            Shape::Bodies(bodies) => bodies.as_slice(),
            Shape::Definition(..) => &[],
        }
        .iter()
        .map(|body| body.kind)
    }

    /// Solid voxels whose centres lie in the tool; those of an invalid pose mean nothing ([`Pose::is_valid`]).
    #[must_use]
    pub fn count(&self, pose: &Pose) -> u32 {
        match &self.shape {
            Shape::Bodies(bodies) => self.bodies_count(bodies, self.placed(pose)),
            Shape::Definition(tool, turned) => self.definition_count(tool, turned, pose),
        }
    }

    /// By the tool's voxels where the tip is on a voxel centre, and by the definition elsewhere.
    fn definition_count(&self, tool: &Tool, turned: &TurnedTools, pose: &Pose) -> u32 {
        let grid = &self.obstacle.grid;
        let tip = snapped(grid, pose.position);
        if tip.is_finite()
            && tip == tip.round()
            && tip.abs().max_element() < FARTHEST
            && let Ok(turned) = turned.of(tool, &pose.orientation, grid.pitch)
        {
            return turned.count_in(&self.obstacle, tip.to_array().map(|v| v as i64));
        }
        tool.count_inside(&self.obstacle, pose.position, &pose.orientation)
    }

    /// [`ExactField::count`] of a tool of revolution by the unit vector along its axis; `None` for tools that are counted
    /// by the definition.
    #[must_use]
    pub(crate) fn count_along(&self, position: DVec3, direction: DVec3) -> Option<u32> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        Some(self.bodies_count(bodies, self.placed_along(position, direction)))
    }

    fn bodies_count(&self, bodies: &[Body], placed: Placed) -> u32 {
        bodies.iter().map(|body| self.body_count(body, placed, false)).sum()
    }

    /// Solid voxels in each element, in the order of [`ExactField::elements`].
    ///
    /// # Panics
    /// If `counts` has not as many places as there are elements.
    pub fn element_counts(&self, pose: &Pose, counts: &mut [u32]) {
        let bodies = match &self.shape {
            Shape::Bodies(bodies) => bodies.as_slice(),
            Shape::Definition(..) => &[],
        };
        assert_eq!(counts.len(), bodies.len(), "one count for each element");
        let placed = self.placed(pose);
        for (count, body) in counts.iter_mut().zip(bodies) {
            *count = self.body_count(body, placed, false);
        }
    }

    /// Volume of the obstacle's voxels whose centres lie in the tool, in world units cubed.
    #[must_use]
    pub fn volume(&self, pose: &Pose) -> f64 {
        f64::from(self.count(pose)) * self.obstacle.grid.voxel_volume()
    }

    /// The tool's own count in an orientation with its tip on a voxel centre: what overlaps are divided by.
    ///
    /// # Errors
    /// A tool that holds no voxel centre, or a mesh tool too large to be voxelised.
    pub fn normaliser(&self, orientation: &Orientation) -> Result<u32, ToolError> {
        match &self.shape {
            Shape::Definition(tool, turned) => {
                Ok(turned.of(tool, orientation, self.obstacle.grid.pitch)?.count)
            }
            Shape::Bodies(bodies) => self.bodies_normaliser(bodies, orientation.direction()),
        }
    }

    /// [`ExactField::normaliser`] of a tool of revolution by the unit vector along its axis; `None` for tools that are
    /// counted by the definition.
    pub(crate) fn normaliser_along(&self, direction: DVec3) -> Option<Result<u32, ToolError>> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        Some(self.bodies_normaliser(bodies, direction))
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

    /// The overlap: solid voxels in the tool over the tool's own, in [0, 1]; NaN of an invalid pose.
    ///
    /// # Errors
    /// As [`ExactField::normaliser`].
    pub fn overlap(&self, pose: &Pose) -> Result<f64, ToolError> {
        if !pose.is_valid() {
            return Ok(f64::NAN);
        }
        Ok(ratio(self.count(pose), self.normaliser(&pose.orientation)?))
    }

    /// True where the tool holds any solid voxel's centre, equal to `count(pose) > 0`, and at an invalid pose.
    #[must_use]
    pub fn collides(&self, pose: &Pose) -> bool {
        if !pose.is_valid() {
            return true;
        }
        let collides = self.collides_along(pose.position, pose.orientation.direction());
        collides.unwrap_or_else(|| self.count(pose) > 0)
    }

    /// [`ExactField::collides`] of a tool of revolution by the unit vector along its axis; `None` for tools that are
    /// counted by the definition.
    #[must_use]
    pub(crate) fn collides_along(&self, position: DVec3, direction: DVec3) -> Option<bool> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        Some(self.bodies_collide(bodies, self.placed_along(position, direction)))
    }

    fn bodies_collide(&self, bodies: &[Body], placed: Placed) -> bool {
        if !(placed.tip.is_finite() && placed.direction.is_finite()) {
            return true;
        }
        let (distances, spine) = self.proof(bodies);
        let mut open = [0; OPEN];
        match spine.prove(placed, bodies, distances, &mut open) {
            Verdict::Free => false,
            Verdict::Blocked => true,
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
    /// by the balls' excess. At most 0 where the tool may hold a centre. `None` for mesh tools.
    #[must_use]
    pub fn clearance_bound(&self, pose: &Pose) -> Option<f64> {
        if !pose.is_valid() && matches!(self.shape, Shape::Bodies(_)) {
            return Some(0.0);
        }
        self.clearance_along(pose.position, pose.orientation.direction())
    }

    /// [`ExactField::clearance_bound`] by the unit vector along the tool's axis.
    #[must_use]
    pub(crate) fn clearance_along(&self, position: DVec3, direction: DVec3) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let (distances, spine) = self.proof(bodies);
        Some(spine.clearance(self.placed_along(position, direction), distances) * self.obstacle.grid.pitch)
    }

    /// Lower bound of the length of any translation that frees the tool, in world units, by balls inside the tool; 0
    /// where none is proven, which a free pose always has. How good it is depends on the balls: of a cylinder deep in
    /// a block it falls short of the truth by about 1.7 voxels. `None` for mesh tools.
    #[must_use]
    pub fn penetration_bound(&self, pose: &Pose) -> Option<f64> {
        let Shape::Bodies(bodies) = &self.shape else { return None };
        let placed = self.placed(pose);
        if !pose.is_valid() {
            return Some(0.0);
        }
        let (distances, _) = self.proof(bodies);
        let depths = self.depths.get_or_init(|| Depths::new(bodies, &self.obstacle));
        Some(depths.bound(placed, distances, &self.obstacle) * self.obstacle.grid.pitch)
    }

    /// Signed clearance in world units, as far as the distance transform proves it. Above 0 the tool is free, and no
    /// solid centre is nearer to it ([`ExactField::clearance_bound`]); below 0 it collides, and no translation shorter
    /// than its amount frees it ([`ExactField::penetration_bound`]). 0 where neither is proven: shallow contact and near
    /// misses, which [`ExactField::collides`] decides. `None` for mesh tools.
    #[must_use]
    pub fn signed_clearance(&self, pose: &Pose) -> Option<f64> {
        let clearance = self.clearance_bound(pose)?;
        if clearance > 0.0 { Some(clearance) } else { Some(-self.penetration_bound(pose)?) }
    }

    fn proof(&self, bodies: &[Body]) -> &(DistanceField, Spine) {
        self.proof.get_or_init(|| (DistanceField::new(&self.obstacle), Spine::new(bodies)))
    }

    fn placed(&self, pose: &Pose) -> Placed {
        self.placed_along(pose.position, pose.orientation.direction())
    }

    fn placed_along(&self, position: DVec3, direction: DVec3) -> Placed {
        let grid = &self.obstacle.grid;
        Placed { tip: snapped(grid, position), direction, pitch: grid.pitch }
    }

    /// Largest distance of any of the tool's points from its tip, in world units.
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    /// The tool's sharp points in its frame; the tip alone of bare elements.
    pub(crate) fn sharp_points(&self) -> &[DVec3] {
        &self.sharp_points
    }

    /// The grid of the obstacle.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.obstacle.grid
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

/// Off the grid more centres may fall into the tool than on it.
fn ratio(inside: u32, whole: u32) -> f64 {
    (f64::from(inside) / f64::from(whole)).min(1.0)
}

/// Poses that one thread answers at a time.
const CHUNK: usize = 256;

/// Counts of poses over the tool's own, orientation by orientation, in parallel; NaN of invalid poses.
pub(super) fn answer(
    poses: &[Pose],
    answers: &mut [f32],
    normaliser: impl Fn(&Orientation) -> Result<u32, ToolError> + Sync,
    count: impl Fn(&Pose) -> u32 + Sync,
) -> Result<(), QueryError> {
    check_lengths(poses, answers)?;
    poses.par_chunks(CHUNK).zip(answers.par_chunks_mut(CHUNK)).try_for_each(|(poses, answers)| {
        // Poses of one orientation tend to stand together.
        let mut last: Option<(Orientation, u32)> = None;
        for (pose, answer) in poses.iter().zip(answers) {
            if !pose.is_valid() {
                *answer = f32::NAN;
                continue;
            }
            let whole = match last {
                Some((orientation, whole)) if orientation == pose.orientation => whole,
                _ => normaliser(&pose.orientation)?,
            };
            last = Some((pose.orientation, whole));
            *answer = ratio(count(pose), whole) as f32;
        }
        Ok(())
    })
}

impl Field for ExactField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let field = &*self;
        answer(poses, answers, |orientation| field.normaliser(orientation), |pose| field.count(pose))
    }
}

#[cfg(test)]
mod tests;
