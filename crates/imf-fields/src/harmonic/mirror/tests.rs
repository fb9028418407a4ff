//! Fields of obstacles that are their own mirror images, against fits and products of the whole grid.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::*;
use crate::harmonic::coefficients::StoragePrecision;
use crate::harmonic::evaluate::{DIRECTIONS_AT_ONCE, MANY, lower_to_whole, whole_sections};
use crate::harmonic::tests::{made, values};
use crate::harmonic::{FitSettings, minimum_of, minimum_over, sections_of};
use imf_core::control::Control;
use imf_core::field::FieldError;
use imf_core::obstacle::Obstacle;
use imf_core::orientation::OrientationSet;
use imf_core::section::{Imf, ToolPoints};
use imf_core::tool::{ElementKind, Segment, Tool};

const DIMS: [usize; 3] = [15, 12, 14];

/// Sections enough that coefficients do not depend on the draw.
fn four_sections() -> FitSettings {
    FitSettings { sections_per_function: 4.0, ..FitSettings::default() }
}

/// A cutter and a holder of a few voxels.
fn small_tool() -> Tool {
    let (cutter, holder) = (Segment::cylinder(0.0, 5.0, 1.2), Segment::cylinder(5.0, 9.0, 2.7));
    Tool::revolved("small", [(ElementKind::Cutter, vec![cutter]), (ElementKind::Holder(0), vec![holder])])
}

/// A bent bar and a pin, or a quarter of them and its images across x and z; `beyond` empty planes lie along x and z behind.
fn obstacle(beyond: usize) -> Occupancy {
    let dims = [DIMS[0] + beyond, DIMS[1], DIMS[2] + beyond];
    let grid =
        Grid { dims, ..Grid::with_dims(DVec3::ZERO, DVec3::from(DIMS.map(|n| n as f64)), DIMS, 0).unwrap() };
    let mut obstacle = Occupancy::empty(grid);
    for index in 0..grid.len() {
        let [x, y, z] = grid.voxel(index);
        if x < DIMS[0] && z < DIMS[2] {
            let (x, z) = (x.min(DIMS[0] - 1 - x), z.min(DIMS[2] - 1 - z));
            let is_solid = (2..4).contains(&x) && y > 1 && (3..6).contains(&z) || y == 3 && x > 2 && z > 2;
            obstacle.solid[index] = u8::from(is_solid);
        }
    }
    obstacle
}

fn plan_of(obstacle: impl Into<Obstacle>) -> SectionPlan {
    SectionPlan::new(obstacle, small_tool(), ToolPoints::SharpPoints).unwrap()
}

fn plan(beyond: usize) -> SectionPlan {
    plan_of(obstacle(beyond))
}

fn across(plan: &SectionPlan) -> [bool; 3] {
    let planes = Planes::of_plan(plan, Domain::Directions, Quantity::Overlap);
    [0, 1, 2].map(|axis| planes.is_across(axis))
}

#[test]
fn planes_are_those_across_which_every_voxel_has_its_image() {
    assert_eq!(across(&plan(0)), [true, false, true]);
    assert_eq!(across(&plan(1)), [false; 3]);
    let mut dented = obstacle(0);
    let place = dented.grid.index([2, 5, 4]);
    dented.solid[place] = 0;
    assert_eq!(across(&plan_of(&dented)), [false; 3]);
    // With the voxel's image across x, and with that across z.
    for (image, expected) in [([12, 5, 4], [true, false, false]), ([2, 5, 9], [false, false, true])] {
        let mut dented = dented.clone();
        let place = dented.grid.index(image);
        dented.solid[place] = 0;
        assert_eq!(across(&plan_of(&dented)), expected);
    }
    assert!(Planes::of_plan(&plan(0), Domain::Rotations, Quantity::Overlap).is_empty());
    assert!(Planes::of_plan(&plan(0), Domain::Directions, Quantity::Depth).is_empty());
}

#[test]
fn a_layer_that_the_cutter_may_enter_is_mirrored_as_well_or_nothing_is() {
    let solid = obstacle(0);
    assert!(small_tool().without_cutter().is_some());
    let mut voxels = Occupancy::empty(solid.grid);
    for (layer, expected) in [([7, 1, 6], [true, false, false]), ([7, 1, 7], [true, false, true])] {
        let place = voxels.grid.index(layer);
        voxels.solid[place] = 1;
        let obstacle =
            Obstacle { forbidden: Arc::new(solid.clone()), cuttable: Some(Arc::new(voxels.clone())) };
        assert_eq!(across(&plan_of(obstacle)), expected);
    }
}

#[test]
fn memory_is_asked_for_one_side_and_then_for_the_whole_field_beside_it() {
    let settings = FitSettings { degree: 6, components: 49, ..four_sections() };
    let (plan, voxels) = (plan(0), DIMS.iter().product::<usize>() as u64);
    let (peak, field) = settings.memory_with(&plan, Domain::Directions);
    // Two bytes for each of 49 functions; eight of fifteen planes, half of the lines.
    assert_eq!(field, voxels * 98);
    assert!(peak >= field + field * 4 / 15 && peak > 2 * 196 * voxels * 4 / 15);
}

#[test]
fn both_sides_hold_what_one_side_of_a_fit_of_the_whole_grid_does() {
    let settings = FitSettings { degree: 6, components: usize::MAX, ..FitSettings::default() };
    // One pass rounds sections to multiples of 1/65535; directions and their images to 1e-16. Halves have 11 bits.
    for (one_pass, precision, tolerance) in [
        (true, StoragePrecision::F32, 5e-5),
        (false, StoragePrecision::F32, 5e-5),
        (true, StoragePrecision::F16, 1e-3),
    ] {
        let settings = FitSettings { one_pass, precision, ..settings };
        let (mirrored, whole) = (made(&plan(0), &settings), made(&plan(1), &settings));
        let set = OrientationSet::parse("random:6:3").unwrap().orientations;
        for orientation in &set {
            let found = values(&mirrored, &[*orientation]);
            for [flip_x, flip_z] in [[false, false], [true, false], [false, true], [true, true]] {
                let sign = |flip| if flip { -1.0 } else { 1.0 };
                let image = orientation.direction() * DVec3::new(sign(flip_x), 1.0, sign(flip_z));
                let image = Orientation::from_direction(image).unwrap();
                let expected = values(&whole, &[image]);
                // What lies on the plane across x is fitted, not mirrored.
                for x in 0..DIMS[0] / 2 {
                    for (y, z) in (0..DIMS[1]).flat_map(|y| (0..DIMS[2] / 2).map(move |z| (y, z))) {
                        let of = |flip: bool, v: usize, n: usize| if flip { n - 1 - v } else { v };
                        let voxel = [of(flip_x, x, DIMS[0]), y, of(flip_z, z, DIMS[2])];
                        let found = found[mirrored.grid.index(voxel)];
                        let expected = expected[whole.grid.index([x, y, z])];
                        assert!((found - expected).abs() < tolerance, "{voxel:?}: {found} {expected}");
                    }
                }
            }
        }
    }
}

/// Coefficients of all functions at every voxel.
fn functions(field: &HarmonicField) -> Vec<f32> {
    let (count, components) = (field.mean.len(), field.components.len() / field.mean.len());
    let Coefficients::F32(coefficients) = &field.coefficients else { panic!("made in f32") };
    let rows = coefficients.chunks_exact(components);
    let of = |z: &[f32], k: usize| -> f32 {
        field.mean[k] + z.iter().zip(&field.components[k * components..]).map(|(z, u)| z * u).sum::<f32>()
    };
    rows.flat_map(|z| (0..count).map(move |k| of(z, k))).collect()
}

#[test]
fn fewer_axes_leave_out_over_both_sides_what_one_side_told() {
    let plan = plan(0);
    for one_pass in [true, false] {
        let settings =
            FitSettings { degree: 6, one_pass, precision: StoragePrecision::F32, ..four_sections() };
        let all = functions(&made(&plan, &FitSettings { components: 49, ..settings }));
        for components in [5, 20] {
            let field = made(&plan, &FitSettings { components, ..settings });
            let few = functions(&field);
            let sum: f64 = all.iter().zip(&few).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            let ratio = sum / plan.grid().len() as f64 / field.report.dropped;
            // The plane across x is an eighth of one side, a fifteenth of both.
            assert!((0.9..1.1).contains(&ratio), "{components}: {ratio}");
        }
    }
}

#[test]
fn planes_of_a_field_are_those_across_which_every_coefficient_has_its_image() {
    for precision in [StoragePrecision::F32, StoragePrecision::F16] {
        let settings = FitSettings { degree: 6, components: 20, precision, ..four_sections() };
        assert_eq!(Mirrors::of(&made(&plan(1), &settings)), None);
        let field = made(&plan(0), &settings);
        // One coefficient of one voxel, off the plane across x or on it.
        for (x, expected) in [(3, None), (7, Some(0b001))] {
            let mut other = field.clone();
            let place = field.grid.index([x, 4, 5]) * 20 + 3;
            match &mut other.coefficients {
                Coefficients::F32(values) => values[place] += 1e-3,
                Coefficients::F16(values) => values[place] = half::f16::from_f32(0.125),
            }
            assert_eq!(Mirrors::of(&other).map(|mirrors| mirrors.planes.across), expected, "{x}");
        }
        // An axis, or the mean, of even and odd functions.
        let (mut turned, mut shifted) = (field.clone(), field);
        turned.components.iter_mut().step_by(20).for_each(|value| *value = 0.1);
        shifted.mean.fill(0.1);
        assert_eq!((Mirrors::of(&turned), Mirrors::of(&shifted)), (None, None));
    }
}

/// Mirrored across x, where a plane goes through voxels, and z, where one goes between.
fn field(components: usize, precision: StoragePrecision) -> HarmonicField {
    made(&plan(0), &FitSettings { degree: 6, components, precision, ..four_sections() })
}

/// One side's sums and every voxel's own.
fn assert_agree(field: &HarmonicField, set: &[Orientation]) {
    let weights = field.direction_weights(set);
    let [mut found, mut expected] = [0, 1].map(|_| vec![f32::NAN; field.grid.len() * set.len()]);
    sections_of(field, &weights, &mut found);
    whole_sections(field, &weights, &mut expected);
    let apart = found.iter().zip(&expected).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
    // Sums of up to 49 products in another order.
    assert!(apart < 2e-6, "{apart}");
    let (least, mut whole) = (minimum_of(field, &weights), Imf::new(field.grid.len()));
    assert!(lower_to_whole(field, &weights, 0, &mut whole, Control::quiet()));
    whole.clamp(field.quantity, field.grid.pitch);
    for voxel in 0..field.grid.len() {
        let value = least.value[voxel];
        assert!((value - whole.value[voxel]).abs() < 2e-6, "voxel {voxel}");
        assert_eq!(value, found[least.best[voxel] as usize * field.grid.len() + voxel]);
    }
}

#[test]
fn what_one_side_tells_of_all_is_what_every_voxel_tells_of_itself() {
    let set = OrientationSet::parse("random:600:3").unwrap().orientations;
    for (components, precision) in
        [(49, StoragePrecision::F32), (20, StoragePrecision::F32), (20, StoragePrecision::F16)]
    {
        let field = field(components, precision);
        assert_eq!(Mirrors::of(&field).unwrap().planes.across, 0b101);
        // Products of chunks of orientations, whole and cut.
        for count in [MANY, 600] {
            assert_agree(&field, &set[..count]);
        }
    }
}

#[test]
fn a_minimum_tells_how_far_it_is_and_stops_when_asked() {
    let field = field(49, StoragePrecision::F32);
    let set = OrientationSet::parse("random:120:3").unwrap().orientations;
    // Voxel by voxel, and on one side.
    for count in [MANY - 1, set.len()] {
        let (done, stop) = (AtomicU64::new(0), AtomicBool::new(false));
        let progress = |voxels| {
            done.fetch_add(voxels, Ordering::Relaxed);
        };
        let control = Control { progress: &progress, cancelled: &stop };
        let minimum = |some: &[Orientation]| minimum_over(&field, some, control);
        let found = minimum(&set[..count]).unwrap();
        assert_eq!(found, field.minimum(&field.direction_weights(&set[..count])));
        assert_eq!(done.swap(0, Ordering::Relaxed), (field.grid.len() * count) as u64);
        stop.store(true, Ordering::Relaxed);
        assert!(matches!(minimum(&set[..count]), Err(FieldError::Cancelled(_))));
        assert_eq!(done.load(Ordering::Relaxed), 0);
    }
}

#[test]
fn more_orientations_than_are_held_at_a_time_have_the_least_of_all() {
    let field = field(9, StoragePrecision::F32);
    let set = OrientationSet::parse("random:16500:3").unwrap().orientations;
    let least = minimum_over(&field, &set, Control::quiet()).unwrap();
    let together = field.minimum(&field.direction_weights(&set));
    let mut late = 0;
    for voxel in 0..field.grid.len() {
        // The last few are too few for one side to be worth while: other sums.
        assert!((least.value[voxel] - together.value[voxel]).abs() < 2e-6, "voxel {voxel}");
        late += usize::from(least.best[voxel] as usize >= DIRECTIONS_AT_ONCE);
    }
    assert!(late > 0, "none of the last orientations is the best anywhere");
}

#[test]
fn three_planes_leave_an_eighth() {
    // Even and odd lengths.
    let dims = [8, 7, 10];
    let grid = Grid::with_dims(DVec3::ZERO, DVec3::new(8.0, 7.0, 10.0), dims, 0).unwrap();
    let mut cross = Occupancy::empty(grid);
    for place in 0..grid.len() {
        let [x, y, z] = grid.voxel(place);
        let inside = |from: usize, at: usize, n: usize| (from..n - from).contains(&at);
        let bar = inside(1, x, 8) && inside(3, y, 7) && inside(3, z, 10);
        cross.solid[place] = u8::from(bar || inside(3, x, 8) && inside(2, y, 7) && inside(4, z, 10));
    }
    let plan = plan_of(&cross);
    let settings =
        FitSettings { degree: 5, components: 36, precision: StoragePrecision::F32, ..four_sections() };
    let field = made(&plan, &settings);
    let mirrors = Mirrors::of(&field).unwrap();
    assert_eq!(mirrors.planes.across, 0b111);
    assert!((0..8).all(|parity| mirrors.parities.contains(&parity)));
    assert_agree(&field, &OrientationSet::parse("random:150:3").unwrap().orientations);
}
