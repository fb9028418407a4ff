//! Arguments of `imf access` and `imf crib`.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::Args;
use glam::DVec3;
use imf_core::machine::{AxisLimits, Machine};
use imf_core::orientation::Limits;
use imf_core::surface::default_tolerance;
use imf_core::unit::LengthUnit;

use super::clearance::ContactArguments;
use super::fixture::{StockArgument, parse_stock};
use super::numbers::{number, parse_length, parse_threshold, three};
use super::scene::SceneArguments;

/// What is to be reached, and from which directions.
#[derive(Args)]
pub(crate) struct ReachArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// A set of directions, see below; by default axes+normals+fibonacci:225, or axes+normals+so3:500 where a tool is not round
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) orientations: Option<String>,
    /// Only orientations that the machine reaches, and what a fixed axis leaves of all others: ac:A0:A1:C0:C1, bc:B0:B1:C0:C1 or
    /// cone:X,Y,Z:HALF_ANGLE
    #[arg(long, value_name = "LIMITS", value_parser = Limits::parse)]
    pub(crate) limits: Option<Limits>,
    /// The machine, in TOML: only directions that its rotary axes reach, with their angles in rotary_angles.csv, and of the
    /// surface only what it reaches within its travel, its head and table out of the way
    #[arg(long, value_name = "FILE", conflicts_with = "limits")]
    pub(crate) machine: Option<PathBuf>,
    /// How deep the cutter may cut below the part's surface and still count as touching it, and a shank stand in it; by default 0.05 mm,
    /// but no less than a tenth of the pitch and no more than a quarter of it
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    pub(crate) tolerance: Option<f64>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// What the tools reach: accessible space, best directions, removable stock, the part's surface
#[derive(Args)]
#[command(after_help = super::orientations::after(
    "Examples:\n  imf access teapot --out access\n  imf access part.stl --unit mm --pitch 0.5 --tool \
                  short.toml --tool long.toml --fixture vise.stl@translate:0,0,-20 --limits ac:-30:120:-360:360 \
                  --removable --stock box:2 --out access\n\n\
                  Writes surface.vtp and surface.ply (ParaView, MeshLab: what is reached of the surface, and why the rest is not), surface.png, imf.vti \
                  (ParaView) and the same fields as .npy, slices.png, orientations.csv and summary.json; with --removable removable.vti and .npy (0 no stock, \
                  1 out of reach, 2 removed, 3 part or fixture, 4 not decided; its grid is that of the stock in summary.json), with --certify any_direction.npy (0 solid, \
                  1 reached, 2 by another direction, 3 by none, 4 not known) and any_direction.csv (tip and axis of a free pose for each 2, of several tools its number), with --map \
                  map.png and map.npy.\n\
                  map.npy is [1, longitude, latitude] by cells, θ from 0° up, φ from 180° down.\n\
                  Machine limits, in degrees: ac: d = Rz(C) Rx(A) z, bc: d = Rz(C) Ry(B) z, d from tip to holder."
))]
pub(crate) struct AccessArguments {
    #[command(flatten)]
    pub(crate) reach: ReachArguments,
    /// The fewest set-ups that reach the surface, proven, on a machine with this range of directions in each: by default that of
    /// --machine, or of a three-axis machine; else ac:A0:A1:C0:C1, bc:B0:B1:C0:C1 or cone:0,0,1:HALF_ANGLE. With --stock they remove
    /// the stock as well. With --machine the part stands with the middle of its foot on the zero of G54
    #[arg(long, value_name = "LIMITS", num_args = 0..=1, conflicts_with = "limits", value_parser = Limits::parse)]
    pub(crate) setups: Option<Option<Limits>>,
    /// The percentage that the set-ups must reach of what all of them together would
    #[arg(long, default_value_t = 100.0, value_name = "PERCENT", requires = "setups", value_parser = parse_percent)]
    pub(crate) cover: f64,
    /// The shortest stick-out with which each tool reaches the surface, its holder moved along its shank
    #[arg(long)]
    pub(crate) stickout: bool,
    /// Largest collision measure of a pose that counts as free; 0 is exact. For the space and the stock, not for the surface
    #[arg(long, default_value_t = 0.0, value_name = "τ", value_parser = parse_threshold)]
    pub(crate) tau: f64,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    /// Voxels around the scene's grid that are examined too
    #[arg(long, default_value_t = 1, value_name = "VOXELS")]
    pub(crate) border: usize,
    /// Of the places that none of the directions reaches, which ones any other does, and which none whatever: proven
    #[arg(long, conflicts_with_all = ["limits", "machine", "tau"])]
    pub(crate) certify: bool,
    /// The stock that a cutter covers at some free pose
    #[arg(long)]
    pub(crate) removable: bool,
    /// What is cut, for --removable: box (the default), box:MARGIN around the part, or a file in the part's frame, set up with it;
    /// FILE@STEPS as for --fixture
    #[arg(long, value_name = "STOCK", value_parser = parse_stock)]
    pub(crate) stock: Option<StockArgument>,
    /// Measure of every direction at this point in the world's frame, drawn over longitude and latitude
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub(crate) map: Option<DVec3>,
    /// Cells of the map in degrees
    #[arg(long, default_value_t = 5.0, value_name = "DEGREES", requires = "map", value_parser = parse_map_step)]
    pub(crate) map_step: f64,
    /// A page with the part in 3D, coloured by what is reached: one file that a browser opens without network
    #[arg(long, value_name = "FILE")]
    pub(crate) html: Option<PathBuf>,
}

/// Which tools serve which part of the surface, the fewest that cover it, and what none reaches
#[derive(Args)]
#[command(
    mut_arg("tool", |tool| tool.required(true).num_args(1..).value_name("PATH").help(
        "Tools to choose from: files as of imf access, folders of them, whole libraries of FreeCAD and Fusion"
    )),
    after_help = super::orientations::after(
        "Examples:\n  imf crib part.stl --unit mm --tool tools/ --out crib\n  imf crib teapot --tool library.json --cover 99 --out crib\n\n\
         Writes surface.ply (which tools reach each triangle), crib.csv (a line for each tool) and summary.json. The surface alone is decided."
    )
)]
pub(crate) struct CribArguments {
    #[command(flatten)]
    pub(crate) reach: ReachArguments,
    /// The percentage that the fewest tools must reach of what all of them together would
    #[arg(long, default_value_t = 100.0, value_name = "PERCENT", value_parser = parse_percent)]
    pub(crate) cover: f64,
}

impl ReachArguments {
    /// The machine, and which directions its axes reach.
    pub(crate) fn machine(&self) -> Result<Option<(Machine, AxisLimits)>> {
        let Some(path) = &self.machine else { return Ok(None) };
        let machine = Machine::read(path)?;
        let limits = machine.limits().with_context(|| {
            format!(
                "{}: its rotary axes are not such that one turns the part about z and the other tilts about x or y, which \
                 directions are limited by here: give the directions yourself (--orientations)",
                path.display()
            )
        })?;
        Ok(Some((machine, limits)))
    }

    /// How deep the cutter may cut, by default as the pitch is.
    pub(crate) fn tolerance_at(&self, pitch: f64, unit: LengthUnit) -> f64 {
        self.tolerance.unwrap_or_else(|| default_tolerance(pitch, unit))
    }
}

impl AccessArguments {
    /// What a machine reaches in one set-up, where the fewest are sought; `reached` is that of the machine.
    pub(crate) fn setup_range(&self, reached: Option<AxisLimits>) -> Option<AxisLimits> {
        let three_axes = Limits::Cone { axis: DVec3::Z, half_angle: 0.0 };
        let given = self.setups?;
        Some(given.map(AxisLimits::from).or(reached).unwrap_or_else(|| three_axes.into()))
    }

    /// The limits on directions: those of the machine, unless each set-up has them.
    pub(crate) fn limits(&self, reached: Option<Limits>) -> Option<Limits> {
        self.reach.limits.or_else(|| reached.filter(|_| self.setups.is_none()))
    }
}

fn parse_point(text: &str) -> Result<DVec3, String> {
    three(text, |v: &f64| v.is_finite(), "three numbers such as 10,0,25.5").map(DVec3::from_array)
}

fn parse_map_step(text: &str) -> Result<f64, String> {
    number(text, |step| (0.25..=90.0).contains(step), "from 0.25 to 90 degrees")
}

fn parse_percent(text: &str) -> Result<f64, String> {
    let wanted = "a percentage above 0 and at most 100, such as 99.5";
    number(text, |&percent| percent > 0.0 && percent <= 100.0, wanted)
}
