//! What cannot be done is refused with cause and remedy: wrong lengths, networks beyond the adapter's limits, adapters
//! that are not there, faults on the device.

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::{EvaluationEngine, SirenShape};
use imf_gpu::{DeviceChoice, Gpu, GpuEvaluator, GpuLimits, GpuTrainer, TrainerSettings, adapters, wgpu};
use imf_train::training::TrainingEngine;

use crate::devices::open;

const SHAPE: SirenShape = SirenShape { width: 8, hidden: 2, skip_after: None, omega: 30.0 };

fn trainer(gpu: &Gpu) -> GpuTrainer {
    let state = TrainingState::new(&SHAPE, 1);
    GpuTrainer::new(gpu, SHAPE.stack(), &TrainerSettings::default(), 16, &state).unwrap()
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn wrong_lengths_are_shape_errors() {
    let gpu = open();
    let mut trainer = trainer(&gpu);
    let mut refused = |inputs: usize, targets: usize| {
        let error = trainer.step(&vec![0.0; inputs], &vec![0.0; targets], 1e-3).unwrap_err();
        assert!(matches!(error, EngineError::Shape(_)), "{error}");
    };
    refused(9, 2);
    refused(0, 0);
    refused(85, 17);
    let mut short = TrainingState::new(&SHAPE, 1);
    short.second_moment.pop();
    let error = GpuTrainer::new(&gpu, SHAPE.stack(), &TrainerSettings::default(), 16, &short).unwrap_err();
    assert!(error.to_string().contains("second moments"), "{error}");

    let mut evaluator = GpuEvaluator::new(&gpu, SHAPE, &SHAPE.initial_parameters(1)).unwrap();
    assert!(evaluator.evaluate(&[0.0; 9], &mut [0.0; 2]).is_err());
    assert!(evaluator.minimum(&[[0.0; 3]], &[], &mut [0.0], &mut [0]).is_err());
    assert!(evaluator.minimum(&[[0.0; 3]], &[[0.0; 2]], &mut [0.0; 2], &mut [0]).is_err());
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_network_beyond_the_limits_is_refused_with_the_estimate() {
    let limits = GpuLimits { storage_binding: 1 << 20, buffer: 1 << 20, workgroups: 65_535 };
    let gpu = open().with_limits(limits);
    let shape = SirenShape::paper();
    let error = GpuTrainer::memory_bytes(&gpu, shape, 1024).unwrap_err().to_string();
    assert!(error.contains("MiB of GPU memory") && error.contains("at most 1.00 MiB"), "{error}");
    assert!(GpuEvaluator::new(&gpu, shape, &shape.initial_parameters(1)).is_err());
    let gpu = open().with_limits(GpuLimits { workgroups: 2, ..open().limits() });
    let error = GpuEvaluator::new(&gpu, shape, &shape.initial_parameters(1)).unwrap_err().to_string();
    assert!(error.contains("workgroups"), "{error}");
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_adapter_is_listed_and_described() {
    let gpu = open();
    assert!(adapters().contains(gpu.adapter()));
    let text = gpu.describe();
    assert!(text.contains(&gpu.adapter().name) && text.contains("MiB"), "{text}");
    println!("{text}");
    let error = Gpu::open(&DeviceChoice::Name("no such adapter".to_owned())).unwrap_err().to_string();
    assert!(error.contains(&gpu.adapter().name), "{error}");
    let again = Gpu::open(&DeviceChoice::Index(gpu.adapter().index)).unwrap();
    assert_eq!(again.adapter(), gpu.adapter());
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_fault_on_the_device_becomes_an_error_of_the_next_call() {
    let gpu = open();
    let mut trainer = trainer(&gpu);
    trainer.step(&[0.0; 5], &[0.5], 1e-3).unwrap();
    // A buffer that no adapter makes; nobody looks at the result.
    drop(gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 8,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    }));
    let error = trainer.step(&[0.0; 5], &[0.5], 1e-3).unwrap_err();
    assert!(matches!(&error, EngineError::Device(text) if text.contains("refused a call")), "{error}");
    assert!(trainer.state().is_err() && trainer.take_mean_loss().is_err());
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_lost_device_is_an_error_not_a_panic() {
    let gpu = open();
    let mut trainer = trainer(&gpu);
    gpu.device().destroy();
    let outcome = trainer.step(&[0.0; 5], &[0.5], 1e-3).and_then(|()| trainer.take_mean_loss().map(|_| ()));
    assert!(matches!(outcome, Err(EngineError::Device(_))), "{outcome:?}");
}
