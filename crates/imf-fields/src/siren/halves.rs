//! Weights in f16 that are widened on their way into a register. A single pose reads every weight once or twice and does
//! little else, so half the bytes are nearly half the time; the values are those of the same weights in `f32`, bit for bit.

#[cfg(target_arch = "x86_64")]
use half::f16;
use pulp::{Arch, Simd};

use super::lanes;
use super::tangent::PanelOfPoint;

/// A weight that a kernel reads as `f32`.
pub(crate) trait Weight<S: Simd>: Copy {
    /// The register at `values[at..]`; lanes past the end are 0.
    fn load(simd: S, values: &[Self], at: usize) -> S::f32s;
}

impl<S: Simd> Weight<S> for f32 {
    #[inline(always)]
    fn load(simd: S, values: &[Self], at: usize) -> S::f32s {
        lanes::load(simd, values, at)
    }
}

/// The bits of an f16.
pub(crate) type HalfBits = u16;

/// Panels of weights that f16 holds exactly, on a CPU that widens sixteen at a time (AVX-512).
pub struct HalfPanels {
    panels: Vec<HalfBits>,
    #[cfg(target_arch = "x86_64")]
    simd: pulp::x86::V4,
}

impl HalfPanels {
    /// `None` where a weight needs more than f16, or the CPU would gain nothing.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn of(arch: Arch, panels: &[f32]) -> Option<Self> {
        let Arch::V4(simd) = arch else { return None };
        let half = |&weight: &f32| {
            let half = f16::from_f32(weight);
            (half.to_f32().to_bits() == weight.to_bits()).then_some(half.to_bits())
        };
        Some(Self { panels: panels.iter().map(half).collect::<Option<_>>()?, simd })
    }

    /// There are none of these.
    #[cfg(not(target_arch = "x86_64"))]
    pub(crate) fn of(_: Arch, _: &[f32]) -> Option<Self> {
        None
    }

    /// The weights, laid out as the panels were.
    pub(crate) fn panels(&self) -> &[HalfBits] {
        &self.panels
    }

    /// One panel of these for one point.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn run<const ROWS: usize>(&self, panel: PanelOfPoint<'_, HalfBits, ROWS>) {
        self.simd.vectorize(avx512::Run { panel, simd: self.simd });
    }

    /// There are none of these.
    #[cfg(not(target_arch = "x86_64"))]
    pub(crate) fn run<const ROWS: usize>(&self, _: PanelOfPoint<'_, HalfBits, ROWS>) {}
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use pulp::{NullaryFnOnce, cast, f32x16, x86::V4};

    use super::{HalfBits, Weight};
    use crate::siren::tangent::PanelOfPoint;

    /// Lanes of a register.
    const LANES: usize = 16;

    impl Weight<V4> for HalfBits {
        #[inline(always)]
        fn load(simd: V4, values: &[Self], at: usize) -> f32x16 {
            let bits = match values[at..].first_chunk::<LANES>() {
                Some(whole) => *whole,
                None => last(&values[at..]),
            };
            cast(simd.avx512f._mm512_cvtph_ps(cast(bits)))
        }
    }

    /// The bits at a panel's end, zeros behind them. Apart, so that the code around a load stays small.
    #[cold]
    #[inline(never)]
    fn last(values: &[HalfBits]) -> [u16; LANES] {
        std::array::from_fn(|lane| values.get(lane).copied().unwrap_or(0))
    }

    pub(super) struct Run<'a, const ROWS: usize> {
        pub(super) panel: PanelOfPoint<'a, HalfBits, ROWS>,
        pub(super) simd: V4,
    }

    impl<const ROWS: usize> NullaryFnOnce for Run<'_, ROWS> {
        type Output = ();
        #[inline(always)]
        fn call(self) {
            self.panel.run(self.simd);
        }
    }
}
