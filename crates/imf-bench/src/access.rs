//! `imf-bench access`: how much of a surface a tool reaches; points × directions a second.
//!
//! The rival is what one would write oneself: at every contact pose of the ball every solid voxel's centre is put to the
//! tool's solid of revolution. It has the ball's closed form for the pose, and stops at the first centre found.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, ensure};
use clap::Args;
use glam::DVec3;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::surface::{
    CollisionEnvironment, SurfaceAccess, SurfaceSample, SurfaceSamples, SurfaceTool, default_tolerance,
    surface_access,
};
use imf_core::unit::LengthUnit;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::{Machine, ROUNDS, minimum_seconds, seconds};
use crate::shop::{End, mill};

/// Surface access: points and directions a second on one core and on two, beside the direct test
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench access --part bracket\n\n\
                        A 6 mm ball end mill with shank and holder at contact poses on a reference part at its full resolution. \
                        The direct test asks every solid voxel's centre at every pose; it gets some of them. \
                        Writes access.json and access.md. Some seconds.")]
pub(crate) struct AccessArguments {
    /// Reference part at its full resolution
    #[arg(long, default_value = "teapot", value_name = "PART")]
    part: ReferencePart,
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// Points on the surface
    #[arg(long, default_value_t = 7_302, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    points: u32,
}

/// Directions from each point.
const DIRECTIONS: usize = 102;
/// Points and directions that the direct test gets.
const RIVAL_POSES: usize = 4_000;
/// Of ball and shank.
const RADIUS: f64 = 3.0;
/// Heights of the ends of cutter and shank.
const CUTTER: f64 = 20.0;
const SHANK: f64 = 30.0;
/// Radius and length.
const HOLDER: [f64; 2] = [12.0, 40.0];

/// One way to know.
#[derive(Serialize)]
struct Row {
    name: String,
    threads: usize,
    points: usize,
    directions: usize,
    seconds: f64,
    per_second: f64,
    /// How many times longer it takes for the same than ours on one thread.
    ratio: f64,
    how: String,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    /// Fraction of points and directions that are free.
    free: f64,
    /// Seconds for what is made once for a part and a tool: running sums, distances, sphere trees.
    preparation_seconds: f64,
    /// Of those where the two were compared, the fraction with the same verdict.
    agree: f64,
    rows: Vec<Row>,
}

pub(crate) fn run(session: &Session, arguments: &AccessArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(session.threads().max(2));
    let scene = reference_scene(arguments.part, 1.0)?;
    let grid = scene.record.grid;
    let solid = Arc::new(scene.obstacle.clone());
    let mesh = arguments.part.mesh().transformed(&scene.record.transform);
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut samples = SurfaceSamples::new(&mesh, &solid, arguments.points as usize).samples;
    // Each place once: the rivals know of no other.
    samples.dedup_by_key(|sample| sample.point);
    ensure!(samples.len() >= arguments.points as usize, "the surface has only {} samples", samples.len());
    // As many as are wanted, in the surface's order.
    let mut chosen: Vec<usize> = (0..samples.len()).collect();
    chosen.shuffle(&mut random);
    chosen.truncate(arguments.points as usize);
    chosen.sort_unstable();
    samples = chosen.into_iter().map(|index| samples[index]).collect();
    let directions = OrientationSet::parse(&format!("fibonacci:{DIRECTIONS}"))?.orientations;

    let tool = mill(End::Ball, RADIUS, CUTTER, SHANK, HOLDER);
    let tolerance = default_tolerance(grid.pitch, LengthUnit::Mm);
    let body =
        (&CollisionEnvironment::new(&solid.clone().into(), &[]).with_surfaces(&[&mesh]), &tool, tolerance);
    let ours = |pool: &ThreadPool, tool: &SurfaceTool| -> Result<SurfaceAccess> {
        Ok(pool.install(|| surface_access(tool, &samples, &directions, Control::quiet()))?)
    };
    let pool = |threads: usize| ThreadPoolBuilder::new().num_threads(threads).build();
    let [one, two] = [pool(1)?, pool(2)?];
    session.note("surface access");
    let (preparation_seconds, tool) = seconds(|| {
        let tool = SurfaceTool::new(body.0, &body.1.into(), body.2)?;
        let first = samples.first().map_or(&[][..], std::slice::from_ref);
        two.install(|| surface_access(&tool, first, &directions, Control::quiet()))?;
        Ok(tool)
    })?;
    let found = ours(&two, &tool)?;
    let [single, double] = minimum_seconds(
        2 * ROUNDS,
        [&mut || ours(&one, &tool).map(drop), &mut || ours(&two, &tool).map(drop)],
    )?;

    session.note("the direct test");
    let direct = Direct::new(&scene.obstacle, tolerance);
    let pairs: Vec<(usize, usize)> = (0..RIVAL_POSES)
        .map(|_| (random.next_u32() as usize % samples.len(), random.next_u32() as usize % directions.len()))
        .collect();
    let (rival, verdicts) = seconds(|| {
        Ok(pairs.iter().map(|&(s, d)| direct.reaches(&samples[s], &directions[d])).collect::<Vec<bool>>())
    })?;
    let same = pairs.iter().zip(&verdicts).filter(|&(&(s, d), &free)| found.is_free(s, d) == free).count();
    machine.finish();

    let pairs_of = |points: usize, directions: usize| (points * directions) as f64;
    let all = pairs_of(samples.len(), directions.len());
    let row = |name: &str, threads, (points, directions), seconds: f64, how: String| {
        let per_second = pairs_of(points, directions) / seconds;
        Row {
            name: name.into(),
            threads,
            points,
            directions,
            seconds,
            per_second,
            ratio: all / single / per_second,
            how,
        }
    };
    let every = (samples.len(), directions.len());
    let contact = "contact poses: spheres against distances, then runs";
    let rows = vec![
        row("imf", 1, every, single, contact.into()),
        row("imf", 2, every, double, contact.into()),
        row(
            "direct test",
            1,
            (pairs.len(), 1),
            rival,
            format!(
                "{} solid centres at each pose; {} pairs drawn at random",
                direct.centres.len(),
                pairs.len()
            ),
        ),
    ];
    let free = (0..samples.len())
        .flat_map(|sample| (0..directions.len()).map(move |direction| (sample, direction)))
        .filter(|&(sample, direction)| found.is_free(sample, direction))
        .count();
    let [x, y, z] = grid.dims;
    let report = Report {
        machine,
        scene: format!(
            "{} {x}×{y}×{z}, pitch {:.3} mm, ball end mill of 6 mm with shank of 6 and holder of 24 mm, {} points, \
             fibonacci:{}, tolerance {tolerance:.3} mm",
            scene.record.part,
            grid.pitch,
            samples.len(),
            directions.len()
        ),
        free: free as f64 / all,
        preparation_seconds,
        agree: same as f64 / pairs.len() as f64,
        rows,
    };
    report.document().write(&arguments.out, "access", &report)?.show(session, &report)
}

/// Every solid centre against the tool's solid of revolution.
struct Direct {
    centres: Vec<DVec3>,
    tolerance: f64,
}

impl Direct {
    fn new(solid: &imf_core::occupancy::Occupancy, tolerance: f64) -> Self {
        let grid = &solid.grid;
        let voxels = (0..solid.solid.len()).filter(|&index| solid.solid[index] != 0);
        Self { centres: voxels.map(|index| grid.centre(grid.voxel(index))).collect(), tolerance }
    }

    /// The ball touches with the point whose normal is against the surface's: its middle stands a radius outside.
    fn reaches(&self, sample: &SurfaceSample, direction: &Orientation) -> bool {
        let axis = direction.direction();
        if sample.normal.dot(axis) < 0.0 {
            return false;
        }
        let middle = sample.point + sample.normal * RADIUS;
        let inside = RADIUS - self.tolerance;
        let holds = |centre: &DVec3| {
            let offset = *centre - middle;
            let up = offset.dot(axis);
            let height = up + RADIUS;
            let across = offset.length_squared() - up * up;
            if height < CUTTER {
                if up < 0.0 { offset.length_squared() < inside * inside } else { across < inside * inside }
            } else {
                let radius = if height < SHANK { RADIUS } else { HOLDER[0] };
                height < SHANK + HOLDER[1] && across <= radius * radius
            }
        };
        !self.centres.iter().any(holds)
    }
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("Surface access");
        document.paragraph(format!("{}\n{}", self.scene, self.machine));
        let rows = self.rows.iter().map(|row| {
            vec![
                row.name.clone(),
                row.threads.to_string(),
                (row.points * row.directions).to_string(),
                format!("{:.3}", row.seconds),
                format!("{:.0}", row.per_second),
                format!("{:.2}", row.ratio),
                row.how.clone(),
            ]
        });
        document.table(
            &["", "threads", "points × directions", "seconds", "a second", "times ours on one", "how"],
            rows.collect(),
        );
        document.paragraph(format!(
            "{:.1} % are free. Made once for part and tool: {:.3} s. The direct test has the same verdict for {:.2} % of its pairs.",
            100.0 * self.free, self.preparation_seconds, 100.0 * self.agree
        ));
        document
    }
}
