//! What is thin of a tool, and passes between voxels' centres: a needle until it is deep enough to be wide, and discs such as a slitting
//! saw, a key cutter, a flange.

use super::{Element, ElementKind, Segment, Tool, ToolShape};

/// Steps towards the height at which a ball fits; each leaves less of the way by a factor.
const STEPS: usize = 4096;

/// Halvings in which a radius or a height is found.
const HALVINGS: usize = 40;

/// A tip that holds a ball within this many of its diameters is not slender.
const DIAMETERS: f64 = 3.0;

/// Sampled heights along a segment.
const ALONG: u32 = 16;

/// A point of the outline: its height and radius, its element, and its segment's number.
struct Spot<'a> {
    height: f64,
    radius: f64,
    kind: ElementKind,
    segment: (usize, &'a Segment),
}

impl Tool {
    /// How deep the tip must stand in a solid, upright, until the overlap holds a ball of a radius; `None` where the tool holds none on
    /// its axis, and of a mesh.
    pub(crate) fn tip_depth(&self, radius: f64) -> Option<f64> {
        let ToolShape::Revolved(_) = &self.shape else { return None };
        let profile = self.segments().copied().collect();
        let whole = Element { kind: ElementKind::Cutter, profile };
        let length = self.length();
        // No nearer surface comes sooner than by the way to it.
        let mut centre = 0.0;
        for _ in 0..STEPS {
            let missing = radius - whole.depth(centre, 0.0, true);
            if missing <= 1e-9 * radius {
                return Some(centre + radius);
            }
            centre += missing;
            if centre > length {
                return None;
            }
        }
        None
    }

    /// Whether the tip holds a ball of a diameter within three diameters from its end.
    pub(crate) fn is_thick_at_tip(&self, diameter: f64) -> bool {
        self.tip_depth(0.5 * diameter).is_some_and(|depth| depth <= DIAMETERS * diameter)
    }

    /// The diameter of the largest ball that a slender tip holds within three diameters from its end, which is its
    /// effective thickness; `None` for other tips, and for those as slender at every size, such as sharp cones.
    #[must_use]
    pub fn slender_tip(&self) -> Option<f64> {
        // The largest radius up to one that something holds of.
        let largest = |most: f64, holds: &dyn Fn(f64) -> bool| {
            if holds(most) { most } else { last_held(0.0, most, holds) }
        };
        let in_tool = largest(0.5 * self.thinnest().1, &|radius| self.tip_depth(radius).is_some());
        let is_near = |radius: f64| self.is_thick_at_tip(2.0 * radius);
        let near = largest(in_tool, &is_near);
        (near < in_tool && is_near(1e-3 * in_tool)).then_some(2.0 * near)
    }

    /// The thinnest disc of the tool that stands out by more than `out` on both sides: the name of its element, and for how long along
    /// the axis the tool is wider than that. `None` where there is none, and of a mesh.
    pub(crate) fn thinnest_disc(&self, out: f64) -> Option<(String, f64)> {
        let elements = self.elements().iter();
        let segments = elements.flat_map(|element| element.profile.iter().map(|own| (element.kind, own)));
        let spots = segments.enumerate().flat_map(|(number, (kind, segment))| {
            let (from, to) = segment.range();
            (0..=ALONG).map(move |step| {
                // The end as it is: it may be where the next segment begins.
                let part = f64::from(step) / f64::from(ALONG);
                let height = if step == ALONG { to } else { from + (to - from) * part };
                Spot { height, radius: segment.radius(height), kind, segment: (number, segment) }
            })
        });
        let mut outline: Vec<Spot<'_>> = spots.collect();
        // Heights that are equal up to rounding are one, at which segments stand in their order.
        let one = 1e-9 * self.reach();
        let level = |spot: &Spot<'_>| (spot.height / one).round();
        outline.sort_by(|a, b| {
            let segments = level(a).total_cmp(&level(b)).then(a.segment.0.cmp(&b.segment.0));
            segments.then(a.height.total_cmp(&b.height))
        });
        let peaks = (0..outline.len()).filter(|&peak| outline[peak].radius > out);
        let discs = peaks.map(|peak| {
            let level = outline[peak].radius - out;
            let [low, high] = [-1, 1].map(|step| end(&outline, peak, step, level));
            (outline[peak].kind.to_string(), high - low)
        });
        discs.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// The height up to which the outline is wider than `level`, from a spot on and one way.
fn end(outline: &[Spot<'_>], peak: usize, step: isize, level: f64) -> f64 {
    let mut at = peak;
    loop {
        let here = &outline[at];
        let Some(next) = at.checked_add_signed(step).and_then(|next| outline.get(next)) else {
            return here.height;
        };
        if next.radius <= level {
            // Between two segments the outline jumps.
            if next.segment.0 != here.segment.0 {
                return here.height;
            }
            return last_held(here.height, next.height, |height| here.segment.1.radius(height) > level);
        }
        at = at.saturating_add_signed(step);
    }
}

/// The last number on the way from one at which a condition holds to one at which it does not, by halving.
pub(super) fn last_held(mut held: f64, mut failed: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (held + failed);
        *(if holds(middle) { &mut held } else { &mut failed }) = middle;
    }
    held
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{line, revolved};
    use crate::unit::LengthUnit;

    fn tool(segment: Segment) -> Tool {
        revolved([(ElementKind::Cutter, vec![segment])])
    }

    #[test]
    fn flat_ends_and_balls_hold_a_ball_at_once_and_cones_as_their_angle_says() {
        let near = |found: Option<f64>, expected: f64| {
            assert!((found.unwrap() - expected).abs() < 1e-6, "{found:?} for {expected}");
        };
        near(tool(line(0.0, 20.0, 3.0, 3.0)).tip_depth(1.0), 2.0);
        near(Tool::paper().tip_depth(1.0), 2.0);
        assert_eq!(Tool::paper().slender_tip(), None);
        assert_eq!(tool(line(0.0, 20.0, 3.0, 3.0)).tip_depth(3.5), None);
        for degrees in [45.0_f64, 30.0, 15.0] {
            let (sine, tangent) = (degrees.to_radians().sin(), degrees.to_radians().tan());
            let cone = tool(line(0.0, 20.0, 0.0, 20.0 * tangent));
            near(cone.tip_depth(0.8), 0.8 * (1.0 + 1.0 / sine));
            assert_eq!(cone.slender_tip(), None);
        }
    }

    #[test]
    fn a_needle_is_as_thick_as_the_ball_that_it_holds_near_its_end() {
        // 0.5 at the tip, 5 degrees a side.
        let (sine, cosine) = 5.0_f64.to_radians().sin_cos();
        let needle = tool(line(0.0, 25.0, 0.25, 0.25 + 25.0 * sine / cosine));
        let expected = |radius: f64| (radius / cosine - 0.25) * cosine / sine + radius;
        assert!((needle.tip_depth(1.0).unwrap() - expected(1.0)).abs() < 1e-6);
        let thick = needle.slender_tip().unwrap();
        assert!((0.8..1.0).contains(&thick), "{thick}");
        assert!((expected(0.5 * thick) - 3.0 * thick).abs() < 1e-6);
        assert!(needle.is_thick_at_tip(0.999 * thick) && !needle.is_thick_at_tip(1.001 * thick));
    }

    fn stacked(parts: &[(ElementKind, [f64; 4])]) -> Tool {
        revolved(parts.iter().map(|&(kind, [from, to, a, b])| (kind, vec![line(from, to, a, b)])))
    }

    #[test]
    fn a_saw_is_as_thin_as_its_disc_and_a_mill_as_long_as_it_is() {
        use ElementKind::{Cutter, Holder, Shank};
        let saw = stacked(&[(Cutter, [0.0, 1.0, 30.0, 30.0]), (Shank, [1.0, 60.0, 6.0, 6.0])]);
        assert_eq!(saw.thinnest_disc(2.0), Some(("cutter".into(), 1.0)));
        // A disc that hardly stands out does not count, nor does one whose neighbours are as wide.
        let low = stacked(&[(Cutter, [0.0, 1.0, 7.0, 7.0]), (Shank, [1.0, 60.0, 6.0, 6.0])]);
        assert_eq!(low.thinnest_disc(2.0).unwrap().1, 60.0);
        assert_eq!(low.thinnest_disc(0.5).unwrap().1, 1.0);
        let flange = [
            (Shank, [0.0, 40.0, 6.0, 6.0]),
            (Holder(0), [40.0, 43.0, 20.0, 20.0]),
            (Holder(1), [43.0, 80.0, 15.0, 15.0]),
        ];
        assert_eq!(stacked(&flange).thinnest_disc(2.0), Some(("holder 1".into(), 3.0)));
        // A tapered rim, where it is 2 below the rim's radius of 20.
        let rim = stacked(&[
            (Cutter, [0.0, 2.0, 10.0, 20.0]),
            (Cutter, [2.0, 4.0, 20.0, 10.0]),
            (Shank, [4.0, 60.0, 6.0, 6.0]),
        ]);
        let (_, thin) = rim.thinnest_disc(2.0).unwrap();
        assert!((thin - 0.8).abs() < 1e-9, "{thin}");
        assert_eq!(Tool::paper().thinnest_disc(2.0).unwrap().1, 48.0);
    }

    #[test]
    fn no_disc_comes_of_rounding_where_elements_meet() {
        use ElementKind::{Cutter, Holder, Shank};
        for (flutes, stick_out) in (1..400).flat_map(|a| (1..40).map(move |b| (a, a + 7 * b))) {
            let [flutes, stick_out] = [flutes, stick_out].map(|tenths| 0.1 * f64::from(tenths));
            let mill = stacked(&[
                (Cutter, [0.0, flutes, 3.0, 3.0]),
                (Shank, [flutes, stick_out, 3.0, 3.0]),
                (Holder(0), [stick_out, stick_out + 40.0, 12.0, 12.0]),
            ]);
            for unit in [LengthUnit::Mm, LengthUnit::Inch] {
                let mill = mill.in_unit(unit);
                let (_, thin) = mill.thinnest_disc(1.0 / unit.in_mm()).unwrap();
                let expected = 40.0 / unit.in_mm();
                assert!((thin - expected).abs() < 1e-9, "{flutes} {stick_out} {unit}: {thin}");
            }
        }
    }

    #[test]
    fn a_countersink_is_no_disc_however_fine_the_voxels_are() {
        use ElementKind::{Cutter, Shank};
        // Half angles of 45 and 60 degrees; the shank is slimmer.
        for height in [10.0, 10.0 / 3_f64.sqrt()] {
            let sink = stacked(&[(Cutter, [0.0, height, 0.0, 10.0]), (Shank, [height, 60.0, 5.0, 5.0])]);
            for pitch in [0.01, 0.1, 0.5, 1.5] {
                let (_, thin) = sink.thinnest_disc(2.0 * pitch).unwrap();
                assert!(
                    (thin - 2.0 * pitch * height / 10.0).abs() < 1e-9 && thin > pitch,
                    "{height} {pitch}: {thin}"
                );
            }
        }
    }
}
