//! Which voxels of a section are sampled.

use imf_fields::recipe::Sampling;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Draws voxels of section `index` without replacement, [`Sampling::count`] of them, `positive_fraction` of them where CMF > 0,
/// each kind uniformly. A kind that is too small is taken whole and topped up from the other. Sorted.
#[must_use]
pub fn draw(cmf: &[f32], sampling: &Sampling, index: u64) -> Vec<u32> {
    let positive = cmf.iter().filter(|&&value| value > 0.0).count();
    let zero = cmf.len() - positive;
    let total = sampling.count(cmf.len());
    let wanted = ((total as f64 * sampling.positive_fraction).round() as usize).min(positive);
    let from_zero = (total - wanted).min(zero);

    let mut generator = ChaCha8Rng::seed_from_u64(sampling.seed);
    generator.set_stream(index);
    // Selection sampling: each voxel is taken with chance (still needed) / (still to come).
    let mut needed = [from_zero, total - from_zero];
    let mut left = [zero, positive];
    let mut drawn = Vec::with_capacity(total);
    for (voxel, &value) in cmf.iter().enumerate() {
        let kind = usize::from(value > 0.0);
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
        let drawn = draw(&cmf, &Sampling { density: 0.4, ..Sampling::default() }, 3);
        assert_eq!(shares(&cmf, &drawn), (300, 100));
        assert!(drawn.windows(2).all(|w| w[0] < w[1]), "sorted, without repetition");
    }

    #[test]
    fn a_small_side_is_taken_whole_and_topped_up() {
        let sampling = Sampling { density: 0.5, ..Sampling::default() };
        let cmf = section(100, 901);
        assert_eq!(shares(&cmf, &draw(&cmf, &sampling, 0)), (100, 401));
        let cmf = section(990, 11);
        assert_eq!(shares(&cmf, &draw(&cmf, &sampling, 0)), (490, 11));
        let all = Sampling { density: 1.0, ..sampling };
        assert_eq!(shares(&cmf, &draw(&cmf, &all, 0)), (990, 11));
    }

    #[test]
    fn seed_and_section_fix_the_draw() {
        let cmf = section(600, 400);
        let sampling = Sampling::default();
        assert_eq!(draw(&cmf, &sampling, 1), draw(&cmf, &sampling, 1));
        assert_ne!(draw(&cmf, &sampling, 1), draw(&cmf, &sampling, 2));
        assert_ne!(draw(&cmf, &sampling, 1), draw(&cmf, &Sampling { seed: 1, ..sampling }, 1));
    }

    #[test]
    fn every_voxel_of_a_side_is_equally_likely() {
        let cmf = section(40, 60);
        let sampling = Sampling { density: 0.2, ..Sampling::default() };
        let mut hits = vec![0.0; cmf.len()];
        for index in 0..20_000 {
            draw(&cmf, &sampling, index).iter().for_each(|&v| hits[v as usize] += 1.0);
        }
        for (voxel, &value) in cmf.iter().enumerate() {
            // 15 of 40 and 5 of 60; the deviation of 20,000 draws is below 70.
            let expected: f64 = 20_000.0 * if value > 0.0 { 15.0 / 40.0 } else { 5.0 / 60.0 };
            assert!((hits[voxel] - expected).abs() < 350.0, "{voxel}: {}", hits[voxel]);
        }
    }
}
