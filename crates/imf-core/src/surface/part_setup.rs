//! The ways to put a part on a machine: what points up, and the turns that matter.

use glam::{DQuat, DVec3};

use super::SurfaceSample;
use crate::mesh::{Mesh, SAME};
use crate::orientation::{Limits, Orientation};
use crate::pose::Pose;

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
    /// How far along `up` the surface that lies on the table goes: no tool gets there in this set-up.
    pub floor: f64,
}

impl PartSetup {
    /// The set-ups with this direction up that matter: no turn about +z gives the tool more of `directions` within
    /// the machine's limits than one of these. There are several only where the turning axis has a range of less than
    /// 360° or a cone is tilted; the four quarter turns then come first. If a direction lies within `SAME` of `up`,
    /// it replaces `up`. With `quarters` all four quarter turns are returned even if they reach the same directions:
    /// the travel and the solids of a machine may treat them differently.
    #[must_use]
    pub fn all(
        part: &Mesh,
        up: DVec3,
        directions: &[Orientation],
        limits: &Limits,
        quarters: bool,
    ) -> Vec<Self> {
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
        let (lowest, level) = part.floor(-up);
        let setup = |turn: f64| {
            let reached = (0..turns.len()).filter(|&direction| end(&turns[direction], turn).is_some());
            Self { up, turn, directions: reached.collect(), rests, floor_area, floor: level - lowest }
        };
        let first = if starts.is_empty() && !quarters { &[0.0][..] } else { &[0.0, 90.0, 180.0, 270.0] };
        let mut kept: Vec<Self> = first.iter().map(|&turn| setup(turn)).collect();
        kept.dedup_by(|a, b| !quarters && a.directions == b.directions);
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

    /// Whether a sample lies on the table.
    #[must_use]
    pub fn stands_on(&self, sample: &SurfaceSample) -> bool {
        sample.point.dot(self.up) <= self.floor
    }

    /// From the part's frame to that in which the middle of its foot is the zero: that of its box in x and y, its lowest point in z.
    #[must_use]
    pub fn place(&self, part: &Mesh) -> Pose {
        let rotation = self.rotation();
        let turned = part.vertices.iter().map(|&vertex| rotation * vertex);
        let most = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (lower, upper) = turned.fold(most, |(lower, upper), v| (lower.min(v), upper.max(v)));
        let middle = 0.5 * (lower + upper);
        Pose::new(-DVec3::new(middle.x, middle.y, lower.z), rotation)
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
pub(super) fn words(indices: &[usize], count: usize) -> Vec<u64> {
    let mut words = vec![0u64; count.div_ceil(64)];
    indices.iter().for_each(|index| words[index / 64] |= 1 << (index % 64));
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::unit_cube;
    use crate::section::test_shapes::orientations;

    /// Where C turns a quarter only, it depends on how the part is turned what the tool reaches: every turn by brute force.
    #[test]
    fn no_turn_of_the_part_reaches_more_than_the_set_ups_that_are_given() {
        let part = Mesh::cuboid(DVec3::ZERO, DVec3::new(40.0, 30.0, 15.0));
        for (limits, several) in [
            ("ac:-20:100:0:90", true),
            ("bc:60:110:-30:15", true),
            ("bc:-90:90:20:20", true),
            ("cone:1,0,0.1:20", true),
            ("ac:-30:120:-180:180", false),
            ("cone:0,0,1:70", false),
        ] {
            let limits = Limits::parse(limits).unwrap();
            let directions = orientations("axes+fibonacci:90");
            for up in [DVec3::Z, DVec3::NEG_X, DVec3::new(0.48, -0.6, 0.64)] {
                let setups = PartSetup::all(&part, up, &directions, &limits, false);
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

    #[test]
    fn all_quarter_turns_are_there_where_they_are_asked_for() {
        let directions = orientations("axes");
        for limits in ["cone:0,0,1:0", "ac:-20:100:-360:360"] {
            let limits = Limits::parse(limits).unwrap();
            let setups = PartSetup::all(&unit_cube(), DVec3::Z, &directions, &limits, true);
            assert_eq!(setups.iter().map(|setup| setup.turn).collect::<Vec<_>>(), [0.0, 90.0, 180.0, 270.0]);
            assert_eq!(PartSetup::all(&unit_cube(), DVec3::Z, &directions, &limits, false).len(), 1);
        }
    }

    #[test]
    fn a_part_is_placed_with_the_middle_of_its_foot_at_zero() {
        let part = Mesh::cuboid(DVec3::ZERO, DVec3::new(40.0, 30.0, 15.0));
        let (up, directions) = (DVec3::X, Vec::new());
        let setup = PartSetup { up, turn: 90.0, directions, rests: true, floor_area: 450.0, floor: 0.0 };
        let place = setup.place(&part);
        let placed = Mesh { vertices: part.vertices.iter().map(|&v| place.of_point(v)).collect(), ..part };
        let (lower, upper) = placed.bounds().unwrap();
        // What was x is z, and a quarter turn has exchanged the other two.
        assert!(lower.distance(DVec3::new(-15.0, -7.5, 0.0)) < 1e-9, "{lower}");
        assert!(upper.distance(DVec3::new(15.0, 7.5, 40.0)) < 1e-9, "{upper}");
    }
}
