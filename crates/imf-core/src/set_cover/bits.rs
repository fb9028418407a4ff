//! Tables of bits: 64 columns a word, the lowest first.

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Bits {
    /// Of each row.
    pub(super) words: usize,
    data: Vec<u64>,
}

impl Bits {
    /// All 0.
    pub(super) fn new(rows: usize, columns: usize) -> Self {
        let words = columns.div_ceil(64);
        Self { words, data: vec![0; rows * words] }
    }

    pub(super) fn set(&mut self, row: usize, column: usize) {
        self.data[row * self.words + column / 64] |= 1 << (column % 64);
    }

    pub(super) fn push(&mut self, row: impl Iterator<Item = u64>) {
        self.data.extend(row.take(self.words));
    }

    pub(super) fn row(&self, row: usize) -> &[u64] {
        &self.data[row * self.words..(row + 1) * self.words]
    }

    /// Columns as rows.
    pub(super) fn transposed(&self, rows: usize, columns: usize) -> Self {
        let mut turned = Self::new(columns, rows);
        let mut block = [0u64; 64];
        for above in 0..rows.div_ceil(64) {
            let height = (rows - above * 64).min(64);
            for word in 0..self.words {
                let mut any = 0;
                for (line, value) in block.iter_mut().enumerate() {
                    *value =
                        if line < height { self.data[(above * 64 + line) * self.words + word] } else { 0 };
                    any |= *value;
                }
                if any == 0 {
                    continue;
                }
                transpose(&mut block);
                let width = (columns - word * 64).min(64);
                for (line, value) in block.iter().enumerate().take(width) {
                    turned.data[(word * 64 + line) * turned.words + above] = *value;
                }
            }
        }
        turned
    }
}

/// Bit j of word i changes place with bit i of word j.
fn transpose(block: &mut [u64; 64]) {
    let (mut half, mut mask) = (32, 0x0000_0000_ffff_ffffu64);
    while half != 0 {
        let mut at = 0;
        while at < 64 {
            let swap = ((block[at] >> half) ^ block[at + half]) & mask;
            block[at] ^= swap << half;
            block[at + half] ^= swap;
            at = (at + half + 1) & !half;
        }
        half >>= 1;
        mask ^= mask << half;
    }
}

pub(super) fn has(words: &[u64], place: usize) -> bool {
    words[place / 64] >> (place % 64) & 1 == 1
}

pub(super) fn remove(words: &mut [u64], place: usize) {
    words[place / 64] &= !(1 << (place % 64));
}

/// The places of the bits that are set.
pub(super) fn ones(words: &[u64]) -> impl Iterator<Item = usize> + '_ {
    places(words.iter().copied())
}

/// The places of the bits that are set in both.
pub(super) fn common<'a>(one: &'a [u64], other: &'a [u64]) -> impl Iterator<Item = usize> + 'a {
    places(one.iter().zip(other).map(|(one, other)| one & other))
}

/// The places of the bits that are set, of words one after the other.
pub(super) fn places(words: impl Iterator<Item = u64>) -> impl Iterator<Item = usize> {
    words.enumerate().flat_map(|(index, word)| of_word(word).map(move |bit| index * 64 + bit))
}

/// The places of a word's bits that are set.
fn of_word(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        (word != 0).then(|| {
            word &= word - 1;
            bit
        })
    })
}

pub(super) fn count(words: impl Iterator<Item = u64>) -> usize {
    words.map(|word| word.count_ones() as usize).sum()
}

/// Bits of which the first `ones` are set.
pub(super) fn first(ones: usize) -> Vec<u64> {
    (0..ones.div_ceil(64)).map(|word| u64::MAX >> (64 - (ones - word * 64).min(64))).collect()
}
