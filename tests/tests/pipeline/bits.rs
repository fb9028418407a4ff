//! The same seed gives the same bits: in datasets, on the CPU with any number of threads, on the GPU, and through the
//! model file.

use std::ops::ControlFlow;

use imf_core::control::Control;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingState;
use imf_fields::recipe::divergence::Watch;
use imf_fields::recipe::{Cursor, Length, TrainingPlan};
use imf_fields::siren::SirenShape;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::over_grid;
use imf_gpu::{GpuEvaluator, GpuTrainer, TrainerSettings};
use imf_train::dataset::generate;
use imf_train::engine::CpuTrainer;
use imf_train::samples::Samples;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Outcome, train};

use crate::scene::{SMALL, adapter, angles, bits, bracket, on_threads, orientations, samples};

const SHAPE: SirenShape = SirenShape { width: 37, hidden: 4, skip_after: Some(2), omega: 30.0 };

/// An epoch and a part, in batches that leave a remainder.
fn plan(steps: u64) -> TrainingPlan {
    TrainingPlan { length: Length::Steps(steps), batch: 301, seed: 5, ..TrainingPlan::default() }
}

fn run(plan: &TrainingPlan, samples: &Samples, engine: &mut dyn TrainingEngine) -> TrainingState {
    let outcome = train(plan, samples, engine, Cursor::default(), &mut |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.unwrap(), Outcome::Finished);
    engine.state().unwrap()
}

fn trained_on_cpu(shape: SirenShape, plan: &TrainingPlan, samples: &Samples, seed: u64) -> TrainingState {
    let start = TrainingState::new(&shape, seed);
    let mut engine = CpuTrainer::new(shape, plan.adam, plan.loss, plan.batch, start).unwrap();
    run(plan, samples, &mut engine)
}

/// Weights in the midst of learning the small bracket.
pub(crate) fn trained(shape: SirenShape) -> Vec<f32> {
    let (_, samples) = samples(&bracket(), &orientations("fibonacci:16"), 0.35);
    trained_on_cpu(shape, &plan(60), &samples, 7).parameters
}

#[test]
fn datasets_do_not_depend_on_threads() {
    let files = |threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        on_threads(threads, || {
            let set = orientations("random:9:1");
            generate(folder.path(), &bracket(), &set, &Sampling::default(), Control::quiet()).unwrap();
        });
        let mut files: Vec<_> = std::fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap())
            .map(|entry| (entry.file_name(), std::fs::read(entry.path()).unwrap()))
            .collect();
        files.sort();
        files
    };
    let one = files(1);
    assert_eq!(one.len(), 3, "manifest, obstacle, one shard");
    assert!(files(3) == one, "three threads wrote other files");
}

#[test]
fn the_same_seed_gives_the_same_weights_on_any_number_of_threads() {
    let (_, samples) = samples(&bracket(), &orientations("fibonacci:16"), 0.35);
    let plan = plan(50);
    let weights = |threads, seed| {
        bits(&on_threads(threads, || trained_on_cpu(SHAPE, &plan, &samples, seed)).parameters)
    };
    let one = weights(1, 7);
    for threads in [1, 2, 3] {
        assert!(weights(threads, 7) == one, "{threads} threads ended elsewhere");
    }
    assert!(weights(1, 8) != one, "another seed ends elsewhere");
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_same_seed_gives_the_same_weights_and_values_on_the_gpu() {
    let (_, samples) = samples(&bracket(), &orientations("fibonacci:16"), 0.35);
    let plan = plan(40);
    let once = || {
        let gpu = adapter();
        let start = TrainingState::new(&SHAPE, 7);
        let settings = TrainerSettings { adam: plan.adam, loss: plan.loss, ..TrainerSettings::default() };
        let mut engine = GpuTrainer::new(&gpu, SHAPE.stack(), &settings, plan.batch, &start).unwrap();
        let weights = run(&plan, &samples, &mut engine).parameters;
        let mut evaluator = GpuEvaluator::new(&gpu, SHAPE, &weights).unwrap();
        let mut values = vec![f32::NAN; SMALL.iter().product()];
        over_grid::section(&mut evaluator, &samples.grid, [200.0, 33.0], &mut values).unwrap();
        (bits(&weights), bits(&values))
    };
    assert!(once() == once(), "the same seed ended elsewhere");
}

#[test]
fn a_model_that_was_written_and_read_evaluates_as_before() {
    let scene = bracket();
    let set = orientations("fibonacci:16");
    let (manifest, samples) = samples(&scene, &set, 0.35);
    let plan = plan(50);
    let state = trained_on_cpu(SHAPE, &plan, &samples, 7);
    let record = TrainingRecord {
        program: "test".into(),
        plan,
        cursor: Cursor::default(),
        watch: Watch::default(),
        finished: true,
        steps: state.step,
        seconds: 0.25,
        engine: "CPU".into(),
        orientations: manifest.orientations.clone(),
        sampling: manifest.sampling,
        samples: samples.len() as u64,
        dataset_crc32: manifest.fingerprint(),
        groups_per_epoch: None,
        fine_tuned_from: None,
        losses: Vec::new(),
        pending_loss: (0.0, 0),
        held_out: None,
    };
    let model = Model { shape: SHAPE, scene, record, state, calibration: None };
    let angles = angles(&set);
    let evaluate = |model: &Model| {
        let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
        let grid = model.scene.record.grid;
        let mut values = vec![f32::NAN; model.scene.record.grid.len()];
        over_grid::section(&mut engine, &grid, [12.0, 6.0], &mut values).unwrap();
        let least = over_grid::minimum(&mut engine, &grid, &angles, Control::quiet()).unwrap();
        (bits(&values), bits(&least.value), least.best)
    };
    let before = evaluate(&model);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    model.clone().without_moments().write(&path).unwrap();
    let read = Model::read(&path).unwrap();
    // Seconds are in the log of a training alone, so that equal trainings make equal files.
    let record = TrainingRecord { seconds: 0.0, ..model.record.clone() };
    assert_eq!((&read.scene, &read.record), (&model.scene, &record));
    assert!(evaluate(&read) == before, "the file changed the field");
}
