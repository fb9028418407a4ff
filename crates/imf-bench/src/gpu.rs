//! `imf-bench gpu`: what a GPU does, in one go, beside the CPU of the same machine and with values compared: its peak, exact
//! sections, training steps, and a field that is distilled and evaluated over grids and at poses.
//!
//! A part has files of its own, written as soon as it is measured, whatever becomes of those after it; those of an earlier run stay until
//! the part is measured again.

mod field;
mod sections;

use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use imf_cli::engine::Device;
use imf_cli::interrupt::{self, Interruption};
use imf_cli::output::{prepare_folder, print, print_json};
use imf_cli::session::Session;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_core::section::{SectionPlan, ToolPoints, stream_sections};
use imf_fields::recipe::Precision;
use imf_gpu::{DeviceChoice, Gpu, Peak};
use serde::Serialize;
use serde_json::{Value, json};

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::exact::SECTIONS;
use crate::measurement::{Machine, ROUNDS, minimum_seconds};
use crate::train::{self, Rounds, Steps};

/// What a GPU does beside the CPU of the same machine, with values compared
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench gpu --python venv/bin/python --out bench-gpu\n\n\
                        Writes a JSON and a Markdown file for each part; those of an earlier run stay until their part is measured again. \
                        Some minutes; on a software device small sizes, which show that every part works.")]
pub(crate) struct GpuArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// These alone; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PART")]
    only: Vec<GpuPart>,
    /// Small sizes, which show that every part works
    #[arg(long)]
    small: bool,
    /// Python with PyTorch
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    python: String,
    /// gpu, software (software Vulkan), or a number or part of a name from `imf info`
    #[arg(long, default_value = "gpu", value_name = "DEVICE")]
    device: String,
}

/// A measurement of a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum GpuPart {
    /// Multiply-adds alone, in f32
    Peak,
    /// Exact sections
    Sections,
    /// Steps of the paper's network, PyTorch's beside them
    Training,
    /// A field distilled and evaluated over grids and at poses
    Field,
}

/// How much is measured.
struct Sizes {
    /// Resolution of the teapot, as a fraction of the paper's.
    scale: f64,
    /// Seconds of the peak.
    peak: f64,
    /// Orientations whose sections are compared value by value.
    compared: usize,
    /// Training: neurons of a hidden layer, and batches.
    width: usize,
    batches: &'static [usize],
    rounds: Rounds,
    field: field::Sizes,
}

impl Sizes {
    /// The paper's.
    fn whole() -> Self {
        Self {
            scale: 1.0,
            peak: 1.0,
            compared: 12,
            width: 512,
            batches: &[1024, 8192, 65_536],
            rounds: Rounds::default(),
            field: field::Sizes {
                degree: 22,
                width: 380,
                steps: 1000,
                random: 64,
                minima: &["fibonacci:225", "fibonacci:10000"],
                poses: 100_000,
            },
        }
    }

    /// Enough to see that every part works.
    fn small() -> Self {
        Self {
            scale: 0.2,
            peak: 0.1,
            compared: 3,
            width: 64,
            batches: &[64],
            rounds: Rounds { count: 1, seconds: 0.05 },
            field: field::Sizes {
                degree: 6,
                width: 32,
                steps: 50,
                random: 8,
                minima: &["fibonacci:37"],
                poses: 500,
            },
        }
    }

    fn scene(&self) -> Result<Scene> {
        reference_scene(ReferencePart::Teapot, self.scale)
    }
}

/// One measurement.
#[derive(Default, Serialize)]
struct Part {
    /// Also its files' name.
    name: &'static str,
    device: String,
    /// The machine beside the device.
    machine: String,
    found: Value,
    /// Why there is no more of it.
    failed: Option<String>,
    #[serde(skip)]
    document: Document,
}

/// What measures a part: it adds to what was found as it goes.
type Work<'a> = &'a dyn Fn(&Gpu, &mut Part) -> Result<()>;

pub(crate) fn run(session: &Session, arguments: &GpuArguments) -> Result<()> {
    let Device::Gpu(gpu) = Device::open(&arguments.device, session)? else {
        bail!(
            "imf-bench gpu measures a GPU, and --device {} is not a GPU: `imf info` lists what there is",
            arguments.device
        );
    };
    let small = arguments.small || gpu.adapter().is_software();
    let sizes = if small { Sizes::small() } else { Sizes::whole() };
    prepare_folder(&arguments.out)?;
    let sizes_used = if small { "small sizes" } else { "the paper's sizes" };
    let adapter = gpu.adapter();
    let device = format!(
        "imf {}, {sizes_used}, on {} ({}, driver {})",
        env!("CARGO_PKG_VERSION"),
        adapter.name,
        adapter.backend,
        adapter.driver
    );
    let trained = |precision| {
        let (width, batches, rounds) = (sizes.width, sizes.batches, sizes.rounds);
        Steps { width, precision, batches, python: &arguments.python, rounds }
    };
    let works: [(GpuPart, &'static str, Work<'_>); 5] = [
        (GpuPart::Peak, "peak", &|gpu, part| peak(gpu, &sizes, part)),
        (GpuPart::Sections, "sections", &|gpu, part| exact_sections(session, gpu, &sizes, part)),
        (GpuPart::Training, "training-f32", &|gpu, part| steps(session, gpu, &trained(Precision::F32), part)),
        (GpuPart::Training, "training-f16", &|gpu, part| match gpu.adapter().half {
            true => steps(session, gpu, &trained(Precision::F16), part),
            false => {
                part.document.paragraph("This adapter has no f16 in shaders.");
                Ok(())
            }
        }),
        (GpuPart::Field, "field", &|gpu, part| {
            field::measured(session, gpu, &sizes.scene()?, &sizes.field, part)
        }),
    ];
    let mut parts = Vec::new();
    for (which, name, work) in works {
        if !arguments.only.is_empty() && !arguments.only.contains(&which) {
            continue;
        }
        session.note(name);
        let mut machine = Machine::new(session.threads());
        let mut part = Part { name, device: device.clone(), ..Part::default() };
        // A device that was lost stays lost: each part has its own.
        let opened = Gpu::open(&DeviceChoice::Index(adapter.index));
        let outcome = opened.map_err(Into::into).and_then(|gpu| work(&gpu, &mut part));
        part.failed = outcome.err().map(|error| format!("{error:#}"));
        machine.finish();
        part.machine = machine.to_string();
        // Where nothing was found, what an earlier run found stays.
        part.finish_document();
        if !part.found.is_null() {
            part.document.write(&arguments.out, name, &part)?;
        }
        parts.push(part);
        if interrupt::requested() {
            let kept = format!("what was measured is in {}", arguments.out.display());
            return Err(Interruption(kept).into());
        }
    }
    let failed = parts.iter().filter_map(|part| Some(format!("{} ({})", part.name, part.failed.as_ref()?)));
    let failed: Vec<String> = failed.collect();
    ensure!(failed.is_empty(), "not measured whole: {}", failed.join(", "));
    if session.json {
        return print_json(&parts);
    }
    parts.iter().try_for_each(|part| print(&part.document.columns()))
}

impl Part {
    /// Says in what was found where, and why not more.
    fn finish_document(&mut self) {
        let mut document = Document::new(self.name);
        document.paragraph(format!("{}\n{}", self.device, self.machine));
        document.append(std::mem::take(&mut self.document));
        if let Some(why) = &self.failed {
            document.paragraph(format!("Failed: {why}"));
        }
        self.document = document;
    }
}

/// Multiply-adds in f32.
fn peak(gpu: &Gpu, sizes: &Sizes, part: &mut Part) -> Result<()> {
    let rate = Peak::new(gpu)?.measure(sizes.peak)?;
    let text = format!("{:.2} TFLOP/s by multiply-adds alone, without matrix units", rate * 1e-12);
    part.document.paragraph(text);
    part.found = json!({ "flops_per_second": rate });
    Ok(())
}

/// Sections of `fibonacci:225`, every value of some of them compared.
fn exact_sections(session: &Session, gpu: &Gpu, sizes: &Sizes, part: &mut Part) -> Result<()> {
    let scene = sizes.scene()?;
    let plan = SectionPlan::of_scene(&scene, ToolPoints::Tip)?;
    let control = session.control(&|_| {});
    let orientations = OrientationSet::parse(&format!("fibonacci:{SECTIONS}"))?.orientations;
    let [ours] = minimum_seconds(
        ROUNDS,
        [&mut || Ok(stream_sections(&plan, &orientations, control, || (), |(), _, _| {}).map(drop)?)],
    )?;
    let ours = ours / SECTIONS as f64;
    let apart = SECTIONS / sizes.compared;
    let compared: Vec<Orientation> =
        orientations.iter().copied().step_by(apart).take(sizes.compared).collect();
    let rows = sections::measure(gpu, &plan, &orientations, &compared, ours, control)?;
    let [x, y, z] = plan.grid().dims;
    let (ms, how) = (ours * 1e3, plan.describe());
    part.document.paragraph(format!("Teapot {x}×{y}×{z}; the CPU takes {ms:.3} ms a section: {how}."));
    let cells = rows.iter().map(|row| {
        let equal = if row.equal == Some(true) { "yes" } else { "NO" };
        let ms = format!("{:.3}", row.milliseconds_per_section);
        vec![row.name.clone(), ms, format!("{:.2}", 1.0 / row.ratio), equal.into(), row.how.clone()]
    });
    part.document.table(&["", "ms a section", "times as fast", "same counts", "how"], cells.collect());
    part.found = json!({ "cpu_milliseconds_per_section": ours * 1e3, "rows": rows });
    ensure!(rows.iter().all(|row| row.equal == Some(true)), "the counts are not the CPU's");
    Ok(())
}

/// Steps of the paper's network, PyTorch's by turns with them.
fn steps(session: &Session, gpu: &Gpu, of: &Steps<'_>, part: &mut Part) -> Result<()> {
    let report = train::measured(session, &Device::Gpu(gpu.clone()), of)?;
    if !report.rows.is_empty() {
        report.describe(&mut part.document);
        part.found = serde_json::to_value(&report)?;
    }
    report.failed.map_or(Ok(()), |why| bail!("{why}"))
}
