//! In how few set-ups a surface is machined: each is one way to put the part on the machine, and gives the tool one
//! direction (three axes) or all within the ranges of the rotary axes.

use glam::{DQuat, DVec3};

use super::{SurfaceAccess, SurfaceSample};
use crate::control::Control;
use crate::mesh::{Mesh, SAME};
use crate::orientation::{Limits, Orientation};
use crate::parallel;
use crate::set_cover::{CoverProblem, CoverSettings};

/// Degrees that rounding may take from the end of a range of turns.
const SLACK: f64 = 1e-6;

/// One way to put the part on the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSetup {
    /// Unit vector in the part's frame that points along the machine's +z.
    pub up: DVec3,
    /// Degrees that the part is turned about the machine's +z, once the shortest way has brought `up` there.
    pub turn: f64,
    /// Indices of the directions that the machine gives the tool there.
    pub directions: Vec<usize>,
    /// True where the part stands on its lowest face by itself.
    pub rests: bool,
    /// Area of the surface that lies on the table, in the part's unit squared.
    pub floor_area: f64,
}

impl PartSetup {
    /// Every set-up with this direction up that matters: no turn about +z gives the tool more of `directions` within the
    /// machine's limits than one of these. Several only where the turning axis has a range of less than 360°, or a cone leans;
    /// quarter turns come first then, whatever they give. A direction of `directions` that is next to `up` stands for it.
    #[must_use]
    pub fn all(part: &Mesh, up: DVec3, directions: &[Orientation], limits: &Limits) -> Vec<Self> {
        let near =
            directions.iter().map(Orientation::direction).filter(|direction| direction.distance(up) <= SAME);
        let up = near.min_by(|a, b| a.distance(up).total_cmp(&b.distance(up))).unwrap_or(up);
        let upright = DQuat::from_rotation_arc(up, DVec3::Z);
        let turns: Vec<Vec<[f64; 2]>> =
            directions.iter().map(|o| limits.turns((upright * o.direction()).normalize())).collect();
        let partial = turns.iter().flatten().filter(|[from, to]| to - from < 360.0);
        // Turned back until the first direction is about to be lost, none is lost.
        let mut starts: Vec<f64> = partial.map(|turn| turn[0]).collect();
        starts.sort_by(f64::total_cmp);
        starts.dedup();
        let (rests, floor_area) = (part.is_stable_on(-up), part.floor_area(-up));
        let setup = |turn: f64| {
            let reached = (0..turns.len()).filter(|&direction| end(&turns[direction], turn).is_some());
            Self { up, turn, directions: reached.collect(), rests, floor_area }
        };
        let quarters = if starts.is_empty() { &[0.0][..] } else { &[0.0, 90.0, 180.0, 270.0] };
        let mut kept: Vec<Self> = quarters.iter().map(|&turn| setup(turn)).collect();
        kept.dedup_by(|a, b| a.directions == b.directions);
        let others = starts.into_iter().map(|start| {
            let ends = turns.iter().filter_map(|turns| end(turns, start));
            setup(roundest(start, ends.fold(f64::INFINITY, f64::min)))
        });
        let mut others: Vec<Self> = others.collect();
        // Those with most directions first, of equal ones in the order of their turns.
        others.sort_by_key(|setup| usize::MAX - setup.directions.len());
        let bits = |setup: &Self| words(&setup.directions, directions.len());
        let mut known: Vec<Vec<u64>> = kept.iter().map(bits).collect();
        for setup in others {
            let own = bits(&setup);
            if !known.iter().any(|known| own.iter().zip(known).all(|(own, known)| own & !known == 0)) {
                known.push(own);
                kept.push(setup);
            }
        }
        kept
    }

    /// From the part's frame to the machine's.
    #[must_use]
    pub fn rotation(&self) -> DQuat {
        DQuat::from_rotation_z(self.turn.to_radians()) * DQuat::from_rotation_arc(self.up, DVec3::Z)
    }
}

/// Where the range of turns ends that holds one; the latest end of several.
fn end(turns: &[[f64; 2]], turn: f64) -> Option<f64> {
    let ends = turns.iter().flat_map(|&[from, to]| {
        let whole = to - from >= 360.0;
        let contains = move |shift: &f64| (from - SLACK..=to + SLACK).contains(&(turn + shift));
        let ends = [0.0, 360.0, -360.0].into_iter().filter(contains).map(move |shift| to - shift);
        ends.map(move |end| if whole { f64::INFINITY } else { end.max(turn) })
    });
    ends.max_by(f64::total_cmp)
}

/// The angle within a range that one would set by hand.
fn roundest(from: f64, to: f64) -> f64 {
    let steps = [360.0, 90.0, 45.0, 30.0, 15.0, 10.0, 5.0, 1.0];
    let round = steps.into_iter().map(|step| (from / step).ceil() * step).find(|angle| *angle <= to);
    round.unwrap_or(0.5 * (from + to)).rem_euclid(360.0)
}

/// Indices as bits, 64 a word, the lowest first.
fn words(indices: &[usize], count: usize) -> Vec<u64> {
    let mut words = vec![0u64; count.div_ceil(64)];
    indices.iter().for_each(|index| words[index / 64] |= 1 << (index % 64));
    words
}

/// One of the set-ups that were chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenSetup {
    /// Its index in the candidates.
    pub candidate: usize,
    /// The area that it reaches.
    pub area: f64,
    /// The area that no other chosen one reaches.
    pub alone: f64,
}

/// The fewest set-ups, and what they reach.
#[derive(Clone, Debug, PartialEq)]
pub struct SetupPlan {
    /// The set-ups; each adds the most to those before it.
    pub setups: Vec<ChosenSetup>,
    /// No fewer of the candidates reach as much.
    pub at_least: usize,
    /// The area that the chosen set-ups reach together.
    pub area: f64,
    /// The area that all candidates together reach.
    pub reachable: f64,
}

impl SetupPlan {
    /// True where no plan with fewer set-ups of the candidates exists.
    #[must_use]
    pub fn is_proven(&self) -> bool {
        self.at_least == self.setups.len()
    }
}

/// The fewest of these set-ups in which any of the tools reaches the fraction of [`CoverSettings`] of the area that all of
/// them reach; `None` where the control asks to stop. Where a part that stands by itself does too, it is chosen, and of set-ups
/// that do as well those that come first. One unit of progress is one set-up looked at. Every element of `tools` is of these samples and of the directions that the set-ups count.
///
/// # Panics
/// If the numbers of samples or directions differ.
#[must_use]
pub fn fewest_setups(
    tools: &[&SurfaceAccess],
    samples: &[SurfaceSample],
    setups: &[PartSetup],
    settings: &CoverSettings,
    control: Control<'_>,
) -> Option<SetupPlan> {
    let count = tools.first().map_or(0, |tool| tool.directions());
    assert!(tools.iter().all(|tool| tool.directions() == count && tool.reach.len() == samples.len()));
    let reached = parallel::map(setups.len(), |index| {
        let directions = words(&setups[index].directions, count);
        let reaches = |sample: &usize| tools.iter().any(|tool| tool.is_free_within(*sample, &directions));
        let stop = control.is_cancelled();
        (control.progress)(1);
        if stop { Vec::new() } else { (0..samples.len()).filter(reaches).collect::<Vec<usize>>() }
    });
    control.check().ok()?;
    let mut problem = CoverProblem::new(samples.iter().map(|sample| sample.area).collect());
    reached.into_iter().for_each(|samples| problem.add(samples));
    let mut cover = problem.fewest(settings, control)?;
    let reachable = problem.covered(&(0..setups.len()).collect::<Vec<_>>());
    // Sums in another order differ in their last digits.
    let enough = problem.covered(&cover.sets).min(settings.fraction * reachable * (1.0 + 1e-12));
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
    let alone = problem.covered_alone(&cover.sets);
    let chosen = cover.sets.iter().zip(alone).map(|(&candidate, alone)| ChosenSetup {
        candidate,
        area: problem.covered(&[candidate]),
        alone,
    });
    Some(SetupPlan {
        setups: chosen.collect(),
        at_least: cover.at_least,
        area: problem.covered(&cover.sets),
        reachable,
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat4;

    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::orientation::{AXES, OrientationSet};
    use crate::surface::{
        CollisionEnvironment, SurfaceSamples, SurfaceTool, default_tolerance, surface_access,
    };
    use crate::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
    use crate::unit::LengthUnit;
    use crate::voxelize::voxelize;

    fn block() -> Mesh {
        unit_cube().transformed(&DMat4::from_scale(DVec3::new(40.0, 30.0, 15.0)))
    }

    /// The fewest set-ups for a plain block with a flat end mill whose flutes are longer than the block is high.
    fn plan(limits: &str, fraction: f64) -> (SetupPlan, Vec<PartSetup>, f64) {
        plan_of(&AXES, limits, fraction)
    }

    fn plan_of(ways: &[DVec3], limits: &str, fraction: f64) -> (SetupPlan, Vec<PartSetup>, f64) {
        let cylinder = |kind, from, to, radius| Element {
            kind,
            profile: vec![Segment::Line { from, to, radius_from: radius, radius_to: radius }],
        };
        let elements = vec![
            cylinder(ElementKind::Cutter, 0.0, 45.0, 5.0),
            cylinder(ElementKind::Holder(0), 45.0, 75.0, 12.0),
        ];
        let (name, unit, sharp_points) = ("flat".into(), LengthUnit::Mm, SharpPoints::Tip);
        let tool =
            Tool { name, unit, shape: ToolShape::Revolved(elements), sharp_points, overall_length: None };
        let block = block();
        let grid = Grid::with_pitch(DVec3::splat(-0.4), DVec3::new(40.3, 30.3, 15.3), 1.0, 1).unwrap();
        let solid = Arc::new(voxelize(&block, &grid, false));
        let samples = SurfaceSamples::new(&block, &solid, 600).samples;
        let environment = CollisionEnvironment::new(&solid.into(), &[]);
        let directions = OrientationSet::parse("0,0;0,180;0,90;180,90;90,90;270,90").unwrap().orientations;
        let tool =
            SurfaceTool::new(&environment, &tool.into(), default_tolerance(1.0, LengthUnit::Mm)).unwrap();
        let access = surface_access(&tool, &samples, &directions, Control::quiet()).unwrap();
        let limits = Limits::parse(limits).unwrap();
        let setups: Vec<PartSetup> =
            ways.iter().flat_map(|&up| PartSetup::all(&block, up, &directions, &limits)).collect();
        let settings = CoverSettings { fraction, ..CoverSettings::default() };
        let plan = fewest_setups(&[&access], &samples, &setups, &settings, Control::quiet()).unwrap();
        (plan, setups, samples.iter().map(|sample| sample.area).sum())
    }

    #[test]
    fn a_block_takes_two_set_ups_on_three_axes_and_one_where_the_tool_tilts_to_the_side() {
        let (three_axes, setups, area) = plan("cone:0,0,1:0", 1.0);
        assert!(setups.iter().all(|setup| setup.directions.len() == 1 && setup.rests && setup.turn == 0.0));
        let floors: Vec<f64> = setups.iter().map(|setup| setup.floor_area.round()).collect();
        assert_eq!(floors, [1200.0, 1200.0, 450.0, 450.0, 600.0, 600.0]);
        assert_eq!((three_axes.setups.len(), three_axes.at_least), (2, 2));
        assert!(
            (three_axes.area - area).abs() < 1e-6 * area && (three_axes.reachable - area).abs() < 1e-6 * area
        );
        // Each leaves the face that it stands on to the other.
        let faces = three_axes.setups.iter().map(|chosen| area - chosen.area);
        let [first, second] = faces.collect::<Vec<_>>()[..] else { panic!() };
        assert!((first - three_axes.setups[1].alone).abs() < 1e-6 * area);
        assert!((second - three_axes.setups[0].alone).abs() < 1e-6 * area);
        let (tilting, setups, _) = plan("cone:0,0,1:90", 1.0);
        assert!(setups.iter().all(|setup| setup.directions.len() == 5));
        assert_eq!(tilting.setups.len(), 1);
    }

    #[test]
    fn a_face_that_may_stay_saves_a_set_up() {
        // The smallest face is 450 of 4,500 mm².
        let (plan, ..) = plan("cone:0,0,1:0", 0.85);
        assert_eq!((plan.setups.len(), plan.is_proven()), (1, true));
    }

    #[test]
    fn a_part_that_stands_by_itself_is_preferred_where_it_is_enough() {
        let ways = [&[DVec3::ONE.normalize()], &AXES[..]].concat();
        // On its corner three axes are within 60°, and their flanks reach all six sides; on a face the one axis leaves that face: 90 %
        // at the most.
        let (corner, setups, _) = plan_of(&ways, "cone:0,0,1:60", 0.95);
        assert!(corner.setups.len() == 1 && !setups[corner.setups[0].candidate].rests);
        let (standing, setups, area) = plan_of(&ways, "cone:0,0,1:60", 0.85);
        assert!(standing.setups.len() == 1 && standing.is_proven());
        assert!(setups[standing.setups[0].candidate].rests);
        assert!((standing.area / area - 0.9).abs() < 0.01, "{} of {area}", standing.area);
    }

    /// Where C turns a quarter only, it depends on how the part is turned what the tool reaches: every turn by brute force.
    #[test]
    fn no_turn_of_the_part_reaches_more_than_the_set_ups_that_are_given() {
        let part = block();
        for (limits, several) in [
            ("ac:-20:100:0:90", true),
            ("bc:60:110:-30:15", true),
            ("bc:-90:90:20:20", true),
            ("cone:1,0,0.1:20", true),
            ("ac:-30:120:-180:180", false),
            ("cone:0,0,1:70", false),
        ] {
            let limits = Limits::parse(limits).unwrap();
            let directions = OrientationSet::parse("axes+fibonacci:90").unwrap().orientations;
            for up in [DVec3::Z, DVec3::NEG_X, DVec3::new(0.48, -0.6, 0.64)] {
                let setups = PartSetup::all(&part, up, &directions, &limits);
                assert_eq!(setups.len() > 1, several, "{limits} {up}");
                let reached = |rotation: DQuat| -> Vec<usize> {
                    let along = |index: &usize| (rotation * directions[*index].direction()).normalize();
                    (0..directions.len()).filter(|index| limits.reach(along(index))).collect()
                };
                let upright = DQuat::from_rotation_arc(up, DVec3::Z);
                for degrees in 0..3600 {
                    let turn = DQuat::from_rotation_z((0.1 * f64::from(degrees)).to_radians());
                    let there = reached(turn * upright);
                    let contains =
                        |setup: &PartSetup| there.iter().all(|index| setup.directions.contains(index));
                    assert!(setups.iter().any(contains), "{limits} {up} {degrees}: {there:?}");
                }
                // And each reaches what it says, but for what lies on the very end of a range.
                for setup in &setups {
                    assert!((setup.rotation() * up).distance(DVec3::Z) < 1e-9);
                    let there = reached(setup.rotation());
                    assert!(
                        there.iter().all(|index| setup.directions.contains(index)),
                        "{limits} {up} {}",
                        setup.turn
                    );
                    let beyond = setup.directions.iter().filter(|index| !there.contains(index));
                    for &index in beyond {
                        let turns = [-2.0 * SLACK, 2.0 * SLACK]
                            .map(|by: f64| DQuat::from_rotation_z(by.to_radians()));
                        let held =
                            turns.iter().any(|&turn| reached(turn * setup.rotation()).contains(&index));
                        assert!(held, "{limits} {up} {} {index}", setup.turn);
                    }
                }
            }
        }
    }
}
