//! Factored and harmonic fields over their whole grids on the adapter: sections and minima as on the CPU.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use imf_core::control::Control;
use imf_core::field::{FieldError, GridField as _};
use imf_core::orientation::OrientationSet;
use imf_core::section::Quantity;
use imf_fields::factored::reference::symmetries;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_gpu::{Gpu, GpuField, GpuLimits};

use crate::devices::{apart, every_device, open};
use crate::fields::{Spec, scene};
use crate::queries::compare_minima_of;
use crate::tolerances::{FUNCTIONS, SECTIONS};

/// Sections and minima at every voxel over a set of orientations.
fn compare_whole(gpu: &Gpu, file: &FieldFile, set: &str, tolerance: f32) {
    let found = GpuField::new(gpu, file.clone()).expect("a field");
    let name = format!("{set}, {}", gpu.matrix_kernel().name());
    let orientations = OrientationSet::parse(set).expect("a set").orientations;
    let (twin, voxels) = (found.twin(), found.grid().len());
    let [mut sections, mut expected] = [0; 2].map(|_| vec![0.0; voxels * orientations.len()]);
    twin.sections(&orientations, &mut expected).expect("sections");
    found.sections(&orientations, &mut sections).expect("sections");
    let worst = apart(&sections, &expected);
    println!("{name}: {worst:.1e}");
    assert!(worst < tolerance, "{name}: {worst}");
    let mut one = vec![0.0; voxels];
    found.section(&orientations[3], &mut one).expect("a section");
    assert!(apart(&one, &sections[3 * voxels..]) < tolerance);

    let least = found.minimum(&orientations, Control::quiet()).expect("minima");
    let expected = twin.minimum(&orientations, Control::quiet()).expect("minima");
    assert!(apart(&least.value, &expected.value) < tolerance, "{name}");
    let of_best = |(voxel, best): (usize, &u32)| sections[*best as usize * voxels + voxel];
    let values: Vec<f32> = least.best.iter().enumerate().map(of_best).collect();
    assert!(apart(&values, &least.value) < tolerance, "{name}: not its value");
    let others = least.best.iter().zip(&expected.best).filter(|(a, b)| a != b).count();
    // Where two orientations are within rounding of each other.
    assert!(others < voxels / 100, "{name}: {others} other orientations");
}

/// Memory for some hundred points at a time: more parts than wait to be read at once.
fn small_devices() -> [Gpu; 2] {
    let limits = GpuLimits { storage_binding: 1 << 20, buffer: 1 << 20, ..open().limits() };
    every_device().map(|gpu| gpu.with_limits(limits))
}

fn devices() -> impl Iterator<Item = Gpu> {
    every_device().into_iter().chain(small_devices())
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn harmonic_fields_over_their_grid_are_the_cpus() {
    let (directions, rotations) = (Domain::Directions, Domain::Rotations);
    for (spec, precision, set) in [
        (Spec::new(directions, 7, 21, Quantity::Overlap), StoragePrecision::F16, "fibonacci:700"),
        (Spec::new(directions, 9, 70, Quantity::Depth), StoragePrecision::F32, "fibonacci:37"),
        (Spec::new(rotations, 2, 12, Quantity::Overlap), StoragePrecision::F32, "so3:40"),
    ] {
        let file = FieldFile::Harmonic(spec.harmonic(precision));
        devices().for_each(|gpu| compare_whole(&gpu, &file, set, FUNCTIONS.value));
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn factored_fields_over_their_grid_are_the_cpus() {
    let (directions, rotations) = (Domain::Directions, Domain::Rotations);
    let grid = scene().record.grid;
    let [_, _, symmetry, _] = symmetries((grid.origin + 0.45 * grid.size()).as_vec3().as_dvec3());
    let symmetric = Spec { symmetry, ..Spec::new(directions, 7, 21, Quantity::Overlap) };
    for (spec, folded, set) in [
        (symmetric, false, "fibonacci:700"),
        (Spec::new(directions, 9, 70, Quantity::Depth), true, "fibonacci:37"),
        (Spec::new(rotations, 2, 12, Quantity::Overlap), false, "so3:40"),
    ] {
        let file = spec.factored_file(folded);
        devices().for_each(|gpu| compare_whole(&gpu, &file, set, FUNCTIONS.value));
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn overlaps_that_are_clipped_and_symmetry_through_voxel_centres_are_the_cpus() {
    let plain = Spec { scale: 1.0, ..Spec::new(Domain::Directions, 5, 21, Quantity::Overlap) };
    assert!(plain.factored().field.folded().shape.folded);
    // One chunk, and more than one with a last one that is not full.
    for (set, folded) in [("fibonacci:37", false), ("fibonacci:700", false), ("fibonacci:37", true)] {
        let file = plain.factored_file(folded);
        every_device().iter().for_each(|gpu| compare_whole(gpu, &file, set, SECTIONS));
    }
    let grid = scene().record.grid;
    // The planes hold voxel centres, and so does an axis.
    assert!(grid.dims.iter().all(|n| n % 2 == 1), "{:?}", grid.dims);
    for symmetry in symmetries(grid.origin + 0.5 * grid.size()) {
        for folded in [false, true] {
            println!("{symmetry}");
            let file = Spec { symmetry, ..plain }.factored_file(folded);
            every_device().iter().for_each(|gpu| compare_whole(gpu, &file, "fibonacci:37", SECTIONS));
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn orientations_that_one_buffer_does_not_hold_are_met_in_batches() {
    // Rows of 25 or 65 numbers in a buffer of 1 MiB: up to 10,240 or 3,584 of them together.
    let file = Spec::new(Domain::Directions, 3, 16, Quantity::Overlap).harmonic(StoragePrecision::F32);
    let field = &file.field;
    for gpu in small_devices() {
        let found = GpuField::new(&gpu, FieldFile::Harmonic(file.clone())).expect("a field");
        let orientations = OrientationSet::parse("fibonacci:12000").expect("a set").orientations;
        let expected = field.minimum(&field.direction_weights(&orientations));
        let least = found.minimum(&orientations, Control::quiet()).expect("minima");
        let (mut others, mut late) = (0, 0);
        for voxel in 0..field.grid.len() {
            let apart = (least.value[voxel] - expected.value[voxel]).abs();
            assert!(apart < FUNCTIONS.value, "voxel {voxel}: {apart}");
            others += usize::from(least.best[voxel] != expected.best[voxel]);
            late += usize::from(least.best[voxel] >= 11_000);
        }
        // So many orientations are near to each other.
        assert!(others < field.grid.len() / 10 && late > 0, "{others} other orientations, {late} late ones");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn minima_of_harmonic_fields_in_parts_are_the_twins() {
    let file = Spec::new(Domain::Directions, 7, 21, Quantity::Overlap).harmonic(StoragePrecision::F16);
    for gpu in small_devices() {
        let field = GpuField::new(&gpu, FieldFile::Harmonic(file.clone())).expect("a field");
        // Some hundred points a part, 512 orientations a chunk.
        compare_minima_of(&field, &FUNCTIONS, 2000, "fibonacci:600");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_minimum_reports_its_progress_and_stops_when_asked() {
    let file = Spec::new(Domain::Directions, 3, 9, Quantity::Overlap).harmonic(StoragePrecision::F16);
    let voxels = file.field.grid.len() as u64;
    let found = GpuField::new(&open(), FieldFile::Harmonic(file)).expect("a field");
    let (done, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    let progress = |voxels| {
        done.fetch_add(voxels, Ordering::Relaxed);
    };
    let control = || Control { progress: &progress, cancelled: &stop };
    let orientations = OrientationSet::parse("fibonacci:5").expect("a set").orientations;
    found.minimum(&orientations, control()).expect("minima");
    assert_eq!(done.load(Ordering::Relaxed), 5 * voxels);
    stop.store(true, Ordering::Relaxed);
    let stopped = found.minimum(&orientations, control());
    assert!(matches!(stopped, Err(FieldError::Cancelled(_))));
    let error = found.sections(&[], &mut []).expect_err("no orientation");
    assert!(error.to_string().contains("at least one orientation"), "{error}");
}
