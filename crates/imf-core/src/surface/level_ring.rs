//! The search for the place on a level ring of a cutter at which it touches a sample: a flat end may stand anywhere over it.

use std::cmp::Ordering;
use std::f64::consts::TAU;
use std::ops::Range;

use glam::DVec3;

use super::Revolved;
use super::sample_query::{DirectionQuery, Outcome, SampleQuery};
use crate::field::solid::{Known, SolidField};
use crate::pose::Pose;

/// Start points around a level ring, how many of them are refined, steps of each refinement, and rounds in which each step
/// clears all that was met.
const STARTS: u32 = 8;
const TRIES: usize = 3;
const STEPS: usize = 16;
const ROUNDS: usize = 32;

/// The number of shank and holder among what is met.
const REST: usize = 2;

/// For each level ring with which a cutter touches from one direction, in order: the known outcomes at the starting
/// places of its search. Tools of one cutter share it.
#[derive(Default)]
pub(super) struct RingPlaces(Vec<Vec<RingPlace>>);

struct RingPlace {
    /// From where the ring's own middle touches.
    offset: DVec3,
    of_cutter: Option<Outcome>,
    /// What the cutter hits most.
    blocker: Option<Option<Blocker>>,
}

/// A solid centre, or a point of a surface, in the tool.
#[derive(Clone, Copy)]
struct Blocker {
    /// In the cutter among the part, in the cutter among the fixtures, or in shank and holder.
    solid: usize,
    voxel: [f64; 3],
    /// The step across the axis that separates the tool from it.
    step: DVec3,
}

impl Blocker {
    /// By length of their steps.
    fn order(&self, other: &Self) -> Ordering {
        self.step.length_squared().total_cmp(&other.step.length_squared())
    }
}

impl SampleQuery<'_> {
    /// The best pose at which a level ring of the cutter touches: `middle` is the tip with the ring's own middle on the sample.
    /// From a few starting places the tool steps away from all that it has hit so far, as far as the ring allows.
    pub(super) fn on_ring(
        &self,
        tool: &Revolved,
        middle: DVec3,
        ([inner, outer], ring): ([f64; 2], usize),
        direction: &mut DirectionQuery<'_, impl FnMut(DVec3) -> bool>,
    ) -> Outcome {
        let (turn, rest) = (direction.turn, direction.rest);
        let u = turn.axis.any_orthonormal_vector();
        if direction.rings.0.len() == ring {
            direction.rings.0.push(ring_places(u, turn.axis.cross(u), inner, outer));
        }
        let mut best = Outcome::NoContact;
        for place in 0..direction.rings.0[ring].len() {
            let start = &mut direction.rings.0[ring][place];
            let tip = middle + start.offset;
            let of_cutter = || self.cutter_at(tool, tip, turn.axis, direction.last);
            let of_cutter = *start.of_cutter.get_or_insert_with(of_cutter);
            best = best.or(direction.with_rest(of_cutter));
            if best.is_good() {
                return best;
            }
        }
        // Where shank and holder are in the way all around, the cutter alone tells whether it fits.
        for rest in [rest, None] {
            let (found, met_rest) = self.search_ring(tool, middle, ([inner, outer], ring), rest, direction);
            best = best.or(found);
            if !(met_rest && best == Outcome::Gouged) {
                break;
            }
        }
        best
    }

    /// The best place that is found from the starting places where none of them is good, and whether shank and holder were met.
    fn search_ring(
        &self,
        tool: &Revolved,
        middle: DVec3,
        ([inner, outer], ring): ([f64; 2], usize),
        rest: Option<&SolidField>,
        direction: &mut DirectionQuery<'_, impl FnMut(DVec3) -> bool>,
    ) -> (Outcome, bool) {
        let (turn, u) = (direction.turn, direction.turn.axis.any_orthonormal_vector());
        let mut best = Outcome::NoContact;
        let solids = [Some(&tool.cutter), tool.held.as_ref(), rest];
        let blocker = |of: Range<usize>, offset: DVec3| {
            let pose = Pose::new(middle + offset, turn.rotation);
            let centre = |solid: usize| {
                let (voxel, step) = solids[solid]?.lateral_separation(&pose)?;
                Some(Blocker { solid, voxel, step })
            };
            // The deepest point of a surface.
            let point = |solid: usize| {
                let of = solids[solid]?;
                let voxel = match solid {
                    0 => tool.deepest_surface_point(pose.position, turn.axis, f64::INFINITY),
                    _ => of.deepest_held_point(pose.position, turn.axis),
                }?;
                let step = of.lateral_separation_from(pose.position, turn.axis, voxel)?;
                Some(Blocker { solid, voxel, step })
            };
            // Of shank and holder, which may hold many, where they hold no centre.
            let both = |solid| match (centre(solid), solid) {
                (found @ Some(_), 1..) => [found, None],
                (found, _) => [found, point(solid)],
            };
            of.flat_map(both).flatten().max_by(Blocker::order)
        };
        let of_cutter = 0..REST;
        let mut met_rest = false;
        let mut starts: Vec<(DVec3, Blocker)> = Vec::new();
        for RingPlace { offset, blocker: known, .. } in &mut direction.rings.0[ring] {
            let own = *known.get_or_insert_with(|| blocker(of_cutter.clone(), *offset));
            let first = own.into_iter().chain(blocker(REST..REST + 1, *offset)).max_by(Blocker::order);
            starts.extend(first.map(|first| (*offset, first)));
        }
        // The least obstructed places.
        starts.sort_by(|(_, a), (_, b)| a.order(b));
        // The nearest place on the ring that is clear of all that was met, by stepping off the deepest of it again and again.
        let clear_of = |met: &[Blocker], mut offset: DVec3| {
            for _ in 0..ROUNDS {
                let tip = middle + offset;
                let steps = met.iter().filter_map(|&Blocker { solid, voxel, .. }| {
                    let solid = solids[solid].filter(|solid| solid.contains(tip, turn.axis, voxel))?;
                    solid.lateral_separation_from(tip, turn.axis, voxel)
                });
                let deepest = steps.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
                let Some(step) = deepest else { return Some(offset) };
                let next = offset + step;
                offset = next.normalize_or(u) * next.length().clamp(inner, outer);
            }
            None
        };
        // A centre that is not nearest to the axis, and yet in the tool.
        let any_blocker = |offset: DVec3| {
            let tip = middle + offset;
            (0..=REST).find_map(|solid| {
                let (of, mut found) = (solids[solid]?, None);
                of.meets(tip, turn.axis, Known::default(), Some(&mut found));
                let voxel = found?;
                Some(Blocker { solid, voxel, step: of.lateral_separation_from(tip, turn.axis, voxel)? })
            })
        };
        for &(start, first) in starts.iter().take(TRIES) {
            let (mut offset, mut met) = (start, vec![first]);
            met_rest |= first.solid == REST;
            for _ in 0..STEPS {
                let Some(next) = clear_of(&met, offset) else { break };
                offset = next;
                best = best.or(self.at(tool, middle + offset, direction));
                if best.is_good() {
                    return (best, met_rest);
                }
                let Some(next) = blocker(0..REST + 1, offset).or_else(|| any_blocker(offset)) else { break };
                met_rest |= next.solid == REST;
                met.push(next);
            }
        }
        (best, met_rest)
    }
}

/// Where the search on a ring between two radii begins.
fn ring_places(u: DVec3, v: DVec3, inner: f64, outer: f64) -> Vec<RingPlace> {
    let around = [0.5 * (inner + outer), outer].into_iter().flat_map(|radius| {
        (0..STARTS).map(move |start| {
            let (sine, cosine) = (f64::from(start) * TAU / f64::from(STARTS)).sin_cos();
            (u * cosine + v * sine) * radius
        })
    });
    let middle = (inner == 0.0).then_some(DVec3::ZERO);
    let place = |offset| RingPlace { offset, of_cutter: None, blocker: None };
    middle.into_iter().chain(around).map(place).collect()
}
