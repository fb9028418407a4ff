//! Toolpaths of five axes: which tool, where its tip goes and how it is turned, line by line of the file it came from.
//!
//! Positions are the tool's tip; axes point from the tip to the holder. Between two lines the tool moves by
//! [`Pose::interpolate`]; of a path for a machine by [`MachineMotion`](crate::machine::MachineMotion). What is not understood is refused with its line: a word or a column that is skipped might be one that
//! moves the tool.

mod apt;
mod csv;
mod error;
mod gcode;
mod of_poses;

pub use csv::column_remedy;
pub use error::ToolpathError;

use std::path::Path;

use glam::{DMat4, DVec3};
use serde::Serialize;

use crate::machine::{Joints, Machine};
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::unit::LengthUnit;
use error::Fault;

/// How the tool comes to a location.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// It begins there: the first location, and the first of another tool. The way to it is not in the file.
    Start,
    /// At rapid rate.
    Rapid,
    /// At feed rate.
    Feed,
}

/// A pose of the tool, and the line that says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Line of the file, from 1; of poses in a list, their place from 1.
    pub line: usize,
    /// Tip and rotation.
    pub pose: Pose,
    /// True where the file says how the tool is rolled about its axis; otherwise the pose's roll means nothing.
    pub rolled: bool,
    /// Number of the tool, where the file names one.
    pub tool: Option<u32>,
    /// How the tool comes here.
    pub kind: MoveKind,
    /// How the machine stands here, of a path for one.
    pub machine: Option<MachinePoint>,
}

/// How a machine stands at a location, and how it comes there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachinePoint {
    /// Positions of its axes.
    pub joints: Joints,
    /// From the spindle's face to the tip, in the path's unit.
    pub length: f64,
    /// The tip goes straight in the part's frame on the way here (the control keeps the tool's centre point); otherwise the linear
    /// axes move evenly.
    pub tip_goes_straight: bool,
    /// The spindle's height is the machine's own, by G53 or G28, and the tip's moves with the tool's length.
    pub by_spindle: bool,
}

/// What a file is read for.
#[derive(Clone, Copy, Debug, Default)]
pub struct PathReading<'a> {
    /// Unit of the path that is made; that of the file where it does not say its own.
    pub unit: LengthUnit,
    /// The machine that follows the path, in that unit.
    pub machine: Option<&'a Machine>,
    /// Lengths of the tools from tip to spindle, by number, or of the only one.
    pub lengths: &'a [(Option<u32>, f64)],
}

/// An axis jumps if it turns at least `JUMP` degrees and at least `TIMES` times as far as the tool's direction: near
/// the axis's own direction smooth paths turn it a few times as far.
const JUMP: f64 = 45.0;
/// Rounding of a rotation.
const SCALED: f64 = 1e-6;
const TIMES: f64 = 4.0;

impl From<LengthUnit> for PathReading<'_> {
    fn from(unit: LengthUnit) -> Self {
        Self { unit, ..Self::default() }
    }
}

impl PathReading<'_> {
    /// The length of a tool by its number.
    fn length_of(&self, tool: Option<u32>) -> Option<f64> {
        let own = self.lengths.iter().find(|(number, _)| number.is_none() || *number == tool);
        own.map(|&(_, length)| length)
    }

    /// The same for a line that needs it.
    fn known_length_of(&self, tool: Option<u32>) -> Result<f64, String> {
        let length = self.length_of(tool);
        length.ok_or_else(|| {
            let which = match tool {
                Some(number) => format!("no tool {number} is given"),
                None => {
                    "it names no tool, and those that are given have numbers: give one tool without a number"
                        .into()
                }
            };
            format!("the length of its tool is not known: {which}")
        })
    }
}

/// What a file says of a cutter, in the unit of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutterStatement {
    /// Line of the file, from 1.
    pub line: usize,
    /// Number of the tool that it describes, where the file names one.
    pub tool: Option<u32>,
    /// Diameter.
    pub diameter: f64,
    /// Radius of the corner between bottom and flank, where it is stated.
    pub corner_radius: Option<f64>,
}

/// The locations of a file in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Toolpath {
    /// In the order of the file.
    pub locations: Vec<Location>,
    /// What it says of its cutters.
    pub cutters: Vec<CutterStatement>,
    /// Where the part's frame is in the world, from [`Toolpath::placed`].
    pub set_up: DMat4,
    /// Remarks in words on what was assumed, with the line.
    pub remarks: Vec<String>,
    /// Lines with motions that are not checked, since some axis was not said by then.
    pub unchecked: Vec<usize>,
    /// The file says its own unit.
    pub states_unit: bool,
    /// What is not said to be at rapid rate is at feed rate.
    pub states_rapids: bool,
    /// Unit of its lengths.
    pub unit: LengthUnit,
}

impl Toolpath {
    /// Reads a CSV file (a header of column names, then numbers), an APT/CL file (`GOTO/x,y,z,i,j,k`) or a program in G-code,
    /// distinguished by the words in it and the end of its name. Lengths become those of `reading`. With a machine every location
    /// knows its joints; where a file says directions, these are the solutions with the smallest turns.
    ///
    /// # Errors
    /// Names the file and the line that is wrong or not understood.
    pub fn read<'a>(path: &Path, reading: impl Into<PathReading<'a>>) -> Result<Self, ToolpathError> {
        let name = path.display().to_string();
        let bytes =
            std::fs::read(path).map_err(|source| ToolpathError::Read { path: name.clone(), source })?;
        // Comments may be in any encoding; what counts is ASCII.
        Self::parse(&String::from_utf8_lossy(&crate::file_error::as_utf8(&bytes)), reading, &name)
    }

    /// As [`Toolpath::read`], from the text of a file called `name`.
    ///
    /// # Errors
    /// Names the file and the line that is wrong or not understood.
    pub fn parse<'a>(
        text: &str,
        reading: impl Into<PathReading<'a>>,
        name: &str,
    ) -> Result<Self, ToolpathError> {
        let reading = reading.into();
        // A carriage return ends a line by itself as well, as on old systems; files that were joined have several marks of byte order.
        let lines = text.replace('\u{feff}', "").replace("\r\n", "\n").replace('\r', "\n");
        let mut path = Self::of_text(&lines, &reading, name).map_err(|error| error.in_file(name))?;
        if path.locations.is_empty() {
            return Err(ToolpathError::Empty(name.to_owned()));
        }
        path.mark_starts();
        Ok(Self { unit: reading.unit, ..path })
    }

    /// No way leads to the first location of a tool.
    fn mark_starts(&mut self) {
        let mut last = None;
        for location in &mut self.locations {
            if last.replace(location.tool) != Some(location.tool) {
                location.kind = MoveKind::Start;
            }
        }
    }

    fn of_text(text: &str, reading: &PathReading<'_>, name: &str) -> Result<Self, Fault> {
        if gcode::is_program(text, name) {
            return gcode::parse(text, reading);
        }
        let is_apt = text.lines().any(|line| {
            let word = line.split('/').next().unwrap_or_default().trim();
            let mut letters = word.chars();
            line.contains('/')
                && letters.next().is_some_and(|c| c.is_ascii_alphabetic())
                && letters.all(|c| c.is_ascii_alphanumeric())
        });
        let mut path = if is_apt { apt::parse(text, reading.unit)? } else { csv::parse(text, reading)? };
        if let Some(machine) = reading.machine {
            path.turn(machine, reading)?;
        }
        Ok(path)
    }

    /// Finds the joints of every location that says a direction.
    fn turn(&mut self, machine: &Machine, reading: &PathReading<'_>) -> Result<(), Fault> {
        let mut before: Option<(Option<u32>, Joints)> = None;
        let chosen: Vec<bool> = self.locations.iter().map(|location| location.machine.is_none()).collect();
        for location in &mut self.locations {
            let line = location.line;
            let wrong = |what: String| Fault::from(what).on_line(line);
            if location.machine.is_none() {
                if location.rolled {
                    return Err(wrong(
                        "the file says how the tool is rolled about its axis, which the machine's axes decide".into(),
                    ));
                }
                let length = reading.known_length_of(location.tool).map_err(wrong)?;
                let from = before.filter(|(tool, _)| *tool == location.tool).map(|(_, joints)| joints);
                let joints = machine.joints(&location.pose, length, from.as_ref());
                let joints = joints.map_err(|error| wrong(error.to_string()))?;
                if from.is_none()
                    && let Some(place) = location.pose.axis().and_then(|axis| machine.inverse(axis).free)
                {
                    let (letter, angle) = (machine.rotary[place].letter, joints.rotary[place]);
                    self.remarks
                        .push(format!("line {line}: {letter} is free here, and taken to be {angle}°"));
                }
                if before.is_none() {
                    self.remarks.push(format!(
                        "line {line}: the file says directions; the angles are chosen here, those nearest to the ones before, and a \
                         post-processor may choose others"
                    ));
                }
                location.machine =
                    Some(MachinePoint { joints, length, tip_goes_straight: true, by_spindle: false });
            }
            if let Some(MachinePoint { joints, length, .. }) = location.machine {
                location.pose = machine.forward(&joints, length);
                location.rolled = true;
                before = Some((location.tool, joints));
            }
        }
        self.remark_on_jumps(machine, &chosen);
        Ok(())
    }

    /// Where axes turn much farther than the tool's does, a post-processor may lift the tool, or have begun elsewhere.
    fn remark_on_jumps(&mut self, machine: &Machine, chosen: &[bool]) {
        let jump = |(pair, chosen): (&[Location], &[bool])| {
            let [from, to] = pair else { return None };
            let turned = from.pose.axis()?.angle_between(to.pose.axis()?).to_degrees();
            let (before, after) = (from.machine?.joints.rotary, to.machine?.joints.rotary);
            let axes = machine.rotary.iter().zip(before.iter().zip(after));
            let far = axes.map(|(axis, (before, after))| (axis.letter, (after - before).abs()));
            let far: Vec<_> = far.filter(|(_, angle)| *angle > JUMP && *angle > TIMES * turned).collect();
            let is_cut = from.tool == to.tool && to.kind == MoveKind::Feed && chosen == [true, true];
            let is_way = is_cut && !far.is_empty();
            is_way.then_some((to.line, far, turned))
        };
        let pairs = self.locations.windows(2).zip(chosen.windows(2));
        let jumps: Vec<_> = pairs.filter_map(jump).collect();
        if let Some((line, far, turned)) = jumps.first() {
            let axes: Vec<String> =
                far.iter().map(|(letter, angle)| format!("{letter} turns by {angle:.0}°")).collect();
            let more = match jumps.len() - 1 {
                0 => String::new(),
                1 => ", as on one more line".into(),
                more => format!(", as on {more} more lines"),
            };
            self.remarks.push(format!(
                "line {line}: {} where the tool's axis turns by {turned:.0}°{more}: the way is followed as it is, and a post-processor may lift \
                 the tool there or choose other angles",
                axes.join(" and ")
            ));
        }
    }

    /// The path where the part's motion puts it, which may scale evenly: from the part's own frame into the world.
    #[must_use]
    pub fn placed(&self, set_up: &DMat4) -> Self {
        if *set_up == DMat4::IDENTITY {
            return self.clone();
        }
        // A part that is scaled is turned as well, and the tool turned alone.
        let (_, turn, _) = set_up.to_scale_rotation_translation();
        let placed = |location: &Location| {
            let Pose { position, rotation } = location.pose;
            Location { pose: Pose::new(set_up.transform_point3(position), turn * rotation), ..*location }
        };
        let locations = self.locations.iter().map(placed).collect();
        let mut placed = Self { locations, set_up: *set_up * self.set_up, ..self.clone() };
        let scale = set_up.x_axis.truncate().length();
        if self.states_unit && (scale - 1.0).abs() > SCALED {
            placed.remarks.push(format!(
                "the path says its own unit, and is multiplied by {scale} as the part is that it goes around"
            ));
        }
        placed
    }

    /// The numbers of its tools, each once, in the order of the file; `None` where the file names none.
    #[must_use]
    pub fn tools(&self) -> Vec<Option<u32>> {
        let mut tools = Vec::new();
        for location in &self.locations {
            if !tools.contains(&location.tool) {
                tools.push(location.tool);
            }
        }
        tools
    }

    /// Tool changes and other places where the path begins anew: locations to which no way leads.
    #[must_use]
    pub fn starts(&self) -> usize {
        self.locations.iter().filter(|location| location.kind == MoveKind::Start).count()
    }
}

/// Which way the tool points, as a file says it.
#[derive(Clone, Copy, Debug)]
enum Direction {
    /// From tip to holder, of any length.
    Axis([f64; 3]),
    /// θ and φ in degrees.
    Angles([f64; 2]),
}

/// A pose from its numbers, checked; the roll in degrees.
fn pose(position: [f64; 3], direction: Direction, roll: Option<f64>) -> Result<Pose, String> {
    let position = DVec3::from_array(position);
    if !position.is_finite() {
        return Err("a position must be finite".into());
    }
    let mut orientation = match direction {
        Direction::Axis(axis) => {
            Orientation::from_direction(DVec3::from_array(axis)).ok_or("the tool axis must not be zero")?
        }
        Direction::Angles([theta, phi]) if theta.is_finite() && (0.0..=180.0).contains(&phi) => {
            Orientation::new(theta.rem_euclid(360.0), phi)
        }
        Direction::Angles([theta, phi]) => {
            return Err(format!("theta must be finite and phi from 0 to 180 degrees, not {theta} and {phi}"));
        }
    };
    if let Some(roll) = roll {
        if !roll.is_finite() {
            return Err("the roll must be finite".into());
        }
        orientation.roll = roll.rem_euclid(360.0);
    }
    Ok(Pose::oriented(position, &orientation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_recognised_and_missing_files_named() {
        let unit = LengthUnit::Mm;
        let apt = Toolpath::parse("PARTNO A/B\nGOTO/1,2,3,0,.1,-.995\n", unit, "a").unwrap();
        let csv = Toolpath::parse("x,y,z,i,j,k\n1,2,3,0,.1,-.995\n", unit, "b").unwrap();
        assert_eq!(apt.locations[0].pose, csv.locations[0].pose);
        for text in ["GOTO/1,2,3,0,.1,-.995\n", "x,y,z,i,j,k\r1,2,3,0,.1,-.995\r"] {
            let marked = Toolpath::parse(&format!("\u{feff}{text}"), unit, "d").unwrap();
            assert_eq!(marked.locations[0].pose, csv.locations[0].pose, "{text}");
        }
        assert!(matches!(Toolpath::parse("\n", unit, "c"), Err(ToolpathError::Empty(_))));
        let error = Toolpath::read(Path::new("no/such/path.apt"), unit).unwrap_err();
        assert!(error.to_string().contains("no/such/path.apt"));
    }

    #[test]
    fn a_path_begins_anew_with_another_tool_and_goes_where_the_part_is_set_up() {
        let text = "LOADTL/1\nRAPID\nGOTO/1,2,3\nRAPID\nGOTO/2,2,3\nLOADTL/2\nGOTO/1,2,3,1,0,0\nGOTO/1,2,4\n";
        let path = Toolpath::parse(text, LengthUnit::Mm, "a").unwrap();
        let kinds: Vec<MoveKind> = path.locations.iter().map(|l| l.kind).collect();
        assert_eq!(kinds, [MoveKind::Start, MoveKind::Rapid, MoveKind::Start, MoveKind::Feed]);
        assert_eq!((path.tools(), path.starts()), (vec![Some(1), Some(2)], 2));
        let turn = DMat4::from_translation(DVec3::Z) * DMat4::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let placed = path.placed(&turn).locations[2];
        assert!((placed.pose.position - DVec3::new(-2.0, 1.0, 4.0)).length() < 1e-12);
        assert!((placed.pose.axis().unwrap() - DVec3::Y).length() < 1e-12);
        // A part that is scaled as well takes its path along, and turns the tool as much.
        let scaled = path.placed(&(DMat4::from_scale(DVec3::splat(2.0)) * turn)).locations[2].pose;
        assert!((scaled.position - 2.0 * placed.pose.position).length() < 1e-12);
        assert!((scaled.axis().unwrap() - DVec3::Y).length() < 1e-12);
    }
}
