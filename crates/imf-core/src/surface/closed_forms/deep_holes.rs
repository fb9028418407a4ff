//! Blind holes that shank or holder enter: what is in the way is what is named, and a shank has the cutter's tolerance.

use super::*;
use crate::section::test_shapes::revolved;
use crate::tool::ElementKind;

/// Across a block of 40 × 40, in its middle.
fn drilled(radius: f64, facets: u32, height: f64, depth: f64) -> Mesh {
    pocketed(DVec3::new(40.0, 40.0, height), &circle(DVec2::splat(20.0), radius, facets as usize), depth)
}

#[test]
fn a_shank_as_wide_as_its_cutter_stands_in_facets_as_far_as_the_cutter_may() {
    // The facets stand 0.048 in the round hole.
    let mesh = drilled(10.0, 32, 40.0, 35.0);
    for pitch in [0.8, 0.5] {
        let part = Part::sampled(&mesh, pitch, 3000);
        let inside = |s: &SurfaceSample| {
            (s.point.truncate() - 20.0).length() < 10.1 && (5.1..39.9).contains(&s.point.z)
        };
        let fluted = revolved([(ElementKind::Cutter, vec![line(0.0, 60.0, 5.0, 5.0)])]);
        let with_shank = |radius| {
            let cutter = (ElementKind::Cutter, vec![line(0.0, 5.0, 5.0, 5.0)]);
            revolved([cutter, (ElementKind::Shank, vec![line(5.0, 60.0, radius, radius)])])
        };
        for tool in [fluted, with_shank(5.0), with_shank(4.9)] {
            let reached = part.found(&tool, DOWN).reached(inside);
            assert!(reached > 0.999, "{pitch}: {reached}");
        }
        let reached = part.found(&with_shank(5.2), DOWN).reached(inside);
        assert!(reached < 0.2, "{pitch}: {reached}");
    }
}

#[test]
fn a_holder_is_blamed_where_the_cutter_just_fits() {
    let mesh = drilled(5.0, 48, 20.0, 15.0);
    let floor =
        |s: &SurfaceSample| s.normal.z > 0.9 && s.point.z < 6.0 && (s.point.truncate() - 20.0).length() < 4.5;
    for (pitch, radius) in [(0.8, 4.9), (0.8, 4.0), (0.5, 4.9)] {
        let tool = revolved([
            (ElementKind::Cutter, vec![line(0.0, 5.0, radius, radius)]),
            (ElementKind::Holder(0), vec![line(5.0, 35.0, 10.0, 10.0)]),
        ]);
        let part = Part::sampled(&mesh, pitch, 3000);
        let found = part.found(&tool, DOWN);
        let blamed = |reach: &SampleReach| {
            let SampleReach::Obstructed { hits, .. } = *reach else { return false };
            found.tool.hits(hits).eq([(ElementKind::Holder(0), 0)])
        };
        let share = found.share(floor, blamed);
        assert!(share > 0.999, "{pitch} {radius}: {share}");
    }
}

#[test]
fn of_directions_as_near_to_the_normal_the_one_is_named_where_least_is_in_the_way() {
    // A floor under a wall, asked at 30 degrees from either side, by a machine that brings the tool nowhere.
    let profile = [[0.0, 0.0], [10.0, 0.0], [10.0, 30.0], [40.0, 30.0], [40.0, 40.0], [0.0, 40.0]];
    let mesh = extruded(&profile, 20.0);
    let tool = revolved([
        (ElementKind::Cutter, vec![arc(0.0, 2.0, 2.0, 0.0, 2.0), line(2.0, 8.0, 2.0, 2.0)]),
        (ElementKind::Shank, vec![line(8.0, 12.0, 1.5, 1.5)]),
        (ElementKind::Holder(0), vec![line(12.0, 60.0, 8.0, 8.0)]),
    ]);
    let part = Part::sampled(&mesh, 1.0, 800);
    let tool = part.surface_tool(&tool).limited(Arc::new(|_, _| false));
    let (towards, away) = (Orientation::new(0.0, 30.0), Orientation::new(180.0, 30.0));
    for (directions, free) in [([towards, away], 1), ([away, towards], 0)] {
        let access = part.access(&tool, &directions);
        let before_wall =
            |s: &SurfaceSample| s.normal.z > 0.9 && s.point.z < 11.0 && (20.0..27.0).contains(&s.point.x);
        let found: Vec<_> = part.samples.iter().zip(&access.reach).filter(|(s, _)| before_wall(s)).collect();
        assert!(found.len() > 20);
        for (sample, reach) in found {
            assert_eq!(*reach, SampleReach::Obstructed { direction: free, hits: 0 }, "{sample:?}");
        }
    }
}
