//! Logical operations of each instruction set on registers of bits.

use bytemuck::Pod;
use pulp::Simd;

/// The logical operations of one instruction set.
pub(super) trait Logic: Copy {
    /// A register of bits.
    type Bits: Pod;

    fn and(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    fn xor(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    /// Sum and carry of three bits in every lane.
    fn full(self, a: Self::Bits, b: Self::Bits, c: Self::Bits) -> (Self::Bits, Self::Bits);
}

/// Any instruction set.
#[derive(Clone, Copy)]
pub(super) struct Plain<S>(pub(super) S);

impl<S: Simd> Logic for Plain<S> {
    type Bits = S::u64s;

    #[inline(always)]
    fn and(self, a: S::u64s, b: S::u64s) -> S::u64s {
        self.0.and_u64s(a, b)
    }

    #[inline(always)]
    fn xor(self, a: S::u64s, b: S::u64s) -> S::u64s {
        self.0.xor_u64s(a, b)
    }

    #[inline(always)]
    fn full(self, a: S::u64s, b: S::u64s, c: S::u64s) -> (S::u64s, S::u64s) {
        let either = self.0.xor_u64s(a, b);
        let carry = self.0.or_u64s(self.0.and_u64s(a, b), self.0.and_u64s(c, either));
        (self.0.xor_u64s(either, c), carry)
    }
}

/// AVX-512, which computes any function of three bits in one instruction.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(super) struct Ternary(pub(super) pulp::x86::V4);

#[cfg(target_arch = "x86_64")]
impl Logic for Ternary {
    type Bits = pulp::u64x8;

    #[inline(always)]
    fn and(self, a: Self::Bits, b: Self::Bits) -> Self::Bits {
        self.0.and_u64x8(a, b)
    }

    #[inline(always)]
    fn xor(self, a: Self::Bits, b: Self::Bits) -> Self::Bits {
        self.0.xor_u64x8(a, b)
    }

    #[inline(always)]
    fn full(self, a: Self::Bits, b: Self::Bits, c: Self::Bits) -> (Self::Bits, Self::Bits) {
        /// True where an odd number of bits is set.
        const ODD: i32 = 0x96;
        /// True where at least two bits are set.
        const MAJORITY: i32 = 0xE8;
        let avx = self.0.avx512f;
        let (a, b, c) = (pulp::cast(a), pulp::cast(b), pulp::cast(c));
        let sum = avx._mm512_ternarylogic_epi64::<ODD>(a, b, c);
        (pulp::cast(sum), pulp::cast(avx._mm512_ternarylogic_epi64::<MAJORITY>(a, b, c)))
    }
}
