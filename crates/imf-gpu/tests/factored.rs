//! Factored fields on the adapter: evaluated as the CPU evaluates them, taught as the definition has it, to the same error,
//! and to the same bits again.

mod adapter;
mod every_device;

use every_device::every_device;
use glam::DVec3;
use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, Imf, Quantity, SectionPlan};
use imf_core::tool::Tool;
use imf_fields::factored::reference::loss_and_gradient;
use imf_fields::factored::{
    Axis, DistillSettings, FactoredField, FactoredShape, FactoredState, INPUTS, Symmetry,
};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit};
use imf_fields::recipe::Loss;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::SoapConfig;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{Length, TrainingPlan};
use imf_gpu::{Gpu, GpuFactored, GpuTrainer, TrainerSettings};
use imf_train::distill::{distil, distil_on};

fn teacher() -> HarmonicField {
    let mesh = ReferencePart::Teapot.mesh();
    let tool = Tool::paper();
    let scene = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    let scene = scene.scene().expect("a scene");
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, At::SharpPoints).expect("a plan");
    let settings = FitSettings {
        quantity: Quantity::Overlap,
        degree: 5,
        sections_per_function: 3.0,
        axes: 21,
        precision: Precision::F32,
        sample: 4096,
        held_out: 16,
        seed: 0,
        one_pass: true,
    };
    fit(&plan, Domain::Directions, &settings, Control::quiet()).expect("a harmonic field")
}

fn settings(steps: u64) -> DistillSettings {
    DistillSettings {
        width: 40,
        hidden: 2,
        omega: 10.0,
        plan: TrainingPlan {
            length: Length::Steps(steps),
            batch: 300,
            schedule: Schedule::Cosine { initial: 3e-3, last: 0.0, warmup: 10 },
            ..DistillSettings::default().plan
        },
        optimiser: Optimiser::Adam,
        ..DistillSettings::default()
    }
}

fn orientations(set: &str) -> Vec<Orientation> {
    OrientationSet::parse(set).expect("a set").orientations
}

fn engine(
    gpu: &Gpu,
    settings: &DistillSettings,
    teacher: &HarmonicField,
    state: &FactoredState,
) -> GpuTrainer {
    let stack = settings.shape(teacher.axis_count()).stack();
    let TrainingPlan { adam, loss, .. } = settings.plan;
    let learning =
        TrainerSettings { adam, loss, optimiser: settings.optimiser, ..TrainerSettings::default() };
    GpuTrainer::of_stack(gpu, stack, &learning, settings.batch(teacher), &state.training).expect("an engine")
}

fn voxel_centres(field: &FactoredField) -> Vec<DVec3> {
    let grid = field.grid;
    (0..grid.len()).map(|voxel| grid.centre(grid.voxel(voxel))).collect()
}

/// Sections and minima at every voxel over a set of orientations.
fn compare(set: &str, field: &FactoredField) {
    let (grid, points) = (field.grid, voxel_centres(field));
    let evaluator = field.evaluator();
    let orientations = orientations(set);
    let heads = field.direction_weights(&orientations);
    let mut expected = vec![0.0; orientations.len() * grid.len()];
    evaluator.sections(&heads, &mut expected);
    let least = evaluator.minimum(&heads);
    for gpu in every_device() {
        let mut found = GpuFactored::new(&gpu, field).expect("a field");
        let name = format!("{set}, {}", gpu.matrix_kernel().name());
        let sections = found.sections(&points, &orientations).expect("sections");
        // Coefficients of some units from sums of f32 in another order, and a product of 21 of them.
        let tolerance = 2e-5;
        let worst = sections.iter().zip(&expected).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        println!("{name}: {worst:.1e}");
        assert!(worst < tolerance, "{name}: {worst}");
        let Imf { value: values, best } = found.minimum(&points, &orientations).expect("minima");
        let mut others = 0;
        for voxel in 0..grid.len() {
            assert!((values[voxel] - least.value[voxel]).abs() < tolerance, "{name}, voxel {voxel}");
            let chosen = sections[best[voxel] as usize * grid.len() + voxel];
            assert!((chosen - values[voxel]).abs() < tolerance, "{name}, voxel {voxel}: not its value");
            others += usize::from(best[voxel] != least.best[voxel]);
        }
        // Where two orientations are within rounding of each other.
        assert!(others < grid.len() / 100, "{name}: {others} other orientations");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn sections_and_minima_are_the_cpus() {
    let teacher = teacher();
    let settings = settings(1);
    let shape = settings.shape(teacher.axis_count());
    // Random weights at a scale where values lie on both sides of 0 and of 1, so that clipping is met.
    let mut field = FactoredField::new(&teacher, shape, shape.initial_parameters(3)).unwrap();
    field.scale = 1.0;
    let folded = field.clone().folded();
    assert!(folded.shape.folded);
    let points = voxel_centres(&field);
    // One chunk, and more than one with a last one that is not full.
    for (set, field) in [("fibonacci:37", &field), ("fibonacci:700", &field), ("fibonacci:37", &folded)] {
        compare(set, field);
    }
    let error = GpuFactored::new(&adapter::open(), &field).unwrap().minimum(&points, &[]).unwrap_err();
    assert!(error.to_string().contains("at least one orientation"), "{error}");
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn sections_and_minima_of_fields_with_symmetry_are_the_cpus() {
    let teacher = teacher();
    // The planes hold voxel centres, and so does an axis.
    assert!(teacher.grid.dims.iter().all(|n| n % 2 == 1), "{:?}", teacher.grid.dims);
    let middle = teacher.grid.origin + 0.5 * teacher.grid.size();
    let [x, y, z] = middle.to_array();
    let axis = |along| Some(Axis { along, through: middle });
    for symmetry in [
        Symmetry { mirrors: [Some(x), None, Some(z)], axis: None },
        Symmetry { mirrors: [None; 3], axis: axis(0) },
        Symmetry { mirrors: [Some(x), Some(y), Some(z)], axis: axis(1) },
        Symmetry { mirrors: [None, Some(y), None], axis: axis(2) },
    ] {
        let shape = settings(1).shape(teacher.axis_count());
        let field = FactoredField::new(&teacher, shape, shape.initial_parameters(3)).unwrap();
        let shape = FactoredShape { symmetry, ..shape };
        let field = FactoredField { shape, parameters: shape.initial_parameters(3), scale: 1.0, ..field };
        println!("{symmetry}");
        compare("fibonacci:37", &field);
        compare("fibonacci:37", &field.folded());
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_gradient_is_the_definitions() {
    for (width, hidden, axes, count) in [(37, 3, 21, 77), (64, 2, 64, 128), (9, 1, 1, 5)] {
        let symmetry = Symmetry::default();
        let shape = FactoredShape { width, hidden, omega: 20.0, axes, folded: false, symmetry };
        let state = FactoredState::new(&shape, 5);
        let numbers = |count: usize, step: f64| -> Vec<f32> {
            (0..count).map(|i| ((i as f64 * step).fract() * 2.0 - 1.0) as f32).collect()
        };
        let (inputs, targets) = (numbers(count * INPUTS, 0.618_034), numbers(count * axes, 0.754_878));
        let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let rows: Vec<[f64; INPUTS]> =
            inputs.chunks(INPUTS).map(|row| std::array::from_fn(|i| f64::from(row[i]))).collect();
        for loss in [Loss::L1, Loss::L2] {
            let parameters = wide(&state.training.parameters);
            let (value, expected) = loss_and_gradient(&shape, &parameters, &rows, &wide(&targets), loss);
            let scale = expected.iter().fold(0.0f64, |top, g| top.max(g.abs()));
            for gpu in every_device() {
                let learning = TrainerSettings { loss, ..TrainerSettings::default() };
                let mut trainer =
                    GpuTrainer::of_stack(&gpu, shape.stack(), &learning, count + 9, &state.training).unwrap();
                trainer.fill_scratch(f32::NAN).unwrap();
                let (found_value, found) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
                let name = format!("{shape:?}, {loss:?}, {}", gpu.matrix_kernel().name());
                assert!((found_value - value).abs() < 1e-5 * value, "{name}: {found_value}, not {value}");
                // As of the CPU engine: some 100 units in the last place of the largest gradient.
                for (&found, &expected) in found.iter().zip(&expected) {
                    let error = (f64::from(found) - expected).abs();
                    assert!(error <= 2e-5 * scale, "{name}: {found}, not {expected}");
                }
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn teaching_reaches_the_cpus_error_and_goes_on_to_the_same_bits() {
    let teacher = teacher();
    let gpu = adapter::open();
    let axes = teacher.axis_count();
    for optimiser in [Optimiser::Adam, Optimiser::Soap(SoapConfig::default())] {
        let all = DistillSettings { optimiser, ..settings(300) };
        let run = |stop: bool| {
            let mut state = all.start(axes);
            let mut told = 0.0;
            if stop {
                // Asked to stop wherever the observer is told something: twice.
                let cancelled = std::sync::atomic::AtomicBool::new(true);
                let control = Control { cancelled: &cancelled, ..Control::quiet() };
                for _ in 0..2 {
                    let mut engine = engine(&gpu, &all, &teacher, &state);
                    distil_on(&teacher, &all, &mut state, &mut engine, control, &mut |_| {}).unwrap();
                }
                assert!(state.training.step > 0 && state.training.step < 300, "{}", state.training.step);
            }
            let mut engine = engine(&gpu, &all, &teacher, &state);
            let mut observe = |report: &imf_train::training::run::Report| told = report.mean_loss;
            distil_on(&teacher, &all, &mut state, &mut engine, Control::quiet(), &mut observe).unwrap();
            (state.training, told)
        };
        let (training, told) = run(false);
        assert!(run(true).0 == training, "{optimiser:?}: stopped on the way, it ended elsewhere");
        let mut state = all.start(axes);
        let mut of_cpu = 0.0;
        distil(&teacher, &all, &mut state, Control::quiet(), &mut |report| of_cpu = report.mean_loss)
            .unwrap();
        println!("{optimiser:?}: GPU {told:.2e}, CPU {of_cpu:.2e}");
        // Roundings part the two a little more with every step.
        assert!((told / of_cpu - 1.0).abs() < 0.1, "{optimiser:?}: {told} on the GPU, {of_cpu} on the CPU");
    }
}
