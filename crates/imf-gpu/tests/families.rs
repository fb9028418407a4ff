//! Poses answered on the adapter for factored and harmonic fields against the same field on the CPU, as `planner.rs` does for
//! the paper's network; and such fields over their whole grids.

mod adapter;
mod asked;
mod every_device;

use asked::{
    Within, calibration, compare, compare_at, compare_minima, compare_minima_of, compare_on_device, poses,
};
use every_device::every_device;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::DVec3;
use imf_core::control::Control;
use imf_core::field::{FieldError, GridField as _};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::tool::Tool;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{Axis, DistillSettings, FactoredField, FactoredShape, Symmetry};
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::{Basis, Domain};
use imf_fields::harmonic::coefficients::{Coefficients, Precision};
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitReport, FitSettings, HarmonicField};
use imf_gpu::{Gpu, GpuField, GpuLimits, MatrixKernel};

fn scene() -> Scene {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    scene.scene().expect("a scene")
}

/// A field of random weights, axes and mean, which nothing taught: its values spread around 1/2 with waves of the highest
/// degree among them. Thresholds cut them in three.
fn file(domain: Domain, degree: usize, axes: usize, quantity: Quantity) -> FactoredFile {
    file_with(Symmetry::default(), domain, degree, axes, quantity)
}

fn file_with(
    symmetry: Symmetry,
    domain: Domain,
    degree: usize,
    axes: usize,
    quantity: Quantity,
) -> FactoredFile {
    let scene = scene();
    let shape = FactoredShape { width: 44, hidden: 3, omega: 10.0, axes, folded: false, symmetry };
    let basis = Basis::new(domain, degree);
    let number = |place: usize, step: f64| ((place as f64 * step).fract() * 2.0 - 1.0) as f32;
    let mean = (0..basis.len()).map(|k| if k == 0 { 0.5 } else { 0.1 * number(k, 0.618_034) / k as f32 });
    let size = 1.0 / (basis.len() as f32).sqrt();
    let field = FactoredField {
        quantity,
        grid: scene.record.grid,
        axes: (0..basis.len() * axes).map(|place| size * number(place + 1, 0.754_878)).collect(),
        mean: mean.collect(),
        basis,
        shape,
        parameters: shape.initial_parameters(3),
        scale: 0.3,
    };
    let (functions, fit) = (field.basis.len(), fit(degree, axes, quantity));
    let file = FactoredFile {
        field,
        scene,
        fit,
        report: FitReport { functions, sections: 0, dropped: 0.0, held_out_mse: 0.0, held_out_mpe: 0.0 },
        settings: DistillSettings::default(),
        precision: Precision::F32,
        state: None,
        calibration: None,
    };
    let twin = Field::new(FieldFile::Factored(Box::new(file.clone()))).expect("a field");
    let asked = poses(&file.scene.record.grid, 500);
    let mut values = vec![0.0; asked.len()];
    twin.values_unclipped(&asked, &mut values).expect("values");
    values.retain(|value| value.is_finite());
    values.sort_by(f32::total_cmp);
    let calibration = calibration(values[values.len() / 3], values[values.len() * 2 / 3]);
    FactoredFile { calibration: Some(calibration), ..file }
}

fn fit(degree: usize, axes: usize, quantity: Quantity) -> FitSettings {
    FitSettings {
        quantity,
        degree,
        sections_per_function: 2.0,
        axes,
        precision: Precision::F32,
        sample: 0,
        held_out: 0,
        seed: 0,
        one_pass: true,
    }
}

/// The same functions with random coefficients at every voxel.
fn harmonic(
    domain: Domain,
    degree: usize,
    axes: usize,
    quantity: Quantity,
    precision: Precision,
) -> HarmonicFile {
    let FactoredFile { field, scene, fit, report, calibration, .. } = file(domain, degree, axes, quantity);
    let number = |place: usize| ((place as f64 * 0.569_840).fract() * 0.6 - 0.3) as f32;
    let values = (0..field.grid.len() * axes).map(number).collect();
    HarmonicFile {
        field: HarmonicField {
            quantity,
            grid: field.grid,
            basis: field.basis,
            axes: field.axes,
            mean: field.mean,
            coefficients: Coefficients::new(values, precision),
            report,
        },
        scene,
        settings: fit,
        calibration,
    }
}

fn field(gpu: &Gpu, degree: usize, axes: usize, quantity: Quantity) -> GpuField {
    let mut file = file(Domain::Directions, degree, axes, quantity);
    file.field = file.field.folded();
    GpuField::new(gpu, FieldFile::Factored(Box::new(file))).expect("a field")
}

/// Points and directions of single precision, seen by ω = 10 through three layers and by waves of degree 16, and sums of some
/// hundred products in another order: 1.5e-6 and 2.6e-6 were found.
const WITHIN: Within = Within { value: 1e-5, slope: 2e-5, poles: true };

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn values_gradients_and_decisions_are_the_twins_also_at_the_poles() {
    // 64 functions, which need no padding, and 289; axes within a tile and beyond. The second network is folded.
    for (degree, axes, quantity) in [(7, 21, Quantity::Overlap), (16, 70, Quantity::Depth)] {
        for gpu in every_device() {
            compare(&field(&gpu, degree, axes, quantity), &WITHIN);
        }
    }
}

/// A point a little off the middle of the grid, in what single precision holds: device and CPU then agree about which side of
/// a plane through it a position is on.
fn middle() -> DVec3 {
    let grid = scene().record.grid;
    (grid.origin + 0.45 * grid.size()).as_vec3().as_dvec3()
}

/// Mirrors, axes along x, y and z, and both.
fn symmetries() -> [Symmetry; 4] {
    let [x, y, z] = middle().to_array();
    let axis = |along| Some(Axis { along, through: middle() });
    [
        Symmetry { mirrors: [Some(x), None, Some(z)], axis: None },
        Symmetry { mirrors: [None; 3], axis: axis(0) },
        Symmetry { mirrors: [Some(x), Some(y), Some(z)], axis: axis(1) },
        Symmetry { mirrors: [None, Some(y), None], axis: axis(2) },
    ]
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
    for symmetry in symmetries() {
        for (degree, axes, quantity) in [(7, 21, Quantity::Overlap), (16, 70, Quantity::Depth)] {
            for gpu in every_device() {
                let mut file = file_with(symmetry, Domain::Directions, degree, axes, quantity);
                file.field = file.field.folded();
                let field = GpuField::new(&gpu, FieldFile::Factored(Box::new(file))).expect("a field");
                println!("{symmetry}, degree {degree}:");
                compare_at(&field, &WITHIN, &asked);
                compare_minima(&field, &WITHIN);
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn harmonic_fields_are_answered_as_on_the_cpu() {
    for (degree, axes, quantity, precision) in
        [(7, 21, Quantity::Overlap, Precision::F16), (9, 70, Quantity::Depth, Precision::F32)]
    {
        for gpu in every_device() {
            let file = harmonic(Domain::Directions, degree, axes, quantity, precision);
            let field = GpuField::new(&gpu, FieldFile::Harmonic(Arc::new(file))).unwrap();
            compare(&field, &WITHIN);
            compare_on_device(&gpu, &field);
            compare_minima(&field, &WITHIN);
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn minima_are_the_twins_and_lengths_are_checked() {
    for quantity in [Quantity::Overlap, Quantity::Depth] {
        compare_minima(&field(&adapter::open(), 7, 21, quantity), &WITHIN);
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn buffers_of_the_device_are_answered_in_place() {
    let gpu = adapter::open();
    compare_on_device(&gpu, &field(&gpu, 9, 30, Quantity::Overlap));
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn fields_over_rotations_are_answered_as_on_the_cpu() {
    let rotations = Domain::Rotations;
    // 10, 84, 165 and 455 functions.
    for gpu in every_device() {
        for (degree, axes, quantity) in [(1, 5, Quantity::Overlap), (6, 70, Quantity::Depth)] {
            let file = file(rotations, degree, axes, quantity);
            let field = GpuField::new(&gpu, FieldFile::Factored(Box::new(file))).expect("a field");
            compare(&field, &WITHIN);
            compare_minima_of(&field, &WITHIN, 300, "so3:40");
        }
        for (degree, axes, precision) in [(3, 21, Precision::F16), (4, 70, Precision::F32)] {
            let file = harmonic(rotations, degree, axes, Quantity::Overlap, precision);
            let field = GpuField::new(&gpu, FieldFile::Harmonic(Arc::new(file))).expect("a field");
            compare(&field, &WITHIN);
            compare_on_device(&gpu, &field);
            compare_minima_of(&field, &WITHIN, 300, "so3:40");
        }
    }
}

/// Sections and minima at every voxel over a set of orientations.
fn compare_whole(name: &str, found: &GpuField, set: &str) {
    let orientations = OrientationSet::parse(set).expect("a set").orientations;
    let (twin, voxels) = (found.twin(), found.grid().len());
    let [mut sections, mut expected] = [0; 2].map(|_| vec![0.0; voxels * orientations.len()]);
    twin.sections(&orientations, &mut expected).expect("sections");
    found.sections(&orientations, &mut sections).expect("sections");
    let apart = |(a, b): (&f32, &f32)| (a - b).abs();
    let worst = sections.iter().zip(&expected).map(apart).fold(0.0, f32::max);
    println!("{name}, {set}: {worst:.1e}");
    assert!(worst < WITHIN.value, "{name}, {set}: {worst}");
    let mut one = vec![0.0; voxels];
    found.section(&orientations[3], &mut one).expect("a section");
    assert!(one.iter().zip(&sections[3 * voxels..]).map(apart).all(|apart| apart < WITHIN.value));

    let least = found.minimum(&orientations, Control::quiet()).expect("minima");
    let expected = twin.minimum(&orientations, Control::quiet()).expect("minima");
    let mut others = 0;
    for voxel in 0..voxels {
        let (value, best) = (least.value[voxel], least.best[voxel]);
        assert!(apart((&value, &expected.value[voxel])) < WITHIN.value, "{name}, {set}, voxel {voxel}");
        assert!(apart((&sections[best as usize * voxels + voxel], &value)) < WITHIN.value, "not its value");
        others += usize::from(best != expected.best[voxel]);
    }
    // Where two orientations are within rounding of each other.
    assert!(others < voxels / 100, "{name}, {set}: {others} other orientations");
}

/// Every kernel, and memory for some hundred points at a time: more parts than wait to be read at once.
fn devices() -> Vec<Gpu> {
    let mut devices = every_device().to_vec();
    let limits = adapter::open().limits();
    let small = GpuLimits { storage_binding: 1 << 20, buffer: 1 << 20, ..limits };
    devices.extend(every_device().map(|gpu| gpu.with_limits(small)));
    devices
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn harmonic_fields_over_their_grid_are_the_cpus() {
    let (directions, rotations) = (Domain::Directions, Domain::Rotations);
    for (domain, degree, axes, quantity, precision, set) in [
        (directions, 7, 21, Quantity::Overlap, Precision::F16, "fibonacci:700"),
        (directions, 9, 70, Quantity::Depth, Precision::F32, "fibonacci:37"),
        (rotations, 2, 12, Quantity::Overlap, Precision::F32, "so3:40"),
    ] {
        let file = Arc::new(harmonic(domain, degree, axes, quantity, precision));
        for gpu in devices() {
            let found = GpuField::new(&gpu, FieldFile::Harmonic(file.clone())).expect("a field");
            compare_whole(gpu.matrix_kernel().name(), &found, set);
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn factored_fields_over_their_grid_are_the_cpus() {
    let (directions, rotations) = (Domain::Directions, Domain::Rotations);
    let [_, _, symmetry, _] = symmetries();
    let none = Symmetry::default();
    let symmetric = file_with(symmetry, directions, 7, 21, Quantity::Overlap);
    let mut folded = file_with(none, directions, 9, 70, Quantity::Depth);
    folded.field = folded.field.folded();
    let rolling = file_with(none, rotations, 2, 12, Quantity::Overlap);
    for (file, set) in [(symmetric, "fibonacci:700"), (folded, "fibonacci:37"), (rolling, "so3:40")] {
        let file = FieldFile::Factored(Box::new(file));
        for gpu in devices() {
            let found = GpuField::new(&gpu, file.clone()).expect("a field");
            compare_whole(gpu.matrix_kernel().name(), &found, set);
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn orientations_that_one_buffer_does_not_hold_are_met_in_batches() {
    // Rows of 25 or 65 numbers in a buffer of 1 MiB: up to 10,240 or 3,584 of them together.
    let file = Arc::new(harmonic(Domain::Directions, 3, 16, Quantity::Overlap, Precision::F32));
    let field = &file.field;
    for gpu in &devices()[MatrixKernel::ALL.len()..] {
        let found = GpuField::new(gpu, FieldFile::Harmonic(file.clone())).expect("a field");
        let orientations = OrientationSet::parse("fibonacci:12000").expect("a set").orientations;
        let expected = field.minimum(&field.direction_weights(&orientations));
        let least = found.minimum(&orientations, Control::quiet()).expect("minima");
        let (mut others, mut late) = (0, 0);
        for voxel in 0..field.grid.len() {
            let apart = (least.value[voxel] - expected.value[voxel]).abs();
            assert!(apart < WITHIN.value, "voxel {voxel}: {apart}");
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
    for gpu in devices().split_off(MatrixKernel::ALL.len()) {
        let file = harmonic(Domain::Directions, 7, 21, Quantity::Overlap, Precision::F16);
        let field = GpuField::new(&gpu, FieldFile::Harmonic(Arc::new(file))).expect("a field");
        // Some hundred points a part, 512 orientations a chunk.
        compare_minima_of(&field, &WITHIN, 2000, "fibonacci:600");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_minimum_tells_how_far_it_is_and_stops_when_asked() {
    let file = harmonic(Domain::Directions, 3, 9, Quantity::Overlap, Precision::F16);
    let voxels = file.field.grid.len() as u64;
    let found = GpuField::new(&adapter::open(), FieldFile::Harmonic(Arc::new(file))).expect("a field");
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
    assert!(matches!(stopped, Err(FieldError::Cancelled)));
    let error = found.sections(&[], &mut []).expect_err("no orientation");
    assert!(error.to_string().contains("at least one orientation"), "{error}");
}
