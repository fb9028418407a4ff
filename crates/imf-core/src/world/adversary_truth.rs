//! Where an adversary's tool collides in truth: by the predicate that defines it, tried at every solid centre that may come into it.
//! And how many answers of a checker are wrong by that.

use glam::DVec3;

use super::*;
use crate::field::Decision;
use crate::grid::Grid;
use crate::tool::{SLACK, Segment, ToolShape, contains, snapped};

/// Solid centres of one obstacle, and the tool that must stay out of them.
pub(super) struct Solid {
    /// Which obstacle of the checker.
    pub(super) placed: usize,
    pub(super) grid: Grid,
    pub(super) profile: Vec<Segment>,
    /// In continuous voxel coordinates.
    pub(super) centres: Vec<DVec3>,
}

impl Solid {
    /// A centre in the tool at a pose in the obstacle's frame.
    fn held(&self, local: &Pose, centres: &[DVec3]) -> Option<DVec3> {
        let (axis, tip, pitch) = (local.axis()?, snapped(&self.grid, local.position), self.grid.pitch);
        let inside = |centre: DVec3| contains(&self.profile, axis, (centre - tip) * pitch, pitch);
        centres.iter().copied().find(|&centre| inside(centre))
    }

    /// Centres that may come into the tool where no point of it moves farther than `room`.
    fn near(&self, local: &Pose, room: f64) -> Vec<DVec3> {
        let axis = local.axis().unwrap();
        let tip = self.grid.continuous(local.position);
        let spans: Vec<_> = self.profile.iter().map(|s| (s.range(), s.max_radius() + room)).collect();
        let near = |centre: &&DVec3| {
            let offset = (**centre - tip) * self.grid.pitch;
            let height = offset.dot(axis);
            let away = (offset - axis * height).length();
            let beside = |&((from, to), radius): &((f64, f64), f64)| {
                from - room <= height && height <= to + room && away <= radius
            };
            spans.iter().any(beside)
        };
        self.centres.iter().filter(near).copied().collect()
    }
}

/// From a point outside a body of revolution, by its height and radius: the minimum over the heights of the distance
/// from the disc there, which is convex, as outlines bulge.
fn to_segment(segment: &Segment, height: f64, radius: f64) -> f64 {
    let to_disc = |at: f64| (height - at).hypot((radius - segment.radius(at)).max(0.0));
    let (mut low, mut high) = segment.range();
    for _ in 0..90 {
        let [a, b] = [low + (high - low) / 3.0, high - (high - low) / 3.0];
        if to_disc(a) < to_disc(b) { high = b } else { low = a }
    }
    to_disc(low).min(to_disc(high))
}

/// A checker with all that its tool must stay out of.
pub(super) struct Case {
    pub(super) name: String,
    pub(super) checker: Checker,
    pub(super) solids: Vec<Solid>,
    /// The finest.
    pub(super) pitch: f64,
}

impl Case {
    pub(super) fn new(name: String, checker: Checker) -> Self {
        let solids = checker.placed.iter().enumerate().flat_map(|(placed, one)| {
            one.around.field.solids_with_tools().map(move |(solid, tool)| {
                let ToolShape::Revolved(elements) = &tool.shape else { unreachable!() };
                let occupancy = solid.voxels().occupancy();
                let grid = occupancy.grid;
                let centre = |index| DVec3::from_array(grid.voxel(index).map(|v| v as f64));
                let profile = elements.iter().flat_map(|element| element.profile.clone()).collect();
                Solid { placed, grid, profile, centres: occupancy.solids().map(centre).collect() }
            })
        });
        let solids = solids.collect();
        Self { name, pitch: checker.finest_pitch().unwrap(), solids, checker }
    }

    pub(super) fn local(&self, solid: &Solid, pose: &Pose) -> Pose {
        self.checker.placed[solid.placed].local(pose)
    }

    /// Farthest that a point of the tool moves from one pose to another, a little generous.
    pub(super) fn between(&self, a: &Pose, b: &Pose) -> f64 {
        let turn = a.axis().unwrap().distance(b.axis().unwrap());
        a.position.distance(b.position) + 1.6 * turn * self.checker.tool.reach
    }

    pub(super) fn near(&self, pose: &Pose, room: f64) -> Vec<Vec<DVec3>> {
        self.solids.iter().map(|solid| solid.near(&self.local(solid, pose), room)).collect()
    }

    /// A centre of those in the tool, in the world.
    pub(super) fn held(&self, near: &[Vec<DVec3>], pose: &Pose) -> Option<DVec3> {
        self.solids.iter().zip(near).find_map(|(solid, near)| {
            let centre = solid.held(&self.local(solid, pose), near)?;
            let centre = solid.grid.origin + (centre + 0.5) * solid.grid.pitch;
            Some(self.checker.placed[solid.placed].at.of_point(centre))
        })
    }

    /// From a free tool to the nearest of some centres.
    fn distance(&self, near: &[Vec<DVec3>], pose: &Pose) -> f64 {
        let mut least = f64::INFINITY;
        for (solid, near) in self.solids.iter().zip(near) {
            let local = self.local(solid, pose);
            let (axis, tip) = (local.axis().unwrap(), solid.grid.continuous(local.position));
            for &centre in near {
                let offset = (centre - tip) * solid.grid.pitch;
                let height = offset.dot(axis);
                let radius = (offset - axis * height).length();
                for segment in &solid.profile {
                    let (from, to) = segment.range();
                    let past = (from - height).max(height - to).max(0.0);
                    if past.hypot((radius - segment.max_radius()).max(0.0)) < least {
                        least = least.min(to_segment(segment, height, radius));
                    }
                }
            }
        }
        least
    }

    /// What rounding may do to a length.
    fn rounding(&self, pose: &Pose) -> f64 {
        1e-9 * (self.checker.tool.reach + pose.position.abs().max_element())
    }

    /// Whether a free tool is as far away as that; some centres beyond `room` may be missing among those near it.
    pub(super) fn is_distance(&self, near: &[Vec<DVec3>], pose: &Pose, found: &Distance, room: f64) -> bool {
        let (truth, rounding) = (self.distance(near, pose), self.rounding(pose));
        let witness = found.tool_point.distance(found.obstacle_point);
        found.lower == found.upper
            && (witness - found.lower).abs() <= rounding
            && if truth < room { (found.lower - truth).abs() <= rounding } else { found.lower >= room }
    }

    /// Whether a colliding tool may be as deep as that: no translation to one of several free poses is shorter.
    pub(super) fn is_depth<'a>(
        &self,
        pose: &Pose,
        found: &Distance,
        free: impl Iterator<Item = &'a Pose>,
    ) -> bool {
        let mut beside = free.filter(|free| free.rotation == pose.rotation);
        let far = |free: &Pose| free.position.distance(pose.position) >= -found.upper - self.rounding(pose);
        found.lower <= found.upper && found.upper <= 0.0 && beside.all(far)
    }

    /// True where a centre lies in the tool to within the predicate's rounding: there the predicate may hold one
    /// centre and not the next on the same line, and a free pose may be called colliding.
    pub(super) fn rounds(&self, pose: &Pose) -> bool {
        self.solids.iter().any(|solid| {
            let local = self.local(solid, pose);
            let (axis, tip) = (local.axis().unwrap(), snapped(&solid.grid, local.position));
            let (pitch, reach) = (solid.grid.pitch, self.checker.tool.reach);
            // With so much slack across the axis.
            let wide = pitch.hypot((2e-15 / SLACK).sqrt() * reach);
            solid.centres.iter().any(|&centre| {
                let aside = [0.0, 4e-15 * reach, -4e-15 * reach].map(|by| (centre - tip) * pitch + axis * by);
                aside.into_iter().any(|offset| contains(&solid.profile, axis, offset, wide))
            })
        })
    }

    /// True where any centre of all is in the tool, by the visits of the library's own definition.
    pub(super) fn visited(&self, pose: &Pose) -> bool {
        self.checker.placed.iter().any(|one| {
            one.around.field.solids_with_tools().any(|(solid, tool)| {
                let ToolShape::Revolved(elements) = &tool.shape else { unreachable!() };
                let mut any = false;
                for element in elements {
                    element.visit_inside(solid.voxels().occupancy(), &one.local(pose), |_, _, _| any = true);
                }
                any
            })
        })
    }
}

/// Number of queries, and the wrong results.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) contacts: usize,
    pub(super) colliding: usize,
    pub(super) free: usize,
    pub(super) motions: usize,
    /// Motions of which a beginning is proven free.
    pub(super) proven: usize,
    /// Distances of free tools and depths of colliding ones.
    pub(super) distances: [usize; 2],
    pub(super) wrong: Vec<String>,
}

impl Tally {
    /// Of each case the first that is wrong, and how many there are.
    pub(super) fn wrong(&self) -> String {
        let mut cases: std::collections::BTreeMap<&str, (usize, &str)> = Default::default();
        for wrong in &self.wrong {
            let (case, _) = wrong.split_once(" Pose").unwrap();
            cases.entry(case).or_insert((0, wrong)).0 += 1;
        }
        let lines = cases.values().map(|(count, first)| format!("{count} times as {first}\n"));
        format!("{} of {} poses\n{}", self.wrong.len(), self.colliding + self.free, lines.collect::<String>())
    }

    pub(super) fn and(mut self, other: Self) -> Self {
        self.contacts += other.contacts;
        self.colliding += other.colliding;
        self.free += other.free;
        self.motions += other.motions;
        self.proven += other.proven;
        (0..2).for_each(|i| self.distances[i] += other.distances[i]);
        self.wrong.extend(other.wrong);
        self
    }
}

/// Poses, and the truth of each.
#[derive(Default)]
pub(super) struct PoseCases {
    pub(super) poses: Vec<Pose>,
    pub(super) collides: Vec<bool>,
}

impl PoseCases {
    pub(super) fn push(&mut self, pose: Pose, collides: bool) {
        self.poses.push(pose);
        self.collides.push(collides);
    }

    /// One by one, and all together.
    pub(super) fn answers(&self, case: &Case, tally: &mut Tally) {
        let mut decisions = vec![Decision::Undecided; self.poses.len()];
        case.checker.classify(&self.poses, &mut decisions).unwrap();
        for ((pose, &collides), decision) in self.poses.iter().zip(&self.collides).zip(decisions) {
            let alone = Decision::of(!case.checker.is_free(pose));
            let is_true = alone == Decision::of(collides) || (!collides && case.rounds(pose));
            if alone != decision || !is_true {
                let answers = format!("one by one {alone:?}, together {decision:?}, collides {collides}");
                tally.wrong.push(format!("{} {pose:?}: {answers}", case.name));
            }
            tally.colliding += usize::from(collides);
            tally.free += usize::from(!collides);
        }
    }
}
