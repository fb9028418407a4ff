//! Sharp points: where a tool cuts.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::profile::{self, Element, ElementKind, Segment};
use super::{Tool, ToolError, ToolShape, contains};
use crate::mesh::distance::distance_to_mesh;
use crate::voxelize::winding_number;

/// Maximum number of voxels of a cutter's box that are searched for sharp points.
const MOST_LOOKED_AT: f64 = (1_u64 << 26) as f64;

/// The points of a tool at which it cuts: the collision measure is the minimum over them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SharpPoints {
    /// The tip alone.
    #[default]
    Tip,
    /// The tip and rings of points over the cutter's surface, this many in all.
    Cutter(usize),
    /// Every voxel of the upright cutter that has a face neighbour outside the tool, at the grid's pitch and with the tip
    /// on a voxel centre. Where elements are given they are the tool meant: those of a tool that has since been offset or
    /// taken apart.
    Boundary(Option<Vec<Element>>),
    /// These points, in the tool frame.
    Points(Vec<DVec3>),
}

impl Tool {
    /// The sharp points in the tool frame, for voxels of `pitch` in the tool's unit. A mesh has no cutter of its own: the
    /// tip alone, unless its points are a list.
    #[must_use]
    pub fn sharp_point_positions(&self, pitch: f64) -> Vec<DVec3> {
        match (&self.sharp_points, &self.shape) {
            (SharpPoints::Points(points), _) => points.clone(),
            (SharpPoints::Boundary(Some(elements)), _) => boundary(elements, pitch),
            (SharpPoints::Boundary(None), ToolShape::Revolved(elements)) => boundary(elements, pitch),
            (SharpPoints::Cutter(count), ToolShape::Revolved(_)) => {
                let profile = self.cutter().map(|(cutter, _)| cutter.profile).unwrap_or_default();
                profile::surface_points(&profile, *count)
            }
            _ => vec![DVec3::ZERO],
        }
    }

    /// Checks that [`Tool::sharp_point_positions`] ends in reasonable time at `pitch`: with
    /// [`SharpPoints::Boundary`] it visits every voxel of the cutter's box.
    pub(crate) fn check_sharp_points(&self, pitch: f64) -> Result<(), ToolError> {
        let elements = match (&self.sharp_points, &self.shape) {
            (SharpPoints::Boundary(Some(elements)), _) => elements,
            (SharpPoints::Boundary(None), ToolShape::Revolved(elements)) => elements,
            _ => return Ok(()),
        };
        for element in elements {
            let across = 2.0 * element.max_radius();
            let along: f64 =
                element.profile.iter().map(Segment::range).map(|(from, to)| (to - from).abs()).sum();
            let sizes = [across, across, along].map(|size| (size / pitch).ceil());
            let voxels: f64 = sizes.iter().product();
            if voxels.is_nan() || voxels > MOST_LOOKED_AT {
                let dims = sizes.map(|size| size as u64);
                return Err(ToolError::TooLarge { name: self.name.clone(), dims, pitch });
            }
        }
        Ok(())
    }

    /// How far from the tool that of its sharp points is which is farthest from it, of its tip or of a list; 0 where all are in it.
    pub(crate) fn sharp_points_off(&self) -> f64 {
        let points: &[DVec3] = match &self.sharp_points {
            SharpPoints::Tip => &[DVec3::ZERO],
            SharpPoints::Points(points) => points,
            SharpPoints::Cutter(_) | SharpPoints::Boundary(_) => &[],
        };
        let off = |&point: &DVec3| match &self.shape {
            ToolShape::Revolved(elements) => {
                let seen = DVec2::new(point.z, point.truncate().length());
                let from = |element: &Element| {
                    let holds = element.profile.iter().any(|part| {
                        let (low, high) = part.range();
                        (low..=high).contains(&seen.x) && seen.y <= part.radius(seen.x)
                    });
                    if holds { 0.0 } else { seen.distance(element.foot(seen.x, seen.y, true)) }
                };
                elements.iter().map(from).fold(f64::INFINITY, f64::min)
            }
            ToolShape::Mesh(mesh) => {
                let holds = winding_number(mesh, point).abs() > 0.5;
                if holds { 0.0 } else { distance_to_mesh(mesh, point) }
            }
        };
        points.iter().map(off).fold(0.0, f64::max)
    }

    /// An upper bound of the distance from a point that some sharp point reaches to any point of the tool, at `pitch`.
    #[must_use]
    pub fn reach_from_sharp_points(&self, pitch: f64) -> f64 {
        let sharp = self.sharp_point_positions(pitch).iter().map(|k| k.length()).fold(0.0, f64::max);
        self.reach() + sharp
    }

    /// The sharp points as they stand, for a tool made of this one by offsetting it or taking it apart.
    pub(super) fn inherited_sharp_points(&self) -> SharpPoints {
        match (&self.sharp_points, &self.shape) {
            (SharpPoints::Boundary(None), ToolShape::Revolved(elements)) => {
                SharpPoints::Boundary(Some(elements.clone()))
            }
            // They depend on no pitch.
            (SharpPoints::Cutter(_), _) => SharpPoints::Points(self.sharp_point_positions(1.0)),
            (other, _) => other.clone(),
        }
    }
}

impl SharpPoints {
    /// The same points with every length multiplied.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Points(points) => Self::Points(points.iter().map(|&p| p * factor).collect()),
            Self::Boundary(Some(elements)) => {
                Self::Boundary(Some(elements.iter().map(|e| e.scaled(factor)).collect()))
            }
            other => other.clone(),
        }
    }
}

/// Centres of the cutter's voxels that have a face neighbour outside all elements, from the tip upwards; the tip's own
/// first. The tip alone where there is no cutter.
fn boundary(elements: &[Element], pitch: f64) -> Vec<DVec3> {
    let at = |voxel: [i64; 3]| DVec3::from_array(voxel.map(|i| i as f64)) * pitch;
    let in_tool = |voxel| elements.iter().any(|e| contains(&e.profile, DVec3::Z, at(voxel), pitch));
    let cutter: Vec<&Element> = elements.iter().filter(|e| e.kind == ElementKind::Cutter).collect();
    let mut points = vec![DVec3::ZERO];
    for element in cutter {
        let widest = element.max_radius();
        let reach = (widest / pitch).ceil() as i64;
        let from = element.profile.first().map_or(0.0, |s| s.range().0);
        let to = element.top();
        for z in (from / pitch).floor() as i64..=(to / pitch).ceil() as i64 {
            for (x, y) in (-reach..=reach).flat_map(|x| (-reach..=reach).map(move |y| (x, y))) {
                let voxel = [x, y, z];
                let mut neighbours = (0..6).map(|side: usize| {
                    let mut next = voxel;
                    next[side / 2] += if side.is_multiple_of(2) { -1 } else { 1 };
                    next
                });
                let inside = contains(&element.profile, DVec3::Z, at(voxel), pitch);
                if inside && voxel != [0; 3] && !neighbours.all(in_tool) {
                    points.push(at(voxel));
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::orientation::Orientation;
    use crate::section::test_shapes::cylinder;
    use crate::tool::{Clearance, ToolVoxels};
    use crate::unit::LengthUnit;

    #[test]
    fn rings_of_sharp_points_lie_on_the_cutter() {
        let tool = Tool { sharp_points: SharpPoints::Cutter(40), ..Tool::paper() };
        let points = tool.sharp_point_positions(1.0);
        assert_eq!(points.len(), 40);
        assert_eq!(points[0], DVec3::ZERO);
        for p in &points {
            let r = p.x.hypot(p.y);
            let expected = if p.z < 5.0 { (25.0 - (5.0 - p.z).powi(2)).sqrt() } else { 5.0 };
            assert!((r - expected).abs() < 1e-9 && p.z <= 35.0, "{p}");
        }
    }

    #[test]
    fn the_corner_of_a_flat_end_is_sharp() {
        for count in [9, 17, 40] {
            let cutter = Tool { sharp_points: SharpPoints::Cutter(count), ..cylinder(2.0, 6.0) };
            let points = cutter.sharp_point_positions(1.0);
            let at_corner = points.iter().filter(|p| p.z < 1e-9 && (p.x.hypot(p.y) - 2.0).abs() < 1e-9);
            assert!(at_corner.count() >= 4 && points.len() == count, "{points:?}");
            assert!(points.iter().all(|p| p.z < 5.9), "the flutes' upper end is not sharp: {points:?}");
        }
    }

    #[test]
    fn a_tool_that_is_not_where_its_tip_is_is_known() {
        let paper = Tool::paper();
        assert_eq!(paper.sharp_points_off(), 0.0);
        let at = |z: f64| Tool { sharp_points: SharpPoints::Points(vec![DVec3::Z * z]), ..Tool::paper() };
        assert_eq!([at(20.0), at(-50.0)].map(|tool| tool.sharp_points_off()), [0.0, 50.0]);
        let mesh = crate::mesh::Mesh::cuboid(DVec3::new(48.0, -2.0, 100.0), DVec3::new(52.0, 2.0, 109.0));
        let head = Tool { shape: ToolShape::Mesh(mesh), ..Tool::paper() };
        assert!((head.sharp_points_off() - 48.0_f64.hypot(100.0)).abs() < 1e-9);
    }

    #[test]
    fn boundary_points_are_the_voxels_of_the_cutter_that_touch_what_is_not_tool() {
        let tool = Tool { sharp_points: SharpPoints::Boundary(None), ..Tool::paper() };
        for pitch in [1.0, 1.7] {
            let voxels = ToolVoxels::new(&tool, &Orientation::default(), pitch).unwrap();
            let solid: HashSet<[i64; 3]> = voxels.offsets().collect();
            let open = |&[x, y, z]: &[i64; 3]| {
                let beside = |step| [[x + step, y, z], [x, y + step, z], [x, y, z + step]];
                [-1, 1].into_iter().flat_map(beside).any(|next| !solid.contains(&next))
            };
            // The holder begins at height 35.
            let cutter = |offset: &&[i64; 3]| (offset[2] as f64 * pitch) < 35.0;
            let mut expected: Vec<_> = solid.iter().filter(cutter).copied().filter(open).collect();
            let positions = tool.sharp_point_positions(pitch);
            let voxel = |p: &DVec3| (*p / pitch).to_array().map(|v| v.round() as i64);
            let mut found: Vec<[i64; 3]> = positions.iter().map(voxel).collect();
            assert_eq!(found[0], [0; 3]);
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
            assert!(found.len() > 200, "{}", found.len());
        }
    }

    #[test]
    fn an_offset_or_divided_tool_is_sharp_where_the_bare_one_is() {
        for sharp_points in [SharpPoints::Cutter(12), SharpPoints::Boundary(None)] {
            let tool = Tool { sharp_points, ..Tool::paper() };
            let bare = tool.sharp_point_positions(1.0);
            let clearance = Clearance { cutter: 0.5, shank: 0.0, holder: 3.0 };
            let offset = tool.with_clearance(&clearance).unwrap();
            assert_eq!(offset.sharp_point_positions(1.0), bare);
            assert_eq!(tool.without_cutter().unwrap().sharp_point_positions(1.0), bare);
            let inches = offset.in_unit(LengthUnit::Inch).sharp_point_positions(1.0 / 25.4);
            assert_eq!(inches.len(), bare.len());
            assert!(inches.iter().zip(&bare).all(|(a, b)| (*a * 25.4 - *b).length() < 1e-9));
        }
    }

    #[test]
    fn the_boundary_of_the_cutter_is_the_same_from_every_side() {
        let tool = Tool { sharp_points: SharpPoints::Boundary(None), ..Tool::paper() };
        assert!(tool.is_axisymmetric());
        let offset = tool.with_clearance(&Clearance { cutter: 0.0, shank: 0.0, holder: 1.0 }).unwrap();
        assert!(offset.is_axisymmetric());
    }
}
