//! Every way to evaluate is the definition: sections, minima, poses, gradients.

use super::*;

#[test]
fn every_way_to_evaluate_is_the_definition() {
    let harmonic = harmonic();
    let set = OrientationSet::parse("random:530:4").unwrap().orientations;
    let mut functions = vec![0.0; harmonic.basis.len()];
    let fields = [37, 130].map(|width| field(&harmonic, width));
    for field in fields.iter().cloned().chain(fields.iter().cloned().map(FactoredField::fold)) {
        let (grid, weights) = (field.grid, as_f64(&field.parameters));
        let evaluator = field.evaluator();
        let heads = field.direction_weights(&set);
        let mut sections = vec![f32::NAN; grid.len() * set.len()];
        evaluator.sections(&heads, &mut sections);
        let expanded = evaluator.expanded(StoragePrecision::F32, harmonic.report);
        let mut again = vec![f32::NAN; sections.len()];
        expanded.sections(&heads, &mut again);
        assert_eq!(sections, again);
        let least = evaluator.minimum(&heads);
        let mut expected = Imf::new(grid.len());
        for (index, section) in sections.chunks_exact(grid.len()).enumerate() {
            expected.lower_to(index, section);
        }
        let voxels = [[0, 0, 0], [14, 18, 30], [7, 3, 20], [3, 11, 9]];
        let points: Vec<DVec3> =
            voxels.iter().map(|&v| grid.centre(v)).chain([grid.origin, DVec3::NAN]).collect();
        let poses: Vec<[u32; 2]> = (0..points.len() as u32 * 11).map(|i| [i / 11, i % 11 * 48]).collect();
        let mut scratch = PointScratch::default();
        for &[point, orientation] in &poses {
            let (point, orientation) = (point as usize, orientation as usize);
            if point >= voxels.len() {
                let direction = set[orientation].direction();
                assert_eq!(evaluator.overlap_with_gradient(points[point], direction, &mut scratch), None);
                continue;
            }
            let input = as_f64(&field.input(points[point]));
            let z = reference::forward(&field.shape, &weights, &input);
            field.basis.values(&set[orientation], &mut functions);
            let defined = defined(&field, &z, &functions);
            let defined = defined.clamp(0.0, 1.0);
            let section = sections[orientation * grid.len() + grid.index(voxels[point])];
            let direction = set[orientation].direction();
            let single = evaluator.overlap_with_gradient(points[point], direction, &mut scratch).unwrap();
            for found in [section, single.value.clamp(0.0, 1.0)] {
                // Sums of some hundred products in f32, of values up to one.
                assert!((f64::from(found) - defined).abs() < 2e-5, "{found}, not {defined}");
            }
        }
        for voxel in 0..grid.len() {
            let value = least.value[voxel];
            assert!((value - expected.value[voxel]).abs() < 1e-6);
            let of_best = sections[least.best[voxel] as usize * grid.len() + voxel];
            assert!((of_best - value).abs() < 1e-6, "voxel {voxel}: {of_best}, {value}");
        }
    }
}

#[test]
fn gradients_of_single_poses_are_central_differences_on_every_instruction_set() {
    let harmonic = harmonic();
    let field = field(&harmonic, 70);
    let folded = field.clone().fold();
    let grid = field.grid;
    let mut scratch = PointScratch::default();
    for (arch, field) in archs().into_iter().flat_map(|arch| [(arch, &field), (arch, &folded)]) {
        let mut evaluator = field.evaluator();
        evaluator.arch = arch;
        for (fraction, direction) in [
            (DVec3::new(0.31, 0.52, 0.44), DVec3::new(0.4, 0.5, -0.7)),
            (DVec3::new(0.61, 0.42, 0.74), DVec3::Z),
            (DVec3::new(0.47, 0.22, 0.58), -DVec3::Z),
        ] {
            let position = grid.origin + grid.size() * fraction;
            let direction = direction.normalize();
            let found = evaluator.overlap_with_gradient(position, direction, &mut scratch).unwrap();
            let mut at = |position, direction| {
                f64::from(evaluator.overlap_with_gradient(position, direction, &mut scratch).unwrap().value)
            };
            // Values in f32: about 1e-6 over a tenth of a voxel, whose third derivative the second order leaves out.
            let step = 0.1;
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let by = axis * step * grid.pitch;
                let expected =
                    (at(position + by, direction) - at(position - by, direction)) / (2.0 * step * grid.pitch);
                let slope = found.position.dot(axis);
                assert!((slope - expected).abs() < 2e-3 / grid.pitch, "{arch:?}: {slope}, {expected}");
            }
            let step = 1e-2;
            let (u, v) = direction.any_orthonormal_pair();
            for tangent in [u, v] {
                let ahead = at(position, direction + tangent * step);
                let behind = at(position, direction - tangent * step);
                let expected = (ahead - behind) / (2.0 * step);
                let slope = found.direction.dot(tangent);
                assert!((slope - expected).abs() < 2e-3, "{arch:?}: {slope}, {expected}");
            }
        }
    }
}
