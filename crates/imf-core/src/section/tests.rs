use super::overlap::Estimate;
use super::test_shapes::{archs, cmf, counts, cylinder, orientations, scattered};
use super::*;
use crate::control::Control;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::tool::{SharpPoints, ToolShape};

const DIMS: [usize; 3] = [13, 11, 17];
/// Three-dimensional and one voxel thick.
const SHAPES: [[usize; 3]; 3] = [DIMS, [1, 13, 11], [10, 12, 1]];

fn plan(obstacle: &Occupancy, tool: &Tool, method: Method) -> SectionPlan {
    SectionPlan::new(obstacle, tool, ToolPoints::SharpPoints).unwrap().with_method(method)
}

/// Sections by every method and every instruction set are direct sums.
fn every_method_counts_like_direct(obstacle: &Occupancy, tool: &Tool, orientations: &[Orientation]) {
    for (method, arch) in
        archs().into_iter().flat_map(|arch| [(Method::Fft, arch), (Method::RunLength, arch)])
    {
        let mut plan = plan(obstacle, tool, method);
        plan.whole.arch = arch;
        orientations.iter().for_each(|o| _ = counts_equal_direct(&plan, o, 1));
        // Transforms were exact: nothing was counted anew.
        assert_eq!(plan.whole.run_length.get().is_some(), method == Method::RunLength);
    }
}

/// Every `step`-th count is the direct sum; all of them.
fn counts_equal_direct(plan: &SectionPlan, orientation: &Orientation, step: usize) -> Vec<u32> {
    let rotated = ToolVoxels::new(plan.tool(), orientation, plan.grid().pitch).unwrap();
    let (counts, _) = counts(plan, orientation);
    for (index, &count) in counts.iter().enumerate().step_by(step) {
        let voxel = plan.grid().voxel(index).map(|v| v as i64);
        let expected = direct_count(&plan.obstacle().forbidden, &rotated, voxel);
        assert_eq!(count, expected, "{:?} {orientation:?} {voxel:?}", plan.whole.method);
    }
    counts
}

/// Every `step`-th value is the direct measure.
fn cmf_equals_direct(plan: &SectionPlan, orientation: &Orientation, step: usize) {
    for (index, value) in cmf(plan, orientation).into_iter().enumerate().step_by(step) {
        let voxel = plan.grid().voxel(index);
        let expected = direct_cmf(&plan.obstacle().forbidden, plan.tool(), orientation, voxel).unwrap();
        let case = format_args!("{:?} {orientation:?} {voxel:?}", plan.grid().dims);
        assert!((f64::from(value) - expected).abs() < 1e-6, "{case}: {value} {expected}");
    }
}

#[test]
fn counts_are_direct_sums_for_tools_smaller_and_larger_than_the_grid() {
    let mut set = orientations("random:6:1");
    set.extend(orientations("0,0;0,180;90,90;45,45"));
    for tool in [cylinder(2.0, 6.0), cylinder(4.0, 45.0), cylinder(0.6, 1.0), cylinder(30.0, 50.0)] {
        for dims in [DIMS, [1, 5, 2], [1, 1, 1], [3, 1, 40]] {
            every_method_counts_like_direct(&scattered(dims, 1), &tool, &set);
        }
    }
}

#[test]
fn lines_without_anything_solid_are_passed_over_rightly() {
    let set = orientations("random:8:5");
    // Solid voxels in a few lines only, and none at all.
    let mut obstacle = scattered([9, 14, 12], 1);
    for (index, solid) in obstacle.solid.iter_mut().enumerate() {
        let (x, y) = (index / (14 * 12), index / 12 % 14);
        *solid &= u8::from((x + 3 * y) % 7 == 2 && x != 4);
    }
    let (tool, empty) = (cylinder(3.3, 8.0), Occupancy::empty(obstacle.grid));
    every_method_counts_like_direct(&obstacle, &tool, &set);
    every_method_counts_like_direct(&empty, &tool, &set[..2]);
}

#[test]
fn runs_and_counts_beyond_a_byte_and_beyond_sixteen_bits_are_exact() {
    // Everything solid: a run of 300 voxels, and a tool of more than 65,535.
    let solid = |dims| {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims };
        Occupancy { grid, solid: vec![1; grid.len()] }
    };
    let set = orientations("0,0;0,180;90,90;31,62");
    every_method_counts_like_direct(&solid([3, 2, 300]), &cylinder(4.0, 320.0), &set);

    let (obstacle, tool) = (solid([64, 50, 50]), cylinder(60.0, 70.0));
    for method in [Method::RunLength, Method::Fft] {
        let counts = counts_equal_direct(&plan(&obstacle, &tool, method), &set[3], 1_371);
        assert!(counts.iter().any(|&count| count > 70_000));
    }
}

#[test]
fn mesh_tools_with_holes_and_sharp_points_off_the_grid_are_direct_sums() {
    // Two boxes apart from each other: two runs on a line.
    let mut mesh = Mesh::cuboid(DVec3::new(-1.2, -2.1, 0.2), DVec3::new(2.3, 1.7, 3.4));
    mesh.append(&Mesh::cuboid(DVec3::splat(5.1), DVec3::splat(8.8)));
    let tool = Tool {
        shape: ToolShape::Mesh(mesh),
        sharp_points: SharpPoints::Points(vec![DVec3::new(-4.2, 6.1, -3.3), DVec3::new(0.5, 0.0, 9.0)]),
        ..cylinder(1.0, 1.0)
    };
    let mut set = orientations("random:4:2");
    set.push(Orientation { theta: 10.0, phi: 140.0, roll: 77.0 });
    let obstacle = scattered([8, 7, 9], 1);
    every_method_counts_like_direct(&obstacle, &tool, &set);
    for method in [Method::RunLength, Method::Fft, Method::Fastest] {
        let plan = plan(&obstacle, &tool, method);
        set.iter().for_each(|orientation| cmf_equals_direct(&plan, orientation, 5));
    }
}

#[test]
fn the_estimate_prefers_run_lengths_for_slender_tools_and_transforms_for_fat_ones() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [58, 76, 121] };
    let obstacle = Occupancy { grid, solid: vec![1; grid.len()] };
    let plan = SectionPlan::new(&obstacle, Tool::paper(), ToolPoints::SharpPoints).unwrap();
    assert!(plan.describe().starts_with("run-length counting ("), "{}", plan.describe());
    let slow = plan.whole.describe(Estimate { run_length: 2.0, fft: 1.0 });
    assert!(slow.starts_with("real FFT 120×160×210"), "{slow}");
    assert!(plan.with_method(Method::Fft).describe().starts_with("real FFT"));
}

#[test]
fn many_sharp_points_are_read_by_boxes_and_stay_the_minimum_of_all() {
    // More and wider than a box of points, on a grid that is narrower than one along an axis.
    for dims in [[17, 9, 14], [6, 18, 3]] {
        for radius in [1.4, 3.2] {
            let tool = Tool { sharp_points: SharpPoints::Boundary(None), ..cylinder(radius, 19.0) };
            let plan = plan(&scattered(dims, 3), &tool, Method::Fastest);
            for orientation in orientations("fibonacci:5+axes") {
                cmf_equals_direct(&plan, &orientation, 37);
            }
        }
    }
}

#[test]
fn sharp_points_are_read_by_trilinear_means() {
    let few = SharpPoints::Points(vec![DVec3::new(1.3, -0.4, 0.7), DVec3::ZERO, DVec3::new(-0.6, 1.1, 2.9)]);
    let mut set = orientations("0,0;20,50;110,130;0,90");
    set.extend(orientations("random:2:1"));
    for dims in SHAPES {
        for (sharp_points, step) in
            [(few.clone(), 1), (SharpPoints::Boundary(None), 7), (SharpPoints::Cutter(12), 5)]
        {
            let tool = Tool { sharp_points, ..cylinder(2.5, 7.0) };
            let plan = plan(&scattered(dims, 1), &tool, Method::Fastest);
            set.iter().for_each(|o| cmf_equals_direct(&plan, o, step));
        }
    }
}

#[test]
fn rounding_of_a_rotation_makes_no_neighbour_count() {
    // At φ = 60° half of a height of 2 is a whole voxel, but for a last bit.
    let sharp = DVec3::new(0.0, 0.0, 2.0);
    let tool = Tool { sharp_points: SharpPoints::Points(vec![sharp]), ..cylinder(0.4, 4.5) };
    let orientation = Orientation::new(0.0, 60.0);
    let z = (orientation.rotation() * sharp).z;
    assert!(z != 1.0 && (z - 1.0).abs() < 1e-9, "{z:e}");
    let cmf = cmf(&plan(&scattered(DIMS, 1), &tool, Method::Fastest), &orientation);
    let minimum = cmf.iter().copied().filter(|&value| value > 0.0).fold(f32::INFINITY, f32::min);
    // The smallest fraction of a voxel that a trilinear mean can have here is that of the one fraction, along x.
    assert!(minimum > 1e-3, "{minimum:e}");
    assert!(cmf.contains(&0.0));
}

#[test]
fn a_box_of_voxels_under_a_one_voxel_line_is_counted_in_closed_form() {
    // A line of 5 voxels going up over a block that fills z < 4: overlap = clamp(4 − z, 0, 5).
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4, 4, 8] };
    let plan = plan(&Occupancy::of(grid, |[_, _, z]| z < 4), &cylinder(0.4, 4.5), Method::Fastest);
    for (index, value) in cmf(&plan, &Orientation::default()).into_iter().enumerate() {
        assert_eq!(value, (4usize.saturating_sub(index % 8)) as f32 / 5.0);
    }
}

#[test]
fn the_imf_is_the_minimum_section_with_the_first_index_at_a_tie_and_falls_with_more_orientations() {
    let mut set = orientations("fibonacci:9");
    set.extend(set.clone());
    for (dims, threads) in SHAPES.into_iter().flat_map(|dims| [(dims, 1), (dims, 3)]) {
        let plan = plan(&scattered(dims, 1), &cylinder(2.0, 6.0), Method::Fastest);
        let all = sections(&plan, &set, Control::quiet()).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let result = pool.install(|| imf(&plan, &set, Control::quiet())).unwrap();
        let part = imf(&plan, &set[..5], Control::quiet()).unwrap();
        for voxel in 0..plan.grid().len() {
            let mut expected = (f32::INFINITY, u32::MAX);
            for (index, section) in all.iter().enumerate() {
                if section[voxel] < expected.0 {
                    expected = (section[voxel], index as u32);
                }
            }
            assert_eq!((result.value[voxel], result.best[voxel]), expected);
            assert!(result.value[voxel] <= part.value[voxel]);
        }
    }
}

#[test]
fn cancelling_stops_the_stream() {
    let plan = plan(&scattered(DIMS, 1), &cylinder(2.0, 6.0), Method::Fastest);
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control { progress: &|_| {}, cancelled: &stop };
    assert!(matches!(imf(&plan, &orientations("fibonacci:9"), control), Err(SectionError::Cancelled(_))));
}

#[test]
fn the_papers_scene_takes_little_memory() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [58, 76, 121] };
    // Copies of the obstacle of 1.2 MB, and about 19 MB a thread.
    let estimate = SectionPlan::memory_estimate(&grid, &Tool::paper(), 2) as f64 / 1e6;
    assert!((10.0..100.0).contains(&estimate), "{estimate} MB");
}

#[test]
fn transforms_of_large_and_ragged_obstacles_are_exact() {
    // Half of all voxels at random: more run boundaries than any part has.
    let obstacle = scattered([90, 75, 110], 2);
    let tool = cylinder(21.0, 80.0);
    let [by_fft, by_runs] = [Method::Fft, Method::RunLength].map(|method| plan(&obstacle, &tool, method));
    for orientation in orientations("0,0;90,0;33,71") {
        assert_eq!(counts(&by_fft, &orientation), counts(&by_runs, &orientation));
    }
    assert!(by_fft.whole.run_length.get().is_none());
}

#[test]
fn a_query_grid_of_its_own_sees_the_whole_obstacle() {
    let obstacle = scattered(DIMS, 1);
    let points = SharpPoints::Points(vec![DVec3::new(0.3, -0.4, 0.7)]);
    let sharp = Tool { sharp_points: points, ..cylinder(1.5, 5.0) };
    // Within, sticking out on one side, around it all, and beside it: nearer and farther than the tool reaches.
    let grids = [
        ([-4, -3, -6], [-5, -4, -7]),
        ([3, -2, 4], [-9, -6, 0]),
        ([5, 6, 7], [8, 4, 3]),
        ([-15, 0, 0], [9, 0, 0]),
        ([0, 0, 60], [0, 0, -70]),
        // Longer than the circle of transforms would have to be.
        ([12; 3], [12; 3]),
    ];
    for (before, after) in grids {
        let query = obstacle.grid.padded(before, after).unwrap();
        // The same obstacle on a grid that holds the query grid too, where the definition reads every voxel.
        let all = obstacle.grid.padded(before.map(|b| b.max(0)), after.map(|a| a.max(0))).unwrap();
        let (whole, shift) = (obstacle.on(&all).unwrap(), all.offset_of(&query).unwrap());
        for tool in [&cylinder(2.0, 9.0), &sharp] {
            let plan = || SectionPlan::with_query(&obstacle, tool, ToolPoints::SharpPoints, &query).unwrap();
            let by_one_method = [Method::RunLength, Method::Fft].map(|method| plan().with_method(method));
            let plan = plan();
            for orientation in orientations("random:3:8") {
                let (counts, total) = counts(&plan, &orientation);
                for plan in &by_one_method {
                    assert_eq!(test_shapes::counts(plan, &orientation), (counts.clone(), total));
                }
                let cmf = cmf(&plan, &orientation);
                let rotated = ToolVoxels::new(tool, &orientation, 1.0).unwrap();
                assert_eq!(total, rotated.count);
                for index in 0..query.len() {
                    let voxel = query.voxel(index);
                    let voxel = [0, 1, 2].map(|axis| voxel[axis] as i64 + shift[axis]);
                    assert_eq!(counts[index], direct_count(&whole, &rotated, voxel), "{voxel:?}");
                    let voxel = voxel.map(|v| v as usize);
                    let expected = direct_cmf(&whole, tool, &orientation, voxel).unwrap();
                    assert!((f64::from(cmf[index]) - expected).abs() < 1e-6);
                }
            }
        }
    }
    let moved = Grid { origin: obstacle.grid.origin + 0.5, ..obstacle.grid };
    let refusal = SectionPlan::with_query(&obstacle, &sharp, ToolPoints::SharpPoints, &moved).err().unwrap();
    assert!(refusal.to_string().contains("whole voxels"), "{refusal}");
}

#[test]
fn a_window_of_the_plans_grid_has_its_counts() {
    let obstacle = scattered(DIMS, 1);
    let query = obstacle.grid.padded([9, 8, 10], [8, 9, 11]).unwrap();
    let cases = [([-12, -3, -20], [-5, -20, -4]), ([0; 3], [0; 3]), ([0, -27, 0], [-29, 0, 0])];
    for tool in [cylinder(2.0, 9.0), cylinder(1.5, 30.0)] {
        for method in [Method::RunLength, Method::Fft, Method::Fastest] {
            let plan = SectionPlan::with_query(&obstacle, &tool, ToolPoints::SharpPoints, &query).unwrap();
            let (plan, mut scratch) = (plan.with_method(method), SectionScratch::default());
            for orientation in orientations("random:4:8") {
                let (all, total) = counts(&plan, &orientation);
                for (before, after) in cases {
                    let window = query.padded(before, after).unwrap();
                    let (whole, counts) = plan.counts_in(&orientation, &window, &mut scratch).unwrap();
                    assert_eq!((whole, counts.len()), (total, window.len()));
                    for (index, &count) in counts.iter().enumerate() {
                        let voxel = window.voxel(index);
                        let voxel = [0, 1, 2].map(|a| (voxel[a] as i64 - before[a]) as usize);
                        assert_eq!(count, all[query.index(voxel)], "{method:?} {voxel:?}");
                    }
                }
            }
            assert!(method != Method::Fft || plan.whole.run_length.get().is_none(), "transforms alone");
        }
    }
}
