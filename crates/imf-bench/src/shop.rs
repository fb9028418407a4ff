//! `imf-bench shop`: what a shop asks of whole parts. The fewest set-ups: how few, whether that is proven, and how long it takes. The stock
//! along a path: how long a segment takes.

mod stock;

use std::sync::Arc;

use anyhow::{Result, ensure};
use glam::DVec3;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::orientation::{Limits, Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::set_cover::CoverSettings;
use imf_core::surface::{
    CollisionEnvironment, PartSetup, SurfaceAccess, SurfaceSample, SurfaceSamples, SurfaceTool,
    default_tolerance, fewest_setups, surface_access,
};
use imf_core::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
use imf_core::unit::LengthUnit;
use imf_core::voxelize::voxelize;
use rand::SeedableRng;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use crate::arguments::shop::ShopArguments;
use crate::document::Document;
use crate::measurement::{Machine, seconds};
use crate::prismatic::prismatic;

/// Threads that the figures are for.
const THREADS: usize = 2;
/// Millimetres.
const PITCH: f64 = 1.0;
/// Radii of the flat end mill and its holder, and heights of the ends of cutter and holder.
const CUTTER: (f64, f64) = (3.0, 45.0);
const HOLDER: (f64, f64) = (12.0, 85.0);

/// The fewest set-ups of one part.
#[derive(Serialize)]
struct Row {
    part: String,
    points: usize,
    candidates: usize,
    /// Of what all candidates reach together.
    percent: f64,
    setups: usize,
    at_least: usize,
    /// Of what the plan is made from: which sample each direction reaches.
    access_seconds: f64,
    seconds: f64,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    setups: Vec<Row>,
    stock: Vec<stock::Row>,
}

pub(crate) fn run(session: &Session, arguments: &ShopArguments) -> Result<()> {
    ensure!(
        arguments.cover.iter().all(|percent| *percent > 0.0 && *percent <= 100.0),
        "--cover takes percentages above 0 and at most 100, such as 100,99.5"
    );
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(THREADS);
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build()?;
    let spec = format!("axes+fibonacci:{}", arguments.directions - 6);
    let directions = OrientationSet::parse(&spec)?.orientations;
    let reference = ReferencePart::ALL.into_iter().map(|part| (part.to_string(), part.mesh()));
    let random = (0..u64::from(arguments.parts)).map(|seed| (format!("prismatic {seed}"), prismatic(seed)));
    let mut rows = Vec::new();
    for (name, mesh) in reference.chain(random) {
        session.note(&name);
        let part = Asked::new(&pool, &mesh, arguments.points as usize, &directions)?;
        for &percent in &arguments.cover {
            let row = part.row(&pool, name.clone(), percent)?;
            session.note(&format!(
                "  {percent} %: {} set-ups, at least {}, {:.2} s",
                row.setups, row.at_least, row.seconds
            ));
            rows.push(row);
        }
    }
    session.note("stock in process");
    let stock = stock::rows()?;
    machine.finish();
    let report = Report { machine, setups: rows, stock };
    let document = report.document();
    document.write(&arguments.out, "shop", &report)?;
    document.show(session, &report)
}

/// A part with what each direction reaches of it.
struct Asked {
    samples: Vec<SurfaceSample>,
    access: SurfaceAccess,
    setups: Vec<PartSetup>,
    seconds: f64,
}

impl Asked {
    fn new(pool: &ThreadPool, mesh: &Mesh, points: usize, directions: &[Orientation]) -> Result<Self> {
        let (lower, upper) = mesh.bounds().unwrap_or_default();
        // Off the part's own planes, as a user's part lies.
        let shift = DVec3::new(0.37, 0.21, 0.13) * PITCH;
        let grid = Grid::with_pitch(lower - shift, upper + shift, PITCH, 1)?;
        let solid = Arc::new(voxelize(mesh, &grid, false));
        let samples = SurfaceSamples::new(mesh, &solid, points).samples;
        // As many as are asked for.
        let mut chosen: Vec<usize> = (0..samples.len()).collect();
        chosen.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
        chosen.truncate(points);
        let samples: Vec<SurfaceSample> = chosen.into_iter().map(|index| samples[index]).collect();
        let surroundings = CollisionEnvironment::new(&solid.into(), &[]);
        let tool = SurfaceTool::new(
            &surroundings,
            &flat_end_mill().into(),
            default_tolerance(PITCH, LengthUnit::Mm),
        )?;
        let access = || surface_access(&tool, &samples, directions, Control::quiet());
        let (seconds, access) = seconds(|| Ok(pool.install(access)?))?;
        let upright = Limits::parse("cone:0,0,1:0")?;
        let of =
            |orientation: &Orientation| PartSetup::all(mesh, orientation.direction(), directions, &upright);
        let setups = directions.iter().flat_map(of).collect();
        Ok(Self { samples, access, setups, seconds })
    }

    fn row(&self, pool: &ThreadPool, part: String, percent: f64) -> Result<Row> {
        let settings = CoverSettings { fraction: 0.01 * percent, ..CoverSettings::default() };
        let (seconds, plan) = seconds(|| {
            let find =
                || fewest_setups(&[&self.access], &self.samples, &self.setups, &settings, Control::quiet());
            pool.install(find).ok_or_else(|| anyhow::anyhow!("a quiet control never stops"))
        })?;
        Ok(Row {
            part,
            points: self.samples.len(),
            candidates: self.setups.len(),
            percent,
            setups: plan.setups.len(),
            at_least: plan.at_least,
            access_seconds: self.seconds,
            seconds,
        })
    }
}

fn flat_end_mill() -> Tool {
    let cylinder = |kind, from, (radius, to): (f64, f64)| Element {
        kind,
        profile: vec![Segment::Line { from, to, radius_from: radius, radius_to: radius }],
    };
    Tool {
        name: "flat6".into(),
        unit: LengthUnit::Mm,
        shape: ToolShape::Revolved(vec![
            cylinder(ElementKind::Cutter, 0.0, CUTTER),
            cylinder(ElementKind::Holder(0), CUTTER.1, HOLDER),
        ]),
        sharp_points: SharpPoints::Tip,
        overall_length: None,
    }
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("What a shop asks");
        document.paragraph(self.machine.to_string());
        document.section("The fewest set-ups");
        document.paragraph(format!(
            "Every direction is a set-up of a three-axis machine. Flat end mill of 6 mm, {} mm out of a holder of 24 mm; voxels of {PITCH} mm.",
            CUTTER.1
        ));
        let rows = self.setups.iter().map(|row| {
            let proof = match row.setups - row.at_least {
                0 => "proven".to_owned(),
                _ => format!("at least {}", row.at_least),
            };
            vec![
                row.part.clone(),
                format!("{} × {}", row.candidates, row.points),
                format!("{}", row.percent),
                row.setups.to_string(),
                proof,
                format!("{:.2}", row.access_seconds),
                format!("{:.2}", row.seconds),
            ]
        });
        document.table(
            &["part", "candidates × points", "%", "set-ups", "", "access, s", "set-ups, s"],
            rows.collect(),
        );
        let proven = self.setups.iter().filter(|row| row.setups == row.at_least).count();
        let slowest = self.setups.iter().map(|row| row.seconds).fold(0.0, f64::max);
        document.paragraph(format!(
            "{proven} of {} are proven; the longest took {slowest:.2} s.",
            self.setups.len()
        ));
        stock::tell(&self.stock, &mut document);
        document
    }
}
