//! Necks: a shank slimmer than its cutter changes what is reached, and not what it is told to fail by.

use super::*;
use crate::section::test_shapes::revolved;
use crate::tool::ElementKind;

#[test]
fn a_ball_that_does_not_fit_into_a_corner_is_not_told_to_be_held_by_its_neck() {
    // A plate of 40 × 20 × 8 under a wall of 8 × 20 × 22; nearer to their edge than its radius no ball touches either.
    let profile = [[0.0, 0.0], [30.0, 0.0], [30.0, 8.0], [8.0, 8.0], [8.0, 40.0], [0.0, 40.0]];
    let mesh = extruded(&profile, 20.0);
    let area = (140.0 * 20.0) + 2.0 * (40.0 * 8.0 + 8.0 * 22.0);
    for pitch in [1.0, 0.5] {
        let part = Part::sampled(&mesh, pitch, 4000);
        for neck in [3.0, 2.5, 1.0] {
            let tool = revolved([
                (ElementKind::Cutter, vec![arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 15.0, 3.0, 3.0)]),
                (ElementKind::Shank, vec![line(15.0, 22.0, neck, neck)]),
                (ElementKind::Holder(0), vec![line(22.0, 60.0, 8.0, 8.0)]),
            ]);
            let found = part.found(&tool, "axes+fibonacci:48");
            let share = |verdict: Verdict| found.share(|_| true, |reach| reach.verdict() == verdict);
            assert_near(share(Verdict::Gouged), 2.0 * 3.0 * 20.0 / area, 0.006, (pitch, neck));
            assert!(share(Verdict::Obstructed) < 0.001, "{pitch} {neck}: {}", share(Verdict::Obstructed));
        }
    }
}
