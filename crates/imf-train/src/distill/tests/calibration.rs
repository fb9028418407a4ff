//! Calibrated fields of depth, harmonic ones and distilled ones, decide nearly all poses.

use std::sync::Arc;

use super::*;
use imf_core::field::PoseField as _;
use imf_core::tool::Clearance;
use imf_fields::calibration::{Calibration, Goals};
use imf_fields::field::Field;
use imf_fields::field::calibrate::{CalibrationSettings, calibrate, measure_rates};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::file::HarmonicFile;

/// One in five hundred, so that a few ten thousand poses show it.
const SETTINGS: CalibrationSettings = CalibrationSettings {
    uniform: 40_000,
    boundary: 3000,
    errors: 2000,
    seed: 5,
    goals: Goals { false_free: 2e-3, false_colliding: 0.05, confidence: 0.99 },
};

fn calibrated(field: &Field) -> Calibration {
    calibrate(field, &SETTINGS, Control::quiet()).unwrap()
}

/// A field of depth of a reference part at a quarter of its resolution, with two voxels of clearance, as harmonic field and,
/// distilled a little, as factored one.
fn coarse(part: ReferencePart) -> [FieldFile; 2] {
    let dims = part.dims().map(|n| n / 4);
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let spec = SceneSpec { margin: 1, ..SceneSpec::of_reference(part, &mesh, dims, &tool) };
    let scene = spec.scene().unwrap();
    let room = 2.0 * scene.record.grid.pitch;
    let scene = scene.with_clearance(&Clearance { holder: room, shank: room, cutter: room }).unwrap();
    let fitting = FitSettings {
        quantity: Quantity::Depth,
        degree: 9,
        components: 60,
        sections_per_function: 2.0,
        sample: 1000,
        held_out: 4,
        ..FitSettings::default()
    };
    let harmonic = HarmonicFile::fit(&scene, &fitting, Control::quiet()).unwrap();
    let settings = DistillSettings {
        width: 96,
        omega: 15.0,
        plan: TrainingPlan {
            length: TrainingLength::Steps(300),
            batch: 512,
            ..DistillSettings::default().plan
        },
        optimiser: Optimiser::Soap(SoapConfig::default()),
        ..DistillSettings::default()
    };
    let mut state = settings.start(harmonic.field.component_count());
    distil(&harmonic.field, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
    let factored = FactoredFile::distilled(&harmonic, settings, state).unwrap();
    let factored = FactoredFile { state: None, ..factored };
    [FieldFile::Harmonic(Arc::new(harmonic)), FieldFile::Factored(Box::new(factored))]
}

#[test]
fn depth_decides_nearly_all_poses_of_every_reference_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    for part in ReferencePart::ALL {
        for mut saved in coarse(part) {
            let calibration = calibrated(&Field::new(saved.clone()).unwrap());
            assert!(calibration.meets_its_goals(), "{part:?}: {calibration:?}");
            assert!(calibration.uniform.undecided_fraction() < 0.1, "{part:?}: {calibration:?}");
            // The file tells what it is of, and decides as it did; the rates hold on fresh poses, within four standard
            // deviations of their bound.
            saved.set_calibration(calibration);
            saved.write(&path).unwrap();
            assert_eq!((FieldFile::read(&path).unwrap(), saved.quantity()), (saved, Quantity::Depth));
            let field = Field::load(&path).unwrap();
            assert_eq!(field.quantity(), Quantity::Depth);
            let fresh = CalibrationSettings { seed: 11, ..SETTINGS };
            let [uniform, _] = measure_rates(&field, &calibration, &fresh, Control::quiet()).unwrap();
            for (rate, stated) in [
                (uniform.false_free, calibration.uniform.false_free),
                (uniform.false_colliding, calibration.uniform.false_colliding),
            ] {
                let expected = rate.of as f64 * stated.bound;
                assert!(rate.wrong as f64 <= expected + 4.0 * expected.sqrt(), "{part:?}: {uniform:?}");
            }
            assert!(uniform.undecided_fraction() < 0.1, "{part:?}: {uniform:?}");
        }
    }
}
