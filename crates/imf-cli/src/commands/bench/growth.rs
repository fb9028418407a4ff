//! How time and memory grow with the grid, the tool and the number of orientations.

use std::fmt;
use std::time::Instant;

use anyhow::Result;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::section::{SectionPlan, imf, stream_sections};
use imf_core::tool::Tool;
use serde::Serialize;

use super::machine::{peak_memory, reset_peak_memory};
use super::scene;
use crate::arguments::ExactBenchArguments;
use crate::picture::{AxisScale, Chart, Series};
use crate::session::{Session, show_bytes};

/// Voxels along each side of the grid.
const SIDES: [usize; 8] = [32, 64, 96, 128, 192, 256, 320, 384];
/// Largest side without `--full`.
const QUICK_SIDE: usize = 192;
/// Numbers of orientations.
const ORIENTATIONS: [usize; 5] = [1, 10, 100, 1_000, 10_000];
/// Largest number without `--full`.
const QUICK_ORIENTATIONS: usize = 1_000;
/// The side at which both tools are the same: the teapot's longest.
const PAPER_SIDE: f64 = 121.0;
/// Seconds to spend on a size, beyond one section a thread.
const BUDGET: f64 = 2.0;

/// Sections at one size.
#[derive(Serialize)]
struct Size {
    side: usize,
    /// True where the tool grows with the grid; else it is the paper's.
    scaled: bool,
    seconds_per_section: f64,
    peak_bytes: Option<u64>,
    method: String,
}

/// An IMF over so many orientations.
#[derive(Serialize)]
struct Stream {
    orientations: usize,
    seconds: f64,
    peak_bytes: Option<u64>,
}

/// All of it.
#[derive(Serialize)]
pub(super) struct Growth {
    part: &'static str,
    sizes: Vec<Size>,
    stream_dims: [usize; 3],
    streams: Vec<Stream>,
}

pub(super) fn measure(session: &Session, arguments: &ExactBenchArguments) -> Result<Growth> {
    // A closed mesh: its voxels take no time to speak of at any size.
    let part = ReferencePart::ScrewGear;
    let mesh = part.mesh();
    let paper = Tool::paper();
    let orientations = OrientationSet::parse("fibonacci:64")?.orientations;
    let most = if arguments.full { usize::MAX } else { QUICK_SIDE };
    let mut growth =
        Growth { part: part.name(), sizes: Vec::new(), stream_dims: part.dims(), streams: Vec::new() };
    for side in SIDES.into_iter().filter(|&side| side <= most) {
        let mut obstacle = scene(part, &mesh, [side; 3], &paper)?.obstacle;
        for scaled in [false, true] {
            session.note(&format!("sections at {side}³, tool {}", if scaled { "scaled" } else { "fixed" }));
            let factor = if scaled { side as f64 / PAPER_SIDE } else { 1.0 };
            // In a grid of another pitch the same tool spans as many voxels as are asked for.
            obstacle.grid.pitch = 1.0 / factor;
            let needed = SectionPlan::memory_estimate(&obstacle.grid, &paper, session.threads());
            if let Err(error) = session.require_memory(needed, || "use fewer --threads".into()) {
                session.warn(&format!("sections at {side}³ are left out: {error}"));
                continue;
            }
            reset_peak_memory();
            let plan = SectionPlan::new(&obstacle, &paper)?;
            let seconds_per_section = time_sections(session, &plan, &orientations)?;
            growth.sizes.push(Size {
                side,
                scaled,
                seconds_per_section,
                peak_bytes: peak_memory(),
                method: plan.describe(),
            });
        }
    }
    let obstacle = scene(part, &mesh, growth.stream_dims, &paper)?.obstacle;
    let plan = SectionPlan::new(&obstacle, &paper)?;
    let most = if arguments.full { usize::MAX } else { QUICK_ORIENTATIONS };
    for count in ORIENTATIONS.into_iter().filter(|&count| count <= most) {
        session.note(&format!("IMF over {count} orientations"));
        let orientations = OrientationSet::parse(&format!("fibonacci:{count}"))?.orientations;
        reset_peak_memory();
        let start = Instant::now();
        imf(&plan, &orientations, session.control(&|_| {}))?;
        let seconds = start.elapsed().as_secs_f64();
        growth.streams.push(Stream { orientations: count, seconds, peak_bytes: peak_memory() });
    }
    Ok(growth)
}

/// Seconds a section on all threads, from as many sections as the budget allows and at least one a thread.
fn time_sections(session: &Session, plan: &SectionPlan, orientations: &[Orientation]) -> Result<f64> {
    let run = |orientations: &[Orientation]| -> Result<f64> {
        let start = Instant::now();
        stream_sections(plan, orientations, session.control(&|_| {}), || (), |(), _, _| {})?;
        Ok(start.elapsed().as_secs_f64() / orientations.len() as f64)
    };
    // Directions far apart, so that few of them stand for all.
    let spread = |count: usize| -> Vec<Orientation> {
        let step = (orientations.len() / count).max(1);
        orientations.iter().copied().step_by(step).take(count).collect()
    };
    // The first section also makes the plan's tables, once for all others.
    run(&spread(1))?;
    let few = session.threads().clamp(1, orientations.len());
    let first = run(&spread(few))?;
    let count = ((BUDGET / first) as usize).clamp(few, orientations.len());
    if count > few { run(&spread(count)) } else { Ok(first) }
}

impl Growth {
    /// Time against the side of the grid, with the line of n³ log n through the scaled tool's point at 128³.
    pub(super) fn chart(&self) -> Chart {
        let series = |scaled: bool, name: &str| Series {
            name: name.into(),
            points: self
                .sizes
                .iter()
                .filter(|size| size.scaled == scaled)
                .map(|size| (size.side as f64, size.seconds_per_section))
                .collect(),
            markers: true,
        };
        let (fixed, scaled) = (series(false, "the paper's tool"), series(true, "tool scaled with the grid"));
        let growth = |side: f64| side.powi(3) * side.log2();
        let anchor =
            scaled.points.iter().copied().find(|&(side, _)| side >= 128.0).or(scaled.points.last().copied());
        let line = anchor.map(|(at, seconds)| Series {
            name: "n³ log n".into(),
            points: scaled.points.iter().map(|&(n, _)| (n, seconds * growth(n) / growth(at))).collect(),
            markers: false,
        });
        Chart {
            title: "Exact sections as the grid grows".into(),
            x_name: "voxels along each side of the grid".into(),
            value_name: "seconds a section".into(),
            value_scale: AxisScale::Logarithmic,
            series: [fixed, scaled].into_iter().chain(line).collect(),
        }
    }
}

fn bytes(peak: Option<u64>) -> String {
    peak.map_or("unknown".into(), show_bytes)
}

impl fmt::Display for Growth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "As the grid grows ({} on n³ voxels):\n", self.part)?;
        writeln!(f, "| n | tool | sections/s | peak memory | by |\n| --- | --- | --- | --- | --- |")?;
        for size in &self.sizes {
            writeln!(
                f,
                "| {} | {} | {:.2} | {} | {} |",
                size.side,
                if size.scaled { "scaled" } else { "29×29×83" },
                1.0 / size.seconds_per_section,
                bytes(size.peak_bytes),
                size.method
            )?;
        }
        let [x, y, z] = self.stream_dims;
        writeln!(f, "\nIMF of the {} at {x}×{y}×{z} as orientations grow:\n", self.part)?;
        writeln!(f, "| orientations | seconds | sections/s | peak memory |\n| --- | --- | --- | --- |")?;
        for stream in &self.streams {
            writeln!(
                f,
                "| {} | {:.2} | {:.0} | {} |",
                stream.orientations,
                stream.seconds,
                stream.orientations as f64 / stream.seconds,
                bytes(stream.peak_bytes)
            )?;
        }
        Ok(())
    }
}
