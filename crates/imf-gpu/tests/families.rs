//! Poses answered on the adapter for factored and harmonic fields against the same field on the CPU, as `planner.rs` does for
//! the paper's network.

mod adapter;
mod asked;

use asked::{
    Within, calibration, compare, compare_at, compare_minima, compare_on_device, every_device, poses,
};
use glam::Vec3;
use imf_core::factored::file::FactoredFile;
use imf_core::factored::{Axis, FactoredField, FactoredShape, Symmetry, TeachSettings};
use imf_core::harmonic::basis::{Basis, Domain};
use imf_core::harmonic::coefficients::{Coefficients, Precision};
use imf_core::harmonic::file::HarmonicFile;
use imf_core::harmonic::{FitReport, FitSettings, HarmonicField};
use imf_core::parts::ReferencePart;
use imf_core::planner::{NeuralField, Pose};
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::stored::StoredField;
use imf_core::tool::Tool;
use imf_gpu::{Gpu, GpuField};

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
        settings: TeachSettings::default(),
        precision: Precision::F32,
        state: None,
        calibration: None,
    };
    if domain == Domain::Rotations {
        return file;
    }
    let twin = NeuralField::new(StoredField::Factored(Box::new(file.clone()))).expect("a field");
    let asked = poses(&file.scene.record.grid, 500);
    let mut values = vec![0.0; asked.len()];
    twin.query_unclipped(&asked, &mut values).expect("values");
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
fn harmonic(degree: usize, axes: usize, quantity: Quantity, precision: Precision) -> HarmonicFile {
    let FactoredFile { field, scene, fit, report, calibration, .. } =
        file(Domain::Directions, degree, axes, quantity);
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
    GpuField::new(gpu, StoredField::Factored(Box::new(file))).expect("a field")
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
fn middle() -> Vec3 {
    let grid = scene().record.grid;
    (grid.origin + 0.45 * grid.size()).as_vec3()
}

/// Mirrors, axes along x, y and z, and both.
fn symmetries() -> [Symmetry; 4] {
    let [x, y, z] = middle().as_dvec3().to_array();
    let axis = |along| Some(Axis { along, through: middle().as_dvec3() });
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
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    asked.extend(axes.map(|axis| Pose::along(middle(), axis)));
    asked.extend(axes.map(|axis| Pose::along(middle() + 0.2 * grid.size().as_vec3() * axis, axis)));
    for (index, pose) in asked[20..50].iter_mut().enumerate() {
        pose.position[index % 3] = middle()[index % 3];
    }
    for symmetry in symmetries() {
        for (degree, axes, quantity) in [(7, 21, Quantity::Overlap), (16, 70, Quantity::Depth)] {
            for gpu in every_device() {
                let mut file = file_with(symmetry, Domain::Directions, degree, axes, quantity);
                file.field = file.field.folded();
                let field = GpuField::new(&gpu, StoredField::Factored(Box::new(file))).expect("a field");
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
            let file = harmonic(degree, axes, quantity, precision);
            let field = GpuField::new(&gpu, StoredField::Harmonic(Box::new(file))).unwrap();
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
fn what_the_device_does_not_answer_is_refused_by_name() {
    let file = file(Domain::Rotations, 2, 5, Quantity::Overlap);
    let refused = GpuField::new(&adapter::open(), StoredField::Factored(Box::new(file)));
    let Err(error) = refused else { panic!("a field over rotations") };
    assert!(error.to_string().contains("on the CPU alone"), "{error}");
}
