//! Symmetry-reduced networks: frames and coefficients by their definition, fields by the reference network, slopes
//! by differences, and what is found of a part.

use glam::DMat3;

use super::*;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_fields::factored::{Axis, LocalHarmonics};
use imf_fields::harmonic::VoxelCoefficients as _;
use imf_fields::harmonic::basis::Basis;

/// Two planes; lines along each axis, alone and in a plane.
fn symmetries() -> Vec<Symmetry> {
    let through = DVec3::new(0.3, -0.2, 0.5);
    let axis = |along| Some(Axis { along, through });
    let none = Symmetry::default();
    vec![
        Symmetry { mirrors: [Some(0.3), Some(-0.2), None], ..none },
        Symmetry { axis: axis(2), ..none },
        Symmetry { mirrors: [None, Some(-0.2), None], axis: axis(0) },
        Symmetry { mirrors: [Some(0.3), None, Some(0.1)], axis: axis(1) },
    ]
}

/// Positions on all sides of planes and lines; numbers without pattern.
fn positions() -> impl Iterator<Item = DVec3> {
    (1..=24).map(|index| 3.0 * ((f64::from(index) * DVec3::new(0.618, 0.755, 0.57)).fract() - 0.5))
}

#[test]
fn frames_are_mirrors_and_turns_that_come_back() {
    for symmetry in symmetries() {
        for position in positions() {
            let place = symmetry.place(position);
            let columns = DVec3::AXES.map(|axis| place.to_local(axis));
            let frame = DMat3::from_cols(columns[0], columns[1], columns[2]);
            let handed = place.signs.x * place.signs.y * place.signs.z;
            // Rounding of a few products.
            assert!((frame.determinant() - handed).abs() < 1e-12, "{symmetry}");
            let back = DVec3::AXES.map(|axis| place.to_world(place.to_local(axis)) - axis);
            assert!(back.iter().all(|rest| rest.length() < 1e-12), "{symmetry} at {position}");
            // A mirrored position has the place of its image, and the other sign.
            for (axis, plane) in symmetry.mirrors.iter().enumerate() {
                let Some(plane) = plane else { continue };
                let mut image = position;
                image[axis] = 2.0 * plane - position[axis];
                let other = symmetry.place(image);
                assert!((other.position - place.position).length() < 1e-12);
                assert!(other.signs[axis] != place.signs[axis] || position[axis] == *plane);
            }
            // Turned about the axis by any angle, a point sees a turned direction as the other saw it.
            let Some(line) = symmetry.axis.filter(|_| symmetry.mirrors == [None; 3]) else { continue };
            let turn = DMat3::from_axis_angle(DVec3::AXES[line.along], 1.1);
            let other = symmetry.place(line.through + turn * (position - line.through));
            let direction = DVec3::new(0.36, 0.48, -0.8);
            let apart = other.to_local(turn * direction) - place.to_local(direction);
            assert!(apart.length() < 1e-12, "{apart}");
        }
    }
}

#[test]
fn coefficients_in_the_frame_of_a_place_are_of_the_same_values() {
    let degree = 6;
    let basis = Basis::new(Domain::Directions, degree);
    let world: Vec<f32> = (0..basis.len()).map(|k| (k as f32 * 0.7).sin()).collect();
    let sum = |coefficients: &[f32], direction| {
        let mut functions = vec![0.0; coefficients.len()];
        basis.values_of_direction(direction, &mut functions);
        coefficients.iter().zip(functions).map(|(&c, b)| f64::from(c) * b).sum::<f64>()
    };
    for symmetry in symmetries() {
        let harmonics = LocalHarmonics::new(&symmetry, degree);
        let (mut ordered, mut scale) = (vec![0.0; world.len()], 0.0f64);
        harmonics.in_order(&world, &mut ordered);
        for position in positions() {
            let place = symmetry.place(position);
            let mut local = ordered.clone();
            harmonics.to_local(&place, &mut local);
            for direction in positions().map(DVec3::normalize) {
                let (expected, found) = (sum(&world, direction), sum(&local, place.to_local(direction)));
                scale = scale.max(expected.abs());
                // Sums of fifty products in f32, of values up to ten.
                assert!((found - expected).abs() < 2e-5, "{symmetry}: {found}, not {expected}");
            }
            harmonics.to_world(&place, &mut local);
            let rest = apart(&local, &ordered);
            assert!(rest < 1e-5, "{symmetry}: back with {rest}");
        }
        assert!(scale > 1.0);
        // The functions in order are sums of the world's.
        let functions = harmonics.functions_in_order();
        let direction = DVec3::new(0.36, 0.48, -0.8);
        let mut values = vec![0.0; world.len()];
        basis.values_of_direction(direction, &mut values);
        let along = (0..world.len()).map(|c| {
            let column = functions.iter().skip(c).step_by(world.len());
            values.iter().zip(column).map(|(b, &m)| b * f64::from(m)).sum::<f64>() * f64::from(ordered[c])
        });
        assert!((along.sum::<f64>() - sum(&world, direction)).abs() < 2e-5, "{symmetry}");
    }
}

/// A harmonic of all functions, whose grid the symmetries' planes and lines cross.
fn all_functions(scene: &Scene) -> HarmonicField {
    let settings = FitSettings { components: usize::MAX, ..FIT };
    fit(&plan(scene), Domain::Directions, &settings, Control::quiet()).unwrap()
}

/// The symmetries, moved so far from a grid's middle, in pitches.
fn within(grid: &Grid, beside: f64) -> Vec<Symmetry> {
    let through = grid.origin + 0.5 * grid.size() + beside * grid.pitch;
    let moved = |symmetry: Symmetry| Symmetry {
        mirrors: std::array::from_fn(|axis| symmetry.mirrors[axis].map(|_| through[axis])),
        axis: symmetry.axis.map(|axis| Axis { through, ..axis }),
    };
    symmetries().into_iter().map(moved).collect()
}

#[test]
fn fields_with_symmetry_are_their_network_in_the_frames_of_places() {
    let scene = scene();
    let harmonic = all_functions(&scene);
    let set = OrientationSet::parse("random:9:5").unwrap().orientations;
    // Where a plane is the grid's middle, one side is computed for both.
    let symmetries =
        [0.13, 0.0].map(|beside| within(&harmonic.grid, beside).into_iter().map(move |s| (s, beside)));
    for (symmetry, beside) in symmetries.into_iter().flatten() {
        let settings = DistillSettings { width: 40, hidden: 2, omega: 6.0, symmetry, ..settings(1) };
        let shape = settings.shape(harmonic.component_count());
        let plain = FactoredField::new(&harmonic, shape, shape.initial_parameters(3)).unwrap();
        for field in [plain.clone(), plain.fold()] {
            let (grid, evaluator) = (field.grid, field.evaluator());
            let has_plane = symmetry.mirrors != [None; 3];
            assert_eq!(evaluator.mirrors(set.len()).is_some(), has_plane && beside == 0.0, "{symmetry}");
            let heads = field.direction_weights(&set);
            let mut sections = vec![0.0; grid.len() * set.len()];
            evaluator.sections(&heads, &mut sections);
            let least = evaluator.minimum(&heads);
            let report = harmonic.report;
            let expanded = evaluator.expanded(StoragePrecision::F32, report);
            let mut from_array = vec![0.0; sections.len()];
            expanded.sections(&expanded.direction_weights(&set), &mut from_array);
            let weights = as_f64(&field.parameters);
            let mut functions = vec![0.0; field.basis.len()];
            let (mut scratch, mut spread) = (PointScratch::default(), 0.0f64);
            for voxel in (0..grid.len()).step_by(97) {
                let point = grid.centre(grid.voxel(voxel));
                let input = as_f64(&field.input(point));
                let z = reference::forward(&field.shape, &weights, &input);
                let place = symmetry.place(point);
                for (number, orientation) in set.iter().enumerate() {
                    let local = place.to_local(orientation.direction());
                    field.basis.values_of_direction(local, &mut functions);
                    let defined = defined(&field, &z, &functions);
                    let gradient =
                        evaluator.overlap_with_gradient(point, orientation.direction(), &mut scratch);
                    spread = spread.max(defined.abs());
                    let free = f64::from(gradient.unwrap().value);
                    // Sums of some hundred products in f32.
                    assert!((free - defined).abs() < 5e-5, "{symmetry}: {free}, not {defined}");
                    let held = defined.clamp(0.0, 1.0);
                    let at = number * grid.len() + voxel;
                    for found in [sections[at], from_array[at]] {
                        assert!((f64::from(found) - held).abs() < 5e-5, "{symmetry}: {found}, not {held}");
                    }
                }
            }
            assert!(spread > 0.01, "a field that is not zero everywhere: {spread}");
            for (voxel, (&value, &best)) in least.value.iter().zip(&least.best).enumerate() {
                let of_set = sections.iter().skip(voxel).step_by(grid.len());
                assert_eq!(value, of_set.copied().fold(f32::INFINITY, f32::min));
                assert_eq!(value, sections[best as usize * grid.len() + voxel]);
            }
        }
    }
}

#[test]
fn slopes_with_symmetry_are_those_of_differences() {
    let scene = scene();
    let harmonic = all_functions(&scene);
    for symmetry in within(&harmonic.grid, 0.13) {
        let settings = DistillSettings { width: 40, hidden: 2, omega: 6.0, symmetry, ..settings(1) };
        let shape = settings.shape(harmonic.component_count());
        let mut field = FactoredField::new(&harmonic, shape, shape.initial_parameters(3)).unwrap();
        // Random weights are small.
        field.scale *= 8.0;
        let (grid, evaluator) = (field.grid, field.evaluator());
        let mut scratch = PointScratch::default();
        let mut value =
            |point, direction| evaluator.overlap_with_gradient(point, direction, &mut scratch).unwrap();
        let (middle, mut most) = (grid.origin + 0.5 * grid.size(), 0.0f64);
        for (index, fraction) in positions().enumerate() {
            let point = middle + grid.size() * fraction * 0.25;
            // Random weights jump where the frame does.
            let place = symmetry.place(point);
            let planes = symmetry.mirrors.iter().enumerate();
            if planes.clone().any(|(axis, m)| m.is_some_and(|m| (point[axis] - m).abs() < 0.1 * grid.pitch)) {
                continue;
            }
            assert!(place.angle.is_none_or(|angle| angle.distance > 0.5 * grid.pitch));
            let direction =
                (DVec3::new(fraction.z, fraction.x, fraction.y) + 0.01 * index as f64).normalize();
            let found = value(point, direction);
            // Steps over which values in f32 are good to some hundredths of the largest slopes.
            let step = 0.04 * grid.pitch;
            for axis in DVec3::AXES {
                let ends =
                    [1.0, -1.0].map(|side| f64::from(value(point + side * step * axis, direction).value));
                let slope = (ends[0] - ends[1]) / (2.0 * step);
                most = most.max(slope.abs() * grid.pitch);
                let apart = (found.position.dot(axis) - slope).abs() * grid.pitch;
                assert!(apart < 3e-3, "{symmetry} at {point}: {}, not {slope} along {axis}", found.position);
            }
            for tangent in
                [direction.any_orthonormal_vector(), direction.cross(direction.any_orthonormal_vector())]
            {
                let ends = [1.0, -1.0].map(|side| {
                    f64::from(value(point, (direction + side * 2e-3 * tangent).normalize()).value)
                });
                let slope = (ends[0] - ends[1]) / 4e-3;
                assert!((found.direction.dot(tangent) - slope).abs() < 3e-3, "{symmetry} at {point}");
            }
        }
        assert!(most > 0.03, "slopes that are not zero everywhere: {most}");
    }
}

/// An obstacle by its voxels' centres from the grid's middle, in voxels.
fn obstacle(grid: Grid, is_solid: impl Fn(DVec3) -> bool) -> Occupancy {
    let middle = grid.origin + 0.5 * grid.size();
    let solid = (0..grid.len())
        .map(|index| u8::from(is_solid((grid.centre(grid.voxel(index)) - middle) / grid.pitch)));
    Occupancy { grid, solid: solid.collect() }
}

#[test]
fn symmetry_is_found_where_it_is_and_nowhere_else() {
    let grid = Grid { origin: DVec3::new(3.0, -2.0, 1.0), pitch: 0.5, dims: [20, 23, 26] };
    let fitted = |occupancy: &Occupancy| {
        let plan = SectionPlan::new(occupancy, Tool::paper(), ToolPoints::SharpPoints).unwrap();
        let settings = FitSettings { components: usize::MAX, ..FIT };
        fit(&plan, Domain::Directions, &settings, Control::quiet()).unwrap()
    };
    let found = |occupancy: &Occupancy| Symmetry::of(&fitted(occupancy), occupancy);
    let middle = grid.origin + 0.5 * grid.size();
    let across = |axes: [bool; 3]| std::array::from_fn(|axis| axes[axis].then_some(middle[axis]));

    // A disc along y off the middle, with a key that is symmetric across x.
    let disc = obstacle(grid, |v| {
        v.y.abs() < 6.0 && (v.x.hypot(v.z - 2.0) < 8.0 || (v.x.abs() < 2.0 && (0.0..11.0).contains(&v.z)))
    });
    let Symmetry { mirrors, axis } = found(&disc);
    assert_eq!(mirrors, across([true, true, false]));
    let Axis { along, through } = axis.unwrap();
    assert_eq!((along, through.x), (1, middle.x), "in its mirror plane");
    // The key pulls it a little its way.
    let off = (through.z - middle.z) / grid.pitch - 2.0;
    assert!((-0.1..1.0).contains(&off), "{off}");

    // A bar across two planes; and with a pin on one side of one of them.
    let bar = |v: DVec3| v.x.abs() < 4.0 && v.y.abs() < 11.0 && (-8.0..-5.0).contains(&v.z);
    assert_eq!(found(&obstacle(grid, bar)), Symmetry { mirrors: across([true, true, false]), axis: None });
    let with_pin = obstacle(grid, |v| bar(v) || (v - DVec3::new(2.0, 7.0, 0.0)).length() < 3.5);
    assert_eq!(found(&with_pin), Symmetry::default());

    // Two voxels thick it changes the mean by less than the field's error, and is told apart all the same; a voxel that a
    // surface's rounding made is not.
    let with_peg = obstacle(grid, |v| {
        bar(v) || ((1.0..3.0).contains(&v.x) && (8.0..10.0).contains(&v.y) && (-5.0..2.0).contains(&v.z))
    });
    assert_eq!(found(&with_peg), Symmetry::default());
    let with_speck = obstacle(grid, |v| bar(v) || v == DVec3::new(2.5, 7.0, -4.5));
    assert_eq!(with_speck.count(), obstacle(grid, bar).count() + 1);
    assert_eq!(found(&with_speck).mirrors, across([true, true, false]));

    // The bar's network goes on with the bar, and not with the bar that has a pin, nor with one that lies elsewhere.
    let solid = obstacle(grid, bar);
    let bar = fitted(&solid);
    let symmetry = Symmetry { mirrors: across([true, true, false]), axis: None };
    let shape = DistillSettings { symmetry, ..settings(1) }.shape(bar.component_count());
    let network = FactoredField::new(&bar, shape, shape.initial_parameters(3)).unwrap();
    assert!(start_from(&network, &bar, &solid).is_ok());
    let moved = Grid { origin: grid.origin + DVec3::X, ..grid };
    let elsewhere = Occupancy { grid: moved, solid: solid.solid };
    for (other, obstacle) in
        [(fitted(&with_pin), with_pin), (HarmonicField { grid: moved, ..bar }, elsewhere)]
    {
        let refused = start_from(&network, &other, &obstacle).unwrap_err();
        assert!(refused.to_string().contains("mirrored across x and y, and this one is not"), "{refused}");
    }
}

#[test]
fn a_symmetry_reduced_network_learns_more_and_stays_what_it_is() {
    let scene = scene();
    let harmonic = all_functions(&scene);
    let symmetry = Symmetry::of(&harmonic, &scene.obstacle);
    // The teapot's spout and handle lie in a plane, its body is turned about x.
    let along_x = symmetry.axis.is_some_and(|axis| axis.along == 0);
    assert!(symmetry.mirrors[1].is_some() && along_x, "{symmetry:?}");
    let set = OrientationSet::parse("random:40:6").unwrap().orientations;
    let mut exact = vec![0.0; harmonic.grid.len() * set.len()];
    harmonic.sections(&harmonic.direction_weights(&set), &mut exact);
    let mut errors = Vec::new();
    for symmetry in [Symmetry::default(), symmetry] {
        let settings = DistillSettings { symmetry, ..settings(300) };
        let mut state = settings.start(harmonic.component_count());
        let outcome = distil(&harmonic, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
        assert_eq!(outcome, Outcome::Finished);
        let shape = settings.shape(harmonic.component_count());
        let field = FactoredField::new(&harmonic, shape, state.training.parameters.clone()).unwrap();
        let mut sections = vec![0.0; exact.len()];
        field.evaluator().sections(&field.direction_weights(&set), &mut sections);
        errors.push(mean_square(&sections, &exact));

        let file = FactoredFile {
            field: field.clone(),
            scene: scene.clone(),
            fit: FitSettings { components: usize::MAX, ..FIT },
            report: harmonic.report,
            settings,
            precision: StoragePrecision::F32,
            state: Some(state),
            calibration: None,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.safetensors");
        for file in [file.clone(), file.finished(StoragePrecision::F16)] {
            file.write(&path).unwrap();
            assert_eq!(FactoredFile::read(&path).unwrap(), file.clone().as_saved());
            if let Some(plane) = symmetry.mirrors[1] {
                let far = Symmetry { mirrors: [None, Some(plane + 1e30), None], ..symmetry };
                let mut bent = file.clone();
                bent.settings.symmetry = far;
                bent.write(&path).unwrap();
                let damaged = FactoredFile::read(&path).unwrap_err();
                assert!(damaged.to_string().contains("the symmetry 'mirrored across y"), "{damaged}");
            }
        }
        // To its own harmonic nothing changes.
        let targets = Targets::new(&harmonic, symmetry).unwrap();
        let same = parameters_for(&field, &harmonic, &targets).unwrap();
        let worst = apart(&same, &field.parameters);
        assert!(worst < 1e-4, "{worst}");
    }
    // Full size gains a half and more; of this coarse teapot a quarter is enough to tell.
    assert!(errors[1] < 0.75 * errors[0], "{errors:?}");

    // A harmonic that keeps fewer axes tells of it as well: of all functions, as far as its axes go.
    let few = super::harmonic();
    assert!(few.component_count() < few.basis.len());
    assert_eq!(Symmetry::of(&few, &scene.obstacle).axis.map(|axis| axis.along), Some(0));
    let settings = DistillSettings { symmetry, ..settings(300) };
    let mut state = settings.start(settings.outputs(&few));
    distil(&few, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
    let shape = settings.shape(settings.outputs(&few));
    let field = FactoredField::new(&few, shape, state.training.parameters).unwrap();
    let (mut found, mut expected) = (vec![0.0; exact.len()], vec![0.0; exact.len()]);
    field.evaluator().sections(&field.direction_weights(&set), &mut found);
    few.sections(&few.direction_weights(&set), &mut expected);
    assert!(mean_square(&found, &expected) < 1.5 * errors[1], "{errors:?}");
}
