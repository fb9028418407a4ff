//! Contact poses: poses of a tool at which its cutter touches a point of a surface.
//!
//! At a point with outward normal n the cutter touches with that point of its outline whose own outward normal is −n: one
//! point of a ball, the rim of a flat end or, with the axis along n, any point of its bottom; the flank, at any height,
//! with the axis across n. The tip itself stands on the surface only where the outline has its tip there.

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;

use crate::mesh::Mesh;
use crate::tool::{ElementKind, Segment, SharpPoints, Tool, ToolShape};

/// Angles closer than this are one, in radians.
const SAME: f64 = 1e-9;
/// Heights of a flank at which a tool is tried that narrows upward, such as a slot cutter.
const HEIGHTS: i32 = 32;

/// An angle of an outward normal above the plane across the axis, from −90° (down, away from the holder) to 90°, by sine and
/// cosine: no angle is ever computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slope {
    pub(super) sine: f64,
    pub(super) cosine: f64,
}

impl Slope {
    const DOWN: Self = Self { sine: -1.0, cosine: 0.0 };
    const UP: Self = Self { sine: 1.0, cosine: 0.0 };

    /// Of a vector, by its parts along the axis and away from it.
    fn of(along: f64, away: f64) -> Self {
        let length = along.hypot(away);
        Self { sine: along / length, cosine: away / length }
    }

    /// Sine of the angle from another to this one.
    fn beyond(self, other: Self) -> f64 {
        self.sine * other.cosine - self.cosine * other.sine
    }

    /// True between two others, the ends included, up to rounding.
    fn is_between(self, from: Self, to: Self) -> bool {
        self.beyond(from) >= -SAME && self.beyond(to) <= SAME
    }
}

/// A piece of a cutter's outline that touches surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Piece {
    /// A level ring: the bottom, or a shoulder.
    Level { height: f64, inner: f64, outer: f64, slope: Slope },
    /// A cylinder or a cone.
    Flank { from: [f64; 2], to: [f64; 2], slope: Slope },
    /// Part of a ball or a torus: height and radius of its centre, its own radius, and the slopes of its ends. A convex edge is one
    /// of radius 0.
    Round { centre: [f64; 2], radius: f64, from: Slope, to: Slope },
}

/// The part of the outline that touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Touch {
    /// One point of the outline, on the side that faces the surface; `hangs` where a flank has a lower one that may touch there.
    Point { height: f64, radius: f64, hangs: bool },
    /// Any point of a level ring.
    Ring { height: f64, inner: f64, outer: f64 },
}

/// The outline of a tool's cutter as surfaces meet it, in the tool's unit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outline {
    pieces: Vec<Piece>,
    /// True where something above a point of the tool is narrower than the tool is there, as on a slot cutter.
    undercuts: bool,
    /// True where the cutter lies on one side of every plane that touches it.
    pub(super) convex: bool,
    /// True where the cutter's upper end sticks out beyond what stands on it.
    pub(super) shoulder: bool,
}

impl Outline {
    /// Of a tool's cutter; `None` of a mesh, and of a tool without a cutter.
    pub(super) fn of(tool: &Tool) -> Option<Self> {
        let ToolShape::Revolved(elements) = &tool.shape else { return None };
        let segments = tool.cutter()?.0.profile;
        let end = segments.last()?.range().1;
        let above = elements.iter().filter(|e| e.kind != ElementKind::Cutter).find_map(|e| e.profile.first());
        let neck = above.filter(|s| s.range().0 <= end).map_or(0.0, |s| s.radius(end));
        let mut builder = OutlineBuilder { pieces: Vec::new(), slope: Slope::DOWN, convex: true };
        let (mut height, mut radius) = (segments[0].range().0, 0.0);
        for segment in &segments {
            let (low, high) = segment.range();
            if low >= high {
                continue;
            }
            builder.step(height, [radius, segment.radius(low)]);
            let piece = piece(segment);
            let (begins, ends) = match piece {
                Piece::Flank { slope, .. } | Piece::Level { slope, .. } => (slope, slope),
                Piece::Round { from, to, .. } => (from, to),
            };
            builder.turn(begins, low, segment.radius(low));
            builder.pieces.push(piece);
            (height, radius, builder.slope) = (high, segment.radius(high), ends);
        }
        let convex = builder.convex;
        let shoulder = radius - neck > SAME * radius;
        if shoulder && tool.back_cutting {
            builder.step(height, [radius, neck]);
        }
        let all = elements.iter().flat_map(|e| &e.profile);
        let mut widest = 0.0;
        let mut undercuts = false;
        for segment in all {
            let (low, high) = segment.range();
            undercuts |= segment.radius(low).min(segment.radius(high)) < widest * (1.0 - SAME);
            widest = segment.max_radius().max(widest);
        }
        Some(Self { pieces: builder.pieces, undercuts, convex, shoulder })
    }

    /// How far from the tip the cutter touches, at most.
    pub(super) fn reach(&self) -> f64 {
        let farthest = self.pieces.iter().map(|piece| match *piece {
            Piece::Level { height, outer, .. } => height.hypot(outer),
            Piece::Flank { from, to, .. } if !self.undercuts && from[1] == to[1] => from[0].hypot(from[1]),
            Piece::Flank { from, to, .. } => from[0].hypot(from[1]).max(to[0].hypot(to[1])),
            Piece::Round { centre, radius, .. } => centre[0].hypot(centre[1]) + radius,
        });
        farthest.fold(0.0, f64::max)
    }

    /// A sine above which no surface is touched whose inward normal has it.
    pub(super) fn highest(&self, tolerance: f64) -> f64 {
        let highest = self.pieces.iter().map(|piece| match *piece {
            Piece::Level { slope, .. } if slope.sine > 0.0 => 1.0,
            // What is touched as a whole, though it is turned away by no more than the tolerance.
            Piece::Level { outer, .. } => (0.5 * tolerance / outer).min(1.0) - 1.0,
            Piece::Flank { from, to, slope } => {
                // An angle is no more than π/2 times its sine.
                slope.sine + FRAC_PI_2 * tolerance / (to[0] - from[0]).hypot(to[1] - from[1])
            }
            Piece::Round { to, .. } => to.sine,
        });
        highest.fold(-1.0, f64::max) + 2.0 * SAME
    }

    /// The places that touch a surface whose inward normal has this slope. A level ring or a flank touches as a whole where no
    /// point of it then lies deeper than `tolerance`.
    pub(super) fn touches(&self, slope: Slope, tolerance: f64, mut visit: impl FnMut(Touch)) {
        for piece in &self.pieces {
            match *piece {
                Piece::Level { height, inner, outer, slope: own } => {
                    if slope.sine * own.sine > 0.0 && 2.0 * outer * slope.beyond(own).abs() <= tolerance {
                        visit(Touch::Ring { height, inner, outer });
                    }
                }
                Piece::Flank { from, to, slope: own } => {
                    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
                    if length * slope.beyond(own).abs() <= tolerance {
                        // A tool that nowhere narrows upward obstructs least with the lower end of a cylinder at the
                        // point: moved down along it, it fills all that it filled, and more.
                        let most = if self.undercuts || from[1] != to[1] { HEIGHTS } else { 0 };
                        for step in 0..=most {
                            let at =
                                |i: usize| from[i] + (to[i] - from[i]) * f64::from(step) / f64::from(HEIGHTS);
                            visit(Touch::Point { height: at(0), radius: at(1), hangs: step > 0 });
                        }
                    }
                }
                Piece::Round { centre, radius, from, to } => {
                    if slope.is_between(from, to) {
                        visit(Touch::Point {
                            height: centre[0] + radius * slope.sine,
                            radius: (centre[1] + radius * slope.cosine).max(0.0),
                            hangs: false,
                        });
                    }
                }
            }
        }
    }
}

/// Builds the pieces of an outline from the tip upwards.
struct OutlineBuilder {
    pieces: Vec<Piece>,
    /// Where the last piece ended.
    slope: Slope,
    convex: bool,
}

impl OutlineBuilder {
    /// A level ring where the outline steps outward or inward, with the edge before it.
    fn step(&mut self, height: f64, [radius, next]: [f64; 2]) {
        if (radius - next).abs() <= SAME * radius.max(next) {
            return;
        }
        let slope = if next > radius { Slope::DOWN } else { Slope::UP };
        self.turn(slope, height, radius);
        self.pieces.push(Piece::Level { height, inner: radius.min(next), outer: radius.max(next), slope });
        self.slope = slope;
    }

    /// The edge before the next piece where it is convex; a groove where it is not.
    fn turn(&mut self, next: Slope, height: f64, radius: f64) {
        // From straight down to straight up the sine of the way is 0 too.
        let turned = if self.slope.sine * next.sine < 0.0 && self.slope.cosine + next.cosine < SAME {
            next.sine
        } else {
            next.beyond(self.slope)
        };
        self.convex &= turned >= -SAME;
        if turned > SAME {
            let centre = [height, radius];
            self.pieces.push(Piece::Round { centre, radius: 0.0, from: self.slope, to: next });
        }
    }
}

fn piece(segment: &Segment) -> Piece {
    match *segment {
        Segment::Line { from, to, radius_from, radius_to } => Piece::Flank {
            from: [from, radius_from],
            to: [to, radius_to],
            slope: Slope::of(radius_from - radius_to, to - from),
        },
        Segment::Arc { from, to, centre_height, centre_radius, arc_radius } => {
            let slope = |height: f64| {
                let sine = ((height - centre_height) / arc_radius).clamp(-1.0, 1.0);
                Slope { sine, cosine: (1.0 - sine * sine).sqrt() }
            };
            Piece::Round {
                centre: [centre_height, centre_radius],
                radius: arc_radius,
                from: slope(from),
                to: slope(to),
            }
        }
    }
}

/// Maximum distance from its tip at which a tool touches a surface, in its own unit; at contact poses it reaches
/// farther by this.
#[must_use]
pub fn contact_reach(tool: &Tool) -> f64 {
    match &tool.shape {
        ToolShape::Revolved(_) => Outline::of(tool).map_or(0.0, |outline| outline.reach()),
        ToolShape::Mesh(mesh) => touching(tool, mesh).iter().map(|point| point.length()).fold(0.0, f64::max),
    }
}

/// The points of a mesh tool that may touch: its sharp points where they are a list, else all vertices.
pub(super) fn touching<'a>(tool: &'a Tool, mesh: &'a Mesh) -> &'a [DVec3] {
    match &tool.sharp_points {
        SharpPoints::Points(points) => points,
        _ => &mesh.vertices,
    }
}

/// The frame of a contact: the axis, and the direction across it in which the surface lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactFrame {
    pub(super) axis: DVec3,
    /// Unit vector across the axis from the tool towards the surface; zero where the surface is level.
    pub(super) across: DVec3,
    /// Of the surface's inward normal.
    pub(super) slope: Slope,
}

impl ContactFrame {
    /// Of a surface with an outward unit normal, for a tool with this axis from tip to holder; `None` where the sine of the
    /// inward normal is above `highest`.
    pub(super) fn new(normal: DVec3, axis: DVec3, highest: f64) -> Option<Self> {
        let sine = -normal.dot(axis);
        if sine > highest {
            return None;
        }
        let flat = -normal - sine * axis;
        let cosine = flat.length();
        // Normals and axes are unit vectors up to rounding: below this nothing is left of the direction.
        let across = if cosine > 1e-12 { flat / cosine } else { DVec3::ZERO };
        Some(Self { axis, across, slope: Slope { sine, cosine } })
    }

    /// The tip of a tool that touches `point` with a point of its outline.
    pub(super) fn tip(&self, point: DVec3, height: f64, radius: f64) -> DVec3 {
        point - self.across * radius - self.axis * height
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{line, revolved};

    fn found(tool: &Tool, degrees: f64) -> Vec<Touch> {
        let mut found = Vec::new();
        let outline = Outline::of(tool).unwrap();
        let (sine, cosine) = degrees.to_radians().sin_cos();
        outline.touches(Slope { sine, cosine }, 0.05, |touch| found.push(touch));
        assert!(found.is_empty() || sine <= outline.highest(0.05), "{degrees}");
        found
    }

    #[test]
    fn a_ball_touches_with_the_point_of_that_normal() {
        let cutter = vec![Segment::ball_end(3.0), Segment::cylinder(3.0, 20.0, 3.0)];
        let tool = revolved([(ElementKind::Cutter, cutter)]);
        for degrees in [-90.0, -60.0, -30.0] {
            let found = found(&tool, degrees);
            let [Touch::Point { height, radius, .. }] = found[..] else { panic!("{degrees}: {found:?}") };
            let (sine, cosine) = f64::to_radians(degrees).sin_cos();
            assert!((height - 3.0 - 3.0 * sine).abs() < 1e-12 && (radius - 3.0 * cosine).abs() < 1e-12);
        }
        // The ball's equator, and the flank's lower end.
        assert_eq!(found(&tool, 0.0).len(), 2);
        assert_eq!(found(&tool, 30.0), [], "what would have to be cut from behind");
        assert!((6.0..7.3).contains(&Outline::of(&tool).unwrap().reach()));
    }

    #[test]
    fn a_flat_end_touches_with_its_bottom_its_rim_or_its_flank() {
        let flank = line(0.0, 20.0, 5.0, 5.0);
        let holder = line(20.0, 40.0, 12.0, 12.0);
        let tool = revolved([(ElementKind::Cutter, vec![flank]), (ElementKind::Holder(0), vec![holder])]);
        let bottom = Touch::Ring { height: 0.0, inner: 0.0, outer: 5.0 };
        let rim = Touch::Point { height: 0.0, radius: 5.0, hangs: false };
        assert_eq!(found(&tool, -90.0), [bottom, rim]);
        assert_eq!(found(&tool, -40.0), [rim]);
        assert_eq!(found(&tool, 0.0), [rim, rim]);
        // The holder is wider: nothing of the cutter faces up.
        assert_eq!(found(&tool, 30.0), []);
    }

    #[test]
    fn a_slot_cutter_touches_with_its_shoulder_and_a_drill_with_its_point() {
        let head = line(0.0, 4.0, 8.0, 8.0);
        let neck = line(4.0, 30.0, 3.0, 3.0);
        let wide = revolved([(ElementKind::Cutter, vec![head]), (ElementKind::Shank, vec![neck])]);
        // The back of a face mill, or of a mill with a neck, cuts nothing.
        assert_eq!((found(&wide, 90.0), found(&wide, 30.0)), (vec![], vec![]));
        assert!(Outline::of(&wide).unwrap().shoulder);
        let slotter = Tool { back_cutting: true, ..wide };
        assert_eq!(Outline::of(&slotter).unwrap().reach(), f64::hypot(4.0, 8.0));
        let shoulder = Touch::Ring { height: 4.0, inner: 3.0, outer: 8.0 };
        assert_eq!(
            found(&slotter, 90.0),
            [Touch::Point { height: 4.0, radius: 8.0, hangs: false }, shoulder]
        );
        // Its flank at all heights, and both its edges.
        assert_eq!(found(&slotter, 0.0).len(), 33 + 2);
        let drill =
            revolved([(ElementKind::Cutter, vec![line(0.0, 2.0, 0.0, 2.0), line(2.0, 9.0, 2.0, 2.0)])]);
        assert_eq!(found(&drill, -90.0), [Touch::Point { height: 0.0, radius: 0.0, hangs: false }]);
        assert_eq!(found(&drill, -45.0).len(), 33 + 2);
        assert_eq!(found(&drill, -20.0), [Touch::Point { height: 2.0, radius: 2.0, hangs: false }]);
        // With the end of its flank alone a cone machines no wall.
        let cone = revolved([(ElementKind::Cutter, vec![line(0.0, 4.0, 1.0, 3.0)])]);
        assert_eq!((found(&cone, -10.0), found(&cone, 10.0)), (vec![], vec![]));
    }

    #[test]
    fn the_touching_point_of_the_tool_lies_on_the_surface() {
        let (normal, axis) = (DVec3::new(0.3, -0.5, 0.8).normalize(), DVec3::new(-0.2, 0.1, 0.9).normalize());
        let facing = ContactFrame::new(normal, axis, 1.0).unwrap();
        let point = DVec3::new(4.0, 5.0, 6.0);
        // Of a ball the centre lies one radius outside, whatever the axis.
        let Slope { sine, cosine } = facing.slope;
        let tip = facing.tip(point, 2.0 + 2.0 * sine, 2.0 * cosine);
        assert!((tip + axis * 2.0 - (point + normal * 2.0)).length() < 1e-12);
        assert_eq!(ContactFrame::new(DVec3::Z, DVec3::Z, 1.0).unwrap().across, DVec3::ZERO);
        assert!(ContactFrame::new(DVec3::Z, DVec3::NEG_Z, 0.5).is_none());
    }
}
