//! Sine and cosine of whole vectors of `f32`, with the instruction set chosen at run time.
//!
//! The argument is reduced by the nearest multiple of π, taken off in three parts (Cody and Waite), to
//! `r ∈ [−π/2, π/2]`; then sin x = ±sin r and cos x = ±cos r with the multiple's parity as the common sign, so that
//! no quadrant has to be selected. Both polynomials are minimax on that interval (error 4.7e-9 and 5.4e-8).
//!
//! Absolute error at most 5e-7 for |x| ≤ 1000. NaN and infinities give NaN. Beyond |x| ≈ 1e6 the reduction runs out of
//! bits and the value means nothing; a network whose sums are that large has diverged.

use pulp::Simd;

/// 1.5·2²³: adding it rounds to an integer, whose lowest bit is then the lowest bit of the sum.
const ROUND: f32 = 12_582_912.0;
/// π in three parts; the first two have so few bits that their products with multiples up to 2¹² are exact even
/// where multiplication and addition are not fused.
const PI_PARTS: [f32; 3] = [3.140_625, 9.675_026e-4, 1.509_958e-7];
/// `sin r = r + r³·(…)` in powers of r².
const SINE: [f32; 4] = [-0.166_666_57, 0.008_333_016, -0.000_198_065_06, 2.599_812_4e-6];
/// `cos r = 1 + r²·(…)` in powers of r².
const COSINE: [f32; 4] = [-0.499_999_3, 0.041_663_98, -0.001_385_582_4, 2.319_189_5e-5];

/// The argument's remainder, its square, and the sign bit that sine and cosine share.
#[inline(always)]
fn reduce<S: Simd>(simd: S, x: S::f32s) -> (S::f32s, S::f32s, S::u32s) {
    let rounded =
        simd.mul_add_e_f32s(x, simd.splat_f32s(std::f32::consts::FRAC_1_PI), simd.splat_f32s(ROUND));
    let sign = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(rounded), simd.splat_u32s(31));
    let multiple = simd.sub_f32s(rounded, simd.splat_f32s(ROUND));
    let mut rest = x;
    for part in PI_PARTS {
        rest = simd.mul_add_e_f32s(multiple, simd.splat_f32s(-part), rest);
    }
    (rest, simd.mul_f32s(rest, rest), sign)
}

#[inline(always)]
fn polynomial<S: Simd>(simd: S, square: S::f32s, coefficients: [f32; 4]) -> S::f32s {
    let mut value = simd.splat_f32s(coefficients[3]);
    for coefficient in [coefficients[2], coefficients[1], coefficients[0]] {
        value = simd.mul_add_e_f32s(value, square, simd.splat_f32s(coefficient));
    }
    value
}

#[inline(always)]
fn with_sign<S: Simd>(simd: S, value: S::f32s, sign: S::u32s) -> S::f32s {
    simd.transmute_f32s_u32s(simd.xor_u32s(simd.transmute_u32s_f32s(value), sign))
}

/// Sine of one register.
#[inline(always)]
pub(crate) fn sine<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let (rest, square, sign) = reduce(simd, x);
    let cube = simd.mul_f32s(rest, square);
    with_sign(simd, simd.mul_add_e_f32s(cube, polynomial(simd, square, SINE), rest), sign)
}

/// Sine and cosine of one register.
#[inline(always)]
pub(crate) fn sine_cosine<S: Simd>(simd: S, x: S::f32s) -> (S::f32s, S::f32s) {
    let (rest, square, sign) = reduce(simd, x);
    let cube = simd.mul_f32s(rest, square);
    let sine = simd.mul_add_e_f32s(cube, polynomial(simd, square, SINE), rest);
    let cosine = simd.mul_add_e_f32s(square, polynomial(simd, square, COSINE), simd.splat_f32s(1.0));
    (with_sign(simd, sine, sign), with_sign(simd, cosine, sign))
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;
    use crate::siren::lanes::{archs, load, store};

    /// Values with their sines by themselves, and with their sines and cosines together.
    fn sines_and_cosines(arch: Arch, values: &[f32]) -> [Vec<f32>; 3] {
        struct Pass<'a>(&'a [f32], &'a mut [Vec<f32>; 3]);
        impl WithSimd for Pass<'_> {
            type Output = ();
            #[inline(always)]
            fn with_simd<S: Simd>(self, simd: S) {
                let Self(values, [alone, sines, cosines]) = self;
                for at in (0..values.len()).step_by(S::F32_LANES) {
                    let value = load(simd, values, at);
                    let (both, cosine) = sine_cosine(simd, value);
                    store(simd, alone, at, sine(simd, value));
                    store(simd, sines, at, both);
                    store(simd, cosines, at, cosine);
                }
            }
        }
        let mut found = [0, 1, 2].map(|_| vec![7.0; values.len()]);
        arch.dispatch(Pass(values, &mut found));
        found
    }

    /// Half a unit in the last place of the reduced argument and of the result, and the polynomials' own error.
    const TOLERANCE: f64 = 5e-7;

    #[test]
    fn sine_and_cosine_keep_their_error_bound() {
        // An odd length, so that the tail is exercised; steps that hit multiples of π/2 closely as well.
        let mut arguments: Vec<f32> = (0..200_003).map(|i| (i as f32 / 200_003.0 - 0.5) * 2000.0).collect();
        arguments.extend((-600..=600).map(|i| i as f32 * std::f32::consts::FRAC_PI_2));
        for arch in archs() {
            let [alone, both, cosines] = sines_and_cosines(arch, &arguments);
            assert_eq!(alone, both, "the sine does not depend on whether the cosine is wanted");
            for ((&x, &s), &c) in arguments.iter().zip(&both).zip(&cosines) {
                let (sine, cosine) = f64::from(x).sin_cos();
                assert!((f64::from(s) - sine).abs() <= TOLERANCE, "sin({x}) = {s}, not {sine}");
                assert!((f64::from(c) - cosine).abs() <= TOLERANCE, "cos({x}) = {c}, not {cosine}");
            }
        }
    }

    #[test]
    fn what_is_not_finite_gives_nan_and_zero_keeps_its_value() {
        for arch in archs() {
            let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0];
            let [_, values, cosines] = sines_and_cosines(arch, &values);
            assert!(values[..3].iter().chain(&cosines[..3]).all(|v| v.is_nan()));
            assert_eq!((values[3], values[4], cosines[3]), (0.0, 0.0, 1.0));
        }
    }
}
