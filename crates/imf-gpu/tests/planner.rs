//! Poses answered on the adapter for the paper's network against the same field on the CPU: values, gradients, decisions and
//! minima, from slices and from buffers of the device.

mod adapter;
mod asked;
mod every_device;

use asked::{Within, calibration, compare, compare_minima, compare_on_device};
use every_device::every_device;
use imf_core::dataset::Sampling;
use imf_core::model::{Model, TrainingRecord};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::siren::SirenShape;
use imf_core::stored::StoredField;
use imf_core::tool::Tool;
use imf_core::training::TrainingState;
use imf_core::training::divergence::Watch;
use imf_core::training::run::{Cursor, TrainingPlan};
use imf_gpu::{Gpu, GpuField};

/// A network of random weights over the teapot's box, with thresholds among its values, which are worth nothing.
fn field(gpu: &Gpu, skip_after: Option<usize>) -> GpuField {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    let shape = SirenShape { width: 48, hidden: 3, skip_after, omega: 10.0 };
    let model = Model {
        shape,
        scene: scene.scene().expect("a scene"),
        record: record(),
        state: TrainingState::new(&shape, 4),
        calibration: Some(calibration(0.49, 0.51)),
    };
    GpuField::new(gpu, StoredField::Siren(Box::new(model))).expect("a field")
}

fn record() -> TrainingRecord {
    TrainingRecord {
        program: "test".to_owned(),
        plan: TrainingPlan::default(),
        cursor: Cursor::default(),
        watch: Watch::default(),
        finished: true,
        steps: 0,
        seconds: 0.0,
        engine: "none".to_owned(),
        orientations: OrientationSet::parse("fibonacci:3").expect("a set"),
        sampling: Sampling::default(),
        samples: 0,
        dataset_crc32: 0,
        groups_per_epoch: None,
        fine_tuned_from: None,
        pending_loss: (0.0, 0),
        held_out: None,
        losses: Vec::new(),
    }
}

/// Angles of a few units in the last place, ω = 10 times through three layers. At the poles the slope in θ is divided by 1e-3
/// and so is its rounding.
const WITHIN: Within = Within { value: 2e-5, slope: 2e-4, poles: false };

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn values_gradients_and_decisions_are_the_twins() {
    for skip in [None, Some(1)] {
        for gpu in every_device() {
            compare(&field(&gpu, skip), &WITHIN);
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn minima_are_the_twins_and_lengths_are_checked() {
    compare_minima(&field(&adapter::open(), Some(1)), &WITHIN);
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn buffers_of_the_device_are_answered_in_place() {
    let gpu = adapter::open();
    compare_on_device(&gpu, &field(&gpu, Some(1)));
}
