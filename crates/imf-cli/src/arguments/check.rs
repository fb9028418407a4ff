//! The arguments of `imf check`.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use imf_core::check::{CheckError, CheckSettings};
use imf_core::scene::SceneRecord;
use imf_core::tool::Tool;
use serde::Serialize;

use super::fixture::{StockArgument, parse_stock};
use super::inputs::read_tool;
use super::numbers::{parse_length, parse_room};
use super::scene::SceneArguments;

/// Check a 5-axis toolpath for collisions, exactly, line by line
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf check part.stl finish.cl --unit mm --tool mill.toml --clearance 2\n  \
                        imf check part.stl all.cl --unit mm --tool 1=face.toml --tool 2=ball6.toml --out checked\n  \
                        imf check teapot path.csv --contact 0.1 --json\n  \
                        imf check part.stl rough.nc --unit mm --tool 1=mill.toml --stock box:2 --out checked\n  \
                        imf check part.stl 5x.nc --unit mm --tool 1=ball6.toml --machine trunnion.toml\n\n\
                        The toolpath is CSV (a header of columns: x,y,z the tip, then i,j,k the axis from tip to holder or \
                        theta,phi in degrees, roll for tools that are not round, tool for the tool's number, rapid with 1 at rapid rate), APT/CL (GOTO/ \
                        lines, LOADTL/ for the tool's number) or G-code (G0 to G3, T and M6), in the part's unit unless it says its \
                        own. What is not understood is refused.\n\
                        With --machine rotary axes are read as columns or words (A, B, C), the spindle head and the table are obstacles, \
                        and travel is checked; the machine's work offset G54 is the frame into which --transform sets the part up.\n\
                        Coordinates are in the part's frame, that of its file; with --frame world, and with a machine, in the frame into \
                        which --transform sets the part up. So are those of the result.\n\
                        Exit code 3 says that something collides or leaves the travel, 2 that the toolpath or a tool cannot be checked."
)]
pub(crate) struct CheckArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// Toolpath, CSV, APT/CL or G-code
    pub(crate) toolpath: PathBuf,
    /// Machine that follows the path, in TOML: its rotary axes, travel, work offsets, head and table
    #[arg(long, value_name = "FILE")]
    pub(crate) machine: Option<PathBuf>,
    /// Frame of the toolpath's coordinates; the part's by default, the world's with a machine, whose G54 is there
    #[arg(long, value_enum, value_name = "FRAME")]
    pub(crate) frame: Option<Frame>,
    /// Farthest that any point of the tool moves between two checked poses; a quarter of a voxel by default
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    pub(crate) step: Option<f64>,
    /// How deep the part may lie in the cutter, and points of any surface in shank and holder; 0.05 mm by default
    #[arg(long, value_name = "LENGTH", value_parser = parse_room)]
    pub(crate) contact: Option<f64>,
    /// The stock that the path cuts, followed line by line: box, box:MARGIN around the part, or a file in the part's frame, set up with it;
    /// FILE@STEPS as for --fixture. --contact loosens it too. Nothing but the cutter may touch it, no rapid may cut it, and no drill
    /// aside
    #[arg(long, value_name = "STOCK", value_parser = parse_stock)]
    pub(crate) stock: Option<StockArgument>,
    /// The shortest stick-out of each tool with which shank and holder are free on the whole path, its holder moved along its shank
    #[arg(long)]
    pub(crate) stickout: bool,
    /// A page with part, fixtures and path in 3D, lines that collide in red: one file that a browser opens without network
    #[arg(long, value_name = "FILE")]
    pub(crate) html: Option<PathBuf>,
    /// Folder for collisions.csv, worst.png and summary.json; with --machine also travel.csv; with --stock removed.csv, and what is left
    /// as stock.vti and stock.stl, which --stock reads again
    #[arg(long, value_name = "FOLDER")]
    pub(crate) out: Option<PathBuf>,
}

/// Whose coordinates a file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Frame {
    /// The part's own, which --transform sets up in the world
    Part,
    /// The world's, in which fixtures stand as well
    World,
}

/// A tool, and the number by which the path knows it.
pub(crate) struct NumberedTool {
    pub(crate) number: Option<u32>,
    /// As given.
    pub(crate) text: String,
    pub(crate) tool: Tool,
}

impl CheckArguments {
    /// Whose coordinates the toolpath has, of a part that is set up elsewhere or not.
    pub(crate) fn frame(&self, is_set_up: bool) -> Result<Frame> {
        let by_machine = self.machine.is_some() && is_set_up;
        ensure!(
            !(by_machine && self.frame == Some(Frame::Part)),
            "with --machine a path has the coordinates of G54, the frame into which --transform sets the part up: leave --frame part out"
        );
        Ok(self.frame.unwrap_or(if by_machine { Frame::World } else { Frame::Part }))
    }

    /// The settings, with defaults that follow the scene.
    pub(crate) fn settings(&self, record: &SceneRecord) -> CheckSettings {
        let clearance = self.scene.clearance.clearance();
        CheckSettings { clearance, ..CheckSettings::of_scene(record, self.contact, self.step) }
    }

    /// `TOOL`, or `NUMBER=TOOL` for each of several.
    pub(crate) fn tools(&self) -> Result<Vec<NumberedTool>> {
        let tools = self.scene.tool.iter().map(|text| {
            let numbered =
                text.split_once('=').and_then(|(number, rest)| Some((number.trim().parse().ok()?, rest)));
            let (number, text) =
                numbered.map_or((None, text.as_str()), |(number, rest)| (Some(number), rest));
            let tool = read_tool(text)?;
            tool.check()?;
            Ok(NumberedTool { number, text: text.to_owned(), tool })
        });
        let tools = tools.collect::<Result<Vec<_>>>()?;
        if tools.len() > 1 && tools.iter().any(|tool| tool.number.is_none()) {
            return Err(CheckError::Tools("several, some of them without a number".into()).into());
        }
        Ok(tools)
    }
}
