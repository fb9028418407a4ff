//! Exact sections on the adapter: every count and value is the CPU's, bit for bit, and the minimum's orientation too.

use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::obstacle::Obstacle;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::Bodies;
use imf_core::section::{SectionError, SectionPlan, ToolPoints, imf, sections};
use imf_core::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape, ToolVoxels};
use imf_core::voxelize::voxelize;
use imf_gpu::{Gpu, GpuLimits, GpuSectionError, GpuSections};

use crate::devices::open;

/// Numbers that no buffer of counts, differences or values may show.
const SENTINEL: u32 = 0x5A5A_1234;

fn grid(pitch: f64, dims: [usize; 3]) -> Grid {
    Grid { origin: [0.3, -1.0, 2.0].into(), pitch, dims }
}

fn scattered(grid: Grid) -> Occupancy {
    let solid = (0..grid.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 7 & 3 == 0)).collect();
    Occupancy { grid, solid }
}

/// A wedge that no rotation but a whole turn brings onto itself.
fn wedge() -> Tool {
    let mesh = Mesh {
        vertices: [[0.0, 0.0, 0.0], [15.0, 0.0, 0.0], [0.0, 9.0, 0.0], [3.0, 1.5, 27.0]]
            .map(Into::into)
            .to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    };
    Tool { name: "wedge".into(), shape: ToolShape::Mesh(mesh), ..Tool::paper() }
}

fn with_sharp_points(sharp_points: SharpPoints) -> Tool {
    Tool { sharp_points, ..Tool::paper() }
}

/// Opposite and upright directions, a repeated one, and some in general position.
fn orientations() -> Vec<Orientation> {
    let upright = [(0.0, 0.0), (0.0, 180.0), (90.0, 90.0), (45.0, 45.0), (45.0, 45.0), (0.0, 0.0)];
    let slanted = [(25.0, 55.0), (301.5, 12.25), (170.0, 101.0), (77.7, 88.0), (213.0, 149.5)];
    upright.into_iter().chain(slanted).map(|(theta, phi)| Orientation::new(theta, phi)).collect()
}

/// As it is, and held to limits that force slabs, strides and submissions of few jobs.
fn devices(smallest: u64) -> Vec<Gpu> {
    let gpu = open();
    let small = GpuLimits { storage_binding: smallest, buffer: 1 << 30, workgroups: 3 };
    vec![gpu.clone(), gpu.with_limits(small)]
}

/// Sections and minimum of a plan on the device are those of the CPU, twice, the second time over sentinels.
fn agree(plan: &SectionPlan, orientations: &[Orientation], smallest: u64) -> Result<(), GpuSectionError> {
    let control = Control::quiet();
    let expected = sections(plan, orientations, control)?;
    let least = imf(plan, orientations, control)?;
    for gpu in devices(smallest) {
        let mut device = GpuSections::new(&gpu, plan)?;
        for round in 0..2 {
            let what = format!("{:?}, limits {:?}, round {round}", plan.grid().dims, gpu.limits());
            let found = device.stream(orientations, control, Vec::new, |own: &mut Vec<_>, index, cmf| {
                own.push((index, cmf.to_vec()));
            })?;
            let mut found: Vec<_> = found.into_iter().flatten().collect();
            found.sort_by_key(|&(index, _)| index);
            assert_eq!(found.len(), orientations.len(), "{what}");
            for (index, section) in &found {
                assert!(*section == expected[*index], "section {index} differs, {what}");
            }
            assert!(device.imf(orientations, control)? == least, "the minimum differs, {what}");
            device.fill_scratch(SENTINEL);
        }
    }
    Ok(())
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn every_value_is_the_cpus_at_sizes_that_are_no_multiple_of_anything() {
    // Smaller than the tool, as long as its reach, thin along each axis, beyond one and two tiles of a line.
    for (pitch, dims) in [
        (4.0, [13, 11, 17]),
        (6.0, [1, 5, 2]),
        (6.0, [1, 1, 1]),
        (5.0, [3, 1, 140]),
        (5.0, [2, 70, 3]),
        (5.0, [67, 2, 3]),
        (7.0, [4, 3, 259]),
    ] {
        let plan =
            SectionPlan::new(scattered(grid(pitch, dims)), Tool::paper(), ToolPoints::SharpPoints).unwrap();
        agree(&plan, &orientations(), 40_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn sharp_points_and_tools_without_symmetry_agree() {
    let obstacle = scattered(grid(3.0, [12, 15, 14]));
    let points = |point: [f64; 3]| SharpPoints::Points(vec![point.into()]);
    for tool in [
        with_sharp_points(SharpPoints::Cutter(5)),
        with_sharp_points(SharpPoints::Boundary(None)),
        with_sharp_points(points([1.0, 0.0, 3.0])),
        wedge(),
        Tool { sharp_points: points([4.0, 0.5, 1.0]), ..wedge() },
    ] {
        let plan = SectionPlan::new(&obstacle, &tool, ToolPoints::SharpPoints).unwrap();
        let device = open();
        let device = GpuSections::new(&device, &plan).unwrap();
        assert_eq!(device.keeps_minimum(), tool.sharp_points == SharpPoints::Tip);
        let mut orientations = orientations();
        orientations.iter_mut().zip([0.0, 30.0, 77.0]).for_each(|(o, roll)| o.roll = roll);
        agree(&plan, &orientations, 40_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn query_grids_inside_across_and_beside_the_obstacle_agree() {
    let obstacle = scattered(grid(4.0, [14, 20, 37]));
    for (offset, dims) in [
        ([3, 4, 5], [6, 7, 9]),
        ([-5, 10, 30], [9, 20, 20]),
        ([20, -30, 2], [5, 21, 8]),
        ([0, 0, -60], [7, 4, 33]),
        ([-40, -40, -40], [90, 6, 5]),
        ([400, 0, 0], [3, 3, 3]),
    ] {
        let mut query = grid(4.0, dims);
        for axis in 0..3 {
            query.origin[axis] += 4.0 * f64::from(offset[axis]);
        }
        let plan =
            SectionPlan::with_query(&obstacle, Tool::paper(), ToolPoints::SharpPoints, &query).unwrap();
        agree(&plan, &orientations(), 40_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn a_layer_that_only_the_cutter_may_enter_is_counted_for_the_rest() {
    let grid = grid(3.0, [14, 13, 15]);
    let inside = |index: usize, from: usize, to: usize| {
        u8::from(grid.voxel(index).iter().all(|voxel| (from..to).contains(voxel)))
    };
    let part = Occupancy { grid, solid: (0..grid.len()).map(|i| inside(i, 2, 11)).collect() };
    let fixtures = Occupancy { grid, solid: (0..grid.len()).map(|i| inside(i, 10, 13)).collect() };
    let fixtures = vec![("clamp".into(), fixtures)];
    let bodies = Bodies { part, fixtures, undecided: 0.0, fixtures_undecided: vec![0.0] };
    let obstacle = Obstacle::with_cuttable(&bodies.obstacle(), bodies.layer(4.0));
    assert!(obstacle.forbidden.count() > 0 && obstacle.cuttable.as_ref().unwrap().count() > 0);
    for sharp_points in [SharpPoints::Tip, SharpPoints::Points(vec![[1.0, 0.0, 3.0].into()])] {
        let tool = with_sharp_points(sharp_points);
        // A holder so thin that it holds no voxel centre when it stands askew.
        let ToolShape::Revolved(elements) = &tool.shape else {
            unreachable!("the paper's tool has elements")
        };
        let of = |elements: Vec<Element>| Tool { shape: ToolShape::Revolved(elements), ..tool.clone() };
        let segment = Segment::Line { from: 35.0, to: 36.0, radius_from: 0.4, radius_to: 0.4 };
        let holder = Element { kind: ElementKind::Holder(0), profile: vec![segment] };
        let cutter = Element { kind: ElementKind::Cutter, ..elements[0].clone() };
        let thin = of(vec![holder.clone()]);
        let pitch = grid.pitch;
        let holds = |o: &Orientation| ToolVoxels::new(&thin, o, pitch).is_ok();
        assert!(!orientations().iter().all(holds), "thin in some orientation");
        for tool in [tool.clone(), of(vec![cutter.clone(), holder])] {
            let plan = SectionPlan::new(&obstacle, &tool, ToolPoints::SharpPoints).unwrap();
            assert!(plan.has_layer());
            assert!(!GpuSections::new(&open(), &plan).unwrap().keeps_minimum());
            agree(&plan, &orientations(), 40_000).unwrap();
        }
        // A tool that is all cutter: nothing of it must stay out of the layer.
        let plan = SectionPlan::new(&obstacle, of(vec![cutter]), ToolPoints::SharpPoints).unwrap();
        assert!(!plan.has_layer());
        agree(&plan, &orientations(), 40_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn nothing_and_everything_solid_agree() {
    let grid = grid(4.0, [9, 14, 12]);
    for obstacle in [Occupancy::empty(grid), Occupancy { grid, solid: vec![1; grid.len()] }] {
        let plan = SectionPlan::new(&obstacle, Tool::paper(), ToolPoints::SharpPoints).unwrap();
        agree(&plan, &orientations(), 40_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn the_reference_parts_agree() {
    for part in [ReferencePart::Teapot, ReferencePart::ScrewGear, ReferencePart::Bracket] {
        // The tool in the proportion that it has to the teapot, at a third of the resolution.
        let mut mesh = part.mesh();
        let (lower, upper) = mesh.bounds().unwrap();
        let scale = 121.0 / (upper - lower).max_element();
        mesh.vertices.iter_mut().for_each(|vertex| *vertex *= scale);
        let pitch = 3.0;
        let dims = (scale * (upper - lower) / pitch).ceil().to_array().map(|n| n as usize);
        let obstacle = voxelize(&mesh, &Grid { origin: scale * lower, pitch, dims }, false);
        let plan = SectionPlan::new(&obstacle, Tool::paper(), ToolPoints::SharpPoints).unwrap();
        agree(&plan, &OrientationSet::parse("fibonacci:40").unwrap().orientations, 600_000).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn limits_and_cancellation_are_reported() {
    let plan =
        SectionPlan::new(scattered(grid(4.0, [13, 11, 17])), Tool::paper(), ToolPoints::SharpPoints).unwrap();
    let gpu = open();
    let tiny = GpuLimits { storage_binding: 1024, buffer: 1 << 30, workgroups: 3 };
    let message = GpuSections::new(&gpu.clone().with_limits(tiny), &plan).err().unwrap().to_string();
    assert!(message.contains("on the CPU"), "{message}");

    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control { progress: &|_| {}, cancelled: &stop };
    let mut device = GpuSections::new(&gpu, &plan).unwrap();
    let cancelled = |result: Result<(), GpuSectionError>| {
        matches!(result, Err(GpuSectionError::Section(SectionError::Cancelled(_))))
    };
    assert!(cancelled(device.imf(&orientations(), control).map(|_| ())));
    assert!(cancelled(device.stream(&orientations(), control, || (), |(), _, _| {}).map(|_| ())));
    assert!(device.stream(&[], Control::quiet(), || (), |(), _, _| {}).unwrap().is_empty());
}
