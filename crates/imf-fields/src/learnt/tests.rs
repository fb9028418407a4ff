use std::f32::consts::FRAC_PI_2;

use glam::{DVec3, Quat, Vec3};

use crate::calibration::{Calibration, Goals, Judgement, Rate};
use crate::factored::file::FactoredFile;
use crate::factored::{Axis, FactoredField, FactoredShape, PointScratch, Symmetry};
use crate::learnt::scenes::{
    factored, factored_file, harmonic, harmonic_file, poses, scene, siren, siren_model,
};
use crate::learnt::{GuardedField, LearntField, NeuralField};
use crate::siren::evaluator::CpuEvaluator;
use crate::stored::StoredField;
use imf_core::field::{self, ExactField, Field};
use imf_core::planner::*;
use imf_core::scene::Scene;
use imf_core::tool::{SharpPoints, Tool};

fn all(scene: &Scene) -> Vec<(&'static str, NeuralField)> {
    vec![("siren", siren(scene)), ("harmonic", harmonic(scene)), ("factored", factored(scene))]
}

fn values(field: &dyn PoseField, poses: &[Pose]) -> Vec<f32> {
    let mut values = vec![-7.0; poses.len()];
    field.query(poses, &mut values).unwrap();
    values
}

#[test]
fn fields_are_shared_by_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<NeuralField>();
    shared::<GuardedField>();
    shared::<ExactField<'_>>();
    shared::<Box<dyn PoseField>>();
}

/// Single precision in another order of addition, and directions rounded to it: relative to waves of degree 8.
const ROUNDING: f32 = 1e-4;

#[test]
fn values_are_those_of_each_familys_own_interface() {
    let scene = scene(&Tool::paper(), 0.0);
    // More than a block, and no multiple of one.
    let asked = poses(&scene, 700, 1);
    let exact: Vec<field::Pose> = asked
        .iter()
        .map(|p| field::Pose { position: p.position.as_dvec3(), orientation: p.orientation() })
        .collect();
    let near = |name: &str, found: &[f32], expected: &[f32]| {
        for (place, (f, e)) in found.iter().zip(expected).enumerate() {
            assert!((f - e).abs() < ROUNDING, "{name} {place}: {f} against {e}");
        }
    };
    let mut expected = vec![0.0; asked.len()];

    let file = harmonic_file(&scene, 8);
    crate::harmonic::HarmonicAnswers(&file.field).query(&exact, &mut expected).unwrap();
    near("harmonic", &values(&harmonic(&scene), &asked), &expected);
    assert!(expected.iter().any(|&v| v > 0.05) && expected.contains(&0.0));

    let file = factored_file(&scene);
    crate::factored::FactoredAnswers(file.field.evaluator()).query(&exact, &mut expected).unwrap();
    near("factored", &values(&factored(&scene), &asked), &expected);

    // With an order of axes that is not the world's.
    let through = scene.record.grid.origin + 0.45 * scene.record.grid.size();
    let symmetry =
        Symmetry { mirrors: [None, Some(through.y), None], axis: Some(Axis { along: 0, through }) };
    let shape = FactoredShape { symmetry, ..file.field.shape };
    let parameters = shape.initial_parameters(5);
    let file = FactoredFile { field: FactoredField { shape, parameters, ..file.field }, ..file };
    let (evaluator, mut scratch) = (file.field.evaluator(), PointScratch::default());
    let mut at =
        |pose: &field::Pose| evaluator.overlap(pose.position, &pose.orientation, &mut scratch).unwrap();
    let one_by_one: Vec<f32> = exact.iter().map(&mut at).collect();
    crate::factored::FactoredAnswers(file.field.evaluator()).query(&exact, &mut expected).unwrap();
    near("with symmetry", &expected, &one_by_one);
    let stored = StoredField::Factored(Box::new(file.clone()));
    near("with symmetry", &values(&NeuralField::new(stored).unwrap(), &asked), &one_by_one);

    let model = siren_model(&scene);
    let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
    LearntField::new(scene.record.grid, &mut engine).query(&exact, &mut expected).unwrap();
    near("siren", &values(&siren(&scene), &asked), &expected);

    let mut field = ExactField::of_tool(&scene.obstacle, &scene.record.tool);
    Field::query(&mut field, &exact, &mut expected).unwrap();
    assert_eq!(values(&field, &asked), expected);
}

/// Poses whose neighbours within a fifth of a voxel lie in the same cell.
fn inside_cells(scene: &Scene, poses: &mut [Pose]) {
    let grid = scene.record.grid;
    for (index, pose) in poses.iter_mut().enumerate() {
        let fraction = 0.25 + 0.5 * ((index * 37 % 101) as f64 / 101.0);
        let cell = grid.continuous(pose.position.as_dvec3()).floor() + fraction;
        let last = DVec3::from_array(grid.dims.map(|n| (n - 2) as f64));
        let cell = cell.min(last + fraction);
        pose.position = (grid.origin + (cell + 0.5) * grid.pitch).as_vec3();
    }
}

#[test]
fn gradients_are_central_differences_also_across_the_seam_and_at_the_poles() {
    let scene = scene(&Tool::paper(), 0.0);
    let pitch = scene.record.grid.pitch as f32;
    for (name, field) in all(&scene) {
        let mut asked = poses(&scene, 200, 2);
        inside_cells(&scene, &mut asked);
        if name != "siren" {
            // The seam at θ = 0°, both poles, and close by.
            let special = [
                Vec3::X,
                Vec3::new(1.0, 1e-4, 0.5),
                Vec3::new(1.0, -1e-4, 0.5),
                Vec3::Z,
                Vec3::NEG_Z,
                Vec3::new(1e-4, 0.0, 1.0),
                Vec3::new(0.0, -1e-3, -1.0),
            ];
            for (index, pose) in asked.iter_mut().take(20 * special.len()).enumerate() {
                *pose = Pose::along(pose.position, special[index % special.len()]);
            }
        } else {
            // Its seam and its poles are jumps.
            asked.retain(|p| p.axis().z.abs() < 0.98 && !(p.axis().x > 0.0 && p.axis().y.abs() < 0.05));
        }
        let mut found = vec![Gradient::NAN; asked.len()];
        field.query_with_gradient(&asked, &mut found).unwrap();
        let mut failures = Vec::new();
        for (pose, found) in asked.iter().zip(&found) {
            let value = |pose: Pose| {
                let mut value = [0.0];
                field.query_unclipped(&[pose], &mut value).unwrap();
                value[0]
            };
            assert!((value(*pose) - found.value).abs() < ROUNDING, "{name} {pose:?}");
            let mut check = |what: &str, slope: f32, expected: f32, width: f32| {
                // Rounding of the two values, and what the third derivative adds over the width.
                let tolerance = 2e-6 / width + 0.02 * expected.abs() + 2e-3;
                if (slope - expected).abs() > tolerance {
                    failures.push(format!("{name} {what} {pose:?}: {slope} against {expected}"));
                }
            };
            let step = 0.1 * pitch;
            for (axis, unit) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
                let ahead = value(Pose { position: pose.position + unit * step, ..*pose });
                let behind = value(Pose { position: pose.position - unit * step, ..*pose });
                // Per voxel, so that one tolerance serves.
                check("position", found.position[axis] * pitch, (ahead - behind) / 0.2, 0.2);
            }
            let angle = 0.01;
            for unit in [Vec3::X, Vec3::Y, Vec3::Z] {
                let turned =
                    |a: f32| Pose { rotation: Quat::from_axis_angle(unit, a) * pose.rotation, ..*pose };
                let slope = (value(turned(angle)) - value(turned(-angle))) / (2.0 * angle);
                check("rotation", found.rotation.dot(unit), slope, 2.0 * angle);
            }
            // The tangent on the sphere and the rotation's tangent say the same.
            let axis = pose.axis();
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
    let middle = (scene.record.grid.origin + 0.5 * scene.record.grid.size()).as_vec3();
    let asked = [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::new(1e-7, 0.0, 1.0), Vec3::new(1.0, -1e-7, 0.0)]
        .map(|axis| Pose::along(middle, axis));
    let mut found = [Gradient::NAN; 5];
    field.query_with_gradient(&asked, &mut found).unwrap();
    for found in found {
        assert!(found.position.is_finite() && found.direction.is_finite() && found.rotation.is_finite());
    }
}

#[test]
fn what_is_no_pose_or_outside_has_the_documented_answer() {
    let scene = scene(&Tool::paper(), 0.0);
    let grid = scene.record.grid;
    let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
    let good = Pose::along((0.5 * (low + high)).as_vec3(), Vec3::X);
    let bad = [
        Pose { position: Vec3::new(0.0, f32::NAN, 0.0), ..good },
        Pose { position: Vec3::new(f32::NEG_INFINITY, 0.0, 0.0), ..good },
        Pose { rotation: Quat::NAN, ..good },
        Pose { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
    ];
    let far = Pose { position: good.position + Vec3::new(0.0, 1e30, 0.0), ..good };
    let face = Pose { position: Vec3::new(good.position.x, high.y as f32, good.position.z), ..good };
    let mut fields: Vec<(&str, Box<dyn PoseField>)> = Vec::new();
    for (name, field) in all(&scene) {
        fields.push((name, Box::new(field.with_calibration(Some(calibration(0.2, 0.3))))));
    }
    fields.push(("guarded", Box::new(GuardedField::new(harmonic(&scene)).unwrap())));
    fields.push(("exact", Box::new(ExactField::owned(scene.obstacle.clone(), Tool::paper()))));
    for (name, field) in &fields {
        let mut decisions = [Decision::Free; 4];
        field.classify(&bad, &mut decisions).unwrap();
        assert_eq!(decisions, [Decision::Blocked; 4], "{name}");
        assert!(values(field.as_ref(), &bad).iter().all(|v| v.is_nan()), "{name}");
        let mut gradients = [Gradient { value: 0.0, ..Gradient::NAN }; 4];
        field.query_with_gradient(&bad, &mut gradients).unwrap();
        assert!(gradients.iter().all(|g| g.value.is_nan() && g.direction.is_nan()), "{name}");
        let mut best = [Best { value: 0.0, ..Best::NONE }; 2];
        field.imf(&[Vec3::NAN, good.position], &[Quat::NAN, good.rotation], &mut best).unwrap();
        assert!(best[0].value.is_nan() && best[0].decision == Decision::Blocked, "{name}: {best:?}");
        assert!(best[1].orientation == 1 && best[1].value >= 0.0, "{name}: {best:?}");

        let mut gradient = [Gradient::NAN];
        field.query_with_gradient(&[far], &mut gradient).unwrap();
        let mut decision = [Decision::Blocked];
        field.classify(&[far], &mut decision).unwrap();
        if ["guarded", "exact"].contains(name) {
            assert_eq!(decision, [Decision::Free], "{name}");
        } else {
            assert_eq!(decision, [Decision::Near], "{name}");
            // As at the nearest point inside, and flat across the face.
            assert!((values(field.as_ref(), &[far])[0] - values(field.as_ref(), &[face])[0]).abs() < 1e-3);
            assert_eq!(gradient[0].position.y, 0.0, "{name}");
        }

        let wrong = field.query(&bad, &mut [0.0]).unwrap_err();
        assert!(wrong.to_string().contains("4 questions"), "{wrong}");
        assert!(field.query(&[], &mut []).is_ok() && field.classify(&[], &mut []).is_ok());
        assert!(field.imf(&[good.position], &[], &mut best[..1]).is_err(), "{name}");
    }
}

fn calibration(free: f32, blocked: f32) -> Calibration {
    let rate = Rate::new(0, 100, 0.99);
    let judged = Judgement {
        poses: 200,
        false_free: rate,
        false_blocked: rate,
        near: 1,
        found_free: 50,
        largest_error: 0.1,
    };
    let goals = Goals::default();
    let (free_up_to, blocked_from) = (Some(free), Some(blocked));
    Calibration { free_up_to, blocked_from, goals, seed: 1, uniform: judged, boundary: judged }
}

#[test]
fn decisions_follow_the_thresholds_and_are_near_without() {
    let scene = scene(&Tool::paper(), 0.0);
    let asked = poses(&scene, 600, 5);
    for (name, field) in all(&scene) {
        let mut raw = vec![0.0; asked.len()];
        field.query_unclipped(&asked, &mut raw).unwrap();
        let mut sorted = raw.clone();
        sorted.sort_by(f32::total_cmp);
        let (free, blocked) = (sorted[200], sorted[400]);
        let mut decisions = vec![Decision::Blocked; asked.len()];
        field.classify(&asked, &mut decisions).unwrap();
        assert!(decisions.iter().all(|&d| d == Decision::Near), "{name}");
        let field = field.with_calibration(Some(calibration(free, blocked)));
        field.classify(&asked, &mut decisions).unwrap();
        for (value, decision) in raw.iter().zip(&decisions) {
            let expected = match value {
                v if *v <= free => Decision::Free,
                v if *v >= blocked => Decision::Blocked,
                _ => Decision::Near,
            };
            assert_eq!(*decision, expected, "{name}: {value}");
        }
        assert!([Decision::Free, Decision::Blocked, Decision::Near].iter().all(|d| decisions.contains(d)));
    }
}

#[test]
fn the_best_orientation_is_that_of_asking_each() {
    let at = |z: f64| DVec3::new(0.0, 0.0, z);
    for sharp in [SharpPoints::Tip, SharpPoints::Points(vec![at(0.0), at(3.0)])] {
        let tool = Tool { sharp_points: sharp, ..Tool::paper() };
        let scene = scene(&tool, 0.0);
        let points: Vec<Vec3> = poses(&scene, 300, 7).iter().map(|p| p.position).collect();
        let rotations: Vec<Quat> = poses(&scene, 40, 8).iter().map(|p| p.rotation).collect();
        let mut fields: Vec<(&str, Box<dyn PoseField>)> = Vec::new();
        for (name, field) in all(&scene) {
            fields.push((name, Box::new(field)));
        }
        fields.push(("exact", Box::new(ExactField::owned(scene.obstacle.clone(), tool.clone()))));
        for (name, field) in fields {
            let mut best = vec![Best::NONE; points.len()];
            field.imf(&points, &rotations, &mut best).unwrap();
            for (&point, best) in points.iter().zip(&best).take(if name == "exact" { 30 } else { 300 }) {
                let cmf = |rotation: Quat| {
                    let shifted = tool
                        .sharp_point_positions(scene.record.grid.pitch)
                        .iter()
                        .map(|&k| Pose::new(point - rotation * k.as_vec3(), rotation))
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
fn guarded_fields_say_free_where_the_true_tool_is_free_and_nowhere_else() {
    for clearance in [0.0, 1.5] {
        let scene = scene(&Tool::paper(), clearance);
        let guarded = GuardedField::new(harmonic(&scene)).unwrap();
        let keeping = GuardedField::keeping(harmonic(&scene), scene.record.clearance).unwrap();
        let asked = poses(&scene, 4000, 11);
        let (mut decisions, mut kept) = (vec![Decision::Near; 4000], vec![Decision::Near; 4000]);
        guarded.classify(&asked, &mut decisions).unwrap();
        keeping.classify(&asked, &mut kept).unwrap();
        let mut between = 0;
        for ((pose, decision), kept) in asked.iter().zip(&decisions).zip(&kept) {
            // The definition.
            let (position, orientation) = (pose.position.as_dvec3(), pose.orientation());
            let count = |tool: &Tool| tool.count_inside(&scene.obstacle, position, &orientation);
            assert_eq!(*decision == Decision::Free, count(scene.record.bare_tool()) == 0, "{pose:?}");
            assert_eq!(*kept == Decision::Free, count(&scene.record.tool) == 0, "{pose:?}");
            between += usize::from(decision != kept);
        }
        assert_eq!(between > 0, clearance > 0.0);
        // The best of those that are free, where any is.
        let points: Vec<Vec3> = asked.iter().take(50).map(|p| p.position).collect();
        let rotations: Vec<Quat> = asked.iter().skip(100).take(60).map(|p| p.rotation).collect();
        let mut best = vec![Best::NONE; points.len()];
        guarded.imf(&points, &rotations, &mut best).unwrap();
        let model = guarded.model();
        for (&point, best) in points.iter().zip(&best) {
            let all: Vec<Pose> = rotations.iter().map(|&r| Pose::new(point, r)).collect();
            let mut decided = vec![Decision::Near; all.len()];
            guarded.classify(&all, &mut decided).unwrap();
            let free = decided.contains(&Decision::Free);
            assert_eq!(best.decision == Decision::Free, free);
            let of = values(model, &all);
            let least = of.iter().zip(&decided).filter(|(_, d)| !free || **d == Decision::Free);
            let least = least.map(|(v, _)| *v).fold(f32::INFINITY, f32::min);
            assert!((best.value - least).abs() < ROUNDING);
        }
    }
}

#[test]
fn tools_that_turn_have_values_and_gradients_too() {
    let mesh = ReferenceBox::tool();
    let scene = scene(&mesh, 0.0);
    for (name, field) in [("harmonic", harmonic(&scene)), ("factored", factored(&scene))] {
        let mut asked = poses(&scene, 60, 13);
        for (index, pose) in asked.iter_mut().enumerate() {
            // Any roll, also with the axis along the grid's.
            let axis =
                if index < 6 { Quat::from_rotation_x(index as f32 * FRAC_PI_2) } else { pose.rotation };
            pose.rotation = axis * Quat::from_rotation_z(index as f32);
        }
        inside_cells(&scene, &mut asked);
        let mut found = vec![Gradient::NAN; asked.len()];
        field.query_with_gradient(&asked, &mut found).unwrap();
        let value = |pose: &Pose| {
            let mut value = [0.0];
            field.query_unclipped(std::slice::from_ref(pose), &mut value).unwrap();
            value[0]
        };
        let (mut steepest, mut rolled): (f32, f32) = (0.0, 0.0);
        for (pose, found) in asked.iter().zip(&found) {
            assert!((value(pose) - found.value).abs() < 2e-6, "{name}");
            // A move and a turn at once.
            let (shift, turn) = (Vec3::new(0.1, -0.05, 0.08), Vec3::new(0.01, 0.015, -0.005));
            let moved = |side: f32| Pose {
                position: pose.position + shift * side,
                rotation: Quat::from_scaled_axis(turn * side) * pose.rotation,
            };
            let expected = 0.5 * (value(&moved(1.0)) - value(&moved(-1.0)));
            let slope = found.position.dot(shift) + found.rotation.dot(turn);
            steepest = steepest.max(expected.abs());
            rolled = rolled.max(found.rotation.dot(pose.axis()).abs());
            // Rounding of the two values, and third derivatives.
            assert!(
                (slope - expected).abs() < 3e-6 + 0.01 * expected.abs(),
                "{name}: {slope} against {expected}"
            );
            let direction = found.rotation.cross(pose.axis());
            assert!((found.direction - direction).length() < 1e-6 * (1.0 + direction.length()), "{name}");
        }
        assert!(steepest > 1e-3 && rolled > 1e-2, "{name}: {steepest}, {rolled}");
        let nowhere = Pose::new(Vec3::ZERO, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0));
        field.query_with_gradient(&[nowhere], &mut found[..1]).unwrap();
        assert!(found[0].value.is_nan() && found[0].rotation.is_nan(), "{name}");
    }
}

/// A tool without symmetry.
struct ReferenceBox;

impl ReferenceBox {
    fn tool() -> Tool {
        let corner = |i: usize| {
            DVec3::new(
                if i & 1 == 0 { -6.0 } else { 14.0 },
                if i & 2 == 0 { -5.0 } else { 7.0 },
                if i & 4 == 0 { 0.0 } else { 50.0 },
            )
        };
        let mesh = imf_core::mesh::Mesh {
            vertices: (0..8).map(corner).collect(),
            triangles: vec![
                [0, 2, 1],
                [1, 2, 3],
                [4, 5, 6],
                [5, 7, 6],
                [0, 1, 4],
                [1, 5, 4],
                [2, 6, 3],
                [3, 6, 7],
                [0, 4, 2],
                [2, 4, 6],
                [1, 3, 5],
                [3, 7, 5],
            ],
        };
        Tool { shape: imf_core::tool::ToolShape::Mesh(mesh), ..Tool::paper() }
    }
}
