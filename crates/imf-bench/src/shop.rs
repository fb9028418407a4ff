//! `imf-bench shop`: what a shop asks of whole parts, each question with its goal's figures.

mod crib;
mod machine;
mod setups;
mod stick_out;
mod stock;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use glam::DVec3;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::surface::{CollisionEnvironment, SurfaceSample, SurfaceSamples, default_tolerance};
use imf_core::tool::{Clearance, ElementKind, Segment, Tool};
use imf_core::unit::LengthUnit;
use imf_core::voxelize::voxelize;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::Machine;

/// What a shop asks: the fewest set-ups, the least stick-outs, a crib of tools, a machine's poses, the stock along a path
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench shop --out shop\n\n\
                        Set-ups: of reference parts and random prismatic parts, every direction a set-up of a three-axis machine with a 6 mm \
                        flat end mill. Stick-out and crib, on one reference part: a 6 mm ball end mill whose 24 mm holder slides, held \
                        against exact counts, and balls, flat ends and bull noses in several holders. Machine: the bracket on a trunnion, \
                        one thread. Stock: a block of 256³ voxels, one thread. Writes shop.json and shop.md. Some minutes.")]
pub(crate) struct ShopArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// These alone; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "QUESTION")]
    only: Vec<ShopCase>,
    /// Random prismatic parts, beside the reference parts
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000))]
    parts: u32,
    /// Points on the surface of which set-ups are chosen
    #[arg(long, default_value_t = 2_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    points: u32,
    /// Directions, each a candidate set-up
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(7..10_000))]
    directions: u32,
    /// Per cent to cover of what all candidates reach; several with commas
    #[arg(long, value_delimiter = ',', default_value = "100,99", value_name = "PERCENT")]
    cover: Vec<f64>,
    /// Reference part of stick-outs and crib, at its full resolution
    #[arg(long, default_value = "teapot", value_name = "PART")]
    part: ReferencePart,
    /// Points on its surface
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    surface_points: u32,
    /// Stick-outs that are held against exact counts
    #[arg(long, default_value_t = 100_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    checks: u32,
    /// Tools of the crib
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..10_000))]
    tools: u32,
    /// Tools of the crib whose verdicts are found one by one too
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    alone: u32,
    /// Lines of the machine's path
    #[arg(long, default_value_t = 500_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    lines: u32,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ShopCase {
    Setups,
    StickOut,
    Crib,
    Machine,
    Stock,
}

impl ShopArguments {
    fn runs(&self, question: ShopCase) -> bool {
        self.only.is_empty() || self.only.contains(&question)
    }
}

/// Threads that the figures are for, but those of the machine's poses.
const THREADS: usize = 2;
/// Around shank and holder, in millimetres.
const CLEARANCE: f64 = 0.5;

#[derive(Serialize)]
struct Report {
    machine: Machine,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    setups: Vec<setups::Row>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stick_out: Option<stick_out::Row>,
    #[serde(skip_serializing_if = "Option::is_none")]
    crib: Option<crib::Row>,
    #[serde(skip_serializing_if = "Option::is_none")]
    machine_poses: Option<machine::Row>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    stock: Vec<stock::Row>,
}

pub(crate) fn run(session: &Session, arguments: &ShopArguments) -> Result<()> {
    ensure!(
        arguments.cover.iter().all(|percent| *percent > 0.0 && *percent <= 100.0),
        "--cover takes percentages above 0 and at most 100, such as 100,99.5"
    );
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(THREADS);
    let setups =
        if arguments.runs(ShopCase::Setups) { setups::rows(session, arguments)? } else { Vec::new() };
    let surface = (arguments.runs(ShopCase::StickOut) || arguments.runs(ShopCase::Crib))
        .then(|| Surface::new(arguments))
        .transpose()?;
    let of_surface = |question| surface.as_ref().filter(|_| arguments.runs(question));
    let stick_out = of_surface(ShopCase::StickOut)
        .map(|surface| stick_out::Row::new(session, surface, arguments))
        .transpose()?;
    let crib =
        of_surface(ShopCase::Crib).map(|surface| crib::Row::new(session, surface, arguments)).transpose()?;
    let machine_poses =
        arguments.runs(ShopCase::Machine).then(|| machine::Row::new(session, arguments)).transpose()?;
    let stock = if arguments.runs(ShopCase::Stock) { stock::rows()? } else { Vec::new() };
    machine.finish();
    let report = Report { machine, setups, stick_out, crib, machine_poses, stock };
    report.document().write(&arguments.out, "shop", &report)?.show(session, &report)
}

/// A reference part's surface, for stick-outs and a crib.
struct Surface {
    name: String,
    pool: ThreadPool,
    samples: Vec<SurfaceSample>,
    directions: Vec<Orientation>,
    solid: Arc<Occupancy>,
    surroundings: CollisionEnvironment,
    tolerance: f64,
}

impl Surface {
    fn new(arguments: &ShopArguments) -> Result<Self> {
        let scene = reference_scene(arguments.part, 1.0)?;
        let grid = scene.record.grid;
        let solid = Arc::new(scene.obstacle.clone());
        let mesh = arguments.part.mesh().transformed(&scene.record.transform);
        let points = arguments.surface_points as usize;
        let samples = drawn(SurfaceSamples::new(&mesh, &solid, points).samples, points);
        ensure!(samples.len() == points, "the surface has only {} samples", samples.len());
        let directions = OrientationSet::parse(&format!("fibonacci:{}", arguments.directions))?.orientations;
        let tolerance = default_tolerance(grid.pitch, LengthUnit::Mm);
        let [x, y, z] = grid.dims;
        let name = format!(
            "{} {x}×{y}×{z}, pitch {:.3} mm, {points} points × {} directions, clearance {CLEARANCE} mm, tolerance {tolerance:.3} mm",
            scene.record.part,
            grid.pitch,
            directions.len(),
        );
        Ok(Self {
            name,
            pool: ThreadPoolBuilder::new().num_threads(THREADS).build()?,
            samples,
            directions,
            surroundings: CollisionEnvironment::new(&solid.clone().into(), &[]).with_surfaces(&[&mesh]),
            solid,
            tolerance,
        })
    }
}

/// Edge of a voxel of what follows, in millimetres.
const PITCH: f64 = 1.0;

/// A mesh as voxels that lie off its own planes, as a user's part does.
fn voxels(mesh: &Mesh) -> Result<Occupancy> {
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let shift = DVec3::new(0.37, 0.21, 0.13) * PITCH;
    let grid = Grid::with_pitch(lower - shift, upper + shift, PITCH, 1)?;
    Ok(voxelize(mesh, &grid, false))
}

/// As many as are wanted, the same ones every time.
fn drawn<T>(mut all: Vec<T>, count: usize) -> Vec<T> {
    all.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
    all.truncate(count);
    all
}

fn clearance() -> Clearance {
    Clearance::around_holder_and_shank(CLEARANCE)
}

/// The end of a cutter.
#[derive(Clone, Copy)]
pub(crate) enum End {
    Ball,
    Flat,
    /// With a corner of a fifth of the radius.
    Bull,
}

/// A plain mill in a plain holder of the given radius and length; the shank is the part between flutes and holder.
pub(crate) fn mill(end: End, radius: f64, flutes: f64, stick_out: f64, [holder, long]: [f64; 2]) -> Tool {
    let corner = match end {
        End::Ball => radius,
        End::Flat => 0.0,
        End::Bull => 0.2 * radius,
    };
    let arc = Segment::Arc {
        from: 0.0,
        to: corner,
        centre_height: corner,
        centre_radius: radius - corner,
        arc_radius: corner,
    };
    let side = Segment::cylinder(corner, flutes, radius);
    let cutter = if corner > 0.0 { vec![arc, side] } else { vec![side] };
    let mut elements = vec![(ElementKind::Cutter, cutter)];
    if stick_out > flutes {
        elements.push((ElementKind::Shank, vec![Segment::cylinder(flutes, stick_out, radius)]));
    }
    elements.push((ElementKind::Holder(0), vec![Segment::cylinder(stick_out, stick_out + long, holder)]));
    Tool::revolved(format!("{}", 2.0 * radius), elements)
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("What a shop asks");
        document.paragraph(self.machine.to_string());
        if !self.setups.is_empty() {
            setups::write(&self.setups, &mut document);
        }
        self.stick_out.iter().for_each(|row| row.write(&mut document));
        self.crib.iter().for_each(|row| row.write(&mut document));
        self.machine_poses.iter().for_each(|row| row.write(&mut document));
        if !self.stock.is_empty() {
            stock::tell(&self.stock, &mut document);
        }
        document
    }
}

/// A table of names and values.
fn table(document: &mut Document, rows: &[(&str, String)]) {
    document
        .table(&["", ""], rows.iter().map(|(name, value)| vec![(*name).to_owned(), value.clone()]).collect());
}
