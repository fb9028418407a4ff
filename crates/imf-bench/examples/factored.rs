//! The factored field against exact sections: time to make, error at random directions, size, time to evaluate.
//!
//! `cargo run --release -p imf-bench --example factored -- [name=value]...`, for example
//! `part=teapot scale=1 degree=20 axes=128 ratio=2 width=384 hidden=3 omega=30 rate=1e-3 batch=1024 seconds=240 solve=25
//! soap=1 look=10 loss=l2 seed=0 evaluate=1`; without `soap` Adam; without `rate` it follows from the length. `steps=N` in place of `seconds` gives the same field each time; `seconds`
//! are of training, found by a first trial of a few steps. Several trainings of one teacher: `then` between their values.
//! `symmetry=1` tells the network of the mirror planes and the axis that are found. `pool=64 every=1` teaches by exact sections alone, 64 at a time and a fresh one every step. `from=bracket-raw` teaches that part first, and the trainings with `fine=1` start from its network, by the rate and solutions for that unless
//! `rate` and `solve` are given.

use std::collections::HashMap;
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use glam::DVec3;
use imf_core::control::Control;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, SectionPlan, sections};
use imf_core::tool::Tool;
use imf_fields::factored::{DistillSettings, FactoredField, PointScratch, Symmetry};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit, section_count};
use imf_fields::metrics::Errors;
use imf_fields::recipe::Length;
use imf_fields::recipe::OnlineSettings;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::SoapConfig;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, Loss};
use imf_train::distill::{SectionSource, distil, start_from};

type Failure = Box<dyn Error>;

/// `name=value` pairs of the command line.
#[derive(Clone, Default)]
struct Values(HashMap<String, String>);

impl Values {
    fn get<T: std::str::FromStr>(&self, name: &str, default: T) -> Result<T, Failure>
    where
        T::Err: Error + 'static,
    {
        self.0.get(name).map_or(Ok(default), |value| Ok(value.parse()?))
    }
}

fn main() -> Result<(), Failure> {
    let mut trials = vec![Values::default()];
    for argument in std::env::args().skip(1) {
        if argument == "then" {
            trials.push(trials[trials.len() - 1].clone());
            continue;
        }
        let (name, value) = argument.split_once('=').ok_or("arguments are name=value")?;
        let last = trials.len() - 1;
        trials[last].0.insert(name.into(), value.into());
    }
    let first = &trials[0];
    let part: ReferencePart = first.get("part", "teapot".to_owned())?.parse()?;
    let threads = rayon::current_num_threads();
    println!("{}, {threads} thread(s)", part.name());
    let source = match first.0.get("from") {
        Some(name) => Some(one(first, &taught_from(first, name.parse()?)?.1, None, None)?),
        None => None,
    };
    let (plan, teaching) = taught_from(first, part)?;
    let teacher = &teaching.teacher;
    let random = OrientationSet::parse("random:256:77")?.orientations;
    let exact = sections(&plan, &random, Control::quiet())?;
    let judge = Judge { random: &random, exact: &exact };
    judge.tell("teacher", |group| {
        let mut values = vec![0.0; teacher.grid.len() * group.len()];
        teacher.sections(&teacher.direction_weights(group), &mut values);
        values
    });
    for trial in &trials {
        if trial.get("pool", 0)? > 0 {
            by_sections(trial, &plan, &judge)?;
            continue;
        }
        let from = if trial.get("fine", 0)? == 1 { source.as_ref() } else { None };
        one(trial, &teaching, Some(&judge), from)?;
    }
    Ok(())
}

/// What teaches a network of a part.
struct Teaching {
    teacher: HarmonicField,
    obstacle: Occupancy,
    /// What is found.
    symmetry: Symmetry,
}

/// What teaches a network of a part, and its exact sections.
fn taught_from(values: &Values, part: ReferencePart) -> Result<(SectionPlan, Teaching), Failure> {
    let scale: f64 = values.get("scale", 1.0)?;
    let dims = part.dims().map(|n| (n as f64 * scale).round() as usize);
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(part, &mesh, dims, &tool).scene()?;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, At::SharpPoints)?;
    let settings = fitting(values)?;
    let start = Instant::now();
    let teacher = fit(&plan, Domain::Directions, &settings, Control::quiet())?;
    let convolutions = section_count(Domain::Directions, &settings);
    println!(
        "{} {dims:?}: teacher in {:.1} s from {convolutions} sections: {:?}",
        part.name(),
        seconds(start),
        teacher.report
    );
    let start = Instant::now();
    let symmetry = Symmetry::of(&teacher, &scene.obstacle);
    println!("  {symmetry}: found in {:.2} s; {symmetry:?}", seconds(start));
    Ok((plan, Teaching { teacher, obstacle: scene.obstacle, symmetry }))
}

/// How a network is taught, but for how long.
fn settings(values: &Values) -> Result<DistillSettings, Failure> {
    let usual = DistillSettings::default();
    let length = usual.plan.length;
    let defaults = match (values.get("pool", 0)?, values.get("fine", 0)?) {
        (0, 0) => usual,
        (0, _) => DistillSettings::of_another(length),
        (pool, _) => {
            let every = values.get("every", 1)?;
            DistillSettings::of_sections(length, OnlineSettings { pool, every, ..OnlineSettings::default() })
        }
    };
    let mut settings = DistillSettings {
        width: values.get("width", defaults.width)?,
        hidden: values.get("hidden", defaults.hidden)?,
        omega: values.get("omega", defaults.omega)?,
        solve_every: values.get("solve", defaults.solve_every)?,
        ..defaults
    };
    let rate: f32 = values.get("soap", 0.0)?;
    settings.optimiser = if rate == 0.0 {
        Optimiser::Adam
    } else {
        Optimiser::Soap(SoapConfig { look_every: values.get("look", 10)?, rate, ..SoapConfig::default() })
    };
    settings.plan.batch = values.get("batch", 1024)?;
    settings.plan.seed = values.get("seed", 0)?;
    settings.plan.loss = if values.get("loss", "l2".to_owned())? == "l1" { Loss::L1 } else { Loss::L2 };
    settings.plan.adam = AdamConfig { beta2: values.get("beta2", 0.999)?, ..settings.plan.adam };
    if let Some(rate) = values.0.get("rate") {
        settings.plan.schedule = Schedule::Cosine {
            initial: rate.parse()?,
            last: values.get("last", 0.0)?,
            warmup: values.get("warmup", 10)?,
        };
    }
    Ok(settings)
}

/// How a harmonic field is fitted.
fn fitting(values: &Values) -> Result<FitSettings, Failure> {
    Ok(FitSettings {
        degree: values.get("degree", 14)?,
        axes: values.get("axes", 128)?,
        sections_per_function: values.get("ratio", 2.0)?,
        precision: Precision::F32,
        ..FitSettings::default()
    })
}

/// Teaches one network by sections alone, `pool` of them at a time, a fresh one every `every` steps, and measures it.
fn by_sections(values: &Values, plan: &SectionPlan, judge: &Judge<'_>) -> Result<(), Failure> {
    let mut settings = settings(values)?;
    let steps: u64 = values.get("steps", 1000)?;
    settings.plan.length = Length::Steps(steps);
    let start = Instant::now();
    let teacher = SectionSource::new(plan, Domain::Directions, &fitting(values)?, Control::quiet())?;
    let mut state = settings.start(teacher.axis_count());
    let mut next = steps / 8;
    let (_, waits) = distil(&teacher, &settings, &mut state, Control::quiet(), &mut |report| {
        if report.step >= next {
            println!(
                "  {:6.1} s step {:6} of {steps}: MSE at the pool {:.3e}",
                seconds(start),
                report.step,
                report.mean_loss
            );
            next += steps / 8;
        }
    })?;
    let pool: usize = values.get("pool", 0)?;
    println!("by sections, {pool} at a time, {steps} steps in {:.1} s: {waits:?}", seconds(start));
    let shape = settings.shape(teacher.axis_count());
    let field = teacher.field(shape, state.training.parameters)?.folded();
    println!("  {}: {} numbers", field.shape, field.parameter_count());
    judge.tell("  factored", |group| judge.factored(&field, group));
    Ok(())
}

/// Teaches one network and measures it, telling it of the symmetry where that is asked; `from` is where its weights start.
fn one(
    values: &Values,
    Teaching { teacher, obstacle, symmetry }: &Teaching,
    judge: Option<&Judge<'_>>,
    from: Option<&FactoredField>,
) -> Result<FactoredField, Failure> {
    let mut settings = settings(values)?;
    if let Some(from) = from {
        settings.symmetry = from.shape.symmetry;
    } else if values.get("symmetry", 0)? == 1 {
        settings.symmetry = *symmetry;
    }
    let steps: u64 = match values.get("steps", 0)? {
        0 => {
            const TRIAL: u64 = 20;
            settings.plan.length = Length::Steps(TRIAL);
            let start = Instant::now();
            distil(
                teacher,
                &settings,
                &mut settings.start(settings.outputs(teacher)),
                Control::quiet(),
                &mut |_| {},
            )?;
            (values.get("seconds", 60.0)? * TRIAL as f64 / seconds(start)) as u64
        }
        steps => steps,
    };
    settings.plan.length = Length::Steps(steps);
    let mut state = match from {
        Some(from) => start_from(from, teacher, obstacle)?,
        None => settings.start(settings.outputs(teacher)),
    };
    let start = Instant::now();
    let mut next = steps / 8;
    distil(teacher, &settings, &mut state, Control::quiet(), &mut |report| {
        if report.step >= next {
            println!(
                "  {:6.1} s step {:6} of {steps}: loss {:.3e}",
                seconds(start),
                report.step,
                report.mean_loss
            );
            next += steps / 8;
        }
    })?;
    let spent = seconds(start);
    let names = ["width", "hidden", "omega", "rate", "batch", "soap", "look", "solve", "loss", "beta2"];
    let told: Vec<String> =
        names.iter().filter_map(|&n| values.0.get(n).map(|v| format!("{n}={v}"))).collect();
    println!(
        "[{}] {steps} steps in {spent:.1} s, {:.2} ms a step",
        told.join(" "),
        spent * 1e3 / steps as f64
    );
    let field =
        FactoredField::new(teacher, settings.shape(settings.outputs(teacher)), state.training.parameters)?;
    let field = if values.get("fold", 1)? == 1 { field.folded() } else { field };
    println!(
        "  {}: {} weights, axes and mean among them, {} bytes in f32",
        field.shape,
        field.parameter_count(),
        field.bytes()
    );
    let Some(judge) = judge else { return Ok(field) };
    judge.tell("  factored", |group| judge.factored(&field, group));
    if values.get("evaluate", 0)? == 1 {
        let half = |values: &[f32]| values.iter().map(|&w| half::f16::from_f32(w).to_f32()).collect();
        let halves =
            FactoredField { parameters: half(&field.parameters), axes: half(&field.axes), ..field.clone() };
        judge.tell("  weights in f16", |group| judge.factored(&halves, group));
        evaluate(&field, teacher)?;
        single_poses(&field)?;
        println!("  with weights in f16:");
        single_poses(&halves)?;
    }
    Ok(field)
}

/// Times of whole fields, single poses and batches; the best of a few.
fn evaluate(field: &FactoredField, teacher: &HarmonicField) -> Result<(), Failure> {
    let evaluator = field.evaluator();
    let voxels = field.grid.len();
    let set = OrientationSet::parse("fibonacci:225")?.orientations;
    let heads = field.direction_weights(&set);
    let mut sections = vec![0.0; voxels * set.len()];
    let mut expanded = None;
    let once = best(2, || expanded = Some(evaluator.expanded(Precision::F32, teacher.report)));
    if let Some(expanded) = expanded {
        let product = best(3, || expanded.sections(&heads, &mut sections));
        println!("  fibonacci:225: g {once:.3} s once, product {product:.3} s");
        let product = best(3, || drop(black_box(expanded.minimum(&heads))));
        println!("  fibonacci:225: IMF from known coefficients {product:.3} s");
    }
    println!(
        "  fibonacci:225: sections in {:.3} s together",
        best(2, || evaluator.sections(&heads, &mut sections))
    );
    drop(sections);
    let many = OrientationSet::parse("fibonacci:10000")?.orientations;
    let start = Instant::now();
    let heads = field.direction_weights(&many);
    let prepared = seconds(start);
    black_box(evaluator.minimum(&heads));
    println!("  fibonacci:10000: IMF in {:.2} s (directions {prepared:.2} s of it)", seconds(start));

    let position = |index: usize| place(field, index);
    let total = 100_000;
    for (points, turns) in [(1000, 100), (1000, 10_000), (100_000, 10_000)] {
        let positions: Vec<DVec3> = (0..points).map(position).collect();
        let poses: Vec<[u32; 2]> =
            (0..total).map(|i| [(i * 7919 % points) as u32, (i * 104_729 % turns) as u32]).collect();
        let mut overlaps = vec![0.0; total];
        let all = best(3, || {
            let heads = field.direction_weights(&many[..turns]);
            evaluator.poses(&positions, &heads, &poses, &mut overlaps);
        });
        println!("  {total} poses of {points} points and {turns} orientations: {:.2} million/s", 0.1 / all);
    }
    Ok(())
}

/// A position inside, another for every index.
fn place(field: &FactoredField, index: usize) -> DVec3 {
    let unit = DVec3::new(0.618_034, 0.754_878, 0.569_840) * (index as f64 + 0.5);
    field.grid.origin + field.grid.pitch * 0.5 + unit.fract() * (field.grid.size() - field.grid.pitch)
}

/// Times of single poses on one thread.
fn single_poses(field: &FactoredField) -> Result<(), Failure> {
    let evaluator = field.evaluator();
    let many = OrientationSet::parse("fibonacci:10000")?.orientations;
    let position = |index: usize| place(field, index);
    let mut scratch = PointScratch::default();
    // Short rounds, so that the best of them is one that no other process interrupted.
    let (count, rounds) = (50, 200);
    let each = |seconds: f64| seconds * 1e6 / count as f64;
    let directions: Vec<DVec3> = many.iter().map(Orientation::direction).collect();
    let value = best(rounds, || {
        for index in 0..count {
            black_box(evaluator.overlap(position(index), &many[index], &mut scratch));
        }
    });
    let gradient = best(rounds, || {
        for index in 0..count {
            black_box(evaluator.overlap_with_gradient(position(index), directions[index], &mut scratch));
        }
    });
    let repeated = best(rounds, || {
        if let Some(mut point) = evaluator.point(position(1), &mut scratch) {
            for direction in &directions[..count] {
                black_box(point.gradient(*direction));
            }
        }
    });
    println!(
        "  single poses: value {:.1} µs, with gradients {:.1} µs, with gradients at a known point {:.1} µs",
        each(value),
        each(gradient),
        each(repeated)
    );
    Ok(())
}

/// Exact sections at random directions.
struct Judge<'a> {
    random: &'a [Orientation],
    exact: &'a [Vec<f32>],
}

impl Judge<'_> {
    fn factored(&self, field: &FactoredField, group: &[Orientation]) -> Vec<f32> {
        let mut values = vec![0.0; field.grid.len() * group.len()];
        field.evaluator().sections(&field.direction_weights(group), &mut values);
        values
    }

    fn tell(&self, name: &str, sections: impl Fn(&[Orientation]) -> Vec<f32>) {
        let mut errors = Errors::default();
        // Half at a time: 256 sections of the teapot are 550 MB.
        for (random, exact) in self.random.chunks(128).zip(self.exact.chunks(128)) {
            let values = sections(random);
            for (exact, values) in exact.iter().zip(values.chunks_exact(exact[0].len())) {
                errors.add(exact, values, 1e-3);
            }
        }
        let r = errors.report(1e-3);
        println!(
            "{name}: MSE {:.3e}, MAE {:.3e}, MPE {:.4}; false free {:.4}, false colliding {:.4}, IoU {:.4}",
            r.mse, r.mae, r.mpe, r.false_free, r.false_colliding, r.iou
        );
    }
}

fn seconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

/// Least seconds of several calls.
fn best(rounds: usize, mut work: impl FnMut()) -> f64 {
    (0..rounds)
        .map(|_| {
            let start = Instant::now();
            work();
            seconds(start)
        })
        .fold(f64::INFINITY, f64::min)
}
