//! Which directions a machine can give the tool: a cone, or two rotary axes with ranges.
//!
//! Convention for two rotary axes, angles in degrees, right-handed about the world's axes as the part is set up:
//! A/C: `d = R_z(C) R_x(A) ẑ = (sin C sin A, −cos C sin A, cos A)`; B/C: `d = R_z(C) R_y(B) ẑ = (cos C sin B,
//! sin C sin B, cos B)`. At 0/0 the tool stands along +z. It does not matter whether head or table turns, only how the
//! tool stands relative to the part; for a table whose angles count the other way, exchange the signs of the ranges.
//! Limits apply to directions; the roll about the tool's own axis is unrestricted.

mod turns;

use std::fmt;

use glam::{DQuat, DVec3};

use super::set::numbers;
use super::spread::{direction_orientation, fibonacci};
use super::{Orientation, OrientationSetError};

/// Angles this far outside a range still count as inside, in degrees: ends of ranges are meant to be reached.
const SLACK: f64 = 1e-7;
/// Degrees between directions along a circle that a fixed rotary axis leaves.
const STEP: f64 = 5.0;

/// The directions that a machine reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limits {
    /// Within an angle (degrees) of an axis.
    Cone {
        /// Unit vector.
        axis: DVec3,
        /// Largest angle between tool and axis.
        half_angle: f64,
    },
    /// Two rotary axes.
    Rotary {
        /// The tilting axis.
        tilting: TiltingAxis,
        /// Smallest and largest angle of A or B.
        tilt: [f64; 2],
        /// Smallest and largest angle of C.
        turn: [f64; 2],
    },
}

/// The rotary axis that tilts the tool away from +z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TiltingAxis {
    /// About x.
    A,
    /// About y.
    B,
}

impl Limits {
    /// Reads `ac:A_MIN:A_MAX:C_MIN:C_MAX`, `bc:B_MIN:B_MAX:C_MIN:C_MAX` or `cone:X,Y,Z:HALF_ANGLE`.
    ///
    /// # Errors
    /// Another form, or a number that is malformed or out of range.
    pub fn parse(text: &str) -> Result<Self, OrientationSetError> {
        let fail = |what: String| OrientationSetError::Value { spec: text.to_owned(), what };
        let angle = |text: &str| match text.trim().parse::<f64>() {
            Ok(angle) if (-3600.0..=3600.0).contains(&angle) => Ok(angle),
            _ => Err(fail(format!("'{text}' is not an angle in degrees"))),
        };
        let range = |name: &str, low: &str, high: &str| {
            let (low, high) = (angle(low)?, angle(high)?);
            if low <= high {
                Ok([low, high])
            } else {
                Err(fail(format!("{name} goes from {low} down to {high}")))
            }
        };
        match text.split(':').collect::<Vec<_>>().as_slice() {
            [axes @ ("ac" | "bc"), low, high, c0, c1] => {
                let (name, tilting) =
                    if *axes == "ac" { ("A", TiltingAxis::A) } else { ("B", TiltingAxis::B) };
                Ok(Self::Rotary { tilting, tilt: range(name, low, high)?, turn: range("C", c0, c1)? })
            }
            ["cone", axis, half_angle] => {
                let axis = numbers(axis).filter(|v| v.len() == 3);
                let axis = axis.and_then(|v| DVec3::from_slice(&v).try_normalize());
                let axis = axis.ok_or_else(|| {
                    fail("the axis must be three numbers, not all zero, such as 0,0,1".into())
                })?;
                let half_angle = angle(half_angle)?;
                if !(0.0..=180.0).contains(&half_angle) {
                    return Err(fail("the half angle must be from 0 to 180 degrees".into()));
                }
                Ok(Self::Cone { axis, half_angle })
            }
            _ => Err(OrientationSetError::Limits(text.to_owned())),
        }
    }

    /// True if the machine can turn the tool's axis along the unit vector `direction`.
    #[must_use]
    pub fn reach(&self, direction: DVec3) -> bool {
        match *self {
            Self::Cone { axis, half_angle } => {
                axis.cross(direction).length().atan2(axis.dot(direction)).to_degrees() <= half_angle + SLACK
            }
            Self::Rotary { .. } => self.angles(direction, SLACK).is_some(),
        }
    }

    /// Directions that fixed axes leave: that of a cone of half angle 0, and those that a fixed rotary axis leaves to the other one.
    pub(crate) fn own_directions(&self) -> Vec<Orientation> {
        match *self {
            Self::Cone { half_angle, .. } if half_angle <= SLACK => self.cone(1),
            Self::Cone { .. } => Vec::new(),
            Self::Rotary { tilt, turn, .. } => {
                let [tilts, turns] = [tilt, turn].map(|[low, high]| high - low);
                // Enough that none is farther than half a step from one of them; a whole turn at most.
                let steps =
                    |span: f64| if span <= SLACK { 1 } else { (span.min(360.0) / STEP).ceil() as usize + 1 };
                if tilts.min(turns) <= SLACK {
                    self.directions(steps(tilts), steps(turns))
                } else {
                    Vec::new()
                }
            }
        }
    }

    /// `n` directions over a cone: its axis, then others spread evenly.
    ///
    /// # Panics
    /// For two rotary axes, and for none.
    pub(super) fn cone(&self, n: usize) -> Vec<Orientation> {
        let Self::Cone { axis, half_angle } = *self else { panic!("a cone") };
        let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
        let lowest = half_angle.to_radians().cos();
        let around = fibonacci(n - 1, lowest).map(|direction| turn * direction);
        std::iter::once(axis).chain(around).map(direction_orientation).collect()
    }

    /// `n_tilt` × `n_turn` directions evenly over the ranges, tilt outermost, ends included; where C makes a whole turn
    /// its end, which is its start, is left out. One sample stands in the middle.
    ///
    /// # Panics
    /// For a cone.
    pub(super) fn directions(&self, n_tilt: usize, n_turn: usize) -> Vec<Orientation> {
        let Self::Rotary { tilting, tilt, turn } = *self else { panic!("two rotary axes") };
        let turn = [turn[0], turn[1].min(turn[0] + 360.0)];
        let whole = turn[1] - turn[0] >= 360.0 - SLACK;
        let along = |range: [f64; 2], n: usize, i: usize, open: bool| {
            let steps = if open { n } else { n - 1 };
            if steps == 0 {
                0.5 * (range[0] + range[1])
            } else {
                range[0] + (range[1] - range[0]) * i as f64 / steps as f64
            }
        };
        let pairs = (0..n_tilt).flat_map(|i| (0..n_turn).map(move |j| (i, j)));
        pairs
            .map(|(i, j)| {
                let (tilt, turn) = (along(tilt, n_tilt, i, false), along(turn, n_turn, j, whole));
                let (sine, cosine) = tilt.to_radians().sin_cos();
                let (turn_sine, turn_cosine) = turn.to_radians().sin_cos();
                direction_orientation(match tilting {
                    TiltingAxis::A => DVec3::new(turn_sine * sine, -turn_cosine * sine, cosine),
                    TiltingAxis::B => DVec3::new(turn_cosine * sine, turn_sine * sine, cosine),
                })
            })
            .collect()
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cone { axis, half_angle } => {
                // Without the sign of a zero.
                let axis = axis + 0.0;
                write!(f, "cone:{},{},{}:{half_angle}", axis.x, axis.y, axis.z)
            }
            Self::Rotary { tilting, tilt: [a, b], turn: [c, d] } => {
                let name = match tilting {
                    TiltingAxis::A => "ac",
                    TiltingAxis::B => "bc",
                };
                let [a, b, c, d] = [a, b, c, d].map(|angle| angle + 0.0);
                write!(f, "{name}:{a}:{b}:{c}:{d}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::super::OrientationSet;
    use super::*;
    use crate::section::test_shapes::orientations;

    #[test]
    fn directions_are_the_rotation_matrices_of_the_convention() {
        for (name, tilt) in
            [("ac", DMat3::from_rotation_x as fn(f64) -> DMat3), ("bc", DMat3::from_rotation_y)]
        {
            let made = orientations(&format!("{name}:-30:120:-50:170:6:5"));
            assert_eq!(made.len(), 30);
            for (index, orientation) in made.iter().enumerate() {
                let (i, j) = ((index / 5) as f64, (index % 5) as f64);
                let (a, c) = ((-30.0 + 30.0 * i).to_radians(), (-50.0 + 55.0 * j).to_radians());
                let expected = DMat3::from_rotation_z(c) * tilt(a) * DVec3::Z;
                assert!((orientation.direction() - expected).length() < 1e-12, "{name} {index}");
            }
        }
    }

    #[test]
    fn a_whole_turn_leaves_out_its_end_and_one_sample_stands_in_the_middle() {
        let near = |o: Orientation, d: DVec3| (o.direction() - d).length() < 1e-12;
        let around = orientations("bc:90:90:-360:360:1:4");
        let expected = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
        assert!(around.len() == 4 && around.iter().zip(expected).all(|(&o, d)| near(o, d)), "{around:?}");
        let turned = DMat3::from_rotation_z(45f64.to_radians()) * DMat3::from_rotation_y(30f64.to_radians());
        let middle = orientations("bc:20:40:0:90:1:1");
        assert!(middle.len() == 1 && near(middle[0], turned * DVec3::Z), "{middle:?}");
    }

    #[test]
    fn what_the_axes_make_they_reach_and_what_lies_beyond_they_do_not() {
        for limits in ["ac:-30:120:-50:170", "bc:-10:95:20:21", "ac:5:30:350:380", "bc:-200:-170:0:90"] {
            let parsed = Limits::parse(limits).unwrap();
            assert!(
                orientations(&format!("{limits}:7:9")).iter().all(|o| parsed.reach(o.direction())),
                "{limits}"
            );
        }
        // Tilt to one side only, C within a quarter: brute force over fine angles is the definition.
        let limits = Limits::parse("ac:-20:70:0:90").unwrap();
        let fine = orientations("ac:-20:70:0:90:181:181");
        let within: Vec<_> =
            orientations("fibonacci:600").into_iter().filter(|o| limits.reach(o.direction())).collect();
        for o in &within {
            let near = fine.iter().map(|f| f.direction().angle_between(o.direction()));
            assert!(near.fold(f64::INFINITY, f64::min) < 0.7f64.to_radians(), "{o:?}");
        }
        // A quarter turn of (1 − cos 70°) + (1 − cos 20°) is 8.98 % of the sphere.
        assert!((52..=56).contains(&within.len()), "{}", within.len());
        let reached = |d: DVec3| limits.reach(d.normalize());
        assert!(
            reached(DVec3::Z) && reached(DVec3::new(0.0, -1.0, 1.0)) && reached(DVec3::new(1.0, 0.0, 1.0))
        );
        assert!(reached(DVec3::new(0.0, 0.3, 1.0)) && !reached(DVec3::new(0.0, 1.0, 1.0)));
        assert!(!reached(DVec3::NEG_Z) && !reached(DVec3::new(0.0, -1.0, 0.1)));
    }

    #[test]
    fn limits_filter_any_set_and_the_text_makes_it_again() {
        let all = OrientationSet::parse("fibonacci:400").unwrap();
        let limits = Limits::parse("ac:-30:120:-360:360").unwrap();
        let within = all.within(&limits).unwrap();
        // With C free the tilt alone decides: the fraction of the sphere with z ≥ cos 120° is 3/4.
        assert_eq!(within.len(), 300);
        assert_eq!(OrientationSet::parse(&within.spec).unwrap(), within);
        let cone = OrientationSet::parse("within:cone:0,0,-1:90@fibonacci:400").unwrap();
        assert_eq!(cone.len(), 200);
        assert!(cone.orientations.iter().all(|o| o.direction().z <= 0.0));
        // A cone that has an opening adds nothing, not its axis either.
        assert_eq!(orientations("within:cone:0,0,1:10@0,5"), [Orientation::new(0.0, 5.0)]);
        let outside = OrientationSet::parse("within:cone:0,0,1:10@0,90").unwrap_err().to_string();
        assert!(outside.contains("none of its 1 orientations is within cone:0,0,1:10"), "{outside}");
        let none = OrientationSet::parse("0,170").unwrap().within(&limits).unwrap_err().to_string();
        assert!(none.contains("none of its 1"), "{none}");
    }

    #[test]
    fn a_fixed_axis_is_found_whatever_the_set() {
        let within = |limits: &str| orientations(&format!("within:{limits}@fibonacci:225"));
        let upright = [Orientation::new(0.0, 0.0)];
        assert_eq!(within("cone:0,0,1:0"), upright);
        assert_eq!(within("ac:0:0:0:0"), upright);
        let tilted = within("cone:0,3,4:0");
        assert!(tilted.len() == 1 && tilted[0].direction().distance(DVec3::new(0.0, 0.6, 0.8)) < 1e-12);
        // A tilt that stands still leaves a circle, and C alone half of one.
        let circle = within("bc:30:30:-720:720");
        assert!(circle.len() == 73 && circle.iter().all(|o| (o.phi - 30.0).abs() < 1e-9), "{circle:?}");
        assert_eq!(within("bc:-90:90:40:40").len(), 37);
        // Directions that are named are those that are asked.
        let named = orientations("within:bc:30:30:-720:720@0,0;40,30;80,30");
        assert_eq!(named, [Orientation::new(40.0, 30.0), Orientation::new(80.0, 30.0)]);
        assert_eq!(Limits::parse("ac:-0:-0:-0:5").unwrap().to_string(), "ac:0:0:0:5");
    }

    #[test]
    fn wrong_limits_are_refused_by_name() {
        for text in
            ["ac:0:10", "ac:10:0:0:1", "bc:0:x:0:1", "cone:0,0,0:5", "cone:0,0,1:-5", "", "ab:0:1:0:1"]
        {
            assert!(Limits::parse(text).is_err(), "{text}");
        }
        for text in [
            "ac:0:10:0:10:0:4",
            "ac:0:10:0:10:99999:99999",
            "within:ac:0:1@fibonacci:9",
            "within:fibonacci:9",
        ] {
            assert!(OrientationSet::parse(text).is_err(), "{text}");
        }
    }
}
