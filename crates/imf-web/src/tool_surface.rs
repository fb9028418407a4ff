//! The tool's surface as triangles, for the picture.

use std::f64::consts::TAU;

use glam::DVec3;
use imf_core::tool::{Element, Segment, Tool, ToolShape};

/// Sides of a tool of revolution.
const SIDES: usize = 48;
/// Pieces of an arc.
const ARC: usize = 12;

/// Three corners of each triangle, in the tool's frame, and by triangle the rank of its element.
pub(crate) fn tool_surface(tool: &Tool) -> (Vec<f32>, Vec<u32>) {
    let (mut corners, mut ranks) = (Vec::new(), Vec::new());
    let mut triangle = |points: [DVec3; 3], rank: usize| {
        corners.extend(points.iter().flat_map(|point| point.as_vec3().to_array()));
        ranks.push(rank as u32);
    };
    match &tool.shape {
        ToolShape::Mesh(mesh) => {
            (0..mesh.triangles.len()).for_each(|index| triangle(mesh.corners(index), 0));
        }
        ToolShape::Revolved(elements) => {
            for element in elements {
                for [low, high] in outline(element) {
                    for side in 0..SIDES {
                        let [a, b] = [side, side + 1].map(|at| at as f64 / SIDES as f64 * TAU);
                        let place = |(radius, height): (f64, f64), angle: f64| {
                            DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
                        };
                        let rank = element.kind.rank();
                        triangle([place(low, a), place(low, b), place(high, b)], rank);
                        triangle([place(low, a), place(high, b), place(high, a)], rank);
                    }
                }
            }
        }
    }
    (corners, ranks)
}

/// Pieces of an element's outline, radius and height at both ends: from the axis up the side and back to it.
fn outline(element: &Element) -> Vec<[(f64, f64); 2]> {
    let mut points = Vec::new();
    for segment in &element.profile {
        let (from, to) = segment.range();
        let pieces = if matches!(segment, Segment::Arc { .. }) { ARC } else { 1 };
        points.extend((0..=pieces).map(|piece| {
            let height = from + (to - from) * piece as f64 / pieces as f64;
            (segment.radius(height), height)
        }));
    }
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else { return Vec::new() };
    points.insert(0, (0.0, first.1));
    points.push((0.0, last.1));
    points.windows(2).filter(|pair| pair[0] != pair[1]).map(|pair| [pair[0], pair[1]]).collect()
}
