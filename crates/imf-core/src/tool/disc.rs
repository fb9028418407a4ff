//! Thin discs of a tool: a slitting saw, a key cutter, a flange.

use super::{Element, Segment, Tool, ToolShape};

/// Heights that are looked at along a segment.
const ALONG: u32 = 16;

impl Tool {
    /// The thinnest disc of the tool that stands out by more than `out` on both sides: the name of its element, and for how long along
    /// the axis the tool is so wide. `None` where there is none, and of a mesh.
    pub(crate) fn thinnest_disc(&self, out: f64) -> Option<(String, f64)> {
        let ToolShape::Revolved(elements) = &self.shape else { return None };
        let heights = |segment: &Segment| {
            let (from, to) = segment.range();
            let at = |step: u32| from + (to - from) * f64::from(step) / f64::from(ALONG);
            (0..=ALONG).map(|step| (at(step), segment.radius(at(step)))).collect::<Vec<_>>()
        };
        let of = |element: &Element| {
            let all: Vec<(f64, f64)> = element.profile.iter().flat_map(heights).collect();
            all.into_iter().map(|(height, radius)| (height, radius, element.kind)).collect::<Vec<_>>()
        };
        let mut outline: Vec<_> = elements.iter().flat_map(of).collect();
        outline.sort_by(|a, b| a.0.total_cmp(&b.0));
        let length = |peak: usize| {
            let is_wide = |&&(_, radius, _): &&(f64, f64, _)| radius > outline[peak].1 - out;
            let below = outline[..peak].iter().rev().take_while(is_wide).last();
            let above = outline[peak..].iter().take_while(is_wide).last();
            above.map_or(0.0, |last| last.0) - below.map_or(outline[peak].0, |first| first.0)
        };
        let peaks = (0..outline.len()).filter(|&peak| outline[peak].1 > out);
        let discs = peaks.map(|peak| (outline[peak].2.to_string(), length(peak)));
        discs.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ElementKind, SharpPoints};
    use super::*;
    use crate::unit::LengthUnit;

    fn tool(parts: &[(ElementKind, [f64; 4])]) -> Tool {
        let line = |[from, to, a, b]: [f64; 4]| Segment::Line { from, to, radius_from: a, radius_to: b };
        let elements =
            parts.iter().map(|&(kind, part)| Element { kind, profile: vec![line(part)] }).collect();
        Tool {
            name: "t".into(),
            unit: LengthUnit::Mm,
            shape: ToolShape::Revolved(elements),
            sharp_points: SharpPoints::Tip,
            overall_length: None,
        }
    }

    #[test]
    fn a_saw_is_as_thin_as_its_disc_and_a_mill_as_long_as_it_is() {
        use ElementKind::{Cutter, Holder, Shank};
        let saw = tool(&[(Cutter, [0.0, 1.0, 30.0, 30.0]), (Shank, [1.0, 60.0, 6.0, 6.0])]);
        assert_eq!(saw.thinnest_disc(2.0), Some(("cutter".into(), 1.0)));
        // A disc that hardly stands out is none, nor is one whose neighbours are as wide.
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
        assert!(thin > 0.4 && thin <= 0.8, "{thin}");
        assert_eq!(Tool::paper().thinnest_disc(2.0).unwrap().1, 48.0);
    }
}
