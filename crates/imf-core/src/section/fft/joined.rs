//! Thirty-two real lines along z, joined to sixteen complex ones for a transform, and what comes back from it.

use pulp::{Simd, WithSimd};

use super::lines::{LANES, Lanes, Point, ZERO};

/// A second difference this far from a whole number may be rounded to the wrong one.
const DOUBTFUL: f32 = 0.25;
/// Adding 1.5·2²³ rounds a number below 2²² to a whole one, which then stands in the lowest bits. What larger ones lose is all of one sign,
/// so that their sums do not come back to zero.
const ROUND: f32 = 12_582_912.0;

/// One number of thirty-two lines at one place.
pub(super) type Both = [Lanes; 2];

/// From the joint spectra of lane `l` and lane `l` + [`LANES`] of the lines as real and imaginary part: the spectrum of each line, from
/// wave number `first` + 1 on.
pub(super) struct Split<'a> {
    pub(super) joint: &'a [Point],
    pub(super) first: usize,
    pub(super) lines: &'a mut [Point],
}

impl WithSimd for Split<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { joint, first, lines } = self;
        let n = joint.len();
        let mut tiles = [[[Lanes::default(); LANES]; 2]; 2];
        let [[re, im], [other_re, other_im]] = &mut tiles;
        for k in 0..LANES.min(n / 2 - first) {
            let (at, opposite) = (&joint[first + k + 1], &joint[n - first - k - 1]);
            for lane in 0..LANES {
                re[k].0[lane] = 0.5 * (at[0].0[lane] + opposite[0].0[lane]);
                im[k].0[lane] = 0.5 * (at[1].0[lane] - opposite[1].0[lane]);
                other_re[k].0[lane] = 0.5 * (at[1].0[lane] + opposite[1].0[lane]);
                other_im[k].0[lane] = 0.5 * (opposite[0].0[lane] - at[0].0[lane]);
            }
        }
        let mut turned = [Lanes::default(); LANES];
        for (lines, tiles) in lines.chunks_mut(LANES).zip(&tiles) {
            for (part, tile) in tiles.iter().enumerate() {
                transpose(simd, tile, &mut turned);
                lines.iter_mut().zip(&turned).for_each(|(line, turned)| line[part] = *turned);
            }
        }
    }
}

/// The inverse of [`Split`].
pub(super) struct Join<'a> {
    pub(super) lines: &'a [Point],
    pub(super) joint: &'a mut [Point],
    pub(super) first: usize,
}

impl WithSimd for Join<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lines, joint, first } = self;
        let n = joint.len();
        let mut tiles = [[[Lanes::default(); LANES]; 2]; 2];
        for (lines, [re, im]) in lines.chunks(LANES).zip(&mut tiles) {
            for ((line, re), im) in lines.iter().zip(re).zip(im) {
                (*re, *im) = (line[0], line[1]);
            }
        }
        let mut turned = [[[Lanes::default(); LANES]; 2]; 2];
        for (tile, turned) in tiles.iter().flatten().zip(turned.iter_mut().flatten()) {
            transpose(simd, tile, turned);
        }
        let [[re, im], [other_re, other_im]] = &turned;
        for k in 0..LANES.min(n / 2 - first) {
            let (mut at, mut opposite) = (ZERO, ZERO);
            for lane in 0..LANES {
                at[0].0[lane] = re[k].0[lane] - other_im[k].0[lane];
                at[1].0[lane] = im[k].0[lane] + other_re[k].0[lane];
                opposite[0].0[lane] = re[k].0[lane] + other_im[k].0[lane];
                opposite[1].0[lane] = other_re[k].0[lane] - im[k].0[lane];
            }
            // At half the length of an even line both are one place.
            joint[first + k + 1] = at;
            joint[n - first - k - 1] = opposite;
        }
    }
}

/// Rows become columns, in squares of as many rows as a register has numbers: of each square within it of 2·half numbers the two
/// quarters beside the diagonal are exchanged.
#[inline(always)]
fn transpose<S: Simd>(simd: S, rows: &[Lanes; LANES], columns: &mut [Lanes; LANES]) {
    let side = S::F32_LANES;
    for (row, column) in (0..LANES / side).flat_map(|row| (0..LANES / side).map(move |column| (row, column)))
    {
        let mut square = [simd.splat_f32s(0.0); LANES];
        for at in 0..side {
            square[at] = S::as_simd_f32s(&rows[row * side + at].0).0[column];
        }
        let mut half = side / 2;
        while half > 0 {
            let bits: [u32; LANES] = std::array::from_fn(|lane| (lane & half) as u32);
            let low = simd.equal_u32s(S::as_simd_u32s(&bits).0[0], simd.splat_u32s(0));
            for at in (0..side).filter(|at| at & half == 0) {
                let (a, b) = (square[at], square[at + half]);
                square[at] = simd.select_f32s(low, a, simd.rotate_right_f32s(b, half));
                square[at + half] = simd.select_f32s(low, simd.rotate_left_f32s(a, half), b);
            }
            half /= 2;
        }
        for at in 0..side {
            S::as_mut_simd_f32s(&mut columns[column * side + at].0).0[row] = square[at];
        }
    }
}

/// Sums second differences, with the sign of a correlation of differences, twice: once round the circle from place `from` on, before
/// which all is zero. The sum after it is the count of voxel `after` of the query, and so on around.
/// False where a difference is far from a whole number, a sum is negative or does not end at zero.
pub(super) struct Sum<'a> {
    pub(super) differences: &'a [Point],
    pub(super) from: usize,
    pub(super) after: usize,
    /// `[z]`, counts as the bits of numbers, which are only moved.
    pub(super) sums: &'a mut [Both],
}

impl WithSimd for Sum<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { differences, from, after, sums } = self;
        let (round, round_bits) = (simd.splat_f32s(ROUND), simd.splat_u32s(ROUND.to_bits()));
        let [mut ends, mut seen] = [[[0; LANES]; 2]; 2];
        let mut near = true;
        for (half, chunk) in (0..2).flat_map(|half| (0..LANES / S::F32_LANES).map(move |chunk| (half, chunk)))
        {
            let [mut step, mut sum, mut any] = [simd.splat_u32s(0); 3];
            let (mut farthest, mut after) = (simd.splat_f32s(0.0), after);
            for place in (from..differences.len()).chain(0..from) {
                let value = S::as_simd_f32s(&differences[place][half].0).0[chunk];
                let shifted = simd.add_f32s(value, round);
                let far = simd.abs_f32s(simd.sub_f32s(value, simd.sub_f32s(shifted, round)));
                farthest = simd.max_f32s(far, farthest);
                step = simd.sub_u32s(step, simd.sub_u32s(simd.transmute_u32s_f32s(shifted), round_bits));
                sum = simd.add_u32s(sum, step);
                any = simd.or_u32s(any, sum);
                if let Some(sums) = sums.get_mut(after) {
                    S::as_mut_simd_f32s(&mut sums[half].0).0[chunk] = simd.transmute_f32s_u32s(sum);
                }
                after = if after + 1 == differences.len() { 0 } else { after + 1 };
            }
            S::as_mut_simd_u32s(&mut ends[half]).0[chunk] = simd.or_u32s(step, sum);
            S::as_mut_simd_u32s(&mut seen[half]).0[chunk] = any;
            near &= simd.reduce_max_f32s(farthest) < DOUBTFUL;
        }
        near && ends == [[0; LANES]; 2] && seen.iter().flatten().all(|&bits| bits >> 31 == 0)
    }
}

/// Writes sums, which are whole numbers, into counts, `[line][qz]`.
pub(super) struct WriteCounts<'a> {
    /// As [`Sum`] gives them, as many as a multiple of [`LANES`]; those from `qz` on are not written.
    pub(super) sums: &'a [Both],
    pub(super) qz: usize,
    pub(super) counts: &'a mut [u32],
}

impl WithSimd for WriteCounts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { sums, qz, counts } = self;
        let [mut tile, mut turned] = [[Lanes::default(); LANES]; 2];
        for (sums, first) in sums.chunks_exact(LANES).zip((0..qz).step_by(LANES)) {
            for (half, counts) in counts.chunks_mut(LANES * qz).enumerate() {
                tile.iter_mut().zip(sums).for_each(|(row, sums)| *row = sums[half]);
                transpose(simd, &tile, &mut turned);
                for (line, turned) in counts.chunks_exact_mut(qz).zip(&turned) {
                    line[first..].iter_mut().zip(turned.0).for_each(|(count, sum)| *count = sum.to_bits());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pulp::Arch;

    use super::*;
    use crate::section::test_shapes::archs;

    #[test]
    fn second_differences_sum_to_counts_and_a_wrong_or_doubtful_one_is_noticed() {
        let count = |line: usize, y: usize| [0, 0, 0, 5, 9, 70_000 + line as i32, 3, 1, 0][y % 9];
        // 2c(y) − c(y+1) − c(y−1), the sign that a correlation of differences has.
        let difference = |line, y| 2 * count(line, y) - count(line, y + 1) - count(line, y + 8);
        let lanes =
            |part, y| Lanes(std::array::from_fn(|lane| difference(part * LANES + lane, y) as f32 + 0.2));
        let differences: Vec<Point> = (0..9).map(|y| [lanes(0, y), lanes(1, y)]).collect();
        let (lines, qz) = (20, 5);
        // The tool is beside the obstacle at 0 and 1: the sum after place 1 is the count at 2, which is read first.
        let add = |arch: Arch, differences: &[Point]| {
            let mut sums = vec![Both::default(); LANES];
            let exact = arch.dispatch(Sum { differences, from: 1, after: 0, sums: &mut sums[..qz] });
            (exact, sums)
        };
        for arch in archs() {
            let (exact, sums) = add(arch, &differences);
            assert!(exact);
            let mut found = vec![7; lines * qz];
            arch.dispatch(WriteCounts { sums: &sums, qz, counts: &mut found });
            for (line, found) in found.chunks(qz).enumerate() {
                assert_eq!(found, [2, 3, 4, 5, 6].map(|y| count(line, y) as u32), "{line}");
            }
            for (part, wrong) in [(0, 1.0), (1, -1.0), (1, 0.3)] {
                let mut differences = differences.clone();
                differences[4][part].0[11] += wrong;
                assert!(!add(arch, &differences).0, "{part} {wrong}");
            }
        }
    }

    #[test]
    fn counts_below_zero_are_noticed() {
        let accepted = |one: i32| {
            let count = |y: usize| [0, 0, 0, one, 0][y % 5];
            let difference = |y| (2 * count(y) - count(y + 1) - count(y + 4)) as f32;
            let differences: Vec<Point> = (0..5).map(|y| [Lanes([difference(y); LANES]), ZERO[1]]).collect();
            Arch::new().dispatch(Sum { differences: &differences, from: 1, after: 0, sums: &mut [] })
        };
        assert!(accepted(1) && !accepted(-1));
    }

    #[test]
    fn rows_become_columns_and_lines_come_apart_as_they_were_joined() {
        let rows: [Lanes; LANES] =
            std::array::from_fn(|row| Lanes(std::array::from_fn(|lane| (row * LANES + lane) as f32)));
        for arch in archs() {
            let n = 40;
            let lines: Vec<Point> = (0..23).map(|l| [rows[l % 16], rows[(l * 7 + 3) % 16]]).collect();
            // At the last wave number of an even length the imaginary parts are nothing.
            for (first, many) in [(0, 16), (16, 3)] {
                let (mut joint, mut apart) = (vec![ZERO; n], vec![ZERO; lines.len()]);
                arch.dispatch(Join { lines: &lines, joint: &mut joint, first });
                assert_eq!(joint[first + 1][0].0[2], rows[2].0[0] - rows[(18 * 7 + 3) % 16].0[0]);
                arch.dispatch(Split { joint: &joint, first, lines: &mut apart });
                for (apart, line) in apart.iter().zip(&lines) {
                    for part in 0..2 {
                        assert_eq!(apart[part].0[..many], line[part].0[..many], "{first}");
                    }
                }
            }
        }
    }
}
