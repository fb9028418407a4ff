//! How far a tool sticks out of its holder, and the same tool at another length.
//!
//! The stick-out is the distance from the tip to the holder's lower face. A holder slides on the plain cylinder that its face
//! is on: farther out the shank goes on with that radius (the cutter's own, where there is no shank), farther in the holder
//! stops where that cylinder ends, so that it never grips flutes, necks or cones.

use super::{Element, ElementKind, Segment, Tool, ToolShape};

impl Tool {
    /// From the tip to the holder's lower face; `None` without a holder, and of a mesh.
    #[must_use]
    pub fn stick_out(&self) -> Option<f64> {
        let holder = self.elements().iter().find(|e| matches!(e.kind, ElementKind::Holder(_)))?;
        Some(holder.profile.first()?.range().0)
    }

    /// The minimum stick-out that the tool can be set to: to the lower end of the plain cylinder that the holder is
    /// on. `None` as of [`Tool::stick_out`].
    #[must_use]
    pub fn shortest_stick_out(&self) -> Option<f64> {
        let mut shortest = self.stick_out()?;
        let shank = self.elements().iter().filter(|e| e.kind == ElementKind::Shank).flat_map(|e| &e.profile);
        let mut gripped = None;
        for segment in shank.collect::<Vec<_>>().into_iter().rev() {
            let Segment::Line { from, to, radius_from, radius_to } = *segment else { break };
            if radius_from != radius_to || to != shortest || gripped.is_some_and(|r| r != radius_to) {
                break;
            }
            (shortest, gripped) = (from, Some(radius_to));
        }
        Some(shortest)
    }

    /// The same tool, its holder's lower face at `length` from the tip. `None` as of [`Tool::stick_out`], for less than
    /// [`Tool::shortest_stick_out`], and for more than the overall length where that is known.
    #[must_use]
    pub fn with_stick_out(&self, length: f64) -> Option<Self> {
        let (face, shortest) = (self.stick_out()?, self.shortest_stick_out()?);
        if !(shortest..=self.overall_length.unwrap_or(f64::MAX)).contains(&length) {
            return None;
        }
        let (elements, is_holder) =
            (self.elements(), |e: &&Element| matches!(e.kind, ElementKind::Holder(_)));
        let mut set: Vec<Element> = elements.iter().filter(|e| !is_holder(e)).cloned().collect();
        for shank in set.iter_mut().filter(|e| e.kind == ElementKind::Shank) {
            shank.profile = shank.profile.iter().filter_map(|segment| segment.below(length)).collect();
        }
        set.retain(|element| !element.profile.is_empty());
        if let Some(segment) = self.extension(face, length) {
            match set.last_mut().filter(|e| e.kind == ElementKind::Shank) {
                Some(shank) => shank.profile.push(segment),
                None => set.push(Element { kind: ElementKind::Shank, profile: vec![segment] }),
            }
        }
        set.extend(elements.iter().filter(is_holder).map(|e| e.raised(length - face)));
        Some(Self { shape: ToolShape::Revolved(set), ..self.clone() })
    }

    /// The plain cylinder on which the holder slides, between two heights; `None` where the first is not below the second.
    pub(crate) fn extension(&self, from: f64, to: f64) -> Option<Segment> {
        let face = self.stick_out()?;
        let below = self.elements().iter().rfind(|e| !matches!(e.kind, ElementKind::Holder(_)))?;
        let radius = below.profile.last()?.radius(face);
        (from < to).then_some(Segment::cylinder(from, to, radius))
    }

    /// Holder alone, its lower face at height 0; `None` as of [`Tool::stick_out`].
    pub(crate) fn holder(&self) -> Option<Self> {
        let face = self.stick_out()?;
        let holder = self.elements().iter().filter(|e| matches!(e.kind, ElementKind::Holder(_)));
        let shape = ToolShape::Revolved(holder.map(|e| e.raised(-face)).collect());
        Some(Self { shape, ..self.with_tip_only() })
    }

    /// Without its holder, sharp where the whole tool is; a mesh has none.
    pub(crate) fn without_holder(&self) -> Self {
        let ToolShape::Revolved(elements) = &self.shape else { return self.clone() };
        let rest = elements.iter().filter(|e| !matches!(e.kind, ElementKind::Holder(_))).cloned();
        Self { shape: ToolShape::Revolved(rest.collect()), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{line, revolved};

    /// A cutter of 20 with a neck of 5 and a shank up to `face`, and a holder of 30.
    fn necked(face: f64) -> Tool {
        let shank = vec![line(20.0, 25.0, 2.0, 3.0), line(25.0, 32.0, 3.0, 3.0), line(32.0, face, 3.0, 3.0)];
        let tool = revolved([
            (ElementKind::Cutter, vec![line(0.0, 20.0, 2.5, 2.5)]),
            (ElementKind::Shank, shank),
            (ElementKind::Holder(0), vec![line(face, face + 30.0, 8.0, 12.0)]),
        ]);
        Tool { overall_length: Some(60.0), ..tool }
    }

    #[test]
    fn a_tool_set_to_another_length_is_the_tool_made_so() {
        let tool = necked(40.0);
        assert_eq!((tool.stick_out(), tool.shortest_stick_out()), (Some(40.0), Some(25.0)));
        let inside = |tool: &Tool, height: f64| {
            let mut radii = tool.elements().iter().map(|element| (element.kind, element.radius_at(height)));
            radii.find(|(_, radius)| *radius > 0.0)
        };
        for length in [34.0, 40.0, 55.0] {
            let (set, made) = (tool.with_stick_out(length).unwrap(), necked(length));
            assert_eq!(set.stick_out(), Some(length));
            for step in 0..950 {
                let height = 0.1 * f64::from(step) + 0.05;
                assert_eq!(inside(&set, height), inside(&made, height), "{length} {height}");
            }
            // And back.
            let back = set.with_stick_out(40.0).unwrap();
            assert_eq!((back.length(), back.volume()), (tool.length(), tool.volume()));
        }
        let shortest = tool.with_stick_out(25.0).unwrap();
        assert_eq!((shortest.length(), shortest.shortest_stick_out()), (55.0, Some(25.0)));
        // Onto the neck, and out of the holder.
        assert!(tool.with_stick_out(24.9).is_none() && tool.with_stick_out(60.1).is_none());
    }

    #[test]
    fn without_a_shank_the_cutters_own_radius_goes_on() {
        let paper = Tool::paper();
        assert_eq!(paper.shortest_stick_out(), Some(35.0));
        let long = paper.with_stick_out(50.0).unwrap();
        let [_, shank, holder] = long.elements() else { panic!() };
        assert_eq!((shank.kind, &shank.profile), (ElementKind::Shank, &vec![line(35.0, 50.0, 5.0, 5.0)]));
        assert_eq!(holder.profile[0].range(), (50.0, 98.0));
        let bare = paper.without_holder();
        assert_eq!((bare.stick_out(), bare.with_stick_out(50.0), bare.length()), (None, None, 35.0));
    }
}
