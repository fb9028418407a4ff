// Purpose: sine and cosine of four angles with the same accuracy on every device; WGSL bounds the accuracy of its
// own `sin` only in [−π, π].
//
// x = n·π/2 + r with n = round(x·2/π) and |r| ≤ π/4 (Cody and Waite): π/2 is a sum of three numbers of few bits, so
// that n times each of the first two is exact for |n| < 4096. The polynomials on [−π/4, π/4] are those of Cephes
// (Moshier, `sinf.c`). Error at most 3e-7 for |x| ≤ 1000 (`shader/tests.rs`, which
// also shows a compiler that regroups sums, as Metal's fast math may).

struct SineCosine {
    sine: vec4<f32>,
    cosine: vec4<f32>,
}

const TWO_OVER_PI: f32 = 0.63661977;
const HALF_PI_1: f32 = 1.5703125;
const HALF_PI_2: f32 = 4.837512969970703e-4;
const HALF_PI_3: f32 = 7.549789948768648e-8;

fn sine_cosine(x: vec4<f32>) -> SineCosine {
    let n = round(x * TWO_OVER_PI);
    let r = ((x - n * HALF_PI_1) - n * HALF_PI_2) - n * HALF_PI_3;
    let q = r * r;
    let s = r + r * q * (-1.6666655e-1 + q * (8.332161e-3 + q * -1.9515296e-4));
    let c = (1.0 - 0.5 * q) + q * q * (4.1666646e-2 + q * (-1.3887316e-3 + q * 2.4433157e-5));
    // Quadrants: (s, c), (c, −s), (−s, −c), (−c, s).
    let quadrant = vec4<i32>(n) & vec4<i32>(3);
    let odd = (quadrant & vec4<i32>(1)) == vec4<i32>(1);
    let sine_sign = select(vec4<f32>(1.0), vec4<f32>(-1.0), quadrant >= vec4<i32>(2));
    let cosine_sign = select(vec4<f32>(1.0), vec4<f32>(-1.0), (quadrant == vec4<i32>(1)) | (quadrant == vec4<i32>(2)));
    return SineCosine(sine_sign * select(s, c, odd), cosine_sign * select(c, s, odd));
}
