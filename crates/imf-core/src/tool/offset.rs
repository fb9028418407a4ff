//! The tool offset by a clearance: every point within δ of an element.
//!
//! A body of revolution offset by δ is again one: its outline is the upper envelope of the outline's lines moved out by
//! δ along their normals, its arcs with a radius larger by δ, and an arc of radius δ around every corner. These are
//! all lines and arcs, so the offset outline is exact, not an approximation; it is made larger by a billionth of δ so
//! that rounding never takes anything away.
//!
//! Offset elements overlap: the bottom of an offset holder reaches below the holder's face, over the cutter. So they are
//! bodies of their own, each with its own heights, which may begin below the tip.

pub(super) mod envelope;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Element, ElementKind, Segment, Tool, ToolShape};
use envelope::{Curve, Side, envelope};

/// Required clearance of each kind of element from the obstacle, in the unit of what takes it: a tool's own for [`Tool::offset`], a
/// scene's, a world's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clearance {
    /// Around every holder segment.
    pub holder: f64,
    /// Around the shank.
    pub shank: f64,
    /// Around the cutter; 0 where the cutter is to touch what it cuts.
    pub cutter: f64,
}

/// Why a tool cannot be offset.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ClearanceError {
    /// A clearance below zero or not finite.
    #[error("the clearance of the {0} must be a finite length of at least 0, not {1}")]
    Value(&'static str, f64),
    /// A mesh has no elements and no outline.
    #[error(
        "the tool '{0}' is a mesh: it cannot be offset by a clearance; describe it by cutter, shank and holder"
    )]
    Mesh(String),
}

impl Clearance {
    /// The same room around holder and shank, none around the cutter.
    #[must_use]
    pub fn around_holder_and_shank(clearance: f64) -> Self {
        Self { holder: clearance, shank: clearance, cutter: 0.0 }
    }

    /// The room of one kind of element.
    #[must_use]
    pub fn of(&self, kind: ElementKind) -> f64 {
        match kind {
            ElementKind::Cutter => self.cutter,
            ElementKind::Shank => self.shank,
            ElementKind::Holder(_) => self.holder,
        }
    }

    /// True where nothing is offset.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        *self == Self::default()
    }

    /// Checks every length.
    ///
    /// # Errors
    /// A length below zero or not finite.
    pub fn check(&self) -> Result<(), ClearanceError> {
        for (name, value) in [("holder", self.holder), ("shank", self.shank), ("cutter", self.cutter)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(ClearanceError::Value(name, value));
            }
        }
        Ok(())
    }
}

impl Tool {
    /// Every element offset by its clearance: bodies that overlap, in the order of the tool's elements.
    ///
    /// # Errors
    /// A mesh tool with any clearance, or a clearance that is not a length. Without clearance a mesh tool has no
    /// elements, and the list is empty.
    pub fn offset_elements(&self, clearance: &Clearance) -> Result<Vec<Element>, ClearanceError> {
        clearance.check()?;
        if self.mesh().is_some() && !clearance.is_zero() {
            return Err(ClearanceError::Mesh(self.name.clone()));
        }
        Ok(self.elements().iter().map(|e| e.offset(clearance.of(e.kind))).collect())
    }

    /// One tool that is the union of the offset elements; each piece of its outline belongs to the element that reaches
    /// farthest out there. It may begin below the tip, which stays the origin. Sharp points stay where they are; those
    /// spread over the cutter become a list of points.
    ///
    /// # Errors
    /// As [`Tool::offset_elements`].
    pub fn with_clearance(&self, clearance: &Clearance) -> Result<Self, ClearanceError> {
        if clearance.is_zero() {
            return Ok(self.clone());
        }
        let bodies = self.offset_elements(clearance)?;
        let curves: Vec<Curve> = bodies
            .iter()
            .enumerate()
            .flat_map(|(owner, body)| body.profile.iter().map(move |&segment| Curve { segment, owner }))
            .collect();
        let outline = envelope(&curves, Side::Outer);
        let elements = outline.chunk_by(|one, next| one.owner == next.owner).map(|pieces| Element {
            kind: bodies[pieces[0].owner].kind,
            profile: pieces.iter().map(|curve| curve.segment).collect(),
        });
        let (shape, sharp_points) = (ToolShape::Revolved(elements.collect()), self.inherited_sharp_points());
        Ok(Self { shape, sharp_points, ..self.clone() })
    }

    /// True where every point of another tool is one of this tool's; false of meshes.
    pub(crate) fn holds_all_of(&self, other: &Self) -> bool {
        if self.mesh().or(other.mesh()).is_some() {
            return false;
        }
        let ends = |tool: &Self| {
            let ranges = || tool.segments().map(Segment::range);
            let low = ranges().map(|range| range.0).fold(f64::INFINITY, f64::min);
            (low, ranges().map(|range| range.1).fold(f64::NEG_INFINITY, f64::max))
        };
        let (ours, theirs) = (ends(self), ends(other));
        if ours.0 > theirs.0 || ours.1 < theirs.1 {
            return false;
        }
        // Of two that are as wide the last one makes the envelope.
        let curves = [(0, other), (1, self)]
            .into_iter()
            .flat_map(|(owner, tool)| tool.segments().map(move |&segment| Curve { segment, owner }));
        envelope(&curves.collect::<Vec<_>>(), Side::Outer).iter().all(|curve| curve.owner == 1)
    }
}

impl Element {
    /// The element offset by `clearance` in every direction.
    pub(crate) fn offset(&self, clearance: f64) -> Self {
        if clearance == 0.0 {
            return self.clone();
        }
        let by = clearance * (1.0 + 1e-9);
        let mut curves = Vec::new();
        for segment in &self.profile {
            let (from, to) = segment.range();
            let corner = |height: f64| Segment::Arc {
                from: height - by,
                to: height + by,
                centre_height: height,
                centre_radius: segment.radius(height),
                arc_radius: by,
            };
            let moved = match *segment {
                Segment::Line { radius_from, radius_to, .. } => {
                    let slope = (radius_to - radius_from) / (to - from);
                    let out = by / slope.hypot(1.0);
                    Segment::Line {
                        from: from - slope * out,
                        to: to - slope * out,
                        radius_from: radius_from + out,
                        radius_to: radius_to + out,
                    }
                }
                Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                    let stretch = (arc_radius + by) / arc_radius;
                    Segment::Arc {
                        from: centre_height + (from - centre_height) * stretch,
                        to: centre_height + (to - centre_height) * stretch,
                        centre_height,
                        centre_radius,
                        arc_radius: arc_radius + by,
                    }
                }
            };
            curves.extend([corner(from), moved, corner(to)].map(|segment| Curve { segment, owner: 0 }));
        }
        Element {
            kind: self.kind,
            profile: envelope(&curves, Side::Outer).into_iter().map(|c| c.segment).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    use crate::section::test_shapes::{arc, holds, line, revolved, walk};

    fn tapered() -> Tool {
        let flank = line(1.6, 12.0, 2.959_591_794_226_542, 5.0);
        revolved([
            (ElementKind::Cutter, vec![arc(0.0, 1.6, 2.0, 1.0, 2.0), flank]),
            (ElementKind::Shank, vec![Segment::cylinder(12.0, 18.0, 2.5)]),
            (ElementKind::Holder(0), vec![line(18.0, 30.0, 9.0, 6.0)]),
        ])
    }

    fn inside(element: &Element, height: f64, radius: f64) -> bool {
        holds(&element.profile, height, radius)
    }

    #[test]
    fn offset_elements_are_the_points_within_the_clearance() {
        let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.5 };
        for tool in [Tool::paper(), tapered()] {
            let offset = tool.offset_elements(&clearance).unwrap();
            for (element, body) in tool.elements().iter().zip(&offset) {
                let delta = clearance.of(element.kind);
                let (low, high) = (body.profile[0].range().0, body.profile.last().unwrap().range().1);
                assert!((low - (element.profile[0].range().0 - delta)).abs() < 1e-6);
                for i in 0..150 {
                    for j in 0..60 {
                        let height = low - 0.3 + (high - low + 0.6) * f64::from(i) / 149.0;
                        let radius = f64::from(j) * 0.31;
                        // The walk's steps are below 0.05, so its distance is right to about a thousandth.
                        let outside = || walk(&element.profile, true, height, radius);
                        let away = if inside(element, height, radius) { 0.0 } else { outside() };
                        if away < delta - 1e-9 {
                            assert!(inside(body, height, radius), "{:?} {height} {radius}", element.kind);
                        }
                        if inside(body, height, radius) {
                            assert!(away <= delta + 2e-3, "{:?} {height} {radius} {away}", element.kind);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn outlines_have_no_gaps_and_few_pieces() {
        let clearance = Clearance { holder: 1.5, shank: 1.5, cutter: 1.5 };
        for tool in [Tool::paper(), tapered()] {
            for body in tool.offset_elements(&clearance).unwrap() {
                assert!(body.profile.len() <= 6, "{:?}", body.profile);
                for pair in body.profile.windows(2) {
                    assert!((pair[0].range().1 - pair[1].range().0).abs() < 1e-9);
                    let joint = pair[0].range().1;
                    assert!((pair[0].radius(joint) - pair[1].radius(joint)).abs() < 1e-5, "{pair:?}");
                }
            }
        }
    }

    #[test]
    fn a_tool_holds_one_that_is_nowhere_wider() {
        let of = |profile| revolved([(ElementKind::Holder(0), profile)]);
        let cone = of(vec![line(5.0, 15.0, 2.0, 6.0), line(15.0, 30.0, 6.0, 6.0)]);
        let cases = [
            (vec![line(5.0, 15.0, 2.0, 6.0), line(15.0, 30.0, 6.0, 6.0)], true),
            (vec![line(6.0, 14.0, 2.0, 5.0)], true),
            (vec![line(4.0, 14.0, 1.0, 1.0)], false),
            (vec![line(14.0, 31.0, 1.0, 1.0)], false),
            // Wider at one place alone.
            (vec![line(5.0, 15.0, 2.0, 2.0), line(15.0, 16.0, 6.5, 6.0)], false),
            (vec![line(5.0, 10.0, 2.5, 2.5)], false),
        ];
        for (profile, expected) in cases {
            let other = of(profile);
            assert_eq!(cone.holds_all_of(&other), expected, "{other:?}");
            let room = Clearance::around_holder_and_shank(0.7);
            let offset = |tool: &Tool| tool.with_clearance(&room).unwrap();
            assert_eq!(offset(&cone).holds_all_of(&offset(&other)), expected, "{other:?}");
        }
    }

    #[test]
    fn an_offset_cylinder_has_the_volume_in_closed_form() {
        let element = Element { kind: ElementKind::Shank, profile: vec![Segment::cylinder(3.0, 11.0, 4.0)] };
        let (r, h, d, pi) = (4.0, 8.0, 1.25, std::f64::consts::PI);
        // Steiner's formula: volume, surface, mean curvature, ball.
        let surface = 2.0 * pi * r * (r + h);
        let expected =
            pi * r * r * h + surface * d + (pi * pi * r + pi * h) * d * d + 4.0 / 3.0 * pi * d * d * d;
        let volume: f64 = element.offset(d).profile.iter().map(Segment::volume).sum();
        assert!((volume - expected).abs() < 1e-5 * expected, "{volume} {expected}");
    }

    #[test]
    fn the_union_holds_every_offset_element_and_nothing_else() {
        let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.5 };
        let tool = tapered();
        let bodies = tool.offset_elements(&clearance).unwrap();
        let union = tool.with_clearance(&clearance).unwrap();
        let pieces = union.elements();
        for i in 0..400 {
            for j in 0..80 {
                let (height, radius) = (-1.0 + 35.0 * f64::from(i) / 399.0, f64::from(j) * 0.17);
                let expected = bodies.iter().any(|b| inside(b, height, radius));
                assert_eq!(pieces.iter().any(|b| inside(b, height, radius)), expected, "{height} {radius}");
            }
        }
        assert_eq!(pieces[0].kind, ElementKind::Cutter);
        assert!((pieces[0].profile[0].range().0 + 0.5).abs() < 1e-6);
        assert_eq!(tool.with_clearance(&Clearance::default()).unwrap(), tool);
    }

    #[test]
    fn an_offset_tool_can_be_voxelised_below_its_tip() {
        let clearance = Clearance { holder: 1.0, shank: 1.0, cutter: 2.0 };
        let offset = Tool::paper().with_clearance(&clearance).unwrap();
        let rotated =
            super::super::ToolVoxels::new(&offset, &crate::orientation::Orientation::default(), 1.0).unwrap();
        assert_eq!(rotated.lower, [-15, -15, -2]);
        assert!((f64::from(rotated.count) / offset.volume() - 1.0).abs() < 0.02);
    }

    #[test]
    fn what_cannot_be_offset_is_refused() {
        let negative = Clearance { shank: -1.0, ..Clearance::default() };
        let error = Tool::paper().offset_elements(&negative).unwrap_err();
        assert_eq!(error, ClearanceError::Value("shank", -1.0));
        let mut mesh = crate::mesh::Mesh::default();
        mesh.vertices.push(DVec3::ZERO);
        let mesh = Tool { shape: ToolShape::Mesh(mesh), ..Tool::paper() };
        assert!(matches!(
            mesh.with_clearance(&Clearance::around_holder_and_shank(1.0)),
            Err(ClearanceError::Mesh(_))
        ));
        assert_eq!(mesh.offset_elements(&Clearance::default()).unwrap(), []);
    }
}
