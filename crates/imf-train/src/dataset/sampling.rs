//! Which voxels of a section are sampled.
//!
//! The boundary of the configuration-space obstacle {CMF > 0} runs between voxels. A voxel is *at the boundary* if the
//! cube of `2·width + 1` voxels around it, as far as it lies in the grid, holds voxels of both kinds, CMF > 0 and CMF = 0.

use imf_fields::recipe::Sampling;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// For each voxel of a section of `dims` voxels (C-ordered) whether it is at the boundary: whether the cube of
/// `2·width + 1` voxels around it holds voxels with CMF > 0 and voxels with CMF = 0.
///
/// # Panics
/// If `cmf` has not as many values as `dims` has voxels.
#[must_use]
pub fn boundary(cmf: &[f32], dims: [usize; 3], width: usize) -> Vec<bool> {
    assert_eq!(cmf.len(), dims.iter().product::<usize>(), "one value for each voxel");
    // Bit 0: a free voxel in the window, bit 1: a colliding one. A cube's union is taken axis by axis.
    let mut kinds: Vec<u8> = cmf.iter().map(|&v| if v > 0.0 { 2 } else { 1 }).collect();
    let [_, ny, nz] = dims;
    let mut line = Vec::new();
    for (axis, stride) in [(0, ny * nz), (1, nz), (2, 1)] {
        let n = dims[axis];
        for start in 0..kinds.len() {
            if (start / stride) % n != 0 {
                continue;
            }
            line.clear();
            line.extend((0..n).map(|i| kinds[start + i * stride]));
            // The nearest voxel of either kind seen so far, first upwards, then downwards.
            for upwards in [true, false] {
                let mut since = [usize::MAX; 2];
                for step in 0..n {
                    let i = if upwards { step } else { n - 1 - step };
                    for (bit, since) in since.iter_mut().enumerate() {
                        *since = if line[i] >> bit & 1 == 1 { 0 } else { since.saturating_add(1) };
                        if *since <= width {
                            kinds[start + i * stride] |= 1 << bit;
                        }
                    }
                }
            }
        }
    }
    kinds.into_iter().map(|kind| kind == 3).collect()
}

/// Draws voxels of section `index` without replacement, [`Sampling::count`] of them: `boundary_share` at the boundary,
/// and of the rest `positive_share` where CMF > 0, each kind uniformly. A kind that is too small is taken whole and
/// topped up from the others. Sorted.
///
/// # Panics
/// If `cmf` has not as many values as `dims` has voxels.
#[must_use]
pub fn draw(cmf: &[f32], dims: [usize; 3], sampling: &Sampling, index: u64) -> Vec<u32> {
    let edge =
        if sampling.boundary_share > 0.0 { boundary(cmf, dims, sampling.boundary_width) } else { Vec::new() };
    // Free, colliding, at the boundary.
    let kind = |voxel: usize| {
        if edge.get(voxel).copied().unwrap_or(false) { 2 } else { usize::from(cmf[voxel] > 0.0) }
    };
    let mut left = [0usize; 3];
    (0..cmf.len()).for_each(|voxel| left[kind(voxel)] += 1);
    let [zero, positive, at_edge] = left;

    let total = sampling.count(cmf.len());
    let wanted_edge = ((total as f64 * sampling.boundary_share).round() as usize).min(at_edge);
    let rest = total - wanted_edge;
    let wanted = ((rest as f64 * sampling.positive_share).round() as usize).min(positive);
    let from_zero = (rest - wanted).min(zero);
    let from_positive = (rest - from_zero).min(positive);
    let from_edge = total - from_zero - from_positive;

    let mut generator = ChaCha8Rng::seed_from_u64(sampling.seed);
    generator.set_stream(index);
    // Selection sampling: each voxel is taken with chance (still needed) / (still to come).
    let mut needed = [from_zero, from_positive, from_edge];
    let mut drawn = Vec::with_capacity(total);
    for voxel in 0..cmf.len() {
        let kind = kind(voxel);
        if (u128::from(generator.next_u64()) * left[kind] as u128) >> 64 < needed[kind] as u128 {
            needed[kind] -= 1;
            drawn.push(voxel as u32);
        }
        left[kind] -= 1;
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(positive: usize, zero: usize) -> Vec<f32> {
        (0..positive + zero)
            .map(|i| if (i * 7919) % (positive + zero) < positive { 0.25 } else { 0.0 })
            .collect()
    }

    fn shares(cmf: &[f32], drawn: &[u32]) -> (usize, usize) {
        let positive = drawn.iter().filter(|&&v| cmf[v as usize] > 0.0).count();
        (positive, drawn.len() - positive)
    }

    #[test]
    fn three_quarters_are_drawn_where_the_tool_collides() {
        let cmf = section(500, 500);
        let drawn = draw(&cmf, [cmf.len(), 1, 1], &Sampling { density: 0.4, ..Sampling::default() }, 3);
        assert_eq!(shares(&cmf, &drawn), (300, 100));
        assert!(drawn.windows(2).all(|w| w[0] < w[1]), "sorted, without repetition");
    }

    #[test]
    fn a_small_side_is_taken_whole_and_topped_up() {
        let sampling = Sampling { density: 0.5, ..Sampling::default() };
        let cmf = section(100, 901);
        assert_eq!(shares(&cmf, &draw(&cmf, [cmf.len(), 1, 1], &sampling, 0)), (100, 401));
        let cmf = section(990, 11);
        assert_eq!(shares(&cmf, &draw(&cmf, [cmf.len(), 1, 1], &sampling, 0)), (490, 11));
        let all = Sampling { density: 1.0, ..sampling };
        assert_eq!(shares(&cmf, &draw(&cmf, [cmf.len(), 1, 1], &all, 0)), (990, 11));
    }

    #[test]
    fn seed_and_section_fix_the_draw() {
        let cmf = section(600, 400);
        let sampling = Sampling::default();
        assert_eq!(draw(&cmf, [cmf.len(), 1, 1], &sampling, 1), draw(&cmf, [cmf.len(), 1, 1], &sampling, 1));
        assert_ne!(draw(&cmf, [cmf.len(), 1, 1], &sampling, 1), draw(&cmf, [cmf.len(), 1, 1], &sampling, 2));
        assert_ne!(
            draw(&cmf, [cmf.len(), 1, 1], &sampling, 1),
            draw(&cmf, [cmf.len(), 1, 1], &Sampling { seed: 1, ..sampling }, 1)
        );
    }

    #[test]
    fn every_voxel_of_a_side_is_equally_likely() {
        let cmf = section(40, 60);
        let sampling = Sampling { density: 0.2, ..Sampling::default() };
        let mut hits = vec![0.0; cmf.len()];
        for index in 0..20_000 {
            draw(&cmf, [cmf.len(), 1, 1], &sampling, index).iter().for_each(|&v| hits[v as usize] += 1.0);
        }
        for (voxel, &value) in cmf.iter().enumerate() {
            // 15 of 40 and 5 of 60; the deviation of 20,000 draws is below 70.
            let expected: f64 = 20_000.0 * if value > 0.0 { 15.0 / 40.0 } else { 5.0 / 60.0 };
            assert!((hits[voxel] - expected).abs() < 350.0, "{voxel}: {}", hits[voxel]);
        }
    }

    #[test]
    fn the_boundary_is_what_its_definition_says() {
        let dims = [7, 5, 9];
        let mut generator = ChaCha8Rng::seed_from_u64(4);
        for share in [1, 8, 28] {
            let cmf: Vec<f32> =
                (0..315).map(|_| if generator.next_u64() % 30 < share { 0.5 } else { 0.0 }).collect();
            for width in [1, 2, 4, 20] {
                let fast = boundary(&cmf, dims, width);
                for (voxel, &found) in fast.iter().enumerate() {
                    let at = [voxel / 45, voxel / 9 % 5, voxel % 9];
                    let near = |other: usize| {
                        let to = [other / 45, other / 9 % 5, other % 9];
                        (0..3).all(|axis| at[axis].abs_diff(to[axis]) <= width)
                    };
                    let holds = |collides: bool| (0..315).any(|o| near(o) && (cmf[o] > 0.0) == collides);
                    assert_eq!(found, holds(true) && holds(false), "width {width}, voxel {at:?}");
                }
            }
        }
    }

    #[test]
    fn half_of_the_samples_are_drawn_at_the_boundary() {
        // A slab: CMF > 0 for x < 10 of 20; with width 2 four layers of 100 voxels are at the boundary.
        let dims = [20, 10, 10];
        let cmf: Vec<f32> = (0..2000).map(|v| if v < 1000 { 0.3 } else { 0.0 }).collect();
        let sampling =
            Sampling { density: 0.2, boundary_share: 0.5, boundary_width: 2, ..Sampling::default() };
        let drawn = draw(&cmf, dims, &sampling, 1);
        let count = |range: std::ops::Range<u32>| drawn.iter().filter(|v| range.contains(v)).count();
        assert_eq!((count(0..800), count(800..1200), count(1200..2000)), (150, 200, 50));
        assert!(drawn.windows(2).all(|w| w[0] < w[1]), "sorted, without repetition");
        // A boundary that is too thin is taken whole, and the rest divided as ever.
        let thin = Sampling { density: 0.8, boundary_width: 1, ..sampling };
        let drawn = draw(&cmf, dims, &thin, 1);
        let count = |range: std::ops::Range<u32>| drawn.iter().filter(|v| range.contains(v)).count();
        assert_eq!((count(900..1100), drawn.len()), (200, 1600));
    }
}
