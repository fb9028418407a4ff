//! Arcs and helices of G2 and G3 as chords.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

/// What a block says of an arc.
pub(super) struct Arc {
    pub(super) from: DVec3,
    pub(super) to: DVec3,
    /// Places of the plane's axes, the third one following them right-handed.
    pub(super) plane: [usize; 3],
    pub(super) clockwise: bool,
    /// From the start to the centre, where it is said.
    pub(super) centre: Option<DVec3>,
    pub(super) radius: Option<f64>,
}

/// Farthest that a chord is from its arc, in mm.
pub(super) const CHORD: f64 = 0.001;
/// Farthest that the ends of an arc differ in their distance from its centre, in mm: programs round to three or four digits.
const ROUND: f64 = 0.01;
/// More of a large arc, as controls allow: a fraction of its radius, up to so many mm.
const ROUND_OF_RADIUS: [f64; 2] = [1e-3, 0.5];
/// An angle, in radians, and a length along the arc, in mm, within which its end is its start: a few times the rounding of double precision,
/// and half of a program's last digit.
const ONE_ANGLE: f64 = 1e-6;
const ONE_PLACE: f64 = 0.000_5;
/// Chords of a whole turn of a radius of 100 m.
const MOST: f64 = 25_000.0;

/// Maximum number of chords of all arcs of a program of `bytes` bytes: at twelve bytes an arc, whole turns of a
/// radius of a third of a metre.
pub(super) fn most_chords(bytes: usize) -> usize {
    bytes.saturating_mul(100).saturating_add(100_000)
}

/// By how much radii may differ by rounding.
fn rounding(radius: f64, mm: f64) -> f64 {
    let [share, most] = ROUND_OF_RADIUS;
    (share * radius).min(most * mm).max(ROUND * mm)
}

impl Arc {
    /// The ends of its chords, its own end last, of which there may be `left` yet; `mm` is a millimetre in the unit of the path.
    pub(super) fn chords(&self, mm: f64, left: &mut usize) -> Result<Vec<DVec3>, String> {
        let [a, b, normal] = self.plane;
        let flat = |p: DVec3| DVec2::new(p[a], p[b]);
        let (from, to) = (flat(self.from), flat(self.to));
        if self.centre.is_some_and(|centre| centre[normal] != 0.0) {
            return Err(format!(
                "{} stands at right angles to the arc's plane, where some controls read it as the pitch of several turns: take it out, or \
                 choose the plane (G17, G18, G19)",
                ['I', 'J', 'K'][normal]
            ));
        }
        let centre = match (self.centre, self.radius) {
            (Some(centre), None) => from + flat(centre),
            (None, Some(radius)) => self.by_radius(from, to, radius, mm)?,
            (Some(_), Some(_)) => return Err("the arc has both a centre (I, J, K) and a radius (R)".into()),
            (None, None) => return Err("the arc has neither a centre (I, J, K) nor a radius (R)".into()),
        };
        let (start, end) = (from - centre, to - centre);
        let (first, last) = (start.length(), end.length());
        if first == 0.0 {
            return Err("the arc's centre is its start".into());
        }
        if (first - last).abs() > rounding(first.max(last), mm) {
            let [first, last] = [first, last].map(|length| (length / mm * 1e4).round() / 1e4 * mm);
            return Err(format!(
                "the arc begins {first} from its centre and ends {last} from it: check I, J, K and the plane (G17, G18, G19), or write more digits"
            ));
        }
        let turned = start.perp_dot(end).atan2(start.dot(end));
        let turned = if self.clockwise { -turned } else { turned };
        // An end at the start is a whole turn, by a centre alone; so controls read one that is rounded otherwise.
        let is_whole =
            self.radius.is_none() && turned.abs() < ONE_ANGLE && turned.abs() * first < ONE_PLACE * mm;
        let sweep = if is_whole { TAU } else { turned.rem_euclid(TAU) };
        let step = 2.0 * (1.0 - (CHORD * mm / first.max(last)).min(0.5)).acos();
        let count = (sweep / step).ceil().max(1.0);
        if count > MOST {
            return Err(format!("the arc has a radius of {first}: check the unit"));
        }
        *left = left.checked_sub(count as usize).ok_or_else(|| {
            format!("the arcs up to this one take more chords of {CHORD} mm than a program of this length may: check the unit, or split the program")
        })?;
        let angle = if self.clockwise { -sweep } else { sweep };
        let chord = |index: u64| {
            let t = index as f64 / count;
            if index as f64 >= count {
                return self.to;
            }
            let at = DVec2::from_angle(angle * t).rotate(start) * (1.0 + (last / first - 1.0) * t) + centre;
            let mut point = DVec3::ZERO;
            (point[a], point[b]) = (at.x, at.y);
            point[normal] = self.from[normal] + (self.to[normal] - self.from[normal]) * t;
            point
        };
        Ok((1..=count as u64).map(chord).collect())
    }

    /// The centre of an arc of less than half a turn, or of more where the radius is negative.
    fn by_radius(&self, from: DVec2, to: DVec2, radius: f64, mm: f64) -> Result<DVec2, String> {
        let half = 0.5 * (to - from);
        if half.length() < 1e-9 * mm {
            return Err("an arc by its radius R must end elsewhere than it begins: give its centre".into());
        }
        if half.length() > radius.abs() + rounding(radius.abs(), mm) {
            return Err(format!("the arc's ends are farther apart than twice its radius {radius}"));
        }
        let height = (radius * radius - half.length_squared()).max(0.0).sqrt();
        let left = (radius > 0.0) != self.clockwise;
        Ok(from + half + half.normalize().perp() * if left { height } else { -height })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(to: [f64; 3], plane: [usize; 3], clockwise: bool) -> Arc {
        Arc { from: DVec3::ZERO, to: DVec3::from_array(to), plane, clockwise, centre: None, radius: None }
    }

    #[test]
    fn chords_keep_to_the_circle_and_end_where_the_arc_ends() {
        let planes = [[0, 1, 2], [2, 0, 1], [1, 2, 0]];
        for plane in planes {
            let [a, b, normal] = plane;
            for clockwise in [true, false] {
                let mut to = [0.0; 3];
                (to[a], to[b], to[normal]) = (10.0, 10.0, 4.0);
                let mut centre = DVec3::ZERO;
                centre[a] = 10.0;
                let quarter = Arc { centre: Some(centre), ..arc(to, plane, clockwise) };
                let points = quarter.chords(1.0, &mut 100_000).unwrap();
                assert_eq!(points.last(), Some(&DVec3::from_array(to)));
                let mut before = quarter.from;
                let mut way = 0.0;
                for &point in &points {
                    let flat = |p: DVec3| DVec2::new(p[a] - 10.0, p[b]);
                    assert!((flat(point).length() - 10.0).abs() < 1e-9);
                    let middle = (0.5 * (flat(point) + flat(before))).length();
                    assert!((0.0..=CHORD * 1.0001).contains(&(10.0 - middle)), "{middle}");
                    way += flat(point).distance(flat(before));
                    before = point;
                }
                // From (0, 0) about (10, 0) to (10, 10): a quarter clockwise, three quarters the other way.
                let turns = if clockwise { 0.25 } else { 0.75 };
                assert!((way - TAU * 10.0 * turns).abs() < 0.02, "{way}");
                let signed = if clockwise { 10.0 } else { -10.0 };
                let by_radius = Arc { radius: Some(signed), ..arc(to, plane, clockwise) }
                    .chords(1.0, &mut 100_000)
                    .unwrap();
                assert_eq!(by_radius.len(), points.len());
                assert!((by_radius[3] - points[3]).length() < 1e-9);
            }
        }
        let whole = Arc { centre: Some(DVec3::new(0.0, 5.0, 0.0)), ..arc([0.0; 3], [0, 1, 2], true) };
        let points = whole.chords(1.0, &mut 100_000).unwrap();
        assert!(points.iter().any(|p| (p.y - 10.0).abs() < 0.01) && points.len() > 50);
        // Its end is rounded otherwise than its start; the shortest arc that a program writes is one.
        let of = |to: [f64; 3]| {
            let from = DVec3::new(0.0, 5.0, 0.0);
            let centre = Some(DVec3::new(0.0, -5.0, 0.0));
            Arc { from, centre, ..arc(to, [0, 1, 2], true) }.chords(1.0, &mut 100_000).unwrap().len()
        };
        for radial in [0.0, 1e-10, 0.001, -0.009] {
            assert_eq!(of([0.0, 5.0 + radial, 0.0]), points.len(), "{radial}");
            assert_eq!(of([1e-10, 5.0 + radial, 0.0]), points.len(), "{radial}");
        }
        assert_eq!(of([0.001, 5.0, 0.0]), 1);
        // Three digits of an inch: the radii differ by 0.0128 mm, and the points go evenly from one to the other.
        let [from, to] = [[0.866, 0.5], [-0.501, 0.866]].map(|[x, y]| DVec3::new(x, y, 0.0) * 25.4);
        let inch = Arc { from, to, centre: Some(-from), ..arc([0.0; 3], [0, 1, 2], false) };
        let points = inch.chords(1.0, &mut 100_000).unwrap();
        assert!(points.windows(2).all(|pair| pair[0].distance(pair[1]) < 0.5) && points.last() == Some(&to));
        let rough = Arc { to: to * 1.01, ..inch };
        assert!(rough.chords(1.0, &mut 100_000).unwrap_err().contains("more digits"));
    }

    #[test]
    fn arcs_that_are_none_are_refused() {
        let of = |centre: Option<DVec3>, radius: Option<f64>| {
            Arc { centre, radius, ..arc([10.0, 0.0, 0.0], [0, 1, 2], true) }
                .chords(1.0, &mut 100_000)
                .unwrap_err()
        };
        assert!(of(None, None).contains("neither"));
        assert!(of(Some(DVec3::X), Some(1.0)).contains("both"));
        assert!(of(Some(DVec3::X), None).contains("begins 1 from its centre and ends 9"));
        assert!(of(None, Some(4.0)).contains("farther apart"));
        let long = Arc { centre: Some(DVec3::X * 5e5), ..arc([0.0; 3], [0, 1, 2], true) };
        assert!(long.chords(1.0, &mut 100_000).unwrap_err().contains("radius of 500000: check the unit"));
        let many = Arc { centre: Some(DVec3::X * 500.0), ..arc([0.0; 3], [0, 1, 2], true) };
        let mut left = 2000;
        assert_eq!(many.chords(1.0, &mut left).unwrap().len(), 2000 - left);
        assert!(many.chords(1.0, &mut left).unwrap_err().contains("split the program"));
    }
}
