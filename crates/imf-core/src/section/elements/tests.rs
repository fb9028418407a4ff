//! Elements against their definition, with and without contact, clearance and sharp points off the tip.

use glam::DVec3;

use super::*;
use crate::occupancy::Occupancy;
use crate::scene::Bodies;
use crate::section::test_shapes::{self, line, orientations, revolved, scattered};
use crate::section::{direct_element_measures, imf};
use crate::tool::Clearance;

/// Cutter, shank and two holder segments; the upper is so thin that it holds no centre upright.
fn tool(sharp_points: SharpPoints) -> Tool {
    let elements = [
        (ElementKind::Cutter, vec![line(0.0, 3.0, 1.3, 1.3)]),
        (ElementKind::Shank, vec![line(3.0, 4.5, 0.8, 1.7)]),
        (ElementKind::Holder(0), vec![line(4.5, 8.1, 2.4, 2.9)]),
        (ElementKind::Holder(1), vec![line(8.1, 8.9, 3.3, 3.3)]),
    ];
    Tool { sharp_points, ..revolved(elements) }
}

/// A block with a fixture beside it.
fn clamped_block() -> (Occupancy, Occupancy) {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [10, 9, 8] };
    let part = Occupancy::of(grid, |[x, y, z]| (1..8).contains(&x) && (1..8).contains(&y) && z < 5);
    (part, Occupancy::of(grid, |[x, y, z]| x >= 7 && (3..5).contains(&y) && z < 7))
}

/// Every voxel's measures are the definition's, and they sum to the section; some sharp point beside the first is best.
fn agrees(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    orientation: &Orientation,
) -> Vec<Vec<f32>> {
    let (obstacle, assembly) = (obstacle.into(), assembly.into());
    let grid = *obstacle.grid();
    let plans = ElementPlans::new(&obstacle, &assembly, &grid).unwrap();
    let kinds: Vec<ElementKind> = plans.elements().collect();
    let mut measures = vec![vec![f32::NAN; grid.len()]; kinds.len()];
    plans.measures(orientation, &mut ElementScratch::default(), &mut measures).unwrap();
    let cmf = test_shapes::cmf(plans.whole(), orientation);
    for voxel in 0..grid.len() {
        let direct = direct_element_measures(&obstacle, &assembly, orientation, grid.voxel(voxel)).unwrap();
        assert_eq!(direct.iter().map(|d| d.0).collect::<Vec<_>>(), kinds);
        let sum: f64 = measures.iter().map(|m| f64::from(m[voxel])).sum();
        // Each measure and the section are rounded to f32 once.
        let rounding = f64::from(f32::EPSILON) * sum.max(1e-30);
        assert!((sum - f64::from(cmf[voxel])).abs() <= rounding, "{sum} {}", cmf[voxel]);
        for ((kind, expected), found) in direct.iter().zip(&measures) {
            // Sums of eighths of counts in another order; a near-tie of two sharp points would be far larger.
            let found = f64::from(found[voxel]);
            assert!((found - expected).abs() <= 1e-6, "{kind} at {voxel}: {found} {expected}");
        }
    }
    measures
}

#[test]
fn elements_are_their_definition_and_sum_to_the_section_flat_and_deep() {
    let off_tip = SharpPoints::Points(vec![
        DVec3::ZERO,
        DVec3::new(1.3, 0.0, 0.0),
        DVec3::new(-0.4, 0.9, 1.7),
        DVec3::new(0.0, 0.0, 3.0),
    ]);
    for dims in [[7, 8, 6], [1, 9, 7], [6, 8, 1]] {
        let obstacle = scattered(dims, 2);
        let mut seen = [false; 4];
        for sharp in [SharpPoints::Tip, off_tip.clone(), SharpPoints::Cutter(9), SharpPoints::Boundary(None)]
        {
            for orientation in [Orientation::default(), Orientation::new(40.0, 75.0)] {
                let measures = agrees(&obstacle, tool(sharp.clone()), &orientation);
                let hits = measures.iter().map(|m| m.iter().any(|&v| v > 0.0));
                seen.iter_mut().zip(hits).for_each(|(seen, hits)| *seen |= hits);
            }
        }
        // No comparison of nothing with nothing, but for the far end over the flat obstacle.
        assert!(seen[..3].iter().all(|&s| s), "{dims:?}: {seen:?}");
    }
}

#[test]
fn contact_and_clearance_are_counted_by_their_definition() {
    let (part, clamp) = clamped_block();
    let fixtures = vec![("clamp".to_owned(), clamp.clone())];
    let bodies = Bodies { part: part.clone(), fixtures, undecided: 0.0, fixtures_undecided: vec![0.0] };
    let obstacle = Obstacle::with_cuttable(&bodies.obstacle(), bodies.layer(1.0));
    let (forbidden, cuttable) = (&obstacle.forbidden, obstacle.cuttable.as_ref().unwrap());
    assert!(forbidden.solid.iter().zip(&cuttable.solid).all(|(a, b)| a & b == 0));
    assert!(cuttable.count() > 0 && forbidden.count() > clamp.count());
    let sharp = SharpPoints::Points(vec![DVec3::ZERO, DVec3::new(0.7, 0.2, 0.5)]);
    // A cutter that grows beyond the shank, and holder and shank that reach down over the cutter.
    for clearance in [
        Clearance::default(),
        Clearance { holder: 1.2, shank: 0.6, cutter: 0.0 },
        Clearance { holder: 0.0, shank: 0.0, cutter: 1.5 },
    ] {
        let bare = tool(sharp.clone());
        let assembly = bare.offset(&clearance).unwrap();
        let bodies = bare.offset_elements(&clearance).unwrap();
        for orientation in [Orientation::default(), Orientation::new(200.0, 110.0)] {
            agrees(&obstacle, &assembly, &orientation);
            // A tip is free where no body holds what is forbidden to it: offset elements one by one.
            let tip = assembly.whole().with_tip_only();
            let plan = SectionPlan::new(&obstacle, &assembly, ToolPoints::Tip).unwrap();
            let (counts, _) = test_shapes::counts(&plan, &orientation);
            let field = |occupancy: &Occupancy, cutter: bool, at: DVec3| -> u32 {
                let wanted = bodies.iter().filter(|b| (b.kind == ElementKind::Cutter) == cutter);
                let alone =
                    |body: &Element| Tool { shape: ToolShape::Revolved(vec![body.clone()]), ..tip.clone() };
                wanted.map(|body| alone(body).count_inside(occupancy, at, &orientation)).sum()
            };
            let mut whole = part.clone();
            whole.add(&clamp);
            for (index, &count) in counts.iter().enumerate() {
                let at = part.grid.centre(part.grid.voxel(index));
                let forbidden = field(&obstacle.forbidden, true, at) + field(&whole, false, at);
                assert_eq!(count > 0, forbidden > 0, "{clearance:?} {:?}", part.grid.voxel(index));
            }
        }
    }
}

#[test]
fn the_best_orientations_elements_sum_to_the_imf_whatever_the_threads() {
    let obstacle = scattered([6, 7, 8], 2);
    let tool = tool(SharpPoints::Cutter(5));
    let set = orientations("fibonacci:13");
    let plans = ElementPlans::new(&obstacle, &tool, &obstacle.grid).unwrap();
    let imf = imf(plans.whole(), &set, Control::quiet()).unwrap();
    let at_best = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| elements_at_best(&plans, &set, &imf, Control::quiet())).unwrap()
    };
    let found = at_best(1);
    assert_eq!(found, at_best(3));
    for voxel in 0..obstacle.grid.len() {
        let best = &set[imf.best[voxel] as usize];
        let direct = direct_element_measures(&obstacle, &tool, best, obstacle.grid.voxel(voxel)).unwrap();
        let sum: f64 = found.values.iter().map(|v| f64::from(v[voxel])).sum();
        assert!((sum - f64::from(imf.value[voxel])).abs() <= f64::from(f32::EPSILON) * sum.max(1e-30));
        for ((_, expected), values) in direct.iter().zip(&found.values) {
            assert!((f64::from(values[voxel]) - expected).abs() < 1e-6);
        }
    }
}

#[test]
fn a_mesh_has_no_elements() {
    let mesh = crate::mesh::tests::unit_cube().transformed(&glam::DMat4::from_scale(DVec3::splat(3.0)));
    let tool = Tool { shape: ToolShape::Mesh(mesh), ..tool(SharpPoints::Tip) };
    let obstacle = scattered([4, 4, 4], 2);
    assert_eq!(ElementPlans::new(&obstacle, &tool, &obstacle.grid).unwrap().elements().count(), 0);
}
