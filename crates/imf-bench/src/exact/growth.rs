//! How time and memory grow with the grid, the tool and the number of orientations.

use anyhow::Result;
use imf_cli::picture::{AxisScale, Chart, Series};
use imf_cli::session::{Session, show_bytes};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{SectionPlan, ToolPoints, imf, stream_sections};
use imf_core::tool::Tool;
use serde::Serialize;

use super::ExactArguments;
use crate::document::Document;
use crate::measurement::{peak_memory, reset_peak_memory, seconds};

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

/// An IMF over a set of orientations.
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

pub(super) fn measure(session: &Session, arguments: &ExactArguments) -> Result<Growth> {
    // A closed mesh: its voxels take no time to speak of at any size.
    let part = ReferencePart::ScrewGear;
    let mesh = part.mesh();
    let paper = Tool::paper();
    let orientations = OrientationSet::parse("fibonacci:64")?.orientations;
    let most = if arguments.full { usize::MAX } else { QUICK_SIDE };
    let mut growth =
        Growth { part: part.name(), sizes: Vec::new(), stream_dims: part.dims(), streams: Vec::new() };
    for side in SIDES.into_iter().filter(|&side| side <= most) {
        let mut obstacle = SceneSpec::of_reference(part, &mesh, [side; 3], &paper).scene()?.obstacle;
        for scaled in [false, true] {
            session.note(&format!("sections at {side}³, tool {}", if scaled { "scaled" } else { "fixed" }));
            let factor = if scaled { side as f64 / PAPER_SIDE } else { 1.0 };
            // In a grid of another pitch the same tool spans as many voxels as are wanted.
            obstacle.grid.pitch = 1.0 / factor;
            let needed = SectionPlan::memory_estimate(&obstacle.grid, &paper, session.threads());
            if let Err(error) = session.require_memory(needed, || "use fewer --threads".into()) {
                session.warn(&format!("sections at {side}³ are left out: {error}"));
                continue;
            }
            reset_peak_memory();
            let plan = SectionPlan::new(&obstacle, &paper, ToolPoints::SharpPoints)?;
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
    let obstacle = SceneSpec::of_reference(part, &mesh, growth.stream_dims, &paper).scene()?.obstacle;
    let plan = SectionPlan::new(&obstacle, &paper, ToolPoints::SharpPoints)?;
    let most = if arguments.full { usize::MAX } else { QUICK_ORIENTATIONS };
    for count in ORIENTATIONS.into_iter().filter(|&count| count <= most) {
        session.note(&format!("IMF over {count} orientations"));
        let orientations = OrientationSet::parse(&format!("fibonacci:{count}"))?.orientations;
        reset_peak_memory();
        let (seconds, _) = seconds(|| Ok(imf(&plan, &orientations, session.control(&|_| {}))?))?;
        growth.streams.push(Stream { orientations: count, seconds, peak_bytes: peak_memory() });
    }
    Ok(growth)
}

/// Sections that each thread takes at least, as far as there are orientations: its working memory is made with the first.
const LEAST: usize = 12;

/// Seconds a section on all threads, from as many sections as the budget allows and at least [`LEAST`] a thread.
fn time_sections(session: &Session, plan: &SectionPlan, orientations: &[Orientation]) -> Result<f64> {
    let control = session.control(&|_| {});
    let run = |orientations: &[Orientation]| -> Result<f64> {
        let (time, _) = seconds(|| Ok(stream_sections(plan, orientations, control, || (), |(), _, _| {})?))?;
        Ok(time / orientations.len() as f64)
    };
    // Directions far apart, so that few of them stand for all.
    let spread = |count: usize| -> Vec<Orientation> {
        let step = (orientations.len() / count).max(1);
        orientations.iter().copied().step_by(step).take(count).collect()
    };
    // The first section also makes the plan's tables, once for all others.
    run(&spread(1))?;
    let threads = session.threads().max(1);
    let first = run(&spread(threads))?;
    let count = ((BUDGET / first) as usize).max(LEAST * threads).min(orientations.len());
    run(&spread(count))
}

impl Growth {
    /// Pictures by the names of their files: time and memory against the side of the grid and against the number of
    /// orientations.
    pub(super) fn charts(&self) -> [(&'static str, Chart); 4] {
        let (side, count) = ("voxels along each side of the grid", "orientations");
        let peak = "peak memory, MiB";
        let times = self.by_side(|size| Some(size.seconds_per_section));
        let times = with_line(times, 128.0, "n³ log n", |n| n.powi(3) * n.log2());
        let memory =
            with_line(self.by_side(|size| size.peak_bytes.map(mebibytes)), 384.0, "n³", |n| n.powi(3));
        let imf_times = with_line(self.by_count(|s| Some(s.seconds)), 1e3, "proportional", |n| n);
        let imf_memory = self.by_count(|s| s.peak_bytes.map(mebibytes));
        [
            ("growth.png", chart("Exact sections as the grid grows", side, "seconds a section", times)),
            ("growth-memory.png", chart("Peak memory as the grid grows", side, peak, memory)),
            ("orientations.png", chart("The IMF as orientations grow", count, "seconds", imf_times)),
            (
                "orientations-memory.png",
                chart("Peak memory of the IMF as orientations grow", count, peak, imf_memory),
            ),
        ]
    }

    /// A quantity against the side of the grid, for the fixed tool and the one that grows.
    fn by_side(&self, value: impl Fn(&Size) -> Option<f64>) -> Vec<Series> {
        let series = |(scaled, name): (bool, &str)| Series {
            name: name.into(),
            points: self
                .sizes
                .iter()
                .filter(|size| size.scaled == scaled)
                .filter_map(|size| Some((size.side as f64, value(size)?)))
                .collect(),
            markers: true,
        };
        [(false, "the paper's tool"), (true, "tool scaled with the grid")].map(series).into()
    }

    /// A quantity against the number of orientations.
    fn by_count(&self, value: impl Fn(&Stream) -> Option<f64>) -> Vec<Series> {
        let points = self.streams.iter().filter_map(|s| Some((s.orientations as f64, value(s)?))).collect();
        vec![Series { name: "IMF".into(), points, markers: true }]
    }

    pub(super) fn describe(&self, document: &mut Document) {
        let bytes = |peak: Option<u64>| peak.map_or("unknown".into(), show_bytes);
        document.paragraph(format!("As the grid grows ({} on n³ voxels):", self.part));
        let rows = self.sizes.iter().map(|size| {
            vec![
                size.side.to_string(),
                if size.scaled { "scaled" } else { "29×29×83" }.into(),
                format!("{:.2}", 1.0 / size.seconds_per_section),
                bytes(size.peak_bytes),
                size.method.clone(),
            ]
        });
        document.table(&["n", "tool", "sections/s", "peak memory", "by"], rows.collect());
        let [x, y, z] = self.stream_dims;
        document.paragraph(format!("IMF of the {} at {x}×{y}×{z} as orientations grow:", self.part));
        let rows = self.streams.iter().map(|stream| {
            vec![
                stream.orientations.to_string(),
                format!("{:.2}", stream.seconds),
                format!("{:.0}", stream.orientations as f64 / stream.seconds),
                bytes(stream.peak_bytes),
            ]
        });
        document.table(&["orientations", "seconds", "sections/s", "peak memory"], rows.collect());
    }
}

fn chart(title: &str, x_name: &str, value_name: &str, series: Vec<Series>) -> Chart {
    Chart {
        title: title.into(),
        x_name: x_name.into(),
        x_scale: AxisScale::Logarithmic,
        value_name: value_name.into(),
        value_scale: AxisScale::Logarithmic,
        series,
    }
}

/// The curves with a line of known growth through the last one's point at `at`, or its last point where it ends before.
fn with_line(mut series: Vec<Series>, at: f64, name: &str, growth: impl Fn(f64) -> f64) -> Vec<Series> {
    let line = series.last().and_then(|last| {
        let anchor = last.points.iter().find(|point| point.0 >= at).or(last.points.last())?;
        let scale = anchor.1 / growth(anchor.0);
        let points = last.points.iter().map(|&(n, _)| (n, scale * growth(n))).collect();
        Some(Series { name: name.into(), points, markers: false })
    });
    series.extend(line);
    series
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
