//! The functions as C calls them, against the Rust calls.

use std::ffi::{CStr, CString};
use std::path::Path;
use std::ptr::{null, null_mut};

use imf_c::*;
use imf_core::field::{Best, Decision, Gradient, PoseField};
use imf_core::glam::{DQuat, DVec3};
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::section::Quantity;
use imf_fields::field::Field;

use crate::files::{DIMS, harmonic, harmonic_of, scene, siren, some, spread};

pub(crate) fn last_error() -> String {
    // SAFETY: read at once.
    unsafe { CStr::from_ptr(imf_last_error()) }.to_str().unwrap().to_owned()
}

type Open = unsafe extern "C" fn(*const std::ffi::c_char, *mut *mut ImfField) -> ImfStatus;

fn open(by: Open, path: &Path) -> *mut ImfField {
    let path = CString::new(path.to_str().unwrap()).unwrap();
    let mut field = null_mut();
    // SAFETY: a text that ends with 0, and a place.
    let status = unsafe { by(path.as_ptr(), &mut field) };
    assert_eq!(status, ImfStatus::Ok, "{}", last_error());
    field
}

/// As many as Miri can bear.
fn poses(scene: &Scene, count: usize) -> Vec<ImfPose> {
    let along = |(p, a): (DVec3, DVec3)| imf_pose_along(p.x, p.y, p.z, a.x, a.y, a.z);
    spread(scene, some(count)).into_iter().map(along).collect()
}

const NO: ImfPose = ImfPose { position: [f64::NAN; 3], rotation: [0.0; 4] };

#[test]
fn batches_of_any_size_are_answered_as_in_rust() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    // More than two blocks, and one pose that is none.
    let mut poses = poses(&scene, 600);
    let none = poses.len() / 2;
    poses[none] = NO;
    let in_rust: Vec<Pose> = poses
        .iter()
        .map(|p| Pose::new(DVec3::from_array(p.position), DQuat::from_array(p.rotation)))
        .collect();
    let n = poses.len();
    let mut paths = vec![siren(&scene, folder.path())];
    // What Miri looks at is the same for all families, and fits take it long.
    let deep = (!cfg!(miri)).then(|| harmonic_of(Quantity::Depth, &scene, folder.path()));
    if let Some(deep) = &deep {
        paths.extend([harmonic(&scene, folder.path()), deep.clone()]);
    }
    for path in paths {
        let rust = Field::load(&path).unwrap();
        let field = open(imf_open_model, &path);
        let (mut values, mut expected) = (vec![-1.0; n], vec![0.0; n]);
        let blank = ImfGradient { value: 0.0, position: [0.0; 3], direction: [0.0; 3], rotation: [0.0; 3] };
        let (mut gradients, mut expected_gradients) = (vec![blank; n], vec![Gradient::NAN; n]);
        let (mut decisions, mut expected_decisions) =
            (vec![ImfDecision::Free; n], vec![Decision::Undecided; n]);
        // SAFETY: as many places as poses.
        unsafe {
            assert_eq!(imf_values(field, poses.as_ptr(), n, values.as_mut_ptr()), ImfStatus::Ok);
            let status = imf_gradients(field, poses.as_ptr(), n, gradients.as_mut_ptr());
            assert_eq!(status, ImfStatus::Ok);
            assert_eq!(imf_classify(field, poses.as_ptr(), n, decisions.as_mut_ptr()), ImfStatus::Ok);
        }
        rust.values(&in_rust, &mut expected).unwrap();
        rust.gradients(&in_rust, &mut expected_gradients).unwrap();
        rust.classify(&in_rust, &mut expected_decisions).unwrap();
        for i in 0..n {
            assert_eq!(values[i].to_bits(), expected[i].to_bits(), "pose {i}");
            let (found, wanted) = (gradients[i], expected_gradients[i]);
            let flat = |value: f32, parts: [[f32; 3]; 3]| {
                let mut all = vec![value.to_bits()];
                all.extend(parts.as_flattened().iter().map(|v| v.to_bits()));
                all
            };
            assert_eq!(
                flat(found.value, [found.position, found.direction, found.rotation]),
                flat(
                    wanted.value,
                    [wanted.position, wanted.direction, wanted.rotation].map(|v| v.to_array())
                ),
                "pose {i}"
            );
            assert_eq!(format!("{:?}", decisions[i]), format!("{:?}", expected_decisions[i]));
        }
        assert!(values[none].is_nan() && decisions[none] == ImfDecision::Colliding);

        let (m, turns) = (n / 2, 20);
        let points: Vec<[f64; 3]> = poses.iter().take(m).map(|p| p.position).collect();
        let rotations: Vec<[f64; 4]> = poses.iter().take(turns).map(|p| p.rotation).collect();
        let mut best = vec![ImfBest { value: 9.0, orientation: 9, decision: ImfDecision::Undecided }; m];
        // SAFETY: m points, as many rotations as turns, m places.
        let status = unsafe {
            imf_best(field, points.as_ptr().cast(), m, rotations.as_ptr().cast(), turns, best.as_mut_ptr())
        };
        assert_eq!(status, ImfStatus::Ok);
        let mut expected = vec![Best::NONE; m];
        let points: Vec<DVec3> = in_rust.iter().take(m).map(|p| p.position).collect();
        let rotations: Vec<DQuat> = in_rust.iter().take(turns).map(|p| p.rotation).collect();
        rust.best(&points, &rotations, &mut expected).unwrap();
        for (found, wanted) in best.iter().zip(&expected) {
            assert_eq!((found.value, found.orientation), (wanted.value, wanted.orientation));
        }

        // SAFETY: 0 is a value of each of its fields.
        let mut info = ImfInfo { calibrated: true, ..unsafe { std::mem::zeroed() } };
        // SAFETY: one place.
        assert_eq!(unsafe { imf_info(field, &mut info) }, ImfStatus::Ok);
        let grid = scene.record.grid;
        assert_eq!((info.pitch, info.unit_in_mm, info.calibrated), (grid.pitch, 1.0, false));
        assert_eq!((info.lower, info.clearance), (grid.centre([0; 3]).to_array(), [grid.pitch; 3]));
        assert_eq!((info.upper, info.contact), (grid.centre(DIMS.map(|n| n - 1)).to_array(), 0.0));
        let depth = Some(&path) == deep.as_ref();
        assert_eq!(info.quantity, if depth { ImfQuantity::Depth } else { ImfQuantity::Overlap });
        assert_eq!(info.bounds, if depth { [-7.5 * grid.pitch, 7.5 * grid.pitch] } else { [0.0, 1.0] });
        // Values are what the field is said to be of.
        assert_eq!(values.iter().any(|&value| value < 0.0), depth);
        // SAFETY: opened above, closed once.
        unsafe { imf_close(field) };
        // Counts are overlaps, whatever the file's own field is of.
        let exact = open(imf_open_exact, &path);
        // SAFETY: one place; opened above, closed once.
        unsafe {
            assert_eq!(imf_info(exact, &mut info), ImfStatus::Ok);
            imf_close(exact);
        }
        assert_eq!((info.quantity, info.bounds), (ImfQuantity::Overlap, [0.0, 1.0]));
    }
}

#[test]
fn clearance_is_kept_only_by_the_field_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    let path = harmonic(&scene, folder.path());
    let poses = poses(&scene, 700);
    let free = |by: Open| -> Vec<bool> {
        let field = open(by, &path);
        let mut decisions = vec![ImfDecision::Undecided; poses.len()];
        // SAFETY: as many places as poses; opened here, closed once.
        unsafe {
            let status = imf_classify(field, poses.as_ptr(), poses.len(), decisions.as_mut_ptr());
            assert_eq!(status, ImfStatus::Ok);
            imf_close(field);
        }
        decisions.into_iter().map(|d| d == ImfDecision::Free).collect()
    };
    let (bare, keeping, exact) =
        (free(imf_open_verified), free(imf_open_verified_with_clearance), free(imf_open_exact));
    // The exact field counts the offset tool.
    assert_eq!(keeping, exact);
    assert!(bare.iter().zip(&keeping).all(|(bare, keeping)| *bare || !keeping) && bare != keeping);
}

#[test]
fn a_file_in_memory_is_opened_as_that_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    let path = harmonic(&scene, folder.path());
    let bytes = std::fs::read(&path).unwrap();
    let poses = poses(&scene, 300);
    let read = open(imf_open_verified, &path);
    let (mut given, mut none) = (null_mut(), read);
    // SAFETY: bytes, a text that ends with 0 and a place, or what is refused before it is read; closed once.
    unsafe {
        let open = imf_open_verified_from_memory;
        let status = open(bytes.as_ptr(), bytes.len(), c"in memory".as_ptr(), &mut given);
        assert_eq!(status, ImfStatus::Ok, "{}", last_error());
        let answers = [read, given].map(|field| {
            let mut values = vec![-1.0_f32; poses.len()];
            let mut decisions = vec![ImfDecision::Undecided; poses.len()];
            let status = imf_values(field, poses.as_ptr(), poses.len(), values.as_mut_ptr());
            assert_eq!(status, ImfStatus::Ok);
            let status = imf_classify(field, poses.as_ptr(), poses.len(), decisions.as_mut_ptr());
            assert_eq!(status, ImfStatus::Ok);
            imf_close(field);
            (values.into_iter().map(f32::to_bits).collect::<Vec<_>>(), decisions)
        });
        assert!(answers[0] == answers[1] && answers[0].1.contains(&ImfDecision::Free));
        let status = open(bytes.as_ptr(), bytes.len() / 2, c"in memory".as_ptr(), &mut none);
        assert_eq!(status, ImfStatus::File);
        assert!(none.is_null() && last_error().contains("in memory"), "{}", last_error());
        assert_eq!(open(null(), 1, c"in memory".as_ptr(), &mut none), ImfStatus::NullPointer);
    }
}

#[test]
fn what_c_must_not_do_is_a_status() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    let path = siren(&scene, folder.path());
    let field = open(imf_open_exact, &path);
    let pose = imf_pose_along(0.0, 0.0, 0.0, 0.0, 0.0, 2.0);
    let mut value = 7.0;
    let mut best = ImfBest { value: 0.0, orientation: 0, decision: ImfDecision::Undecided };
    // SAFETY: refused before anything is read through a null pointer.
    unsafe {
        assert_eq!(imf_values(null(), &pose, 1, &mut value), ImfStatus::NullPointer);
        assert!(last_error().contains("field is NULL"));
        assert_eq!(imf_values(field, null(), 1, &mut value), ImfStatus::NullPointer);
        assert_eq!(imf_values(field, &pose, 1, null_mut()), ImfStatus::NullPointer);
        assert_eq!(imf_values(field, &pose, usize::MAX, &mut value), ImfStatus::Argument);
        assert_eq!(imf_values(field, null(), 0, null_mut()), ImfStatus::Ok);
        assert_eq!(value, 7.0);
        assert_eq!(imf_info(field, null_mut()), ImfStatus::NullPointer);
        let point = [0.0_f64; 3];
        assert_eq!(imf_best(field, point.as_ptr(), 1, null(), 0, &mut best), ImfStatus::Argument);
        assert!(last_error().contains("orientations"), "{}", last_error());
        assert_eq!(imf_best(field, point.as_ptr(), usize::MAX, null(), 0, &mut best), ImfStatus::Argument);
        let mut motion = std::mem::zeroed::<ImfMotion>();
        assert_eq!(imf_check_motion(field, &pose, &pose, &mut motion), ImfStatus::Ok);
        let model = open(imf_open_model, &path);
        assert_eq!(imf_check_motion(model, &pose, &pose, &mut motion), ImfStatus::Unsupported);
        assert!(last_error().contains("imf_open_exact"), "{}", last_error());
        imf_close(model);
        let verified = open(imf_open_verified, &path);
        assert_eq!(imf_check_motion(verified, &pose, &NO, &mut motion), ImfStatus::NoAnswer);
        assert_eq!(imf_check_motion(verified, &pose, null(), &mut motion), ImfStatus::NullPointer);
        let none = imf_pose_along(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        assert!(none.rotation.iter().all(|v| v.is_nan()));
        imf_close(verified);
        imf_close(field);
        imf_close(null_mut());

        let mut opened = field;
        let missing = CString::new(folder.path().join("none").to_str().unwrap()).unwrap();
        assert_eq!(imf_open_model(missing.as_ptr(), &mut opened), ImfStatus::File);
        assert!(opened.is_null() && last_error().contains("none"), "{}", last_error());
        assert_eq!(imf_open_model(null(), &mut opened), ImfStatus::NullPointer);
        assert_eq!(imf_open_model(missing.as_ptr(), null_mut()), ImfStatus::NullPointer);
        let version = CStr::from_ptr(imf_version()).to_str().unwrap();
        assert_eq!(version, env!("CARGO_PKG_VERSION"));
    }
}
