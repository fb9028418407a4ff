//! Which set-ups are candidates: ways up that part and vise suggest, and the turns of each that matter.

use glam::{DQuat, DVec3};

use super::PartSetup;
use crate::mesh::{MachiningDirection, Mesh, SAME};
use crate::orientation::{AXES, Limits, Orientation, OrientationSet, joined};

/// Ways up that a vise and the part suggest: the axes, then the part's own directions, then their opposites; none twice.
#[must_use]
pub fn ways_up(suggested: &[MachiningDirection]) -> Vec<DVec3> {
    let own = suggested.iter().map(|suggested| suggested.direction);
    let opposite = suggested.iter().map(|suggested| -suggested.direction);
    let mut ways: Vec<DVec3> = Vec::new();
    for way in AXES.into_iter().chain(own).chain(opposite) {
        if ways.iter().all(|known| known.distance(way) > SAME) {
            ways.push(way);
        }
    }
    ways
}

/// The text of a set of directions with every way up added, as a direction that the tool may come from.
#[must_use]
pub fn with_ways_up(set: &str, suggested: &[MachiningDirection]) -> String {
    let own = |way: &DVec3| suggested.iter().any(|suggested| suggested.direction == *way);
    // The axes are in the set in any case.
    let is_new = |way: &DVec3| own(&-*way) && !own(way) && !AXES.contains(way);
    let opposite = ways_up(suggested).into_iter().filter(is_new);
    let opposite = opposite.filter_map(Orientation::from_direction);
    let opposite: Vec<String> = opposite.map(|o| format!("{},{}", o.theta, o.phi)).collect();
    let without = |own: &str| set.strip_prefix(own).filter(|rest| rest.is_empty() || rest.starts_with('+'));
    let rest =
        without("axes+normals").or_else(|| without("axes")).map_or(set, |rest| rest.trim_start_matches('+'));
    let terms = ["axes+normals", &opposite.join(";"), rest];
    terms.into_iter().filter(|term| !term.is_empty()).collect::<Vec<_>>().join("+")
}

/// More candidates than this take too long to compare.
const MOST: usize = 20_000;

/// A set, and for each way up the directions that a fixed axis of a machine within `limits` leaves, which no set meets by chance. Its text
/// names them, and cannot be read again.
#[must_use]
pub fn with_fixed_axes(set: OrientationSet, ways: &[DVec3], limits: &Limits) -> OrientationSet {
    let own = limits.own_directions();
    let around = ways.iter().flat_map(|&up| {
        let back = DQuat::from_rotation_arc(up, DVec3::Z).inverse();
        own.iter().filter_map(move |own| Orientation::from_direction(back * own.direction()))
    });
    let orientations = joined(&[&set.orientations, &around.collect::<Vec<_>>()]);
    match orientations.len() == set.len() {
        true => set,
        false => {
            OrientationSet { spec: format!("{}, and {limits} around each way up", set.spec), orientations }
        }
    }
}

/// Why no set-ups can be compared.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CandidatesError {
    /// Too many.
    #[error(
        "more than {MOST} set-ups are candidates, since what this machine reaches depends on how the part is turned on its table: give \
         fewer directions"
    )]
    TooMany,
    /// No direction is of any set-up.
    #[error(
        "none of the directions is within {0} in any of {1} set-ups: give directions that the machine reaches; where an axis is fixed, those \
         at its angle"
    )]
    NoDirection(Limits, usize),
}

/// The set-ups of every way up ([`PartSetup::all`]), those first in which the part stands by itself: of set-ups that reach the same the
/// first is taken.
///
/// # Errors
/// More than can be compared; none with a direction.
pub fn candidate_setups(
    part: &Mesh,
    ways: &[DVec3],
    directions: &[Orientation],
    limits: &Limits,
    quarters: bool,
) -> Result<Vec<PartSetup>, CandidatesError> {
    let mut candidates: Vec<PartSetup> = Vec::new();
    for &up in ways {
        candidates.extend(PartSetup::all(part, up, directions, limits, quarters));
        if candidates.len() > MOST {
            return Err(CandidatesError::TooMany);
        }
    }
    if candidates.iter().all(|candidate| candidate.directions.is_empty()) {
        return Err(CandidatesError::NoDirection(*limits, candidates.len()));
    }
    candidates.sort_by_key(|candidate| !candidate.rests);
    Ok(candidates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::unit_cube;

    #[test]
    fn ways_up_are_the_axes_and_both_ways_along_the_parts_own() {
        let own = |direction: DVec3| MachiningDirection { direction, flat_area: 1.0, cylinders: 0 };
        let (leaning, almost) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(1e-4, 0.0, -1.0).normalize());
        let ways = ways_up(&[own(leaning), own(almost), own(-leaning)]);
        assert_eq!(ways, [&AXES[..], &[leaning, -leaning]].concat());
        assert_eq!(with_ways_up("0,0", &[own(DVec3::NEG_Z)]), "axes+normals+0,0");
    }

    #[test]
    fn a_part_that_stands_by_itself_comes_first_and_too_many_are_refused() {
        let directions = AXES.map(|axis| Orientation::from_direction(axis).unwrap());
        let ways = [DVec3::ONE.normalize(), DVec3::Z];
        let limits = Limits::parse("cone:0,0,1:0").unwrap();
        let found = candidate_setups(&unit_cube(), &ways, &directions, &limits, false).unwrap();
        assert_eq!(found.iter().map(|setup| setup.rests).collect::<Vec<_>>(), [true, false]);
        assert_eq!(found[0].up, DVec3::Z);
        let fixed = Limits::parse("ac:30:30:-360:360").unwrap();
        let none = candidate_setups(&unit_cube(), &ways, &directions, &fixed, false).unwrap_err().to_string();
        assert!(none.contains("ac:30:30:-360:360") && none.contains("where an axis is fixed"), "{none}");
        let axes = OrientationSet::parse("axes").unwrap();
        let own = with_fixed_axes(axes.clone(), &AXES, &fixed);
        assert!(own.spec.contains("axes, and ac:30:30:-360:360 around"), "{}", own.spec);
        assert_eq!(with_fixed_axes(axes.clone(), &AXES, &limits), axes);
        let texts = ["axes", "axes+normals+0,9", "axes+0,9", "0,9"].map(|set| with_ways_up(set, &[]));
        assert_eq!(texts, ["axes+normals", "axes+normals+0,9", "axes+normals+0,9", "axes+normals+0,9"]);
        // Not more than 5° apart around each of the six axes.
        let found = candidate_setups(&unit_cube(), &AXES, &own.orientations, &fixed, false).unwrap();
        assert!(found.len() == 6 && found.iter().all(|setup| setup.directions.len() == 73), "{found:?}");
        let many = vec![DVec3::Z; MOST + 1];
        let refused = candidate_setups(&unit_cube(), &many, &directions, &limits, false);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("20000") && refused.contains("fewer directions"), "{refused}");
    }
}
