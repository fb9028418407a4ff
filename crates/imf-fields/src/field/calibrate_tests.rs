use crate::calibration::{Calibration, Goals};
use crate::factored::{Axis, Symmetry};
use crate::field::Field;
use crate::field::calibrate::{CalibrationError, CalibrationSettings, calibrate, measure_rates};
use crate::field::scenes::{calibration, harmonic, poses, scene, with_symmetry};
use crate::field::tests::all;
use crate::file::FieldFile;
use glam::Vec3Swizzles as _;
use imf_core::control::Control;
use imf_core::field::{Decision, PoseField};
use imf_core::tool::Tool;

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

#[test]
fn stated_rates_hold_on_fresh_poses() {
    let scene = scene(&Tool::paper(), 2.0);
    let field = harmonic(&scene);
    let calibration = calibrated(&field);
    let (free, blocked) = (calibration.free_up_to.unwrap(), calibration.colliding_from.unwrap());
    assert!(free < blocked && calibration.fault().is_none());
    assert!(calibration.meets_its_goals(), "{calibration:?}");
    assert!(calibration.uniform.found_free > 0 && calibration.uniform.largest_error > 0.0);
    // A tool offset by two voxels still touches where the true one was moved a voxel away from contact.
    let boundary = calibration.boundary;
    assert_eq!((boundary.poses, boundary.false_colliding.of), (3000, 0));
    assert!((600..2400).contains(&boundary.false_free.of), "{boundary:?}");

    // Other poses, decided by the definition of both tools.
    let field = field.with_calibration(Some(calibration));
    let asked = poses(&scene, 8000, 77);
    let mut decisions = vec![Decision::Undecided; asked.len()];
    field.classify(&asked, &mut decisions).unwrap();
    let (mut colliding, mut false_free, mut clear, mut false_colliding) = (0.0, 0.0, 0.0, 0.0);
    for (pose, decision) in asked.iter().zip(decisions) {
        let (position, orientation) = (pose.position, pose.orientation());
        let hits = |tool: &Tool| tool.count_inside(&scene.obstacle, position, &orientation) > 0;
        if hits(scene.record.bare_tool()) {
            colliding += 1.0;
            false_free += f64::from(decision == Decision::Free);
        } else if !hits(&scene.record.tool) {
            clear += 1.0;
            false_colliding += f64::from(decision == Decision::Colliding);
        }
    }
    // Four standard deviations of a count beyond the bound: once in thirty thousand draws.
    let most = |of: f64, rate: f64| of * rate + 4.0 * (of * rate).sqrt();
    assert!(
        false_free <= most(colliding, calibration.uniform.false_free.bound),
        "{false_free} of {colliding}"
    );
    assert!(
        false_colliding <= most(clear, calibration.uniform.false_colliding.bound),
        "{false_colliding} of {clear}"
    );

    // And by the measurement itself, whose draw of the same seed would be the same.
    let again = measure_rates(&field, &calibration, &SETTINGS, Control::quiet()).unwrap();
    assert_eq!(again, [calibration.uniform, calibration.boundary]);
    let other = CalibrationSettings { seed: 6, ..SETTINGS };
    let [uniform, _] = measure_rates(&field, &calibration, &other, Control::quiet()).unwrap();
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
fn decisions_follow_the_thresholds_and_are_near_without() {
    let scene = scene(&Tool::paper(), 0.0);
    let asked = poses(&scene, 600, 5);
    let mut around_an_axis = 0;
    let through = scene.record.grid.origin + 0.45 * scene.record.grid.size();
    let symmetry = Symmetry { mirrors: [None; 3], axis: Some(Axis { along: 0, through }) };
    let symmetric = FieldFile::Factored(Box::new(with_symmetry(&scene, symmetry)));
    let symmetric = ("with symmetry", Field::new(symmetric).unwrap());
    for (name, field) in all(&scene).into_iter().chain([symmetric]) {
        let mut raw = vec![0.0; asked.len()];
        field.values_unclipped(&asked, &mut raw).unwrap();
        let mut sorted = raw.clone();
        sorted.sort_by(f32::total_cmp);
        let (free, blocked) = (sorted[200], sorted[400]);
        let mut decisions = vec![Decision::Colliding; asked.len()];
        field.classify(&asked, &mut decisions).unwrap();
        assert!(decisions.iter().all(|&d| d == Decision::Undecided), "{name}");
        let field = field.with_calibration(Some(calibration(free, blocked)));
        field.classify(&asked, &mut decisions).unwrap();
        let axis = field.undecided_around();
        for ((value, decision), pose) in raw.iter().zip(&decisions).zip(&asked) {
            let is_around = axis.is_some_and(|(Axis { along, through }, around)| {
                assert_eq!((along, around), (0, 2.0 * scene.record.grid.pitch), "{name}");
                (pose.position - through).yz().length() <= around
            });
            let expected = match value {
                _ if is_around => Decision::Undecided,
                v if *v <= free => Decision::Free,
                v if *v >= blocked => Decision::Colliding,
                _ => Decision::Undecided,
            };
            assert_eq!(*decision, expected, "{name}: {value}");
            around_an_axis += usize::from(is_around && !(free..blocked).contains(value));
        }
        assert!(
            [Decision::Free, Decision::Colliding, Decision::Undecided].iter().all(|d| decisions.contains(d))
        );
    }
    assert!(around_an_axis > 0);
}
