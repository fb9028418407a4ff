//! `imf-bench families`: every family of fields made from the same number of exact sections, side by side; but coarse tables, which
//! take as many as serve their size best.
//!
//! ```text
//! OUT/families.md, families.json     the table of every part
//! OUT/PART.png                       error and wrong decisions as bars
//! OUT/runs/PART-…/                   siren5's dataset and training, which go on after an interruption
//! ```

mod judge;
mod report;
mod rivals;
mod siren;

use std::str::FromStr as _;
use std::time::Instant;

use anyhow::{Context as _, Result};
use imf_cli::engine::{Calls, Device};
use imf_cli::interrupt::{self, Interrupted};
use imf_cli::output::{prepare_folder, print, print_json};
use imf_cli::session::Session;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{At, Imf, SectionPlan, imf};
use imf_core::tool::Tool;
use imf_fields::evaluation::field_sections;
use imf_fields::factored::{DistillSettings, FactoredField, Symmetry};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::{HarmonicField, fit, section_count};
use imf_fields::metrics::Errors;
use imf_fields::recipe::{Length, TrainingPlan};
use imf_train::distill::distil;
use imf_train::training::run::Outcome;

use crate::arguments::families::FamiliesArguments;
use crate::arguments::paper::PaperPart;
use crate::interpolation::{AngleGrid, CoarseTable, StoredSections};
use crate::machine::{Machine, timed};
use crate::paper::harmonic_settings;
use judge::Judge;
use report::{Comparison, Report, Row};
use rivals::{Exact, Rival, Table, Tabulated};

/// Orientations whose sections, and whose IMF, are timed.
const ASKED: &str = "fibonacci:225";
/// Angles along each side that the coarse table may take.
const COARSE_ANGLES: [usize; 7] = [5, 6, 8, 10, 12, 15, 20];
/// Orientations that choose among them, at random with another seed than those that judge.
const CHOOSING: usize = 8;

pub(crate) fn run(session: &Session, arguments: &FamiliesArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(session.threads());
    let device = Device::open(&arguments.device.device, session)?;
    let comparisons = arguments.part.iter().map(|&part| compare(session, &device, arguments, part));
    let comparisons = comparisons.collect::<Result<Vec<_>>>()?;
    machine.finish();
    let report = Report::new(machine, arguments, comparisons);
    report.write(&arguments.out)?;
    if session.json { print_json(&report) } else { print(&report.text()) }
}

/// What all families of a part share.
struct Bench<'a> {
    session: &'a Session,
    arguments: &'a FamiliesArguments,
    plan: &'a SectionPlan,
    judge: Judge<'a>,
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
    part: PaperPart,
) -> Result<Comparison> {
    let reference = ReferencePart::from_str(part.name())?;
    let dims = reference.dims().map(|n| ((n as f64 * arguments.scale).round() as usize).max(4));
    let scene = SceneSpec::of_reference(reference, &reference.mesh(), dims, &Tool::paper()).scene()?;
    let random = OrientationSet::parse(&format!("random:{}:{}", arguments.random, arguments.seed))?;
    let asked = OrientationSet::parse(ASKED)?.orientations;
    let angles = AngleGrid::new(arguments.angles as usize);
    require_memory(session, &scene, arguments, angles, asked.len())?;

    let [x, y, z] = dims;
    session.note(&format!("{}, {x}×{y}×{z} voxels: the exact field", part.name()));
    let begun = Instant::now();
    let plan = SectionPlan::of_scene(&scene, At::Tip)?;
    let planned = begun.elapsed().as_secs_f64();
    let judge = Judge::new(session, &plan, &random.orientations, arguments.near, arguments.threshold)?;
    let least = imf(&plan, &asked, session.control(&|_| {}))?;
    let mut bench = Bench { session, arguments, plan: &plan, judge, asked, least, rows: Vec::new() };
    let making = Making {
        name: "exact",
        how: format!("counts voxels for every direction asked: {}", plan.describe()),
        seconds: planned,
        bytes: plan.grid().len().div_ceil(8) as u64,
    };
    bench.measure(making, &mut Exact { session, plan: &plan })?;

    let (harmonic, fitted) = bench.harmonic()?;
    let factored = bench.factored(harmonic, fitted, &scene)?;
    let siren_bytes = bench.siren(device, &scene, part)?;
    bench.stored(angles)?;
    bench.coarse("coarse table, as large as factored", factored)?;
    bench.coarse("coarse table, as large as siren5", siren_bytes)?;
    Ok(Comparison {
        part: part.name(),
        ours: part != PaperPart::Teapot,
        dims,
        sections: (arguments.angles * arguments.angles) as usize,
        rows: bench.rows,
    })
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
    let count = (arguments.angles * arguments.angles) as usize;
    let settings = harmonic_settings(count);
    let families = settings.memory(Domain::Directions, voxels).0.max(StoredSections::memory(angles, voxels));
    let needed = families
        + Judge::memory(arguments.random as usize, voxels)
        + 4 * (asked * voxels) as u64
        + SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads());
    session.require_memory(needed, || {
        format!("{count} sections of {voxels} voxels, and what they are compared with; use a smaller --scale")
    })
}

impl Bench<'_> {
    /// Judges a family and takes its times.
    fn measure(&mut self, making: Making, field: &mut dyn Rival) -> Result<()> {
        let verdict = self.judge.ask(field)?;
        let mut values = vec![0.0; self.asked.len() * self.plan.grid().len()];
        let (sections, ()) = timed(|| field.sections(&self.asked, &mut values))?;
        drop(values);
        let (minimum, found) = timed(|| field.least(&self.asked))?;
        let mut errors = Errors::default();
        errors.add(&self.least.value, &found.value, self.arguments.threshold);
        let Making { name, how, seconds, bytes } = making;
        let errors = errors.report(self.arguments.threshold);
        self.rows.push(Row { name, how, made: seconds, bytes, verdict, sections, minimum, imf: errors });
        Ok(())
    }

    /// The sections that every family is made from.
    fn sections(&self) -> usize {
        (self.arguments.angles * self.arguments.angles) as usize
    }

    fn harmonic(&mut self) -> Result<(HarmonicField, f64)> {
        let settings = harmonic_settings(self.sections());
        let total = section_count(Domain::Directions, &settings) as u64;
        let stage = self.session.stage("harmonic", "sections", total);
        let advance = |sections| stage.advance(sections);
        let begun = Instant::now();
        let mut field = fit(self.plan, Domain::Directions, &settings, self.session.control(&advance))?;
        let seconds = begun.elapsed().as_secs_f64();
        stage.finish("");
        let how = format!("{} functions of degree {}, in f16", field.basis.len(), settings.degree);
        self.measure(Making { name: "harmonic", how, seconds, bytes: field.bytes() }, &mut field)?;
        Ok((field, seconds))
    }

    /// Teaches a network; the bytes of it.
    fn factored(&mut self, teacher: HarmonicField, fitted: f64, scene: &Scene) -> Result<u64> {
        let mut settings = taught_by(self.arguments);
        let stage = self.session.stage("factored", "steps", self.arguments.factored_steps);
        let advance = |steps| stage.advance(steps);
        let begun = Instant::now();
        settings.symmetry = Symmetry::of(&teacher, &scene.obstacle);
        let mut state = settings.start(settings.outputs(&teacher));
        let control = self.session.control(&advance);
        let (outcome, _) = distil(&teacher, &settings, &mut state, control, &mut |_| {})?;
        if !matches!(outcome, Outcome::Finished) || interrupt::requested() {
            return Err(Interrupted("a comparison needs every family; nothing was written".into()).into());
        }
        let seconds = fitted + begun.elapsed().as_secs_f64();
        stage.finish("");
        let shape = settings.shape(settings.outputs(&teacher));
        let mut field = FactoredField::new(&teacher, shape, state.training.parameters)?.folded();
        drop(teacher);
        let bytes = field.bytes();
        let how = format!(
            "{}, {} weights, taught this harmonic field in {} steps",
            field.shape,
            field.parameter_count(),
            self.arguments.factored_steps
        );
        self.measure(Making { name: "factored", how, seconds, bytes }, &mut field)?;
        Ok(bytes)
    }

    /// Trains the paper's kind of network; the bytes of it.
    fn siren(&mut self, device: &Device, scene: &Scene, part: PaperPart) -> Result<u64> {
        let (model, seconds) = siren::train(self.session, device, scene, self.arguments, part)?;
        let parameters = model.shape.parameter_count();
        let how = format!(
            "{}×{}, ω = {}, {parameters} weights, {} steps on {}",
            model.shape.hidden, model.shape.width, model.shape.omega, model.record.steps, model.record.engine
        );
        let bytes = 4 * parameters as u64;
        let file = FieldFile::Siren(Box::new(model));
        let mut field = device.field(self.session, &file, Calls::Many)?;
        self.measure(Making { name: "siren5", how, seconds, bytes }, &mut field)?;
        Ok(bytes)
    }

    /// Sections between stored sections.
    fn stored(&mut self, angles: AngleGrid) -> Result<()> {
        let stage = self.session.stage("stored sections", "sections", self.sections() as u64);
        let advance = |sections| stage.advance(sections);
        let begun = Instant::now();
        let stored = StoredSections::new(self.plan, angles, self.session.control(&advance))?;
        let seconds = begun.elapsed().as_secs_f64();
        stage.finish("");
        let voxels = self.plan.grid().len();
        let bytes = StoredSections::memory(angles, voxels);
        let how = |what: &str| format!("{what} of {} stored in f32", self.sections());
        let tables = [
            ("nearest section", how("the nearest"), Table::Nearest(&stored)),
            ("linear in angle", how("between the four around it"), Table::Linear(&stored)),
        ];
        for (name, how, table) in tables {
            self.measure(Making { name, how, seconds, bytes }, &mut Tabulated { table, voxels })?;
        }
        Ok(())
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
        let mut best: Option<(f64, f64, CoarseTable)> = None;
        for n in COARSE_ANGLES {
            let angles = AngleGrid::new(n);
            let points = CoarseTable::points_within(self.plan.grid(), angles, bytes);
            let begun = Instant::now();
            let table = CoarseTable::new(self.plan, angles, points, control)?;
            let seconds = begun.elapsed().as_secs_f64();
            let tau = self.arguments.threshold;
            let errors = field_sections(self.plan, &choosing, tau, control, |o, v| table.section(o, v))?;
            if best.as_ref().is_none_or(|(mse, ..)| errors.overall.mse < *mse) {
                best = Some((errors.overall.mse, seconds, table));
            }
        }
        stage.finish("");
        let (_, seconds, table) = best.context("no coarse table was tried")?;
        let ([x, y, z], sections) = table.shape();
        let how = format!("{x}×{y}×{z} points × {sections} sections, linear between them");
        let (bytes, voxels) = (table.bytes(), self.plan.grid().len());
        let making = Making { name, how, seconds, bytes };
        self.measure(making, &mut Tabulated { table: Table::Coarse(&table), voxels })
    }
}

/// How the factored field is taught: as `imf train factored` does by default.
fn taught_by(arguments: &FamiliesArguments) -> DistillSettings {
    let defaults = DistillSettings::of_length(Length::Steps(arguments.factored_steps));
    DistillSettings { plan: TrainingPlan { seed: arguments.seed, ..defaults.plan }, ..defaults }
}
