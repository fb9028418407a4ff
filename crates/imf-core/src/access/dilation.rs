//! Binary dilation of a set of voxels by a body: the union of the body's copies, 64 voxels at a time.
//!
//! The set is one bit a voxel, all lines along z of a plane x behind one another at one distance:
//!
//! ```text
//! plane x: line 0 (z voxels) line 1 … line y−1 | words that the longest shift reads
//! ```
//! A run of the body [a, b] on a row reaches z from any visited voxel in [z − b, z − a]. Let `E` be the set in which
//! every bit is joined by the b − a bits behind it. Then that is one bit of `E`, and for the whole run it is `E`
//! shifted by the run's distance from the body's corner, the same for a whole plane. So a run costs a shift and an OR
//! for each word of the target, and each length of runs one pass that widens `E`. Only positions from which the body
//! meets the target are visited: shifts then never reach another line.

use pulp::Arch;

use crate::grid::{Grid, GridError};
use crate::tool::ToolVoxels;
use crate::vectorised::vectorised;

/// A run of solid voxels of the body along z: offsets from the body's last plane, line and voxel to the run's last,
/// and how many voxels it has beyond one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Run {
    x: usize,
    y: usize,
    z: usize,
    more: usize,
}

fn runs_of(body: &ToolVoxels) -> Vec<Run> {
    let [nx, ny, nz] = body.dims;
    let mut runs = Vec::new();
    for (row, line) in body.solid.chunks_exact(nz).enumerate() {
        let mut begun = None;
        for (z, &solid) in line.iter().chain(&[0]).enumerate() {
            match (begun, solid != 0) {
                (None, true) => begun = Some(z),
                (Some(first), false) => {
                    let (x, y) = (nx - 1 - row / ny, ny - 1 - row % ny);
                    runs.push(Run { x, y, z: nz - z, more: z - 1 - first });
                    begun = None;
                }
                _ => {}
            }
        }
    }
    runs
}

/// The positions of the body's origin at which it meets `target`'s box.
///
/// # Errors
/// More voxels than can be indexed.
pub(super) fn meeting_positions(body: &ToolVoxels, target: &Grid) -> Result<Grid, GridError> {
    target.padded(body.upper().map(i64::from), body.lower.map(|lower| -i64::from(lower)))
}

/// Accumulated coverage, and the working memory of one thread.
pub(super) struct Dilation {
    arch: Arch,
    target: Grid,
    /// One bit a voxel of the target, each line along z from a word of its own; bits behind a line mean nothing.
    covered: Vec<u64>,
    visited: Vec<u64>,
    widened: Vec<u64>,
    swept: Vec<u64>,
}

impl Dilation {
    /// Nothing of `target` is covered.
    pub(super) fn new(target: &Grid) -> Self {
        let [nx, ny, nz] = target.dims;
        Self {
            arch: Arch::new(),
            target: *target,
            covered: vec![0; nx * ny * nz.div_ceil(64)],
            visited: Vec::new(),
            widened: Vec::new(),
            swept: Vec::new(),
        }
    }

    /// Bytes for a target and at most `positions` positions along the axes.
    pub(super) fn memory(target: [usize; 3], positions: [usize; 3]) -> u64 {
        let bits = |[x, y, z]: [usize; 3]| x as u64 * (y as u64 * (z as u64 + 64) + 192);
        (2 * bits(target) + 2 * bits(positions)) / 8
    }

    /// Covers what `body` holds with its origin at every one of its [`meeting_positions`] whose entry in `counts`,
    /// C-ordered, is at most `most`.
    ///
    /// # Panics
    /// If there is not one count for each of those positions.
    pub(super) fn cover(&mut self, body: &ToolVoxels, counts: &[u32], most: u32) {
        let positions = [0, 1, 2].map(|a| self.target.dims[a] + body.dims[a] - 1);
        assert_eq!(counts.len(), positions.iter().product::<usize>(), "one count for each meeting position");
        vectorised!(self.arch, self.cover_all(body, counts, positions, most));
    }

    #[inline(always)]
    fn cover_all(&mut self, body: &ToolVoxels, counts: &[u32], [px, py, pz]: [usize; 3], most: u32) {
        let Self { target, covered, visited, widened, swept, .. } = self;
        let [nx, ny, nz] = target.dims;
        // Behind a plane there is room for the bits of a line's last word.
        let words = py * pz / 64 + 2;
        visited.clear();
        visited.resize(px * words, 0);
        for (row, line) in counts.chunks_exact(pz).enumerate() {
            put_at_most(line, most, row % py * pz, &mut visited[row / py * words..][..words]);
        }
        widened.clone_from(visited);
        // The target's voxels, at the distances of the positions.
        let wanted = (ny * pz).div_ceil(64);
        swept.clear();
        swept.resize(nx * wanted, 0);
        let mut runs = runs_of(body);
        runs.sort_unstable_by_key(|run| (run.more, run.x, run.y, run.z));
        let mut more = 0;
        for run in runs {
            while more < run.more {
                more += 1;
                or_shifted(visited, more, widened);
            }
            for (x, plane) in swept.chunks_exact_mut(wanted).enumerate() {
                or_shifted(&widened[(x + run.x) * words..][..words], run.y * pz + run.z, plane);
            }
        }
        for (row, line) in covered.chunks_exact_mut(nz.div_ceil(64)).enumerate() {
            or_shifted(&swept[row / ny * wanted..][..wanted], row % ny * pz, line);
        }
    }

    /// Adds what another thread covered of the same target.
    pub(super) fn merge(&mut self, other: &Self) {
        self.covered.iter_mut().zip(&other.covered).for_each(|(all, more)| *all |= more);
    }

    /// 1 for every voxel of the target that was covered, C-ordered.
    pub(super) fn covered(&self) -> Vec<u8> {
        let nz = self.target.dims[2];
        let lines = self.covered.chunks_exact(nz.div_ceil(64));
        lines.flat_map(|line| (0..nz).map(|z| (line[z / 64] >> (z % 64) & 1) as u8)).collect()
    }
}

/// Sets, from bit `start` on, a bit for every count that is at most `most`.
#[inline(always)]
fn put_at_most(counts: &[u32], most: u32, start: usize, bits: &mut [u64]) {
    let (mut word, shift) = (start / 64, start % 64);
    for counts in counts.chunks(64) {
        let mut found = 0u64;
        for (place, &count) in counts.iter().enumerate() {
            found |= u64::from(count <= most) << place;
        }
        bits[word] |= found << shift;
        // In two steps: all 64 bits go where nothing is left for the next word.
        bits[word + 1] |= found >> 1 >> (63 - shift);
        word += 1;
    }
}

/// `target |= source >> bits`, both as one long number; beyond the source's end there are zeros.
#[inline(always)]
fn or_shifted(source: &[u64], bits: usize, target: &mut [u64]) {
    let (skip, shift) = (bits / 64, bits % 64);
    let source = source.get(skip..).unwrap_or_default();
    if shift == 0 {
        target.iter_mut().zip(source).for_each(|(t, s)| *t |= s);
        return;
    }
    let next = source.get(1..).unwrap_or_default();
    for ((target, low), high) in target.iter_mut().zip(source).zip(next) {
        *target |= low >> shift | high << (64 - shift);
    }
    if let (Some(target), Some(low)) = (target.get_mut(next.len()), source.get(next.len())) {
        *target |= low >> shift;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::tests::{slotted, small_tool};
    use crate::section::test_shapes::orientations;

    /// The definition: every voxel of the body at every position.
    fn direct(body: &ToolVoxels, target: &Grid, counts: &[u32], most: u32) -> Vec<u8> {
        let positions = meeting_positions(body, target).unwrap();
        let shift = target.offset_of(&positions).unwrap();
        let mut expected = vec![0; target.len()];
        for position in (0..positions.len()).filter(|&p| counts[p] <= most) {
            let origin = positions.voxel(position);
            for own in body.offsets() {
                let at = [0, 1, 2].map(|a| origin[a] as i64 + shift[a] + own[a]);
                if (0..3).all(|a| (0..target.dims[a] as i64).contains(&at[a])) {
                    expected[target.index(at.map(|v| v as usize))] = 1;
                }
            }
        }
        expected
    }

    #[test]
    fn it_is_the_union_of_the_bodys_copies() {
        // Lines shorter than a word, of a word, and longer, as positions and as target.
        for (before, after) in
            [([1, -2, 2], [-3, 2, 5]), ([-2, -4, 0], [-3, -3, 52]), ([-4, -4, 0], [-3, -3, 61])]
        {
            let target = slotted().grid.padded(before, after).unwrap();
            let mut both = Dilation::new(&target);
            let mut either = vec![0; target.len()];
            for (index, orientation) in orientations("random:4:2").iter().enumerate() {
                let mut body = ToolVoxels::new(&small_tool(), orientation, 1.0).unwrap();
                if index == 3 {
                    // Several runs on a line, and a body that does not hold its origin.
                    body.solid.iter_mut().step_by(3).for_each(|s| *s = 0);
                    body.lower[0] += 9;
                }
                let positions = meeting_positions(&body, &target).unwrap();
                let hash = |i: usize| (i.wrapping_mul(2_654_435_761) >> 9) as u32 & 255;
                let counts: Vec<u32> = (0..positions.len()).map(hash).collect();
                let expected = direct(&body, &target, &counts, 1);
                let mut one = Dilation::new(&target);
                one.cover(&body, &counts, 1);
                assert_eq!(one.covered(), expected);
                assert!(expected.contains(&1) && expected.contains(&0));
                both.merge(&one);
                either.iter_mut().zip(&expected).for_each(|(e, x)| *e |= x);
            }
            assert_eq!(both.covered(), either);
        }
    }

    #[test]
    fn shifted_bits_are_those_of_one_bit_after_the_other() {
        let words =
            |n: usize| (0..n as u64).map(|i| i.wrapping_mul(0x9E37_79B9_7F4A_7C15)).collect::<Vec<_>>();
        let bit = |words: &[u64], i: usize| words.get(i / 64).map_or(0, |word| word >> (i % 64) & 1);
        for (source, target) in [(3, 5), (5, 3), (1, 1), (4, 4)] {
            for bits in [0, 1, 63, 64, 65, 128, 191, 192, 500] {
                let (source, before) = (words(source), words(target + 7)[7..].to_vec());
                let mut after = before.clone();
                or_shifted(&source, bits, &mut after);
                for i in 0..64 * target {
                    assert_eq!(bit(&after, i), bit(&before, i) | bit(&source, i + bits), "{bits}: {i}");
                }
            }
        }
    }
}
