//! Against counts of single poses, and against closed forms.

use std::f64::consts::PI;

use glam::{DMat4, DQuat, DVec2, DVec3};

use super::*;
use crate::access::tests::{slotted, small_tool};
use crate::mesh::Mesh;
use crate::orientation::OrientationSet;
use crate::parts::shell::{area, circle, pocketed, rectangle, rounded_rectangle};
use crate::section::direct_count;
use crate::section::test_shapes::{cylinder, orientations};
use crate::voxelize::voxelize;

#[test]
fn it_is_what_the_cutter_covers_at_free_poses_counted_one_by_one() {
    let mut obstacle = slotted();
    // A cavity that nothing reaches.
    let cavity = obstacle.grid.index([3, 3, 4]);
    obstacle.solid[cavity] = 0;
    let mut stock = Occupancy::empty(obstacle.grid.padded([0, 1, 0], [0, -2, 2]).unwrap());
    let there = obstacle.on(&stock.grid).unwrap();
    stock.solid.iter_mut().zip(&there.solid).for_each(|(s, &part)| *s = 1 - part);
    let set = orientations("0,0;40,25;200,90;0,180");
    let (tool, cutter) = (small_tool(), cutter_of(&small_tool()).unwrap());
    for tau in [0.0, 0.1] {
        let mut expected = vec![0u8; stock.grid.len()];
        let shift = obstacle.grid.offset_of(&stock.grid).unwrap();
        for orientation in &set {
            let whole = ToolVoxels::new(&tool, orientation, 1.0).unwrap();
            let body = ToolVoxels::new(&cutter, orientation, 1.0).unwrap();
            for index in stock.solids() {
                let voxel = stock.grid.voxel(index);
                // Every pose at which some voxel of the cutter lies on this voxel.
                let reaches = body.offsets().any(|own| {
                    let tip = [0, 1, 2].map(|a| voxel[a] as i64 + shift[a] - own[a]);
                    f64::from(direct_count(&obstacle, &whole, tip)) <= tau * f64::from(whole.count)
                });
                expected[index] |= u8::from(reaches);
            }
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found =
                pool.install(|| removable(&obstacle, &tool, &stock, &set, tau, Control::quiet()).unwrap());
            assert_eq!(found.covered, expected);
            assert!(found.covered.iter().zip(&found.possible).all(|(covered, possible)| covered <= possible));
            assert!(found.possible.iter().zip(&stock.solid).all(|(possible, stock)| possible <= stock));
            let thinned = Occupancy {
                grid: stock.grid,
                solid: stock.solid.iter().enumerate().map(|(i, &s)| s * u8::from(i % 3 != 1)).collect(),
            };
            let by_orientation = pool.install(|| {
                let control = Control::quiet();
                removable_by_orientation(&obstacle, &tool, &thinned, &set, tau, control).unwrap()
            });
            for (orientation, own) in set.iter().zip(&by_orientation) {
                let one = std::slice::from_ref(orientation);
                let alone = removable(&obstacle, &tool, &thinned, one, tau, Control::quiet()).unwrap();
                let voxels = |holds: &dyn Fn(usize) -> bool| -> Vec<u32> {
                    (0..stock.grid.len()).filter(|&i| holds(i)).map(|i| i as u32).collect()
                };
                assert_eq!(own.covered, voxels(&|i| alone.covered[i] == 1));
                assert_eq!(own.undecided, voxels(&|i| alone.possible[i] > alone.covered[i]));
            }
        }
        let count = expected.iter().map(|&v| usize::from(v)).sum::<usize>();
        assert!(count > 0 && (tau > 0.0 || count < stock.count()));
    }
}

/// What a mill of a radius leaves of the stock that `mesh` leaves of `whole`: least and most, as volumes.
fn left(mesh: &Mesh, whole: &Mesh, set: &[Orientation], radius: f64, pitch: f64) -> [f64; 2] {
    let (lower, upper) = whole.bounds().unwrap();
    let grid = Grid::with_pitch(lower, upper, pitch, 0).unwrap();
    let (part, mut stock) = (voxelize(mesh, &grid, false), voxelize(whole, &grid, false));
    stock.solid.iter_mut().zip(&part.solid).for_each(|(stock, &part)| *stock &= 1 - part);
    let tool = cylinder(radius, 40.0);
    let found = removable(&part, &tool, &stock, set, 0.0, Control::quiet()).unwrap();
    [&found.possible, &found.covered].map(|gone| {
        let left = stock.solid.iter().zip(gone).filter(|&(&stock, &gone)| stock > gone).count();
        left as f64 * grid.voxel_volume()
    })
}

/// A plate of 30 × 30 × 12 with a hole of depth 8, and the same without it.
fn plate(hole: &[DVec2]) -> [Mesh; 2] {
    let size = DVec3::new(30.0, 30.0, 12.0);
    [pocketed(size, hole, 8.0), Mesh::cuboid(DVec3::ZERO, size)]
}

/// What stays lies between both bounds, and their distance falls with the pitch.
fn converges(hole: &[DVec2], radius: f64, closed: f64) {
    let ([part, whole], down) = (plate(hole), orientations("0,0"));
    let bounds = [1.0, 0.5, 0.25].map(|pitch| left(&part, &whole, &down, radius, pitch));
    for [least, most] in bounds {
        assert!((least..=most).contains(&closed), "{closed}: {bounds:?}");
    }
    let apart = bounds.map(|[least, most]| most - least);
    assert!(apart[1] < 0.7 * apart[0] && apart[2] < 0.7 * apart[1], "{apart:?}");
}

#[test]
fn what_stays_of_holes_and_pockets_converges_to_the_closed_form() {
    let centre = DVec2::splat(15.0);
    // A hole wider than the mill is cleared, one that is narrower is not touched.
    converges(&circle(centre, 4.0, 64), 3.0, 0.0);
    let narrow = circle(centre, 4.0, 64);
    let volume = 8.0 * area(&narrow);
    let [part, whole] = plate(&narrow);
    let [least, most] = left(&part, &whole, &orientations("0,0"), 5.0, 0.25);
    assert!(least > 0.93 * volume && most > 0.97 * volume && most < 1.03 * volume, "{least} {most} {volume}");
    // A round corner of a pocket keeps what lies between its radius and a larger one of the mill.
    let corners = |corner: f64| (4.0 - PI) * (9.0 - corner * corner).max(0.0) * 8.0;
    let (lower, upper) = (DVec2::new(4.0, 6.0), DVec2::new(26.0, 24.0));
    converges(&rectangle([4.0, 26.0], [6.0, 24.0]), 3.0, corners(0.0));
    for corner in [1.5, 4.0] {
        converges(&rounded_rectangle(lower, upper, corner, 16), 3.0, corners(corner));
    }
}

#[test]
fn a_deep_hole_in_a_turned_block_is_cleared_along_the_axis_that_the_block_suggests() {
    let turn = DMat4::from_quat(DQuat::from_axis_angle(DVec3::new(2.0, 1.0, 0.5).normalize(), 0.6));
    let size = DVec3::new(12.0, 12.0, 40.0);
    let hole = circle(DVec2::splat(6.0), 4.0, 64);
    let volume = size.z * area(&hole);
    let bodies = [pocketed(size, &hole, size.z), Mesh::cuboid(DVec3::ZERO, size)];
    let [part, whole] = bodies.map(|mesh| mesh.transformed(&turn));
    let directions = || part.machining_directions().into_iter().map(|found| found.direction).collect();
    let set = OrientationSet::parse_for("axes+normals+fibonacci:20", directions).unwrap().orientations;
    let even = orientations("axes+fibonacci:20");
    let bounds = [1.0, 0.5].map(|pitch| left(&part, &whole, &set, 3.0, pitch));
    // None of it is out of reach, and what the pitch does not decide gets less.
    assert!(bounds.iter().all(|[least, _]| *least == 0.0), "{bounds:?}");
    let shares = bounds.map(|[_, most]| most / volume);
    assert!(shares[0] < 0.45 && shares[1] < 0.7 * shares[0], "{shares:?}");
    let [least, _] = left(&part, &whole, &even, 3.0, 1.0);
    assert!(least > 0.1 * volume, "{least} of {volume} without the hole's axis");
}

#[test]
fn the_largest_free_count_is_found_among_all_counts() {
    for whole in [1, 7, 1000] {
        for tau in [-1.0, 0.0, 1e-3, 0.07, 1.0 / 7.0, 0.5, 1.0, 3.0] {
            let share = 1.0 / f64::from(whole);
            let free = |&count: &u32| f64::from((share * f64::from(count)) as f32) <= tau;
            assert_eq!(most_free(whole, tau), (0..=whole).filter(free).max(), "{whole}, {tau}");
        }
    }
}

#[test]
fn a_mesh_has_no_cutter() {
    let tool = Tool { shape: ToolShape::Mesh(crate::mesh::tests::unit_cube()), ..small_tool() };
    assert!(cutter_of(&tool).is_err());
    let refusal = position_grid(&slotted().grid, &tool).unwrap_err();
    assert!(refusal.to_string().contains("no cutter"));
}
