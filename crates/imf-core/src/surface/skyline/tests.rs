//! The skyline against the solid that it is of.

use crate::grid::Grid;
use crate::section::test_shapes::{arc, line};
use crate::surface::skyline::*;

/// A cone, a collar that narrows again, a waist, and a round flange.
fn holder() -> Body {
    let round = arc(4.0, 7.0, 7.0, 3.0, 3.0);
    Body::new([line(-1.0, 2.0, 1.5, 3.5), line(2.0, 4.0, 3.5, 2.0), round].into_iter()).unwrap()
}

fn contains(body: &Body, height: f64, radius: f64) -> bool {
    body.segments.iter().any(|s| (s.range().0..s.range().1).contains(&height) && s.radius(height) >= radius)
}

#[test]
fn a_body_holds_points_down_to_where_it_is_narrower() {
    let body = holder();
    assert_eq!((body.lowest, body.highest, body.widest), (-1.0, 7.0, 6.0));
    // Height and radius, and how far down from there.
    let cases = [
        (3.0, 1.0, Some(-1.0)),
        (3.0, 2.5, Some(0.5)),
        (3.0, 3.0, None),
        (6.5, 4.0, Some(7.0 - 8.0f64.sqrt())),
        (6.5, 1.9, Some(-0.4)),
        // The waist is at 4, where the arc begins wider.
        (6.5, 2.5, Some(4.0)),
        (6.5, 6.01, None),
        (7.0, 1.0, None),
        (-1.1, 0.0, None),
    ];
    for (height, radius, expected) in cases {
        let found = body.lower_end(height, radius);
        match (found, expected) {
            (Some(found), Some(expected)) => {
                assert!((found - expected).abs() < 1e-12, "{height} {radius}: {found}");
            }
            _ => assert_eq!(found, expected, "{height} {radius}"),
        }
    }
    for step in 0..600 {
        let radius = f64::from(step) * 0.01;
        let lowest =
            (0..8000).map(|h| f64::from(h) * 1e-3 - 1.0).find(|&h| contains(&body, h, radius)).unwrap();
        assert!(body.rise(radius) <= lowest + 1e-9 && body.rise(radius) > lowest - 2e-3, "{radius}");
        assert!(body.rise_at_least(radius) <= body.rise(radius), "{radius}");
    }
}

/// Against the slow way: from the least on, each voxel by itself, in small steps.
#[test]
fn it_is_the_first_free_place_on_the_way_up() {
    let grid = Grid { origin: DVec3::new(-3.0, 1.0, 0.5), pitch: 0.5, dims: [23, 17, 19] };
    // Towers, and a ceiling with holes that a body may stand below.
    let solid = Occupancy::of(grid, |[x, y, z]| {
        let tower = z < (x * x + 3 * y + x * y * y) % 11 && (x + y) % 7 == 0;
        tower || z == 18 && x > 8 && y > 4
    });
    let centres: Vec<DVec3> = solid.centres().collect();
    // Nothing here is thick.
    assert_eq!(boundary(&solid).len(), centres.len());
    let body = holder();
    let (mut moved, mut below) = (0, 0);
    for axis in [DVec3::Z, DVec3::new(0.3, -0.5, 0.8).normalize(), DVec3::new(-1.0, 0.2, -0.1).normalize()] {
        let skyline = Skyline::new(&centres, grid.pitch, axis);
        for step in 0..60 {
            let turn = f64::from(step) * 0.7;
            let across = DVec3::new(4.0 + 6.0 * turn.sin(), 4.0 + 5.0 * (1.7 * turn).cos(), 0.0);
            let tip = grid.origin + across + DVec3::Z * f64::from(step % 5);
            let free = |stands: f64| {
                centres.iter().all(|&centre| {
                    let from_tip = centre - tip;
                    let height = from_tip.dot(axis);
                    !contains(&body, height - stands, (from_tip - axis * height).length())
                })
            };
            let expected = (0..30_000).map(|i| 1.0 + 1e-3 * f64::from(i)).find(|&s| free(s)).unwrap();
            let mut waiting = CellQueue::new();
            let found = skyline.clearing_height(tip, &body, 1.0, f64::INFINITY, &mut waiting).unwrap();
            assert!((found - expected).abs() < 2e-3, "{axis} {tip}: {found} {expected}");
            assert!(free(found));
            if found > 1.0 {
                moved += 1;
                assert_eq!(skyline.clearing_height(tip, &body, 1.0, 0.9 * found, &mut waiting), None);
            }
            let top = centres.iter().map(|c| (*c - tip).dot(axis)).fold(0.0, f64::max);
            below += usize::from(top > found + body.highest);
        }
    }
    assert!(moved > 40 && below > 3, "{moved} {below}");
}

#[test]
fn nothing_solid_leaves_the_least() {
    let skyline = Skyline::new(&[], 1.0, DVec3::Z);
    let found = skyline.clearing_height(DVec3::ONE, &holder(), 7.0, 9.0, &mut CellQueue::new());
    assert_eq!(found, Some(7.0));
}

#[test]
fn the_inside_of_a_block_is_no_boundary() {
    let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [5, 6, 7] };
    assert_eq!(boundary(&Occupancy::of(grid, |_| true)).len(), 5 * 6 * 7 - 3 * 4 * 5);
}
