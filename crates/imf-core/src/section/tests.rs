use super::*;
use crate::orientation::OrientationSet;
use crate::tool::{Element, ElementKind, Segment, SharpPoints, ToolShape};
use crate::unit::LengthUnit;

const DIMS: [usize; 3] = [13, 11, 17];

/// A cylinder of the given radius and height with its tip at the origin.
fn cylinder(radius: f64, height: f64) -> Tool {
    let line = Segment::Line { from: 0.0, to: height, radius_from: radius, radius_to: radius };
    Tool {
        name: "cylinder".into(),
        unit: LengthUnit::Mm,
        shape: ToolShape::Revolved(vec![Element { kind: ElementKind::Cutter, profile: vec![line] }]),
        sharp_points: SharpPoints::Tip,
    }
}

fn scattered(dims: [usize; 3]) -> Occupancy {
    let grid = Grid { origin: DVec3::new(0.3, -1.0, 2.0), pitch: 1.0, dims };
    let solid = (0..grid.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 7 & 3 == 0)).collect();
    Occupancy { grid, solid }
}

fn counts_equal_direct(plan: &SectionPlan, orientation: &Orientation) {
    let mut scratch = SectionScratch::default();
    let mut counts = vec![u32::MAX; plan.grid().len()];
    plan.counts(orientation, &mut scratch, &mut counts).unwrap();
    let rotated = RotatedTool::new(plan.tool(), orientation, plan.grid().pitch).unwrap();
    for (index, &count) in counts.iter().enumerate() {
        let voxel = plan.grid().voxel(index).map(|v| v as i64);
        assert_eq!(count, direct_count(plan.obstacle(), &rotated, voxel), "{orientation:?} {voxel:?}");
    }
}

#[test]
fn counts_are_direct_sums_for_tools_smaller_and_larger_than_the_grid() {
    let mut orientations = OrientationSet::parse("random:6:1").unwrap().orientations;
    orientations.extend(OrientationSet::parse("0,0;0,180;90,90;45,45").unwrap().orientations);
    for tool in [cylinder(2.0, 6.0), cylinder(4.0, 45.0), cylinder(0.6, 1.0)] {
        for dims in [DIMS, [1, 5, 2]] {
            let plan = SectionPlan::new(&scattered(dims), &tool).unwrap();
            orientations.iter().for_each(|o| counts_equal_direct(&plan, o));
        }
    }
}

#[test]
fn sharp_points_are_read_by_trilinear_means() {
    let tool = Tool {
        sharp_points: SharpPoints::Points(vec![DVec3::new(1.3, -0.4, 0.7), DVec3::ZERO]),
        ..cylinder(2.5, 7.0)
    };
    let plan = SectionPlan::new(&scattered(DIMS), &tool).unwrap();
    let mut scratch = SectionScratch::default();
    let mut cmf = vec![f32::NAN; plan.grid().len()];
    for orientation in OrientationSet::parse("0,0;20,50;110,130").unwrap().orientations {
        plan.cmf(&orientation, &mut scratch, &mut cmf).unwrap();
        for (index, &value) in cmf.iter().enumerate() {
            let expected =
                direct_cmf(plan.obstacle(), &tool, &orientation, plan.grid().voxel(index)).unwrap();
            assert!((f64::from(value) - expected).abs() < 1e-6, "{value} {expected}");
        }
    }
}

#[test]
fn a_box_of_voxels_under_a_one_voxel_line_is_counted_in_closed_form() {
    // A line of 5 voxels going up over a block that fills z < 4: overlap = clamp(4 − z, 0, 5).
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4, 4, 8] };
    let solid = (0..grid.len()).map(|i| u8::from(i % 8 < 4)).collect();
    let plan = SectionPlan::new(&Occupancy { grid, solid }, &cylinder(0.4, 4.5)).unwrap();
    let mut cmf = vec![0.0; grid.len()];
    plan.cmf(&Orientation::default(), &mut SectionScratch::default(), &mut cmf).unwrap();
    for (index, &value) in cmf.iter().enumerate() {
        let z = index % 8;
        assert_eq!(value, (4usize.saturating_sub(z)) as f32 / 5.0);
    }
}

#[test]
fn the_imf_is_the_least_section_with_the_first_index_at_a_tie() {
    let plan = SectionPlan::new(&scattered(DIMS), &cylinder(2.0, 6.0)).unwrap();
    let mut orientations = OrientationSet::parse("fibonacci:9").unwrap().orientations;
    orientations.extend(orientations.clone());
    let all = sections(&plan, &orientations, Control::quiet()).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let result = pool.install(|| imf(&plan, &orientations, Control::quiet())).unwrap();
        for voxel in 0..plan.grid().len() {
            let mut expected = (f32::INFINITY, u32::MAX);
            for (index, section) in all.iter().enumerate() {
                if section[voxel] < expected.0 {
                    expected = (section[voxel], index as u32);
                }
            }
            assert_eq!((result.value[voxel], result.best[voxel]), expected);
        }
    }
}

#[test]
fn cancelling_stops_the_stream() {
    let plan = SectionPlan::new(&scattered(DIMS), &cylinder(2.0, 6.0)).unwrap();
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control { progress: &|_| {}, cancelled: &stop };
    let orientations = OrientationSet::parse("fibonacci:9").unwrap().orientations;
    assert!(matches!(imf(&plan, &orientations, control), Err(SectionError::Cancelled)));
}

#[test]
fn the_papers_scene_fits_f32_and_its_estimate_is_near_the_truth() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [58, 76, 121] };
    let estimate = SectionPlan::memory_estimate(&grid, &Tool::paper(), 2) as f64 / 1e6;
    // One spectrum of 16 MB, and about 35 MB of scratch a thread.
    assert!((40.0..200.0).contains(&estimate), "{estimate} MB");
    assert!(
        CircularSize::new(grid.dims, QueryBox::grown(grid.dims, 0), 84.3).error_bound::<f32>(120_000, 33_000)
            < 0.5
    );
}
