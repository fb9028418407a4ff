//! How deep a cutter must enter a surface until it is seen there.

use std::f64::consts::{PI, SQRT_2};

use glam::DVec2;

use super::thin::last_held;
use super::{Element, Segment};

/// Sine of half a corner's angle beyond which it is none.
const SMOOTH: f64 = 0.9999;
/// What rounding may take from a ball, of its radius.
const SLACK: f64 = 1e-6;

impl Element {
    /// How deep a plane must enter the element, wherever it touches it first, until what lies deeper than `contact` holds a circle of
    /// a radius on that plane: less by far for rounds than for corners, infinite where it is too thin. The upper end is surface only
    /// where it is `exposed`.
    pub(crate) fn depth_of_circle(&self, contact: f64, radius: f64, exposed: bool) -> f64 {
        let ball = contact + radius;
        // Behind a corner: the distance to the ball that touches both its sides, which must lie in the element.
        let corner = |at: DVec2, inward: DVec2, sine: f64| {
            let DVec2 { x: height, y: away } = at + inward * (ball / sine);
            let is_inside = away >= 0.0 && away <= self.radius_at(height);
            let fits = is_inside && self.depth(height, away, exposed) >= ball * (1.0 - SLACK);
            if fits { ball / sine } else { f64::INFINITY }
        };
        let round = |own: f64| {
            let left = own - contact;
            let of_ball = contact + left - (left * left - radius * radius).max(0.0).sqrt();
            if left > radius { of_ball } else { ball * SQRT_2 }
        };
        // A slender tip is wide enough only farther up.
        let foot = self.profile.first().map_or(0.0, |lowest| lowest.range().0);
        let mut deepest =
            self.eroded(contact, exposed).map_or(f64::INFINITY, |deep| first_height(&deep, radius) - foot);
        // The outline goes from the axis out, up and back; of each piece the directions at both its ends, in height and radius.
        let mut pieces: Vec<(DVec2, [DVec2; 2])> = Vec::new();
        let mut last = 0.0;
        for segment in self.profile.iter().filter(|segment| segment.range().0 < segment.range().1) {
            let (from, to) = segment.range();
            let [start, end] = [from, to].map(|height| segment.radius(height));
            if (start - last).abs() > 1e-9 * (start + last) {
                pieces.push((DVec2::new(from, last), [DVec2::new(0.0, start - last); 2]));
            }
            match *segment {
                Segment::Line { .. } => {
                    pieces.push((DVec2::new(from, start), [DVec2::new(to - from, end - start); 2]));
                    if start == end {
                        deepest = deepest.max(round(start));
                    }
                }
                Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                    let tangent = |height, radius| DVec2::new(radius - centre_radius, centre_height - height);
                    pieces.push((DVec2::new(from, start), [tangent(from, start), tangent(to, end)]));
                    deepest = deepest.max(round(arc_radius));
                }
            }
            last = end;
        }
        if let (true, Some(top)) = (exposed, self.profile.last()) {
            pieces.push((DVec2::new(top.range().1, last), [DVec2::new(0.0, -last); 2]));
        }
        if let Some(&(tip, [way, _])) = pieces.first() {
            let sine = way.y / way.length();
            if sine < SMOOTH {
                deepest = deepest.max(corner(tip, DVec2::X, sine));
            }
        }
        for pair in pieces.windows(2) {
            let ((_, [_, before]), (at, [after, _])) = (pair[0], pair[1]);
            let sine = (0.5 * (PI + before.angle_to(after))).sin();
            if before.perp_dot(after) < 0.0 && sine < SMOOTH {
                deepest = deepest.max(corner(at, (after.normalize() - before.normalize()).normalize(), sine));
            }
        }
        deepest
    }
}

/// The lowest height at which an element is so wide; infinite where it is nowhere.
fn first_height(element: &Element, radius: f64) -> f64 {
    let wide = |segment: &Segment| {
        let (from, to) = segment.range();
        let is_narrow = |height: f64| segment.radius(height) < radius;
        match [from, to].map(is_narrow) {
            [false, _] => Some(from),
            [true, false] => Some(last_held(from, to, is_narrow)),
            [true, true] => None,
        }
    };
    element.profile.iter().filter_map(wide).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{arc, line};
    use crate::tool::ElementKind;

    #[test]
    fn depths_are_those_of_geometry() {
        let of = |profile: Vec<Segment>, exposed| {
            // Wherever on the tool it is.
            let element = Element { kind: ElementKind::Holder(0), profile };
            let [found, raised] = [0.0, 35.0].map(|by| element.raised(by).depth_of_circle(0.1, 0.5, exposed));
            assert!(found == raised || (found - raised).abs() < 1e-9, "{found} {raised}");
            found
        };
        let cap = |radius: f64| 0.1 + (radius - 0.1) - ((radius - 0.1_f64).powi(2) - 0.25).sqrt();
        let ball = vec![Segment::ball_end(4.0), Segment::cylinder(4.0, 20.0, 4.0)];
        let cases = [
            (of(ball.clone(), false), cap(4.0)),
            (of(ball, true), 0.6 * 2f64.sqrt()),
            (of(vec![Segment::cylinder(0.0, 20.0, 4.0)], false), 0.6 * 2f64.sqrt()),
            (of(vec![arc(0.0, 1.0, 1.0, 3.0, 1.0), line(1.0, 20.0, 4.0, 4.0)], false), cap(1.0)),
            // A point of 60 degrees, and a dovetail's edge of 60.
            (of(vec![line(0.0, 8.0 * 3f64.sqrt(), 0.0, 8.0)], false), 1.2),
            (of(vec![line(0.0, 3.0 * 3f64.sqrt(), 8.0, 5.0)], false), 1.2),
            // A round point of radius 0.25 on a cone of 1 in 10.
            (
                of(vec![arc(0.0, 0.25, 0.25, 0.0, 0.25), line(0.25, 30.25, 0.25, 3.25)], false),
                0.25 + 10.0 * (0.25 + 0.1 * 0.1_f64.hypot(1.0)),
            ),
            // A saw of 1 mm, whose rim holds no ball of 1.2 mm, and one of 1.5 mm.
            (of(vec![line(0.0, 1.0, 20.0, 20.0), line(1.0, 9.0, 5.0, 5.0)], false), f64::INFINITY),
            (of(vec![line(0.0, 1.5, 20.0, 20.0), line(1.5, 9.0, 5.0, 5.0)], false), 0.6 * 2f64.sqrt()),
            // A step inward has an edge, one outward too, but no more than that.
            (of(vec![line(0.0, 3.0, 4.0, 4.0), line(3.0, 9.0, 2.0, 2.0)], false), 0.6 * 2f64.sqrt()),
        ];
        for (index, (found, expected)) in cases.into_iter().enumerate() {
            assert!(found == expected || (found - expected).abs() < 1e-9, "{index}: {found} {expected}");
        }
    }
}
