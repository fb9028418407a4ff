//! The motions of a toolpath: which tool makes each, and at how many poses it is looked at.

use super::{CheckError, CheckSettings};
use crate::pose::{Pose, StraightMotion};
use crate::tool::Tool;
use crate::toolpath::{Location, MoveKind, Toolpath};

/// More poses than this on one motion are a slip of units.
const MOST: f64 = 1e8;

/// Evenly spaced poses of one motion, its end included, its start left to the motion before.
pub(super) struct Motion {
    way: StraightMotion,
    /// Place among the tools that are given.
    pub(super) tool: usize,
    pub(super) count: u64,
    /// Farthest that any point of the tool moves from one pose to the next.
    pub(super) step: f64,
}

impl Motion {
    /// Every pose, and how far on the way it is.
    pub(super) fn poses(&self) -> impl Iterator<Item = (f64, Pose)> {
        (1..=self.count).map(|step| {
            let fraction = step as f64 / self.count as f64;
            (fraction, self.way.at(fraction))
        })
    }
}

/// The way to every location; to one that the path begins at, that pose alone.
pub(super) fn motions(
    toolpath: &Toolpath,
    tools: &[(Option<u32>, &Tool)],
    settings: &CheckSettings,
) -> Result<Vec<Motion>, CheckError> {
    let chosen = choose(toolpath, tools)?;
    let clearance = &settings.clearance;
    let room = clearance.holder.max(clearance.shank).max(clearance.cutter);
    let sizes: Vec<(f64, f64)> =
        tools.iter().map(|(_, tool)| (tool.reach() + room, tool.rolling_radius())).collect();
    let locations = &toolpath.locations;
    let motion = |index: usize| {
        let to = &locations[index];
        let from = if to.kind == MoveKind::Start || index == 0 { to } else { &locations[index - 1] };
        let (reach, radius) = sizes[chosen[index]];
        let way = StraightMotion::new(&from.pose, &to.pose);
        let way = way.ok_or(CheckError::Opposite { line: to.line })?;
        if radius > 0.0 && !to.rolled {
            return Err(CheckError::NoRoll { line: to.line, tool: tools[chosen[index]].1.name.clone() });
        }
        if radius > 0.0 && way.rolls_over() {
            return Err(CheckError::RollsOver { line: to.line });
        }
        let (farthest, tolerance) = (way.farthest(reach, radius), settings.tolerance);
        let poses = (farthest / tolerance - 1e-9).ceil().max(1.0);
        if poses > MOST {
            return Err(CheckError::TooLong { line: to.line, poses, tolerance });
        }
        Ok(Motion { way, tool: chosen[index], count: poses as u64, step: farthest / poses })
    };
    (0..locations.len()).map(motion).collect()
}

/// The tool of every location, by its place among those that are given.
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
    let place = |location: &Location| -> Result<usize, CheckError> {
        let (line, number) = (location.line, location.tool);
        if numbers == [None] {
            let from = toolpath.locations[0].tool;
            return if number == from {
                Ok(0)
            } else {
                Err(CheckError::ToolChange { line, from, to: number })
            };
        }
        let found = number.and_then(|number| numbers.iter().position(|own| *own == Some(number)));
        found.ok_or_else(|| {
            let given: Vec<String> = numbers.iter().flatten().map(u32::to_string).collect();
            CheckError::NoTool { line, number, given: given.join(", ") }
        })
    };
    toolpath.locations.iter().map(place).collect()
}
