//! Poses answered on the adapter against the same field on the CPU: values, gradients, decisions and minima, from slices
//! and from buffers of the device.

mod adapter;

use glam::{Quat, Vec3};
use imf_core::calibration::{Calibration, Goals, Judgement, Rate};
use imf_core::dataset::Sampling;
use imf_core::model::{Model, TrainingRecord};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::planner::{Best, Decision, Gradient, Pose, PoseField};
use imf_core::scene::SceneSpec;
use imf_core::siren::SirenShape;
use imf_core::tool::Tool;
use imf_core::training::TrainingState;
use imf_core::training::run::{Cursor, TrainingPlan};
use imf_gpu::wgpu::{BufferDescriptor, BufferUsages, MapMode, PollType};
use imf_gpu::{DevicePose, Gpu, GpuField, MatrixKernel};

/// A network of random weights over the teapot's box, with thresholds among its values.
fn model(skip_after: Option<usize>) -> Model {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    let shape = SirenShape { width: 48, hidden: 3, skip_after, omega: 10.0 };
    Model {
        shape,
        scene: scene.scene().expect("a scene"),
        record: record(),
        state: TrainingState::new(&shape, 4),
        calibration: Some(calibration()),
    }
}

fn record() -> TrainingRecord {
    TrainingRecord {
        program: "test".to_owned(),
        plan: TrainingPlan::default(),
        cursor: Cursor::default(),
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

/// Thresholds among the values of random weights, which are worth nothing.
fn calibration() -> Calibration {
    let rate = Rate::new(0, 0, 0.99);
    let nothing = Judgement {
        poses: 0,
        false_free: rate,
        false_blocked: rate,
        near: 0,
        found_free: 0,
        largest_error: 0.0,
    };
    Calibration {
        free_up_to: Some(0.49),
        blocked_from: Some(0.51),
        goals: Goals::default(),
        seed: 0,
        uniform: nothing,
        boundary: nothing,
    }
}

/// Poses in and around the box, along the grid's axes among them, and what is no pose.
fn poses(model: &Model, count: usize) -> Vec<Pose> {
    let grid = model.scene.record.grid;
    let set = OrientationSet::parse(&format!("random:{count}:3")).expect("a set").orientations;
    let axes = [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y];
    let mut poses: Vec<Pose> = set
        .iter()
        .enumerate()
        .map(|(i, orientation)| {
            let part = |step: f64| (i as f64 * step).fract() * 1.4 - 0.2;
            let at = glam::DVec3::new(part(0.618_034), part(0.754_878), part(0.569_840));
            let axis = axes.get(i).copied().unwrap_or(orientation.direction().as_vec3());
            Pose::along((grid.origin + at * grid.size()).as_vec3(), axis)
        })
        .collect();
    poses[7].position.y = f32::NAN;
    poses[8].rotation = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    poses[9].rotation *= 1e-12;
    poses[10].rotation.x = f32::INFINITY;
    poses
}

fn every_device() -> [Gpu; 2] {
    let gpu = adapter::open();
    MatrixKernel::ALL.map(|kernel| gpu.clone().with_matrix_kernel(kernel))
}

/// Angles of a few units in the last place, ω = 10 times through three layers.
const VALUE: f32 = 2e-5;

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn values_gradients_and_decisions_are_the_twins() {
    for skip in [None, Some(1)] {
        for gpu in every_device() {
            let field = GpuField::new(&gpu, model(skip)).unwrap();
            // More than one pass.
            let poses = poses(&model(skip), 9000);
            let (mut found, mut expected) = (vec![0.0; poses.len()], vec![0.0; poses.len()]);
            field.query(&poses, &mut found).unwrap();
            field.twin().query(&poses, &mut expected).unwrap();
            for ((pose, found), expected) in poses.iter().zip(&found).zip(&expected) {
                assert_eq!(found.is_nan(), !pose.is_pose(), "{pose:?}: {found}");
                assert!(found.is_nan() || (found - expected).abs() < VALUE, "{pose:?}: {found}, {expected}");
            }
            let none = Gradient::NAN;
            let (mut found, mut expected) = (vec![none; poses.len()], vec![none; poses.len()]);
            field.query_with_gradient(&poses, &mut found).unwrap();
            field.twin().query_with_gradient(&poses, &mut expected).unwrap();
            let largest = expected.iter().map(|g| g.position.length()).fold(0.0, f32::max);
            let steepest = expected.iter().map(|g| g.direction.length()).fold(0.0, f32::max);
            let mut clamped = 0;
            for ((pose, found), expected) in poses.iter().zip(&found).zip(&expected) {
                if !pose.is_pose() {
                    assert!(found.value.is_nan() && found.position.is_nan() && found.direction.is_nan());
                    continue;
                }
                // At the poles the slope in θ is divided by 1e-3 and so is its rounding.
                let pole = pose.axis().truncate().length() < 1e-2;
                let apart = (found.direction - expected.direction).length();
                assert!(pole || apart < 2e-4 * steepest, "{pose:?}: {found:?}, {expected:?}");
                let apart = (found.rotation - expected.rotation).length();
                assert!(pole || apart < 2e-4 * steepest, "{pose:?}: {found:?}, {expected:?}");
                assert!(found.direction.is_finite(), "{pose:?}: {found:?}");
                let apart = (found.position - expected.position).length();
                assert!(apart < 2e-4 * largest, "{pose:?}: {found:?}, {expected:?}");
                clamped += usize::from((0..3).any(|axis| found.position[axis] == 0.0));
            }
            assert!(clamped > 100, "{clamped} poses outside the box");

            let near = Decision::Near;
            let (mut found, mut expected) = (vec![near; poses.len()], vec![near; poses.len()]);
            field.classify(&poses, &mut found).unwrap();
            field.twin().classify(&poses, &mut expected).unwrap();
            let others = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            // Values within rounding of a threshold.
            assert!(others < 5, "{others} other decisions");
            for decision in [Decision::Free, Decision::Blocked, Decision::Near] {
                assert!(found.contains(&decision), "{decision:?} is not met");
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn minima_are_the_twins_and_lengths_are_checked() {
    let gpu = adapter::open();
    let field = GpuField::new(&gpu, model(Some(1))).unwrap();
    let mut points: Vec<Vec3> = poses(&model(None), 300).iter().map(|pose| pose.position).collect();
    points[3].x = f32::INFINITY;
    let set = OrientationSet::parse("fibonacci:40").unwrap().orientations;
    let orientations: Vec<Quat> =
        set.iter().map(|o| Pose::along(Vec3::ZERO, o.direction().as_vec3()).rotation).collect();
    let (mut found, mut expected) = (vec![Best::NONE; points.len()], vec![Best::NONE; points.len()]);
    field.imf(&points, &orientations, &mut found).unwrap();
    field.twin().imf(&points, &orientations, &mut expected).unwrap();
    let mut others = 0;
    for ((point, found), expected) in points.iter().zip(&found).zip(&expected) {
        if !point.is_finite() {
            assert!(found.value.is_nan() && found.decision == Decision::Blocked);
            continue;
        }
        assert!((found.value - expected.value).abs() < VALUE, "{point}: {found:?}, {expected:?}");
        others +=
            usize::from((found.orientation, found.decision) != (expected.orientation, expected.decision));
    }
    assert!(others < 4, "{others} others");
    let all = poses(&model(None), 20);
    assert!(field.query(&all, &mut [0.0]).is_err());
    assert!(field.query_with_gradient(&all, &mut []).is_err());
    assert!(field.classify(&all, &mut []).is_err());
    assert!(field.imf(&points, &orientations, &mut []).is_err());
    assert!(field.imf(&points, &[], &mut found).is_err());
    field.query(&[], &mut []).unwrap();
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn buffers_of_the_device_are_answered_in_place() {
    let gpu = adapter::open();
    let field = GpuField::new(&gpu, model(Some(1))).unwrap();
    let poses = poses(&model(None), 1000);
    let blocks: Vec<DevicePose> = poses.iter().map(|&pose| pose.into()).collect();
    let buffer = |bytes: usize| {
        gpu.device().create_buffer(&BufferDescriptor {
            label: None,
            size: bytes as u64,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    };
    let (asked, values) = (buffer(size_of_val(&blocks[..])), buffer(4 * poses.len()));
    let bytes: Vec<u8> = blocks
        .iter()
        .flat_map(|block| block.position.iter().chain(&block.rotation).flat_map(|v| v.to_le_bytes()))
        .collect();
    gpu.queue().write_buffer(&asked, 0, &bytes);
    field.query_on_device(&asked, &values, poses.len()).unwrap();
    let read = buffer(4);
    // Read back by the caller's own means.
    let staging = gpu.device().create_buffer(&BufferDescriptor {
        label: None,
        size: values.size(),
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(&values, 0, &staging, 0, values.size());
    gpu.queue().submit([encoder.finish()]);
    staging.map_async(MapMode::Read, .., |_| ());
    gpu.device().poll(PollType::wait_indefinitely()).unwrap();
    let view = staging.get_mapped_range(..).unwrap();
    let found: Vec<f32> =
        view.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect();
    let mut expected = vec![0.0; poses.len()];
    field.query(&poses, &mut expected).unwrap();
    for (found, expected) in found.iter().zip(&expected) {
        assert!(found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan()));
    }
    let small = field.query_with_gradient_on_device(&asked, &values, &read, poses.len()).unwrap_err();
    assert!(small.to_string().contains("1000 gradients"), "{small}");
}
