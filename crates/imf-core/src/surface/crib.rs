//! What each tool of a crib reaches, all decided together.
//!
//! Tools with the same cutter share its contact poses: each is found once, and shank and holder of every such tool
//! are tested there, the smaller ones first: a tool that contains a colliding one collides too. One direction from
//! which a tool reaches a sample is enough, and the last successful one is tried first. Cutters are tested at each
//! sample from thin to thick: what one of them gouges from a direction is tested first for the next, which mostly
//! gouges it as well. The verdicts are those of [`surface_access`](super::surface_access), tool by tool.

use super::level_ring::RingPlaces;
use super::places::map_alike;
use super::sample_query::{DirectionQuery, Last, SampleQuery};
use super::{Revolved, SurfaceError, SurfaceSample, SurfaceTool, ToolDirection, Verdict};
use crate::control::Control;
use crate::field::solid::OutsidePlane;
use crate::orientation::Orientation;
use crate::tool::Tool;

/// Samples that one thread takes at once.
const CHUNK: usize = 32;
/// Maximum number of solid centres around a sample that all cutters share; where there are more each searches for
/// itself.
const MOST_AROUND: u32 = 256;

/// By tool and sample, what becomes of it over all directions, on all threads of the current pool; the result does not depend on
/// their number. The tools are among the same surroundings. One unit of progress is one sample.
///
/// # Errors
/// [`SurfaceError::Cancelled`] when the control asks to stop.
pub fn crib_access(
    tools: &[SurfaceTool],
    samples: &[SurfaceSample],
    directions: &[Orientation],
    control: Control<'_>,
) -> Result<Vec<Vec<Verdict>>, SurfaceError> {
    let turns: Vec<ToolDirection> = directions.iter().map(ToolDirection::new).collect();
    let groups: Vec<Group<'_>> =
        same_cutters(tools).into_iter().map(|group| Group::new(tools, group)).collect();
    let work = || Work::new(&groups, &turns);
    let rows = map_alike(samples, SurfaceSample::is_tried_with, (CHUNK, control), work, |work, sample| {
        work.verdicts(sample, tools.len())
    })?;
    Ok((0..tools.len()).map(|tool| rows.iter().map(|row| row[tool]).collect()).collect())
}

/// Tools that touch a surface at the same poses, by index, those of the thinner cutters first; a mesh tool is alone.
fn same_cutters(tools: &[SurfaceTool]) -> Vec<Vec<usize>> {
    let same_cutter = |(a, b): (&Revolved, &Revolved)| {
        (&a.end, &a.outline, a.plunge_only) == (&b.end, &b.outline, b.plunge_only)
    };
    let same = |a: &SurfaceTool, b: &SurfaceTool| {
        a.tolerance == b.tolerance && a.revolved().zip(b.revolved()).is_some_and(same_cutter)
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, tool) in tools.iter().enumerate() {
        match groups.iter_mut().find(|group| same(&tools[group[0]], tool)) {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    let radius = |group: &Vec<usize>| tools[group[0]].revolved().map_or(f64::INFINITY, |tool| tool.radius);
    groups.sort_by(|a, b| radius(a).total_cmp(&radius(b)));
    groups
}

/// Tools of one cutter.
struct Group<'a> {
    /// Their places among all.
    tools: Vec<usize>,
    members: Vec<&'a SurfaceTool>,
    /// The members, those of the smaller shanks and holders first.
    order: Vec<usize>,
    /// By member: those whose shank and holder lie within its own.
    inner: Vec<Vec<usize>>,
}

impl<'a> Group<'a> {
    fn new(all: &'a [SurfaceTool], tools: Vec<usize>) -> Self {
        let members: Vec<&SurfaceTool> = tools.iter().map(|&tool| &all[tool]).collect();
        let above = |tool: usize| members[tool].revolved().and_then(|revolved| revolved.above.as_ref());
        let volumes: Vec<f64> =
            (0..members.len()).map(|tool| above(tool).map_or(0.0, Tool::volume)).collect();
        let mut order: Vec<usize> = (0..members.len()).collect();
        order.sort_by(|&a, &b| volumes[a].total_cmp(&volumes[b]).then(a.cmp(&b)));
        let mut inner = vec![Vec::new(); members.len()];
        for (place, &outer) in order.iter().enumerate() {
            let Some(whole) = above(outer) else { continue };
            let smaller = order[..place].iter().copied();
            inner[outer] =
                smaller.filter(|&tool| above(tool).is_some_and(|part| whole.holds_all_of(part))).collect();
        }
        Self { tools, members, order, inner }
    }
}

/// All tools, and what neighbouring samples, and cutters at one sample, pass on to each other.
struct Work<'a> {
    groups: &'a [Group<'a>],
    turns: &'a [ToolDirection],
    /// By direction.
    at_cutter: Vec<Last>,
    /// By group.
    above: Vec<AboveCutter>,
    /// Directions that may face a sample.
    facing: Vec<usize>,
    /// The largest ball around a sample that any cutter needs, and a tool that does.
    farthest: Option<(f64, &'a SurfaceTool)>,
    /// A sine of a surface's inward normal above which no tool touches.
    highest: f64,
}

/// State of the tools of one cutter.
struct AboveCutter {
    /// By tool.
    at_rest: Vec<Last>,
    /// Number of poses, and by tool the last one at which it collided.
    poses: u64,
    collided: Vec<u64>,
    /// The direction from which a sample was reached last.
    served: usize,
}

impl<'a> Work<'a> {
    fn new(groups: &'a [Group<'a>], turns: &'a [ToolDirection]) -> Self {
        let above = groups.iter().map(|group| {
            let count = group.members.len();
            AboveCutter { at_rest: vec![None; count], poses: 0, collided: vec![0; count], served: 0 }
        });
        let highest = groups.iter().map(|group| group.members[0].revolved().map_or(1.0, |tool| tool.highest));
        let above = above.collect();
        let tools = groups.iter().map(|group| group.members[0]);
        let asked = tools.filter_map(|tool| Some((tool.asks_around()?, tool)));
        let farthest = asked.max_by(|a, b| a.0.total_cmp(&b.0));
        Self {
            groups,
            turns,
            at_cutter: vec![None; turns.len()],
            above,
            facing: Vec::new(),
            farthest,
            highest: highest.fold(-1.0, f64::max),
        }
    }

    /// By tool.
    fn verdicts(&mut self, sample: &SurfaceSample, tools: usize) -> Vec<Verdict> {
        let mut verdicts = vec![Verdict::NotFaced; tools];
        self.facing.clear();
        let faces = |turn: &ToolDirection| -sample.normal.dot(turn.axis) <= self.highest;
        self.facing.extend((0..self.turns.len()).filter(|&turn| faces(&self.turns[turn])));
        let mut served = None;
        let around = self.farthest.and_then(|(radius, tool)| tool.around(sample, radius, MOST_AROUND));
        for (at, group) in self.groups.iter().enumerate() {
            let own = self.of_group(at, sample, around.as_ref(), &mut served);
            group.tools.iter().zip(own).for_each(|(&tool, verdict)| verdicts[tool] = verdict);
        }
        verdicts
    }

    /// Of the tools of one cutter. `served` is a direction from which the sample was reached.
    fn of_group(
        &mut self,
        at: usize,
        sample: &SurfaceSample,
        around: Option<&OutsidePlane>,
        served: &mut Option<usize>,
    ) -> Vec<Verdict> {
        let Group { members, order, inner, .. } = &self.groups[at];
        let AboveCutter { at_rest, poses, collided, served: before } = &mut self.above[at];
        let mut verdicts = vec![Verdict::NotFaced; members.len()];
        let mut open = order.clone();
        let query = SampleQuery::new(members[0], sample, around);
        let first = [*served, Some(*before)];
        let rest = self.facing.iter().copied().filter(|turn| !first.contains(&Some(*turn)));
        let [known, before_here] = first;
        let first = known.into_iter().chain(before_here.filter(|_| known != before_here));
        for index in first.chain(rest).filter(|&turn| turn < self.turns.len()) {
            let (turn, last) = (&self.turns[index], &mut self.at_cutter[index]);
            let left = open.len();
            let rings = &mut RingPlaces::default();
            if query.has_ring(turn) {
                // Each steps away from what it hits itself.
                open.retain(|&tool| {
                    let is_free = |tip| {
                        members[tool].is_rest_free(tip, turn.axis, &mut at_rest[tool])
                            && members[tool].is_brought(tip, turn.axis)
                    };
                    let rest = members[tool].rest();
                    let outcome = query.best_pose(DirectionQuery { turn, last, rest, is_free, rings });
                    verdicts[tool] = verdicts[tool].min(outcome.verdict());
                    verdicts[tool] != Verdict::Reached
                });
            } else {
                let is_free = |tip| {
                    *poses += 1;
                    open.retain(|&tool| {
                        let blocked = inner[tool].iter().any(|&inner| collided[inner] == *poses)
                            || !members[tool].is_rest_free(tip, turn.axis, &mut at_rest[tool]);
                        if blocked {
                            collided[tool] = *poses;
                            return true;
                        }
                        let brought = members[tool].is_brought(tip, turn.axis);
                        if brought {
                            verdicts[tool] = Verdict::Reached;
                        }
                        !brought
                    });
                    open.is_empty()
                };
                let outcome = query.best_pose(DirectionQuery { turn, last, rest: None, is_free, rings });
                // What is still open went as the cutter did.
                for &tool in &open {
                    verdicts[tool] = verdicts[tool].min(outcome.verdict());
                }
            }
            if open.len() < left {
                (*before, *served) = (index, Some(index));
            }
            if open.is_empty() {
                break;
            }
        }
        verdicts
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec2;

    use super::*;
    use crate::grid::Grid;
    use crate::occupancy::Occupancy;
    use crate::parts::shell::{pocketed, rounded_rectangle};
    use crate::section::test_shapes::{orientations, revolved};
    use crate::surface::CollisionEnvironment;
    use crate::surface::closed_forms::Part;
    use crate::tool::{ElementKind, Segment};

    fn crib() -> Vec<Tool> {
        let cutters = [
            vec![Segment::cylinder(0.0, 8.0, 2.0)],
            vec![Segment::ball_end(2.0), Segment::cylinder(2.0, 8.0, 2.0)],
            vec![Segment::cylinder(0.0, 8.0, 5.0)],
            // A slot cutter.
            vec![Segment::cylinder(0.0, 3.0, 4.0)],
        ];
        let mut tools = Vec::new();
        for (index, cutter) in cutters.iter().enumerate() {
            let end = cutter.last().unwrap().range().1;
            for (shank, face, holder) in
                [(1.9, 12.0, 8.0), (2.0, 12.0, 8.0), (2.0, 20.0, 8.0), (2.0, 30.0, 14.0), (2.0, 20.0, 5.0)]
            {
                let tool = revolved([
                    (ElementKind::Cutter, cutter.clone()),
                    (ElementKind::Shank, vec![Segment::cylinder(end, face, shank)]),
                    (ElementKind::Holder(0), vec![Segment::cylinder(face, face + 25.0, holder)]),
                ]);
                tools.push(Tool { back_cutting: index == 3, ..tool });
            }
        }
        // As the first, but that it cuts along its axis alone.
        tools.push(Tool { plunge_only: true, ..tools[0].clone() });
        tools
    }

    #[test]
    fn verdicts_are_those_of_each_tool_alone() {
        let pocket = rounded_rectangle(DVec2::new(7.0, 4.0), DVec2::new(21.0, 20.0), 3.0, 8);
        let mesh = pocketed(glam::DVec3::new(40.0, 24.0, 22.0), &pocket, 16.0);
        let grid =
            Grid::with_pitch(glam::DVec3::splat(-0.3), glam::DVec3::new(40.3, 24.3, 22.3), 1.0, 1).unwrap();
        let mut part = Part::on(&grid, &mesh, 700);
        let clamp = Occupancy::of(grid, |[x, y, z]| x < 4 && y < 8 && z > 20);
        let solid = Arc::new(part.environment.part().clone());
        part.environment = CollisionEnvironment::new(&solid.into(), &[Arc::new(clamp)]);
        let tools: Vec<SurfaceTool> = crib().iter().map(|tool| part.surface_tool(tool)).collect();
        // A slimmer shank is another shoulder of a slot cutter, and where the shank is as wide as the cutter there is none.
        let mut sizes: Vec<usize> = same_cutters(&tools).iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [1, 1, 1, 1, 4, 4, 4, 5]);
        let directions = orientations("axes+fibonacci:40");
        let together = crib_access(&tools, &part.samples, &directions, Control::quiet()).unwrap();
        let mut counts = [0; 4];
        for (tool, together) in tools.iter().zip(&together) {
            let alone = part.access(tool, &directions);
            for (index, (reach, together)) in alone.reach.iter().zip(together).enumerate() {
                assert_eq!(reach.verdict(), *together, "{index}");
                counts[*together as usize] += 1;
            }
        }
        // All but what no direction faces: there is none.
        assert!(counts[..3].iter().all(|&count| count > 100), "{counts:?}");
        // The same in another order.
        let backwards: Vec<_> = directions.iter().rev().copied().collect();
        assert_eq!(crib_access(&tools, &part.samples, &backwards, Control::quiet()).unwrap(), together);
    }
}
