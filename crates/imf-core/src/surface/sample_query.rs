//! The contact poses of one tool at one sample, tested direction by direction.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec3};

use super::contact::{ContactFrame, Touch};
use super::level_ring::RingPlaces;
use super::{Revolved, Shape, SurfaceSample, SurfaceTool, ToolDirection, Verdict};
use crate::field::solid::{FreeBall, HalfSpace, Known, OutsidePlane, SolidField};
use crate::pose::Pose;

/// The result of a contact pose, or the best one of a direction; from best to worst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    /// With the tip there.
    Good(DVec3),
    /// With the tip there.
    Obstructed(DVec3),
    Gouged,
    NoContact,
}

impl Outcome {
    pub(super) fn is_good(&self) -> bool {
        matches!(self, Self::Good(_))
    }

    pub(super) fn verdict(&self) -> Verdict {
        match self {
            Self::Good(_) => Verdict::Reached,
            Self::Obstructed(_) => Verdict::Obstructed,
            Self::Gouged => Verdict::Gouged,
            Self::NoContact => Verdict::NotFaced,
        }
    }

    pub(super) fn or(self, other: Self) -> Self {
        if other.verdict() < self.verdict() { other } else { self }
    }
}

/// Most steps by which a gouging cutter is moved aside.
const GOUGE_STEPS: usize = 24;
/// Cosine of the angle to a tool's axis within which a hole's floor is level.
const LEVEL_FLOOR: f64 = 0.999;
/// Points of a mesh tool that are tried.
const VERTICES: usize = 48;
/// Solid centres outside the tangent plane that are tried one by one in every direction.
const FEW: u32 = 16;

/// Where a point of the surface counts as in the tangent plane: so many voxels outside it, and tolerances, whichever is less.
const IN_PLANE: [f64; 2] = [0.01, 0.1];

/// How far an obstructed tool stands off the surface when it is tried once more, in tolerances: a shank as wide as its cutter touches the
/// wall that the cutter touches, and rounding must not decide.
pub(super) const TOUCH: f64 = 0.01;

/// What obstructed an earlier pose, a voxel or a point of the surface, and is tried first: for neighbouring samples it is mostly the
/// same.
pub(super) type Last = Option<[f64; 3]>;

/// A direction, and what decides beside the cutter.
pub(super) struct DirectionQuery<'a, G> {
    pub(super) turn: &'a ToolDirection,
    /// What obstructed the cutter.
    pub(super) last: &'a mut Last,
    /// Shank and holder, from which a cutter on a level ring steps away.
    pub(super) rest: Option<&'a SolidField>,
    /// True of a tip where they are free.
    pub(super) is_free: G,
    pub(super) rings: &'a mut RingPlaces,
}

impl<G: FnMut(DVec3) -> bool> DirectionQuery<'_, G> {
    /// The outcome of the whole tool, where that of its cutter is known.
    pub(super) fn with_rest(&mut self, of_cutter: Outcome) -> Outcome {
        match of_cutter {
            Outcome::Good(tip) if !(self.is_free)(tip) => Outcome::Obstructed(tip),
            other => other,
        }
    }
}

/// Tests the contact poses of a tool at a sample.
pub(super) struct SampleQuery<'a> {
    tool: &'a SurfaceTool,
    sample: &'a SurfaceSample,
    /// All solid centres in this ball that a cutter could hold are listed.
    free_ball: Option<FreeBall>,
    /// Of a convex cutter that touches: outside the tangent plane.
    stays_in: Option<HalfSpace>,
    listed: Vec<[f64; 3]>,
}

impl SurfaceTool {
    /// Radius in voxels of the largest ball around a sample whose solid centres it needs; `None` where it needs none.
    pub(super) fn asks_around(&self) -> Option<f64> {
        self.revolved().filter(|tool| tool.outline.convex).map(|tool| tool.near)
    }

    /// The solid centres of the part around a sample, as far as a radius; `None` where there are more than `most`.
    pub(super) fn around(&self, sample: &SurfaceSample, radius: f64, most: u32) -> Option<OutsidePlane> {
        self.revolved()?.cutter.voxels().outside_plane(sample.point, sample.normal, radius, most)
    }
}

impl<'a> SampleQuery<'a> {
    /// `around` are the solid centres around the sample, where they are known.
    pub(super) fn new(
        tool: &'a SurfaceTool,
        sample: &'a SurfaceSample,
        around: Option<&OutsidePlane>,
    ) -> Self {
        let mut query = Self { tool, sample, free_ball: None, stays_in: None, listed: Vec::new() };
        if let Some(revolved) = tool.revolved().filter(|revolved| revolved.outline.convex) {
            let (near, across) = (revolved.near, revolved.near_across);
            let middle = DVec3::from_array(revolved.cutter.voxel_of(sample.point));
            let tolerance = tool.tolerance / revolved.cutter.voxels().occupancy().grid.pitch;
            let offset = middle.dot(sample.normal) + IN_PLANE[0].min(IN_PLANE[1] * tolerance);
            query.stays_in = Some(HalfSpace { normal: sample.normal, offset });
            query.free_ball =
                [near, 0.5 * (near + across), across].into_iter().find_map(|radius| match around {
                    Some(around) => around.free_ball(radius, FEW, &mut query.listed),
                    None => tool.around(sample, radius, FEW)?.free_ball(radius, FEW, &mut query.listed),
                });
        }
        query
    }

    /// True where the cutter may touch with a level ring, and the search for its place depends on shank and holder.
    pub(super) fn has_ring(&self, turn: &ToolDirection) -> bool {
        let Some(tool) = self.tool.revolved() else { return true };
        let mut ring = false;
        if let Some(facing) = ContactFrame::new(self.sample.normal, turn.axis, tool.highest) {
            tool.outline.touches(facing.slope, self.tool.tolerance, |touch| {
                ring |= matches!(touch, Touch::Ring { .. });
            });
        }
        ring
    }

    /// The best pose of a direction. The search ends at the first pose where the cutter and all above it is free.
    pub(super) fn best_pose<G: FnMut(DVec3) -> bool>(&self, mut direction: DirectionQuery<'_, G>) -> Outcome {
        let (tolerance, sample, turn) = (self.tool.tolerance, self.sample, direction.turn);
        let mut best = Outcome::NoContact;
        let tool = match &*self.tool.shape {
            Shape::Revolved(tool) => tool,
            Shape::Mesh { touching, whole } => {
                // The points that lie farthest towards the surface, a tolerance outside it; between them the tool is flat.
                let support = |v: &DVec3| -sample.normal.dot(turn.rotation * *v);
                let farthest = touching.iter().map(support).fold(f64::NEG_INFINITY, f64::max);
                let outside = sample.point + sample.normal * tolerance;
                let touching = touching.iter().filter(|v| support(v) >= farthest - tolerance).take(VERTICES);
                let touching: Vec<DVec3> = touching.copied().collect();
                let middle = touching.iter().sum::<DVec3>() / touching.len() as f64;
                // One point alone is its own middle.
                let several = if touching.len() > 1 { &touching[..] } else { &[] };
                let halfway = several.iter().map(|&vertex| 0.5 * (middle + vertex));
                let places = std::iter::once(middle).chain(halfway).chain(several.iter().copied());
                for place in places {
                    let tip = outside - turn.rotation * place;
                    let pose = Pose::new(tip, turn.rotation);
                    let collides = whole.mesh_holds_a_point(&pose) || whole.collides(&pose);
                    let outcome = if collides { Outcome::Obstructed(tip) } else { Outcome::Good(tip) };
                    best = best.or(direction.with_rest(outcome));
                    if best.is_good() {
                        break;
                    }
                }
                return best;
            }
        };
        let Some(facing) = ContactFrame::new(sample.normal, turn.axis, tool.highest) else {
            return Outcome::NoContact;
        };
        let DirectionQuery { last, rest, mut is_free, rings: places, .. } = direction;
        let in_hole = |tip| !tool.plunge_only || self.is_in_hole(tool, tip, turn.axis);
        let is_free = |tip| in_hole(tip) && is_free(tip);
        let mut direction = DirectionQuery { turn, last, rest, is_free, rings: places };
        let mut rings = 0;
        tool.outline.touches(facing.slope, tolerance, |touch| {
            if best.is_good() {
                return;
            }
            let outcome = match touch {
                Touch::Point { height, radius, hangs } => {
                    let tip = facing.tip(sample.point, height, radius);
                    let outcome = match self.at(tool, tip, &mut direction) {
                        Outcome::Gouged => self.avoid_gouge(tool, tip, &mut direction),
                        outcome @ Outcome::Obstructed(_) => {
                            let tip = tip + sample.normal * (TOUCH * tolerance);
                            outcome.or(self.at(tool, tip, &mut direction))
                        }
                        outcome => outcome,
                    };
                    match outcome {
                        Outcome::Obstructed(tip)
                            if hangs
                                && !matches!(best, Outcome::Obstructed(_))
                                && tool.axis_meets_part(tip, turn.axis) =>
                        {
                            Outcome::Gouged
                        }
                        outcome => outcome,
                    }
                }
                Touch::Ring { height, inner, outer } => {
                    let middle = sample.point - turn.axis * height;
                    rings += 1;
                    self.on_ring(tool, middle, ([inner, outer], rings - 1), &mut direction)
                }
            };
            best = best.or(match outcome {
                Outcome::Obstructed(tip) if !in_hole(tip) => Outcome::NoContact,
                outcome => outcome,
            });
        });
        best
    }

    /// Whether the part stands all around the tool that touches the sample, as below the sample itself: what a tool machines that cuts
    /// along its axis alone is a hole of its own outline. On a level floor and near its axis, around it one voxel above.
    fn is_in_hole(&self, tool: &Revolved, tip: DVec3, axis: DVec3) -> bool {
        let part = tool.cutter.voxels().occupancy();
        let (from_tip, pitch) = (self.sample.point - tip, part.grid.pitch);
        let stands_around = |beyond: DVec3| {
            (0..4).all(|quarter| {
                let turned = DQuat::from_axis_angle(axis, f64::from(quarter) * FRAC_PI_2) * beyond;
                let voxel = part.grid.index_at(part.grid.continuous(tip + turned));
                voxel.is_some_and(|index| part.solid[index] == 1)
            })
        };
        let (facing, height) = (self.sample.normal.dot(axis), from_tip.dot(axis));
        if facing > LEVEL_FLOOR {
            let beside = axis.any_orthonormal_vector();
            return stands_around((height + pitch) * axis + (tool.radius + pitch) * beside);
        }
        let beside = (self.sample.normal - facing * axis).normalize_or_zero();
        // Near the axis a plane that is tilted lies below all quarter turns of a point behind it: there one voxel higher up too.
        let away = (from_tip - height * axis).length();
        let is_told = away * (1.0 - facing * facing).max(0.0).sqrt() >= pitch || {
            let wide = tool.end.radius_at(height + pitch);
            let wide = if wide > 0.0 { wide } else { tool.radius };
            stands_around((height + pitch) * axis + (wide + pitch) * beside)
        };
        // A voxel that holds it is solid: it lies farther in than half a voxel's diagonal.
        is_told && stands_around(from_tip - pitch * self.sample.normal)
    }

    /// On a facet of a curved surface a gouging cutter is moved aside: as far as the true normal may differ from the facet's, and
    /// while its surface stays within the tolerance of the sample.
    fn avoid_gouge(
        &self,
        tool: &Revolved,
        tip: DVec3,
        direction: &mut DirectionQuery<'_, impl FnMut(DVec3) -> bool>,
    ) -> Outcome {
        if self.sample.bend == 0.0 {
            return Outcome::Gouged;
        }
        let axis = direction.turn.axis;
        let most = tool.radius * self.sample.bend + self.tool.tolerance;
        // How deep a voxel is in the cutter as it first stands: one deeper than it may move is in it wherever it goes.
        let depth = |voxel: [f64; 3]| {
            if !tool.cutter.contains(tip, axis, voxel) {
                return -1.0;
            }
            let [height, radius] = tool.cutter.along_and_away(tip, axis, voxel);
            tool.eroded.depth(height, radius, true)
        };
        let mut deepest = direction.last.map_or(-1.0, depth);
        let stays = |depth: f64| depth > most * (1.0 + 1e-9);
        if stays(deepest) || self.listed.iter().any(|&voxel| stays(depth(voxel))) {
            return Outcome::Gouged;
        }
        let sample = tool.cutter.voxel_of(self.sample.point);
        // What this search met before is tried first, but not what others met: the path would depend on them.
        let mut met = [[0.0; 3]; GOUGE_STEPS];
        let mut count = 0;
        let mut now = tip;
        for _ in 0..GOUGE_STEPS {
            let known = self.listed.iter().chain(&met[..count]);
            let mut blocker = known.copied().rfind(|&voxel| tool.cutter.contains(now, axis, voxel));
            if blocker.is_none() {
                // Before the first step one that stays is enough.
                let enough = if now == tip { most * (1.0 + 1e-9) } else { f64::INFINITY };
                blocker = tool.deepest_surface_point(now, axis, enough);
                if blocker.is_none() && !tool.cutter.meets(now, axis, Known::default(), Some(&mut blocker)) {
                    if !tool.touching.contains(now, axis, sample) {
                        break;
                    }
                    // The cutter may cross the tangent plane.
                    let of_cutter = of_cutter(tool, now, axis, Known::default(), direction.last);
                    return direction.with_rest(of_cutter);
                }
                let Some(voxel) = blocker else { break };
                (met[count], count) = (voxel, count + 1);
                let depth = depth(voxel);
                if depth > deepest {
                    (deepest, *direction.last) = (depth, Some(voxel));
                }
                if stays(depth) {
                    break;
                }
            }
            let step = blocker.and_then(|voxel| tool.cutter.lateral_separation_from(now, axis, voxel));
            let Some(step) = step else { break };
            now += step;
            if !tool.touching.contains(now, axis, sample) {
                now -= 0.5 * self.tool.tolerance * self.sample.normal;
            }
            if now.distance(tip) > most {
                break;
            }
        }
        Outcome::Gouged
    }

    /// One contact pose.
    pub(super) fn at(
        &self,
        tool: &Revolved,
        tip: DVec3,
        direction: &mut DirectionQuery<'_, impl FnMut(DVec3) -> bool>,
    ) -> Outcome {
        let of_cutter = self.cutter_at(tool, tip, direction.turn.axis, direction.last);
        direction.with_rest(of_cutter)
    }

    /// One contact pose, for all but shank and holder: good where they decide.
    pub(super) fn cutter_at(&self, tool: &Revolved, tip: DVec3, axis: DVec3, last: &mut Last) -> Outcome {
        let among = |voxel: &[f64; 3]| tool.cutter.contains(tip, axis, *voxel);
        // What lies in the plane is looked for anew: whether it counts must not depend on who met it.
        let counts = |p: &[f64; 3]| {
            self.stays_in.is_none_or(|space| space.normal.dot(DVec3::from_array(*p)) > space.offset)
        };
        let mut known_blocker = last.filter(counts);
        if known_blocker.as_ref().is_some_and(among) || self.listed.iter().any(among) {
            return Outcome::Gouged;
        }
        let known = Known { free_ball: self.free_ball.as_ref(), stays_in: self.stays_in.as_ref() };
        let outcome = of_cutter(tool, tip, axis, known, &mut known_blocker);
        *last = known_blocker.or(*last);
        outcome
    }
}

impl Revolved {
    /// Whether the part stands on the axis above the cutter, in the tool or in the spindle beyond it: no slimmer shank or holder would
    /// be free there.
    pub(super) fn axis_meets_part(&self, tip: DVec3, axis: DVec3) -> bool {
        let part = self.cutter.voxels().occupancy();
        let (grid, end) = (&part.grid, self.end.top());
        // Half a pitch each, as far as to the other end of the grid.
        let reach = tip.distance(grid.origin + 0.5 * grid.size()) + 0.5 * grid.size().length();
        let steps = (2.0 * (reach - end) / grid.pitch).ceil() as usize;
        (0..=steps).any(|step| {
            let place = tip + axis * (end + 0.5 * grid.pitch * step as f64);
            grid.index_at(grid.continuous(place)).is_some_and(|voxel| part.solid[voxel] == 1)
        })
    }

    /// The point of the part's surface that is deepest in the cutter; one that is deeper than `enough` where there is one.
    pub(super) fn deepest_surface_point(&self, tip: DVec3, axis: DVec3, enough: f64) -> Option<[f64; 3]> {
        let depth = |height: f64, away: f64| self.eroded.depth(height, away, true);
        self.cutter.deepest_surface_point(tip, axis, depth, enough)
    }
}

/// The cutter at a pose, among part and fixtures.
fn of_cutter(tool: &Revolved, tip: DVec3, axis: DVec3, known: Known<'_>, last: &mut Last) -> Outcome {
    if tool.cutter.meets(tip, axis, known, Some(last)) {
        return Outcome::Gouged;
    }
    let held = tool.held.as_ref().is_some_and(|held| held.meets(tip, axis, Known::default(), None));
    if held { Outcome::Obstructed(tip) } else { Outcome::Good(tip) }
}
