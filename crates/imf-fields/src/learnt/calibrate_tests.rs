use crate::calibration::{Calibration, Goals};
use crate::factored::file::FactoredFile;
use crate::factored::{FactoredField, TeachSettings};
use crate::harmonic::basis::Domain;
use crate::harmonic::coefficients::Precision;
use crate::harmonic::file::HarmonicFile;
use crate::harmonic::{FitSettings, fit};
use crate::learnt::NeuralField;
use crate::learnt::calibrate::{CalibrationError, CalibrationSettings, calibrate, judge};
use crate::learnt::scenes::{factored_file, harmonic, harmonic_file, poses, scene, siren_model};
use crate::recipe::MuonConfig;
use crate::recipe::Optimiser;
use crate::recipe::{Length, TrainingPlan};
use crate::stored::StoredField;
use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::planner::{Decision, PoseField};
use imf_core::scene::SceneSpec;
use imf_core::section::{Quantity, SectionPlan};
use imf_core::tool::{Clearance, Tool};
use imf_train::distill::teach;

/// One in five hundred, so that a few ten thousand poses show it.
const SETTINGS: CalibrationSettings = CalibrationSettings {
    uniform: 40_000,
    boundary: 3000,
    errors: 2000,
    seed: 5,
    goals: Goals { false_free: 2e-3, false_blocked: 0.05, confidence: 0.99 },
};

fn calibrated(field: &NeuralField) -> Calibration {
    calibrate(field, &SETTINGS, Control::quiet()).unwrap()
}

#[test]
fn stated_rates_hold_on_fresh_poses() {
    let scene = scene(&Tool::paper(), 2.0);
    let field = harmonic(&scene);
    let calibration = calibrated(&field);
    let (free, blocked) = (calibration.free_up_to.unwrap(), calibration.blocked_from.unwrap());
    assert!(free < blocked && calibration.fault().is_none());
    assert!(calibration.keeps_its_goals(), "{calibration:?}");
    assert!(calibration.uniform.found_free > 0 && calibration.uniform.largest_error > 0.0);
    // A tool grown by two voxels still touches where the true one was moved a voxel away from contact.
    let boundary = calibration.boundary;
    assert_eq!((boundary.poses, boundary.false_blocked.of), (3000, 0));
    assert!((600..2400).contains(&boundary.false_free.of), "{boundary:?}");

    // Other poses, judged by the definition of both tools.
    let field = field.with_calibration(Some(calibration));
    let asked = poses(&scene, 8000, 77);
    let mut decisions = vec![Decision::Near; asked.len()];
    field.classify(&asked, &mut decisions).unwrap();
    let (mut colliding, mut false_free, mut clear, mut false_blocked) = (0.0, 0.0, 0.0, 0.0);
    for (pose, decision) in asked.iter().zip(decisions) {
        let (position, orientation) = (pose.position.as_dvec3(), pose.orientation());
        let hits = |tool: &Tool| tool.count_inside(&scene.obstacle, position, &orientation) > 0;
        if hits(scene.record.bare_tool()) {
            colliding += 1.0;
            false_free += f64::from(decision == Decision::Free);
        } else if !hits(&scene.record.tool) {
            clear += 1.0;
            false_blocked += f64::from(decision == Decision::Blocked);
        }
    }
    // Four standard deviations of a count beyond the bound: once in thirty thousand draws.
    let most = |of: f64, rate: f64| of * rate + 4.0 * (of * rate).sqrt();
    assert!(
        false_free <= most(colliding, calibration.uniform.false_free.bound),
        "{false_free} of {colliding}"
    );
    assert!(
        false_blocked <= most(clear, calibration.uniform.false_blocked.bound),
        "{false_blocked} of {clear}"
    );

    // And by the judge itself, whose draw of the same seed would be the same.
    let again = judge(&field, &calibration, &SETTINGS, Control::quiet()).unwrap();
    assert_eq!(again, [calibration.uniform, calibration.boundary]);
    let other = CalibrationSettings { seed: 6, ..SETTINGS };
    let [uniform, _] = judge(&field, &calibration, &other, Control::quiet()).unwrap();
    assert!(uniform != calibration.uniform);
    let (wrong, of) = (uniform.false_free.wrong as f64, uniform.false_free.of as f64);
    assert!(wrong <= most(of, calibration.uniform.false_free.bound), "{wrong} of {of}");
}

#[test]
fn what_cannot_be_shown_is_refused() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = harmonic(&scene);
    let few = CalibrationSettings { uniform: 3000, goals: Goals::default(), ..SETTINGS };
    let error = calibrate(&field, &few, Control::quiet()).unwrap_err();
    assert!(matches!(error, CalibrationError::TooFew { .. }) && error.to_string().contains("more poses"));
    let wrong = CalibrationSettings { goals: Goals { confidence: 1.0, ..SETTINGS.goals }, ..SETTINGS };
    let error = calibrate(&field, &wrong, Control::quiet()).unwrap_err();
    assert!(error.to_string().contains("confidence"), "{error}");
}

#[test]
fn every_familys_file_keeps_its_calibration() {
    let scene = scene(&Tool::paper(), 2.0);
    let calibration = calibrated(&harmonic(&scene));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    let all = [
        StoredField::Siren(Box::new(siren_model(&scene))),
        StoredField::Harmonic(Box::new(harmonic_file(&scene, 4))),
        StoredField::Factored(Box::new(factored_file(&scene))),
    ];
    for mut stored in all {
        // A file without one, as all were before.
        stored.write(&path).unwrap();
        let plain = std::fs::read(&path).unwrap();
        assert!(!plain.windows(11).any(|w| w == b"calibration"));
        assert_eq!(StoredField::read(&path).unwrap().calibration(), None);
        stored.set_calibration(calibration);
        stored.write(&path).unwrap();
        assert_eq!(StoredField::read(&path).unwrap(), stored);
        assert_eq!(NeuralField::load(&path).unwrap().calibration(), Some(&calibration));
        // Thresholds that cannot be.
        stored.set_calibration(Calibration { free_up_to: Some(0.5), blocked_from: Some(0.2), ..calibration });
        stored.write(&path).unwrap();
        let error = StoredField::read(&path).unwrap_err().to_string();
        assert!(error.contains("thresholds cross"), "{error}");
    }
}

/// A field of depth of a reference part at a quarter of its resolution, with two voxels of clearance, as harmonic field and,
/// taught a little, as factored one.
fn coarse(part: ReferencePart) -> [StoredField; 2] {
    let dims = part.dims().map(|n| n / 4);
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let spec = SceneSpec { margin: 1, ..SceneSpec::of_reference(part, &mesh, dims, &tool) };
    let scene = spec.scene().unwrap();
    let room = 2.0 * scene.record.grid.pitch;
    let scene = scene.with_clearance(&Clearance { holder: room, shank: room, cutter: room }).unwrap();
    let settings = FitSettings {
        quantity: Quantity::Depth,
        degree: 9,
        axes: 60,
        sections_per_function: 2.0,
        sample: 1000,
        held_out: 4,
        ..FitSettings::default()
    };
    let plan = SectionPlan::of_scene(&scene).unwrap();
    let field = fit(&plan, Domain::Directions, &settings, Control::quiet()).unwrap();
    let teaching = TeachSettings {
        width: 96,
        omega: 15.0,
        plan: TrainingPlan { length: Length::Steps(300), batch: 512, ..TeachSettings::default().plan },
        optimiser: Optimiser::Muon(MuonConfig::default()),
        ..TeachSettings::default()
    };
    let mut state = teaching.start(field.axis_count());
    teach(&field, &teaching, &mut state, Control::quiet(), &mut |_| {}).unwrap();
    let small =
        FactoredField::new(&field, teaching.shape(field.axis_count()), state.training.parameters).unwrap();
    let report = field.report;
    let harmonic = HarmonicFile { field, scene: scene.clone(), settings, calibration: None };
    let factored = FactoredFile {
        field: small,
        scene,
        fit: settings,
        report,
        settings: teaching,
        precision: Precision::F32,
        state: None,
        calibration: None,
    };
    [StoredField::Harmonic(Box::new(harmonic)), StoredField::Factored(Box::new(factored))]
}

#[test]
fn depth_decides_nearly_all_poses_of_every_reference_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    for part in ReferencePart::ALL {
        for mut stored in coarse(part) {
            let calibration = calibrated(&NeuralField::new(stored.clone()).unwrap());
            assert!(calibration.keeps_its_goals(), "{part:?}: {calibration:?}");
            assert!(calibration.uniform.near_share() < 0.1, "{part:?}: {calibration:?}");
            // The file tells what it is of, and decides as it did; the rates hold on fresh poses, within four standard
            // deviations of their bound.
            stored.set_calibration(calibration);
            stored.write(&path).unwrap();
            assert_eq!((StoredField::read(&path).unwrap(), stored.quantity()), (stored, Quantity::Depth));
            let field = NeuralField::load(&path).unwrap();
            assert_eq!(field.quantity(), Quantity::Depth);
            let fresh = CalibrationSettings { seed: 11, ..SETTINGS };
            let [uniform, _] = judge(&field, &calibration, &fresh, Control::quiet()).unwrap();
            for (rate, stated) in [
                (uniform.false_free, calibration.uniform.false_free),
                (uniform.false_blocked, calibration.uniform.false_blocked),
            ] {
                let expected = rate.of as f64 * stated.bound;
                assert!(rate.wrong as f64 <= expected + 4.0 * expected.sqrt(), "{part:?}: {uniform:?}");
            }
            assert!(uniform.near_share() < 0.1, "{part:?}: {uniform:?}");
        }
    }
}
