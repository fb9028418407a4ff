//! What is left of an element below a depth under its surface: the points of a cutter that lie deeper in it than a tolerance.

use std::f64::consts::SQRT_2;

use super::offset::envelope::{Curve, Side, envelope};
use super::{Element, Segment};

impl Element {
    /// As [`Element::eroded`]; `None` too where voxels of a pitch do not show what is left, since between the columns of their centres
    /// there is room for it: it is thinner than a voxel's diagonal.
    pub(crate) fn eroded_among_voxels(&self, depth: f64, exposed: bool, pitch: f64) -> Option<Self> {
        self.eroded(depth, exposed).filter(|left| 2.0 * left.max_radius() >= SQRT_2 * pitch)
    }

    /// The element as it is held against voxels of a pitch and points of surfaces where it may hold both as deep as `contact`, and how
    /// deep points may lie in that: what lies deeper in it, and nothing; or all of it where voxels do not show what does.
    pub(crate) fn touching(&self, contact: f64, pitch: f64) -> (Self, f64) {
        let deeper = (contact > 0.0).then(|| self.eroded_among_voxels(contact, true, pitch)).flatten();
        deeper.map_or_else(|| (self.clone(), contact), |deeper| (deeper, f64::NEG_INFINITY))
    }

    /// The points of the element deeper than `depth` below its surface, `None` where there are none. The upper end counts as
    /// surface only where it is `exposed`; a tool goes on above its cutter.
    ///
    /// For outlines that are convex but for steps, which cutters are; where two pieces meet in a groove the result is a little
    /// too large.
    pub(crate) fn eroded(&self, depth: f64, exposed: bool) -> Option<Self> {
        let (first, last) = (self.profile.first()?, self.profile.last()?);
        let lowest = first.range().0 + if first.radius(first.range().0) > 0.0 { depth } else { 0.0 };
        let highest = last.range().1 - if exposed { depth } else { 0.0 };
        let pieces = self.profile.iter().filter_map(|segment| shrunk(segment, depth));
        let curves: Vec<Curve> = pieces.map(|segment| Curve { segment, owner: 0 }).collect();
        let within = |curve: Curve| {
            let (from, to) = curve.segment.range();
            let (from, to) = (from.max(lowest), to.min(highest));
            (from < to).then(|| positive(&curve.segment, from, to)).flatten()
        };
        let profile: Vec<Segment> = envelope(&curves, Side::Inner).into_iter().filter_map(within).collect();
        (!profile.is_empty()).then_some(Self { kind: self.kind, profile })
    }
}

/// A piece of the outline moved inward. A line is made longer by the depth at both ends, so that it meets its neighbours
/// behind a convex corner.
fn shrunk(segment: &Segment, depth: f64) -> Option<Segment> {
    match *segment {
        Segment::Line { from, to, radius_from, radius_to } if from < to => {
            let slope = (radius_to - radius_from) / (to - from);
            let inward = depth * slope.hypot(1.0);
            let at = |height: f64| radius_from + slope * (height - from) - inward;
            let (from, to) = (from - depth, to + depth);
            Some(Segment::Line { from, to, radius_from: at(from), radius_to: at(to) })
        }
        Segment::Arc { from, to, centre_height, centre_radius, arc_radius } if arc_radius > depth => {
            let shrink = (arc_radius - depth) / arc_radius;
            let at = |height: f64| centre_height + (height - centre_height) * shrink;
            let arc_radius = arc_radius - depth;
            Some(Segment::Arc { from: at(from), to: at(to), centre_height, centre_radius, arc_radius })
        }
        Segment::Line { .. } | Segment::Arc { .. } => None,
    }
}

/// The part of a segment between two heights at which its radius is positive.
fn positive(segment: &Segment, from: f64, to: f64) -> Option<Segment> {
    match *segment {
        Segment::Arc { .. } => Some(segment.between(from, to)),
        Segment::Line { .. } => {
            let (mut low, mut high) = (from, to);
            let (a, b) = (segment.radius(from), segment.radius(to));
            if a <= 0.0 && b <= 0.0 {
                return None;
            }
            // Where the line crosses the axis.
            let zero = from + (to - from) * a / (a - b);
            if a < 0.0 {
                low = zero;
            } else if b < 0.0 {
                high = zero;
            }
            let radius = |height: f64| segment.radius(height).max(0.0);
            (low < high).then(|| Segment::Line {
                from: low,
                to: high,
                radius_from: radius(low),
                radius_to: radius(high),
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{arc, holds, line, walk};
    use crate::tool::ElementKind;

    #[test]
    fn eroded_cutters_are_the_points_deeper_than_the_depth() {
        let profiles = [
            vec![line(0.0, 10.0, 3.0, 3.0)],
            vec![arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 12.0, 3.0, 3.0)],
            vec![arc(0.0, 1.0, 1.0, 2.0, 1.0), line(1.0, 8.0, 3.0, 3.0)],
            vec![line(0.0, 2.0, 0.0, 3.0), line(2.0, 9.0, 3.0, 3.0)],
            vec![line(0.0, 1.0, 2.0, 3.0), line(1.0, 6.0, 3.0, 4.0)],
            // A corner radius below the depth.
            vec![arc(0.0, 0.2, 0.2, 2.8, 0.2), line(0.2, 8.0, 3.0, 3.0)],
        ];
        for profile in profiles {
            let element = Element { kind: ElementKind::Cutter, profile };
            for (amount, exposed) in [(0.05, false), (0.4, true)] {
                let eroded = element.eroded(amount, exposed).unwrap();
                for i in 0..60 {
                    for j in 0..40 {
                        let (height, radius) = (-0.2 + 0.22 * f64::from(i), 0.12 * f64::from(j));
                        let inside = holds(&eroded.profile, height, radius);
                        let below = || walk(&element.profile, exposed, height, radius);
                        let depth = if holds(&element.profile, height, radius) { below() } else { -1.0 };
                        // Half a step of the walk is below a hundredth.
                        if depth > amount + 0.01 {
                            assert!(inside, "{element:?} {amount} {height} {radius} {depth}");
                        }
                        if inside {
                            assert!(depth > amount - 0.01, "{element:?} {amount} {height} {radius} {depth}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_is_left_of_an_element_thinner_than_twice_the_depth() {
        let element = Element { kind: ElementKind::Cutter, profile: vec![line(0.0, 5.0, 0.5, 0.5)] };
        assert!(element.eroded(0.6, false).is_none());
    }
}
