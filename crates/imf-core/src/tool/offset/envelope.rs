//! The envelope of lines and arcs over the height: which of them is farthest from the axis, or nearest to it, where.

use crate::tool::Segment;

/// A line or an arc, and whose it is.
#[derive(Clone, Copy, Debug)]
pub(in crate::tool) struct Curve {
    pub(in crate::tool) segment: Segment,
    pub(in crate::tool) owner: usize,
}

/// Which of the curves that stand above a height makes the envelope there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::tool) enum Side {
    /// The one farthest from the axis: a union of bodies.
    Outer,
    /// The one nearest to the axis: what bodies have in common.
    Inner,
}

/// Heights closer than this, relative to the largest, are one.
const SAME: f64 = 1e-12;

/// The envelope from its lowest to its highest height; each piece is cut out of one of the curves. The curves'
/// heights together must leave no gap.
pub(in crate::tool) fn envelope(curves: &[Curve], side: Side) -> Vec<Curve> {
    let mut heights: Vec<f64> =
        curves.iter().flat_map(|c| [c.segment.range().0, c.segment.range().1]).collect();
    for (index, a) in curves.iter().enumerate() {
        for b in &curves[index + 1..] {
            heights.extend(crossings(&a.segment, &b.segment).into_iter().flatten());
        }
    }
    heights.sort_by(f64::total_cmp);
    let scale = heights.iter().fold(0.0, |m: f64, h| m.max(h.abs()));
    let mut pieces: Vec<(usize, f64, f64)> = Vec::new();
    let mut from = heights.first().copied().unwrap_or_default();
    for &to in heights.iter().skip(1) {
        if to - from <= SAME * scale {
            continue;
        }
        let middle = 0.5 * (from + to);
        let reaching = (0..curves.len()).filter(|&c| {
            let (low, high) = curves[c].segment.range();
            low <= middle && middle <= high
        });
        let radius = |&c: &usize| match side {
            Side::Outer => curves[c].segment.radius(middle),
            Side::Inner => -curves[c].segment.radius(middle),
        };
        if let Some(best) = reaching.max_by(|a, b| radius(a).total_cmp(&radius(b))) {
            match pieces.last_mut() {
                Some((last, _, end)) if *last == best => *end = to,
                _ => pieces.push((best, from, to)),
            }
        }
        from = to;
    }
    pieces
        .into_iter()
        .map(|(c, from, to)| Curve { segment: curves[c].segment.between(from, to), ..curves[c] })
        .collect()
}

/// Heights within both ranges at which two curves may cross (the other half of a circle counts too: a height more
/// does no harm).
fn crossings(a: &Segment, b: &Segment) -> [Option<f64>; 2] {
    let found = match (straight(a), straight(b)) {
        (Some((slope_a, at_a)), Some((slope_b, at_b))) => [(at_b - at_a) / (slope_a - slope_b), f64::NAN],
        (Some(line), None) => line_circle(line, circle(b)),
        (None, Some(line)) => line_circle(line, circle(a)),
        (None, None) => circle_circle(circle(a), circle(b)),
    };
    let low = a.range().0.max(b.range().0);
    let high = a.range().1.min(b.range().1);
    found.map(|height| Some(height).filter(|h| (low..=high).contains(h)))
}

/// Slope and radius at height 0.
fn straight(segment: &Segment) -> Option<(f64, f64)> {
    match *segment {
        Segment::Line { from, to, radius_from, radius_to } => {
            let slope = (radius_to - radius_from) / (to - from);
            Some((slope, radius_from - slope * from))
        }
        Segment::Arc { .. } => None,
    }
}

/// Height and radius of the centre, and radius of the circle; of a line, nothing that meets anything.
fn circle(segment: &Segment) -> (f64, f64, f64) {
    match *segment {
        Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
            (centre_height, centre_radius, arc_radius)
        }
        Segment::Line { .. } => (f64::NAN, f64::NAN, f64::NAN),
    }
}

fn line_circle((slope, at_zero): (f64, f64), (height, centre, radius): (f64, f64, f64)) -> [f64; 2] {
    // (h − height)² + (slope·h + at_zero − centre)² = radius², with t = h − height.
    let offset = slope * height + at_zero - centre;
    let a = 1.0 + slope * slope;
    let half_b = slope * offset;
    let root = (half_b * half_b - a * (offset * offset - radius * radius)).sqrt();
    [height + (-half_b - root) / a, height + (-half_b + root) / a]
}

fn circle_circle(a: (f64, f64, f64), b: (f64, f64, f64)) -> [f64; 2] {
    let (dh, dr) = (b.0 - a.0, b.1 - a.1);
    let apart = dh.hypot(dr);
    let along = (apart * apart + a.2 * a.2 - b.2 * b.2) / (2.0 * apart);
    let across = (a.2 * a.2 - along * along).sqrt();
    let (uh, ur) = (dh / apart, dr / apart);
    [a.0 + along * uh - across * ur, a.0 + along * uh + across * ur]
}
