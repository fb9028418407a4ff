//! Whether a tool is one: what is refused before anything is counted or proven with it.

use super::profile::meets;
use super::{ElementKind, LONGEST_MM, MOST_SHARP_POINTS, SharpPoints, Tool, ToolError, ToolShape};
use crate::voxelize::openings;

impl Tool {
    /// Checks that the tool has a volume, its elements stand on one another, a mesh is closed, and a machine can hold its lengths.
    ///
    /// # Errors
    /// [`ToolError::Empty`] with what is missing, [`ToolError::Outline`], [`ToolError::Open`], [`ToolError::SharpPoints`],
    /// [`ToolError::TooLong`].
    pub fn check(&self) -> Result<(), ToolError> {
        let empty = |what: &str| ToolError::Empty { name: self.name.clone(), what: what.into() };
        match &self.shape {
            ToolShape::Revolved(elements) if elements.is_empty() => return Err(empty("it has no element")),
            ToolShape::Mesh(mesh) if mesh.triangles.is_empty() => {
                return Err(empty("its mesh has no triangle"));
            }
            _ => {}
        }
        if let Some(what) = self.outline_fault() {
            return Err(ToolError::Outline { name: self.name.clone(), what });
        }
        let volume = self.volume();
        if !(volume.is_finite() && volume > 0.0) {
            return Err(empty(&format!("its volume is {volume}")));
        }
        if let SharpPoints::Cutter(count) = self.sharp_points
            && count > MOST_SHARP_POINTS
        {
            return Err(ToolError::SharpPoints { name: self.name.clone(), count });
        }
        let (name, unit) = (self.name.clone(), self.unit);
        let length = self.reach();
        if length * unit.in_mm() > LONGEST_MM {
            return Err(ToolError::TooLong { name, length, unit });
        }
        match self.mesh().and_then(openings) {
            Some(boundary_edges) => Err(ToolError::Open { name, boundary_edges }),
            None => Ok(()),
        }
    }

    /// What is wrong with the outline, if anything: everything else takes its pieces for stacked, and would see nothing in a gap.
    fn outline_fault(&self) -> Option<String> {
        let mut below: Option<(ElementKind, f64)> = None;
        for element in self.elements() {
            let kind = element.kind;
            if !element.has_radii() {
                return Some(format!("a radius of its {kind} is below 0 or not finite"));
            }
            if !element.runs_upwards() {
                return Some(format!("the outline of its {kind} does not run upwards without gaps"));
            }
            let (Some(first), Some(last)) = (element.profile.first(), element.profile.last()) else {
                return Some(format!("its {kind} has no outline"));
            };
            let from = first.range().0;
            if last.range().1 <= from {
                return Some(format!("its {kind} has no height"));
            }
            if let Some((other, end)) = below.filter(|&(_, end)| !meets(end, from)) {
                return Some(format!(
                    "its {kind} begins at {from}, where its {other} ends at {end}; let each element begin where the one below it ends"
                ));
            }
            below = Some((kind, last.range().1));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::revolved;
    use crate::tool::Segment;

    #[test]
    fn tools_without_volume_are_refused() {
        let none = Tool { shape: ToolShape::Revolved(vec![]), ..Tool::paper() };
        assert!(none.check().unwrap_err().to_string().contains("no element"));
        assert!(Tool::paper().check().is_ok());
        let stacked = |elements: &[(ElementKind, Segment)]| {
            revolved(elements.iter().map(|&(kind, segment)| (kind, vec![segment]))).check()
        };
        let (cutter, holder) = (ElementKind::Cutter, ElementKind::Holder(0));
        let tip = (cutter, Segment::cylinder(0.0, 10.0, 3.0));
        // Equal up to rounding, as sums of lengths are.
        assert_eq!(stacked(&[tip, (holder, Segment::cylinder(10.0 + 1e-9, 60.0, 9.0))]), Ok(()));
        let faults = [
            (
                vec![tip, (holder, Segment::cylinder(40.0, 60.0, 9.0))],
                "holder 1 begins at 40, where its cutter ends at 10",
            ),
            (vec![tip, (holder, Segment::cylinder(9.0, 60.0, 9.0))], "holder 1 begins at 9,"),
            (vec![(cutter, Segment::cylinder(0.0, 10.0, -3.0))], "radius of its cutter"),
            (vec![tip, (holder, Segment::cylinder(10.0, 60.0, f64::NAN))], "radius of its holder 1"),
            (vec![(cutter, Segment::ball_end(-1.0))], "radius of its cutter"),
        ];
        for (elements, said) in faults {
            let text = stacked(&elements).unwrap_err().to_string();
            assert!(text.contains(said), "{text}");
        }
        // A stick-out of 4e9 mm.
        let far = revolved([
            (ElementKind::Cutter, vec![Segment::cylinder(0.0, 9.0, 3.0)]),
            (ElementKind::Shank, vec![Segment::cylinder(9.0, 4e9, 2.0)]),
        ]);
        let text = far.check().unwrap_err().to_string();
        assert!(text.contains("4e9 mm") && text.contains("stick-out"), "{text}");
        assert_eq!(far.thinnest(), ("shank".into(), 4.0));
    }
}
