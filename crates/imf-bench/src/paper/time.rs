//! The table of time: training, 225 sections by the network and exactly on the same device in the same run, and what
//! everything takes in memory.

use anyhow::Result;
use imf_cli::engine::Device;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{SectionPlan, ToolPoints, stream_sections};
use imf_fields::siren::over_grid;
use imf_gpu::GpuSections;
use serde::{Deserialize, Serialize};

use super::published::PAPER;
use super::table::{Kind, PaperComparison, Row, Table};
use super::{Bench, Run, Training, part_label};
use crate::cells::Cell;
use crate::measurement::seconds;
use crate::recipe::Recipe;

/// The sections that the paper evaluates.
const SECTIONS: &str = "grid:15";
/// The network's sections that are timed at most where all of them take minutes; their time is scaled up.
const TIMED: usize = 9;
/// Seconds for all sections above which they are scaled up.
const MINUTES: f64 = 120.0;
/// Bytes of a sample: its voxel and its value.
const SAMPLE_BYTES: u64 = 8;

/// Seconds for all sections, and what they and the network take.
#[derive(Serialize, Deserialize)]
struct TimingResult {
    network: f64,
    exact_cpu: f64,
    /// On the GPU where networks run there.
    exact_gpu: Option<f64>,
    network_bytes: u64,
    sections_bytes: u64,
}

/// Any weights take as long as those that were learnt.
fn measure(bench: &Bench<'_>, recipe: &Recipe) -> Result<TimingResult> {
    let session = bench.session;
    let (scene, shape) = (bench.scene(&recipe.scene)?, recipe.network.shape());
    let grid = scene.record.grid;
    let set = OrientationSet::parse(SECTIONS)?.orientations;
    let plan = SectionPlan::of_scene(&scene, ToolPoints::Tip)?;
    let stage = session.stage("timing", "sections", 3 * set.len() as u64);
    let advance = |n| stage.advance(n);
    let control = session.control(&advance);
    let mut engine = bench.device.evaluator(shape, &shape.initial_parameters(0))?;
    let mut section = |orientation: &Orientation, values: &mut [f32]| {
        over_grid::section(engine.as_mut(), &grid, orientation.angles(), values)
    };
    let mut values = vec![0.0; grid.len()];
    // Twice before, so that nothing is compiled or allocated while the clock runs.
    section(&set[0], &mut values)?;
    let (one, ()) = seconds(|| Ok(section(&set[0], &mut values)?))?;
    let timed = if one * set.len() as f64 > MINUTES { TIMED } else { set.len() };
    let each = set.len() / timed;
    let (network, ()) = seconds(|| {
        for orientation in set.iter().step_by(each) {
            control.check()?;
            section(orientation, &mut values)?;
            advance(each as u64);
        }
        Ok(())
    })?;
    let network = network * each as f64;
    let (exact_cpu, _) = seconds(|| Ok(stream_sections(&plan, &set, control, || (), |(), _, _| {})?))?;
    let mut exact_gpu = None;
    if let Device::Gpu(gpu) = bench.device {
        let mut sections = GpuSections::new(gpu, &plan)?;
        sections.stream(&set[..1], control, || (), |(), _, _| {})?;
        let (time, _) = seconds(|| Ok(sections.stream(&set, control, || (), |(), _, _| {})?))?;
        exact_gpu = Some(time);
    }
    stage.finish("");
    Ok(TimingResult {
        network,
        exact_cpu,
        exact_gpu,
        network_bytes: 4 * shape.parameter_count() as u64,
        sections_bytes: (4 * set.len() * grid.len()) as u64,
    })
}

pub(super) fn table(bench: &Bench<'_>) -> Result<Table> {
    let values = [("time", Kind::Seconds), ("memory", Kind::Bytes)];
    let mut table = Table::new("time", "Time and memory", &["part", "what"], &values);
    table.notes.push(
        "225 sections each (`grid:15`), the network's and the exact ones on the same device in the same run; memory of the \
         samples, the network in f32, and the sections. The paper says 2 MB of its network, whose layers as described \
         hold 1,056,769 parameters (4.2 MB in f32). The stored sections and the harmonic field are made from as many sections as \
         `single` learns from; nearest and linear share them. The paper's times are of its own resolution and machine. \
         What was kept from an interrupted run has the times of that run. Where the network's 225 sections take more than two \
         minutes, every 25th of them was timed."
            .into(),
    );
    table.judged = bench.protocol.full;
    for &part in &bench.parts {
        let run = match bench.trained(part, "single")? {
            Training::Finished(run) => Some(run),
            Training::Diverged(what) => {
                table.notes.push(format!("{}: no network to time. {what}", part.name()));
                None
            }
            Training::Missing => {
                table.notes.push(format!("{}: not trained yet.", part_label(part)));
                None
            }
        };
        let source = bench.protocol.recipe("single", Some(part.name()))?;
        let name = format!("time-{}", part.name());
        let measured = match &run {
            Some(_) => bench.cell(&name, &(&source, SECTIONS), || measure(bench, &source.recipe()?))?,
            None => None,
        };
        let others = if measured.is_some() { bench.baselines(part)? } else { None };
        if let Some(run) = &run {
            let label = part_label(part);
            table.notes.push(match &measured {
                None => format!("{label}: not timed yet."),
                Some(Cell { made_on, .. }) => format!(
                    "{label}: trained on {}; its and the exact sections on {made_on}; the other fields {}.",
                    run.made_on,
                    others.as_ref().map_or("not made yet".into(), |others| format!("on {}", others.made_on))
                ),
            });
        }
        let measured = measured.map(|cell| cell.value);
        let paper = PAPER.seconds.get(part.name());
        // Seconds and bytes; nothing of what is not made, which the paper has all the same.
        let mut row = |what: &str, papers: [Option<f64>; 2], ours: Option<(f64, u64)>| {
            table.rows.push(Row {
                labels: vec![part_label(part), what.into()],
                values: vec![
                    PaperComparison::new(papers[0], ours.map(|own| own.0)),
                    PaperComparison::new(papers[1], ours.map(|own| own.1 as f64)),
                ],
            });
        };
        let samples = |run: &Run| run.summary.stages.iter().map(|stage| stage.samples).sum::<u64>();
        let trained = run.as_ref().map(|run| (run.summary.seconds(), SAMPLE_BYTES * samples(run)));
        row("train (single)", [paper.map(|p| p[0]), None], trained);
        let network = [paper.map(|p| p[1]), Some(PAPER.network_bytes)];
        row("225 sections, network", network, measured.as_ref().map(|own| (own.network, own.network_bytes)));
        let exact = paper.map(|p| p[2]);
        let on_gpu = measured.as_ref().and_then(|own| Some((own.exact_gpu?, own.sections_bytes)));
        let on_cpu = measured.as_ref().map(|own| (own.exact_cpu, own.sections_bytes));
        row("225 sections, exact, CPU", [exact.filter(|_| on_gpu.is_none()), None], on_cpu);
        if on_gpu.is_some() {
            row("225 sections, exact, GPU", [exact, None], on_gpu);
        }
        for method in others.into_iter().flat_map(|cell| cell.value) {
            row(&format!("make, {}", method.name), [None; 2], Some((method.made, method.bytes)));
            let sections = Some((method.sections, method.bytes));
            row(&format!("225 sections, {}", method.name), [None; 2], sections);
        }
    }
    Ok(table)
}
