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
    let mut low = [0, 1, 2, 3, 4].map(|digit| S::as_mut_simd_u64s(&mut digits[digit]).0[register]);
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

/// `plus − minus` as whole numbers, place by place, from counts of at most `used` digits.
pub(super) fn subtract(arch: Arch, plus: &Digits, minus: &Digits, used: usize, out: &mut [i32; TILE_BITS]) {
    struct Pass<'a>(&'a Digits, &'a Digits, usize, &'a mut [i32; TILE_BITS]);
    impl WithSimd for Pass<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(plus, minus, used, out) = self;
            // Thirty-two places at a time: each bit of a word tested in a lane of its own.
            let bits: [u32; 32] = std::array::from_fn(|lane| 1 << lane);
            for (group, out) in out.as_chunks_mut::<32>().0.iter_mut().enumerate() {
                let word = |row: &[u64; TILE_WORDS]| (row[group / 2] >> (32 * (group % 2))) as u32;
                let mut borrow = 0;
                let mut values = [0i32; 32];
                for digit in 0..used {
                    let (a, b) = (word(&plus[digit]), word(&minus[digit]));
                    let difference = a ^ b ^ borrow;
                    borrow = (!a & (b | borrow)) | (b & borrow);
                    for (value, bit) in values.iter_mut().zip(bits) {
                        *value += if difference & bit != 0 { 1 << digit } else { 0 };
                    }
                }
                for (value, bit) in values.iter_mut().zip(bits) {
                    *value -= if borrow & bit != 0 { 1 << used } else { 0 };
                }
                *out = values;
            }
        }
    }
    arch.dispatch(Pass(plus, minus, used, out));
}
