//! The teapot at the paper's resolution: all 225 sections of `grid:15`, count for count, and their least.

use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::section::{SectionScratch, direct_count, imf};
use imf_core::tool::ToolVoxels;
use imf_train::training::permutation::Permutation;
use rayon::prelude::*;

use crate::scene::{orientations, plan, scene};

/// Voxels of every section that are counted directly, other ones in each.
const CHECKED: usize = 64;
/// A measure is a quotient of whole numbers rounded to f32: two ways to divide differ by a unit in the last place.
const LAST_PLACE: f64 = f32::EPSILON as f64;

#[test]
fn sections_of_the_papers_teapot_are_direct_sums_and_the_imf_is_their_least() {
    let scene = scene(ReferencePart::Teapot, ReferencePart::Teapot.dims());
    let plan = plan(&scene);
    let set = orientations("grid:15").orientations;
    let least = imf(&plan, &set, Control::quiet()).unwrap();
    assert!(least.best.iter().all(|&best| (best as usize) < set.len()));

    let voxels = plan.grid().len();
    let section = |scratch: &mut SectionScratch, index: usize| {
        // The counts of the section before are not in it.
        *scratch = SectionScratch::default();
        let (whole, counts) = plan.counts_in(&set[index], plan.grid(), scratch).unwrap();
        let rotated = ToolVoxels::new(plan.tool(), &set[index], plan.grid().pitch).unwrap();
        assert_eq!(whole, rotated.count);

        let order = Permutation::new(voxels, 2024, index as u64);
        let mut colliding = 0;
        for voxel in (0..CHECKED).map(|place| order.at(place)) {
            let at = plan.grid().voxel(voxel).map(|v| v as i64);
            let expected = direct_count(&plan.obstacle().forbidden, &rotated, at);
            assert_eq!(counts[voxel], expected, "{:?}, voxel {at:?}", set[index]);
            colliding += usize::from(expected > 0);
        }

        // Held for every section, these three say that the IMF is the least of all and its index the first that has it.
        let fields = least.value.iter().zip(&least.best);
        for (voxel, (&count, (&value, &best))) in counts.iter().zip(fields).enumerate() {
            let measure = f64::from(count) / f64::from(whole);
            let value = f64::from(value);
            let case = || format!("voxel {voxel}, section {index}: {measure}; IMF {value} by section {best}");
            assert!(value <= measure * (1.0 + LAST_PLACE), "not the least: {}", case());
            if best as usize == index {
                assert!((value - measure).abs() <= measure * LAST_PLACE, "not its section's: {}", case());
            }
            assert!(count > 0 || best as usize <= index, "not the first: {}", case());
        }
        colliding
    };
    let colliding: Vec<usize> =
        (0..set.len()).into_par_iter().map_init(SectionScratch::default, section).collect();

    // The sample sees both sides.
    let all = CHECKED * set.len();
    let colliding = colliding.into_iter().sum::<usize>();
    assert!((all / 10..all * 9 / 10).contains(&colliding), "{colliding} of {all} counts are positive");
}
