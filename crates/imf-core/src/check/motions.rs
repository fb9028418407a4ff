//! The motions of a toolpath: which tool makes each, and at how many poses it is sampled.

use glam::{DMat4, DVec3};

use super::{CheckError, CheckSettings, Collision, LineFault};
use crate::machine::{Machine, MachineMotion};
use crate::occupancy::Occupancy;
use crate::pose::{Pose, StraightMotion};
use crate::tool::{Element, Segment, Tool};
use crate::toolpath::{CutterStatement, Location, MoveKind, Toolpath};
use crate::unit::DisplayLength;

/// More poses than this on one motion are a slip of units.
const MAX_POSES: f64 = 1e8;
/// Maximum number of poses within a step.
const MAX_BETWEEN: f64 = 100.0;

/// One of the poses of a motion.
pub(super) struct Step {
    /// From 1.
    pub(super) index: u64,
    pub(super) fraction: f64,
    pub(super) is_last: bool,
    /// Farthest that anything moves from one to the next.
    pub(super) length: f64,
}

/// How the tool gets from one location to the next.
enum Way<'a> {
    Straight(StraightMotion),
    /// By a machine's axes, and where the part's frame is in the world.
    Machine(MachineMotion<'a>, Pose),
}

/// Evenly spaced poses of one motion, its end included, its start left to the motion before.
pub(super) struct Motion<'a> {
    way: Way<'a>,
    /// Place among the tools that are given.
    pub(super) tool: usize,
    pub(super) count: u64,
    /// Farthest that any point of the tool moves from one pose to the next.
    pub(super) step: f64,
}

impl Motion<'_> {
    /// Every pose.
    pub(super) fn poses(&self) -> impl Iterator<Item = (Step, Pose)> {
        (1..=self.count).map(|index| {
            let fraction = index as f64 / self.count as f64;
            let step = Step { index, fraction, is_last: index == self.count, length: self.step };
            (step, self.at(fraction))
        })
    }

    /// The poses between the one before a step's and its own, so many that none is farther than `longest` from the next along the tool.
    pub(super) fn poses_between(&self, step: &Step, longest: f64) -> impl Iterator<Item = Pose> {
        let place = |part: f64| self.at((step.index as f64 - 1.0 + part) / self.count as f64);
        let mut along = 0.0;
        if self.step > longest
            && let (before, after) = (place(0.0), place(1.0))
            && let Some(axis) = after.axis()
        {
            along = (after.position - before.position).dot(axis).abs();
        }
        let count = (along / longest - 1e-9).ceil().clamp(1.0, MAX_BETWEEN);
        (1..count as u32).map(move |part| place(f64::from(part) / count))
    }

    /// The tool in the world.
    pub(super) fn at(&self, fraction: f64) -> Pose {
        match &self.way {
            Way::Straight(way) => way.at(fraction),
            Way::Machine(way, set_up) => set_up.of_pose(&way.pose(fraction)),
        }
    }

    /// A collision of what moves with the head, reported with the current tool.
    pub(super) fn with_tool(&self, mut hit: Collision) -> Collision {
        let pose = self.at(hit.fraction);
        hit.position = pose.position.to_array();
        hit.axis = pose.axis().unwrap_or(DVec3::NAN).to_array();
        hit.roll = hit.roll.map(|_| pose.orientation().roll);
        hit
    }

    /// A collision found at some of `count` poses, which may be spaced otherwise than the motion's: rescaled to the
    /// motion's poses.
    pub(super) fn with_poses(&self, hit: Collision, count: u64) -> Collision {
        let poses = (hit.poses as f64 * self.count as f64 / count as f64).round().max(1.0) as u64;
        Collision { poses, ..hit }
    }

    /// Says where the machine's axes stand when these happen.
    pub(super) fn with_joints(&self, hits: &mut [Collision]) {
        if let Some(way) = self.by_machine() {
            hits.iter_mut().for_each(|hit| hit.joints = Some(way.joints(hit.fraction)));
        }
    }

    /// Of a path for a machine.
    pub(super) fn by_machine(&self) -> Option<&MachineMotion<'_>> {
        match &self.way {
            Way::Straight(_) => None,
            Way::Machine(way, _) => Some(way),
        }
    }
}

/// A rigid motion as a pose, what it scales by left out.
pub(super) fn rigid(motion: &DMat4) -> Pose {
    let (_, rotation, _) = motion.to_scale_rotation_translation();
    Pose::new(motion.transform_point3(DVec3::ZERO), rotation)
}

/// Number of poses such that nothing moves farther than the step from one to the next.
pub(super) fn poses_needed(farthest: f64, step: f64) -> Result<u64, LineFault> {
    let poses = (farthest / step - 1e-9).ceil().max(1.0);
    if poses <= MAX_POSES { Ok(poses as u64) } else { Err(LineFault::TooLong { poses, step }) }
}

/// Visits the poses of a motion in order, numbered from 1, and skips those that an earlier one decides: `look` checks
/// a pose and returns how far everything may move from it before anything can be found, 0 or less where that is
/// unknown.
pub(super) fn look_at_poses(count: u64, farthest: f64, mut look: impl FnMut(u64, f64) -> f64) {
    let step = farthest / count as f64;
    let mut index = 1;
    while index <= count {
        let room = look(index, index as f64 / count as f64);
        let known = if room > 0.0 { (room / step) as u64 } else { 0 };
        index = index.saturating_add(1).saturating_add(known);
    }
}

/// A round body about the tool's axis that holds an element with its clearance.
struct Round {
    heights: [f64; 2],
    radius: f64,
}

impl Round {
    /// Of every element; none of a mesh.
    fn of(tool: &Tool, room: f64) -> Vec<Self> {
        let of = |element: &Element| {
            let ranges = element.profile.iter().map(Segment::range);
            let (low, high) = ranges.reduce(|(low, high), (from, to)| (low.min(from), high.max(to)))?;
            Some(Self { heights: [low - room, high + room], radius: element.max_radius() + room })
        };
        tool.elements().iter().filter_map(of).collect()
    }
}

/// The way to every location; to one that the path begins at, that pose alone. Of a path for a machine the ways are the machine's.
pub(super) fn motions<'a>(
    toolpath: &Toolpath,
    tools: &[(Option<u32>, &Tool)],
    settings: &CheckSettings,
    machine: Option<&'a Machine>,
) -> Result<Vec<Motion<'a>>, CheckError> {
    if let Some((_, tool)) = tools.iter().find(|(_, tool)| tool.unit != toolpath.unit) {
        let (unit, path) = (tool.unit, toolpath.unit);
        return Err(CheckError::Unit { tool: tool.name.clone(), unit, path });
    }
    let chosen = choose(toolpath, tools)?;
    for statement in &toolpath.cutters {
        let own = tools.iter().find(|(number, _)| number.is_none() || *number == statement.tool);
        if let Some((_, tool)) = own {
            same_cutter(statement, tool).map_err(|fault| fault.on_line(statement.line))?;
        }
    }
    for (_, (_, tool)) in tools.iter().enumerate().filter(|(index, _)| chosen.contains(index)) {
        let ((element, thickness), step) = (tool.thinnest(), settings.step);
        if step > thickness {
            return Err(CheckError::Step { tool: tool.name.clone(), element, thickness, step });
        }
    }
    let clearance = &settings.clearance;
    let room = clearance.holder.max(clearance.shank).max(clearance.cutter);
    let sizes: Vec<(f64, f64)> =
        tools.iter().map(|(_, tool)| (tool.reach() + room, tool.rolling_radius())).collect();
    let rounds: Vec<Vec<Round>> = tools.iter().map(|(_, tool)| Round::of(tool, room)).collect();
    let locations = &toolpath.locations;
    let motion = |index: usize| {
        let to = &locations[index];
        let from = if to.kind == MoveKind::Start || index == 0 { to } else { &locations[index - 1] };
        let (reach, radius) = sizes[chosen[index]];
        if radius > 0.0 && !to.rolled {
            return Err(LineFault::NoRoll { tool: tools[chosen[index]].1.name.clone() });
        }
        let (way, farthest) = match (machine, from.machine, to.machine) {
            (Some(machine), Some(before), Some(after)) => {
                let straight = after.tip_goes_straight;
                let way = MachineMotion::new(machine, before.joints, after.joints, after.length, straight);
                let farthest = way.tool_motion_bound(reach);
                (Way::Machine(way, rigid(&toolpath.set_up)), farthest)
            }
            (None, None, None) => {
                let way = StraightMotion::new(&from.pose, &to.pose);
                let way = way.ok_or(LineFault::Opposite)?;
                if radius > 0.0 && way.rolls_over() {
                    return Err(LineFault::RollsOver);
                }
                let all = way.motion_bound(reach, radius);
                let of_round = |own: &Round| way.round_motion_bound(own.heights, own.radius);
                let farthest = rounds[chosen[index]].iter().map(of_round).reduce(f64::max);
                (Way::Straight(way), farthest.map_or(all, |farthest| farthest.min(all)))
            }
            _ => return Err(LineFault::Machine),
        };
        let count = poses_needed(farthest, settings.step)?;
        Ok(Motion { way, tool: chosen[index], count, step: farthest / count as f64 })
    };
    (0..locations.len())
        .map(|index| motion(index).map_err(|fault| fault.on_line(locations[index].line)))
        .collect()
}

/// Lengths of files have four digits behind the point, or come from inches.
const SAME: f64 = 1e-3;

/// A file's cutter and the one that is given must have one size; the corner of a taper is compared alone, since programs
/// measure its diameter at different heights. A mesh has neither.
fn same_cutter(statement: &CutterStatement, tool: &Tool) -> Result<(), LineFault> {
    let Some((diameter, corner)) = tool.cutter_size() else { return Ok(()) };
    let differ = |said: f64, own: f64| (said - own).abs() > SAME * own.abs().max(said.abs()).max(1e-9);
    let refuse =
        |what, said, given| Err(LineFault::OtherCutter { what, said, given, tool: tool.name.clone() });
    match (diameter, statement.corner_radius) {
        (Some(own), _) if differ(statement.diameter, own) => refuse("diameter", statement.diameter, own),
        (_, Some(said)) if differ(said, corner) => refuse("corner radius", said, corner),
        _ => Ok(()),
    }
}

/// What a path says of its cutters and is not held against the tools that are given, in words: the size of a mesh, the diameter of a
/// taper.
#[must_use]
pub fn cutters_not_compared(toolpath: &Toolpath, tools: &[(Option<u32>, &Tool)]) -> Vec<String> {
    let remark = |said: &CutterStatement| {
        let own = |(number, _): &&(Option<u32>, &Tool)| number.is_none() || *number == said.tool;
        let (_, tool) = tools.iter().find(own)?;
        let why = match tool.cutter_size() {
            None => "is a mesh, or has no cutter",
            Some((None, _)) => "tapers, and programs measure a taper at different heights",
            Some(_) => return None,
        };
        let CutterStatement { line, diameter, .. } = said;
        let name = &tool.name;
        Some(format!(
            "line {line}: a cutter with a diameter of {diameter} is not compared with '{name}', which {why}"
        ))
    };
    toolpath.cutters.iter().filter_map(remark).collect()
}

/// That nothing of a path comes within a tool's length of the part, in words: such a path is of another part, unit or frame.
#[must_use]
pub fn never_near(toolpath: &Toolpath, tools: &[(Option<u32>, &Tool)], part: &Occupancy) -> Option<String> {
    let (low, high) = part.extent()?;
    let part = [low, high].map(|voxel| part.grid.centre(voxel));
    let reach = tools.iter().map(|(_, tool)| tool.reach()).fold(0.0, f64::max);
    let tips = || toolpath.locations.iter().map(|location| location.pose.position);
    let path = [tips().reduce(DVec3::min)?, tips().reduce(DVec3::max)?];
    // Between two locations tips stay in the box of all.
    let unit = toolpath.unit;
    let apart = (part[0] - path[1]).max(path[0] - part[1]).max(DVec3::ZERO).length();
    (apart > reach).then(|| {
        format!(
            "the tips of the whole path stay {} {unit} away from the part, farther than any tool reaches ({} {unit}): check the path's \
             unit and the frame that it is in",
            DisplayLength(apart),
            DisplayLength(reach)
        )
    })
}

/// For every location the index of its tool in `tools`.
fn choose(toolpath: &Toolpath, tools: &[(Option<u32>, &Tool)]) -> Result<Vec<usize>, CheckError> {
    let numbers: Vec<Option<u32>> = tools.iter().map(|(number, _)| *number).collect();
    let wrong = match numbers.as_slice() {
        [] => Some("none"),
        [_] => None,
        several if several.contains(&None) => Some("several, some of them without a number"),
        several if (1..several.len()).any(|i| several[..i].contains(&several[i])) => {
            Some("several of one number")
        }
        _ => None,
    };
    if let Some(wrong) = wrong {
        return Err(CheckError::Tools(wrong.into()));
    }
    let place = |location: &Location| -> Result<usize, LineFault> {
        let number = location.tool;
        if numbers == [None] {
            let from = toolpath.locations[0].tool;
            return if number == from { Ok(0) } else { Err(LineFault::ToolChange { from, to: number }) };
        }
        let found = number.and_then(|number| numbers.iter().position(|own| *own == Some(number)));
        found.ok_or_else(|| {
            let given: Vec<String> = numbers.iter().flatten().map(u32::to_string).collect();
            LineFault::NoTool { number, given: given.join(", ") }
        })
    };
    toolpath.locations.iter().map(|own| place(own).map_err(|fault| fault.on_line(own.line))).collect()
}
