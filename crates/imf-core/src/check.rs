//! A toolpath checked against what must not be hit, exactly, pose by pose and element by element.
//!
//! Between two lines of the toolpath poses are taken so close together that no point of the tool moves farther than
//! a step from one to the next, roll included. Each stretch is checked with its own tool. Holder and shank, offset by
//! their clearance, must hold no solid voxel's centre. The cutter must touch what it cuts: it may hold centres of the part's
//! voxels, but none deeper below its own surface than `contact`, a length that does not follow the pitch. What lies deep in the
//! cutter may be a thin wall, so that none is cut through unseen. With fixtures nothing is accepted.
//!
//! A collision's depth is measured from both sides: a solid centre that lies so deep in the element and so deep in the part has a
//! ball around it in either, so no translation shorter than the sum of both radii separates them. The depth of a pose is
//! the largest of these sums. The part's surface is taken to lie half-way between solid and empty centres.
//!
//! With stock ([`check_stock`]) the path is followed once more, the cutter taking away what it holds.
//!
//! With a machine the motions are its own, its head and table are bodies that move with its axes, and where an axis leaves its
//! range is told.

mod elements;
mod machine;
mod motions;
mod report;
mod stick_out;
mod stock;

pub use machine::{MachineBodies, MachineFault, MachineReach, machine_remarks};
pub use report::{CheckReport, Collision, HitBody, LineCollisions, TravelFault};
pub use stick_out::{PathStickOut, least_stick_outs};
pub use stock::{LineRemoval, StockLeft, StockReport, check_stock};

use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;
use thiserror::Error;

use crate::control::{Cancelled, Control};
use crate::occupancy::Occupancy;
use crate::parallel;
use crate::scene::SceneError;
use crate::surface::SurfaceError;
use crate::tool::{Clearance, ClearanceError, Tool, ToolError, ToolShape};
use crate::toolpath::Toolpath;
use crate::unit::LengthUnit;
use elements::{Body, Elements};
use machine::{Beyond, MachinePairs};
pub use motions::{cutters_not_compared, never_near};
use motions::{motions, rigid};

/// Accepted contact, clearances, and how densely the path is sampled. Lengths in the unit of the part's grid.
///
/// # Example
/// Ten times as closely as by default, at a pitch of half a millimetre:
/// ```
/// use imf_core::check::CheckSettings;
/// use imf_core::unit::LengthUnit;
///
/// let usual = CheckSettings::of_pitch(0.5, LengthUnit::Mm);
/// let closer = CheckSettings { step: usual.step / 10.0, ..usual };
/// assert_eq!((closer.step, closer.contact), (0.0125, 0.05));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CheckSettings {
    /// Room around each kind of element.
    pub clearance: Clearance,
    /// How deep the part may lie in the cutter; 0 accepts nothing, and keeps the cutter's clearance.
    pub contact: f64,
    /// How closely the path is followed: farthest that any point of the tool moves between two poses that are checked. What the cutter
    /// may cut is `contact`.
    pub step: f64,
}

/// Contact that is accepted by default, in mm: chord errors and tolerances of CAM programs are a few hundredths.
const CONTACT: f64 = 0.05;

impl CheckSettings {
    /// No clearance, contact of 0.05 mm, a step of a quarter of the pitch; lengths in `unit`.
    #[must_use]
    pub fn of_pitch(pitch: f64, unit: LengthUnit) -> Self {
        Self { clearance: Clearance::default(), contact: CONTACT / unit.in_mm(), step: pitch / 4.0 }
    }

    /// The same around conservative voxels, which reach out of the part by up to half their diagonal: the cutter may enter so much more.
    #[must_use]
    pub fn of_conservative(pitch: f64, unit: LengthUnit) -> Self {
        let usual = Self::of_pitch(pitch, unit);
        Self { contact: usual.contact + 0.75_f64.sqrt() * pitch, ..usual }
    }

    /// Diameter of the smallest ball whose overlap is certain to be detected at any time of a motion: at the nearest checked
    /// pose, and below the accepted contact, the rest of such an overlap still contains a voxel centre.
    #[must_use]
    pub fn sure_depth(&self, pitch: f64) -> f64 {
        3f64.sqrt() * pitch + 2.0 * self.contact + self.step
    }

    fn check(&self) -> Result<(), CheckError> {
        let Self { contact, step, .. } = *self;
        if !(contact.is_finite() && contact >= 0.0) {
            let wanted = "a finite length of at least 0";
            return Err(CheckError::Setting { name: "contact", wanted, value: contact });
        }
        if !(step.is_finite() && step > 0.0) {
            let wanted = "a finite length above 0";
            return Err(CheckError::Setting { name: "step", wanted, value: step });
        }
        Ok(())
    }
}

/// What must not be hit: voxels on grids of one pitch, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub struct CheckBodies<'a> {
    /// What is cut.
    pub part: &'a Occupancy,
    /// What holds it, by name.
    pub fixtures: &'a [(String, Occupancy)],
    /// The machine that follows the path; the path is read for it.
    pub machine: Option<&'a MachineBodies>,
}

/// Why a toolpath cannot be checked.
#[derive(Debug, Error)]
pub enum CheckError {
    /// The tool has no volume.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The tool cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// Which way the tool turns is not defined.
    #[error(
        "line {line}: the tool axis turns to its opposite in one step; which way is not said, so add a line between"
    )]
    Opposite {
        /// The line the motion ends on.
        line: usize,
    },
    /// Which way the tool rolls is not defined.
    #[error(
        "line {line}: the tool rolls about its axis by half a turn in one step; which way is not said, so add a line between"
    )]
    RollsOver {
        /// The line the motion ends on.
        line: usize,
    },
    /// The tool is not round, and the path does not say how it is rolled.
    #[error(
        "line {line}: the tool '{tool}' is not round, and the toolpath does not say how it is rolled about its axis: add a \
         column roll, in degrees (APT files have none)"
    )]
    NoRoll {
        /// The line.
        line: usize,
        /// The tool's name.
        tool: String,
    },
    /// A tool number that none of the tools has.
    #[error("line {line}: {}, and the tools that are given have the numbers {given}", number_text(*.number))]
    NoTool {
        /// The line.
        line: usize,
        /// The number that it has.
        number: Option<u32>,
        /// The numbers that there are.
        given: String,
    },
    /// The path was made for another cutter.
    #[error(
        "line {line}: the path is made for a cutter with a {what} of {said}, and that of '{tool}' is {given}: give the tool \
         that the path was made for, or take the line out if it means another one"
    )]
    OtherCutter {
        /// The line.
        line: usize,
        /// Which length.
        what: &'static str,
        /// What the file says, in the path's unit.
        said: f64,
        /// What the tool has.
        given: f64,
        /// The tool's name.
        tool: String,
    },
    /// Several tools on the path, and one without a number.
    #[error(
        "line {line}: the tool changes, from {} to {}, and one tool is given for both: give each tool its number",
        number_text(*.from), number_text(*.to)
    )]
    ToolChange {
        /// The line.
        line: usize,
        /// The number before.
        from: Option<u32>,
        /// The number after.
        to: Option<u32>,
    },
    /// The path is for a machine that is not given, or for none.
    #[error("line {line}: the toolpath was not read for the machine that is to follow it")]
    Machine {
        /// The line.
        line: usize,
    },
    /// A mesh cannot be offset.
    #[error(
        "the machine's solid '{name}' is a mesh, which cannot be offset by the holder's clearance: describe it by cylinders and boxes"
    )]
    HeadMesh {
        /// The solid's name.
        name: String,
    },
    /// A solid that voxels do not show.
    #[error(
        "the machine's solid '{name}' is {thickness} thick, and voxels of {pitch} show nothing below √2 of that for sure: choose a \
         smaller pitch, or describe it by smaller solids"
    )]
    ThinSolid {
        /// The solid's name.
        name: String,
        /// Its thickness.
        thickness: f64,
        /// Of its voxels.
        pitch: f64,
    },
    /// A solid of which walls lie between the voxels' centres.
    #[error(
        "the machine's solid '{name}' has walls that lie between the centres of voxels of {pitch} (an area of {area:.1}, as at {at:.1}), and \
         would be overlooked there: choose a smaller pitch, or describe it by boxes and cylinders"
    )]
    LostSolid {
        /// The solid's name.
        name: String,
        /// Area of their surface.
        area: f64,
        /// A point of it.
        at: DVec3,
        /// Of its voxels.
        pitch: f64,
    },
    /// A solid's mesh that does not say what is inside.
    #[error(transparent)]
    Solid(#[from] SceneError),
    /// Tools that cannot be told apart.
    #[error("the tools are {0}: give one tool without a number, or each its own")]
    Tools(String),
    /// The cutter is too thin for the contact.
    #[error(
        "the cutter of '{tool}' is not thicker than twice the contact of {contact} and a voxel's diagonal together: it could cut \
         anything unseen between the voxels' centres; choose a smaller contact or pitch"
    )]
    Contact {
        /// The tool's name.
        tool: String,
        /// The contact.
        contact: f64,
    },
    /// A setting that is not a valid length.
    #[error("the {name} must be {wanted}, not {value}")]
    Setting {
        /// Which.
        name: &'static str,
        /// What it should be.
        wanted: &'static str,
        /// What it is.
        value: f64,
    },
    /// A motion would need too many poses.
    #[error(
        "line {line}: {poses:.1e} poses at steps of {step}; use larger ones, or check the toolpath's unit"
    )]
    TooLong {
        /// The line the motion ends on.
        line: usize,
        /// Poses it would need.
        poses: f64,
        /// The step.
        step: f64,
    },
    /// The elements of an outline that bends inwards cannot be counted by themselves.
    #[error(
        "the tool '{0}' has an arc around a centre beyond its axis, which cannot be checked with a clearance or among stock"
    )]
    Outline(String),
    /// The stock is followed with a tool that has no elements.
    #[error(
        "the tool '{0}' is a mesh, which does not say what of it cuts the stock: describe it by cutter, shank and holder"
    )]
    StockMesh(String),
    /// The stock lies between the part's voxels.
    #[error("the voxels of the stock are not those of the part and the fixtures")]
    StockGrid,
    /// The tip's place depends on the tool's length.
    #[error(
        "line {line}: the head is tilted and no centre point is kept, so that the tip moves with the tool's length: no stick-out \
         can be found for such a path; write it with the centre point kept (G43.4)"
    )]
    TipMoves {
        /// The line.
        line: usize,
    },
    /// No stick-out can be found for the tool.
    #[error(transparent)]
    StickOut(#[from] SurfaceError),
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

fn number_text(number: Option<u32>) -> String {
    number.map_or_else(|| "no tool by number".into(), |number| format!("tool {number}"))
}

/// Checks every motion of a toolpath on all threads of the current pool. One unit of progress is one location.
///
/// `tools` are one tool without a number, for a path of one tool, or tools by number, each of which checks its own stretches;
/// their lengths are in the grids' unit.
///
/// # Errors
/// Settings or tools that make no sense, a location without a tool or, where its tool is not round, without a roll, a motion whose
/// turn is not defined or that is absurdly long, cancellation.
pub fn check_toolpath(
    bodies: CheckBodies<'_>,
    tools: &[(Option<u32>, &Tool)],
    toolpath: &Toolpath,
    settings: &CheckSettings,
    control: Control<'_>,
) -> Result<CheckReport, CheckError> {
    settings.check()?;
    tools.iter().try_for_each(|(_, tool)| tool.check())?;
    // Every motion is validated before any pose is checked.
    let machine = bodies.machine.map(MachineBodies::machine);
    let motions = motions(toolpath, tools, settings, machine)?;
    let part = Arc::new(Body::new(Arc::new(bodies.part.clone()), HitBody::Part));
    let fixture = |(name, voxels): &(String, Occupancy)| {
        Arc::new(Body::new(Arc::new(voxels.clone()), HitBody::Fixture(name.clone())))
    };
    let fixtures: Vec<Arc<Body>> = bodies.fixtures.iter().map(fixture).collect();
    bodies.machine.map_or(Ok(()), |machine| machine.check(bodies.part.grid.pitch))?;
    let world = rigid(&toolpath.set_up);
    let mut lines: Vec<report::Followed> = Vec::with_capacity(motions.len());
    for (index, (_, tool)) in tools.iter().enumerate() {
        let own: Vec<usize> = (0..motions.len()).filter(|&m| motions[m].tool == index).collect();
        if own.is_empty() {
            continue;
        }
        let elements = Elements::new(&part, &fixtures, tool, settings)?;
        let pairs = bodies
            .machine
            .map(|machine| MachinePairs::new(machine, &part, &fixtures, tool, settings, &world));
        let pairs = pairs.transpose()?;
        lines.extend(parallel::try_map(own.len(), |place| {
            control.check()?;
            let motion = &motions[own[place]];
            let location = &toolpath.locations[own[place]];
            let (line, tool, kind) = (location.line, location.tool, location.kind);
            let mut collisions = elements.collisions(motion);
            let mut beyond = Vec::new();
            if let Some(pairs) = &pairs {
                let (more, out) = pairs.follow(motion, line)?;
                collisions.extend(more);
                beyond.extend(out.into_iter().map(|Beyond { first, fraction, farthest }| TravelFault {
                    line,
                    axis: first.axis,
                    value: first.value,
                    farthest,
                    range: first.range.map(|end| end.is_finite().then_some(end)),
                    fraction,
                }));
            }
            motion.with_joints(&mut collisions);
            (control.progress)(1);
            let found = LineCollisions { line, tool, kind, poses: motion.count, collisions };
            Ok::<_, CheckError>((own[place], found, beyond))
        })?);
    }
    lines.sort_by_key(|(index, ..)| *index);
    let mut report = report::gather(&lines, toolpath, settings, bodies.part.grid.pitch);
    let ball = report.sure_depth;
    // A slender tip is wide enough only farther up; one that never is, is never certain to be seen.
    let of_tip = |&(_, tool): &(Option<u32>, &Tool)| match &tool.shape {
        ToolShape::Revolved(_) => {
            tool.tip_depth(0.5 * ball.min(tool.thinnest().1)).unwrap_or_else(|| tool.length())
        }
        ToolShape::Mesh(_) => ball,
    };
    report.sure_depth = tools.iter().map(of_tip).fold(ball, f64::max);
    Ok(report)
}

#[cfg(test)]
mod machine_oracle;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;
