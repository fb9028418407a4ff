//! Thin discs of a tool: a slitting saw, a key cutter, a flange.

use super::{ElementKind, Segment, Tool};

/// Sampled heights along a segment.
const ALONG: u32 = 16;
/// Halvings of the step between two of them.
const HALVINGS: u32 = 40;

/// A point of the outline: its height and radius, its element, and its segment's number.
struct Spot<'a> {
    height: f64,
    radius: f64,
    kind: ElementKind,
    segment: (usize, &'a Segment),
}

impl Tool {
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
        let one = 1e-9 * self.length();
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
            let (mut wide, mut thin) = (here.height, next.height);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (wide + thin);
                *(if here.segment.1.radius(middle) > level { &mut wide } else { &mut thin }) = middle;
            }
            return wide;
        }
        at = at.saturating_add_signed(step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{line, revolved};
    use crate::unit::LengthUnit;

    fn tool(parts: &[(ElementKind, [f64; 4])]) -> Tool {
        revolved(parts.iter().map(|&(kind, [from, to, a, b])| (kind, vec![line(from, to, a, b)])))
    }

    #[test]
    fn a_saw_is_as_thin_as_its_disc_and_a_mill_as_long_as_it_is() {
        use ElementKind::{Cutter, Holder, Shank};
        let saw = tool(&[(Cutter, [0.0, 1.0, 30.0, 30.0]), (Shank, [1.0, 60.0, 6.0, 6.0])]);
        assert_eq!(saw.thinnest_disc(2.0), Some(("cutter".into(), 1.0)));
        // A disc that hardly stands out does not count, nor does one whose neighbours are as wide.
        let low = tool(&[(Cutter, [0.0, 1.0, 7.0, 7.0]), (Shank, [1.0, 60.0, 6.0, 6.0])]);
        assert_eq!(low.thinnest_disc(2.0).unwrap().1, 60.0);
        assert_eq!(low.thinnest_disc(0.5).unwrap().1, 1.0);
        let flange = [
            (Shank, [0.0, 40.0, 6.0, 6.0]),
            (Holder(0), [40.0, 43.0, 20.0, 20.0]),
            (Holder(1), [43.0, 80.0, 15.0, 15.0]),
        ];
        assert_eq!(tool(&flange).thinnest_disc(2.0), Some(("holder 1".into(), 3.0)));
        // A tapered rim, where it is 2 below the rim's radius of 20.
        let rim = tool(&[
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
            let mill = tool(&[
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
            let sink = tool(&[(Cutter, [0.0, height, 0.0, 10.0]), (Shank, [height, 60.0, 5.0, 5.0])]);
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
