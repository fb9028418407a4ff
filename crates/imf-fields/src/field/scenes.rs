//! Small fields of every family for the tests.

use std::sync::Arc;

use glam::DVec3;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use crate::calibration::{Calibration, DecisionRates, Rate};
use crate::factored::file::FactoredFile;
use crate::factored::{DistillSettings, FactoredField, FactoredShape, FactoredState, Symmetry};
use crate::field::Field;
use crate::file::FieldFile;
use crate::harmonic::coefficients::{Coefficients, StoragePrecision};
use crate::harmonic::file::HarmonicFile;
use crate::harmonic::{FitSettings, Gradient};
use crate::model::{Model, TrainingRecord};
use crate::recipe::TrainingState;
use crate::siren::SirenShape;
use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::tool::{Clearance, Tool};

/// A coarse bracket and a tool, offset all around by a clearance in voxels.
pub(crate) fn scene(tool: &Tool, clearance: f64) -> Scene {
    let mesh = ReferencePart::Bracket.mesh();
    let spec =
        SceneSpec { margin: 1, ..SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [12, 36, 22], tool) };
    let scene = spec.scene().unwrap();
    let room = clearance * scene.record.grid.pitch;
    scene.with_clearance(&Clearance { holder: room, shank: room, cutter: room }).unwrap()
}

pub(crate) fn harmonic_file(scene: &Scene, degree: usize) -> HarmonicFile {
    let settings = FitSettings {
        degree,
        sections_per_function: 1.5,
        components: 40,
        sample: 1000,
        held_out: 4,
        precision: StoragePrecision::F32,
        ..FitSettings::default()
    };
    HarmonicFile::fit(scene, &settings, Control::quiet()).unwrap()
}

/// The same with coefficients in f16.
pub(crate) fn harmonic_in_halves(scene: &Scene, degree: usize) -> HarmonicFile {
    let mut file = harmonic_file(scene, degree);
    let Coefficients::F32(values) = file.field.coefficients else { panic!("made in f32") };
    file.field.coefficients = Coefficients::new(values, StoragePrecision::F16);
    file.settings.precision = StoragePrecision::F16;
    file
}

pub(crate) fn harmonic(scene: &Scene) -> Field {
    Field::new(FieldFile::Harmonic(Arc::new(harmonic_file(scene, 8)))).unwrap()
}

/// Weights as they are before training: a field as bumpy as any.
pub(crate) fn factored_file(scene: &Scene) -> FactoredFile {
    let teacher = harmonic_file(scene, 6);
    let settings = DistillSettings { width: 24, hidden: 2, omega: 6.0, ..DistillSettings::default() };
    let shape = settings.shape(teacher.field.component_count());
    let state = FactoredState::new(&shape, 4);
    FactoredFile { state: None, ..FactoredFile::distilled(&teacher, settings, state).unwrap() }
}

pub(crate) fn factored(scene: &Scene) -> Field {
    Field::new(FieldFile::Factored(Box::new(factored_file(scene)))).unwrap()
}

/// Starting weights, of the paper's shape but narrow.
pub(crate) fn siren_model(scene: &Scene) -> Model {
    let shape = SirenShape { width: 33, hidden: 3, omega: 3.0, ..SirenShape::default() };
    let orientations = OrientationSet::parse("fibonacci:3").unwrap();
    let record = TrainingRecord { finished: true, ..TrainingRecord::untrained(orientations) };
    let state = TrainingState::new(&shape, 3);
    Model { shape, scene: scene.clone(), record, state, calibration: None }
}

/// A factored field with other starting weights, of a network with this symmetry.
pub(crate) fn with_symmetry(scene: &Scene, symmetry: Symmetry) -> FactoredFile {
    let file = factored_file(scene);
    let shape = FactoredShape { symmetry, ..file.field.shape };
    let parameters = shape.initial_parameters(5);
    FactoredFile { field: FactoredField { shape, parameters, ..file.field }, ..file }
}

/// A calibration of these thresholds.
pub(crate) fn calibration(free: f32, colliding: f32) -> Calibration {
    let rate = Rate::new(0, 100, 0.99);
    let rates = DecisionRates {
        poses: 200,
        false_free: rate,
        false_colliding: rate,
        undecided: 1,
        found_free: 50,
        misordered: rate,
        largest_error: 0.1,
    };
    Calibration {
        seed: 1,
        uniform: rates,
        boundary: rates,
        ..Calibration::unmeasured(Some(free), Some(colliding))
    }
}

pub(crate) fn siren(scene: &Scene) -> Field {
    Field::new(FieldFile::Siren(Box::new(siren_model(scene)))).unwrap()
}

/// Asserts that gradients of some poses together are those of each by itself, to the rounding of `f32`.
pub(crate) fn assert_gradients_agree(
    scene: &Scene,
    mut together: impl FnMut(&[(DVec3, DVec3)], &mut [Gradient]),
    mut alone: impl FnMut(DVec3, DVec3) -> Gradient,
) {
    let [low, high] = scene.record.grid.box_of_centres();
    for count in [crate::factored::ROWS, 1, 7] {
        let pose = |pose: Pose| (pose.position.clamp(low, high), pose.axis().unwrap());
        let asked: Vec<_> = poses(scene, count, 5).into_iter().map(pose).collect();
        let mut found = vec![Gradient::ZERO; count];
        together(&asked, &mut found);
        for (&(position, direction), found) in asked.iter().zip(found) {
            let one = alone(position, direction);
            assert!((one.value - found.value).abs() < 1e-5, "{} {}", one.value, found.value);
            for (one, found) in [
                (one.position, found.position),
                (one.direction, found.direction),
                (one.rotation, found.rotation),
            ] {
                assert!((one - found).length() < 1e-4 * (1.0 + one.length()), "{one} {found}");
            }
        }
    }
}

/// Uniform positions in the box of the voxel centres, uniform axes.
pub(crate) fn poses(scene: &Scene, count: usize, seed: u64) -> Vec<Pose> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let grid = scene.record.grid;
    let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
    (0..count)
        .map(|_| {
            let unit = DVec3::new(number(), number(), number()) * 0.998 + 0.001;
            let (theta, z) = (std::f64::consts::TAU * number(), 2.0 * number() - 1.0);
            let flat = (1.0 - z * z).sqrt();
            let axis = DVec3::new(flat * theta.cos(), flat * theta.sin(), z).as_vec3();
            // What single precision holds, as graphs and GPUs read it.
            let position = (low + unit * (high - low)).as_vec3();
            Pose::along(position.as_dvec3(), axis.as_dvec3())
        })
        .collect()
}
