//! From binary digits to numbers: differences, and one number a place.

use pulp::{Arch, Simd, WithSimd};

use super::{Digits, TILE_WORDS};

/// `plus −= minus` in two's complement, place by place, of numbers of at most `used` digits; one more digit is set,
/// the sign.
pub(in super::super) fn subtract(arch: Arch, plus: &mut Digits, minus: &Digits, used: usize) {
    struct Pass<'a>(&'a mut Digits, &'a Digits, usize);
    impl WithSimd for Pass<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(plus, minus, used) = self;
            let mut borrow = [0; TILE_WORDS];
            for (plus, minus) in plus.iter_mut().zip(minus).take(used) {
                for ((plus, &minus), borrow) in plus.iter_mut().zip(minus).zip(&mut borrow) {
                    let before = *plus;
                    *plus = before ^ minus ^ *borrow;
                    *borrow = (!before & (minus | *borrow)) | (minus & *borrow);
                }
            }
            plus[used] = borrow;
        }
    }
    arch.dispatch(Pass(plus, minus, used));
}

/// Writes the numbers at places `from..from + out.len()` of the tile, of `used` digits and a sign.
pub(in super::super) fn spread(arch: Arch, digits: &Digits, used: usize, from: usize, out: &mut [i32]) {
    struct Pass<'a>(&'a Digits, usize, usize, &'a mut [i32]);
    impl WithSimd for Pass<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(digits, used, mut from, mut out) = self;
            while !out.is_empty() {
                let first = from % 32;
                let count = out.len().min(32 - first);
                let (target, rest) = out.split_at_mut(count);
                target.copy_from_slice(&word_numbers(digits, used, from / 32)[first..first + count]);
                out = rest;
                from += count;
            }
        }
    }
    #[cfg(target_arch = "x86_64")]
    if let Arch::V4(simd) = arch
        && used <= MAX_SHORT_DIGITS
    {
        return simd.vectorize(SpreadShort { simd, digits, used, from, out });
    }
    arch.dispatch(Pass(digits, used, from, out));
}

/// The numbers of 32 places.
#[inline(always)]
fn word_numbers(digits: &Digits, used: usize, word: usize) -> [i32; 32] {
    // Each bit of a word is tested in a lane of its own.
    let bits: [u32; 32] = std::array::from_fn(|lane| 1 << lane);
    let mut numbers = [0; 32];
    for (digit, row) in digits[..=used].iter().enumerate() {
        let row = (row[word / 2] >> (32 * (word % 2))) as u32;
        let weight = if digit == used { (1i32 << digit).wrapping_neg() } else { 1 << digit };
        for (number, bit) in numbers.iter_mut().zip(bits) {
            *number += if row & bit != 0 { weight } else { 0 };
        }
    }
    numbers
}

/// Digits of a number that fits 16 bits with its sign.
#[cfg(target_arch = "x86_64")]
const MAX_SHORT_DIGITS: usize = 15;

/// [`spread`] with AVX-512: a word of bits is a mask for 32 numbers of 16 bits, so each digit costs one instruction.
/// A fifth of the time of the general way.
#[cfg(target_arch = "x86_64")]
struct SpreadShort<'a> {
    simd: pulp::x86::V4,
    digits: &'a Digits,
    used: usize,
    from: usize,
    out: &'a mut [i32],
}

#[cfg(target_arch = "x86_64")]
impl pulp::NullaryFnOnce for SpreadShort<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { simd, digits, used, mut from, mut out } = self;
        while !out.is_empty() {
            let (word, first) = (from / 32, from % 32);
            let count = out.len().min(32 - first);
            let mut numbers = simd.avx512f._mm512_setzero_si512();
            for (digit, row) in digits[..=used].iter().enumerate() {
                let mask = (row[word / 2] >> (32 * (word % 2))) as u32;
                let weight = if digit == used { (1i16 << digit).wrapping_neg() } else { 1 << digit };
                let weight = simd.avx512f._mm512_set1_epi16(weight);
                numbers = simd.avx512bw._mm512_mask_add_epi16(numbers, mask, numbers, weight);
            }
            let numbers: [i16; 32] = pulp::cast(numbers);
            let (target, rest) = out.split_at_mut(count);
            if let Ok(target) = <&mut [i32; 32]>::try_from(&mut *target) {
                // A loop: `map` becomes a call.
                for (target, &number) in target.iter_mut().zip(&numbers) {
                    *target = i32::from(number);
                }
            } else {
                for (target, &number) in target.iter_mut().zip(&numbers[first..]) {
                    *target = i32::from(number);
                }
            }
            out = rest;
            from += count;
        }
    }
}
