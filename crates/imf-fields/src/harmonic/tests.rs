//! The field against exact sections, against its definition, and against itself read back.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use super::basis::{Basis, Domain};
use super::coefficients::StoragePrecision;
use super::radial::direct_coefficients;
use super::{FitSettings, HarmonicField, PointScratch, fit, section_count};
use crate::field::Field;
use crate::field::scenes::harmonic_file;
use crate::file::FieldFile;
use crate::metrics::{Errors, Validation};
use imf_core::control::Control;
use imf_core::mesh::Mesh;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{Imf, Quantity, SectionPlan, ToolPoints, sections};
use imf_core::tool::Tool;

fn scene() -> Scene {
    let mesh = ReferencePart::Teapot.mesh();
    SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &Tool::paper()).scene().unwrap()
}

fn plan() -> SectionPlan {
    let scene = scene();
    SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap()
}

/// Sections of a field, `[orientation][voxel]`.
pub(super) fn values(field: &HarmonicField, set: &[Orientation]) -> Vec<f32> {
    let mut values = vec![f32::NAN; field.grid.len() * set.len()];
    field.sections(&field.direction_weights(set), &mut values);
    values
}

fn settings() -> FitSettings {
    FitSettings {
        degree: 8,
        sections_per_function: 4.0,
        components: usize::MAX,
        precision: StoragePrecision::F32,
        held_out: 24,
        ..FitSettings::default()
    }
}

pub(super) fn made(plan: &SectionPlan, settings: &FitSettings) -> HarmonicField {
    fit(plan, Domain::Directions, settings, Control::quiet()).unwrap()
}

fn mean_squared(plan: &SectionPlan, field: &HarmonicField, set: &[Orientation]) -> f64 {
    let exact = sections(plan, set, Control::quiet()).unwrap();
    let mut errors = Errors::default();
    errors.add(&exact.concat(), &values(field, set), 1e-3);
    errors.report(1e-3).mse
}

#[test]
fn unseen_directions_are_near_the_exact_sections() {
    let plan = plan();
    let field = made(&plan, &settings());
    let unseen = OrientationSet::parse("random:40:5").unwrap().orientations;
    let mse = mean_squared(&plan, &field, &unseen);
    // The best constant errs by 3e-2; 81 functions of a quarter-resolution teapot by some 2e-4.
    assert!(mse < 4e-4, "{mse}");
    let coarse = made(&plan, &FitSettings { degree: 4, ..settings() });
    assert!(mean_squared(&plan, &coarse, &unseen) > 2.0 * mse);
}

#[test]
fn the_stated_error_is_what_a_strangers_draw_finds_within_three_standard_errors() {
    let plan = plan();
    let stranger = OrientationSet::parse("random:200:977").unwrap().orientations;
    let exact = sections(&plan, &stranger, Control::quiet()).unwrap();
    let quarter = FitSettings { held_out: FitSettings::default().held_out, ..settings() };
    for settings in [
        quarter,
        FitSettings { one_pass: false, ..quarter },
        FitSettings { components: 12, precision: StoragePrecision::F16, ..quarter },
    ] {
        let field = made(&plan, &settings);
        let own: Vec<(f64, f64)> = exact
            .iter()
            .zip(values(&field, &stranger).chunks_exact(plan.grid().len()))
            .map(|(exact, found)| {
                let mut errors = Errors::default();
                errors.add(exact, found, 0.0);
                let report = errors.report(0.0);
                (report.mse, report.mpe)
            })
            .collect();
        let (reported, found) = (field.report.validation, Validation::of(&own));
        let sure = reported.standard_error.hypot(found.standard_error);
        assert!((reported.mse - found.mse).abs() < 3.0 * sure, "{reported:?} {found:?}");
        // What it is called: known to a tenth or two, and the largest error no fraction of what is met.
        assert!(
            reported.standard_error < 0.2 * reported.mse && reported.mpe > 0.6 * found.mpe,
            "{reported:?} {found:?}"
        );
    }
}

#[test]
fn rounding_does_not_take_the_highest_degree_away() {
    let plan = plan();
    let most = FitSettings { degree: 40, sections_per_function: 4.0 / 3.0, ..settings() };
    let report = made(&plan, &most).report;
    // Degree 37 has 8e-6 of this scene.
    assert!(report.validation.mse < 1e-5, "{report:?}");
}

#[test]
fn one_pass_and_two_make_the_same_field() {
    let plan = plan();
    let some = FitSettings { components: 30, ..settings() };
    let (one, two) = (made(&plan, &some), made(&plan, &FitSettings { one_pass: false, ..some }));
    let set = OrientationSet::parse("random:20:4").unwrap().orientations;
    let [a, b] = [&one, &two].map(|field| values(field, &set));
    // The same sums of products in another order; the axes follow from covariances that differ as little.
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4));
    let close = |a: f64, b: f64| (a - b).abs() < 1e-3 * b;
    assert!(close(one.report.validation.mse, two.report.validation.mse));
    assert!(close(one.report.dropped, two.report.dropped));
    let counts =
        [true, false].map(|one_pass| section_count(Domain::Directions, &FitSettings { one_pass, ..some }));
    assert_eq!(counts[1] - counts[0], one.report.sections);
    let bytes = [true, false]
        .map(|one_pass| FitSettings { one_pass, ..some }.memory(Domain::Directions, plan.grid().len()).0);
    assert!(bytes[0] > bytes[1]);
}

#[test]
fn class_by_class_all_functions_get_what_they_get_together() {
    let plan = plan();
    let set = OrientationSet::parse("random:20:4").unwrap().orientations;
    for sections_per_function in [1.0, 1.33, 3.0] {
        let some = FitSettings { sections_per_function, ..settings() };
        let [one, two] = [true, false].map(|one_pass| {
            let (settings, counted) = (FitSettings { one_pass, ..some }, AtomicUsize::new(0));
            let progress = |more: u64| {
                counted.fetch_add(more as usize, Ordering::Relaxed);
            };
            let control = Control { progress: &progress, ..Control::quiet() };
            let made = fit(&plan, Domain::Directions, &settings, control).unwrap();
            // No axes to decide on: every section is counted once.
            let expected = section_count(Domain::Directions, &settings);
            assert_eq!(
                (counted.into_inner(), expected),
                (expected, section_count(Domain::Directions, &some))
            );
            made
        });
        let [a, b] = [&one, &two].map(|field| values(field, &set));
        // Sections rounded to multiples of 1/65535; few sections a function let some functions take up more of that.
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4));
        assert!((one.report.validation.mse / two.report.validation.mse - 1.0).abs() < 1e-3);
        assert_eq!((one.report.dropped, one.report.sections), (0.0, two.report.sections));
        // A network trained on these coefficients goes on with either's.
        assert_eq!((&one.components, &one.mean), (&two.components, &two.mean));
    }
}

#[test]
fn as_many_sections_as_functions_make_a_field_that_is_no_worse_than_a_lower_degrees() {
    let plan = plan();
    let unseen = OrientationSet::parse("random:40:5").unwrap().orientations;
    let error = |degree, sections_per_function| {
        let field = made(&plan, &FitSettings { degree, sections_per_function, ..settings() });
        mean_squared(&plan, &field, &unseen)
    };
    // 84 sections: all of degree 8's functions, or 1.71 times those of degree 6.
    let (full, lower) = (error(8, 1.0), error(6, 84.0 / 49.0));
    assert!(full < lower, "{full} against {lower}");
    // With many sections a function, what is known beforehand no longer matters: the least sum of squares.
    assert!(error(8, 4.0) < full);
}

#[test]
fn fewer_axes_and_half_precision_cost_what_is_stated() {
    let plan = plan();
    let whole = made(&plan, &settings());
    let few = made(&plan, &FitSettings { components: 30, sample: usize::MAX, ..settings() });
    let halves = made(&plan, &FitSettings { precision: StoragePrecision::F16, ..settings() });
    let set = Basis::new(Domain::Directions, 8).even_set(2000).unwrap().orientations;
    let mean_square = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).map(|(&a, &b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64
    };
    let exact = values(&whole, &set);
    let dropped = mean_square(&exact, &values(&few, &set));
    // Clipping to [0, 1] hides a part of it.
    assert!(
        dropped < 1.05 * few.report.dropped && dropped > 0.3 * few.report.dropped,
        "{dropped} {:?}",
        few.report
    );
    // Eleven bits of coefficients of order one tenth.
    assert!(mean_square(&exact, &values(&halves, &set)) < 1e-7);
}

#[test]
fn coefficients_agree_with_the_definition() {
    let scene = scene();
    let tool = &scene.record.tool;
    let plan = SectionPlan::new(&scene.obstacle, tool, ToolPoints::SharpPoints).unwrap();
    let field = made(&plan, &FitSettings { sections_per_function: 16.0, ..settings() });
    let grid = plan.grid();
    let mut scratch = Vec::new();
    for voxel in [[7, 9, 15], [2, 3, 28], [12, 10, 5]] {
        let position = grid.centre(voxel);
        let defined = direct_coefficients(&scene.obstacle, tool, position, 8);
        let index = grid.index(voxel) * field.component_count();
        let found = field.coefficients.read(index, index + field.component_count(), &mut scratch);
        let scale = (4.0 * std::f64::consts::PI).sqrt();
        // The definition has the analytic tool, divided by its volume; sections have voxels, divided by their count:
        // with a tool of 2,000 voxels the two differ by a few hundredths of the value.
        let norm = defined.iter().map(|c| c * c).sum::<f64>().sqrt() / scale;
        for (place, (components, defined)) in
            field.components.chunks_exact(field.component_count()).zip(&defined).enumerate()
        {
            let along: f32 = components.iter().zip(found).map(|(u, z)| u * z).sum();
            let found = along + field.mean[place];
            let difference = (f64::from(found) - defined / scale).abs();
            assert!(
                difference < 0.04 * norm,
                "{voxel:?}, function {place}: {found} against {}",
                defined / scale
            );
        }
    }
}

#[test]
fn the_minimum_is_the_least_section_and_ties_go_to_the_first() {
    let plan = plan();
    let field = made(&plan, &FitSettings { components: 30, ..settings() });
    // More than one chunk, and a direction twice.
    let mut set = OrientationSet::parse("fibonacci:700").unwrap().orientations;
    set.push(set[3]);
    let voxels = plan.grid().len();
    let values = values(&field, &set);
    let mut expected = Imf::new(voxels);
    for (index, section) in values.chunks_exact(voxels).enumerate() {
        expected.lower_to(index, section);
    }
    let found = field.minimum(&field.direction_weights(&set));
    for (voxel, (&value, &least)) in found.value.iter().zip(&expected.value).enumerate() {
        // Products of other block sizes add in another order.
        assert!((value - least).abs() < 1e-6, "voxel {voxel}: {value} against {least}");
        let of_best = values[found.best[voxel] as usize * voxels + voxel];
        assert!((of_best - least).abs() < 1e-6 && found.best[voxel] != 700);
    }
}

#[test]
fn single_poses_equal_sections_and_gradients_central_differences() {
    let plan = plan();
    let field = made(&plan, &FitSettings { components: 30, ..settings() });
    let grid = *plan.grid();
    let set = OrientationSet::parse("random:3:9").unwrap().orientations;
    let values = values(&field, &set);
    let mut scratch = PointScratch::default();
    for (index, orientation) in set.iter().enumerate() {
        for voxel in [[0, 0, 0], [14, 18, 30], [7, 3, 20]] {
            let direction = orientation.direction();
            let found = field.overlap_with_gradient(grid.centre(voxel), direction, &mut scratch).unwrap();
            let found = found.value.clamp(0.0, 1.0);
            let expected = values[index * grid.len() + grid.index(voxel)];
            assert!((found - expected).abs() < 1e-5, "{voxel:?}: {found} against {expected}");
        }
    }
    for outside in [grid.origin, DVec3::splat(f64::NAN)] {
        assert_eq!(field.overlap_with_gradient(outside, set[0].direction(), &mut scratch), None);
    }
    let step = 1e-3;
    for (fraction, direction) in [
        (DVec3::new(0.31, 0.52, 0.44), DVec3::new(0.4, 0.5, -0.7)),
        (DVec3::new(0.61, 0.42, 0.74), DVec3::Z),
        (DVec3::new(0.47, 0.22, 0.58), -DVec3::Z),
    ] {
        let position = grid.origin + grid.size() * fraction;
        let direction = direction.normalize();
        let found = field.overlap_with_gradient(position, direction, &mut scratch).unwrap();
        let mut at = |position, direction| {
            f64::from(field.overlap_with_gradient(position, direction, &mut scratch).unwrap().value)
        };
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let move_by = axis * step * grid.pitch;
            let expected = (at(position + move_by, direction) - at(position - move_by, direction))
                / (2.0 * move_by.length());
            // Values in f32: 1e-7 over a thousandth of a voxel.
            assert!(
                (found.position.dot(axis) - expected).abs() < 3e-4 / grid.pitch,
                "{found:?} {axis} {expected}"
            );
        }
        let (u, v) = direction.any_orthonormal_pair();
        for tangent in [u, v] {
            let ahead = at(position, direction + tangent * step);
            let behind = at(position, direction - tangent * step);
            let expected = (ahead - behind) / (2.0 * step);
            assert!((found.direction.dot(tangent) - expected).abs() < 5e-4, "{found:?} {tangent} {expected}");
        }
    }
}

#[test]
fn tools_that_are_not_of_revolution_have_fields_over_rotations() {
    let mut scene = scene();
    // A cutter with a box beside its axis.
    let side = Mesh::cuboid(DVec3::new(0.0, -6.0, 0.0), DVec3::new(24.0, 6.0, 50.0));
    scene.record.tool = Tool { shape: imf_core::tool::ToolShape::Mesh(side), ..Tool::paper() };
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let settings = FitSettings { degree: 4, components: 60, sections_per_function: 3.0, ..settings() };
    let field = fit(&plan, Domain::Rotations, &settings, Control::quiet()).unwrap();
    assert_eq!(field.report.functions, 165);
    let unseen = field.basis.random_set(20, 3).unwrap().orientations;
    let over_rotations = mean_squared(&plan, &field, &unseen);
    // The same directions with another roll.
    let rolled: Vec<_> = unseen.iter().map(|o| Orientation { roll: o.roll + 180.0, ..*o }).collect();
    let mut errors = Errors::default();
    errors.add(&sections(&plan, &unseen, Control::quiet()).unwrap().concat(), &values(&field, &rolled), 1e-3);
    let without_roll = errors.report(1e-3).mse;
    assert!(over_rotations < 0.5 * without_roll, "{over_rotations} against {without_roll}");
    let refused = fit(&plan, Domain::Directions, &settings, Control::quiet()).unwrap_err().to_string();
    assert!(refused.contains("'paper' is not round") && refused.contains("rotations"), "{refused}");
}

/// What is written could not be read, and fractions became lengths.
#[test]
fn a_harmonic_field_of_another_scene_or_quantity_is_refused() {
    let scene = crate::field::scenes::scene(&Tool::paper(), 0.0);
    let whole = harmonic_file(&scene, 4);
    let (mut moved, mut depth, mut halves) = (whole.clone(), whole.clone(), whole.clone());
    moved.scene.record.grid.origin.x += 1.0;
    depth.settings.quantity = Quantity::Depth;
    halves.settings.precision = StoragePrecision::F16;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    for (file, what) in [(moved, "grid is not the scene's"), (depth, "quantity"), (halves, "precision")] {
        let refused = file.write(&path).unwrap_err().to_string();
        assert!(refused.contains(what) && !path.exists(), "{refused}");
        let loaded = Field::new(FieldFile::Harmonic(Arc::new(file)));
        assert_eq!(loaded.is_err(), what.contains("grid"));
    }
    assert!(Field::new(FieldFile::Harmonic(Arc::new(whole))).is_ok());
}
