//! The fewest set-ups: how few, whether that is proven, and how long it takes.

use std::sync::Arc;

use anyhow::Result;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::mesh::Mesh;
use imf_core::orientation::{Limits, Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::set_cover::CoverSettings;
use imf_core::surface::{
    CollisionEnvironment, PartSetup, SetupTool, SurfaceAccess, SurfaceSample, SurfaceSamples, SurfaceTool,
    default_tolerance, fewest_setups, reached_in_setups, surface_access,
};
use imf_core::unit::LengthUnit;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use super::{End, PITCH, ShopArguments, THREADS, drawn, mill, voxels};
use crate::document::Document;
use crate::measurement::seconds;
use crate::prismatic::prismatic;

/// Of the cutter, which ends at its holder.
const LENGTH: f64 = 45.0;

/// The fewest set-ups of one part.
#[derive(Serialize)]
pub(super) struct Row {
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

pub(super) fn rows(session: &Session, arguments: &ShopArguments) -> Result<Vec<Row>> {
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build()?;
    let spec = format!("axes+fibonacci:{}", arguments.directions - 6);
    let directions = OrientationSet::parse(&spec)?.orientations;
    let reference = ReferencePart::ALL.into_iter().map(|part| (part.to_string(), part.mesh()));
    let random = (0..u64::from(arguments.parts)).map(|seed| (format!("prismatic {seed}"), prismatic(seed)));
    let mut rows = Vec::new();
    for (name, mesh) in reference.chain(random) {
        session.note(&name);
        let part = SetupCase::new(&pool, &mesh, arguments.points as usize, &directions)?;
        for &percent in &arguments.cover {
            let row = part.row(&pool, name.clone(), percent)?;
            session.note(&format!(
                "  {percent} %: {} set-ups, at least {}, {:.2} s",
                row.setups, row.at_least, row.seconds
            ));
            rows.push(row);
        }
    }
    Ok(rows)
}

/// A part with what each direction reaches of it.
struct SetupCase {
    samples: Vec<SurfaceSample>,
    access: SurfaceAccess,
    directions: Vec<Orientation>,
    setups: Vec<PartSetup>,
    seconds: f64,
}

impl SetupCase {
    fn new(pool: &ThreadPool, mesh: &Mesh, points: usize, directions: &[Orientation]) -> Result<Self> {
        let solid = Arc::new(voxels(mesh)?);
        let samples = drawn(SurfaceSamples::new(mesh, &solid, points).samples, points);
        let surroundings = CollisionEnvironment::new(&solid.into(), &[]).with_surfaces(&[mesh]);
        let tool = SurfaceTool::new(
            &surroundings,
            &mill(End::Flat, 3.0, LENGTH, LENGTH, [12.0, 40.0]).into(),
            default_tolerance(PITCH, LengthUnit::Mm),
        )?;
        let access = || surface_access(&tool, &samples, directions, Control::quiet());
        let (seconds, access) = seconds(|| Ok(pool.install(access)?))?;
        let upright = Limits::parse("cone:0,0,1:0")?;
        let of = |orientation: &Orientation| {
            PartSetup::all(mesh, orientation.direction(), directions, &upright, false)
        };
        let setups = directions.iter().flat_map(of).collect();
        Ok(Self { samples, access, directions: directions.to_vec(), setups, seconds })
    }

    fn row(&self, pool: &ThreadPool, part: String, percent: f64) -> Result<Row> {
        let settings = CoverSettings { fraction: 0.01 * percent, ..CoverSettings::default() };
        let (seconds, plan) = seconds(|| {
            let find = || {
                let tools = [SetupTool { access: &self.access, brought: None }];
                let (samples, setups) = (&self.samples, &self.setups);
                let reached = reached_in_setups(&tools, samples, &self.directions, setups, Control::quiet())?;
                fewest_setups(setups, &reached, &settings, Control::quiet())
            };
            pool.install(find).ok_or_else(|| anyhow::anyhow!("a quiet control never stops"))
        })?;
        Ok(Row {
            part,
            points: self.samples.len(),
            candidates: self.setups.len(),
            percent,
            setups: plan.sets.len(),
            at_least: plan.at_least,
            access_seconds: self.seconds,
            seconds,
        })
    }
}

/// The rows as a table.
pub(super) fn write(rows: &[Row], document: &mut Document) {
    document.section("The fewest set-ups");
    document.paragraph(format!(
        "Every direction is a set-up of a three-axis machine. Flat end mill of 6 mm, {LENGTH} mm out of a holder of 24 mm; voxels of {PITCH} mm."
    ));
    let lines = rows.iter().map(|row| {
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
        lines.collect(),
    );
    let proven = rows.iter().filter(|row| row.setups == row.at_least).count();
    let slowest = rows.iter().map(|row| row.seconds).fold(0.0, f64::max);
    document.paragraph(format!("{proven} of {} are proven; the longest took {slowest:.2} s.", rows.len()));
}
