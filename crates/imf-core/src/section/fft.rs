//! Correlation of obstacle and tool by Fourier transforms, planned once, with empty and unread lines skipped.
//!
//! What is transformed is not the voxels but the ends of their runs along z: +1 and −1. Their correlation is the overlap's second
//! difference along z, small whole numbers that f32 holds where it does not hold the overlaps themselves. Sums from a
//! place where the tool is beside the obstacle give the overlaps exactly, and must end at zero where they have come round the circle.
//!
//! The half spectrum along z is cut into blocks of [`LANES`] wave numbers, from 1 on, since run boundaries have nothing at 0. Within a
//! block everything that follows is a plane transform: along y for the tool's own rows, along x and back with the product in
//! between, back along y for the rows that are read.
//!
//! ```text
//! tool [tx][ty][z] → z → [block][tx][ty] → y → [tx][ky]
//!   → x → · obstacle [block][ky][kx] → x⁻¹ → [qx][ky] → y⁻¹ → [block][qx][qy] → z⁻¹ → sums → counts
//! ```
//! Each entry stands for the block's wave numbers, one a lane; along z each lane is two lines instead, which as real and
//! imaginary part make one complex transform.

mod lines;

use pulp::{Arch, Simd, WithSimd};

use self::lines::{LANES, Lanes, LineTransform, Point};
use super::size::{CircularSize, QueryBox, VoxelBox};
use crate::occupancy::Occupancy;
use crate::vectorised::vectorised;

/// Real lines that are transformed together along z.
const PAIRED: usize = 2 * LANES;
const ZERO: Point = [Lanes([0.0; LANES]); 2];
/// A second difference this far from a whole number may be rounded to the wrong one.
const DOUBTFUL: f32 = 0.25;
/// Adding 1.5·2²³ rounds a number below 2²² to a whole one, which then stands in the lowest bits. What larger ones lose is all of one sign,
/// so that their sums do not come back to zero.
const ROUND: f32 = 12_582_912.0;

/// Plans and the obstacle's spectrum.
pub(super) struct Convolver {
    arch: Arch,
    size: CircularSize,
    /// Voxels of the obstacle along z.
    depth: usize,
    along: [LineTransform; 3],
    /// `[block][ky][kx]`, divided by the number of points.
    spectrum: Vec<Point>,
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    /// Two lines, from one to the other of which a transform goes.
    line: Vec<Point>,
    other: Vec<Point>,
    input: Vec<Point>,
    columns: Vec<Point>,
    rows: Vec<Point>,
    output: Vec<Point>,
}

impl Convolver {
    pub(super) fn new(arch: Arch, obstacle: &Occupancy, size: CircularSize) -> Self {
        let along = size.n.map(|length| LineTransform::new(arch, length));
        let depth = obstacle.grid.dims[2];
        let mut convolver = Self { arch, size, depth, along, spectrum: Vec::new() };
        convolver.spectrum = convolver.obstacle_spectrum(obstacle);
        convolver
    }

    fn obstacle_spectrum(&self, obstacle: &Occupancy) -> Vec<Point> {
        let [nx, ny, _] = self.size.n;
        let mut scratch = Scratch::default();
        let solid = VoxelBox::of_obstacle(obstacle);
        let points = self.size.n.iter().map(|&n| n as f64).product::<f64>();
        self.transform_z(&solid, (1.0 / points) as f32, &mut scratch);
        let mut spectrum = vec![ZERO; blocks_of(&self.size) * ny * nx];
        for (block, planes) in spectrum.chunks_exact_mut(ny * nx).enumerate() {
            self.transform_y(&solid, block, &mut scratch);
            for (ky, target) in planes.chunks_exact_mut(nx).enumerate() {
                target.copy_from_slice(self.transform_x(&solid, ky, &mut scratch));
            }
        }
        spectrum
    }

    /// Correlates the obstacle with a tool: overlaps over a query box, for which the size given to `new` holds, into
    /// `counts`. False where rounding may have made one of them wrong.
    pub(super) fn correlate(
        &self,
        tool: &VoxelBox<'_>,
        query: &QueryBox,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> bool {
        let [nx, ny, _] = self.size.n;
        let [qx, qy, _] = query.dims;
        if tool.dims[0] == 0 {
            counts.fill(0);
            return true;
        }
        debug_assert!(self.size.n[2] > self.depth + tool.dims[2], "two places where the tool meets nothing");
        debug_assert!((0..3).all(|axis| query.dims[axis] <= self.size.n[axis]), "each place is read once");
        self.transform_z(tool, 1.0, scratch);
        let blocks = blocks_of(&self.size);
        scratch.output.resize(blocks * qx * qy, ZERO);
        scratch.rows.resize(qx * ny, ZERO);
        for block in 0..blocks {
            self.transform_y(tool, block, scratch);
            for ky in 0..ny {
                self.transform_x(tool, ky, scratch);
                let Scratch { line, other, rows, .. } = &mut *scratch;
                let (line, other) = (&mut line[..nx], &mut other[..nx]);
                let obstacle = &self.spectrum[(block * ny + ky) * nx..][..nx];
                self.arch.dispatch(Multiply { tool: line, obstacle });
                let transformed = self.along[0].inverse(line, other);
                for (row, &value) in rows.chunks_exact_mut(ny).zip(around(transformed, query.lower[0])) {
                    row[ky] = value;
                }
            }
            let Scratch { rows, other, output, .. } = &mut *scratch;
            for (x, row) in rows.chunks_exact_mut(ny).enumerate() {
                let transformed = self.along[1].inverse(row, &mut other[..ny]);
                let target = &mut output[(block * qx + x) * qy..][..qy];
                target.iter_mut().zip(around(transformed, query.lower[1])).for_each(|(to, &from)| *to = from);
            }
        }
        let mut exact = true;
        for x in 0..qx {
            for first in (0..qy).step_by(PAIRED) {
                exact &= self.inverse_z(tool, query, (x, first), scratch, counts);
            }
        }
        exact
    }

    /// Transforms run boundaries along z, each of this size, into `scratch.input [block][tx][ty]`.
    fn transform_z(&self, solid: &VoxelBox<'_>, size: f32, scratch: &mut Scratch) {
        let [nx, ny, nz] = self.size.n;
        let [tx, ty, tz] = solid.dims;
        let blocks = blocks_of(&self.size);
        let longest = nx.max(ny).max(nz);
        scratch.line.resize(longest, ZERO);
        scratch.other.resize(longest, ZERO);
        scratch.input.clear();
        scratch.input.resize(blocks * tx * ty, ZERO);
        for (x, first) in (0..tx).flat_map(|x| (0..ty).step_by(PAIRED).map(move |first| (x, first))) {
            let count = PAIRED.min(ty - first);
            let line = &mut scratch.line[..nz];
            line.fill(ZERO);
            let mut any = false;
            for lane in 0..count {
                let mut before = 0;
                let solids = solid.line(x, first + lane).iter().chain(&[0]).enumerate();
                for (z, &now) in solids.take(tz + 1) {
                    if now != before {
                        let part = &mut line[wrap(solid.lower[2] + z as i64, nz)][lane / LANES];
                        part.0[lane % LANES] += size * (f32::from(now) - f32::from(before));
                        (any, before) = (true, now);
                    }
                }
            }
            if !any {
                continue;
            }
            let Scratch { line, other, input, .. } = &mut *scratch;
            let spectrum = &*self.along[2].forward(&mut line[..nz], &mut other[..nz]);
            for k in 0..nz / 2 {
                let pair = vectorised!(self.arch, apart(&spectrum[k + 1], &spectrum[nz - k - 1]));
                let target = &mut input[(k / LANES * tx + x) * ty + first..][..count];
                for (lane, target) in target.iter_mut().enumerate() {
                    let [re, im] = &pair[lane / LANES];
                    target[0].0[k % LANES] = re.0[lane % LANES];
                    target[1].0[k % LANES] = im.0[lane % LANES];
                }
            }
        }
    }

    /// Transforms one block along y into `scratch.columns [tx][ky]`.
    fn transform_y(&self, solid: &VoxelBox<'_>, block: usize, scratch: &mut Scratch) {
        let ny = self.size.n[1];
        let [tx, ty, _] = solid.dims;
        scratch.columns.resize(tx * ny, ZERO);
        let Scratch { line, other, input, columns, .. } = scratch;
        let (line, other) = (&mut line[..ny], &mut other[..ny]);
        for (x, target) in columns.chunks_exact_mut(ny).enumerate() {
            line.fill(ZERO);
            let source = &input[(block * tx + x) * ty..][..ty];
            around_mut(line, solid.lower[1]).zip(source).for_each(|(to, &from)| *to = from);
            target.copy_from_slice(self.along[1].forward(line, other));
        }
    }

    /// Transforms one block along x at wave number ky, and returns it: the first `nx` points of `scratch.line`.
    fn transform_x<'a>(&self, solid: &VoxelBox<'_>, ky: usize, scratch: &'a mut Scratch) -> &'a [Point] {
        let [nx, ny, _] = self.size.n;
        let Scratch { line, other, columns, .. } = scratch;
        line[..nx].fill(ZERO);
        let source = columns.chunks_exact(ny);
        around_mut(&mut line[..nx], solid.lower[0]).zip(source).for_each(|(to, column)| *to = column[ky]);
        if self.along[0].forward(&mut line[..nx], &mut other[..nx]).as_ptr() != line.as_ptr() {
            std::mem::swap(line, other);
        }
        &line[..nx]
    }

    /// Transforms the rows from `(x, first)` on back along z, and sums their second differences to counts. False where
    /// one may be wrong.
    fn inverse_z(
        &self,
        tool: &VoxelBox<'_>,
        query: &QueryBox,
        (x, first): (usize, usize),
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> bool {
        let nz = self.size.n[2];
        let [qx, qy, qz] = query.dims;
        let count = PAIRED.min(qy - first);
        let Scratch { line, other, output, .. } = scratch;
        let (line, other) = (&mut line[..nz], &mut other[..nz]);
        line[0] = ZERO;
        for k in 0..nz / 2 {
            let mut pair = [ZERO; 2];
            let source = &output[(k / LANES * qx + x) * qy + first..][..count];
            for (lane, source) in source.iter().enumerate() {
                let [re, im] = &mut pair[lane / LANES];
                re.0[lane % LANES] = source[0].0[k % LANES];
                im.0[lane % LANES] = source[1].0[k % LANES];
            }
            [line[k + 1], line[nz - k - 1]] = vectorised!(self.arch, together(&pair));
        }
        let differences = &*self.along[2].inverse(line, other);
        // There the tool has passed the obstacle, and at the next place as well: the circle is that long.
        let start = self.depth as i64 - tool.lower[2];
        let after = wrap(start + 2 - query.lower[2], nz);
        let counts = &mut counts[(x * qy + first) * qz..][..count * qz];
        vectorised!(self.arch, sum(differences, wrap(start + 1, nz), after, counts, qz))
    }
}

/// Spectra of the two lines whose joint spectrum has these values at a wave number and at its negative.
#[inline(always)]
fn apart(at: &Point, opposite: &Point) -> [Point; 2] {
    let mut pair = [ZERO; 2];
    for lane in 0..LANES {
        let [re, im] = [at[0].0[lane], at[1].0[lane]];
        let [opposite_re, opposite_im] = [opposite[0].0[lane], opposite[1].0[lane]];
        pair[0][0].0[lane] = 0.5 * (re + opposite_re);
        pair[0][1].0[lane] = 0.5 * (im - opposite_im);
        pair[1][0].0[lane] = 0.5 * (im + opposite_im);
        pair[1][1].0[lane] = 0.5 * (opposite_re - re);
    }
    pair
}

/// The joint spectrum of two real lines at a wave number and at its negative.
#[inline(always)]
fn together(pair: &[Point; 2]) -> [Point; 2] {
    let mut joint = [ZERO; 2];
    for lane in 0..LANES {
        let [[re, im], [other_re, other_im]] = [0, 1].map(|line| [0, 1].map(|part| pair[line][part].0[lane]));
        joint[0][0].0[lane] = re - other_im;
        joint[0][1].0[lane] = im + other_re;
        joint[1][0].0[lane] = re + other_im;
        joint[1][1].0[lane] = other_re - im;
    }
    joint
}

/// The obstacle's spectrum times the conjugate of the tool's, in place of the latter.
struct Multiply<'a> {
    tool: &'a mut [Point],
    obstacle: &'a [Point],
}

impl WithSimd for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for ([re, im], [other_re, other_im]) in self.tool.iter_mut().zip(self.obstacle) {
            let (re, im) = (S::as_mut_simd_f32s(&mut re.0).0, S::as_mut_simd_f32s(&mut im.0).0);
            let (other_re, other_im) = (S::as_simd_f32s(&other_re.0).0, S::as_simd_f32s(&other_im.0).0);
            for ((re, im), (&c, &d)) in re.iter_mut().zip(im).zip(other_re.iter().zip(other_im)) {
                let (a, b) = (*re, *im);
                *re = simd.mul_add_e_f32s(a, c, simd.mul_f32s(b, d));
                *im = simd.mul_add_e_f32s(a, d, simd.neg_f32s(simd.mul_f32s(b, c)));
            }
        }
    }
}

/// Sums second differences, with the sign of a correlation of differences, twice: once round the circle from place `from` on, before
/// which all is zero. The sum after it is the count of voxel `after` of the query, and so on around; counts are `[line][qz]`.
/// False where a difference is far from a whole number, a sum is negative or does not end at zero.
#[inline(always)]
fn sum(differences: &[Point], from: usize, mut after: usize, counts: &mut [u32], qz: usize) -> bool {
    let mut steps = [[0i32; LANES]; 2];
    let mut sums = [[0i32; LANES]; 2];
    let mut farthest = [0.0f32; LANES];
    let mut lowest = [0i32; LANES];
    for place in (from..differences.len()).chain(0..from) {
        for ((values, steps), sums) in differences[place].iter().zip(&mut steps).zip(&mut sums) {
            for lane in 0..LANES {
                let shifted = values.0[lane] + ROUND;
                let far = (values.0[lane] - (shifted - ROUND)).abs();
                farthest[lane] = if far > farthest[lane] { far } else { farthest[lane] };
                steps[lane] =
                    steps[lane].wrapping_sub((shifted.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32));
                sums[lane] = sums[lane].wrapping_add(steps[lane]);
                lowest[lane] = lowest[lane].min(sums[lane]);
            }
        }
        if after < qz {
            for (line, count) in counts.iter_mut().skip(after).step_by(qz).enumerate() {
                *count = sums[line / LANES][line % LANES] as u32;
            }
        }
        after = if after + 1 == differences.len() { 0 } else { after + 1 };
    }
    let closed = [steps, sums].iter().flatten().flatten().all(|&end| end == 0);
    closed && lowest == [0; LANES] && farthest.iter().all(|&far| far < DOUBTFUL)
}

/// Bytes of an obstacle's plan, which all threads share, and of every thread's working memory.
pub(super) fn memory(
    [ox, oy, _]: [usize; 3],
    size: &CircularSize,
    query: &QueryBox,
    tool: &VoxelBox<'_>,
    threads: u64,
) -> u64 {
    let [nx, ny, blocks] = [size.n[0], size.n[1], blocks_of(size)];
    let ([tx, ty, _], [qx, qy, _]) = (tool.dims, query.dims);
    let own = blocks * (tx * ty + qx * qy) + (tx + qx) * ny;
    // The obstacle's own lines, while its spectrum is made.
    let made = (blocks * ox * oy + ox * ny) as u64;
    size_of::<Point>() as u64 * ((blocks * nx * ny) as u64 + made.max(threads * own as u64))
}

/// Blocks of the half spectrum along z.
fn blocks_of(size: &CircularSize) -> usize {
    (size.n[2] / 2).div_ceil(LANES)
}

/// The points of a circle from one on, once around.
fn around(circle: &[Point], from: i64) -> impl Iterator<Item = &Point> {
    let (before, after) = circle.split_at(wrap(from, circle.len()));
    after.iter().chain(before)
}

/// The same, to be changed.
fn around_mut(circle: &mut [Point], from: i64) -> impl Iterator<Item = &mut Point> {
    let (before, after) = circle.split_at_mut(wrap(from, circle.len()));
    after.iter_mut().chain(before)
}

/// Position on a circle of `n` points.
fn wrap(index: i64, n: usize) -> usize {
    index.rem_euclid(n as i64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_differences_sum_to_counts_and_a_wrong_or_doubtful_one_is_noticed() {
        let count = |line: usize, y: usize| [0, 0, 0, 5, 9, 70_000 + line as i32, 3, 1, 0][y % 9];
        // 2c(y) − c(y+1) − c(y−1), the sign that a correlation of differences has.
        let difference = |line, y| 2 * count(line, y) - count(line, y + 1) - count(line, y + 8);
        let lanes =
            |part, y| Lanes(std::array::from_fn(|lane| difference(part * LANES + lane, y) as f32 + 0.2));
        let differences: Vec<Point> = (0..9).map(|y| [lanes(0, y), lanes(1, y)]).collect();
        let (lines, qz) = (20, 5);
        let mut found = vec![7; lines * qz];
        // The tool is beside the obstacle at 0 and 1: the sum after place 1 is the count at 2, which is read first.
        assert!(sum(&differences, 1, 0, &mut found, qz));
        for (line, found) in found.chunks(qz).enumerate() {
            assert_eq!(found, [2, 3, 4, 5, 6].map(|y| count(line, y) as u32), "{line}");
        }
        for (part, wrong) in [(0, 1.0), (1, -1.0), (1, 0.3)] {
            let mut differences = differences.clone();
            differences[4][part].0[11] += wrong;
            assert!(!sum(&differences, 1, 0, &mut found, qz), "{part} {wrong}");
        }
    }

    #[test]
    fn counts_below_zero_are_noticed() {
        let count = |y: usize| [0, 0, 0, -1, 0][y % 5];
        let difference = |y| (2 * count(y) - count(y + 1) - count(y + 4)) as f32;
        let differences: Vec<Point> = (0..5).map(|y| [Lanes([difference(y); LANES]), ZERO[1]]).collect();
        assert!(!sum(&differences, 1, 0, &mut [0; 3], 3));
    }
}
