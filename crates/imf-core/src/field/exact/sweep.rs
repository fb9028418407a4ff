//! Where a line of voxel centres along z enters and leaves one segment of a body of revolution.
//!
//! A segment is convex, so a line is inside between two ends or never. Within the slab of heights `from ≤ h < to` a
//! cylinder, a cone and a ball are each a quadratic in z, `a z² + 2 b z + c ≤ 0`, solved for eight lines at a time; a
//! torus, and a cone along whose flank the line runs, by Newton's method on a convex function. Ends that lie so close
//! to a voxel centre that rounding could decide, and lines that hardly touch, are reported as unsure: those centres
//! are tried one by one with the predicate that defines the tool, so the whole numbers are the definition's.
//!
//! All lengths here are in voxels.

use glam::DVec3;

use crate::tool::{SLACK, Segment, holds};

/// Lines that are solved together.
pub(super) const LANES: usize = 8;
/// Farther than any voxel.
const FAR: f64 = 1e9;
/// An end this close to a voxel centre is unsure. Rounding moves ends by less, see [`Sweep::new`].
const CLOSE: f64 = 1e-5;
/// Tilt of the axis along z below which heights do not bound the line well: |d_z|.
const LEVEL: f64 = 1e-6;
/// Leading coefficient below which a quadratic is solved by other means.
const FLAT: f64 = 1e-3;

/// Where a tool stands, in voxels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    /// The tip in continuous voxel coordinates.
    pub(super) tip: DVec3,
    /// From the tip along the axis.
    pub(super) direction: DVec3,
    /// Edge of a voxel in world units.
    pub(super) pitch: f64,
}

impl Placed {
    /// The predicate that defines the tool, for one voxel and a profile in world units.
    #[inline]
    pub(super) fn holds(&self, profile: &[Segment], voxel: [f64; 3]) -> bool {
        let offset = (DVec3::from_array(voxel) - self.tip) * self.pitch;
        holds(profile, self.direction, offset, SLACK * self.pitch * self.pitch)
    }
}

/// How a segment is solved.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Method {
    /// The quadratic, inside between its roots.
    Between,
    /// The quadratic opens downwards: a cone steeper than the line, inside above its larger root…
    Above,
    /// … or below its smaller one.
    Below,
    /// A cylinder along the line, or nearly so.
    Upright,
    /// Newton's method.
    Convex,
}

/// Ends of up to eight lines, as heights in voxels above the tip, and which of them are unsure. Low is above high where
/// the line misses.
pub(super) struct Ends {
    pub(super) low: [f64; LANES],
    pub(super) high: [f64; LANES],
    pub(super) unsure: [bool; LANES],
}

/// One segment in one pose.
pub(super) struct Sweep<'a> {
    pub(super) placed: Placed,
    /// The segment in world units.
    world: &'a Segment,
    /// The segment in voxels.
    segment: Segment,
    /// Heights between which it is looked at.
    pub(super) from: f64,
    pub(super) to: f64,
    /// Largest radius, a little generous.
    pub(super) widest: f64,
    method: Method,
    level: bool,
    near: f64,
    far: f64,
    per_height: f64,
    a: f64,
    per_a: f64,
    b: [f64; 2],
    c: [f64; 3],
    /// Rounding of the quadratic's value.
    rounding: f64,
    /// Discriminants within this of zero are unsure.
    tangent: f64,
}

impl<'a> Sweep<'a> {
    /// Prepares the part of a segment between the heights `from` and `to`, given in world units and, for speed, in
    /// voxels as well.
    #[inline]
    pub(super) fn new(
        placed: Placed,
        world: &'a Segment,
        segment: &Segment,
        widest: f64,
        from: f64,
        to: f64,
    ) -> Self {
        let d = placed.direction;
        let lean = d.x * d.x + d.y * d.y;
        let (method, a, b, mut c) = match *segment {
            Segment::Line { from, to, radius_from, radius_to } => {
                let k = if radius_from == radius_to { 0.0 } else { (radius_to - radius_from) / (to - from) };
                let at_zero = radius_from - k * from;
                let a = lean - k * k * d.z * d.z;
                let method = match (k == 0.0, a) {
                    (true, a) if a < FLAT => Method::Upright,
                    (false, a) if a.abs() < FLAT => Method::Convex,
                    (_, a) if a > 0.0 => Method::Between,
                    _ if k * d.z > 0.0 => Method::Above,
                    _ => Method::Below,
                };
                let b = [-k * at_zero * d.z, -d.z * (1.0 + k * k)];
                (method, a, b, [-at_zero * at_zero, -2.0 * at_zero * k, -(1.0 + k * k)])
            }
            Segment::Arc { centre_height: h, centre_radius, arc_radius, .. } => {
                // The ball; for a torus the ball around it, from which Newton's method starts.
                let method = if centre_radius == 0.0 { Method::Between } else { Method::Convex };
                let radius = centre_radius + arc_radius;
                (method, 1.0, [-h * d.z, 0.0], [h * h - radius * radius, -2.0 * h, 0.0])
            }
        };
        c[0] -= SLACK;
        // Values of the quadratic are sums of squares up to the reach's; a hundred roundings of that size. A root's
        // error is rounding / (2·a·√discriminant): below CLOSE unless the discriminant is called tangent.
        let reach = from.abs().max(to.abs()) + widest + 1.0;
        let rounding = 4e-14 * reach * reach;
        let least_root = rounding / (CLOSE * a.abs());
        let level = d.z.abs() <= LEVEL;
        let (near, far) = if d.z > 0.0 { (from, to) } else { (to, from) };
        Self {
            placed,
            world,
            segment: *segment,
            from,
            to,
            widest,
            method,
            level,
            near,
            far,
            per_height: if level { 0.0 } else { 1.0 / d.z },
            a,
            per_a: 1.0 / a,
            b,
            c,
            rounding,
            tangent: least_root * least_root + rounding,
        }
    }

    /// Ends on the lines at `(x, y + lane)`, both relative to the tip.
    #[inline(always)]
    pub(super) fn ends(&self, x: f64, y: f64) -> Ends {
        match (self.method, self.level) {
            (Method::Between, false) => self.quadratic::<false>(x, y),
            (Method::Between, true) => self.quadratic::<true>(x, y),
            _ => self.one_by_one(x, y),
        }
    }

    /// Eight quadratics, in loops over lanes so that they become vector instructions.
    #[inline(always)]
    fn quadratic<const IS_LEVEL: bool>(&self, x: f64, y: f64) -> Ends {
        let d = self.placed.direction;
        let (mut low, mut high, mut unsure) = ([0.0; LANES], [0.0; LANES], [false; LANES]);
        for lane in 0..LANES {
            let y = y + lane as f64;
            let flat = x * d.x + y * d.y;
            let b = self.b[0] + self.b[1] * flat;
            let c = x * x + y * y + self.c[0] + flat * (self.c[1] + flat * self.c[2]);
            let discriminant = b * b - self.a * c;
            let root = discriminant.max(0.0).sqrt();
            let (first, last) = ((-b - root) * self.per_a, (-b + root) * self.per_a);
            let (enter, leave, edge) = if IS_LEVEL {
                // The height hardly changes along the line.
                let margin = (flat - self.from).min(self.to - flat);
                (if margin < -1e-3 { FAR } else { -FAR }, FAR, margin.abs() < 1e-3)
            } else {
                ((self.near - flat) * self.per_height, (self.far - flat) * self.per_height, false)
            };
            let (enter, leave) = (enter.max(first), leave.min(last));
            let misses = discriminant < -self.tangent;
            low[lane] = if misses { FAR } else { enter };
            high[lane] = if misses { -FAR } else { leave };
            unsure[lane] = (discriminant.abs() <= self.tangent) | (edge & !misses);
        }
        Ends { low, high, unsure }
    }

    #[inline(never)]
    fn one_by_one(&self, x: f64, y: f64) -> Ends {
        let (mut low, mut high, mut unsure) = ([0.0; LANES], [0.0; LANES], [false; LANES]);
        for lane in 0..LANES {
            (low[lane], high[lane], unsure[lane]) = self.line(x, y + lane as f64);
        }
        Ends { low, high, unsure }
    }

    /// One line by whichever method; unsure ends are generous.
    fn line(&self, x: f64, y: f64) -> (f64, f64, bool) {
        const MISS: (f64, f64, bool) = (FAR, -FAR, false);
        let d = self.placed.direction;
        let flat = x * d.x + y * d.y;
        let (enter, leave, edge) = if self.level {
            let margin = (flat - self.from).min(self.to - flat);
            if margin < -1e-3 {
                return MISS;
            }
            (-FAR, FAR, margin < 1e-3)
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
            Method::Above => (enter.max((-b - discriminant.sqrt()) * self.per_a), leave, edge),
            Method::Below => (enter, leave.min((-b + discriminant.sqrt()) * self.per_a), edge),
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
        const MISS: (f64, f64, bool) = (FAR, -FAR, false);
        let (mut first, mut last) = (enter, leave);
        if matches!(self.segment, Segment::Arc { .. }) {
            if discriminant < -self.tangent {
                return MISS;
            }
            let root = discriminant.max(0.0).sqrt() + 1e-6;
            (first, last) = (-b - root, -b + root);
        }
        let mut unsure = edge;
        for (end, side) in [(&mut first, 1.0), (&mut last, -1.0)] {
            let mut settled = false;
            for _ in 0..60 {
                let (value, slope, radius) = self.convex(x, y, flat, *end);
                if value <= 1e-11 {
                    unsure |= slope.abs() < 1e-2 || radius < 1e-2;
                    settled = true;
                    break;
                }
                if slope * side >= 0.0 {
                    if value > 1e-7 {
                        return MISS;
                    }
                    break;
                }
                *end -= value / slope;
                if *end > leave + 1.0 && side > 0.0 || *end < enter - 1.0 && side < 0.0 {
                    return MISS;
                }
            }
            unsure |= !settled;
        }
        if unsure {
            // Tangents are few: let every centre that may be meant be tried.
            (enter.max(first.min(last) - 1.0), leave.min(last.max(first) + 1.0), true)
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

    /// First and one past the last whole z of an unsure line at voxel (x, y), within `[least, most]`, by trying centres.
    #[inline(never)]
    pub(super) fn settle(
        &self,
        x: i64,
        y: i64,
        tangent: bool,
        (low, high): (f64, f64),
        bounds: (i64, i64),
    ) -> (i64, i64) {
        let (x, y) = (x as f64, y as f64);
        let tip = self.placed.tip;
        let (low, high) = if tangent {
            let (low, high, _) = self.line(x - tip.x, y - tip.y);
            (low - 0.5, high + 0.5)
        } else {
            (low, high)
        };
        let mut first = (((low + tip.z - 2.0 * CLOSE).ceil()).max(bounds.0 as f64)) as i64;
        let mut last = (((high + tip.z + 2.0 * CLOSE).floor()).min(bounds.1 as f64)) as i64;
        let inside = |z: i64| {
            let offset = (DVec3::new(x, y, z as f64) - tip) * self.placed.pitch;
            let slack = SLACK * self.placed.pitch * self.placed.pitch;
            holds(std::slice::from_ref(self.world), self.placed.direction, offset, slack)
        };
        while first <= last && !inside(first) {
            first += 1;
        }
        while first <= last && !inside(last) {
            last -= 1;
        }
        (first, last + 1)
    }

    /// Whole x whose lines may meet the segment.
    pub(super) fn columns(&self) -> (i64, i64) {
        let d = self.placed.direction;
        let spread = (1.0 - d.x * d.x).max(0.0).sqrt() * self.widest;
        let (one, other) = (self.from * d.x, self.to * d.x);
        let x = self.placed.tip.x;
        ((x + one.min(other) - spread).ceil() as i64, (x + one.max(other) + spread).floor() as i64)
    }
}

/// True where an end is so close to a voxel centre that rounding could decide. `end` is in voxel coordinates.
#[inline(always)]
pub(super) fn is_close(end: f64) -> bool {
    (end - whole(end)).abs() < CLOSE
}

/// 1.5·2⁵²: adding it rounds to whole numbers, which then stand in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

#[inline(always)]
fn whole(value: f64) -> f64 {
    (value + ROUND) - ROUND
}

/// The next whole number above a value that is not close to one and below 2³⁰ in size.
#[inline(always)]
pub(super) fn ceiling(value: f64) -> i32 {
    (value + 0.5 + ROUND).to_bits() as i32
}
