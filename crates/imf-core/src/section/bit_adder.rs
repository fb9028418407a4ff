//! Adding bits at hundreds of places at once.
//!
//! A count is kept as one register for each binary digit, a place in every lane of a bit. A full adder (five logical
//! operations, two instructions with AVX-512) takes three registers of one weight to one of that weight and one of
//! the next. A tree of them takes 32 loads into the digits of weight 1 to 16 and one carry, which ripples on: about
//! two instructions a load, whatever the number of lanes.

use bytemuck::Zeroable;
use pulp::{Arch, Simd, WithSimd};

/// Places that are counted together: four registers of AVX-512, so that neighbouring loads hit the same cache lines.
pub(super) const TILE_BITS: usize = 2048;
/// Digits of a count.
pub(super) const DIGITS: usize = 32;

const TILE_WORDS: usize = TILE_BITS / 64;
/// Loads of one tree.
const TREE: usize = 32;
/// Addresses that are worked off for all registers of a tile before the next ones: their bytes then stay in the first
/// level of the cache.
const SHARE: usize = 256;

/// One row of bits for each digit of weight 1, 2, 4, …; the last one has the sign where there is one.
pub(super) type Digits = [[u64; TILE_WORDS]; DIGITS];

/// No counts at all.
pub(super) const ZERO: Digits = [[0; TILE_WORDS]; DIGITS];

/// Sum and carry of three bits in every lane.
#[inline(always)]
fn full<S: Simd>(simd: S, a: S::u64s, b: S::u64s, c: S::u64s) -> (S::u64s, S::u64s) {
    let sum = simd.xor_u64s(simd.xor_u64s(a, b), c);
    let carry = simd.or_u64s(simd.and_u64s(a, b), simd.and_u64s(c, simd.or_u64s(a, b)));
    (sum, carry)
}

/// Reads of one register of the tile.
struct Reader<'a, S> {
    simd: S,
    bytes: &'a [u8],
    shift: usize,
}

impl<S: Simd> Reader<'_, S> {
    #[inline(always)]
    fn load(&self, address: u32) -> S::u64s {
        let start = address as usize + self.shift;
        bytemuck::pod_read_unaligned(&self.bytes[start..start + size_of::<S::u64s>()])
    }

    /// Adds eight loads to the digits 0 to 2; the carry has weight 8.
    #[inline(always)]
    fn eight(&self, addresses: &[u32; 8], low: &mut [S::u64s; 5]) -> S::u64s {
        let simd = self.simd;
        let mut fours = [S::u64s::zeroed(); 2];
        for half in 0..2 {
            let mut twos = [S::u64s::zeroed(); 2];
            for pair in 0..2 {
                let at = 4 * half + 2 * pair;
                let (a, b) = (self.load(addresses[at]), self.load(addresses[at + 1]));
                (low[0], twos[pair]) = full(simd, low[0], a, b);
            }
            (low[1], fours[half]) = full(simd, low[1], twos[0], twos[1]);
        }
        let carry;
        (low[2], carry) = full(simd, low[2], fours[0], fours[1]);
        carry
    }

    /// Adds 32 loads to the digits 0 to 4; the carry has weight 32.
    #[inline(always)]
    fn tree(&self, addresses: &[u32; TREE], low: &mut [S::u64s; 5]) -> S::u64s {
        let simd = self.simd;
        let (groups, _) = addresses.as_chunks::<8>();
        let mut sixteens = [S::u64s::zeroed(); 2];
        for half in 0..2 {
            let a = self.eight(&groups[2 * half], low);
            let b = self.eight(&groups[2 * half + 1], low);
            (low[3], sixteens[half]) = full(simd, low[3], a, b);
        }
        let carry;
        (low[4], carry) = full(simd, low[4], sixteens[0], sixteens[1]);
        carry
    }
}

/// Adds the bits at every address of the list, a multiple of eight of them, to the digits. Returns the number of
/// digits that may be set.
pub(super) fn add(arch: Arch, bytes: &[u8], addresses: &[u32], digits: &mut Digits) -> usize {
    struct Pass<'a>(&'a [u8], &'a [u32], &'a mut Digits);
    impl WithSimd for Pass<'_> {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> usize {
            let Self(bytes, addresses, digits) = self;
            let used = (usize::BITS - addresses.len().leading_zeros()) as usize;
            let used = used.clamp(5, DIGITS);
            for share in addresses.chunks(SHARE) {
                for register in 0..TILE_BITS / 8 / size_of::<S::u64s>() {
                    let reader = Reader { simd, bytes, shift: register * size_of::<S::u64s>() };
                    add_share(&reader, share, digits, register, used);
                }
            }
            used
        }
    }
    arch.dispatch(Pass(bytes, addresses, digits))
}

/// Adds a share of the addresses to one register of every digit.
#[inline(always)]
fn add_share<S: Simd>(
    reader: &Reader<'_, S>,
    share: &[u32],
    digits: &mut Digits,
    register: usize,
    used: usize,
) {
    let simd = reader.simd;
    let (trees, rest) = share.as_chunks::<TREE>();
    let mut low = [S::u64s::zeroed(); 5];
    for (value, digit) in low.iter_mut().zip(digits.iter_mut()) {
        *value = S::as_mut_simd_u64s(digit).0[register];
    }
    for addresses in trees {
        let mut carry = reader.tree(addresses, &mut low);
        for digit in &mut digits[5..used] {
            let value = &mut S::as_mut_simd_u64s(digit).0[register];
            (*value, carry) = (simd.xor_u64s(*value, carry), simd.and_u64s(*value, carry));
        }
    }
    for addresses in rest.as_chunks::<8>().0 {
        let mut carry = reader.eight(addresses, &mut low);
        for value in &mut low[3..] {
            (*value, carry) = (simd.xor_u64s(*value, carry), simd.and_u64s(*value, carry));
        }
        for digit in &mut digits[5..used] {
            let value = &mut S::as_mut_simd_u64s(digit).0[register];
            (*value, carry) = (simd.xor_u64s(*value, carry), simd.and_u64s(*value, carry));
        }
    }
    for (digit, value) in low.into_iter().enumerate() {
        S::as_mut_simd_u64s(&mut digits[digit]).0[register] = value;
    }
}

/// `plus −= minus` in two's complement, place by place, of numbers of at most `used` digits; one more digit is set,
/// the sign.
pub(super) fn subtract(arch: Arch, plus: &mut Digits, minus: &Digits, used: usize) {
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
pub(super) fn spread(arch: Arch, digits: &Digits, used: usize, from: usize, out: &mut [i32]) {
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
        && used <= MOST_SHORT_DIGITS
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
const MOST_SHORT_DIGITS: usize = 15;

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
                *target = numbers.map(i32::from);
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
