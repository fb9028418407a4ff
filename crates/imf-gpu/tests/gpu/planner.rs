//! Poses answered on the adapter for the paper's network against the same field on the CPU: values, gradients, decisions and
//! minima, from slices and from buffers of the device.

use glam::DVec3;
use imf_core::control::Control;
use imf_core::field::{Gradient, GridField as _, PoseField as _};
use imf_core::orientation::OrientationSet;
use imf_core::pose::Pose;
use imf_fields::file::FieldFile;
use imf_fields::model::Model;
use imf_fields::siren::output::move_to_the_foot;
use imf_fields::siren::{EvaluationEngine as _, features};
use imf_gpu::{Gpu, GpuEvaluator, GpuField};

use crate::devices::{apart, every_device, open};
use crate::fields::{calibration, model};
use crate::queries::{compare, compare_at, compare_minima, compare_on_device, poses};
use crate::tolerances::SIREN as WITHIN;

fn field(gpu: &Gpu, skip_after: Option<usize>) -> GpuField {
    GpuField::new(gpu, FieldFile::Siren(Box::new(model(skip_after)))).expect("a field")
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn poses_are_answered_as_on_the_cpu_and_in_place_from_buffers_of_the_device() {
    for skip in [None, Some(1)] {
        for gpu in every_device() {
            let field = field(&gpu, skip);
            compare(&field, &WITHIN);
            compare_minima(&field, &WITHIN);
            compare_on_device(&gpu, &field, &poses(&field.twin().scene().record.grid, 1000));
        }
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn clamped_values_are_the_twins_and_have_no_slope() {
    let mut model = Model { calibration: Some(calibration(2e-4, 4e-4)), ..model(None) };
    move_to_the_foot(&mut model.state.parameters);
    let field = GpuField::new(&open(), FieldFile::Siren(Box::new(model))).expect("a field");
    let poses = poses(&field.twin().scene().record.grid, 1000);
    let mut gradients = vec![Gradient::NAN; poses.len()];
    field.gradients(&poses, &mut gradients).expect("answers");
    let clamped: Vec<&Gradient> = gradients.iter().filter(|gradient| gradient.value == 0.0).collect();
    assert!(100 < clamped.len() && clamped.len() < 900, "{} of them", clamped.len());
    let is_flat = |found: &&Gradient| found.position.length() == 0.0 && found.direction.length() == 0.0;
    assert!(clamped.iter().all(is_flat));
    compare_at(&field, &WITHIN, &poses);
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn positions_outside_the_box_are_answered_alike_by_poses_and_by_samples() {
    let (gpu, model) = (open(), model(Some(1)));
    let grid = model.scene.record.grid;
    let [low, high] = grid.box_of_centres();
    let poses: Vec<Pose> = (0..60)
        .map(|index| {
            let part = |of: u32| f64::from(index * of % 61) / 60.0;
            let mut position = low + DVec3::new(part(7), part(11), part(13)) * (high - low);
            let room = [0.4 * grid.pitch, 3.0 * grid.pitch, 1e3][index as usize / 6 % 3];
            let axis = index as usize % 3;
            position[axis] = if index % 2 == 0 { low[axis] - room } else { high[axis] + room };
            let axis = DVec3::new(part(5) - 0.5, part(3) - 0.5, 0.3);
            Pose::along(position, axis)
        })
        .collect();
    let mut engine = GpuEvaluator::new(&gpu, model.shape, &model.state.parameters).expect("an evaluator");
    let mut samples = |poses: &[Pose]| {
        let inputs = poses.iter().flat_map(|pose| {
            let [theta, phi] = pose.orientation().angles();
            features(grid.unit(pose.position.clamp(low, high)).as_vec3().to_array(), theta, phi)
        });
        let mut values = vec![f32::NAN; poses.len()];
        engine.evaluate(&inputs.collect::<Vec<f32>>(), &mut values).expect("answers");
        values
    };
    let mut found = vec![f32::NAN; poses.len()];
    field(&gpu, Some(1)).values(&poses, &mut found).expect("answers");
    for ((expected, found), pose) in samples(&poses).iter().zip(&found).zip(&poses) {
        assert!((expected - found).abs() < WITHIN.value, "{pose:?}: {expected} against {found}");
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn grids_are_the_twins_also_in_vertical_directions_whatever_their_theta() {
    let device = field(&open(), Some(1));
    let twin = device.twin();
    let set = OrientationSet::parse("0,0;90,0;37,180;40,65").expect("a set").orientations;
    let voxels = twin.grid().len();
    let [mut found, mut expected] = [0; 2].map(|_| vec![f32::NAN; voxels * set.len()]);
    device.sections(&set, &mut found).expect("sections");
    twin.sections(&set, &mut expected).expect("sections");
    assert!(apart(&found, &expected) < WITHIN.value);
    for (orientation, section) in set.iter().zip(found.chunks(voxels)) {
        let at = |voxel| Pose::oriented(twin.grid().centre(twin.grid().voxel(voxel)), orientation);
        let poses: Vec<Pose> = (0..voxels).map(at).collect();
        let mut values = vec![f32::NAN; voxels];
        device.values(&poses, &mut values).expect("values");
        assert!(apart(&values, section) < WITHIN.value, "{orientation:?}");
    }
    let [found, expected] = [device.minimum(&set, Control::quiet()), twin.minimum(&set, Control::quiet())]
        .map(|minimum| minimum.expect("a minimum"));
    assert!(apart(&found.value, &expected.value) < WITHIN.value);
    assert!(device.minimum(&[], Control::quiet()).is_err());
}
