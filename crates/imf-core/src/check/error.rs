//! Why a toolpath cannot be checked.

use glam::DVec3;
use thiserror::Error;

use crate::control::Cancelled;
use crate::scene::SceneError;
use crate::surface::SurfaceError;
use crate::tool::{ClearanceError, ToolError};
use crate::unit::{DisplayLength, LengthUnit};

/// Why a toolpath cannot be checked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CheckError {
    /// The tool has no volume.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The tool cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// A tool in another unit than the path.
    #[error(
        "the tool '{tool}' is in {unit}, and the path in {path}: convert it to the path's unit, which is also that of part and fixtures"
    )]
    Unit {
        /// The tool's name.
        tool: String,
        /// Its unit.
        unit: LengthUnit,
        /// The path's.
        path: LengthUnit,
    },
    /// Voxels that are none.
    #[error("the voxels of {0} must be a byte for each voxel of their grid, 0 or 1, of the part's pitch")]
    Voxels(String),
    /// A pose that is none.
    #[error("the pose is not valid: its numbers must be finite, and its axis must have a length")]
    Pose,
    /// A line of the toolpath cannot be followed.
    #[error("line {line}: {fault}")]
    Line {
        /// Line of the toolpath's file.
        line: usize,
        /// Why.
        fault: LineFault,
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
    /// Tools that cannot be distinguished.
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
    /// The tool is thinner than what it moves from one pose to the next.
    #[error(
        "the {element} of '{tool}' is {} thick, and a step of {step} from one pose to the next is longer: it could pass through \
         anything unseen; choose a smaller step",
        DisplayLength(*.thickness)
    )]
    Step {
        /// The tool's name.
        tool: String,
        /// Its thinnest element.
        element: String,
        /// The thickness of that.
        thickness: f64,
        /// The step.
        step: f64,
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
    /// No stick-out can be found for the tool.
    #[error(transparent)]
    StickOut(#[from] SurfaceError),
    /// The caller's [`Control`](crate::control::Control) asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

/// Why a line of a toolpath, or the motion that ends on it, cannot be followed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LineFault {
    /// Which way the tool turns is not defined.
    #[error("the tool axis turns to its opposite in one step; which way is not said, so add a line between")]
    Opposite,
    /// Which way the tool rolls is not defined.
    #[error(
        "the tool rolls about its axis by half a turn in one step; which way is not said, so add a line between"
    )]
    RollsOver,
    /// The tool is not round, and the path does not say how it is rolled.
    #[error(
        "the tool '{tool}' is not round, and the toolpath does not say how it is rolled about its axis: add a \
         column roll, in degrees (APT files have none)"
    )]
    NoRoll {
        /// The tool's name.
        tool: String,
    },
    /// A tool number that none of the tools has.
    #[error(
        "{}, and the tools that are given have the numbers {given}{}", number_text(*.number),
        if number.is_none() { ": give one tool without a number where all lines are its" } else { "" }
    )]
    NoTool {
        /// The number that it has.
        number: Option<u32>,
        /// The numbers that there are.
        given: String,
    },
    /// The path was made for another cutter.
    #[error(
        "the path is made for a cutter with a {what} of {said}, and that of '{tool}' is {given}: give the tool \
         that the path was made for, or take the line out if it means another one"
    )]
    OtherCutter {
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
        "the tool changes, from {} to {}, and one tool is given for both: give each tool its number",
        number_text(*.from), number_text(*.to)
    )]
    ToolChange {
        /// The number before.
        from: Option<u32>,
        /// The number after.
        to: Option<u32>,
    },
    /// The path is for a machine that is not given, or for none.
    #[error("the toolpath was not read for the machine that is to follow it")]
    Machine,
    /// A motion would need too many poses.
    #[error("{poses:.1e} poses at steps of {step}; use larger ones, or check the toolpath's unit")]
    TooLong {
        /// Poses it would need.
        poses: f64,
        /// The step.
        step: f64,
    },
    /// The tip's place depends on the tool's length.
    #[error(
        "the head is tilted and no centre point is kept, so that the tip moves with the tool's length: no stick-out \
         can be found for such a path; write it with the centre point kept (G43.4)"
    )]
    TipMoves,
}

impl LineFault {
    pub(super) fn on_line(self, line: usize) -> CheckError {
        CheckError::Line { line, fault: self }
    }
}

fn number_text(number: Option<u32>) -> String {
    number.map_or_else(|| "no tool by number".into(), |number| format!("tool {number}"))
}
