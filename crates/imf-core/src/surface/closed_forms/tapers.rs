//! Cutters that widen upwards: their flank machines what it lies on, and its end no wall.

use super::solids::tapered;
use super::*;

#[test]
fn a_groove_with_draft_is_reached_by_tapers_up_to_its_own() {
    // A floor 8 wide, 10 deep, walls that lean by 15 degrees.
    let (floor_half, depth, degrees) = (4.0, 10.0, 15.0_f64);
    let top_half = floor_half + depth * degrees.to_radians().tan();
    let x = |offset: f64| 20.0 + offset;
    let profile = [
        [0.0, 0.0],
        [16.0, 0.0],
        [16.0, x(-top_half)],
        [6.0, x(-floor_half)],
        [6.0, x(floor_half)],
        [16.0, x(top_half)],
        [16.0, 40.0],
        [0.0, 40.0],
    ];
    let mesh = extruded(&profile, 20.0);
    let inner = |s: &SurfaceSample| (s.point.x - 20.0).abs() < top_half && (6.01..15.99).contains(&s.point.z);
    let floor = |s: &SurfaceSample| (s.point.x - 20.0).abs() < floor_half && (s.point.z - 6.0).abs() < 0.01;
    let wall = |s: &SurfaceSample| inner(s) && s.normal.y.abs() < 0.5;
    for pitch in PITCHES {
        let part = Part::sampled(&mesh, pitch, 600);
        // Its flank lies on the wall; a steeper one touches with its rim.
        for taper in [15.0, 5.0] {
            let found = part.found(&tapered(2.0, taper, 12.0), DOWN);
            let found = [found.reached(wall), found.reached(floor)];
            assert!(found.iter().all(|&share| share > 0.99), "{pitch} {taper}: {found:?}");
        }
        // A flatter one would touch with its upper edge alone, whatever stands on it.
        for shank in [2.0, 2.0 + 4.0 * 30.0_f64.to_radians().tan()] {
            let Tool { shape: ToolShape::Revolved(mut elements), .. } = tapered(2.0, 30.0, 4.0) else {
                panic!()
            };
            elements[1].profile = vec![line(4.0, 30.0, shank, shank)];
            let chamfer = Tool { shape: ToolShape::Revolved(elements), ..tapered(2.0, 30.0, 4.0) };
            assert_eq!(part.found(&chamfer, DOWN).reached(wall), 0.0, "{pitch} {shank}");
        }
    }
}
