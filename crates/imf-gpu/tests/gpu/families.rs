//! Poses answered on the adapter for factored and harmonic fields against the same field on the CPU, as `planner.rs` does for
//! the paper's network.

use std::sync::Arc;

use glam::DVec3;
use imf_core::field::{Best, PoseField as _};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_fields::factored::reference::symmetries;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_gpu::{Gpu, GpuField};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use crate::devices::{every_device, open};
use crate::fields::{Spec, scene};
use crate::queries::{compare, compare_at, compare_minima, compare_minima_of, compare_on_device, poses};
use crate::tolerances::FUNCTIONS as WITHIN;

fn made(gpu: &Gpu, file: FieldFile) -> GpuField {
    GpuField::new(gpu, file).expect("a field")
}

/// 64 functions, which need no padding, and 289; axes within a tile and beyond.
fn specs() -> [Spec; 2] {
    let directions = Domain::Directions;
    [Spec::new(directions, 7, 21, Quantity::Overlap), Spec::new(directions, 16, 70, Quantity::Depth)]
}

/// Values, gradients and decisions, also at the poles, the same from buffers of the device; and minima over a set.
fn compare_all(set: &str, factored: &[FieldFile], harmonic: &[Arc<HarmonicFile>]) {
    let harmonic = harmonic.iter().map(|file| FieldFile::Harmonic(file.clone()));
    for file in factored.iter().cloned().chain(harmonic) {
        for gpu in every_device() {
            let field = made(&gpu, file.clone());
            compare(&field, &WITHIN);
            compare_on_device(&gpu, &field, &poses(&field.twin().scene().record.grid, 1000));
            compare_minima_of(&field, &WITHIN, 300, set);
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn fields_over_directions_are_answered_as_on_the_cpu() {
    let spec = |degree, components, quantity| Spec::new(Domain::Directions, degree, components, quantity);
    let harmonic = [
        spec(7, 21, Quantity::Overlap).harmonic(StoragePrecision::F16),
        spec(9, 70, Quantity::Depth).harmonic(StoragePrecision::F32),
    ];
    // And 100 functions, which are padded while the axes fit into a tile.
    let more = [spec(7, 21, Quantity::Depth), spec(9, 30, Quantity::Overlap)];
    let factored: Vec<_> = specs().into_iter().chain(more).map(|spec| spec.factored_file(true)).collect();
    compare_all("fibonacci:40", &factored, &harmonic);
}

/// A point a little off the middle of the grid, in what single precision holds: device and CPU then agree about which side of
/// a plane through it a position is on.
fn middle() -> DVec3 {
    let grid = scene().record.grid;
    (grid.origin + 0.45 * grid.size()).as_vec3().as_dvec3()
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn fields_with_symmetry_are_answered_as_on_the_cpu() {
    let grid = scene().record.grid;
    let mut asked = poses(&grid, 9000);
    // On the planes and on the axis itself, where the angle is 0 by convention and has no slope; in directions at the poles of
    // every frame. Beside the axis none is nearer to it than some thousandths of the box: slopes by the angle grow as the
    // distance falls, and would be all that the others are measured by.
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    asked.extend(axes.map(|axis| Pose::along(middle(), axis)));
    asked.extend(axes.map(|axis| Pose::along(middle() + 0.2 * grid.size() * axis, axis)));
    for (index, pose) in asked[20..50].iter_mut().enumerate() {
        pose.position[index % 3] = middle()[index % 3];
    }
    // And around each axis, where nothing is decided within two voxels.
    for (index, pose) in asked[50..350].iter_mut().enumerate() {
        let out = DVec3::from_array([0, 1, 2].map(|axis| f64::from(u8::from(axis != index % 3))));
        let turned = pose.position - middle();
        let across = (turned * out).normalize_or(out);
        pose.position = middle() + turned * (1.0 - out) + across * grid.pitch * (0.503 + 0.01 * index as f64);
    }
    // Poses are folded before functions and products: each symmetry has one pair of these, and each pair a symmetry.
    let devices = every_device();
    let pairs = specs().into_iter().flat_map(|spec| devices.iter().map(move |gpu| (spec, gpu)));
    for (symmetry, (spec, gpu)) in symmetries(middle()).into_iter().zip(pairs.cycle()) {
        let field = made(gpu, Spec { symmetry, ..spec }.factored_file(true));
        println!("{symmetry}, degree {}:", spec.degree);
        compare_at(&field, &WITHIN, &asked);
        compare_on_device(gpu, &field, &asked);
        compare_minima(&field, &WITHIN);
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn fields_over_rotations_are_answered_as_on_the_cpu() {
    let spec = |degree, components, quantity| Spec::new(Domain::Rotations, degree, components, quantity);
    // 10, 455, 84 and 165 functions.
    let factored = [spec(1, 5, Quantity::Overlap), spec(6, 70, Quantity::Depth)];
    let harmonic = [
        spec(3, 21, Quantity::Overlap).harmonic(StoragePrecision::F16),
        spec(4, 70, Quantity::Overlap).harmonic(StoragePrecision::F32),
    ];
    compare_all("so3:40", &factored.map(|spec| spec.factored_file(false)), &harmonic);
}

/// More threads than there may be cores: one of them holds the field while it is made, and the others ask for it.
#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn tasks_of_a_pool_ask_a_field_that_is_still_to_be_made() {
    let (gpu, pool) = (open(), ThreadPoolBuilder::new().num_threads(8).build().expect("threads"));
    let file = Spec::new(Domain::Directions, 7, 21, Quantity::Overlap).harmonic(StoragePrecision::F16);
    let set = OrientationSet::parse("fibonacci:40").expect("a set").orientations;
    let rotations: Vec<_> = set.iter().map(Orientation::quaternion).collect();
    for _ in 0..4 {
        let field = made(&gpu, FieldFile::Harmonic(file.clone()));
        let poses = poses(&field.twin().scene().record.grid, 400);
        let points: Vec<DVec3> = poses.iter().map(|pose| pose.position).collect();
        let mut values = vec![f32::NAN; poses.len()];
        let mut best = vec![Best::NONE; points.len()];
        pool.install(|| {
            let of_poses = poses.par_chunks(10).zip(values.par_chunks_mut(10));
            let of_points = points.par_chunks(10).zip(best.par_chunks_mut(10));
            of_poses.zip(of_points).for_each(|((poses, values), (points, best))| {
                field.values(poses, values).expect("answers");
                field.best(points, &rotations, best).expect("answers");
            });
        });
        let (mut alone, mut best_alone) = (values.clone(), best.clone());
        field.values(&poses, &mut alone).expect("answers");
        field.best(&points, &rotations, &mut best_alone).expect("answers");
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&alone), bits(&values));
        // A point that is none has no value.
        let mut both = best.iter().zip(&best_alone);
        assert!(!both.any(|(a, b)| (a.value - b.value).abs() >= WITHIN.value));
    }
}
