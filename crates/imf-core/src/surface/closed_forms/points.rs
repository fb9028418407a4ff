//! What a cutter does not fit into is told from points of the surface: alike at every pitch.

use super::*;
use crate::parts::shell::rectangle;
use crate::section::test_shapes::revolved;
use crate::tool::{ElementKind, Segment};

#[test]
fn what_a_cutter_leaves_in_a_sharp_corner_is_told_alike_at_every_pitch() {
    let (radius, side, depth) = (3.0, 20.0, 10.0);
    let outline = rectangle([5.0, 5.0 + side], [5.0, 5.0 + side]);
    let mesh = pocketed(DVec3::new(30.0, 30.0, 20.0), &outline, depth);
    let inside = |s: &SurfaceSample| (s.point.truncate() - 15.0).abs().max_element() < 10.1;
    let wall = |s: &SurfaceSample| inside(s) && is_wall(s);
    let floor = |s: &SurfaceSample| inside(s) && s.normal.z > 0.5 && s.point.z < 19.0;
    for tolerance in [0.05, 0.2] {
        // The cutter's axis stays so far off the walls.
        let off = radius - tolerance;
        let on_wall = 1.0 - 2.0 * off / side;
        let on_floor = 1.0 - (4.0 - PI) * radius * radius / (side * side);
        for pitch in [3.0, 1.5, 0.75] {
            let part = Part::sampled(&mesh, pitch, 6000);
            let tool = SurfaceTool::new(&part.environment, &(&flat(radius)).into(), tolerance).unwrap();
            let reach = part.access(&tool, &orientations(DOWN)).reach;
            let found = SampleVerdicts { samples: &part.samples, tool, reach };
            // Points stand half a pitch apart, samples half a millimetre.
            assert_near(found.reached(wall), on_wall, 0.015, (tolerance, pitch));
            assert_near(found.reached(floor), on_floor, 0.02, (tolerance, pitch));
        }
    }
}

#[test]
fn a_holder_that_enters_a_wall_between_the_centres_is_in_the_way() {
    let (wide, radius) = (30.0, 8.0);
    let outline = rectangle([15.0, 15.0 + wide], [15.0, 15.0 + wide]);
    let mesh = pocketed(DVec3::new(60.0, 60.0, 30.0), &outline, 20.0);
    // On the floor its holder stands below the pocket's mouth.
    let short = revolved([
        (ElementKind::Cutter, vec![Segment::ball_end(2.0), Segment::cylinder(2.0, 6.0, 2.0)]),
        (ElementKind::Shank, vec![Segment::cylinder(6.0, 10.0, 2.0)]),
        (ElementKind::Holder(0), vec![Segment::cylinder(10.0, 50.0, radius)]),
    ]);
    for pitch in [2.0, 1.0, 0.5] {
        let part = Part::sampled(&mesh, pitch, 6000);
        let reach = part.access(&part.surface_tool(&short), &orientations(DOWN)).reach;
        let mut seen = [0; 2];
        for (sample, reach) in part.samples.iter().zip(&reach) {
            let off = 0.5 * wide - (sample.point.truncate() - 30.0).abs().max_element();
            let on_floor = off > 2.0 && sample.normal.z > 0.5;
            // A round enters a wall so deep between points, and a corner of the part is a point itself.
            let told = (off - radius).abs() > 0.063 * pitch * pitch / radius;
            if on_floor && told {
                seen[usize::from(off > radius)] += 1;
                assert_eq!(reach.verdict() == Verdict::Reached, off > radius, "{pitch} {off} {reach:?}");
            }
        }
        assert!(seen[0] > 200 && seen[1] > 200, "{seen:?}");
    }
}

#[test]
fn a_small_part_is_measured_by_its_own_pitch() {
    let of = |pitch: f64| default_tolerance(pitch, LengthUnit::Mm);
    assert_eq!([0.002, 0.04].map(|pitch| of(pitch) / pitch), [0.25; 2]);
    assert_eq!([0.25, 0.5].map(of), [0.05; 2]);
    assert_eq!(of(4.0), 0.4);
    assert!((default_tolerance(0.01, LengthUnit::Inch) * 25.4 - 0.05).abs() < 1e-12);
}
