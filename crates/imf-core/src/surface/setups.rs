//! In how few set-ups a surface is machined: each is one way to put the part on the machine, and gives the tool one
//! direction (three axes) or all within the ranges of the rotary axes.

use super::part_setup::{PartSetup, words};
use super::{SurfaceAccess, SurfaceSample, SurfaceTool, ToolDirection};
use crate::control::Control;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::parallel;
use crate::set_cover::{Cover, CoverProblem, CoverSettings};

/// A tool in all set-ups.
#[derive(Clone, Copy)]
pub struct SetupTool<'a> {
    /// What it reaches of the samples from all directions.
    pub access: &'a SurfaceAccess,
    /// The tool where a set-up's machine brings it ([`SurfaceTool::limited`]); `None` where it is brought to every pose.
    pub brought: Option<&'a (dyn Fn(&PartSetup) -> SurfaceTool + Sync)>,
}

/// The samples, weighing their areas, that any of the tools reaches in each set-up, but for those that the part stands on; `None`
/// where the control asks to stop. One unit of progress is one set-up. `directions` are those that the tools' access and the set-ups count.
///
/// # Panics
/// If the numbers of samples or directions differ.
#[must_use]
pub fn reached_in_setups(
    tools: &[SetupTool<'_>],
    samples: &[SurfaceSample],
    directions: &[Orientation],
    setups: &[PartSetup],
    control: Control<'_>,
) -> Option<CoverProblem> {
    let fits = |access: &SurfaceAccess| {
        access.directions() == directions.len() && access.reach.len() == samples.len()
    };
    assert!(tools.iter().all(|tool| fits(tool.access)));
    let turns: Vec<ToolDirection> = directions.iter().map(ToolDirection::new).collect();
    let reached = parallel::map(setups.len(), |index| {
        let setup = &setups[index];
        let given = words(&setup.directions, directions.len());
        let mut reached = vec![false; samples.len()];
        for tool in tools {
            let Some(brought) = tool.brought.map(|brought| brought(setup)) else {
                let of_all = |sample: usize| tool.access.is_free_within(sample, &given);
                reached.iter_mut().enumerate().for_each(|(sample, any)| *any |= of_all(sample));
                continue;
            };
            let mut last = vec![[None; 2]; turns.len()];
            for (sample, any) in reached.iter_mut().enumerate().filter(|(_, any)| !**any) {
                if control.is_cancelled() {
                    return Vec::new();
                }
                let free = setup.directions.iter().copied().filter(|&d| tool.access.is_free(sample, d));
                *any = brought.reaches(&samples[sample], free, &turns, &mut last);
            }
        }
        (control.progress)(1);
        let is_reached = |&sample: &usize| reached[sample] && !setup.stands_on(&samples[sample]);
        (0..samples.len()).filter(is_reached).collect::<Vec<usize>>()
    });
    control.check().ok()?;
    let mut problem = CoverProblem::new(samples.iter().map(|sample| sample.area).collect());
    reached.into_iter().for_each(|samples| problem.add(samples));
    Some(problem)
}

/// The stock's voxels that are removed in each set-up, weighing their volume, as elements in the order of `stock`; `removed` has by
/// direction the indices of those that are removed from there.
///
/// # Panics
/// If an index is not the stock's.
#[must_use]
pub fn removed_in_setups(removed: &[Vec<u32>], stock: &Occupancy, setups: &[PartSetup]) -> CoverProblem {
    let mut element = vec![usize::MAX; stock.solid.len()];
    stock.solids().enumerate().for_each(|(place, voxel)| element[voxel] = place);
    let mut problem = CoverProblem::new(vec![stock.grid.voxel_volume(); stock.count()]);
    for setup in setups {
        let voxels = setup.directions.iter().flat_map(|&direction| &removed[direction]);
        problem.add(voxels.map(|&voxel| element[voxel as usize]));
    }
    problem
}

/// The fewest set-ups that cover [`CoverSettings::fraction`] of what all of them cover; `None` where the control asks
/// to stop. `problem` has one set per set-up, in their order, and the sets of the cover are indices of set-ups. Ties
/// go to set-ups in which the part rests by itself, then to the first.
///
/// # Panics
/// If the problem has another number of sets.
#[must_use]
pub fn fewest_setups(
    setups: &[PartSetup],
    problem: &CoverProblem,
    settings: &CoverSettings,
    control: Control<'_>,
) -> Option<Cover> {
    assert_eq!(setups.len(), problem.sets());
    let mut cover = problem.fewest(settings, control)?;
    // Sums in another order differ in their last digits.
    let enough = problem.covered(&cover.sets).min(settings.fraction * problem.coverable() * (1.0 + 1e-12));
    let standing: Vec<usize> = (0..setups.len()).filter(|&index| setups[index].rests).collect();
    for at in 0..cover.sets.len() {
        if setups[cover.sets[at]].rests {
            continue;
        }
        let mut best: Option<(f64, usize)> = None;
        let held = cover.sets[at];
        let chosen = cover.sets.clone();
        for &candidate in standing.iter().filter(|candidate| !chosen.contains(candidate)) {
            cover.sets[at] = candidate;
            let covered = problem.covered(&cover.sets);
            if covered >= enough && best.is_none_or(|(most, _)| covered > most) {
                best = Some((covered, candidate));
            }
        }
        cover.sets[at] = best.map_or(held, |(_, candidate)| candidate);
    }
    problem.largest_gain_first(&mut cover.sets);
    Some(cover)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::mesh::Mesh;
    use crate::orientation::{AXES, Limits};
    use crate::section::test_shapes::{orientations, revolved};
    use crate::surface::SampleReach;
    use crate::surface::closed_forms::Part;
    use crate::tool::{ElementKind, Segment, Tool};

    fn block() -> Mesh {
        Mesh::cuboid(DVec3::ZERO, DVec3::new(40.0, 30.0, 15.0))
    }

    /// Flutes of 45 in a holder.
    fn flat() -> Tool {
        revolved([
            (ElementKind::Cutter, vec![Segment::cylinder(0.0, 45.0, 5.0)]),
            (ElementKind::Holder(0), vec![Segment::cylinder(45.0, 75.0, 12.0)]),
        ])
    }

    fn setups(ways: &[DVec3], directions: &[Orientation], limits: &str) -> Vec<PartSetup> {
        let limits = Limits::parse(limits).unwrap();
        ways.iter().flat_map(|&up| PartSetup::all(&block(), up, directions, &limits, false)).collect()
    }

    /// The fewest set-ups for a plain block with a flat end mill whose flutes are longer than the block is high.
    struct Plan {
        chosen: Cover,
        setups: Vec<PartSetup>,
        /// What each of them reaches.
        reached: CoverProblem,
        /// Of the whole block.
        area: f64,
    }

    fn plan(ways: &[DVec3], limits: &str, fraction: f64) -> Plan {
        let part = Part::sampled(&block(), 1.0, 600);
        let directions = orientations("0,0;0,180;0,90;180,90;90,90;270,90");
        let access = part.access(&part.surface_tool(&flat()), &directions);
        let setups = setups(ways, &directions, limits);
        let settings = CoverSettings { fraction, ..CoverSettings::default() };
        let tools = [SetupTool { access: &access, brought: None }];
        let reached =
            reached_in_setups(&tools, &part.samples, &directions, &setups, Control::quiet()).unwrap();
        let chosen = fewest_setups(&setups, &reached, &settings, Control::quiet()).unwrap();
        Plan { chosen, setups, area: part.samples.iter().map(|sample| sample.area).sum(), reached }
    }

    #[test]
    fn a_block_takes_two_set_ups_also_where_the_tool_tilts_to_the_side_as_it_stands_on_a_face() {
        let Plan { chosen, setups, reached, area } = plan(&AXES, "cone:0,0,1:0", 1.0);
        assert!(setups.iter().all(|setup| setup.directions.len() == 1 && setup.rests && setup.turn == 0.0));
        let floors: Vec<f64> = setups.iter().map(|setup| setup.floor_area.round()).collect();
        assert_eq!(floors, [1200.0, 1200.0, 450.0, 450.0, 600.0, 600.0]);
        assert_eq!((chosen.sets.len(), chosen.at_least), (2, 2));
        let near = |one: f64, other: f64| assert!((one - other).abs() < 1e-6 * area, "{one} {other}");
        near(reached.covered(&chosen.sets), area);
        // Each leaves the face that it stands on to the other.
        let [first, second] = chosen.sets[..] else { panic!() };
        let alone = reached.covered_alone(&chosen.sets);
        near(area - reached.covered(&[first]), alone[1]);
        near(area - reached.covered(&[second]), alone[0]);
        let tilting = plan(&AXES, "cone:0,0,1:90", 1.0);
        assert!(tilting.setups.iter().all(|setup| setup.directions.len() == 5));
        // Flanks would reach the face that it stands on as well: nothing else keeps them away.
        assert_eq!(tilting.chosen.sets.len(), 2);
        for (index, setup) in tilting.setups.iter().enumerate() {
            near(tilting.reached.covered(&[index]), area - setup.floor_area);
        }
    }

    #[test]
    fn a_face_that_may_stay_saves_a_set_up() {
        // The smallest face is 450 of 4,500 mm².
        let Plan { chosen, .. } = plan(&AXES, "cone:0,0,1:0", 0.85);
        assert_eq!((chosen.sets.len(), chosen.is_proven()), (1, true));
    }

    #[test]
    fn a_part_that_stands_by_itself_is_preferred_where_it_is_enough() {
        let ways = [&[DVec3::ONE.normalize()], &AXES[..]].concat();
        // On its corner three axes are within 60°, and their flanks reach all six sides; on a face that face is left: 90 % at the most.
        let corner = plan(&ways, "cone:0,0,1:60", 0.95);
        assert!(corner.chosen.sets.len() == 1 && !corner.setups[corner.chosen.sets[0]].rests);
        let Plan { chosen, setups, reached, area } = plan(&ways, "cone:0,0,1:60", 0.85);
        assert!(chosen.sets.len() == 1 && chosen.is_proven());
        assert!(setups[chosen.sets[0]].rests);
        let covered = reached.covered(&chosen.sets);
        assert!((covered / area - 0.9).abs() < 0.01, "{covered} of {area}");
    }

    #[test]
    fn a_tool_that_is_brought_to_some_poses_reaches_what_it_reaches_there_in_each_set_up() {
        let part = Part::sampled(&block(), 1.0, 300);
        let (samples, directions) = (&part.samples, orientations("axes"));
        let tool = part.surface_tool(&flat());
        let access = part.access(&tool, &directions);
        let setups = setups(&AXES, &directions, "cone:0,0,1:90");
        const MIDDLE: DVec3 = DVec3::new(20.0, 15.0, 7.5);
        // The part's half that is up is out of reach.
        let brought = |setup: &PartSetup| {
            let up = setup.up;
            let limit = move |tip: DVec3, _| (tip - MIDDLE).dot(up) < 0.0;
            tool.clone().limited(Arc::new(limit))
        };
        let tools = [SetupTool { access: &access, brought: Some(&brought) }];
        let found = reached_in_setups(&tools, samples, &directions, &setups, Control::quiet()).unwrap();
        let mut fewer = 0;
        for (index, setup) in setups.iter().enumerate() {
            let own = setup.directions.iter().map(|&at| directions[at]).collect::<Vec<_>>();
            let expected = part.access(&brought(setup), &own);
            for (sample, reach) in expected.reach.iter().enumerate() {
                let reached = matches!(reach, SampleReach::Reached { .. });
                let reached = reached && !setup.stands_on(&samples[sample]);
                assert_eq!(found.contains(index, sample), reached, "{setup:?} {sample}");
                fewer += usize::from(!reached && access.is_free_from_any(sample, &setup.directions));
                for (place, direction) in own.iter().enumerate() {
                    let tip = brought(setup).free_tip(&samples[sample], direction);
                    assert_eq!(tip.is_some(), expected.is_free(sample, place));
                    assert!(tip.is_none_or(|tip| (tip - MIDDLE).dot(setup.up) < 0.0));
                }
            }
        }
        assert!(fewer > samples.len(), "{fewer}");
    }
}
