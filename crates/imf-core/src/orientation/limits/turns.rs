//! What a turn of the part about +z does: the turns with which a direction is reached, and the rotary angles that reach it.

use glam::DVec3;

use super::{Limits, SLACK, TiltingAxis};

/// A direction this near to +z or −z has no longitude: no machine tilts so little, and printed directions have no more digits.
const FLAT: f64 = 2e-6;
/// All turns.
const WHOLE: [f64; 2] = [0.0, 360.0];

impl Limits {
    /// The turns of the part about +z, in degrees, with which the machine reaches a direction that is now along the unit vector
    /// `direction`: ranges that begin in [0, 360), [0, 360] for all.
    #[must_use]
    pub fn turns(&self, direction: DVec3) -> Vec<[f64; 2]> {
        let range = |from: f64, to: f64| {
            let first = from.rem_euclid(360.0);
            // Rounding may take a small negative angle to 360.
            let first = if first < 360.0 { first } else { 0.0 };
            [first, first + (to - from)]
        };
        match *self {
            Self::Cone { axis, half_angle } => {
                let flats = [axis, direction].map(|d| d.x.hypot(d.y));
                let across = flats[0] * flats[1];
                if flats[0].min(flats[1]) < FLAT {
                    return if self.reach(direction) { vec![WHOLE] } else { Vec::new() };
                }
                let within = |angle: f64| (angle.to_radians().cos() - axis.z * direction.z) / across;
                let [cosine, widest] = [half_angle, (half_angle + SLACK).min(180.0)].map(within);
                if widest <= -1.0 || half_angle >= 180.0 {
                    vec![WHOLE]
                } else if widest > 1.0 {
                    Vec::new()
                } else {
                    let [here, there] = [axis, direction].map(|d| d.y.atan2(d.x).to_degrees());
                    let half = cosine.clamp(-1.0, 1.0).acos().to_degrees();
                    vec![range(here - there - half, here - there + half)]
                }
            }
            Self::Rotary { tilting, tilt, turn } => {
                let reached = branches(tilting, direction).into_iter();
                let reached = reached.filter(|[angle, _]| nearest(tilt, *angle, SLACK).is_some());
                let whole = direction.x.hypot(direction.y) < FLAT || turn[1] - turn[0] >= 360.0 - SLACK;
                let turns = reached.map(|[_, azimuth]| match whole {
                    true => WHOLE,
                    false => range(turn[0] - azimuth, turn[1] - azimuth),
                });
                let turns: Vec<[f64; 2]> = turns.collect();
                if turns.contains(&WHOLE) { vec![WHOLE] } else { turns }
            }
        }
    }

    /// Angles of A or B and of C that turn the tool along the unit vector `direction`: the smallest tilt, then the C
    /// nearest to 0. `None` where the machine has no rotary axes, or does not reach the direction to `slack` degrees.
    #[must_use]
    pub fn angles(&self, direction: DVec3, slack: f64) -> Option<[f64; 2]> {
        let Self::Rotary { tilting, tilt, turn } = *self else { return None };
        let flat = direction.x.hypot(direction.y);
        let angles = branches(tilting, direction).into_iter().filter_map(|[angle, azimuth]| {
            let tilted = nearest(tilt, angle, slack)?;
            let turned =
                if flat < FLAT { 0f64.clamp(turn[0], turn[1]) } else { nearest(turn, azimuth, slack)? };
            Some([tilted, turned])
        });
        angles.min_by(|a, b| a[0].abs().total_cmp(&b[0].abs()).then(a[1].abs().total_cmp(&b[1].abs())))
    }
}

/// Angles of A or B and of C, to either side, that turn the tool along a direction.
fn branches(tilting: TiltingAxis, direction: DVec3) -> [[f64; 2]; 2] {
    let tilted = direction.x.hypot(direction.y).atan2(direction.z).to_degrees();
    let longitude = direction.y.atan2(direction.x).to_degrees();
    // A positive A tilts towards −y, a positive B towards +x; a negative angle to the other side.
    let ahead = match tilting {
        TiltingAxis::A => longitude + 90.0,
        TiltingAxis::B => longitude,
    };
    [[tilted, ahead], [-tilted, ahead + 180.0]]
}

/// Of an angle and whole turns the one nearest to 0 within a range.
fn nearest(range: [f64; 2], angle: f64, slack: f64) -> Option<f64> {
    let first = ((range[0] - slack - angle) / 360.0).ceil();
    let last = ((range[1] + slack - angle) / 360.0).floor();
    let turns = (-angle / 360.0).round();
    (first <= last).then(|| (angle + 360.0 * turns.clamp(first, last)).clamp(range[0], range[1]))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::orientation::Orientation;
    use crate::section::test_shapes::orientations;

    #[test]
    fn turns_are_those_with_which_the_direction_is_reached() {
        for text in [
            "ac:-30:120:-50:170",
            "bc:-90:20:20:60",
            "ac:0:90:-360:360",
            "bc:30:30:10:10",
            "cone:1,0,0.2:25",
            "cone:0,0,1:30",
            "cone:1,0,0:170",
        ] {
            let limits = Limits::parse(text).unwrap();
            let mut partial = 0;
            for direction in orientations("axes+20,30+fibonacci:200").iter().map(Orientation::direction) {
                let turns = limits.turns(direction);
                partial += usize::from(turns.iter().any(|turn| *turn != WHOLE));
                for degrees in (0..720).map(|half| 0.5 * f64::from(half) + 0.1) {
                    let turned = (DQuat::from_rotation_z(degrees.to_radians()) * direction).normalize();
                    let held = turns.iter().any(|&[from, to]| {
                        [0.0, 360.0].into_iter().any(|whole| (from..=to).contains(&(degrees + whole)))
                    });
                    assert_eq!(held, limits.reach(turned), "{text} {direction} {degrees} {turns:?}");
                }
            }
            let depends = !text.contains("-360") && text != "cone:0,0,1:30";
            assert_eq!(partial > 0, depends, "{text}");
        }
    }

    #[test]
    fn angles_turn_the_tool_along_the_direction() {
        for text in ["ac:-30:120:-50:170", "bc:-90:20:20:360", "ac:0:90:-720:-300"] {
            let limits = Limits::parse(text).unwrap();
            let Limits::Rotary { tilting, tilt, turn } = limits else { panic!() };
            // The first whole turn from the range's beginning on.
            let holds = |range: [f64; 2], angle: f64| {
                let first = ((range[0] - SLACK - angle) / 360.0).ceil();
                angle + 360.0 * first <= range[1] + SLACK
            };
            let by_definition = |direction: DVec3| {
                let flat = direction.x.hypot(direction.y) < FLAT;
                let held = |[a, c]: [f64; 2]| holds(tilt, a) && (flat || holds(turn, c));
                branches(tilting, direction).into_iter().any(held)
            };
            for direction in orientations("axes+fibonacci:300").iter().map(Orientation::direction) {
                let angles = limits.angles(direction, SLACK);
                assert_eq!(angles.is_some(), limits.reach(direction), "{text} {direction}");
                assert_eq!(angles.is_some(), by_definition(direction), "{text} {direction}");
                let Some([a, c]) = angles else { continue };
                assert!((tilt[0]..=tilt[1]).contains(&a) && (turn[0]..=turn[1]).contains(&c));
                let tilted = match tilting {
                    TiltingAxis::A => DQuat::from_rotation_x(a.to_radians()),
                    TiltingAxis::B => DQuat::from_rotation_y(a.to_radians()),
                };
                let reached = DQuat::from_rotation_z(c.to_radians()) * tilted * DVec3::Z;
                assert!(reached.distance(direction) < 1e-8, "{text} {direction} {a} {c}");
            }
        }
        // Both ways round reach it: the lesser tilt, and of C what is nearest to 0.
        let limits = Limits::parse("bc:-120:120:-360:360").unwrap();
        let [b, c] = limits.angles(DVec3::new(-0.6, 0.0, 0.8), SLACK).unwrap();
        assert!((b + 36.869_897_645_844_02).abs() < 1e-9 && c.abs() < 1e-9, "{b} {c}");
        assert_eq!(Limits::parse("cone:0,0,1:10").unwrap().angles(DVec3::Z, SLACK), None);
        // Straight up but for the digits that are printed, whatever C is.
        let quarter = Limits::parse("ac:0:90:0:90").unwrap();
        let printed = DVec3::new(7e-7, 7e-7, 1.0).normalize();
        assert_eq!(quarter.angles(printed, SLACK).unwrap()[1], 0.0);
        assert_eq!(quarter.turns(printed), [WHOLE]);
        assert_eq!(quarter.angles(DVec3::new(1e-3, 1e-3, 1.0).normalize(), SLACK), None);
    }
}
