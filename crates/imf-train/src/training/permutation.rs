//! The order of an epoch's samples: a permutation that is computed, not held in memory.
//!
//! A Feistel network whose key is made of the seed and the epoch permutes the numbers of as many bits as the
//! length needs; a result past the length goes through it again until it falls inside (cycle walking, fewer than two
//! rounds on average). So an epoch's order needs no memory, any thread can compute any place in it, and resuming needs
//! only the epoch and the place.

/// Feistel rounds; from four on it is a pseudo-random permutation where its round function is a random one, and the
/// rest makes up for halves of few bits.
const ROUNDS: usize = 8;

/// A permutation of `0..len` given by a seed and an epoch. The same arguments give the same order everywhere.
#[derive(Clone, Debug)]
pub struct Permutation {
    len: u64,
    /// Bits of the right half; the left half has as many or one less.
    right_bits: u32,
    left_mask: u64,
    right_mask: u64,
    keys: [u64; ROUNDS],
}

impl Permutation {
    /// The order of `len` samples in epoch `epoch`.
    #[must_use]
    pub fn new(len: usize, seed: u64, epoch: u64) -> Self {
        let len = len as u64;
        let bits = u64::BITS - len.saturating_sub(1).leading_zeros();
        let (left_bits, right_bits) = (bits / 2, bits - bits / 2);
        let base = mix(mix(seed) ^ epoch);
        Self {
            len,
            right_bits,
            left_mask: (1 << left_bits) - 1,
            right_mask: (1 << right_bits) - 1,
            keys: std::array::from_fn(|round| mix(base.wrapping_add(round as u64))),
        }
    }

    /// The sample at place `place` of the order.
    ///
    /// # Panics
    /// If `place` is not below the length.
    #[must_use]
    pub fn at(&self, place: usize) -> usize {
        let mut value = place as u64;
        assert!(value < self.len, "place {place} of {}", self.len);
        loop {
            value = self.rounds(value);
            if value < self.len {
                return value as usize;
            }
        }
    }

    fn rounds(&self, value: u64) -> u64 {
        let (mut left, mut right) = (value >> self.right_bits, value & self.right_mask);
        for pair in self.keys.chunks_exact(2) {
            left ^= mix(right ^ pair[0]) & self.left_mask;
            right ^= mix(left ^ pair[1]) & self.right_mask;
        }
        left << self.right_bits | right
    }
}

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): every bit of the result depends on every bit of the argument.
pub(super) fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let value = (value ^ value >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ value >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ value >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(len: usize, seed: u64, epoch: u64) -> Vec<usize> {
        let permutation = Permutation::new(len, seed, epoch);
        (0..len).map(|place| permutation.at(place)).collect()
    }

    #[test]
    fn every_sample_comes_once() {
        for len in (0..=130).chain([255, 256, 257, 1000, 4095, 4097, 65_537, 100_003]) {
            let mut sorted = order(len, 3, 1);
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..len), "length {len}");
        }
    }

    #[test]
    fn seed_and_epoch_both_decide_the_order() {
        let len = 10_000;
        let base = order(len, 5, 7);
        assert_eq!(base, order(len, 5, 7));
        // Two independent orders agree at one place on average; 15 or more has a probability below 1e-12.
        for other in [order(len, 5, 8), order(len, 6, 7), order(len, 7, 5), (0..len).collect()] {
            let same = base.iter().zip(&other).filter(|(a, b)| a == b).count();
            assert!(same < 15, "{same} places agree");
        }
    }

    #[test]
    fn places_are_roughly_uniform_over_epochs() {
        // Chi-square of where one sample goes, in 16 bins over 4000 epochs: 15 degrees of freedom, 44 is beyond
        // 1e-4.
        let (len, epochs, bins) = (1000, 4000, 16);
        for place in [0, 1, 499, 999] {
            let mut counts = vec![0.0f64; bins];
            for epoch in 0..epochs {
                counts[Permutation::new(len, 11, epoch).at(place) * bins / len] += 1.0;
            }
            let square: f64 = counts
                .iter()
                .enumerate()
                .map(|(bin, count)| {
                    let share = ((bin + 1) * len).div_ceil(bins) - (bin * len).div_ceil(bins);
                    let expected = epochs as f64 * share as f64 / len as f64;
                    (count - expected) * (count - expected) / expected
                })
                .sum();
            assert!(square < 44.0, "place {place}: chi-square {square}");
        }
    }

    #[test]
    fn neighbours_in_the_order_are_not_neighbours_in_the_data() {
        let len = 50_000;
        let order = order(len, 2, 0);
        let mean = (len as f64 - 1.0) / 2.0;
        let variance = (len as f64 * len as f64 - 1.0) / 12.0;
        let products: f64 =
            order.windows(2).map(|pair| (pair[0] as f64 - mean) * (pair[1] as f64 - mean)).sum();
        let correlation = products / variance / (len - 1) as f64;
        // Five standard deviations of 1/√len.
        assert!(correlation.abs() < 0.022, "correlation {correlation}");
    }
}
