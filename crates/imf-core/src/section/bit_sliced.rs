//! Bit-sliced counters: adding bits at thousands of places at once by carry-save adders.
//!
//! A count is held as one register for each binary digit, a place in every lane of a bit. A full adder (five logical
//! operations, two instructions with AVX-512) takes three registers of one weight to one of that weight and one of
//! the next. A tree of them takes 32 loads into the digits of weight 1 to 16 and one carry, which ripples on: about
//! two instructions a load, whatever the number of lanes.

mod logic;
mod numbers;

use bytemuck::Zeroable;
use pulp::{Arch, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use logic::Ternary;
use logic::{Logic, Plain};
pub(super) use numbers::{spread, subtract};

/// Places that are counted together: four registers of AVX-512, so that neighbouring loads hit the same cache lines.
/// Twice as many are 3 % slower on the teapot: more lines are read that another part of the tile wants.
pub(super) const TILE_BITS: usize = 2048;
/// Digits of a count.
pub(super) const DIGITS: usize = 32;

const TILE_WORDS: usize = TILE_BITS / 64;
/// Loads of one tree.
const TREE: usize = 32;
/// Addresses that are worked off for all registers of a tile before the next ones: their 30 kB stay in the first level
/// of the cache. On an AMD Zen 5 sections take 8 % longer with 32 and 3 % longer with 256.
const CHUNK: usize = 96;

/// One row of bits for each digit of weight 1, 2, 4, …; the last one has the sign where there is one.
pub(super) type Digits = [[u64; TILE_WORDS]; DIGITS];

/// Reads of one register of the tile. No address is beyond the last tile of the bytes.
struct Reader<'a, L> {
    logic: L,
    bytes: &'a [u8],
    shift: usize,
}

impl<L: Logic> Reader<'_, L> {
    #[inline(always)]
    fn load(&self, address: u32) -> L::Bits {
        let start = address as usize + self.shift;
        debug_assert!(start + size_of::<L::Bits>() <= self.bytes.len(), "checked by add");
        #[expect(
            unsafe_code,
            reason = "one check for the whole list instead of one a load makes the loop CHECKED faster"
        )]
        // SAFETY: `add` has checked that a whole tile can be read at every address, and the register with this shift
        // lies within the tile. Any bits are a valid `L::Bits`, which is `Pod`.
        unsafe {
            self.bytes.as_ptr().add(start).cast::<L::Bits>().read_unaligned()
        }
    }

    /// Adds eight loads to the digits 0 to 2; the carry has weight 8.
    #[inline(always)]
    fn eight(&self, addresses: &[u32; 8], low: &mut [L::Bits; 5]) -> L::Bits {
        let mut fours = [L::Bits::zeroed(); 2];
        for half in 0..2 {
            let mut twos = [L::Bits::zeroed(); 2];
            for pair in 0..2 {
                let at = 4 * half + 2 * pair;
                let (a, b) = (self.load(addresses[at]), self.load(addresses[at + 1]));
                (low[0], twos[pair]) = self.logic.full(low[0], a, b);
            }
            (low[1], fours[half]) = self.logic.full(low[1], twos[0], twos[1]);
        }
        let carry;
        (low[2], carry) = self.logic.full(low[2], fours[0], fours[1]);
        carry
    }

    /// Adds 32 loads to the digits 0 to 4; the carry has weight 32.
    #[inline(always)]
    fn tree(&self, addresses: &[u32; TREE], low: &mut [L::Bits; 5]) -> L::Bits {
        let (groups, _) = addresses.as_chunks::<8>();
        let mut sixteens = [L::Bits::zeroed(); 2];
        for half in 0..2 {
            let a = self.eight(&groups[2 * half], low);
            let b = self.eight(&groups[2 * half + 1], low);
            (low[3], sixteens[half]) = self.logic.full(low[3], a, b);
        }
        let carry;
        (low[4], carry) = self.logic.full(low[4], sixteens[0], sixteens[1]);
        carry
    }

    /// Adds a chunk of the addresses to the register in every digit.
    #[inline(always)]
    fn chunk(&self, addresses: &[u32], digits: &mut Digits, used: usize) {
        let logic = self.logic;
        let register = self.shift / size_of::<L::Bits>();
        let (trees, rest) = addresses.as_chunks::<TREE>();
        let mut low = [L::Bits::zeroed(); 5];
        for (value, digit) in low.iter_mut().zip(digits.iter_mut()) {
            *value = *word::<L>(digit, register);
        }
        for addresses in trees {
            let mut carry = self.tree(addresses, &mut low);
            for digit in &mut digits[5..used] {
                let value = word::<L>(digit, register);
                (*value, carry) = (logic.xor(*value, carry), logic.and(*value, carry));
            }
        }
        for addresses in rest.as_chunks::<8>().0 {
            let mut carry = self.eight(addresses, &mut low);
            for value in &mut low[3..] {
                (*value, carry) = (logic.xor(*value, carry), logic.and(*value, carry));
            }
            for digit in &mut digits[5..used] {
                let value = word::<L>(digit, register);
                (*value, carry) = (logic.xor(*value, carry), logic.and(*value, carry));
            }
        }
        for (value, digit) in low.into_iter().zip(digits.iter_mut()) {
            *word::<L>(digit, register) = value;
        }
    }
}

/// One register of a row of bits.
#[inline(always)]
fn word<L: Logic>(row: &mut [u64; TILE_WORDS], register: usize) -> &mut L::Bits {
    &mut bytemuck::cast_slice_mut::<u64, L::Bits>(row)[register]
}

/// Adds the bits at every address of the list, a multiple of eight of them, to the digits. Returns the number of
/// digits that may be set.
///
/// # Panics
/// If a tile at some address would reach beyond the bytes.
pub(super) fn add(arch: Arch, bytes: &[u8], addresses: &[u32], digits: &mut Digits) -> usize {
    struct Pass<'a> {
        bytes: &'a [u8],
        addresses: &'a [u32],
        digits: &'a mut Digits,
        used: usize,
    }
    impl Pass<'_> {
        #[inline(always)]
        fn run<L: Logic>(self, logic: L) {
            // The one check for all loads.
            let last = self.addresses.iter().fold(0, |last, &address| last.max(address)) as usize;
            assert!(last + TILE_BITS / 8 <= self.bytes.len(), "a tile beyond the end of the obstacle's bits");
            for chunk in self.addresses.chunks(CHUNK) {
                for shift in (0..TILE_BITS / 8).step_by(size_of::<L::Bits>()) {
                    Reader { logic, bytes: self.bytes, shift }.chunk(chunk, self.digits, self.used);
                }
            }
        }
    }
    impl WithSimd for Pass<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            self.run(Plain(simd));
        }
    }
    #[cfg(target_arch = "x86_64")]
    struct TernaryPass<'a>(pulp::x86::V4, Pass<'a>);
    #[cfg(target_arch = "x86_64")]
    impl pulp::NullaryFnOnce for TernaryPass<'_> {
        type Output = ();
        #[inline(always)]
        fn call(self) {
            self.1.run(Ternary(self.0));
        }
    }
    let used = ((usize::BITS - addresses.len().leading_zeros()) as usize).clamp(5, DIGITS);
    let pass = Pass { bytes, addresses, digits, used };
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(simd) => simd.vectorize(TernaryPass(simd, pass)),
        _ => arch.dispatch(pass),
    }
    used
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::archs;

    fn bytes(length: usize) -> Vec<u8> {
        (0..length as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
    }

    fn addresses(count: usize, bytes: usize) -> Vec<u32> {
        let most = bytes - TILE_BITS / 8;
        (0..count).map(|i| (i * 7919 % (most + 1)) as u32).collect()
    }

    #[test]
    fn differences_of_counts_are_those_of_one_bit_after_the_other() {
        let bytes = bytes(1000);
        // No tree, a tree and a rest, and counts beyond 15 digits, which numbers of 16 bits could not hold: too many for Miri.
        let pairs: &[(usize, usize)] = match cfg!(miri) {
            true => &[(8, 16), (40, 8)],
            false => &[(8, 16), (104, 40), (0, 32), (70_000, 8), (8, 70_000)],
        };
        for &(plus, minus) in pairs {
            let (plus, minus) = (addresses(plus, bytes.len()), addresses(minus, bytes.len()));
            let bit = |address: u32, place: usize| {
                i32::from(bytes[address as usize + place / 8] >> (place % 8) & 1)
            };
            let sum = |list: &[u32], place| list.iter().map(|&address| bit(address, place)).sum::<i32>();
            for arch in archs() {
                let (mut covered, mut uncovered) = (Digits::default(), Digits::default());
                let used = add(arch, &bytes, &plus, &mut covered);
                let used = used.max(add(arch, &bytes, &minus, &mut uncovered));
                subtract(arch, &mut covered, &uncovered, used);
                for (from, count) in [(0, TILE_BITS), (5, 121), (2000, 48), (32, 32), (31, 1)] {
                    let mut out = vec![i32::MAX; count];
                    spread(arch, &covered, used, from, &mut out);
                    for (index, &found) in out.iter().enumerate().step_by(7) {
                        let expected = sum(&plus, from + index) - sum(&minus, from + index);
                        let lengths = (plus.len(), minus.len());
                        assert_eq!(found, expected, "{arch:?} {lengths:?} at {from}+{index}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "beyond the end")]
    fn an_address_too_near_the_end_is_refused() {
        let bytes = bytes(1000);
        add(Arch::new(), &bytes, &[0, 0, 0, 745, 0, 0, 0, 0], &mut Digits::default());
    }
}
