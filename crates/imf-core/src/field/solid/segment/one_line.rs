//! Where one line enters and leaves a segment, in doubt generously: by its quadratic, or by Newton's method.

use super::{CLOSE, FAR, Method, PlacedSegment};
use crate::tool::Segment;

const MISS: (f64, f64, bool) = (FAR, -FAR, false);

impl PlacedSegment<'_> {
    /// One line by whichever method; unsure ends are generous.
    pub(super) fn line(&self, x: f64, y: f64) -> (f64, f64, bool) {
        let d = self.placed.direction;
        let flat = x * d.x + y * d.y;
        let (enter, leave, edge) = if self.level {
            let margin = (flat - self.from).min(self.to - flat);
            if margin < -self.edge {
                return MISS;
            }
            (-FAR, FAR, margin < self.edge)
        } else {
            ((self.near - flat) * self.per_height, (self.far - flat) * self.per_height, false)
        };
        let b = self.b[0] + self.b[1] * flat;
        let c = x * x + y * y + self.c[0] + flat * (self.c[1] + flat * self.c[2]);
        let discriminant = b * b - self.a * c;
        match self.method {
            Method::Upright => {
                let value = |z: f64| (self.a * z + 2.0 * b) * z + c;
                let (one, other) = (value(enter), value(leave));
                // Between its ends the parabola sags by no more than this.
                let sag = self.a * (leave - enter) * (leave - enter) + self.rounding;
                if one.max(other) < -self.rounding {
                    (enter, leave, false)
                } else if one.min(other) > sag {
                    MISS
                } else {
                    (enter, leave, true)
                }
            }
            Method::Convex => self.newton(x, y, flat, enter, leave, edge, discriminant, b),
            Method::Between if discriminant < -self.tangent => MISS,
            Method::Between => {
                let root = (discriminant.max(0.0) + self.tangent).sqrt();
                let tangent = discriminant <= self.tangent;
                let root = if tangent { root } else { discriminant.sqrt() };
                (enter.max((-b - root) * self.per_a), leave.min((-b + root) * self.per_a), edge || tangent)
            }
            _ if discriminant < -self.tangent => (enter, leave, edge),
            _ if discriminant <= self.tangent => (enter, leave, true),
            // Where the line passes the cone's tip as near as the slack, centres behind the tip may be inside as well.
            Method::Above | Method::Below => {
                let root = discriminant.sqrt();
                let (below, above) = ((-b + root) * self.per_a, (-b - root) * self.per_a);
                match self.method {
                    Method::Above if below < enter - CLOSE => (enter.max(above), leave, edge),
                    Method::Below if above > leave + CLOSE => (enter, leave.min(below), edge),
                    _ => (enter, leave, true),
                }
            }
        }
    }

    /// From outside, Newton's steps on a convex function come ever closer to its root and never pass it.
    fn newton(
        &self,
        x: f64,
        y: f64,
        flat: f64,
        enter: f64,
        leave: f64,
        edge: bool,
        discriminant: f64,
        b: f64,
    ) -> (f64, f64, bool) {
        // A line that came this close may touch the segment by the predicate's slack or by rounding, where the function has no root.
        let touching = 1e-3 + self.rounding;
        let (mut first, mut last) = (enter, leave);
        if matches!(self.segment, Segment::Arc { .. }) {
            if discriminant < -self.tangent {
                return MISS;
            }
            let root = discriminant.max(0.0).sqrt() + 1e-6;
            (first, last) = (-b - root, -b + root);
        }
        let (lowest, highest) = (enter.max(first), leave.min(last));
        let mut unsure = edge;
        for (end, side) in [(&mut first, 1.0), (&mut last, -1.0)] {
            let (mut settled, mut least) = (false, f64::INFINITY);
            for _ in 0..60 {
                let (value, slope, radius) = self.convex(x, y, flat, *end);
                least = least.min(value);
                if value <= 1e-11 {
                    unsure |= slope.abs() < 1e-2 || radius < 1e-2;
                    unsure |= slope.abs() * radius < 1e5 * self.rounding;
                    settled = true;
                    break;
                }
                let passed = *end > leave + 1.0 && side > 0.0 || *end < enter - 1.0 && side < 0.0;
                if passed || slope * side >= 0.0 {
                    if least > touching {
                        return MISS;
                    }
                    break;
                }
                *end -= value / slope;
            }
            unsure |= !settled;
        }
        if unsure {
            // Tangents are few, and may run along the segment: let every centre be tried.
            (lowest, highest, true)
        } else {
            (enter.max(first), leave.min(last), false)
        }
    }

    /// A convex function of z that is at most 0 inside, its slope, and the distance from the axis.
    fn convex(&self, x: f64, y: f64, flat: f64, z: f64) -> (f64, f64, f64) {
        let d = self.placed.direction;
        let height = flat + z * d.z;
        let radius = (x * x + y * y + z * z - height * height).max(0.0).sqrt();
        let radius_slope = (z - height * d.z) / radius.max(1e-9);
        match self.segment {
            Segment::Line { from, to, radius_from, radius_to } => {
                let k = (radius_to - radius_from) / (to - from);
                (radius - radius_from - k * (height - from), radius_slope - k * d.z, radius)
            }
            Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                // Distance from the disc within the torus.
                let (out, up) = ((radius - centre_radius).max(0.0), height - centre_height);
                let away = out.hypot(up);
                ((away - arc_radius), (out * radius_slope + up * d.z) / away.max(1e-9), radius)
            }
        }
    }
}
