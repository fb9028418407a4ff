//! Stock that only becomes less: a bit a voxel on lines along z, and how many voxels each block of 4 × 4 × 4 still holds.
//!
//! Removing voxels changes the bits and the counts of these voxels alone; the result equals one computed from the
//! remaining stock, bit for bit.

use std::ops::Range;

use crate::field::solid::LineVisitor;
use crate::grid::Grid;
use crate::occupancy::Occupancy;

/// Voxels along the edge of a block.
pub(super) const BLOCK: usize = 4;

/// A bit for each voxel of a grid, in words along z.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BitLines {
    pub(super) grid: Grid,
    /// Of a line.
    words: usize,
    bits: Vec<u64>,
}

/// The words of a line that hold the voxels of a run, and the bits of these voxels.
fn words(from: usize, to: usize) -> impl Iterator<Item = (usize, u64)> {
    let (first, last) = (from / 64, (to - 1) / 64);
    (first..=last).map(move |word| {
        let low = if word == first { !0 << (from % 64) } else { !0 };
        let high = if word == last { !0 >> (63 - (to - 1) % 64) } else { !0 };
        (word, low & high)
    })
}

impl BitLines {
    fn empty(grid: Grid) -> Self {
        let words = grid.dims[2].div_ceil(64);
        Self { grid, words, bits: vec![0; grid.dims[0] * grid.dims[1] * words] }
    }

    pub(super) fn of(solid: &Occupancy) -> Self {
        let mut lines = Self::empty(solid.grid);
        for (line, voxels) in solid.solid.chunks_exact(solid.grid.dims[2]).enumerate() {
            for (word, voxels) in voxels.chunks(64).enumerate() {
                let bits =
                    voxels.iter().enumerate().fold(0, |bits, (z, &solid)| bits | u64::from(solid) << z);
                lines.bits[line * lines.words + word] = bits;
            }
        }
        lines
    }

    /// First word of a line.
    fn line(&self, x: usize, y: usize) -> usize {
        (x * self.grid.dims[1] + y) * self.words
    }

    /// True where a run holds a solid voxel.
    #[inline]
    pub(super) fn holds_any(&self, x: usize, y: usize, from: usize, to: usize) -> bool {
        let line = self.line(x, y);
        words(from, to).any(|(word, mask)| self.bits[line + word] & mask != 0)
    }

    /// The word that begins with a voxel, the first of a word.
    #[inline]
    pub(super) fn from(&self, first: usize) -> u64 {
        let nz = self.grid.dims[2];
        self.bits[first / nz * self.words + first % nz / 64]
    }

    pub(super) fn occupancy(&self) -> Occupancy {
        let mut solid = Vec::with_capacity(self.grid.len());
        for line in self.bits.chunks_exact(self.words) {
            solid.extend((0..self.grid.dims[2]).map(|z| (line[z / 64] >> (z % 64) & 1) as u8));
        }
        Occupancy { grid: self.grid, solid }
    }
}

/// The stock that is still there.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StockVoxels {
    fine: BitLines,
    /// Solid where a block holds anything.
    blocks: BitLines,
    /// Solid voxels of each block, C-ordered.
    counts: Vec<u8>,
}

impl StockVoxels {
    pub(super) fn new(solid: &Occupancy) -> Self {
        let grid = solid.grid;
        let dims = grid.dims.map(|n| n.div_ceil(BLOCK));
        let blocks = Grid { origin: grid.origin, pitch: BLOCK as f64 * grid.pitch, dims };
        let mut counts = vec![0; blocks.len()];
        for (line, voxels) in solid.solid.chunks_exact(grid.dims[2]).enumerate() {
            let column = blocks.index([line / grid.dims[1] / BLOCK, line % grid.dims[1] / BLOCK, 0]);
            for (z, &solid) in voxels.iter().enumerate() {
                counts[column + z / BLOCK] += solid;
            }
        }
        let held = counts.iter().map(|&count| u8::from(count > 0)).collect();
        let blocks = BitLines::of(&Occupancy { grid: blocks, solid: held });
        Self { fine: BitLines::of(solid), blocks, counts }
    }

    pub(super) fn fine(&self) -> &BitLines {
        &self.fine
    }

    pub(super) fn blocks(&self) -> &BitLines {
        &self.blocks
    }

    /// False where no voxel between these is solid, as its blocks say.
    #[inline(always)]
    fn may_hold(&self, x: usize, y: &Range<usize>, z: &Range<usize>) -> bool {
        let (from, to) = (z.start / BLOCK, (z.end - 1) / BLOCK + 1);
        (y.start / BLOCK..=(y.end - 1) / BLOCK).any(|y| self.blocks.holds_any(x / BLOCK, y, from, to))
    }

    /// Takes a run of a line away, but for what is spared: true where something was. `taken` gets what was there: the index of a voxel,
    /// and a bit for each from there on.
    #[inline]
    pub(super) fn take(
        &mut self,
        [x, y]: [usize; 2],
        from: usize,
        to: usize,
        spared: Option<&BitLines>,
        taken: &mut impl FnMut(usize, u64),
    ) -> bool {
        let line = self.fine.line(x, y);
        let mut spares = false;
        for (word, mask) in words(from, to) {
            let bits = &mut self.fine.bits[line + word];
            let kept = *bits & mask & spared.map_or(0, |spared| spared.bits[line + word]);
            let held = *bits & mask & !kept;
            spares |= kept != 0;
            if held == 0 {
                continue;
            }
            *bits &= !held;
            taken(self.fine.grid.index([x, y, 64 * word]), held);
            let column = [x / BLOCK, y / BLOCK, 64 / BLOCK * word];
            let mut rest = held;
            while rest != 0 {
                let block = rest.trailing_zeros() as usize / BLOCK;
                let within = 0xF << (BLOCK * block);
                let index = self.blocks.grid.index(column) + block;
                self.counts[index] -= (rest & within).count_ones() as u8;
                if self.counts[index] == 0 {
                    let z = column[2] + block;
                    let word = self.blocks.line(column[0], column[1]) + z / 64;
                    self.blocks.bits[word] &= !(1 << (z % 64));
                }
                rest &= !within;
            }
        }
        spares
    }

    /// Visits the solid voxels of a run that are not among others, by their z, until it returns false; true where it never did.
    #[inline]
    pub(super) fn visit(
        &self,
        [x, y]: [usize; 2],
        from: usize,
        to: usize,
        others: &BitLines,
        visit: &mut impl FnMut(usize) -> bool,
    ) -> bool {
        let line = self.fine.line(x, y);
        words(from, to).all(|(word, mask)| {
            let mut held = self.fine.bits[line + word] & !others.bits[line + word] & mask;
            while held != 0 {
                if !visit(64 * word + held.trailing_zeros() as usize) {
                    return false;
                }
                held &= held - 1;
            }
            true
        })
    }
}

/// Visits the stock on lines where it may be.
pub(super) struct StockScanner<'a, F> {
    pub(super) stock: &'a StockVoxels,
    pub(super) line: F,
}

impl<F: FnMut(usize, usize, usize, usize) -> bool> LineVisitor for StockScanner<'_, F> {
    #[inline(always)]
    fn may_hold(&self, x: usize, y: Range<usize>, z: Range<usize>) -> bool {
        self.stock.may_hold(x, &y, &z)
    }

    #[inline(always)]
    fn line(&mut self, x: usize, y: usize, from: usize, to: usize) -> bool {
        (self.line)(x, y, from, to)
    }
}

/// Takes away what lines hold.
pub(super) struct StockRemover<'a, F> {
    pub(super) stock: &'a mut StockVoxels,
    /// But for these.
    pub(super) spared: Option<&'a BitLines>,
    /// Whether any of them was met.
    pub(super) spares: bool,
    pub(super) taken: F,
}

impl<F: FnMut(usize, u64)> LineVisitor for StockRemover<'_, F> {
    #[inline(always)]
    fn may_hold(&self, x: usize, y: Range<usize>, z: Range<usize>) -> bool {
        self.stock.may_hold(x, &y, &z)
    }

    #[inline(always)]
    fn line(&mut self, x: usize, y: usize, from: usize, to: usize) -> bool {
        self.spares |= self.stock.take([x, y], from, to, self.spared, &mut self.taken);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::scattered;
    use crate::set_cover::local::Numbers;

    #[test]
    fn after_any_removals_the_stock_is_what_is_made_anew_of_the_rest() {
        for dims in [[9, 10, 131], [4, 7, 64], [5, 5, 3]] {
            let (mut rest, spared) = (scattered(dims, 3), scattered(dims, 4));
            let lines = BitLines::of(&spared);
            let mut stock = StockVoxels::new(&rest);
            let mut numbers = Numbers(12345);
            let mut next = |below: usize| numbers.below(below);
            for step in 0..400 {
                let (x, y) = (next(dims[0]), next(dims[1]));
                let from = next(dims[2]);
                let to = from + 1 + next(dims[2] - from);
                let mut taken = Vec::new();
                let of_these = (step % 2 == 0).then_some(&lines);
                let spares = stock.take([x, y], from, to, of_these, &mut |index, bits| {
                    taken.extend((0..64).filter(|bit| bits >> bit & 1 == 1).map(|bit| index + bit));
                });
                let run = rest.grid.index([x, y, from])..rest.grid.index([x, y, to - 1]) + 1;
                let is_spared = |v: usize| of_these.is_some() && spared.solid[v] == 1;
                let (kept, expected): (Vec<usize>, _) =
                    run.filter(|&v| rest.solid[v] == 1).partition(|&v| is_spared(v));
                expected.iter().for_each(|&v: &usize| rest.solid[v] = 0);
                assert_eq!((taken, spares), (expected, !kept.is_empty()));
                if step % 20 == 0 {
                    assert_eq!(stock, StockVoxels::new(&rest), "{dims:?} {step}");
                }
            }
            assert_eq!(stock, StockVoxels::new(&rest));
            assert_eq!(stock.fine().occupancy(), rest);
            assert_eq!(stock.fine().occupancy().count(), rest.count());
            // All of it.
            for (x, y) in (0..dims[0]).flat_map(|x| (0..dims[1]).map(move |y| (x, y))) {
                stock.take([x, y], 0, dims[2], None, &mut |_, _| {});
            }
            assert_eq!(stock, StockVoxels::new(&Occupancy::empty(rest.grid)));
        }
    }

    #[test]
    fn visits_find_what_is_solid_and_not_elsewhere() {
        let (solid, others) = (scattered([6, 5, 150], 2), scattered([6, 5, 150], 1));
        let (stock, without) = (StockVoxels::new(&solid), BitLines::of(&others));
        for (from, to) in [(0, 150), (3, 64), (63, 65), (64, 128), (127, 150), (70, 71)] {
            for (x, y) in (0..6).flat_map(|x| (0..5).map(move |y| (x, y))) {
                let index = |z| solid.grid.index([x, y, z]);
                let held: Vec<usize> = (from..to).filter(|&z| solid.solid[index(z)] == 1).collect();
                let expected: Vec<usize> =
                    held.iter().copied().filter(|&z| others.solid[index(z)] == 0).collect();
                let mut found = Vec::new();
                let went_on = stock.visit([x, y], from, to, &without, &mut |z| {
                    found.push(z);
                    true
                });
                assert!(went_on && found == expected);
                assert_eq!(stock.fine().holds_any(x, y, from, to), !held.is_empty());
                let first = stock.visit([x, y], from, to, &without, &mut |_| false);
                assert_eq!(first, expected.is_empty());
            }
        }
    }
}
