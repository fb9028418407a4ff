//! Fourier transforms of sixteen lines at once, one line a lane.
//!
//! Stockham's algorithm in mixed radix: a stage of radix r takes r points from r equally distant places, and leaves them
//! side by side, so that nothing is reordered. Every number is a vector of sixteen lines, so that nothing is transposed.

use pulp::{Arch, Simd, WithSimd};

use super::butterflies::{Butterfly, Eight, Four, Odd, Two, turn};

/// Lines that are transformed together.
pub(super) const LANES: usize = 16;

/// One number of each line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

/// One complex number of each line: the real parts, then the imaginary ones.
pub(super) type Point = [Lanes; 2];

pub(super) const ZERO: Point = [Lanes([0.0; LANES]); 2];

/// Transforms of lines of one length, a product of 2, 3, 5 and 7.
pub(super) struct LineTransform {
    arch: Arch,
    length: usize,
    stages: Vec<Stage>,
}

/// One stage: `stride` transforms of length `radix · steps`, interleaved, become `radix` times as many of length `steps`.
struct Stage {
    radix: usize,
    stride: usize,
    steps: usize,
    /// `[steps][radix − 1]` complex: exp(−2πi·step·k / (radix·steps)) for k from 1 on.
    twiddles: Vec<[f32; 2]>,
}

impl LineTransform {
    pub(super) fn new(arch: Arch, length: usize) -> Self {
        let mut stages = Vec::new();
        let (mut stride, mut rest) = (1, length);
        while rest > 1 {
            // Odd factors first, then eights, last the 2 or 4 that they leave.
            let radix = [7, 5, 3, 8, 4, 2].into_iter().find(|radix| rest % radix == 0).unwrap_or(rest);
            let steps = rest / radix;
            let factors = (0..steps).flat_map(|step| (1..radix).map(move |k| turn(step * k, rest)));
            let twiddles = factors.map(|[cos, sin]| [cos, -sin]).collect();
            stages.push(Stage { radix, stride, steps, twiddles });
            (stride, rest) = (stride * radix, steps);
        }
        Self { arch, length, stages }
    }

    /// Σ p(j)·exp(−2πi·jk / length) over the places j of a segment, whose points p(j) are among `points`, for every k, into `to[k]`.
    pub(super) fn forward(&self, points: &[Point], segment: Segment, to: &mut [Point], work: &mut Work) {
        assert!(segment.holds(points), "a point for each place");
        self.run(
            [0, 1],
            Within { points, segment, length: self.length },
            (to, Segment::whole(self.length)),
            work,
        );
    }

    /// Σ points[k]·exp(2πi·jk / length) for the places j of a segment, into `to`.
    pub(super) fn inverse(&self, points: &[Point], to: (&mut [Point], Segment), work: &mut Work) {
        // Of numbers whose parts are exchanged, with the parts of its result exchanged.
        self.run([1, 0], &points[..self.length], to, work);
    }

    /// The same of each factor times the point's conjugate.
    pub(super) fn inverse_of_product(
        &self,
        factors: &[Point],
        points: &[Point],
        to: (&mut [Point], Segment),
        work: &mut Work,
    ) {
        self.run(
            [1, 0],
            Product { factors: &factors[..self.length], points: &points[..self.length] },
            to,
            work,
        );
    }

    fn run(
        &self,
        parts: [usize; 2],
        from: impl Source,
        (to, segment): (&mut [Point], Segment),
        [now, next]: &mut Work,
    ) {
        assert!(segment.holds(to), "a point for each place");
        let mut to = Within { points: to, segment, length: self.length };
        for between in [&mut *now, &mut *next] {
            between.resize(between.len().max(self.length), ZERO);
        }
        let (mut now, mut next) = (&mut now[..self.length], &mut next[..self.length]);
        let [first, others @ ..] = &self.stages[..] else { unreachable!("at least two points") };
        self.arch.dispatch(Pass { stage: first, parts, from, to: &mut *now });
        let Some((last, middle)) = others.split_last() else {
            now.iter()
                .enumerate()
                .for_each(|(place, &from)| to.point(place).into_iter().for_each(|to| *to = from));
            return;
        };
        for stage in middle {
            self.arch.dispatch(Pass { stage, parts, from: &*now, to: &mut *next });
            (now, next) = (next, now);
        }
        self.arch.dispatch(Pass { stage: last, parts, from: &*now, to });
    }
}

/// Two lines between which stages go; they grow as needed.
pub(super) type Work = [Vec<Point>; 2];

/// Places of a circle one after the other: those that may not be zero, or those that are asked for.
#[derive(Clone, Copy)]
pub(super) struct Segment {
    /// The first place.
    pub(super) begin: usize,
    pub(super) count: usize,
    /// From one to the next in memory.
    pub(super) step: usize,
}

impl Segment {
    /// A whole circle.
    pub(super) fn whole(length: usize) -> Self {
        Self { begin: 0, count: length, step: 1 }
    }

    fn holds(&self, points: &[Point]) -> bool {
        self.count == 0 || (self.count - 1) * self.step < points.len()
    }

    /// Where a place stands in memory; beyond all where it is none of these.
    #[inline(always)]
    fn position(&self, place: usize, length: usize) -> usize {
        let at = if place < self.begin { place + length - self.begin } else { place - self.begin };
        if at < self.count { at * self.step } else { usize::MAX }
    }
}

/// What a stage takes: rows of points, which are adjacent places of the circle.
trait Source {
    type Row: Copy;
    fn row(&self, place: usize, count: usize) -> Self::Row;
    fn load<S: Simd>(simd: S, parts: [usize; 2], row: Self::Row, at: usize, chunk: usize) -> [S::f32s; 2];
}

impl<'a> Source for &'a [Point] {
    type Row = &'a [Point];

    #[inline(always)]
    fn row(&self, place: usize, count: usize) -> Self::Row {
        &self[place..][..count]
    }

    #[inline(always)]
    fn load<S: Simd>(_: S, parts: [usize; 2], row: Self::Row, at: usize, chunk: usize) -> [S::f32s; 2] {
        parts.map(|part| lanes::<S>(&row[at][part], chunk))
    }
}

/// Points of a segment of a circle; others are zero.
struct Within<P> {
    points: P,
    segment: Segment,
    length: usize,
}

/// For the first stage, whose rows are single points.
impl<'a> Source for Within<&'a [Point]> {
    type Row = &'a Point;

    #[inline(always)]
    fn row(&self, place: usize, _: usize) -> Self::Row {
        self.points.get(self.segment.position(place, self.length)).unwrap_or(&ZERO)
    }

    #[inline(always)]
    fn load<S: Simd>(_: S, parts: [usize; 2], row: Self::Row, _: usize, chunk: usize) -> [S::f32s; 2] {
        parts.map(|part| lanes::<S>(&row[part], chunk))
    }
}

/// Each factor times the point's conjugate.
struct Product<'a> {
    factors: &'a [Point],
    points: &'a [Point],
}

/// For the first stage of an inverse transform, which takes the imaginary parts first.
impl<'a> Source for Product<'a> {
    type Row = [&'a Point; 2];

    #[inline(always)]
    fn row(&self, place: usize, _: usize) -> Self::Row {
        [&self.factors[place], &self.points[place]]
    }

    #[inline(always)]
    fn load<S: Simd>(simd: S, parts: [usize; 2], row: Self::Row, _: usize, chunk: usize) -> [S::f32s; 2] {
        debug_assert!(parts == [1, 0], "imaginary parts first");
        let [[d, c], [b, a]] = row.map(|point| parts.map(|part| lanes::<S>(&point[part], chunk)));
        [
            simd.mul_add_e_f32s(a, d, simd.neg_f32s(simd.mul_f32s(b, c))),
            simd.mul_add_e_f32s(a, c, simd.mul_f32s(b, d)),
        ]
    }
}

/// What a stage gives. A place that nobody asks for has no point.
trait Sink {
    fn point(&mut self, place: usize) -> Option<&mut Point>;
}

impl Sink for &mut [Point] {
    #[inline(always)]
    fn point(&mut self, place: usize) -> Option<&mut Point> {
        self.get_mut(place)
    }
}

impl Sink for Within<&mut [Point]> {
    #[inline(always)]
    fn point(&mut self, place: usize) -> Option<&mut Point> {
        self.points.get_mut(self.segment.position(place, self.length))
    }
}

/// One stage over all points.
struct Pass<'a, F, T> {
    stage: &'a Stage,
    /// Where real and imaginary parts stand.
    parts: [usize; 2],
    from: F,
    to: T,
}

impl<F: Source, T: Sink> WithSimd for Pass<'_, F, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.stage.radix {
            2 => self.with::<S, 2, _>(simd, &Two),
            3 => self.with::<S, 3, _>(simd, &Odd::<3>::new()),
            4 => self.with::<S, 4, _>(simd, &Four),
            5 => self.with::<S, 5, _>(simd, &Odd::<5>::new()),
            7 => self.with::<S, 7, _>(simd, &Odd::<7>::new()),
            8 => self.with::<S, 8, _>(simd, &Eight),
            radix => unreachable!("no factor of a fast length: {radix}"),
        }
    }
}

impl<F: Source, T: Sink> Pass<'_, F, T> {
    #[inline(always)]
    fn with<S: Simd, const R: usize, B: Butterfly<R>>(self, simd: S, butterfly: &B) {
        let Self { stage, parts, from, mut to } = self;
        let [re, im] = parts;
        let (stride, steps) = (stage.stride, stage.steps);
        for step in 0..steps {
            let twiddles = &stage.twiddles[step * (R - 1)..][..R - 1];
            let rows: [F::Row; R] = std::array::from_fn(|k| from.row(stride * (step + steps * k), stride));
            for at in 0..stride {
                for chunk in 0..LANES / S::F32_LANES {
                    let mut values = [[simd.splat_f32s(0.0); 2]; R];
                    for (value, &row) in values.iter_mut().zip(&rows) {
                        *value = F::load(simd, parts, row, at, chunk);
                    }
                    let mut values = butterfly.transform(simd, values);
                    if step > 0 {
                        for (value, factor) in values[1..].iter_mut().zip(twiddles) {
                            let [a, b] = *value;
                            let [c, d] = [simd.splat_f32s(factor[0]), simd.splat_f32s(factor[1])];
                            *value = [
                                simd.mul_add_e_f32s(a, c, simd.neg_f32s(simd.mul_f32s(b, d))),
                                simd.mul_add_e_f32s(a, d, simd.mul_f32s(b, c)),
                            ];
                        }
                    }
                    for (k, value) in values.iter().enumerate() {
                        if let Some(point) = to.point(stride * (R * step + k) + at) {
                            S::as_mut_simd_f32s(&mut point[re].0).0[chunk] = value[0];
                            S::as_mut_simd_f32s(&mut point[im].0).0[chunk] = value[1];
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn lanes<S: Simd>(lanes: &Lanes, chunk: usize) -> S::f32s {
    S::as_simd_f32s(&lanes.0).0[chunk]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::archs;

    /// The definition, in f64.
    fn slow(n: usize, sign: f64, value: impl Fn(usize) -> [f32; 2]) -> Vec<[f64; 2]> {
        let term = |j: usize, k: usize| {
            let (sin, cos) = (sign * std::f64::consts::TAU * (j * k % n) as f64 / n as f64).sin_cos();
            let [re, im] = value(j).map(f64::from);
            [re * cos - im * sin, re * sin + im * cos]
        };
        let sum = |k| (0..n).map(|j| term(j, k)).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        (0..n).map(sum).collect()
    }

    #[test]
    fn transforms_of_every_radix_are_the_definition() {
        for length in [2, 3, 4, 5, 6, 7, 8, 16, 30, 49, 64, 84, 126, 200, 210] {
            let mut seed = 1u32;
            let mut number = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
            };
            let mut values = || -> Vec<Point> {
                (0..length).map(|_| [(); 2].map(|()| Lanes(std::array::from_fn(|_| number())))).collect()
            };
            let (values, factors) = (values(), values());
            // Two thirds of the circle, beyond its end; of each three points in memory one.
            let segment = Segment { begin: length / 2, count: (2 * length).div_ceil(3), step: 3 };
            let places: Vec<usize> = (0..segment.count).map(|at| (segment.begin + at) % length).collect();
            let mut spread = vec![[Lanes([9.0; LANES]); 2]; length * 3];
            places.iter().enumerate().for_each(|(at, &place)| spread[at * 3] = values[place]);
            let within: Vec<Point> =
                (0..length).map(|place| if places.contains(&place) { values[place] } else { ZERO }).collect();
            let product = |lane: usize, k: usize| {
                let [[a, b], [c, d]] = [values[k], factors[k]].map(|point| point.map(|part| part.0[lane]));
                [a * c + b * d, a * d - b * c]
            };
            let check = |found: Point, lane: usize, expected: [f64; 2]| {
                let found = found.map(|part| f64::from(part.0[lane]));
                let far = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                assert!(far < 3e-6 * length as f64, "{length}: {found:?} {expected:?}");
            };
            for arch in archs() {
                let transform = LineTransform::new(arch, length);
                let mut work = Work::default();
                let mut all = vec![ZERO; length];
                transform.forward(&spread, segment, &mut all, &mut work);
                let [mut plain, mut times] = [(); 2].map(|()| vec![ZERO; length * 3]);
                transform.inverse(&values, (&mut plain, segment), &mut work);
                transform.inverse_of_product(&factors, &values, (&mut times, segment), &mut work);
                for lane in [0, 7, LANES - 1] {
                    let forward = slow(length, -1.0, |k| within[k].map(|part| part.0[lane]));
                    all.iter().zip(forward).for_each(|(&found, expected)| check(found, lane, expected));
                    let inverse = slow(length, 1.0, |k| values[k].map(|part| part.0[lane]));
                    let inverse_of_product = slow(length, 1.0, |k| product(lane, k));
                    for (at, &place) in places.iter().enumerate() {
                        check(plain[at * 3], lane, inverse[place]);
                        check(times[at * 3], lane, inverse_of_product[place]);
                    }
                }
                // What was not asked for is not touched.
                let asked = |at: usize| at.is_multiple_of(3) && at / 3 < segment.count;
                for found in [&plain, &times] {
                    assert!(
                        found.iter().enumerate().all(|(at, point)| asked(at) || *point == ZERO),
                        "{length}"
                    );
                }
            }
        }
    }
}
