//! How slender a tool is at its tip: a needle passes between voxels' centres until it is deep enough to be wide.

use super::{Element, ElementKind, Tool, ToolShape};

/// Steps towards the height at which a ball fits; each leaves less of the way by a factor.
const STEPS: usize = 4096;

/// Halvings in which a radius is found.
const HALVINGS: usize = 40;

/// A tip that holds a ball within this many of its diameters is not slender.
const DIAMETERS: f64 = 3.0;

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
            let (mut held, mut wide) = (0.0, most);
            for _ in 0..if holds(most) { 0 } else { HALVINGS } {
                let middle = 0.5 * (held + wide);
                *(if holds(middle) { &mut held } else { &mut wide }) = middle;
            }
            if holds(most) { most } else { held }
        };
        let in_tool = largest(0.5 * self.thinnest().1, &|radius| self.tip_depth(radius).is_some());
        let is_near = |radius: f64| self.is_thick_at_tip(2.0 * radius);
        let near = largest(in_tool, &is_near);
        (near < in_tool && is_near(1e-3 * in_tool)).then_some(2.0 * near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::{line, revolved};
    use crate::tool::Segment;

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
}
