//! Factored fields trained on the adapter: by the definition's gradient, to the CPU's error, and to the same bits again.

use imf_core::control::Control;
use imf_core::section::{SectionPlan, ToolPoints};
use imf_fields::factored::reference::loss_and_gradient;
use imf_fields::factored::{DistillSettings, FactoredShape, FactoredState, INPUTS, Symmetry};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit};
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{Loss, Optimiser, SoapConfig, TrainingLength, TrainingPlan};
use imf_fields::siren::reference::{as_f64, rows};
use imf_gpu::{Gpu, GpuTrainer, TrainerSettings};
use imf_train::distill::{distil, distil_on};

use crate::devices::{every_device, numbers, open, worst};
use crate::fields::scene;
use crate::tolerances::GRADIENT_LINEAR;

fn teacher() -> HarmonicField {
    let scene = scene();
    let plan =
        SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).expect("a plan");
    let settings = FitSettings {
        degree: 5,
        sections_per_function: 3.0,
        components: 21,
        precision: StoragePrecision::F32,
        sample: 4096,
        held_out: 16,
        ..FitSettings::default()
    };
    fit(&plan, Domain::Directions, &settings, Control::quiet()).expect("a harmonic field")
}

fn settings(steps: u64) -> DistillSettings {
    DistillSettings {
        width: 40,
        hidden: 2,
        omega: 10.0,
        plan: TrainingPlan {
            length: TrainingLength::Steps(steps),
            batch: 300,
            schedule: Schedule::Cosine { initial: 3e-3, last: 0.0, warmup: 10 },
            ..DistillSettings::default().plan
        },
        optimiser: Optimiser::Adam,
        ..DistillSettings::default()
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_gradient_is_the_definitions() {
    for (width, hidden, components, count) in [(37, 3, 21, 77), (64, 2, 64, 128), (9, 1, 1, 5)] {
        let symmetry = Symmetry::default();
        let shape = FactoredShape { width, hidden, omega: 20.0, components, folded: false, symmetry };
        let state = FactoredState::new(&shape, 5);
        let (inputs, targets) = (numbers(count * INPUTS, 0.618_034), numbers(count * components, 0.754_878));
        let rows = rows::<INPUTS>(&inputs);
        for loss in [Loss::L1, Loss::L2] {
            let parameters = as_f64(&state.training.parameters);
            let (value, expected) = loss_and_gradient(&shape, &parameters, &rows, &as_f64(&targets), loss);
            for gpu in every_device() {
                let learning = TrainerSettings { loss, ..TrainerSettings::default() };
                let mut trainer =
                    GpuTrainer::new(&gpu, shape.stack(), &learning, count + 9, &state.training).unwrap();
                trainer.fill_scratch(f32::NAN).unwrap();
                let (found_value, found) = trainer.loss_and_gradient(&inputs, &targets).unwrap();
                let name = format!("{shape:?}, {loss:?}, {}", gpu.matrix_kernel().name());
                assert!((found_value - value).abs() < 1e-5 * value, "{name}: {found_value}, not {value}");
                let error = worst(&found, &expected, 0.0, GRADIENT_LINEAR);
                assert!(error <= 1.0, "{name}: gradient off by {error} tolerances");
            }
        }
    }
}

fn engine(
    gpu: &Gpu,
    settings: &DistillSettings,
    teacher: &HarmonicField,
    state: &FactoredState,
) -> GpuTrainer {
    let stack = settings.shape(teacher.component_count()).stack();
    let TrainingPlan { adam, loss, .. } = settings.plan;
    let learning =
        TrainerSettings { adam, loss, optimiser: settings.optimiser, ..TrainerSettings::default() };
    let batch = settings.batch(teacher);
    GpuTrainer::new(gpu, stack, &learning, batch, &state.training).expect("an engine")
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn distillation_reaches_the_cpus_error_and_goes_on_to_the_same_bits() {
    let teacher = teacher();
    let gpu = open();
    let components = teacher.component_count();
    for optimiser in [Optimiser::Adam, Optimiser::Soap(SoapConfig::default())] {
        let all = DistillSettings { optimiser, ..settings(300) };
        let run = |stop: bool| {
            let mut state = all.start(components);
            let mut of_gpu = 0.0;
            if stop {
                // Asked to stop at every report: twice.
                let cancelled = std::sync::atomic::AtomicBool::new(true);
                let control = Control { cancelled: &cancelled, ..Control::quiet() };
                for _ in 0..2 {
                    let mut engine = engine(&gpu, &all, &teacher, &state);
                    distil_on(&teacher, &all, &mut state, &mut engine, control, &mut |_| {}).unwrap();
                }
                assert!(state.training.step > 0 && state.training.step < 300, "{}", state.training.step);
            }
            let mut engine = engine(&gpu, &all, &teacher, &state);
            let mut observe = |report: &imf_train::training::run::Report| of_gpu = report.mean_loss;
            distil_on(&teacher, &all, &mut state, &mut engine, Control::quiet(), &mut observe).unwrap();
            (state.training, of_gpu)
        };
        let (training, of_gpu) = run(false);
        assert!(run(true).0 == training, "{optimiser:?}: stopped on the way, it ended elsewhere");
        let mut state = all.start(components);
        let mut of_cpu = 0.0;
        distil(&teacher, &all, &mut state, Control::quiet(), &mut |report| of_cpu = report.mean_loss)
            .unwrap();
        println!("{optimiser:?}: GPU {of_gpu:.2e}, CPU {of_cpu:.2e}");
        // Roundings part the two a little more with every step.
        let error = (of_gpu / of_cpu - 1.0).abs();
        assert!(error < 0.1, "{optimiser:?}: {of_gpu} on the GPU, {of_cpu} on the CPU");
    }
}
