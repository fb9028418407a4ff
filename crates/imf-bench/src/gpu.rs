//! `imf-bench gpu`: what a GPU does, in one go, beside the CPU of the same machine and with values compared: its peak, exact
//! sections, training steps, and a field that is distilled and evaluated over grids and at poses.
//!
//! A part is written as soon as it is measured, whatever becomes of those after it; parts that an earlier run on the same device left
//! in the folder stay until they are measured again.

mod field;
mod sections;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use imf_cli::engine::Device;
use imf_cli::interrupt::{self, Interrupted};
use imf_cli::output::{prepare_folder, print, print_json, write_json, write_text};
use imf_cli::session::Session;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_core::section::{At, SectionPlan, stream_sections};
use imf_fields::recipe::Precision;
use imf_gpu::{DeviceChoice, Gpu, Peak};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::arguments::{GpuArguments, GpuPart};
use crate::candidates::reference_scene;
use crate::document::Document;
use crate::exact::SECTIONS;
use crate::measurement::{Machine, ROUNDS, least_seconds};
use crate::train::{self, Rounds, Steps};

const JSON: &str = "gpu.json";

/// How much is measured.
struct Sizes {
    /// Resolution of the teapot, as a share of the paper's.
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

#[derive(Serialize, Deserialize)]
struct Report {
    device: String,
    parts: Vec<Part>,
}

/// One measurement.
#[derive(Default, Serialize, Deserialize)]
struct Part {
    title: String,
    /// The machine beside the device.
    machine: String,
    text: String,
    found: Value,
    /// Why there is no more of it.
    failed: Option<String>,
}

/// What measures a part: it adds to what was found as it goes.
type Work<'a> = &'a dyn Fn(&Gpu, &mut Part) -> Result<()>;

pub(crate) fn run(session: &Session, arguments: &GpuArguments) -> Result<()> {
    let Device::Gpu(gpu) = Device::open(&arguments.device, session)? else {
        bail!(
            "imf-bench gpu measures a GPU, and --device {} is none: `imf info` lists what there is",
            arguments.device
        );
    };
    let small = arguments.small || gpu.adapter().is_software();
    let sizes = if small { Sizes::small() } else { Sizes::whole() };
    prepare_folder(&arguments.out)?;
    let mut report = Report::begun(&arguments.out, &gpu, small)?;

    let trained = |precision| {
        let (width, batches, rounds) = (sizes.width, sizes.batches, sizes.rounds);
        Steps { width, precision, batches, python: Some(&arguments.python), rounds }
    };
    let works: [(GpuPart, &str, Work<'_>); 5] = [
        (GpuPart::Peak, "Peak in f32", &|gpu, part| peak(gpu, &sizes, part)),
        (GpuPart::Sections, "Exact sections", &|gpu, part| exact_sections(session, gpu, &sizes, part)),
        (GpuPart::Training, "Training steps, f32", &|gpu, part| {
            steps(session, gpu, &trained(Precision::F32), part)
        }),
        (GpuPart::Training, "Training steps, f16", &|gpu, part| {
            if gpu.adapter().half.is_none() {
                part.text = "This adapter has no f16 in shaders.\n".into();
                return Ok(());
            }
            steps(session, gpu, &trained(Precision::F16), part)
        }),
        (GpuPart::Field, "A field distilled and evaluated", &|gpu, part| {
            field::measured(session, gpu, &sizes.scene()?, &sizes.field, part)
        }),
    ];
    let mut failed = Vec::new();
    for (which, title, work) in works {
        if !arguments.only.is_empty() && !arguments.only.contains(&which) {
            continue;
        }
        session.note(title);
        let mut machine = Machine::new(session.threads());
        let mut part = Part { title: title.into(), ..Part::default() };
        // A device that was lost stays lost: each part has its own.
        let opened = Gpu::open(&DeviceChoice::Index(gpu.adapter().index));
        let outcome = opened.map_err(Into::into).and_then(|gpu| work(&gpu, &mut part));
        let stopped = interrupt::requested();
        if let Err(error) = outcome {
            failed.push(title);
            part.failed = Some(if stopped { "interrupted".into() } else { format!("{error:#}") });
        }
        machine.finish();
        part.machine = machine.to_string();
        if !(stopped && part.found.is_null()) {
            report.add(part);
            report.write(&arguments.out)?;
        }
        if stopped {
            let kept = match report.parts.is_empty() {
                true => "nothing was measured".to_owned(),
                false => format!("what was measured is in {}", arguments.out.join(JSON).display()),
            };
            return Err(Interrupted(kept).into());
        }
    }
    ensure!(
        failed.is_empty(),
        "not measured whole: {}; see {}",
        failed.join(", "),
        arguments.out.join(JSON).display()
    );
    if session.json { print_json(&report) } else { print(&report.markdown()) }
}

impl Report {
    /// With the parts that an earlier run of this version on the same device left; refuses what it cannot go on with.
    fn begun(out: &Path, gpu: &Gpu, small: bool) -> Result<Self> {
        let sizes = if small { "small sizes" } else { "the paper's sizes" };
        let adapter = gpu.adapter();
        let device = format!(
            "imf {}, {sizes}, on {} ({}, driver {})",
            env!("CARGO_PKG_VERSION"),
            adapter.name,
            adapter.backend,
            adapter.driver
        );
        let path = out.join(JSON);
        let Some(bytes) = path.exists().then(|| std::fs::read(&path)).transpose()? else {
            return Ok(Self { device, parts: Vec::new() });
        };
        let name = path.display();
        let remedy = "choose another --out, or remove it";
        let found: Self = serde_json::from_slice(&bytes)
            .map_err(|error| anyhow!("{name} is no record of a GPU ({error}): {remedy}"))?;
        ensure!(found.device == device, "{name} is of {}, this is {device}: {remedy}", found.device);
        Ok(found)
    }

    /// In place of what there was of it; where nothing was found that stays, with the reason.
    fn add(&mut self, part: Part) {
        match self.parts.iter_mut().find(|old| old.title == part.title) {
            Some(old) if part.failed.is_some() && part.found.is_null() => old.failed = part.failed,
            Some(old) => *old = part,
            None => self.parts.push(part),
        }
    }

    fn markdown(&self) -> String {
        let mut text = format!("{}\n", self.device);
        for Part { title, machine, text: found, failed, .. } in &self.parts {
            let _ = write!(text, "\n## {title}\n\n{machine}\n\n{found}");
            if let Some(why) = failed {
                let _ = writeln!(text, "\nFailed: {why}");
            }
        }
        text
    }

    fn write(&self, out: &Path) -> Result<()> {
        write_json(&out.join(JSON), self)?;
        write_text(&out.join("gpu.md"), &self.markdown())
    }
}

/// Multiply-adds in f32.
fn peak(gpu: &Gpu, sizes: &Sizes, part: &mut Part) -> Result<()> {
    let rate = Peak::new(gpu)?.measure(sizes.peak)?;
    part.text = format!("{:.2} TFLOP/s by multiply-adds alone, without matrix units\n", rate * 1e-12);
    part.found = json!({ "flops_per_second": rate });
    Ok(())
}

/// Sections of `fibonacci:225`, every value of some of them compared.
fn exact_sections(session: &Session, gpu: &Gpu, sizes: &Sizes, part: &mut Part) -> Result<()> {
    let scene = sizes.scene()?;
    let plan = SectionPlan::of_scene(&scene, At::Tip)?;
    let control = session.control(&|_| {});
    let orientations = OrientationSet::parse(&format!("fibonacci:{SECTIONS}"))?.orientations;
    let [ours] = least_seconds(
        ROUNDS,
        [&mut || Ok(drop(stream_sections(&plan, &orientations, control, || (), |(), _, _| {})?))],
    )?;
    let ours = ours / SECTIONS as f64;
    let apart = SECTIONS / sizes.compared;
    let compared: Vec<Orientation> =
        orientations.iter().copied().step_by(apart).take(sizes.compared).collect();
    let rows = sections::measure(gpu, &plan, &orientations, &compared, ours, control)?;
    let [x, y, z] = plan.grid().dims;
    let mut document = Document::default();
    let (ms, how) = (ours * 1e3, plan.describe());
    document.paragraph(format!("Teapot {x}×{y}×{z}; the CPU takes {ms:.3} ms a section: {how}."));
    let cells = rows.iter().map(|row| {
        let equal = if row.equal == Some(true) { "yes" } else { "NO" };
        let ms = format!("{:.3}", row.milliseconds_per_section);
        vec![row.name.clone(), ms, format!("{:.2}", 1.0 / row.ratio), equal.into(), row.how.clone()]
    });
    document.table(&["", "ms a section", "times as fast", "same counts", "how"], cells.collect());
    part.text = document.markdown();
    part.found = json!({ "cpu_milliseconds_per_section": ours * 1e3, "rows": rows });
    ensure!(rows.iter().all(|row| row.equal == Some(true)), "the counts are not the CPU's");
    Ok(())
}

/// Steps of the paper's network, PyTorch's by turns with them.
fn steps(session: &Session, gpu: &Gpu, of: &Steps<'_>, part: &mut Part) -> Result<()> {
    let report = train::measured(session, &Device::Gpu(gpu.clone()), of)?;
    if !report.rows.is_empty() {
        let mut document = Document::default();
        report.describe(&mut document);
        (part.text, part.found) = (document.markdown(), serde_json::to_value(&report)?);
    }
    report.failed.map_or(Ok(()), |why| bail!("{why}"))
}
