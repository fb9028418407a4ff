//! Where a line of voxel centres along z enters and leaves one segment of a body of revolution.
//!
//! A segment is convex, so a line is inside between two ends or never. Within the slab of heights `from ≤ h < to` a
//! cylinder, a cone and a ball are each a quadratic in z, `a z² + 2 b z + c ≤ 0`, solved for eight lines at a time; a
//! torus, and a cone along whose flank the line runs, by Newton's method on a convex function. Where an end lies so
//! close to a voxel centre that rounding could decide, or a line hardly touches, centres are tried one by one with the
//! predicate that defines the tool, so that the whole numbers are the definition's.
//!
//! All lengths here are in voxels.

mod one_line;

use glam::DVec3;
use pulp::Simd;

use crate::tool::{SLACK, Segment, contains};

/// Lines that are solved together.
pub(super) const LANES: usize = 8;
/// Farther than any voxel.
const FAR: f64 = 1e9;
/// An end this close to a voxel centre is unsure. Rounding moves ends by less, see [`PlacedSegment::new`].
const CLOSE: f64 = 1e-5;
/// Tilt of the axis along z, |d_z|, below which heights do not bound the line well: the first number, or the second
/// times the tool's reach in voxels, since heights carry the rounding of the reach.
const LEVEL: [f64; 2] = [1e-6, 1e-10];
/// Leading coefficient below which a quadratic is solved by other means.
const FLAT: f64 = 1e-3;

/// A tool's pose in continuous voxel coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct VoxelPose {
    pub(super) tip: DVec3,
    /// From the tip along the axis.
    pub(super) direction: DVec3,
    /// Edge of a voxel in world units.
    pub(super) pitch: f64,
}

impl VoxelPose {
    #[inline]
    pub(super) fn on_axis(&self, height: f64) -> DVec3 {
        self.tip + self.direction * height
    }

    /// The predicate that defines the tool, for one voxel and a profile in world units.
    #[inline]
    pub(super) fn contains(&self, profile: &[Segment], voxel: [f64; 3]) -> bool {
        let offset = (DVec3::from_array(voxel) - self.tip) * self.pitch;
        contains(profile, self.direction, offset, self.pitch)
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

/// Runs on eight lines: the first whole z inside and one past the last, not above the first where there is none; each as [`whole_of`]
/// reads it.
pub(super) struct Runs {
    pub(super) from: [f64; LANES],
    pub(super) to: [f64; LANES],
    /// True where some line must be settled by trying centres; then the runs mean nothing.
    pub(super) doubt: bool,
}

impl Runs {
    #[inline(always)]
    pub(super) fn run(&self, lane: usize) -> (i32, i32) {
        (whole_of(self.from[lane]), whole_of(self.to[lane]))
    }

    /// Sets what was in doubt.
    pub(super) fn settle(&mut self, run: impl Fn(usize) -> (i64, i64)) {
        for lane in 0..LANES {
            let (from, to) = run(lane);
            (self.from[lane], self.to[lane]) = (from as f64 + ROUND, to as f64 + ROUND);
        }
    }

    /// Voxels on all eight lines together.
    #[inline(always)]
    pub(super) fn sum(&self) -> u32 {
        (0..LANES).map(|lane| (self.to[lane] - self.from[lane]).max(0.0)).sum::<f64>() as u32
    }
}

/// One segment in one pose.
pub(super) struct PlacedSegment<'a> {
    pub(super) placed: VoxelPose,
    /// The segment in world units.
    world: &'a Segment,
    /// The segment in voxels.
    segment: Segment,
    /// Heights between which it counts.
    pub(super) from: f64,
    pub(super) to: f64,
    /// Largest radius, a little generous.
    pub(super) widest: f64,
    method: Method,
    level: bool,
    /// How much heights on a level line may differ from that at the tip's z.
    edge: f64,
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
    /// The axis runs along the lines, exactly, and how far from it a line enters and leaves is known without solving.
    along: Option<Along>,
}

/// What a line along the axis meets at its own distance from it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Along {
    /// A cylinder: all of its height, or nothing.
    Cylinder,
    /// A torus: a circle.
    Torus,
}

/// Discriminants of a torus within this of zero are unsure: there the predicate's slack moves an end by more than [`CLOSE`].
const TORUS_TANGENT: f64 = 1e-6;

impl<'a> PlacedSegment<'a> {
    /// Prepares the part of a segment between the heights `from` and `to`, given in world units and, for speed, in
    /// voxels as well.
    #[inline]
    pub(super) fn new(
        placed: VoxelPose,
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
        let smallest_root = rounding / (CLOSE * a.abs());
        let tilt = d.z.abs();
        let level = tilt <= LEVEL[0].max(LEVEL[1] * reach);
        let edge = 1e-3 + tilt * (widest + tilt * reach);
        let along = match (lean == 0.0, method, segment) {
            (true, Method::Upright, _) => Some(Along::Cylinder),
            (true, Method::Convex, Segment::Arc { .. }) => Some(Along::Torus),
            _ => None,
        };
        let tangent = match along {
            Some(Along::Cylinder) => rounding,
            Some(Along::Torus) => TORUS_TANGENT,
            None => smallest_root * smallest_root + rounding,
        };
        // As the predicate has them, from which they are far apart where the axis is nearly level.
        let (bottom, top) = (from - SLACK, to - SLACK);
        let (near, far) = if d.z > 0.0 { (bottom, top) } else { (top, bottom) };
        Self {
            placed,
            world,
            segment: *segment,
            from,
            to,
            widest,
            method,
            level,
            edge,
            near,
            far,
            per_height: if level { 0.0 } else { 1.0 / d.z },
            a,
            per_a: 1.0 / a,
            b,
            c,
            rounding,
            tangent,
            along,
        }
    }

    /// Runs on the lines at `(x, y + lane)`, both relative to the tip, cut off at `[floor, top]`, which are a quarter of
    /// a voxel away from whole numbers.
    #[inline(always)]
    pub(super) fn runs<S: Simd>(&self, simd: S, x: f64, y: f64, (floor, top): (f64, f64)) -> Runs {
        let mut runs = Runs { from: [0.0; LANES], to: [0.0; LANES], doubt: false };
        if (self.method != Method::Between && self.along.is_none()) || self.level {
            runs.doubt = true;
            return runs;
        }
        const STEPS: [f64; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let d = self.placed.direction;
        let all = |value: f64| simd.splat_f64s(value);
        let (steps, _) = S::as_simd_f64s(&STEPS);
        let ((froms, _), (tos, _)) = (S::as_mut_simd_f64s(&mut runs.from), S::as_mut_simd_f64s(&mut runs.to));
        let torus = (self.along == Some(Along::Torus)).then(|| self.torus_discriminants(x, y));
        for (part, ((&step, from), to)) in steps.iter().zip(froms).zip(tos).enumerate() {
            let y = simd.add_f64s(all(y), step);
            let flat = simd.mul_add_f64s(y, all(d.y), all(x * d.x));
            let b = simd.mul_add_f64s(flat, all(self.b[1]), all(self.b[0]));
            let c = simd.mul_add_f64s(flat, all(self.c[2]), all(self.c[1]));
            let c = simd.mul_add_f64s(flat, c, simd.mul_add_f64s(y, y, all(x * x + self.c[0])));
            let discriminant = match (self.along, &torus) {
                (Some(Along::Cylinder), _) => simd.sub_f64s(all(0.0), c),
                (_, Some(torus)) => S::as_simd_f64s(torus).0[part],
                _ => simd.sub_f64s(simd.mul_f64s(b, b), simd.mul_f64s(all(self.a), c)),
            };
            let (first, last) = if self.along == Some(Along::Cylinder) {
                (all(-FAR), all(FAR))
            } else {
                let root = simd.sqrt_f64s(simd.max_f64s(discriminant, all(0.0)));
                let first = simd.mul_f64s(simd.add_f64s(b, root), all(-self.per_a));
                (first, simd.mul_f64s(simd.sub_f64s(root, b), all(self.per_a)))
            };
            let enter = simd.mul_f64s(simd.sub_f64s(all(self.near), flat), all(self.per_height));
            let leave = simd.mul_f64s(simd.sub_f64s(all(self.far), flat), all(self.per_height));
            let cut_off = |end| {
                let end = simd.add_f64s(end, all(self.placed.tip.z));
                simd.min_f64s(simd.max_f64s(end, all(floor)), all(top))
            };
            let (low, high) = (cut_off(simd.max_f64s(enter, first)), cut_off(simd.min_f64s(leave, last)));
            let misses = simd.less_than_f64s(discriminant, all(-self.tangent));
            let high = simd.select_f64s(misses, all(floor), high);
            let whole = |end| simd.sub_f64s(simd.add_f64s(end, all(ROUND)), all(ROUND));
            let off = |end| simd.abs_f64s(simd.sub_f64s(end, whole(end)));
            let close = simd.less_than_f64s(simd.min_f64s(off(low), off(high)), all(CLOSE));
            let touching = simd.less_than_or_equal_f64s(simd.abs_f64s(discriminant), all(self.tangent));
            let doubt = simd.first_true_m64s(simd.or_m64s(close, touching)) < S::F64_LANES;
            runs.doubt |= doubt;
            let above = |end| simd.add_f64s(simd.add_f64s(end, all(0.5)), all(ROUND));
            (*from, *to) = (above(low), above(high));
        }
        runs
    }

    /// Discriminants of a torus along the lines at `(x, y + lane)`. Out of line: inlined, the compiler takes its square roots for every kind
    /// of segment, on meaningless bytes where there is no arc.
    #[cold]
    #[inline(never)]
    fn torus_discriminants(&self, x: f64, y: f64) -> [f64; LANES] {
        let Segment::Arc { centre_radius, arc_radius, .. } = self.segment else { return [0.0; LANES] };
        std::array::from_fn(|lane| {
            let y = y + lane as f64;
            let out = ((x * x + y * y).sqrt() - centre_radius).max(0.0);
            arc_radius * arc_radius + SLACK - out * out
        })
    }

    /// First and one past the last whole z of the line at voxel (x, y), within the whole numbers `[lowest, highest]`.
    #[inline(never)]
    pub(super) fn run(&self, x: i64, y: i64, (lowest, highest): (i64, i64)) -> (i64, i64) {
        let tip = self.placed.tip;
        let (low, high, unsure) = self.line(x as f64 - tip.x, y as f64 - tip.y);
        let (low, high) = (low + tip.z, high + tip.z);
        if low > high + 1.0 {
            return (lowest, lowest);
        }
        let margin = if unsure { 0.5 } else { 2.0 * CLOSE };
        let mut first = (low - margin).ceil().max(lowest as f64) as i64;
        let mut last = (high + margin).floor().min(highest as f64) as i64;
        let inside = |z: i64| {
            let offset = (DVec3::new(x as f64, y as f64, z as f64) - tip) * self.placed.pitch;
            contains(std::slice::from_ref(self.world), self.placed.direction, offset, self.placed.pitch)
        };
        // Ends away from centres need no trying.
        if unsure || is_close(low) {
            while first <= last && !inside(first) {
                first += 1;
            }
        }
        if unsure || is_close(high) {
            while first <= last && !inside(last) {
                last -= 1;
            }
        }
        if first <= last { (first, last + 1) } else { (lowest, lowest) }
    }

    /// Lowest and highest z, relative to the tip, at which lines between two at `(x, y)` may meet the segment; both a little generous.
    #[inline(always)]
    pub(super) fn z_range(&self, x: f64, (y_low, y_high): (f64, f64)) -> (f64, f64) {
        let d = self.placed.direction;
        let spread = (1.0 - d.z * d.z).max(0.0).sqrt() * self.widest;
        let (one, other) = (self.from * d.z, self.to * d.z);
        let (mut low, mut high) = (one.min(other) - spread, one.max(other) + spread);
        if !self.level {
            let (one, other) = (x * d.x + y_low * d.y, x * d.x + y_high * d.y);
            let (flat_low, flat_high) = (one.min(other), one.max(other));
            let (near, far) = if d.z > 0.0 { (flat_high, flat_low) } else { (flat_low, flat_high) };
            low = low.max((self.near - near) * self.per_height);
            high = high.min((self.far - far) * self.per_height);
        }
        (low - 1e-3, high + 1e-3)
    }

    /// Whole x whose lines may meet the segment; a little generous, also where the axis runs along x.
    pub(super) fn columns(&self) -> (i64, i64) {
        let d = self.placed.direction;
        // Not by 1 − d.x², of which nothing is left where the axis hardly leaves x.
        let spread = (d.y * d.y + d.z * d.z).sqrt() * self.widest + 1e-6;
        let (one, other) = (self.from * d.x, self.to * d.x);
        let x = self.placed.tip.x;
        ((x + one.min(other) - spread).ceil() as i64, (x + one.max(other) + spread).floor() as i64)
    }
}

/// True where an end is so close to a voxel centre that rounding could decide, and wherever a run's margin reaches one. `end` is in
/// voxel coordinates.
fn is_close(end: f64) -> bool {
    (end - end.round()).abs() < 3.0 * CLOSE
}

/// 1.5·2⁵²: adding it rounds to whole numbers, which then stand in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// The whole number of a sum with [`ROUND`].
#[inline(always)]
pub(super) fn whole_of(rounded: f64) -> i32 {
    rounded.to_bits() as i32
}
