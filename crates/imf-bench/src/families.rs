//! `imf-bench families`: every family of fields made from the same number of exact sections, side by side; but coarse tables, which
//! take as many as serve their size best.
//!
//! ```text
//! OUT/families.md, families.json     the table of every part
//! OUT/PART.png                       error and wrong decisions as bars
//! OUT/runs/PART-…/, OUT/datasets/    siren5's training and its samples, which go on after an interruption
//! ```

mod report;
mod truth;

use anyhow::{Context as _, Result};
use imf_cli::commands::demo::SHAPE;
use imf_cli::engine::{Calls, Device};
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_core::section::{At, Imf, SectionPlan, imf};
use imf_fields::evaluation::field_sections;
use imf_fields::factored::DistillSettings;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::metrics::Errors;
use imf_fields::recipe::schedule::{RateRule, Schedule};
use imf_fields::recipe::{AdamConfig, Length, Sampling, TrainingPlan, TrainingState};

use crate::arguments::families::FamiliesArguments;
use crate::candidates::{Candidate, distilled, fitted, harmonic_settings, reference_scene, symmetric};
use crate::cells::interruption;
use crate::interpolation::{AngleGrid, SectionTable};
use crate::measurement::{Machine, better_seconds, seconds};
use crate::recipe::{RANDOM_START, Runner, Stage};
use report::{Comparison, Report, Row};
use truth::Truth;

/// Orientations whose sections, and whose IMF, are timed.
const ASKED: &str = "fibonacci:225";
/// Angles along each side that the coarse table may take.
const COARSE_ANGLES: [usize; 7] = [5, 6, 8, 10, 12, 15, 20];
/// Orientations that choose among them, at random with another seed than those of the comparison.
const CHOOSING: usize = 8;

pub(crate) fn run(session: &Session, arguments: &FamiliesArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(session.threads());
    let device = Device::open(&arguments.device.device, session)?;
    let comparisons = arguments.part.iter().map(|&part| compare(session, &device, arguments, part));
    let comparisons = comparisons.collect::<Result<Vec<_>>>();
    let comparisons = comparisons.map_err(|error| interruption(error, &arguments.out))?;
    machine.finish();
    let report = Report::new(machine, arguments, comparisons);
    report.write(session, &arguments.out)
}

/// What all families of a part share.
struct Bench<'a> {
    session: &'a Session,
    arguments: &'a FamiliesArguments,
    plan: &'a SectionPlan,
    truth: Truth<'a>,
    /// Whose sections are timed.
    asked: Vec<Orientation>,
    /// The exact minimum over them.
    least: Imf,
    rows: Vec<Row>,
}

/// How a family was made.
struct Making {
    name: &'static str,
    how: String,
    seconds: f64,
    bytes: u64,
}

fn compare(
    session: &Session,
    device: &Device,
    arguments: &FamiliesArguments,
    part: ReferencePart,
) -> Result<Comparison> {
    let scene = reference_scene(part, arguments.scale)?;
    let random = OrientationSet::parse(&format!("random:{}:{}", arguments.random, arguments.seed))?;
    let asked = OrientationSet::parse(ASKED)?.orientations;
    let angles = AngleGrid::new(arguments.angles as usize);
    require_memory(session, &scene, arguments, angles, asked.len())?;

    let [x, y, z] = scene.record.grid.dims;
    session.note(&format!("{part}, {x}×{y}×{z} voxels: the exact field"));
    let (planned, plan) = seconds(|| Ok(SectionPlan::of_scene(&scene, At::Tip)?))?;
    let truth = Truth::new(session, &plan, &random.orientations, arguments.near, arguments.threshold)?;
    let least = imf(&plan, &asked, session.control(&|_| {}))?;
    let mut bench = Bench { session, arguments, plan: &plan, truth, asked, least, rows: Vec::new() };
    let how = format!("counts voxels for every direction: {}", plan.describe());
    let bytes = plan.grid().len().div_ceil(8) as u64;
    bench
        .measure(Making { name: "exact", how, seconds: planned, bytes }, &Candidate::Exact(session, &plan))?;

    let factored = bench.harmonic_and_factored(&scene)?;
    let siren = bench.siren(device, &scene, part)?;
    bench.stored(angles)?;
    bench.coarse("coarse table, as large as factored", factored)?;
    bench.coarse("coarse table, as large as siren5", siren)?;
    Ok(Comparison { part: part.name(), dims: [x, y, z], sections: arguments.sections(), rows: bench.rows })
}

/// Everything that is held at once at the most.
fn require_memory(
    session: &Session,
    scene: &Scene,
    arguments: &FamiliesArguments,
    angles: AngleGrid,
    asked: usize,
) -> Result<()> {
    let record = &scene.record;
    let voxels = record.grid.len();
    let count = arguments.sections();
    let settings = harmonic_settings(count);
    let families = settings.memory(Domain::Directions, voxels).0.max(SectionTable::memory(angles, voxels));
    let needed = families
        + Truth::memory(arguments.random as usize, voxels)
        + 4 * (asked * voxels) as u64
        + SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads());
    session.require_memory(needed, || {
        format!("{count} sections of {voxels} voxels, and what they are compared with; use a smaller --scale")
    })
}

impl Bench<'_> {
    /// Judges a family and takes its times.
    fn measure(&mut self, making: Making, field: &Candidate<'_>) -> Result<()> {
        let verdict = self.truth.compare(field)?;
        let mut values = vec![0.0; self.asked.len() * self.plan.grid().len()];
        let (sections, ()) = better_seconds(|| field.sections(&self.asked, &mut values))?;
        drop(values);
        let (minimum, found) = better_seconds(|| field.minimum(&self.asked))?;
        let mut errors = Errors::default();
        errors.add(&self.least.value, &found.value, self.arguments.threshold);
        let Making { name, how, seconds, bytes } = making;
        let errors = errors.report(self.arguments.threshold);
        self.rows.push(Row { name, how, made: seconds, bytes, verdict, sections, minimum, imf: errors });
        Ok(())
    }

    /// Fits the one and distils the other from it; the bytes of the latter.
    fn harmonic_and_factored(&mut self, scene: &Scene) -> Result<u64> {
        let (session, steps) = (self.session, self.arguments.factored_steps);
        let settings = harmonic_settings(self.arguments.sections());
        let (fitting, file) = seconds(|| fitted(session, scene, self.plan, settings))?;
        let HarmonicFile { field, .. } = &*file;
        let how = format!("{} basis functions of degree {}, in f16", field.basis.len(), settings.degree);
        let making = Making { name: "harmonic", how, seconds: fitting, bytes: field.bytes() };
        self.measure(making, &Candidate::Field(&Field::new(FieldFile::Harmonic(file.clone()))?))?;

        let defaults = DistillSettings::of_length(Length::Steps(steps));
        let plan = TrainingPlan { seed: self.arguments.seed, ..defaults.plan };
        let (distilling, factored) = seconds(|| {
            let settings = symmetric(&file, DistillSettings { plan, ..defaults });
            distilled(session, &Device::Cpu, &file, settings)
        })?;
        drop(file);
        let field = &factored.field;
        let (bytes, weights) = (field.bytes(), field.parameter_count());
        let how = format!(
            "{}, {weights} weights, distilled from this harmonic field in {steps} steps",
            field.shape
        );
        let making = Making { name: "factored", how, seconds: fitting + distilling, bytes };
        self.measure(making, &Candidate::Field(&Field::new(FieldFile::Factored(Box::new(factored)))?))?;
        Ok(bytes)
    }

    /// Trains the paper's kind of network, the demo's, on a dataset of its own; the bytes of it.
    fn siren(&mut self, device: &Device, scene: &Scene, part: ReferencePart) -> Result<u64> {
        let (arguments, seed) = (self.arguments, self.arguments.seed);
        let [x, y, z] = scene.record.grid.dims;
        let stage = Stage {
            name: format!("{part}-{x}x{y}x{z}-{}-{seed}", arguments.sections()),
            part: None,
            start: RANDOM_START.into(),
            resolution: 1.0,
            orientations: Some(format!("fibonacci:{}", arguments.sections())),
            online: None,
            sampling: Sampling { seed, ..Sampling::default() },
            training: TrainingPlan {
                length: Length::Steps(arguments.siren_steps),
                schedule: Schedule::Cosine { initial: 5e-4, last: 5e-6, warmup: 200 },
                adam: AdamConfig { weight_decay: 0.0, ..AdamConfig::default() },
                seed,
                ..TrainingPlan::default()
            },
            rate_rule: RateRule::Constant,
        };
        let runner = Runner {
            session: self.session,
            device,
            checkpoint_every: 60.0,
            held_out: 0,
            datasets: arguments.out.join("datasets"),
        };
        let start = (TrainingState::new(&SHAPE, seed), None);
        let folder = arguments.out.join("runs").join(&stage.name);
        let trained = runner.train(&stage, SHAPE, [scene, scene], start, &folder)?;
        let (model, parameters) = (trained.model, SHAPE.parameter_count());
        let record = &model.record;
        let how = format!(
            "{}×{}, ω = {}, {parameters} weights, {} steps on {}",
            SHAPE.hidden, SHAPE.width, SHAPE.omega, record.steps, record.engine
        );
        let (bytes, seconds) = (4 * parameters as u64, trained.sampled + record.seconds);
        let field = device.field(self.session, &FieldFile::Siren(Box::new(model)), Calls::Many)?;
        let making = Making { name: "siren5", how, seconds, bytes };
        self.measure(making, &Candidate::Field(&*field.field))?;
        Ok(bytes)
    }

    /// Sections between stored sections.
    fn stored(&mut self, angles: AngleGrid) -> Result<()> {
        let count = self.arguments.sections();
        let stage = self.session.stage("stored sections", "sections", count as u64);
        let advance = |sections| stage.advance(sections);
        let control = self.session.control(&advance);
        let (seconds, stored) =
            seconds(|| Ok(SectionTable::new(self.plan, angles, self.plan.grid().dims, control)?))?;
        stage.finish("");
        let voxels = self.plan.grid().len();
        let bytes = SectionTable::memory(angles, voxels);
        let making =
            |name, how: &str| Making { name, how: format!("{how} of {count} stored in f32"), seconds, bytes };
        let nearest = Candidate::Table(voxels, &|o, values| stored.nearest(o, values));
        self.measure(making("nearest section", "the nearest"), &nearest)?;
        let linear = Candidate::Table(voxels, &|o, values| stored.linear(o, values));
        self.measure(making("linear in angle", "between the four around it"), &linear)
    }

    /// The best table of so many bytes: as many angles or as many points as serve it best.
    fn coarse(&mut self, name: &'static str, bytes: u64) -> Result<()> {
        let session = self.session;
        let seed = self.arguments.seed.wrapping_add(0x000C_0A25_E000);
        let choosing = OrientationSet::parse(&format!("random:{CHOOSING}:{seed}"))?.orientations;
        let total: usize = COARSE_ANGLES.iter().map(|n| n * n + CHOOSING).sum();
        let stage = session.stage("coarse tables", "sections", total as u64);
        let advance = |sections| stage.advance(sections);
        let control = session.control(&advance);
        let mut best: Option<(f64, f64, SectionTable)> = None;
        for n in COARSE_ANGLES {
            let angles = AngleGrid::new(n);
            let points = SectionTable::points_within(self.plan.grid(), angles, bytes);
            let (seconds, table) = seconds(|| Ok(SectionTable::new(self.plan, angles, points, control)?))?;
            let tau = self.arguments.threshold;
            let errors = field_sections(self.plan, &choosing, tau, control, |o, v| table.linear(o, v))?;
            if best.as_ref().is_none_or(|(mse, ..)| errors.overall.mse < *mse) {
                best = Some((errors.overall.mse, seconds, table));
            }
        }
        stage.finish("");
        let (_, seconds, table) = best.context("no coarse table was tried")?;
        let ([x, y, z], sections) = table.shape();
        let how = format!("{x}×{y}×{z} points × {sections} sections, linear between them");
        let (bytes, voxels) = (table.bytes(), self.plan.grid().len());
        let table = Candidate::Table(voxels, &|o, values| table.linear(o, values));
        self.measure(Making { name, how, seconds, bytes }, &table)
    }
}
