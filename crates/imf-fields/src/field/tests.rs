use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec3};

use crate::factored::{Axis, PointScratch, Symmetry};
use crate::field::scenes::{
    calibration, factored, factored_file, harmonic, harmonic_file, poses, scene, siren, siren_model,
    with_symmetry,
};
use crate::field::{Field, Planner};
use crate::file::FieldFile;
use crate::siren::EvaluationEngine;
use crate::siren::evaluator::CpuEvaluator;
use crate::siren::features;
use imf_core::control::Control;
use imf_core::field::*;
use imf_core::mesh::Mesh;
use imf_core::orientation::OrientationSet;
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::tool::{SharpPoints, Tool, ToolShape};

pub(super) fn all(scene: &Scene) -> Vec<(&'static str, Field)> {
    vec![("siren", siren(scene)), ("harmonic", harmonic(scene)), ("factored", factored(scene))]
}

pub(super) fn values(field: &dyn PoseField, poses: &[Pose]) -> Vec<f32> {
    let mut values = vec![-7.0; poses.len()];
    field.values(poses, &mut values).unwrap();
    values
}

#[test]
fn fields_are_shared_by_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Field>();
    shared::<Planner>();
    shared::<ExactField>();
    shared::<Box<dyn PoseField>>();
    shared::<Box<dyn GridField>>();
}

fn unclipped(field: &Field, pose: Pose) -> f32 {
    let mut value = [0.0];
    field.values_unclipped(&[pose], &mut value).unwrap();
    value[0]
}

/// Single precision in another order of addition, and directions rounded to it: relative to waves of degree 8.
pub(super) const ROUNDING: f32 = 1e-4;

#[test]
fn values_are_those_of_each_familys_own_interface() {
    let scene = scene(&Tool::paper(), 0.0);
    // More than a block, and no multiple of one.
    let asked = poses(&scene, 700, 1);
    let near = |name: &str, found: &[f32], expected: &[f32]| {
        for (place, (f, e)) in found.iter().zip(expected).enumerate() {
            assert!((f - e).abs() < ROUNDING, "{name} {place}: {f} against {e}");
        }
    };
    let mut expected = vec![0.0; asked.len()];

    let (file, mut scratch) = (harmonic_file(&scene, 8), crate::harmonic::PointScratch::default());
    for (pose, expected) in asked.iter().zip(&mut expected) {
        let direction = pose.orientation().direction();
        let found = file.field.overlap_with_gradient(pose.position, direction, &mut scratch).unwrap();
        *expected = found.value.clamp(0.0, 1.0);
    }
    near("harmonic", &values(&harmonic(&scene), &asked), &expected);
    assert!(expected.iter().any(|&v| v > 0.05) && expected.contains(&0.0));

    // With an order of axes that is not the world's.
    let through = scene.record.grid.origin + 0.45 * scene.record.grid.size();
    let symmetry =
        Symmetry { mirrors: [None, Some(through.y), None], axis: Some(Axis { along: 0, through }) };
    let symmetric = with_symmetry(&scene, symmetry);
    for (name, file) in [("factored", factored_file(&scene)), ("with symmetry", symmetric)] {
        let (evaluator, mut scratch) = (file.field.evaluator(), PointScratch::default());
        for (pose, expected) in asked.iter().zip(&mut expected) {
            let direction = pose.orientation().direction();
            let found = evaluator.overlap_with_gradient(pose.position, direction, &mut scratch).unwrap();
            *expected = found.value.clamp(0.0, 1.0);
        }
        let field = Field::new(FieldFile::Factored(Box::new(file.clone()))).unwrap();
        near(name, &values(&field, &asked), &expected);
    }

    let model = siren_model(&scene);
    let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
    let inputs: Vec<f32> = asked
        .iter()
        .flat_map(|pose| {
            let [theta, phi] = pose.orientation().angles();
            features(scene.record.grid.unit(pose.position).as_vec3().to_array(), theta, phi)
        })
        .collect();
    engine.evaluate(&inputs, &mut expected).unwrap();
    near("siren", &values(&siren(&scene), &asked), &expected);
}

/// In vertical directions, which have every θ, too.
#[test]
fn grids_are_the_values_of_poses_at_voxel_centres() {
    let scene = scene(&Tool::paper(), 0.0);
    let grid = scene.record.grid;
    let set = OrientationSet::parse("0,0;90,0;37,180;40,65;200,100;300,20").unwrap().orientations;
    for (name, field) in all(&scene) {
        let mut sections = vec![f32::NAN; grid.len() * set.len()];
        field.sections(&set, &mut sections).unwrap();
        for (orientation, section) in set.iter().zip(sections.chunks(grid.len())) {
            let poses: Vec<Pose> = (0..grid.len())
                .map(|voxel| Pose::oriented(grid.centre(grid.voxel(voxel)), orientation))
                .collect();
            let mut found = vec![f32::NAN; grid.len()];
            values_on_all_threads(&field, &poses, &mut found).unwrap();
            for (voxel, (found, expected)) in found.iter().zip(section).enumerate() {
                assert!((found - expected).abs() < ROUNDING, "{name} {voxel} {orientation:?}");
            }
            let mut alone = vec![f32::NAN; grid.len()];
            field.section(orientation, &mut alone).unwrap();
            assert!(alone.iter().zip(section).all(|(a, b)| (a - b).abs() < 1e-6), "{name}");
        }
        let least = field.minimum(&set, Control::quiet()).unwrap();
        for (voxel, value) in least.value.iter().enumerate() {
            let each = sections.iter().skip(voxel).step_by(grid.len());
            let expected = each.copied().fold(f32::INFINITY, f32::min);
            assert!((value - expected).abs() < 1e-5, "{name} {voxel}");
        }
        assert!(field.minimum(&[], Control::quiet()).is_err(), "{name}");
        assert_eq!(field.bounds(), Some(grid.box_of_centres()));
        let cancelled = std::sync::atomic::AtomicBool::new(true);
        let control = Control { cancelled: &cancelled, ..Control::quiet() };
        assert!(matches!(field.minimum(&set, control), Err(FieldError::Cancelled(_))), "{name}");
    }
    // A factored field's coefficients in memory are the same field.
    let (field, expanded) = (factored(&scene), factored(&scene).expanded());
    let asked = poses(&scene, 200, 31);
    let nearest = |point| (grid.continuous(point) + 0.5).floor().to_array().map(|v| v as usize);
    let at_centres: Vec<Pose> =
        asked.iter().map(|pose| Pose { position: grid.centre(nearest(pose.position)), ..*pose }).collect();
    let (a, b) = (values(&field, &at_centres), values(&expanded, &at_centres));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < ROUNDING));
}

/// Poses whose neighbours within a fifth of a voxel lie in the same cell.
fn inside_cells(scene: &Scene, poses: &mut [Pose]) {
    let grid = scene.record.grid;
    for (index, pose) in poses.iter_mut().enumerate() {
        let fraction = 0.25 + 0.5 * ((index * 37 % 101) as f64 / 101.0);
        let cell = grid.continuous(pose.position).floor() + fraction;
        let last = DVec3::from_array(grid.dims.map(|n| (n - 2) as f64));
        let cell = cell.min(last + fraction);
        pose.position = grid.origin + (cell + 0.5) * grid.pitch;
    }
}

#[test]
fn gradients_are_central_differences_also_across_the_seam_and_at_the_poles() {
    let scene = scene(&Tool::paper(), 0.0);
    let pitch = scene.record.grid.pitch;
    for (name, field) in all(&scene) {
        let mut asked = poses(&scene, 200, 2);
        inside_cells(&scene, &mut asked);
        if name != "siren" {
            // The seam at θ = 0°, both poles, and close by.
            let special = [
                DVec3::X,
                DVec3::new(1.0, 1e-4, 0.5),
                DVec3::new(1.0, -1e-4, 0.5),
                DVec3::Z,
                DVec3::NEG_Z,
                DVec3::new(1e-4, 0.0, 1.0),
                DVec3::new(0.0, -1e-3, -1.0),
            ];
            for (index, pose) in asked.iter_mut().take(20 * special.len()).enumerate() {
                *pose = Pose::along(pose.position, special[index % special.len()]);
            }
        } else {
            // Its seam and its poles are jumps.
            asked.retain(|p| {
                let axis = p.axis().unwrap();
                axis.z.abs() < 0.98 && !(axis.x > 0.0 && axis.y.abs() < 0.05)
            });
        }
        let mut found = vec![Gradient::NAN; asked.len()];
        field.gradients(&asked, &mut found).unwrap();
        let mut failures = Vec::new();
        for (pose, found) in asked.iter().zip(&found) {
            let value = |pose: Pose| unclipped(&field, pose);
            assert!((value(*pose) - found.value).abs() < ROUNDING, "{name} {pose:?}");
            let mut check = |what: &str, slope: f32, expected: f32, width: f32| {
                // Rounding of the two values, and what the third derivative adds over the width.
                let tolerance = 2e-6 / width + 0.02 * expected.abs() + 2e-3;
                if (slope - expected).abs() > tolerance {
                    failures.push(format!("{name} {what} {pose:?}: {slope} against {expected}"));
                }
            };
            let step = 0.1 * pitch;
            for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                let ahead = value(Pose { position: pose.position + unit * step, ..*pose });
                let behind = value(Pose { position: pose.position - unit * step, ..*pose });
                // Per voxel, so that one tolerance serves.
                check("position", found.position[axis] * pitch as f32, (ahead - behind) / 0.2, 0.2);
            }
            let angle = 0.01;
            for unit in [DVec3::X, DVec3::Y, DVec3::Z] {
                let turned =
                    |a: f64| Pose { rotation: DQuat::from_axis_angle(unit, a) * pose.rotation, ..*pose };
                let slope = (value(turned(angle)) - value(turned(-angle))) / (2.0 * angle as f32);
                check("rotation", found.rotation.dot(unit.as_vec3()), slope, 2.0 * angle as f32);
            }
            // The tangent on the sphere and the rotation's tangent say the same.
            let axis = pose.axis().unwrap().as_vec3();
            assert!(found.direction.dot(axis).abs() < 1e-3 * (1.0 + found.direction.length()));
            assert!(
                (axis.cross(found.direction) - found.rotation).length()
                    < 1e-5 * (1.0 + found.rotation.length())
            );
        }
        assert!(failures.is_empty(), "{} of them\n{}", failures.len(), failures.join("\n"));
    }
}

#[test]
fn the_papers_network_has_finite_gradients_at_its_jumps() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = siren(&scene);
    let middle = scene.record.grid.origin + 0.5 * scene.record.grid.size();
    let asked = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::new(1e-7, 0.0, 1.0), DVec3::new(1.0, -1e-7, 0.0)]
        .map(|axis| Pose::along(middle, axis));
    let mut found = [Gradient::NAN; 5];
    field.gradients(&asked, &mut found).unwrap();
    for found in found {
        assert!(found.position.is_finite() && found.direction.is_finite() && found.rotation.is_finite());
    }
    // A vertical direction is asked at θ = 180°: the slope is that of the plane y = 0 on the side of −x.
    let value = |axis: DVec3| unclipped(&field, Pose::along(middle, axis));
    for (axis, found) in [(DVec3::Z, found[0]), (DVec3::NEG_Z, found[1])] {
        let by_x = -(value(axis + DVec3::NEG_X * 0.02) - value(axis + DVec3::NEG_X * 1e-3)) / 0.019;
        assert!((found.direction.x - by_x).abs() < 0.02 * by_x.abs() + 2e-3, "{} {by_x}", found.direction);
        assert!(found.direction.y.abs() < 1e-6);
    }
}

#[test]
fn the_papers_network_has_one_value_at_a_vertical_direction_however_it_is_turned() {
    let scene = scene(&Tool::paper(), 0.0);
    let field = siren(&scene);
    let middle = scene.record.grid.origin + 0.5 * scene.record.grid.size();
    for up in [DQuat::IDENTITY, DQuat::from_rotation_x(std::f64::consts::PI)] {
        let turned = |turn: f64| Pose { position: middle, rotation: up * DQuat::from_rotation_z(turn) };
        let found = values(&field, &[0.0, 1.0, 2.5, 4.0, 6.0].map(turned));
        assert!(found.iter().all(|value| *value == found[0]), "{found:?}");
        // Its neighbours at other θ have others.
        let beside = Pose::along(middle, turned(0.0).axis().unwrap() + DVec3::new(1e-3, -1e-4, 0.0));
        assert!((values(&field, &[beside])[0] - found[0]).abs() > 1e-3);
    }
}

#[test]
fn what_is_no_pose_or_outside_has_the_documented_answer() {
    let scene = scene(&Tool::paper(), 0.0);
    let grid = scene.record.grid;
    let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
    let good = Pose::along(0.5 * (low + high), DVec3::X);
    let bad = [
        Pose { position: DVec3::new(0.0, f64::NAN, 0.0), ..good },
        Pose { position: DVec3::new(f64::NEG_INFINITY, 0.0, 0.0), ..good },
        Pose { rotation: DQuat::NAN, ..good },
        Pose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
    ];
    let far = Pose { position: good.position + DVec3::new(0.0, 1e30, 0.0), ..good };
    let face = Pose { position: DVec3::new(good.position.x, high.y, good.position.z), ..good };
    let mut fields: Vec<(&str, Box<dyn PoseField>)> = Vec::new();
    for (name, field) in all(&scene) {
        fields.push((name, Box::new(field.with_calibration(Some(calibration(0.2, 0.3))))));
    }
    fields.push(("verified", Box::new(Planner::new(harmonic(&scene)).unwrap())));
    fields.push(("exact", Box::new(ExactField::new(&scene, Tool::paper()).unwrap())));
    for (name, field) in &fields {
        let mut decisions = [Decision::Free; 4];
        field.classify(&bad, &mut decisions).unwrap();
        assert_eq!(decisions, [Decision::Colliding; 4], "{name}");
        assert!(values(field.as_ref(), &bad).iter().all(|v| v.is_nan()), "{name}");
        let mut gradients = [Gradient { value: 0.0, ..Gradient::NAN }; 4];
        field.gradients(&bad, &mut gradients).unwrap();
        assert!(gradients.iter().all(|g| g.value.is_nan() && g.direction.is_nan()), "{name}");
        let mut best = [Best { value: 0.0, ..Best::NONE }; 2];
        field.best(&[DVec3::NAN, good.position], &[DQuat::NAN, good.rotation], &mut best).unwrap();
        assert!(best[0].value.is_nan() && best[0].decision == Decision::Colliding, "{name}: {best:?}");
        assert!(best[1].orientation == 1 && best[1].value >= 0.0, "{name}: {best:?}");

        let mut gradient = [Gradient::NAN];
        field.gradients(&[far], &mut gradient).unwrap();
        let mut decision = [Decision::Colliding];
        field.classify(&[far], &mut decision).unwrap();
        if ["verified", "exact"].contains(name) {
            assert_eq!(decision, [Decision::Free], "{name}");
        } else {
            assert_eq!(decision, [Decision::Undecided], "{name}");
            // As at the nearest point inside, and flat across the face.
            assert!((values(field.as_ref(), &[far])[0] - values(field.as_ref(), &[face])[0]).abs() < 1e-3);
            assert_eq!(gradient[0].position.y, 0.0, "{name}");
        }

        let wrong = field.values(&bad, &mut [0.0]).unwrap_err();
        assert!(wrong.to_string().contains("4 queries"), "{wrong}");
        assert!(field.values(&[], &mut []).is_ok() && field.classify(&[], &mut []).is_ok());
        assert!(field.best(&[good.position], &[], &mut best[..1]).is_err(), "{name}");
    }
}

#[test]
fn the_best_orientation_is_that_of_asking_each() {
    let at = |z: f64| DVec3::new(0.0, 0.0, z);
    for sharp in [SharpPoints::Tip, SharpPoints::Points(vec![at(0.0), at(3.0)])] {
        let tool = Tool { sharp_points: sharp, ..Tool::paper() };
        let scene = scene(&tool, 0.0);
        let points: Vec<DVec3> = poses(&scene, 300, 7).iter().map(|p| p.position).collect();
        let rotations: Vec<DQuat> = poses(&scene, 40, 8).iter().map(|p| p.rotation).collect();
        let mut fields: Vec<(&str, Box<dyn PoseField>)> = Vec::new();
        for (name, field) in all(&scene) {
            fields.push((name, Box::new(field)));
        }
        fields.push(("exact", Box::new(ExactField::new(&scene, &tool).unwrap())));
        for (name, field) in fields {
            let mut best = vec![Best::NONE; points.len()];
            field.best(&points, &rotations, &mut best).unwrap();
            for (&point, best) in points.iter().zip(&best).take(if name == "exact" { 30 } else { 300 }) {
                let cmf = |rotation: DQuat| {
                    let shifted = tool
                        .sharp_point_positions(scene.record.grid.pitch)
                        .iter()
                        .map(|&k| Pose::new(point - rotation * k, rotation))
                        .collect::<Vec<_>>();
                    values(field.as_ref(), &shifted).into_iter().fold(f32::INFINITY, f32::min)
                };
                let least = rotations.iter().map(|&r| cmf(r)).fold(f32::INFINITY, f32::min);
                assert!((best.value - least).abs() < ROUNDING, "{name}: {best:?} against {least}");
                let there = cmf(rotations[best.orientation as usize]);
                assert!((there - least).abs() < ROUNDING, "{name}: {best:?}, there {there}");
            }
        }
    }
}

#[test]
fn tools_that_turn_have_values_and_gradients_too() {
    // A tool without symmetry.
    let side = Mesh::cuboid(DVec3::new(-6.0, -5.0, 0.0), DVec3::new(14.0, 7.0, 50.0));
    let scene = scene(&Tool { shape: ToolShape::Mesh(side), ..Tool::paper() }, 0.0);
    for (name, field) in [("harmonic", harmonic(&scene)), ("factored", factored(&scene))] {
        let mut asked = poses(&scene, 60, 13);
        for (index, pose) in asked.iter_mut().enumerate() {
            // Any roll, also with the axis along the grid's.
            let axis =
                if index < 6 { DQuat::from_rotation_x(index as f64 * FRAC_PI_2) } else { pose.rotation };
            pose.rotation = axis * DQuat::from_rotation_z(index as f64);
        }
        inside_cells(&scene, &mut asked);
        let mut found = vec![Gradient::NAN; asked.len()];
        field.gradients(&asked, &mut found).unwrap();
        let value = |pose: &Pose| unclipped(&field, *pose);
        let (mut steepest, mut rolled): (f32, f32) = (0.0, 0.0);
        for (pose, found) in asked.iter().zip(&found) {
            assert!((value(pose) - found.value).abs() < 2e-6, "{name}");
            let axis = pose.axis().unwrap().as_vec3();
            // A move and a turn at once.
            let (shift, turn) = (DVec3::new(0.1, -0.05, 0.08), DVec3::new(0.01, 0.015, -0.005));
            let moved = |side: f64| Pose {
                position: pose.position + shift * side,
                rotation: DQuat::from_scaled_axis(turn * side) * pose.rotation,
            };
            let expected = 0.5 * (value(&moved(1.0)) - value(&moved(-1.0)));
            let slope = found.position.dot(shift.as_vec3()) + found.rotation.dot(turn.as_vec3());
            steepest = steepest.max(expected.abs());
            rolled = rolled.max(found.rotation.dot(axis).abs());
            // Rounding of the two values, and third derivatives.
            assert!(
                (slope - expected).abs() < 3e-6 + 0.01 * expected.abs(),
                "{name}: {slope} against {expected}"
            );
            let direction = found.rotation.cross(axis);
            assert!((found.direction - direction).length() < 1e-6 * (1.0 + direction.length()), "{name}");
        }
        assert!(steepest > 1e-3 && rolled > 1e-2, "{name}: {steepest}, {rolled}");
        let nowhere = Pose::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0));
        field.gradients(&[nowhere], &mut found[..1]).unwrap();
        assert!(found[0].value.is_nan() && found[0].rotation.is_nan(), "{name}");
    }
}
