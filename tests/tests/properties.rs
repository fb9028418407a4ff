//! Properties that the exact field must have whatever the shapes are: what the mathematics says, on random cases.

use glam::{DMat4, DVec3};
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{SectionPlan, SectionScratch, ToolPoints};
use imf_core::tool::{ElementKind, Segment, SharpPoints, Tool, ToolShape};
use imf_core::voxelize::voxelize;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random blobs: some boxes and scattered voxels.
fn obstacle(random: &mut ChaCha8Rng, dims: [usize; 3], pitch: f64) -> Occupancy {
    let origin = DVec3::from_array([(); 3].map(|()| random.random_range(-5.0..5.0)));
    let mut occupancy = Occupancy::empty(Grid { origin, pitch, dims });
    for _ in 0..3 {
        let low = dims.map(|d| random.random_range(0..d));
        let high = [0, 1, 2].map(|a| (low[a] + 1 + random.random_range(0..dims[a])).min(dims[a]));
        for x in low[0]..high[0] {
            for y in low[1]..high[1] {
                for z in low[2]..high[2] {
                    let index = occupancy.grid.index([x, y, z]);
                    occupancy.solid[index] = u8::from(random.random_range(0..4) > 0);
                }
            }
        }
    }
    occupancy
}

/// A cutter, a conical shank and a holder of random sizes, tip as the only sharp point.
fn tool(random: &mut ChaCha8Rng) -> Tool {
    let (r, l) = (random.random_range(0.6..1.6), random.random_range(2.0..5.0));
    let wide = random.random_range(1.5..3.0);
    let cone = Segment::Line { from: l, to: l + 1.5, radius_from: r, radius_to: wide };
    let elements = [
        (ElementKind::Cutter, vec![Segment::cylinder(0.0, l, r)]),
        (ElementKind::Shank, vec![cone]),
        (ElementKind::Holder(0), vec![Segment::cylinder(l + 1.5, l + 4.0, wide)]),
    ];
    Tool::revolved("random", elements)
}

fn axes(spec: &str) -> Vec<Orientation> {
    OrientationSet::parse(spec).expect("a sound case").orientations
}

fn cmf(obstacle: &Occupancy, query: &Grid, tool: &Tool, orientation: &Orientation) -> Vec<f32> {
    let plan = SectionPlan::with_query(obstacle, tool, ToolPoints::SharpPoints, query).expect("a sound case");
    let mut values = vec![f32::NAN; query.len()];
    plan.cmf(orientation, &mut SectionScratch::default(), &mut values).expect("a sound case");
    values
}

/// Three-dimensional and one voxel thick.
const SHAPES: [[usize; 3]; 3] = [[12, 9, 14], [1, 13, 11], [10, 12, 1]];

#[test]
fn moving_the_obstacle_moves_the_field() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for dims in SHAPES {
        let (solid, tool) = (obstacle(&mut random, dims, 1.0), tool(&mut random));
        let query = solid.grid.padded([2; 3], [3; 3]).unwrap();
        let shift = DVec3::new(3.0, -2.0, 5.0);
        let moved = |grid: Grid| Grid { origin: grid.origin + shift, ..grid };
        let other = Occupancy { grid: moved(solid.grid), solid: solid.solid.clone() };
        // The same place in the world, other voxels of the query grid.
        let wide = moved(query).padded([4; 3], [6; 3]).unwrap();
        for orientation in axes("random:4:3") {
            let here = cmf(&solid, &query, &tool, &orientation);
            assert_eq!(here, cmf(&other, &moved(query), &tool, &orientation));
            let there = cmf(&other, &wide, &tool, &orientation);
            for (index, &value) in here.iter().enumerate() {
                assert_eq!(value, there[wide.index(query.voxel(index).map(|v| v + 4))]);
            }
        }
    }
}

#[test]
fn a_tool_of_revolution_is_the_same_at_every_roll() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for dims in SHAPES {
        let (solid, mut tool) = (obstacle(&mut random, dims, 0.8), tool(&mut random));
        // Rings of sharp points are whole only in the limit, so the axis' own points.
        tool.sharp_points = SharpPoints::Points(vec![DVec3::ZERO, DVec3::new(0.0, 0.0, 1.3)]);
        for direction in axes("random:3:5").into_iter().chain(axes("0,0;90,90;0,180")) {
            let upright = cmf(&solid, &solid.grid, &tool, &direction);
            for roll in [37.0, 90.0, 180.0, 271.5] {
                assert_eq!(upright, cmf(&solid, &solid.grid, &tool, &Orientation { roll, ..direction }));
            }
        }
    }
}

#[test]
fn more_obstacle_never_lowers_the_field() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for dims in SHAPES {
        let (less, mut tool) = (obstacle(&mut random, dims, 1.0), tool(&mut random));
        tool.sharp_points = SharpPoints::Points(vec![DVec3::ZERO, DVec3::new(0.7, 0.2, 0.4)]);
        let mut more = less.clone();
        for _ in 0..40 {
            let index = random.random_range(0..more.grid.len());
            more.solid[index] = 1;
        }
        assert!(more.count() > less.count());
        for orientation in axes("random:5:1") {
            let (low, high) =
                (cmf(&less, &less.grid, &tool, &orientation), cmf(&more, &less.grid, &tool, &orientation));
            assert!(low.iter().zip(&high).all(|(a, b)| a <= b));
        }
    }
}

#[test]
fn a_buried_tool_overlaps_wholly_and_a_distant_one_not_at_all() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let grid = Grid { origin: DVec3::new(-3.0, 1.0, 0.0), pitch: 0.5, dims: [60; 3] };
    let full = Occupancy { grid, solid: vec![1; grid.len()] };
    for _ in 0..3 {
        let tool = tool(&mut random);
        let reach = (tool.reach() / grid.pitch).ceil() as i64 + 1;
        let inside = grid.padded([-reach; 3], [-reach; 3]).unwrap();
        let beside = grid.padded([-(60 + reach), 0, 0], [reach + 5, 0, 0]).unwrap();
        for orientation in axes("random:3:9") {
            assert!(cmf(&full, &inside, &tool, &orientation).iter().all(|&v| v == 1.0));
            assert!(cmf(&full, &beside, &tool, &orientation).iter().all(|&v| v == 0.0));
            let anywhere = cmf(&full, &grid, &tool, &orientation);
            assert!(anywhere.iter().all(|v| (0.0..=1.0).contains(v)));
        }
    }
}

/// Length of the overlap of [a, b) and [c, d) in whole voxels.
fn shared(a: i64, b: i64, c: i64, d: i64) -> i64 {
    (b.min(d) - a.max(c)).max(0)
}

#[test]
fn a_box_tool_and_a_box_part_overlap_in_a_box() {
    // Corners of the part in voxels of a grid of 20; the tool's corners relative to its tip, between voxel centres.
    let cases = [
        ([4, 5, 6], [11, 9, 15], [-2, -1, 0], [3, 2, 6]),
        ([0, 0, 0], [20, 20, 7], [-4, -3, -2], [1, 4, 9]),
        // One voxel thick, part and tool.
        ([10, 3, 2], [11, 12, 17], [0, -2, 0], [1, 3, 5]),
        ([2, 9, 9], [18, 10, 10], [-1, 0, 0], [4, 1, 1]),
    ];
    let pitch = 0.25;
    let grid = Grid { origin: DVec3::new(2.0, -1.0, 0.5), pitch, dims: [20; 3] };
    for (low, high, first, end) in cases {
        let world = |v: [i64; 3]| grid.origin + DVec3::from_array(v.map(|c| c as f64)) * pitch;
        let part = voxelize(&Mesh::cuboid(world(low), world(high)), &grid, false);
        // Faces half a voxel off the centres: offsets first … end − 1 lie inside.
        let corner = |v: [i64; 3]| (DVec3::from_array(v.map(|c| c as f64)) - 0.5) * pitch;
        let mesh = Mesh::cuboid(corner(first), corner(end));
        let tool = Tool { shape: ToolShape::Mesh(mesh), ..tool(&mut ChaCha8Rng::seed_from_u64(0)) };
        // Quarter turns carry the box's corners along.
        for orientation in axes("0,0;90,90;0,90;0,180;270,90") {
            let turn = DMat4::from_mat3(orientation.rotation());
            let ends = [first, end]
                .map(|v| turn.transform_point3(DVec3::from_array(v.map(|c| c as f64)) - 0.5) + 0.5);
            let (from, to) = (ends[0].min(ends[1]).round(), ends[0].max(ends[1]).round());
            let total: f64 = (to - from).element_product();
            let query = grid.padded([3, 0, 2], [1, 4, 0]).unwrap();
            for (index, &value) in cmf(&part, &query, &tool, &orientation).iter().enumerate() {
                let tip = query.voxel(index);
                let tip = [tip[0] as i64 - 3, tip[1] as i64, tip[2] as i64 - 2];
                let sides = [0, 1, 2]
                    .map(|a| shared(low[a], high[a], tip[a] + from[a] as i64, tip[a] + to[a] as i64));
                let expected = sides.iter().product::<i64>() as f64 / total;
                assert!(
                    (f64::from(value) - expected).abs() < 1e-7,
                    "{orientation:?} {tip:?}: {value} {expected}"
                );
            }
        }
    }
}
