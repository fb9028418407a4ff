//! The fast engine against the f64 definition, the field against its harmonic and central differences, and against itself
//! read back.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::DVec3;

use super::output_layer::{SOLVED_FIRST, solve_output_layer};
use super::warm_start::parameters_for;
use super::*;
use crate::engine::CpuTrainer;
use crate::fixtures::{as_f64, assert_gradient, numbers, on_threads, rows};
use crate::training::TrainingEngine;
use crate::training::run::{Outcome, TrainError};
use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{Imf, Quantity, SectionPlan, ToolPoints};
use imf_core::tool::Tool;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::targets::Targets;
use imf_fields::factored::{
    DistillSettings, FactoredEvaluator, FactoredField, FactoredShape, INPUTS, PointScratch, Symmetry,
    reference,
};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit};
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{
    AdamConfig, Cursor, Loss, Optimiser, SoapConfig, TrainingLength, TrainingPlan, TrainingState,
};
use imf_fields::siren::lanes::archs;

/// A coarse teapot.
fn scene() -> Scene {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool).scene().unwrap()
}

fn plan(scene: &Scene) -> SectionPlan {
    SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap()
}

const FIT: FitSettings = FitSettings {
    quantity: Quantity::Overlap,
    degree: 5,
    sections_per_function: 3.0,
    components: 21,
    precision: StoragePrecision::F32,
    sample: 4096,
    held_out: 16,
    seed: 0,
    one_pass: true,
};

fn harmonic() -> HarmonicField {
    fit(&plan(&scene()), Domain::Directions, &FIT, Control::quiet()).unwrap()
}

/// Every one, SOAP with looks between the places where tests stop it.
const OPTIMISERS: [Optimiser; 2] =
    [Optimiser::Adam, Optimiser::Soap(SoapConfig { beta: 0.95, precondition_every: 4, rate: 1.0 })];

fn settings(steps: u64) -> DistillSettings {
    DistillSettings {
        width: 40,
        hidden: 2,
        omega: 10.0,
        plan: TrainingPlan {
            length: TrainingLength::Steps(steps),
            batch: 300,
            schedule: Schedule::Cosine { initial: 3e-3, last: 0.0, warmup: 10 },
            report_every: 7,
            ..DistillSettings::default().plan
        },
        solve_every: 20,
        ..DistillSettings::default()
    }
}

fn shape(width: usize, hidden: usize, omega: f32, components: usize) -> FactoredShape {
    FactoredShape { width, hidden, omega, components, folded: false, symmetry: Symmetry::default() }
}

/// The largest difference.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// The mean square of the differences.
fn mean_square<'a>(a: &[f32], b: impl IntoIterator<Item = &'a f32>) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64
}

/// As of the engine of the paper's network: some 100 units in the last place of the largest gradient.
const GRADIENT_TOLERANCE: f64 = 2e-5;

#[test]
fn the_gradient_is_the_definitions() {
    for (width, hidden, components, count) in
        [(37, 3, 21, 77), (70, 2, 130, 300), (9, 1, 1, 5), (300, 2, 64, 130)]
    {
        let shape = shape(width, hidden, 20.0, components);
        for loss in [Loss::L1, Loss::L2] {
            let state = TrainingState::from_parameters(shape.initial_parameters(5));
            let weights = as_f64(&state.parameters);
            let adam = AdamConfig::default();
            let mut trainer = CpuTrainer::new(shape.stack(), adam, loss, count, state).unwrap();
            let (inputs, targets) = (numbers(count * INPUTS, 1), numbers(count * components, 2));
            let (value, gradient) =
                reference::loss_and_gradient(&shape, &weights, &rows(&inputs), &as_f64(&targets), loss);
            let (_, found) = trainer.gradient(&inputs, &targets, count).unwrap();
            assert_gradient(found, &gradient, GRADIENT_TOLERANCE, &format!("{shape:?} {loss:?}"));
            trainer.step(&inputs, &targets, 1e-4).unwrap();
            let found = trainer.take_mean_loss().unwrap();
            assert!((found - value).abs() <= 1e-5 * value, "{shape:?} {loss:?}: loss {found}, not {value}");
        }
    }
}

#[test]
fn the_definitions_gradient_and_jacobian_are_central_differences() {
    let shape = shape(6, 3, 3.0, 4);
    let weights = as_f64(&shape.initial_parameters(3));
    let (inputs, targets) = ([[0.3, -0.2, 0.7], [0.9, 0.4, -0.6]], as_f64(&numbers(8, 4)));
    let value = |w: &[f64]| reference::loss_and_gradient(&shape, w, &inputs, &targets, Loss::L2).0;
    let (_, gradient) = reference::loss_and_gradient(&shape, &weights, &inputs, &targets, Loss::L2);
    // h²·|f‴|/6 + ε/h at h = 1e-5.
    let tolerance = 2e-8;
    for index in 0..weights.len() {
        let mut probe = weights.clone();
        probe[index] += 1e-5;
        let above = value(&probe);
        probe[index] -= 2e-5;
        let slope = (above - value(&probe)) / 2e-5;
        assert!((slope - gradient[index]).abs() < tolerance, "{index}: {slope}, {}", gradient[index]);
    }
    let jacobian = reference::jacobian(&shape, &weights, &inputs[0]);
    for axis in 0..INPUTS {
        let mut probe = inputs[0];
        probe[axis] += 1e-5;
        let above = reference::forward(&shape, &weights, &probe);
        probe[axis] -= 2e-5;
        let below = reference::forward(&shape, &weights, &probe);
        for output in 0..shape.components {
            let slope = (above[output] - below[output]) / 2e-5;
            assert!((slope - jacobian[output][axis]).abs() < tolerance, "{output} by {axis}");
        }
    }
}

/// A state of random weights whose field is not a constant.
fn field(harmonic: &HarmonicField, width: usize) -> FactoredField {
    let shape = shape(width, 3, 8.0, harmonic.component_count());
    FactoredField::new(harmonic, shape, shape.initial_parameters(2)).unwrap()
}

/// What a field is by definition of its network's outputs and its functions' values, not clipped: `Σ b_k (μ_k + s Σ U_ka z_a)`.
fn defined(field: &FactoredField, z: &[f64], functions: &[f64]) -> f64 {
    let of_function = |(k, b): (usize, &f64)| {
        let row = &field.components[k * z.len()..][..z.len()];
        let sum: f64 = row.iter().zip(z).map(|(&u, z)| f64::from(u) * z).sum();
        b * (f64::from(field.mean[k]) + f64::from(field.scale) * sum)
    };
    functions.iter().enumerate().map(of_function).sum()
}

/// The mean squared error of the coefficients, which is that of the field over the sphere.
fn error(field: &FactoredField, harmonic: &HarmonicField) -> f64 {
    let expanded = field.evaluator().expanded(StoragePrecision::F32, harmonic.report);
    let (mut a, mut b) = (Vec::new(), Vec::new());
    let found = expanded.coefficients.read(0, expanded.coefficients.len(), &mut a);
    let distilled = harmonic.coefficients.read(0, harmonic.coefficients.len(), &mut b);
    mean_square(found, distilled) * harmonic.component_count() as f64
}

#[test]
fn distillation_brings_the_field_to_the_harmonic_one_with_every_optimiser() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    let constant =
        f64::from(Targets::new(&harmonic, Symmetry::default()).unwrap().scale).powi(2) * components as f64;
    for optimiser in OPTIMISERS {
        let settings = DistillSettings { optimiser, ..settings(400) };
        let mut state = settings.start(components);
        let mut reported = 0.0;
        let steps = AtomicU64::new(0);
        let count = |done| {
            steps.fetch_add(done, Ordering::Relaxed);
        };
        let control = Control { progress: &count, ..Control::quiet() };
        distil(&harmonic, &settings, &mut state, control, &mut |report| reported = report.mean_loss).unwrap();
        assert_eq!(steps.into_inner(), 400);
        let field =
            FactoredField::new(&harmonic, settings.shape(components), state.training.parameters).unwrap();
        let found = error(&field, &harmonic);
        assert!(found < 0.02 * constant, "{optimiser:?}: {found} of {constant}");
        // The loss of the last steps' batches is that of all voxels, nearly.
        let ratio = reported / found;
        assert!((0.5..2.0).contains(&ratio), "{optimiser:?}: reported {reported}, found {found}");
    }
}

#[test]
fn the_closed_form_output_layer_is_that_of_least_squares() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    let mut field = field(&harmonic, 17);
    let shape = field.shape;
    // All voxels: what the definition sums over.
    let targets = Targets::new(&harmonic, Symmetry::default()).unwrap();
    solve_output_layer(&mut field, &targets, usize::MAX / 1000, 0.0);
    let (columns, voxels) = (shape.width + 1, harmonic.grid.len());
    let (mut last, mut outputs) = (vec![0.0; voxels * columns], vec![0.0; voxels * components]);
    let centres = (0..voxels).map(|voxel| harmonic.grid.centre(harmonic.grid.voxel(voxel)));
    field.evaluator().with_last_layer(centres, &mut last, &mut outputs);
    let last = nalgebra::DMatrix::from_row_slice(voxels, columns, &as_f64(&last));
    let mut scratch = Vec::new();
    let z = harmonic.coefficients.read(0, harmonic.coefficients.len(), &mut scratch);
    let targets = nalgebra::DMatrix::from_row_slice(voxels, components, &as_f64(z)) / f64::from(field.scale);
    let expected = last.clone().svd(true, true).solve(&targets, 1e-9).unwrap();
    let layer = shape.layers()[shape.hidden];
    let mean = |difference: nalgebra::DMatrix<f64>| difference.norm_squared() / voxels as f64;
    let best = mean(&last * &expected - &targets);
    let found = mean(nalgebra::DMatrix::from_row_slice(voxels, components, &as_f64(&outputs)) - &targets);
    // The pull to 0 is a millionth of the sines' mean square.
    assert!(found >= best * (1.0 - 1e-6) && found <= best * 1.001, "{found}, the least is {best}");
    assert_eq!(layer.outputs, components);
    assert_eq!((outputs.len(), layer.biases + components), (voxels * components, field.parameters.len()));
}

#[test]
fn solving_now_and_then_learns_more_in_as_many_steps() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    let after = |solve_every: u64| {
        let optimiser = Optimiser::Soap(SoapConfig::default());
        let settings = DistillSettings { solve_every, optimiser, ..settings(100) };
        let mut state = settings.start(components);
        distil(&harmonic, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
        let field =
            FactoredField::new(&harmonic, settings.shape(components), state.training.parameters).unwrap();
        error(&field, &harmonic)
    };
    let [never, now_and_then] = [0, 20].map(after);
    assert!(now_and_then < 0.8 * never, "{now_and_then}, without {never}");
}

#[test]
fn short_trainings_begin_with_a_closed_form_output_layer() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    let first_loss = |steps: u64, solve_every: u64| {
        let settings = settings(steps);
        let plan = TrainingPlan { report_every: 1, ..settings.plan };
        let settings = DistillSettings { plan, solve_every, ..settings };
        let cancelled = AtomicBool::new(true);
        let control = Control { cancelled: &cancelled, ..Control::quiet() };
        let mut found = f64::NAN;
        distil(&harmonic, &settings, &mut settings.start(components), control, &mut |report| {
            assert_eq!(report.step, 1);
            found = report.mean_loss;
        })
        .unwrap();
        found
    };
    let long = first_loss(SOLVED_FIRST + 1, 20);
    assert_eq!(first_loss(SOLVED_FIRST, 0), long, "no layer is solved for where that is off");
    let short = first_loss(SOLVED_FIRST, 20);
    assert!(short < 0.1 * long, "{short}, not solved {long}");
}

#[test]
fn threads_and_interruptions_change_no_bit() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    for optimiser in OPTIMISERS {
        // Across the end of an epoch of 30 steps, whose last batch is smaller.
        let settings = DistillSettings { optimiser, ..settings(50) };
        let run = |threads: usize, stop: bool| {
            on_threads(threads, || {
                let mut state = settings.start(components);
                if stop {
                    let cancelled = AtomicBool::new(true);
                    let control = Control { cancelled: &cancelled, ..Control::quiet() };
                    for _ in 0..3 {
                        let outcome = distil(&harmonic, &settings, &mut state, control, &mut |_| {}).unwrap();
                        assert_eq!(outcome, Outcome::Stopped(state.cursor));
                    }
                    assert_eq!(state.cursor, Cursor { epoch: 0, step: 21 });
                }
                let quiet = Control::quiet();
                let outcome = distil(&harmonic, &settings, &mut state, quiet, &mut |_| {}).unwrap();
                assert_eq!(outcome, Outcome::Finished);
                state
            })
        };
        let one = run(1, false);
        for (threads, stop) in [(2, false), (3, true), (1, true)] {
            assert!(run(threads, stop) == one, "{optimiser:?}: {threads} threads, interrupted: {stop}");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let harmonic = harmonic();
    let components = harmonic.component_count();
    let start = settings(5).start(components);
    let refused = |settings: DistillSettings, words: &str| {
        let mut state = start.clone();
        let before = state.clone();
        let error = distil(&harmonic, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!(state, before);
    };
    refused(DistillSettings { omega: f32::NAN, ..settings(5) }, "frequency");
    refused(DistillSettings { width: 41, ..settings(5) }, "parameters");
    let soap = DistillSettings { optimiser: OPTIMISERS[1], ..settings(5) };
    let kept = 4 * 40 * 40;
    for (step, count) in [(3, 0), (3, kept - 1), (0, kept)] {
        let mut state = start.clone();
        (state.training.step, state.training.preconditioners) = (step, vec![0.0; count]);
        let error = distil(&harmonic, &soap, &mut state, Control::quiet(), &mut |_| {}).unwrap_err();
        assert!(error.to_string().contains("SOAP's means and axes"), "{error}");
    }
    let schedule = Schedule::Exponential { initial: 1e30, factor: 1.0, warmup: 0 };
    let plan = TrainingPlan { schedule, ..settings(2000).plan };
    let (steep, mut state) = (DistillSettings { plan, ..settings(5) }, start);
    let result = distil(&harmonic, &steep, &mut state, Control::quiet(), &mut |_| {});
    assert!(result.as_ref().is_err_and(TrainError::is_divergence), "{result:?}");
    let shape = settings(5).shape(components + 1);
    assert!(FactoredField::new(&harmonic, shape, shape.initial_parameters(1)).is_err());
}

mod calibration;
mod evaluators;
mod files;
mod symmetry;
