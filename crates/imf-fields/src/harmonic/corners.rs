//! Eight voxels' coefficients mixed by weights: at a position between their centres.

use std::hint::black_box;

use imf_core::vectorised::vectorised;
use pulp::Arch;

use super::coefficients::Coefficients;

/// Where the corners' coefficients begin, and the weights of each: its own, and its derivatives along x, y and z.
pub(super) type Corners = [(usize, [f32; 4]); 8];

impl Coefficients {
    /// The sums of the corners' coefficients by their weights, `[rows][components]`; `scratch` is working memory.
    pub(super) fn mix(
        &self,
        corners: &Corners,
        components: usize,
        mixed: &mut [f32],
        scratch: &mut Vec<f32>,
    ) {
        // Corner by corner memory would be waited for several times.
        let touched = corners.iter().fold(0, |sum, (from, _)| sum ^ self.touch(*from, from + components));
        black_box(touched);
        #[cfg(target_arch = "x86_64")]
        if let Self::F16(values) = self
            && is_x86_feature_detected!("avx512f")
        {
            let corners = corners.map(|(from, weights)| (&values[from..from + components], weights));
            #[expect(unsafe_code, reason = "halves are widened sixteen at a time and stay in registers")]
            // SAFETY: the CPU has the feature.
            unsafe {
                match mixed.len() / components {
                    1 => avx512::mix::<1>(&corners, mixed),
                    4 => avx512::mix::<4>(&corners, mixed),
                    rows => unreachable!("coefficients, or they and three derivatives, not {rows} rows"),
                }
            }
            return;
        }
        self.mix_one_by_one(corners, components, mixed, scratch);
    }

    /// The same corner by corner.
    fn mix_one_by_one(
        &self,
        corners: &Corners,
        components: usize,
        mixed: &mut [f32],
        scratch: &mut Vec<f32>,
    ) {
        mixed.fill(0.0);
        for (from, weights) in corners {
            let z = self.read(*from, from + components, scratch);
            vectorised!(Arch::new(), {
                for (mixed, weight) in mixed.chunks_exact_mut(components).zip(weights) {
                    mixed.iter_mut().zip(z).for_each(|(m, &z)| *m += weight * z);
                }
            });
        }
    }
}

/// With AVX-512: the same products and sums in the same order.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::{
        _mm256_loadu_si256, _mm512_add_ps, _mm512_cvtph_ps, _mm512_mul_ps, _mm512_set1_ps, _mm512_setzero_ps,
        _mm512_storeu_ps,
    };

    use half::f16;

    /// Lanes of a register.
    const LANES: usize = 16;

    /// # Safety
    /// The CPU has the feature.
    #[expect(unsafe_code, reason = "loads and stores through pointers")]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn mix<const ROWS: usize>(corners: &[(&[f16], [f32; 4]); 8], mixed: &mut [f32]) {
        let components = mixed.len() / ROWS;
        assert!(corners.iter().all(|(z, _)| z.len() == components), "as many of every corner");
        let whole = components / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            let mut sums = [_mm512_setzero_ps(); ROWS];
            for (z, weights) in corners {
                // SAFETY: sixteen halves from `at` on.
                let z = _mm512_cvtph_ps(unsafe { _mm256_loadu_si256(z[at..at + LANES].as_ptr().cast()) });
                for (sum, weight) in sums.iter_mut().zip(weights) {
                    *sum = _mm512_add_ps(*sum, _mm512_mul_ps(_mm512_set1_ps(*weight), z));
                }
            }
            for (row, sum) in mixed.chunks_exact_mut(components).zip(sums) {
                // SAFETY: sixteen values from `at` on.
                unsafe { _mm512_storeu_ps(row[at..at + LANES].as_mut_ptr(), sum) };
            }
        }
        for (row, mixed) in mixed.chunks_exact_mut(components).enumerate() {
            for (at, mixed) in mixed.iter_mut().enumerate().skip(whole) {
                *mixed = corners.iter().fold(0.0, |sum, (z, weights)| sum + weights[row] * z[at].to_f32());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::coefficients::StoragePrecision;
    use super::*;

    #[test]
    fn corners_are_mixed_as_one_by_one() {
        for components in [128, 37, 5] {
            let value = |at: usize| ((at * 37 + 11) % 101) as f32 / 50.5 - 1.0;
            for precision in [StoragePrecision::F16, StoragePrecision::F32] {
                let all = Coefficients::new((0..20 * components).map(value).collect(), precision);
                let corners: Corners = std::array::from_fn(|bits| {
                    (2 * bits * components, std::array::from_fn(|row| value(7 * bits + row)))
                });
                for rows in [1, 4] {
                    let [mut found, mut expected] = [(); 2].map(|()| vec![f32::NAN; rows * components]);
                    all.mix(&corners, components, &mut found, &mut Vec::new());
                    all.mix_one_by_one(&corners, components, &mut expected, &mut Vec::new());
                    assert_eq!(found, expected, "{components} {rows} {precision:?}");
                }
            }
        }
    }
}
