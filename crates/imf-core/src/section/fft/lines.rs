//! Fourier transforms of sixteen lines at once, one line a lane.
//!
//! Stockham's algorithm in mixed radix: a stage of radix r takes r points from r equally distant places, and leaves them
//! side by side, so that nothing is reordered. Every number is a vector of sixteen lines, so that nothing is transposed.

use pulp::{Arch, Simd, WithSimd};

/// Lines that are transformed together.
pub(super) const LANES: usize = 16;

/// One number of each line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

/// One complex number of each line: the real parts, then the imaginary ones.
pub(super) type Point = [Lanes; 2];

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

/// `cos` and `sin` of a fraction of a turn.
fn turn(part: usize, whole: usize) -> [f32; 2] {
    let angle = std::f64::consts::TAU * (part % whole) as f64 / whole as f64;
    [angle.cos() as f32, angle.sin() as f32]
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

    /// Σ values[j]·exp(−2πi·jk / length) for every k: in one of the two slices, which is returned.
    pub(super) fn forward<'a>(&self, values: &'a mut [Point], other: &'a mut [Point]) -> &'a mut [Point] {
        self.run([0, 1], values, other)
    }

    /// Σ values[k]·exp(2πi·jk / length) for every j: in one of the two slices, which is returned.
    pub(super) fn inverse<'a>(&self, values: &'a mut [Point], other: &'a mut [Point]) -> &'a mut [Point] {
        // Of numbers whose parts are exchanged, with the parts of its result exchanged.
        self.run([1, 0], values, other)
    }

    fn run<'a>(&self, parts: [usize; 2], values: &'a mut [Point], other: &'a mut [Point]) -> &'a mut [Point] {
        assert!(values.len() == self.length && other.len() == self.length, "one value for each point");
        let (mut from, mut to) = (values, other);
        for stage in &self.stages {
            self.arch.dispatch(Pass { stage, parts, from, to });
            (from, to) = (to, from);
        }
        from
    }
}

/// One stage over all points.
struct Pass<'a> {
    stage: &'a Stage,
    /// Where real and imaginary parts stand.
    parts: [usize; 2],
    from: &'a [Point],
    to: &'a mut [Point],
}

impl WithSimd for Pass<'_> {
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

impl Pass<'_> {
    #[inline(always)]
    fn with<S: Simd, const R: usize, B: Butterfly<R>>(self, simd: S, butterfly: &B) {
        let Self { stage, parts: [re, im], from, to } = self;
        let (stride, steps) = (stage.stride, stage.steps);
        for step in 0..steps {
            let twiddles = &stage.twiddles[step * (R - 1)..][..R - 1];
            let mut sources = [from; R];
            for (k, source) in sources.iter_mut().enumerate() {
                *source = &from[stride * (step + steps * k)..][..stride];
            }
            let target = &mut to[stride * R * step..][..stride * R];
            for at in 0..stride {
                for chunk in 0..LANES / S::F32_LANES {
                    let mut values = [[simd.splat_f32s(0.0); 2]; R];
                    for (value, source) in values.iter_mut().zip(&sources) {
                        let point = &source[at];
                        *value = [part::<S>(&point[re], chunk), part::<S>(&point[im], chunk)];
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
                        let point = &mut target[stride * k + at];
                        S::as_mut_simd_f32s(&mut point[re].0).0[chunk] = value[0];
                        S::as_mut_simd_f32s(&mut point[im].0).0[chunk] = value[1];
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn part<S: Simd>(lanes: &Lanes, chunk: usize) -> S::f32s {
    S::as_simd_f32s(&lanes.0).0[chunk]
}

/// The transform of R numbers.
trait Butterfly<const R: usize> {
    fn transform<S: Simd>(&self, simd: S, values: [[S::f32s; 2]; R]) -> [[S::f32s; 2]; R];
}

#[inline(always)]
fn add<S: Simd>(simd: S, a: [S::f32s; 2], b: [S::f32s; 2]) -> [S::f32s; 2] {
    [simd.add_f32s(a[0], b[0]), simd.add_f32s(a[1], b[1])]
}

#[inline(always)]
fn sub<S: Simd>(simd: S, a: [S::f32s; 2], b: [S::f32s; 2]) -> [S::f32s; 2] {
    [simd.sub_f32s(a[0], b[0]), simd.sub_f32s(a[1], b[1])]
}

/// a − i·b and a + i·b.
#[inline(always)]
fn turned<S: Simd>(simd: S, a: [S::f32s; 2], b: [S::f32s; 2]) -> [[S::f32s; 2]; 2] {
    [
        [simd.add_f32s(a[0], b[1]), simd.sub_f32s(a[1], b[0])],
        [simd.sub_f32s(a[0], b[1]), simd.add_f32s(a[1], b[0])],
    ]
}

struct Two;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, [a, b]: [[S::f32s; 2]; 2]) -> [[S::f32s; 2]; 2] {
        [add(simd, a, b), sub(simd, a, b)]
    }
}

struct Four;

impl Butterfly<4> for Four {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, [a, b, c, d]: [[S::f32s; 2]; 4]) -> [[S::f32s; 2]; 4] {
        let (even, odd) = (add(simd, a, c), add(simd, b, d));
        let [minus, plus] = turned(simd, sub(simd, a, c), sub(simd, b, d));
        [add(simd, even, odd), minus, sub(simd, even, odd), plus]
    }
}

struct Eight;

impl Butterfly<8> for Eight {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, [a, b, c, d, e, f, g, h]: [[S::f32s; 2]; 8]) -> [[S::f32s; 2]; 8] {
        let [e0, e1, e2, e3] = Four.transform(simd, [a, c, e, g]);
        let [o0, o1, o2, o3] = Four.transform(simd, [b, d, f, h]);
        let root = simd.splat_f32s(std::f32::consts::FRAC_1_SQRT_2);
        // By an eighth of a turn, (1 − i)/√2, and by three, (−1 − i)/√2.
        let o1 = [
            simd.mul_f32s(root, simd.add_f32s(o1[0], o1[1])),
            simd.mul_f32s(root, simd.sub_f32s(o1[1], o1[0])),
        ];
        let o3 = [
            simd.mul_f32s(root, simd.sub_f32s(o3[1], o3[0])),
            simd.neg_f32s(simd.mul_f32s(root, simd.add_f32s(o3[0], o3[1]))),
        ];
        let [minus, plus] = turned(simd, e2, o2);
        [
            add(simd, e0, o0),
            add(simd, e1, o1),
            minus,
            add(simd, e3, o3),
            sub(simd, e0, o0),
            sub(simd, e1, o1),
            plus,
            sub(simd, e3, o3),
        ]
    }
}

/// Of 3, 5 or 7 numbers: by sums and differences of those that lie opposite each other.
struct Odd<const R: usize> {
    /// Cosine and sine of k turns by R.
    turns: [[f32; 2]; R],
}

impl<const R: usize> Odd<R> {
    #[inline(always)]
    fn new() -> Self {
        Self { turns: std::array::from_fn(|k| turn(k, R)) }
    }
}

impl<const R: usize> Butterfly<R> for Odd<R> {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, values: [[S::f32s; 2]; R]) -> [[S::f32s; 2]; R] {
        let mut result = values;
        for k in 1..=R / 2 {
            result[0] = add(simd, result[0], add(simd, values[k], values[R - k]));
        }
        for u in 1..=R / 2 {
            let (mut even, mut odd) = (values[0], [simd.splat_f32s(0.0); 2]);
            for k in 1..=R / 2 {
                let [cos, sin] = self.turns[k * u % R];
                let [cos, sin] = [simd.splat_f32s(cos), simd.splat_f32s(sin)];
                let (sum, difference) =
                    (add(simd, values[k], values[R - k]), sub(simd, values[k], values[R - k]));
                even = [simd.mul_add_e_f32s(cos, sum[0], even[0]), simd.mul_add_e_f32s(cos, sum[1], even[1])];
                odd = [
                    simd.mul_add_e_f32s(sin, difference[0], odd[0]),
                    simd.mul_add_e_f32s(sin, difference[1], odd[1]),
                ];
            }
            [result[u], result[R - u]] = turned(simd, even, odd);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, in f64.
    fn slow(values: &[Point], lane: usize, sign: f64) -> Vec<[f64; 2]> {
        let n = values.len();
        let term = |j: usize, k: usize| {
            let (sin, cos) = (sign * std::f64::consts::TAU * (j * k % n) as f64 / n as f64).sin_cos();
            let [re, im] = values[j].map(|part| f64::from(part.0[lane]));
            [re * cos - im * sin, re * sin + im * cos]
        };
        let sum = |k| (0..n).map(|j| term(j, k)).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        (0..n).map(sum).collect()
    }

    #[test]
    fn transforms_of_every_radix_are_the_definition() {
        for length in [1, 2, 3, 4, 5, 6, 7, 8, 16, 30, 49, 64, 84, 126, 200, 210] {
            let mut seed = 1u32;
            let mut number = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
            };
            let values: Vec<Point> =
                (0..length).map(|_| [(); 2].map(|()| Lanes(std::array::from_fn(|_| number())))).collect();
            for arch in [Arch::Scalar, Arch::new()] {
                let transform = LineTransform::new(arch, length);
                for sign in [-1.0, 1.0] {
                    let (mut from, mut to) = (values.clone(), values.clone());
                    let result = if sign < 0.0 {
                        transform.forward(&mut from, &mut to)
                    } else {
                        transform.inverse(&mut from, &mut to)
                    };
                    for lane in [0, 7, LANES - 1] {
                        for (point, expected) in result.iter().zip(slow(&values, lane, sign)) {
                            let found = point.map(|part| f64::from(part.0[lane]));
                            let far = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                            assert!(far < 3e-6 * length as f64, "{length} {sign}: {found:?} {expected:?}");
                        }
                    }
                }
            }
        }
    }
}
