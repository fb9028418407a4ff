//! Transforms of few numbers, each a register of as many lines.

use pulp::Simd;

/// `cos` and `sin` of a fraction of a turn.
pub(super) fn turn(part: usize, whole: usize) -> [f32; 2] {
    let angle = std::f64::consts::TAU * (part % whole) as f64 / whole as f64;
    [angle.cos() as f32, angle.sin() as f32]
}

/// The transform of R numbers.
pub(super) trait Butterfly<const R: usize> {
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

pub(super) struct Two;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, [a, b]: [[S::f32s; 2]; 2]) -> [[S::f32s; 2]; 2] {
        [add(simd, a, b), sub(simd, a, b)]
    }
}

pub(super) struct Four;

impl Butterfly<4> for Four {
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, [a, b, c, d]: [[S::f32s; 2]; 4]) -> [[S::f32s; 2]; 4] {
        let (even, odd) = (add(simd, a, c), add(simd, b, d));
        let [minus, plus] = turned(simd, sub(simd, a, c), sub(simd, b, d));
        [add(simd, even, odd), minus, sub(simd, even, odd), plus]
    }
}

pub(super) struct Eight;

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
pub(super) struct Odd<const R: usize> {
    /// Cosine and sine of k turns by R.
    turns: [[f32; 2]; R],
}

impl<const R: usize> Odd<R> {
    #[inline(always)]
    pub(super) fn new() -> Self {
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
