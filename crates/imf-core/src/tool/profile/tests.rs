//! Outlines: volumes, radii, and what is cut off.

use super::*;

#[test]
fn volumes_agree_with_sums_of_thin_discs() {
    let segments = [
        Segment::Line { from: 1.0, to: 4.0, radius_from: 2.0, radius_to: 0.5 },
        Segment::Arc { from: 0.0, to: 1.5, centre_height: 2.0, centre_radius: 3.0, arc_radius: 2.0 },
    ];
    for segment in segments {
        let (from, to) = segment.range();
        let steps = 100_000;
        let thickness = (to - from) / f64::from(steps);
        let sum: f64 = (0..steps)
            .map(|i| PI * segment.radius(from + thickness * (f64::from(i) + 0.5)).powi(2) * thickness)
            .sum();
        assert!((sum - segment.volume()).abs() < 1e-6 * sum, "{segment:?}");
    }
}

#[test]
fn the_widest_stretch_is_where_the_radius_is_nearly_the_largest() {
    let line = |from, to, radius_from, radius_to| Segment::Line { from, to, radius_from, radius_to };
    let length = |profile: &[Segment], room: f64| {
        Element { kind: ElementKind::Cutter, profile: profile.to_vec() }.widest_length(room)
    };
    // A cone up to its end, and down from there; with a cylinder between; a ball; and two rims apart.
    let (up, down) = (line(0.0, 4.0, 0.0, 2.0), line(4.0, 8.0, 2.0, 0.0));
    let ball = Segment::Arc { from: 0.0, to: 4.0, centre_height: 2.0, centre_radius: 0.0, arc_radius: 2.0 };
    let apart = [line(0.0, 0.5, 2.0, 2.0), line(0.5, 3.0, 1.0, 1.0), line(3.0, 3.2, 2.0, 2.0)];
    for (profile, expected) in [
        (&[up][..], 0.2),
        (&[up, down], 0.4),
        (&[up, line(4.0, 5.0, 2.0, 2.0)], 1.2),
        (&[ball], 2.0 * (4.0_f64 - 1.9 * 1.9).sqrt()),
        (&apart, 0.5),
    ] {
        let found = length(profile, 0.1);
        assert!((found - expected).abs() < 1e-12, "{profile:?}: {found}");
    }
}

#[test]
fn cutting_keeps_the_outline() {
    let cone = Segment::Line { from: 0.0, to: 10.0, radius_from: 0.0, radius_to: 5.0 };
    let cut = cone.below(4.0).unwrap();
    assert_eq!(cut.range(), (0.0, 4.0));
    assert!((cut.radius(3.0) - cone.radius(3.0)).abs() < 1e-12);
    assert!(cone.below(0.0).is_none());
}
