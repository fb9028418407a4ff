//! Against counted poses in many directions, and closed forms.

use super::*;
use crate::field::ExactField;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::section::test_shapes::{arc, line, orientations, revolved};
use crate::tool::{Clearance, ElementKind};

/// A ball end of radius 2 and 8 long, a shank, and a holder that is wider.
fn mill() -> Tool {
    revolved([
        (ElementKind::Cutter, vec![arc(0.0, 2.0, 2.0, 0.0, 2.0), line(2.0, 8.0, 2.0, 2.0)]),
        (ElementKind::Shank, vec![line(8.0, 14.0, 2.0, 2.0)]),
        (ElementKind::Holder(0), vec![line(14.0, 24.0, 5.0, 6.0)]),
    ])
}

/// Voxels of 0.5 of a world in which something is solid.
fn voxels(size: f64, is_solid: impl Fn(DVec3) -> bool) -> Occupancy {
    let dims = [(size / 0.5) as usize; 3];
    let grid = Grid { origin: DVec3::splat(-0.5 * size), pitch: 0.5, dims };
    Occupancy::of(grid, |voxel| is_solid(grid.centre(voxel)))
}

fn empty(solid: &Occupancy) -> Vec<usize> {
    (0..solid.solid.len()).filter(|&index| solid.solid[index] == 0).collect()
}

/// Holds every answer against counts, and gives how many points are reached, out of reach, and open.
fn counted(obstacle: &Obstacle, assembly: &Assembly, points: &[usize], directions: &str) -> [usize; 3] {
    let grid = *obstacle.grid();
    let found = certify(obstacle, assembly, &grid, points, Control::quiet()).unwrap();
    let exact = ExactField::new(obstacle, assembly.clone()).unwrap();
    let set = orientations(directions);
    let mut numbers = [0; 3];
    for (&point, found) in points.iter().zip(&found) {
        let tip = grid.centre(grid.voxel(point));
        match found {
            Reachability::Reached(axis) => {
                assert!(!exact.collides(&Pose::along(tip, *axis)), "{tip} {axis}");
                numbers[0] += 1;
            }
            Reachability::OutOfReach => {
                let free = set.iter().map(Orientation::direction);
                let free = free.filter(|axis| !exact.collides(&Pose::along(tip, *axis))).count();
                assert_eq!(free, 0, "{tip}");
                numbers[1] += 1;
            }
            Reachability::Open => numbers[2] += 1,
        }
    }
    numbers
}

#[test]
fn nothing_that_is_proven_is_contradicted_by_counts() {
    // A block with a slot of 5 and one of 3, the second under a roof, and a loose bar above.
    let solid = voxels(26.0, |p| {
        let block = p.z < 2.0 && p.x.abs() < 11.0;
        let slot = (p.x + 5.0).abs() < 2.5 && p.z > -6.0;
        let narrow = (p.x - 4.0).abs() < 1.5 && p.z > -5.0 && p.z < 0.0;
        let bar = p.x.abs() < 1.0 && (p.z - 7.0).abs() < 1.0;
        block && !slot && !narrow || bar
    });
    let points: Vec<usize> = empty(&solid).into_iter().step_by(7).collect();
    for clearance in [0.0, 0.7] {
        let assembly = mill().offset(&Clearance { holder: clearance, ..Clearance::default() }).unwrap();
        let [reached, out, open] =
            counted(&solid.clone().into(), &assembly, &points, "fibonacci:900+random:600:3");
        assert!(reached > 1_000 && out > 500, "{reached} {out} {open}");
        assert!(open * 200 < points.len(), "{open} of {}", points.len());
    }
    // A layer that the cutter may enter, and shank and holder may not.
    let deep = crate::distance::deeper_than(&solid, 0.25);
    let mut layer = solid.clone();
    layer.solid.iter_mut().zip(&deep.solid).for_each(|(all, deep)| *all -= deep);
    let obstacle = Obstacle::with_cuttable(&solid, layer);
    let assembly = mill().offset(&Clearance::default()).unwrap();
    let some: Vec<usize> = points.iter().copied().step_by(3).collect();
    let [reached, out, open] = counted(&obstacle, &assembly, &some, "fibonacci:900");
    assert!(reached > 300 && out > 30 && open * 100 < some.len(), "{reached} {out} {open}");
}

#[test]
fn a_hole_is_reached_as_deep_as_it_is_wide_enough() {
    // A block of 20 with a round hole through its top: at its middle the tool stands upright or not at all.
    let rod = |radius: f64| revolved([(ElementKind::Cutter, vec![line(0.0, 24.0, radius, radius)])]);
    let hole = |radius: f64| {
        voxels(24.0, |p| p.abs().max_element() < 10.0 && (p.z < -6.0 || p.truncate().length() > radius))
    };
    let assembly = |radius| rod(radius).offset(&Clearance::default()).unwrap();
    for (radius, of_hole, is_reached) in
        [(2.0, 2.6, true), (2.9, 2.5, false), (1.0, 4.0, true), (4.4, 4.0, false)]
    {
        let solid = hole(of_hole);
        let grid = solid.grid;
        let middle = grid.index([24, 24, 13]);
        assert_eq!(solid.solid[middle], 0);
        let found = certify(&solid.into(), &assembly(radius), &grid, &[middle], Control::quiet()).unwrap();
        match found[0] {
            Reachability::Reached(axis) => assert!(is_reached && axis.z > 0.8, "{radius} {axis}"),
            Reachability::OutOfReach => assert!(!is_reached, "{radius}"),
            Reachability::Open => panic!("{radius} in {of_hole} is open"),
        }
    }
    // Far from everything each direction is free, and inside a closed shell none is.
    let shell = voxels(24.0, |p| (8.0..11.0).contains(&p.length()));
    let grid = shell.grid;
    let points = [grid.index([24; 3]), grid.index([0; 3])];
    let found = certify(&shell.into(), &assembly(1.0), &grid, &points, Control::quiet()).unwrap();
    assert!(matches!(found[..], [Reachability::OutOfReach, Reachability::Reached(_)]), "{found:?}");
}

#[test]
fn caps_are_those_of_the_outline() {
    let bodies = |tool: &Tool| {
        let ToolShape::Revolved(elements) = &tool.shape else { panic!("no mesh") };
        joined(elements)
    };
    // A cylinder blocks up to asin(r/ρ) beyond its radius, and a right angle within.
    let rod = bodies(&revolved([(ElementKind::Cutter, vec![line(0.0, 20.0, 3.0, 3.0)])]));
    for distance in [4.0, 9.0, 19.0] {
        let found = blocked_angle(&rod, distance, 1.0).unwrap();
        let expected = (3.0_f64 / distance).asin();
        assert!(found <= expected && found > expected - 2e-3, "{distance} {found} {expected}");
    }
    assert!(blocked_angle(&rod, 20.5, 1.0).is_none());
    // A ball end from its tip: acos(ρ/2r) while that is in the ball.
    let mill = bodies(&mill());
    let found = blocked_angle(&mill, 2.0, 1.0).unwrap();
    assert!(found <= 60_f64.to_radians() && found > 59.7_f64.to_radians(), "{}", found.to_degrees());
    // Cutter and shank are one; the holder's lower face ends what its width blocks.
    let found = blocked_angle(&mill, 14.05, 1.0).unwrap();
    let expected = (2.0_f64 / 14.05).asin();
    assert!(found <= expected + 0.05 && found > expected - 2e-3, "{found} {expected}");
    // No angle blocks more than the predicate does.
    for distance in 1..24 {
        let distance = f64::from(distance);
        let Some(angle) = blocked_angle(&mill, distance, 1.0) else { continue };
        for step in 0..=200 {
            let at = angle * f64::from(step) / 200.0;
            let point = DVec3::new(distance * at.sin(), 0.0, distance * at.cos());
            assert!(mill.iter().any(|body| contains(&body.profile, DVec3::Z, point, 0.0)), "{distance} {at}");
        }
    }
}

#[test]
fn tools_that_nothing_is_proven_of_are_refused() {
    let solid = voxels(8.0, |p| p.z < 0.0);
    let grid = solid.grid;
    let sharp = Tool { sharp_points: SharpPoints::Boundary(None), ..mill() };
    let assembly = sharp.offset(&Clearance::default()).unwrap();
    let found = certify(&(&solid).into(), &assembly, &grid, &[0], Control::quiet());
    assert!(found.unwrap_err().to_string().contains("only sharp point"));
    let other = Grid { origin: grid.origin + 0.2, ..grid };
    let assembly = mill().offset(&Clearance::default()).unwrap();
    assert_eq!(
        certify(&solid.into(), &assembly, &other, &[0], Control::quiet()),
        Err(CertificateError::Grid)
    );
}

#[test]
#[should_panic(expected = "the grid has no voxel 64")]
fn a_voxel_that_the_grid_has_not_is_refused() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4; 3] };
    let solid = Occupancy { grid, solid: vec![0; grid.len()] };
    let assembly = mill().offset(&Clearance::default()).unwrap();
    let _ = certify(&(&solid).into(), &assembly, &grid, &[grid.len()], Control::quiet());
}
