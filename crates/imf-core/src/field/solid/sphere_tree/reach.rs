//! How far a stretch of a body reaches.

use super::super::Part;
use crate::tool::Segment;

/// Distance of the farthest point of a stretch from a point of the axis.
pub(super) fn reach(parts: &[Part], from: f64, to: f64, middle: f64) -> f64 {
    const STEPS: i32 = 8;
    let mut radius: f64 = 0.0;
    for part in parts {
        let (low, high) = part.segment.range();
        let (low, high) = (low.max(from), high.min(to));
        for step in 0..STEPS {
            let at = |step: i32| low + (high - low) * f64::from(step) / f64::from(STEPS);
            let (low, high) = (at(step), at(step + 1));
            if low < high {
                let away = (low - middle).abs().max((high - middle).abs());
                radius = radius.max(away.hypot(widest(&part.segment, low, high)));
            }
        }
    }
    radius
}

/// Largest radius between two heights within the segment's range.
pub(super) fn widest(segment: &Segment, from: f64, to: f64) -> f64 {
    let ends = segment.radius(from).max(segment.radius(to));
    match *segment {
        Segment::Line { .. } => ends,
        Segment::Arc { centre_height, .. } => ends.max(segment.radius(centre_height.clamp(from, to))),
    }
}
