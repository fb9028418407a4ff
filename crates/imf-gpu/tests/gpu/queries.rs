//! Queries of planners to a field on the adapter, compared with its twin on the CPU, whatever family it is of.

use glam::{DQuat, DVec3};
use imf_core::field::{Best, Decision, Gradient, PoseField};
use imf_core::grid::Grid;
use imf_core::orientation::OrientationSet;
use imf_core::pose::Pose;
use imf_gpu::wgpu::{Buffer, BufferDescriptor, BufferUsages, MapMode, PollType};
use imf_gpu::{DeviceGradient, DevicePose, Gpu, GpuField, decision_of};

use crate::tolerances::Within;

/// Poses in and around the box, along the grid's axes among them, and invalid ones.
pub(crate) fn poses(grid: &Grid, count: usize) -> Vec<Pose> {
    let set = OrientationSet::parse(&format!("random:{count}:3")).expect("a set").orientations;
    let axes = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y];
    let mut poses: Vec<Pose> = set
        .iter()
        .enumerate()
        .map(|(i, orientation)| {
            let part = |step: f64| (i as f64 * step).fract() * 1.4 - 0.2;
            let at = DVec3::new(part(0.618_034), part(0.754_878), part(0.569_840));
            let axis = axes.get(i).copied().unwrap_or(orientation.direction());
            let along = Pose::along((grid.origin + at * grid.size()).as_vec3().as_dvec3(), axis);
            // Idle of tools of revolution.
            let roll = if i < axes.len() { 0.0 } else { i as f64 };
            Pose { rotation: along.rotation * DQuat::from_rotation_z(roll), ..along }
        })
        .collect();
    // The poles are met inside the box, too.
    for pose in &mut poses[..2] {
        pose.position = (grid.origin + DVec3::new(0.4, 0.6, 0.3) * grid.size()).as_vec3().as_dvec3();
    }
    poses[7].position.y = f64::NAN;
    poses[8].rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    poses[9].rotation *= 1e-12;
    poses[10].rotation.x = f64::INFINITY;
    poses
}

/// Values, gradients and decisions of 9000 poses, more than one pass.
pub(crate) fn compare(field: &GpuField, within: &Within) {
    compare_at(field, within, &poses(&field.twin().scene().record.grid, 9000));
}

/// Those of some poses.
pub(crate) fn compare_at(field: &GpuField, within: &Within, poses: &[Pose]) {
    let (mut found, mut expected) = (vec![0.0; poses.len()], vec![0.0; poses.len()]);
    field.values(poses, &mut found).expect("answers");
    field.twin().values(poses, &mut expected).expect("answers");
    let mut worst = [0.0f32; 3];
    for ((pose, found), expected) in poses.iter().zip(&found).zip(&expected) {
        assert_eq!(found.is_nan(), !pose.is_valid(), "{pose:?}: {found}");
        worst[0] = worst[0].max((found - expected).abs());
        assert!(found.is_nan() || (found - expected).abs() < within.value, "{pose:?}: {found}, {expected}");
    }
    let none = Gradient::NAN;
    let (mut found, mut expected) = (vec![none; poses.len()], vec![none; poses.len()]);
    field.gradients(poses, &mut found).expect("answers");
    field.twin().gradients(poses, &mut expected).expect("answers");
    let largest = expected.iter().map(|g| g.position.length()).fold(0.0, f32::max);
    let steepest = expected.iter().map(|g| g.direction.length()).fold(0.0, f32::max);
    let mut clamped = 0;
    for ((pose, found), expected) in poses.iter().zip(&found).zip(&expected) {
        if !pose.is_valid() {
            assert!(found.value.is_nan() && found.position.is_nan() && found.direction.is_nan());
            continue;
        }
        assert!((found.value - expected.value).abs() < within.value, "{pose:?}: {found:?}, {expected:?}");
        let counts = within.poles || pose.axis().is_some_and(|axis| axis.truncate().length() >= 1e-2);
        let apart = (found.direction - expected.direction).length() / steepest;
        worst[2] = worst[2].max(if counts { apart } else { 0.0 });
        assert!(!counts || apart < within.slope, "{pose:?}: {found:?}, {expected:?}");
        let apart = (found.rotation - expected.rotation).length() / steepest;
        assert!(!counts || apart < within.slope, "{pose:?}: {found:?}, {expected:?}");
        assert!(found.direction.is_finite(), "{pose:?}: {found:?}");
        let apart = (found.position - expected.position).length() / largest;
        worst[1] = worst[1].max(apart);
        assert!(apart < within.slope, "{pose:?}: {found:?}, {expected:?}");
        clamped += usize::from((0..3).any(|axis| found.position[axis] == 0.0));
    }
    assert!(clamped > 100, "{clamped} poses outside the box");
    println!("value {:.1e}, slopes {:.1e} and {:.1e} of the largest", worst[0], worst[1], worst[2]);

    let near = Decision::Undecided;
    let (mut found, mut expected) = (vec![near; poses.len()], vec![near; poses.len()]);
    field.classify(poses, &mut found).expect("answers");
    field.twin().classify(poses, &mut expected).expect("answers");
    let others = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
    // Values within rounding of a threshold.
    assert!(others < 5, "{others} other decisions");
    for decision in [Decision::Free, Decision::Colliding, Decision::Undecided] {
        assert!(found.contains(&decision), "{decision:?} is not met");
    }
}

/// Minima over orientations, and lengths that differ.
pub(crate) fn compare_minima(field: &GpuField, within: &Within) {
    compare_minima_of(field, within, 300, "fibonacci:40");
}

/// Those of so many points, over a set.
pub(crate) fn compare_minima_of(field: &GpuField, within: &Within, count: usize, set: &str) {
    let grid = field.twin().scene().record.grid;
    let mut points: Vec<DVec3> = poses(&grid, count).iter().map(|pose| pose.position).collect();
    points[3].x = f64::INFINITY;
    let set = OrientationSet::parse(set).expect("a set").orientations;
    let orientations: Vec<DQuat> = set.iter().map(imf_core::orientation::Orientation::quaternion).collect();
    let (mut found, mut expected) = (vec![Best::NONE; points.len()], vec![Best::NONE; points.len()]);
    field.best(&points, &orientations, &mut found).expect("answers");
    field.twin().best(&points, &orientations, &mut expected).expect("answers");
    let mut others = 0;
    for ((point, found), expected) in points.iter().zip(&found).zip(&expected) {
        if !point.is_finite() {
            assert!(found.value.is_nan() && found.decision == Decision::Colliding);
            continue;
        }
        assert!((found.value - expected.value).abs() < within.value, "{point}: {found:?}, {expected:?}");
        others +=
            usize::from((found.orientation, found.decision) != (expected.orientation, expected.decision));
    }
    assert!(others < 4 + count / 100, "{others} others");
    let all = poses(&grid, 20);
    assert!(field.values(&all, &mut [0.0]).is_err());
    assert!(field.gradients(&all, &mut []).is_err());
    assert!(field.classify(&all, &mut []).is_err());
    assert!(field.best(&points, &orientations, &mut []).is_err());
    assert!(field.best(&points, &[], &mut found).is_err());
    field.values(&[], &mut []).expect("answers");
}

/// A caller's own buffer.
fn buffer(gpu: &Gpu, bytes: usize) -> Buffer {
    gpu.device().create_buffer(&BufferDescriptor {
        label: None,
        size: bytes as u64,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Its contents, read by the caller's own means.
fn words(gpu: &Gpu, buffer: &Buffer) -> Vec<u32> {
    let staging = gpu.device().create_buffer(&BufferDescriptor {
        label: None,
        size: buffer.size(),
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    gpu.queue().submit([encoder.finish()]);
    staging.map_async(MapMode::Read, .., |_| ());
    gpu.device().poll(PollType::wait_indefinitely()).expect("a device");
    let view = staging.get_mapped_range(..).expect("a mapping");
    view.chunks_exact(4).map(|four| u32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect()
}

/// Poses that lie on the device get the answers of slices there.
pub(crate) fn compare_on_device(gpu: &Gpu, field: &GpuField, poses: &[Pose]) {
    let blocks: Vec<DevicePose> = poses.iter().map(|&pose| pose.into()).collect();
    let [values, decisions] = [4; 2].map(|bytes| buffer(gpu, bytes * poses.len()));
    let (asked, gradients) =
        (buffer(gpu, size_of_val(&blocks[..])), buffer(gpu, size_of::<DeviceGradient>() * poses.len()));
    let bytes: Vec<u8> = blocks
        .iter()
        .flat_map(|block| block.position.iter().chain(&block.rotation).flat_map(|v| v.to_le_bytes()))
        .collect();
    gpu.queue().write_buffer(&asked, 0, &bytes);
    let (quantity, pitch) = (field.twin().quantity(), field.twin().scene().record.grid.pitch);
    let mut expected = vec![0.0; poses.len()];
    field.values(poses, &mut expected).expect("answers");
    let same = |found: f32, expected: f32| {
        found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan())
    };

    field.values_on_device(&asked, &values, poses.len()).expect("answers");
    let found: Vec<f32> = words(gpu, &values).into_iter().map(f32::from_bits).collect();
    assert!(
        found.iter().zip(&expected).all(|(&found, &expected)| same(quantity.clamp(found, pitch), expected))
    );

    field.classify_on_device(&asked, &values, &decisions, poses.len()).expect("answers");
    let mut decided = vec![Decision::Undecided; poses.len()];
    field.classify(poses, &mut decided).expect("answers");
    let found: Vec<Decision> = words(gpu, &decisions).into_iter().map(decision_of).collect();
    assert!(found == decided);

    field.gradients_on_device(&asked, &values, &gradients, poses.len()).expect("answers");
    let mut expected = vec![Gradient::NAN; poses.len()];
    field.gradients(poses, &mut expected).expect("answers");
    let found: Vec<f32> = words(gpu, &gradients).into_iter().map(f32::from_bits).collect();
    for (found, expected) in found.chunks_exact(8).zip(&expected) {
        let all =
            [&[expected.value][..], &expected.position.to_array(), &expected.direction.to_array()].concat();
        assert!(found.iter().zip(all).all(|(&found, expected)| same(found, expected)));
    }

    let small = buffer(gpu, 4);
    let count = poses.len();
    let error = field.gradients_on_device(&asked, &values, &small, count).expect_err("a buffer too small");
    assert!(error.to_string().contains(&format!("{count} gradients")), "{error}");
    let error = field.classify_on_device(&asked, &values, &small, count).expect_err("a buffer too small");
    assert!(error.to_string().contains(&format!("{count} decisions")), "{error}");
}
