//! Counting by runs: the tool's exact run on every line of voxels, summed or counted among the obstacle's bits along z.

use pulp::{Arch, Simd, WithSimd};

use super::segment::{LANES, PlacedSegment};
use crate::occupancy::Occupancy;

/// Solid voxels as bits, in lines of constant x and y.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Columns {
    /// Voxels along x, y, z.
    dims: [usize; 3],
    /// Words of a line.
    words: usize,
    /// Lines C-ordered over `[x, y]`: voxel z is bit z mod 64 of word z / 64.
    bits: Vec<u64>,
    /// First and last y of a line that holds anything, for each x; first above last where none does.
    rows: Vec<(i64, i64)>,
}

/// The words of a line of voxels, each of which is 0 or 1.
fn fill(words: &mut [u64], solid: &[u8]) {
    for (word, solid) in words.iter_mut().zip(solid.chunks(64)) {
        *word = 0;
        for (byte, solid) in solid.chunks(8).enumerate() {
            let mut eight = [0; 8];
            eight[..solid.len()].copy_from_slice(solid);
            // Each byte's lowest bit comes to the top byte, in order.
            let bits = u64::from_le_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            *word |= bits << (8 * byte);
        }
    }
}

impl Columns {
    pub(super) fn new(obstacle: &Occupancy) -> Self {
        let [nx, ny, nz] = obstacle.grid.dims;
        let words = nz.div_ceil(64);
        let mut bits = vec![0; nx * ny * words];
        for (line, solid) in bits.chunks_mut(words).zip(obstacle.solid.chunks(nz)) {
            fill(line, solid);
        }
        let mut columns = Self { dims: obstacle.grid.dims, words, bits, rows: vec![(0, 0); nx] };
        (0..nx).for_each(|x| columns.find_row(x));
        columns
    }

    /// Finds the first and the last line of an x that holds anything.
    fn find_row(&mut self, x: usize) {
        let [_, ny, _] = self.dims;
        let holds = |&y: &usize| self.line(x, y).iter().any(|&word| word != 0);
        let [first, last] = [(0..ny).find(holds), (0..ny).rfind(holds)];
        self.rows[x] =
            first.zip(last).map_or((i64::MAX, i64::MIN), |(first, last)| (first as i64, last as i64));
    }

    /// Follows an obstacle of which these voxels have just become solid or empty.
    pub(super) fn change(&mut self, obstacle: &Occupancy, changed: &[usize]) {
        let [_, ny, nz] = self.dims;
        let mut lines: Vec<usize> = changed.iter().map(|index| index / nz).collect();
        lines.sort_unstable();
        lines.dedup();
        for &line in &lines {
            fill(&mut self.bits[line * self.words..][..self.words], &obstacle.solid[line * nz..][..nz]);
        }
        let mut all: Vec<usize> = lines.iter().map(|line| line / ny).collect();
        all.dedup();
        all.into_iter().for_each(|x| self.find_row(x));
    }

    #[inline(always)]
    fn line(&self, x: usize, y: usize) -> &[u64] {
        &self.bits[(x * self.dims[1] + y) * self.words..][..self.words]
    }

    /// How many voxels of a line are solid, from one z on, up to another.
    #[inline(always)]
    pub(super) fn count(&self, x: usize, y: usize, from: usize, to: usize) -> u32 {
        if from >= to {
            return 0;
        }
        let line = self.line(x, y);
        let (first, last) = (from / 64, (to - 1) / 64);
        let (above, below) = (u64::MAX << (from % 64), u64::MAX >> (63 - (to - 1) % 64));
        if first == last {
            return (line[first] & above & below).count_ones();
        }
        let between: u32 = line[first + 1..last].iter().map(|word| word.count_ones()).sum();
        (line[first] & above).count_ones() + between + (line[last] & below).count_ones()
    }

    /// The solid voxels of a line, from one z on, up to another.
    pub(super) fn solid(&self, x: usize, y: usize, from: usize, to: usize) -> impl Iterator<Item = usize> {
        let line = self.line(x, y);
        (from..to).filter(move |z| line[z / 64] >> (z % 64) & 1 != 0)
    }

    /// First and last y at this x of a line that holds anything.
    #[inline(always)]
    pub(super) fn row(&self, x: usize) -> (i64, i64) {
        self.rows[x]
    }
}

/// Lines at these x and y, in voxels, ends included; `from > to` in x where there are none.
#[derive(Clone, Copy)]
pub(super) struct Lines {
    pub(super) x: (f32, f32),
    pub(super) y: (f32, f32),
}

impl Lines {
    pub(super) const ALL: Self = Self { x: (-1e9, 1e9), y: (-1e9, 1e9) };

    pub(super) fn is_empty(&self) -> bool {
        self.x.0 > self.x.1
    }

    /// Those of both, and what lies between.
    pub(super) fn join(self, other: Self) -> Self {
        let join = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
        Self { x: join(self.x, other.x), y: join(self.y, other.y) }
    }
}

/// What is counted.
#[derive(Clone, Copy)]
pub(super) enum Within<'a> {
    /// Solid voxels of an obstacle, on some of its lines.
    Obstacle(&'a Columns, Lines),
    /// All voxels, at most this far from the origin along each axis.
    Everything(i64),
}

/// Voxel centres within a segment. With `stop` the count may end at the first line that holds any.
pub(super) fn count(arch: Arch, segment: &PlacedSegment<'_>, within: Within<'_>, stop: bool) -> u32 {
    struct Pass<'a>(&'a PlacedSegment<'a>, Within<'a>, bool);
    impl WithSimd for Pass<'_> {
        type Output = u32;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> u32 {
            match self.1 {
                Within::Obstacle(columns, lines) => {
                    count_lines::<S, true>(simd, self.0, Some((columns, lines)), 0, self.2)
                }
                Within::Everything(most) => count_lines::<S, false>(simd, self.0, None, most, self.2),
            }
        }
    }
    arch.dispatch(Pass(segment, within, stop))
}

#[inline(always)]
fn count_lines<S: Simd, const OBSTACLE: bool>(
    simd: S,
    segment: &PlacedSegment<'_>,
    obstacle: Option<(&Columns, Lines)>,
    most: i64,
    stop: bool,
) -> u32 {
    let tip = segment.placed.tip;
    let (mut x_low, mut x_high) = segment.columns();
    let mut z_bounds = (-most, most);
    let (mut y_least, mut y_most) = (i64::MIN, i64::MAX);
    let columns = obstacle.map(|(columns, _)| columns);
    if let Some((columns, lines)) = obstacle {
        x_low = x_low.max(0).max(lines.x.0.ceil() as i64);
        x_high = x_high.min(columns.dims[0] as i64 - 1).min(lines.x.1.floor() as i64);
        (y_least, y_most) = (lines.y.0.ceil() as i64, lines.y.1.floor() as i64);
        z_bounds = (0, columns.dims[2] as i64 - 1);
    }
    let silhouette = Silhouette::new(segment);
    // A quarter of a voxel off the last centres: an end that was cut off there is sure.
    let cut = (z_bounds.0 as f64 - 0.25, z_bounds.1 as f64 + 0.75);
    let mut total = 0;
    for x in x_low..=x_high {
        let across = x as f64 - tip.x;
        let (mut y, mut y_high) = silhouette.row(across, tip.y);
        if let Some(columns) = columns {
            let (first, last) = columns.row(x as usize);
            y = y.max(first).max(y_least);
            y_high = y_high.min(last).min(y_most);
        }
        while y <= y_high {
            let lanes = ((y_high - y + 1) as usize).min(LANES);
            let runs = segment.runs(simd, across, y as f64 - tip.y, cut);
            match columns {
                Some(columns) if OBSTACLE => {
                    for lane in 0..lanes {
                        let (from, to) = if runs.doubt {
                            let (from, to) = segment.run(x, y + lane as i64, z_bounds);
                            (from as i32, to as i32)
                        } else {
                            runs.run(lane)
                        };
                        total += columns.count(x as usize, y as usize + lane, from as usize, to as usize);
                    }
                }
                _ if runs.doubt => {
                    for lane in 0..lanes {
                        let (from, to) = segment.run(x, y + lane as i64, z_bounds);
                        total += (to - from).max(0) as u32;
                    }
                }
                // Lines past the last one miss the tool: their runs are empty.
                _ => total += runs.sum(),
            }
            y += LANES as i64;
        }
        if stop && total > 0 {
            return total;
        }
    }
    total
}

/// A solid voxel whose centre lies within the segment, in whole numbers: slow and simple.
#[inline(never)]
pub(super) fn first_solid(segment: &PlacedSegment<'_>, columns: &Columns) -> Option<[f64; 3]> {
    let [nx, _, nz] = columns.dims.map(|n| n as i64);
    let silhouette = Silhouette::new(segment);
    let (x_low, x_high) = segment.columns();
    for x in x_low.max(0)..=x_high.min(nx - 1) {
        let (low, high) = silhouette.row(x as f64 - segment.placed.tip.x, segment.placed.tip.y);
        let (first, last) = columns.row(x as usize);
        for y in low.max(first)..=high.min(last) {
            let (from, to) = segment.run(x, y, (0, nz - 1));
            if let Some(z) = columns.solid(x as usize, y as usize, from as usize, to as usize).next() {
                return Some([x as f64, y as f64, z as f64]);
            }
        }
    }
    None
}

/// The oblong that holds a segment as seen along z: a strip along the axis and its two ends.
pub(super) struct Silhouette {
    /// Unit vector of the axis as seen along z.
    along: [f64; 2],
    half_width: f64,
    ends: (f64, f64),
}

impl Silhouette {
    pub(super) fn new(segment: &PlacedSegment<'_>) -> Self {
        let d = segment.placed.direction;
        let lean = (d.x * d.x + d.y * d.y).sqrt();
        let along = if lean > 1e-12 { [d.x / lean, d.y / lean] } else { [1.0, 0.0] };
        let spread = segment.widest * d.z.abs();
        Self {
            along,
            half_width: segment.widest,
            ends: (segment.from * lean - spread, segment.to * lean + spread),
        }
    }

    /// First and last whole y of lines at distance `x` from the tip that may meet the segment.
    #[inline(always)]
    pub(super) fn row(&self, x: f64, tip_y: f64) -> (i64, i64) {
        let [ux, uy] = self.along;
        let (mut low, mut high) = (-1e9, 1e9);
        // |y·ux − x·uy| ≤ half_width, and the ends ≤ x·ux + y·uy. More than rounding is added before a small factor divides it.
        let bounds = [
            (ux, -self.half_width + x * uy, self.half_width + x * uy),
            (uy, self.ends.0 - x * ux, self.ends.1 - x * ux),
        ];
        for (factor, lowest, highest) in bounds {
            let (lowest, highest) = (lowest - 1e-6, highest + 1e-6);
            if factor.abs() > 1e-12 {
                let (one, other) = (lowest / factor, highest / factor);
                low = f64::max(low, one.min(other));
                high = f64::min(high, one.max(other));
            } else if lowest > 0.0 || highest < 0.0 {
                return (0, -1);
            }
        }
        ((tip_y + low - 1e-6).ceil() as i64, (tip_y + high + 1e-6).floor() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    #[test]
    fn lines_of_bits_count_as_their_voxels_do_before_and_after_a_change() {
        for nz in [1, 63, 64, 65, 200] {
            let grid = Grid { origin: glam::DVec3::ZERO, pitch: 1.0, dims: [4, 5, nz] };
            let mut obstacle = Occupancy::empty(grid);
            let scattered = |index: usize, most: usize| index.wrapping_mul(2_654_435_761) >> 7 & 7 < most;
            for index in 0..grid.len() {
                let [x, y, _] = grid.voxel(index);
                obstacle.solid[index] = u8::from(x != 2 && y != 1 && scattered(index, 3));
            }
            let mut columns = Columns::new(&obstacle);
            let changed: Vec<usize> = (0..grid.len()).filter(|&index| scattered(index + 11, 1)).collect();
            for _ in 0..2 {
                for x in 0..4 {
                    let solid = |y: usize, z: usize| obstacle.solid[grid.index([x, y, z])] != 0;
                    let holds = |&y: &usize| (0..nz).any(|z| solid(y, z));
                    let expected =
                        (0..5).find(holds).map(|first| (first as i64, (0..5).rfind(holds).unwrap() as i64));
                    assert_eq!(columns.row(x), expected.unwrap_or((i64::MAX, i64::MIN)));
                    for (y, from) in (0..5).flat_map(|y| (0..nz).map(move |from| (y, from))) {
                        for to in [from, from + 1, (from + 64).min(nz), (from + 131).min(nz), nz] {
                            let expected: Vec<usize> = (from..to).filter(|&z| solid(y, z)).collect();
                            assert_eq!(columns.count(x, y, from, to), expected.len() as u32);
                            assert_eq!(columns.solid(x, y, from, to).collect::<Vec<_>>(), expected);
                        }
                    }
                }
                changed.iter().for_each(|&index| obstacle.solid[index] ^= 1);
                columns.change(&obstacle, &changed);
                assert_eq!(columns, Columns::new(&obstacle));
            }
        }
    }
}
