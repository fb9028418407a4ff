//! The minimum stick-out with which a tool's shank and holder are free on a whole path.
//!
//! The path is followed at poses as close together as for a check, and shank and holder are offset by half of what moves between
//! two of them, beside their clearance: what holds no voxel centre and no point of a surface then holds none at any time.

use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;

use super::motions::{Motion, motions};
use super::{CheckError, CheckSettings, LineFault};
use crate::control::Control;
use crate::machine::{Machine, Side};
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::parallel;
use crate::surface::{CollisionEnvironment, StickOutSearch, StickOutTool, default_tolerance};
use crate::tool::{Clearance, Tool};
use crate::toolpath::{Location, MoveKind, Toolpath};

/// The minimum stick-out of one tool over its part of a path, in the grid's unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PathStickOut {
    /// The tool's number, where the path knows it by one.
    pub tool: Option<u32>,
    /// Its name.
    pub name: String,
    /// What it is set to.
    pub given: f64,
    /// The minimum that it can be set to.
    pub shortest: f64,
    /// Its overall length, where it is known.
    pub longest: Option<f64>,
    /// The minimum with which shank and holder are free on all of the path; it may exceed the overall length. `None`
    /// where no length is.
    pub minimum: Option<f64>,
    /// Motions by the machine's own coordinates, G53 and G28, on which the tip moves with the tool's length: they
    /// were not checked.
    pub left_out: usize,
    /// Line of the toolpath's file that needs most, or on which no stick-out helps; `None` where the shortest serves.
    pub line: Option<usize>,
}

/// By how much farther out than needed poses are taken so closely, so that seldom all must be taken again.
const AHEAD: f64 = 1.25;

/// For each tool that the path uses the minimum stick-out with which shank and holder, with their clearance, are free
/// of `obstacle` on the whole path, also between the sampled poses, and of points of `surfaces`, the meshes of part and fixtures, but for
/// what a shank touches. The cutter is not checked, nor are a machine's head, table and travel. One unit of progress is one location.
///
/// # Errors
/// As of [`check_toolpath`](super::check_toolpath); a tool without a holder; a path on which the tip moves with the tool's length.
pub fn shortest_stick_outs(
    obstacle: &Arc<Occupancy>,
    surfaces: &[&Mesh],
    tools: &[(Option<u32>, &Tool)],
    toolpath: &Toolpath,
    settings: &CheckSettings,
    machine: Option<&Machine>,
    control: Control<'_>,
) -> Result<Vec<PathStickOut>, CheckError> {
    settings.check()?;
    // A control without tool centre point control adds the length to Z, and a tilted tool's tip moves aside with it.
    let moves = |location: &&Location| {
        location.machine.zip(machine).is_some_and(|(point, machine)| {
            let head = machine.placements(Side::Head, &point.joints.rotary)[2].rotation;
            !point.by_spindle && !point.tip_goes_straight && (head * DVec3::Z).distance(DVec3::Z) > 1e-9
        })
    };
    if let Some(location) = toolpath.locations.iter().find(moves) {
        return Err(LineFault::TipMoves.on_line(location.line));
    }
    let grid = obstacle.grid;
    let mut environment = CollisionEnvironment::new(&obstacle.clone().into(), &[]);
    if settings.contact > 0.0 {
        let mut all = Mesh::default();
        surfaces.iter().for_each(|mesh| all.append(mesh));
        environment = environment.with_surfaces(&[&all]);
    }
    let Clearance { holder, shank, cutter } = settings.clearance;
    let between = 0.5 * settings.step;
    let room = Clearance { holder: holder + between, shank: shank + between, cutter };
    let mut found = Vec::new();
    let used = motions(toolpath, tools, settings, machine)?;
    for (index, (number, tool)) in tools.iter().enumerate() {
        let of_tool = |motion: &usize| used[*motion].tool == index;
        let (left_out, own): (Vec<usize>, Vec<usize>) = (0..used.len())
            .filter(of_tool)
            .partition(|&motion| moves_with_length(&toolpath.locations, motion));
        if own.is_empty() && left_out.is_empty() {
            continue;
        }
        let touching = default_tolerance(grid.pitch, tool.unit);
        let touching = if settings.contact > 0.0 { touching.min(settings.contact) } else { touching };
        // What is added for what lies between two poses may lie in a wall that the shank touches.
        let contact = (&settings.clearance, touching + between);
        let prepared = StickOutTool::with_contact(&environment, &tool.offset(&room)?, touching, contact)?;
        let mut search = Search { tool: &prepared, length: prepared.shortest(), line: None };
        let lines = |motion: usize| toolpath.locations[motion].line;
        // A tool that sticks out farther moves farther between two poses.
        let mut followed = prepared.given().max(prepared.shortest());
        let minimum = loop {
            let bare = Tool { overall_length: None, ..Tool::clone(tool) };
            let long = bare.with_stick_out(followed).unwrap_or(bare);
            let tools: Vec<(Option<u32>, &Tool)> = tools
                .iter()
                .enumerate()
                .map(|(at, own)| (own.0, if at == index { &long } else { own.1 }))
                .collect();
            let all = motions(toolpath, &tools, settings, machine)?;
            let own: Vec<(usize, &Motion<'_>)> =
                own.iter().map(|&motion| (lines(motion), &all[motion])).collect();
            let minimum = search.over(&own, control)?;
            match minimum {
                Some(length) if length > followed => followed = AHEAD * length,
                minimum => break minimum,
            }
        };
        (control.progress)(own.len() as u64);
        found.push(PathStickOut {
            tool: *number,
            name: tool.name.clone(),
            given: prepared.given(),
            shortest: prepared.shortest(),
            longest: tool.overall_length,
            left_out: left_out.len(),
            minimum,
            line: search.line,
        });
    }
    Ok(found)
}

/// True for the motions to and from a location where the spindle's height does not depend on the tool's length.
fn moves_with_length(locations: &[Location], motion: usize) -> bool {
    let by_spindle = |at: usize| locations[at].machine.is_some_and(|point| point.by_spindle);
    let from = motion.checked_sub(1).filter(|_| locations[motion].kind != MoveKind::Start);
    by_spindle(motion) || from.is_some_and(by_spindle)
}

/// The minimum stick-out that is known to be needed, and the line that needs it.
struct Search<'a> {
    tool: &'a StickOutTool,
    length: f64,
    line: Option<usize>,
}

impl Search<'_> {
    /// The minimum that is free at every pose of some motions; `None` where there is none.
    fn over(
        &mut self,
        motions: &[(usize, &Motion<'_>)],
        control: Control<'_>,
    ) -> Result<Option<f64>, CheckError> {
        let mut raising = StickOutSearch::new(self.tool);
        loop {
            // A pose that was free may collide farther out: all are checked until none does.
            let length = self.length;
            let blocked = parallel::try_map(motions.len(), |at| {
                control.check()?;
                Ok::<_, CheckError>(
                    motions[at].1.poses().any(|(_, pose)| !self.tool.is_free_at(&pose, length)),
                )
            })?;
            if !blocked.contains(&true) {
                return Ok(Some(self.length));
            }
            for ((line, motion), _) in motions.iter().zip(blocked).filter(|(_, blocked)| *blocked) {
                for (_, pose) in motion.poses() {
                    let Some(length) = raising.from(self.length, &pose) else {
                        self.line = Some(*line);
                        return Ok(None);
                    };
                    if length > self.length {
                        (self.length, self.line) = (length, Some(*line));
                    }
                }
                control.check()?;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::grid::Grid;
    use crate::section::test_shapes::{line, revolved};
    use crate::tool::ElementKind;
    use crate::unit::LengthUnit;

    /// A wall of 12 × 40 that is 30 high, on a plate.
    fn wall() -> Arc<Occupancy> {
        let grid = Grid { origin: DVec3::new(-20.0, -20.0, -4.0), pitch: 1.0, dims: [60, 40, 36] };
        Arc::new(Occupancy::of(grid, |[x, _, z]| z < 4 || ((34..46).contains(&x) && z < 34)))
    }

    fn mill(overall_length: Option<f64>) -> Tool {
        let tool = revolved([
            (ElementKind::Cutter, vec![line(0.0, 10.0, 3.0, 3.0)]),
            (ElementKind::Shank, vec![line(10.0, 25.0, 3.0, 3.0)]),
            (ElementKind::Holder(0), vec![line(25.0, 60.0, 9.0, 9.0)]),
        ]);
        Tool { overall_length, ..tool }
    }

    fn found(text: &str, overall: Option<f64>, settings: &CheckSettings) -> PathStickOut {
        found_among(&[], text, overall, settings)
    }

    fn found_among(
        surfaces: &[&Mesh],
        text: &str,
        overall: Option<f64>,
        settings: &CheckSettings,
    ) -> PathStickOut {
        let path = Toolpath::parse(text, LengthUnit::Mm, "path").unwrap();
        let (wall, tool) = (wall(), mill(overall));
        let tools = [(None, &tool)];
        let found = shortest_stick_outs(&wall, surfaces, &tools, &path, settings, None, Control::quiet());
        found.unwrap().remove(0)
    }

    /// Free at all of many poses, each by trying every centre.
    fn is_free(text: &str, length: f64, clearance: &Clearance) -> bool {
        let path = Toolpath::parse(text, LengthUnit::Mm, "path").unwrap();
        let tool = mill(None);
        let close = CheckSettings { step: 0.05, ..CheckSettings::of_pitch(1.0, LengthUnit::Mm) };
        let set = tool.with_stick_out(length).unwrap();
        let rest = set.offset(clearance).unwrap().noncutting().unwrap().clone();
        let wall = wall();
        motions(&path, &[(None, &set)], &close, None).unwrap().iter().all(|motion| {
            let mut poses = motion.poses();
            poses.all(|(_, pose)| rest.count_inside(&wall, pose.position, &pose.orientation()) == 0)
        })
    }

    const ALONG: &str = "x,y,z\n-10,0,12\n9.6,0,12\n9.6,5,8.3\n0,5,20\n";
    const TILTED: &str = "x,y,z,i,j,k\n-8,0,3,0,0,1\n4,0,3,0.2,0.1,1\n9,-4,12,-0.1,0.3,1\n4,2,6,-0.5,0,1\n";

    #[test]
    fn it_is_free_at_many_more_poses_and_hardly_longer_than_needed() {
        let usual = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
        let clearance = Clearance { holder: 1.0, shank: 0.4, cutter: 0.0 };
        for (text, line) in [(ALONG, 4), (TILTED, 3)] {
            for settings in [usual, CheckSettings { clearance, ..usual }] {
                let found = found(text, None, &settings);
                let minimum = found.minimum.unwrap();
                assert!(
                    minimum > found.shortest + 3.0 && found.given == 25.0 && found.shortest == 10.0,
                    "{found:?}"
                );
                assert!(is_free(text, minimum, &settings.clearance), "{found:?}");
                assert!(!is_free(text, minimum - 1.0, &settings.clearance), "{found:?}");
                assert_eq!(found.line, Some(line), "{found:?}");
            }
        }
    }

    #[test]
    fn a_holder_stays_off_the_surface_between_the_centres() {
        let usual = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
        let plate = Mesh::cuboid(DVec3::new(-20.0, -20.0, -4.0), DVec3::new(40.0, 20.0, 0.0));
        let block = Mesh::cuboid(DVec3::new(14.0, -20.0, -4.0), DVec3::new(26.0, 20.0, 30.0));
        let by_centres = found(ALONG, None, &usual).minimum.unwrap();
        let minimum = found_among(&[&plate, &block], ALONG, None, &usual).minimum.unwrap();
        // A shank as wide as its cutter rubs along the wall with it.
        let along_the_wall = "x,y,z\n11,0,60\n11,0,5\n11,5,5\n11,5,60\n";
        let rubbing = found_among(&[&plate, &block], along_the_wall, None, &usual).minimum.unwrap();
        let needed = 30.0 - 5.0 + 0.5 * usual.step;
        assert!((needed..needed + 0.01).contains(&rubbing), "{rubbing}");
        // From the lowest tip beside the wall to its top, and half a step.
        let needed = 30.0 - 8.3 + 0.5 * usual.step;
        assert!(
            by_centres < needed - 0.4 && (needed..needed + 0.25).contains(&minimum),
            "{by_centres} {minimum}"
        );
    }

    #[test]
    fn where_the_shortest_serves_no_line_decides_and_where_none_does_one_is_named() {
        let usual = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
        let above = found("x,y,z\n-10,0,40\n10,0,40\n", None, &usual);
        assert_eq!((above.minimum, above.line), (Some(10.0), None));
        // Through the wall.
        let through = found("x,y,z\n-10,0,40\n-10,0,8\n30,0,8\n", Some(60.0), &usual);
        assert_eq!((through.minimum, through.line, through.longest), (None, Some(4), Some(60.0)));
        // More than it has is told, not hidden.
        let more = found("x,y,z\n9,0,0.5\n", Some(28.0), &usual);
        assert!(more.minimum.unwrap() > 28.0 && more.line == Some(2), "{more:?}");
        let bare = revolved([(ElementKind::Cutter, vec![line(0.0, 10.0, 3.0, 3.0)])]);
        let path = Toolpath::parse("x,y,z\n-10,0,40\n", LengthUnit::Mm, "path").unwrap();
        let refused =
            shortest_stick_outs(&wall(), &[], &[(None, &bare)], &path, &usual, None, Control::quiet());
        assert!(refused.unwrap_err().to_string().contains("has no holder"));
    }
}
