//! Counts the obstacle's voxels in the tool at any pose, on the grid or off it.

use std::ops::Range;

use glam::DVec3;

use super::extent::bounds;
use super::tool_voxels::{contains, turn};
use super::{ElementKind, Segment, Tool, ToolShape, ToolVoxels};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::voxelize::voxelize;

/// A world point in continuous voxel coordinates; numbers that are whole to a billionth become whole, so that ties are
/// decided as on the grid.
pub(crate) fn snapped(grid: &Grid, position: DVec3) -> DVec3 {
    grid.continuous(position).map(|v| if (v - v.round()).abs() < 1e-9 { v.round() } else { v })
}

impl Tool {
    /// Solid voxels whose centres lie inside the tool with its tip at the world point `position`: the definition of
    /// the exact field off the grid. Lengths are in the grid's unit.
    ///
    /// At a voxel centre (to a billionth of the pitch) the same centres count as in [`super::ToolVoxels`].
    #[must_use]
    pub fn count_inside(&self, obstacle: &Occupancy, position: DVec3, orientation: &Orientation) -> u32 {
        let tip = snapped(&obstacle.grid, position);
        let bounds = bounds(self, orientation, obstacle.grid.pitch);
        match &self.shape {
            ToolShape::Revolved(_) => {
                let profile: Vec<Segment> = self.segments().copied().collect();
                let (direction, pitch) = (orientation.direction(), obstacle.grid.pitch);
                let inside = |offset| contains(&profile, direction, offset, pitch);
                count_one_by_one(obstacle, tip, ranges(&obstacle.grid, tip, bounds), inside)
            }
            ToolShape::Mesh(mesh) => {
                let turned = turn(mesh, orientation, obstacle.grid.pitch);
                count_in_mesh(&turned, obstacle, tip, bounds)
            }
        }
    }

    /// The element that holds a point of the world with the tool at a pose; `None` outside, at an invalid pose, and of a mesh.
    #[must_use]
    pub fn element_at(&self, pose: &Pose, point: DVec3) -> Option<ElementKind> {
        let (axis, offset) = (pose.axis()?, point - pose.position);
        let mut elements = self.elements().iter();
        elements.find(|element| contains(&element.profile, axis, offset, 0.0)).map(|element| element.kind)
    }
}

/// The obstacle's voxels along each axis that lie between two offsets from the tip.
fn ranges(grid: &Grid, tip: DVec3, (lower, upper): (DVec3, DVec3)) -> [Range<usize>; 3] {
    [0, 1, 2].map(|axis| {
        let clamp = |v: f64| v.clamp(0.0, grid.dims[axis] as f64) as usize;
        clamp((tip[axis] + lower[axis]).floor())..clamp((tip[axis] + upper[axis]).ceil() + 1.0)
    })
}

/// Voxel by voxel: solid ones whose offsets from the tip, in world units, are inside.
fn count_one_by_one(
    obstacle: &Occupancy,
    tip: DVec3,
    [xs, ys, zs]: [Range<usize>; 3],
    inside: impl Fn(DVec3) -> bool,
) -> u32 {
    let grid = &obstacle.grid;
    let mut count = 0;
    for (x, y) in xs.flat_map(|x| ys.clone().map(move |y| (x, y))) {
        for z in zs.clone().filter(|&z| obstacle.solid[grid.index([x, y, z])] != 0) {
            count += u32::from(inside((DVec3::new(x as f64, y as f64, z as f64) - tip) * grid.pitch));
        }
    }
    count
}

/// In a mesh that is turned already: its own voxels where the obstacle's centres are. With the tip on a voxel centre these are
/// the rotated tool's, by the same arithmetic, so that ties on its surface are decided as there.
fn count_in_mesh(turned: &Mesh, obstacle: &Occupancy, tip: DVec3, bounds: (DVec3, DVec3)) -> u32 {
    let voxels = mesh_voxels(turned, obstacle, tip, bounds);
    voxels.map_or(0, |voxels| voxels.count_in(obstacle, tip.floor().to_array().map(|v| v as i64)))
}

/// The first and the last solid voxel along each axis within some ranges; `None` where all are empty. A tool that touches a body has
/// little of it in its box, and making the tool's voxels is what takes the time.
fn solid_box(obstacle: &Occupancy, [xs, ys, zs]: [&Range<usize>; 3]) -> Option<[DVec3; 2]> {
    let (mut first, mut last) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (x, y) in xs.clone().flat_map(|x| ys.clone().map(move |y| (x, y))) {
        let start = obstacle.grid.index([x, y, 0]);
        let line = obstacle.solid.get(start + zs.start..start + zs.end)?;
        let is_solid = |&voxel: &u8| voxel != 0;
        if let (Some(low), Some(high)) = (line.iter().position(is_solid), line.iter().rposition(is_solid)) {
            let at = |z: usize| DVec3::new(x as f64, y as f64, (zs.start + z) as f64);
            (first, last) = (first.min(at(low)), last.max(at(high)));
        }
    }
    first.is_finite().then_some([first, last])
}

/// A turned mesh's own voxels among an obstacle's solid ones, relative to the voxel below its tip; `None` where there are none of the
/// latter within its bounds. However large the mesh is, they are no more than the obstacle's.
pub(super) fn mesh_voxels(
    turned: &Mesh,
    obstacle: &Occupancy,
    tip: DVec3,
    (lower, upper): (DVec3, DVec3),
) -> Option<ToolVoxels> {
    let pitch = obstacle.grid.pitch;
    let [xs, ys, zs] = ranges(&obstacle.grid, tip, (lower, upper));
    let [first, last] = solid_box(obstacle, [&xs, &ys, &zs])?;
    let below = tip.floor();
    let (lower, upper) = (lower.max(first - below), upper.min(last - below));
    let dims = (upper - lower + 2.0).to_array().map(|span| span as usize);
    let own = Grid { origin: (lower - (tip - tip.floor()) - 0.5) * pitch, pitch, dims };
    let solid = voxelize(turned, &own, false).solid;
    // The voxels' own count, which normalises, is not needed.
    Some(ToolVoxels { lower: lower.to_array().map(|v| v as i32), dims, solid, count: 0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxelize::winding_number;
    use glam::DMat4;

    use crate::field::solid::SolidField;
    use crate::section::test_shapes::orientations;

    /// A box whose faces lie on voxel centres when it is upright, with the tip on its lowest.
    fn tool() -> Tool {
        let mesh = Mesh::cuboid(DVec3::new(-2.0, -3.0, 0.0), DVec3::new(4.0, 1.0, 9.0));
        Tool { shape: ToolShape::Mesh(mesh), ..Tool::paper() }
    }

    fn obstacle() -> Occupancy {
        let grid = Grid { origin: DVec3::new(3.0, -7.0, 0.5), pitch: 1.0, dims: [11, 9, 13] };
        Occupancy::of(grid, |voxel| grid.index(voxel) * 7919 % 11 < 5)
    }

    #[test]
    fn at_voxel_centres_a_mesh_counts_as_the_rotated_tool_also_at_ties() {
        let (tool, obstacle) = (tool(), obstacle());
        let grid = obstacle.grid;
        let mut set = orientations("0,0;90,90;0,180;0,90;45,90");
        set.extend(orientations("so3:6"));
        let inside = [[5, 4, 6], [0, 0, 0], [10, 8, 12], [3, 7, 1]];
        let outside = [[-4, 2, 15], [40, 0, 0], [10, 8, 15], [5, 4, -50]];
        let tips: Vec<[i64; 3]> = inside.into_iter().chain(outside).collect();
        for orientation in &set {
            let rotated = ToolVoxels::new(&tool, orientation, grid.pitch).unwrap();
            for &at in &tips {
                let solid = rotated.offsets().filter(|offset| {
                    let voxel = [0, 1, 2].map(|a| at[a] + offset[a]);
                    let inside = (0..3).all(|a| (0..grid.dims[a] as i64).contains(&voxel[a]));
                    inside && obstacle.solid[grid.index(voxel.map(|v| v as usize))] == 1
                });
                let expected = solid.count() as u32;
                assert_eq!(rotated.count_in(&obstacle, at), expected, "{at:?} {orientation:?}");
                let tip = grid.origin + (DVec3::from_array(at.map(|v| v as f64)) + 0.5) * grid.pitch;
                let counted = tool.count_inside(&obstacle, tip, orientation);
                assert_eq!(counted, expected, "{at:?} {orientation:?}");
                let (pose, mut visited) = (Pose::oriented(tip, orientation), 0);
                tool.visit_inside_mesh(&obstacle, &pose, |_, _, _| visited += 1).unwrap();
                assert_eq!(visited, expected, "{at:?} {orientation:?}");
            }
        }
    }

    #[test]
    fn a_mesh_of_more_voxels_than_can_be_made_holds_what_lies_in_it() {
        let mesh = Mesh::cuboid(DVec3::new(-2000.0, -3000.0, 0.0), DVec3::splat(4000.0));
        let tool = Tool { shape: ToolShape::Mesh(mesh), ..Tool::paper() };
        let obstacle = obstacle();
        let field = SolidField::of_tool(std::sync::Arc::new(obstacle.clone()), &tool);
        let upright = orientations("0,0")[0];
        for height in [0.0, 3.5, 7.0, 12.25, 20.0] {
            let tip = obstacle.grid.origin + DVec3::new(2.5, 4.5, height);
            let above = |voxel: &usize| obstacle.grid.centre(obstacle.grid.voxel(*voxel)).z >= tip.z;
            let expected = obstacle.solids().filter(above).count() as u32;
            let (pose, mut visited) = (Pose::oriented(tip, &upright), 0);
            tool.visit_inside_mesh(&obstacle, &pose, |_, _, _| visited += 1).unwrap();
            assert_eq!([visited, tool.count_inside(&obstacle, tip, &upright)], [expected; 2], "{height}");
            assert_eq!(
                (field.count(&pose), field.collides(&pose)),
                (Some(expected), expected > 0),
                "{height}"
            );
        }
    }

    #[test]
    fn a_mesh_whose_faces_lie_on_voxel_centres_is_as_large_at_all_cube_rotations() {
        let tool = tool();
        for direction in ["0,0", "0,90", "90,90", "180,90", "270,90", "0,180"] {
            let [straight] = orientations(direction)[..] else { panic!() };
            for roll in [0.0, 90.0, 180.0, 270.0] {
                let rotated = ToolVoxels::new(&tool, &Orientation { roll, ..straight }, 1.0).unwrap();
                // Of each pair of faces one counts: the tip's among them.
                assert_eq!(rotated.count, 6 * 4 * 9, "{direction}, {roll}");
                assert!(rotated.offsets().any(|offset| offset == [0; 3]), "{direction}, {roll}");
            }
        }
    }

    #[test]
    fn off_the_grid_a_mesh_holds_what_its_winding_number_says() {
        let (tool, obstacle) = (tool(), obstacle());
        let (grid, ToolShape::Mesh(mesh)) = (obstacle.grid, &tool.shape) else { panic!("a mesh") };
        let field = SolidField::of_tool(std::sync::Arc::new(obstacle.clone()), &tool);
        for (index, orientation) in orientations("so3:200").iter().enumerate() {
            let part = |step: f64| (index as f64 * step).fract() * 2.4 - 0.7;
            let tip = grid.origin + DVec3::new(part(0.618), part(0.755), part(0.57)) * grid.size();
            let turned = mesh.transformed(&DMat4::from_mat3(orientation.rotation()));
            let inside = |voxel: usize| {
                let centre = grid.centre(grid.voxel(voxel));
                obstacle.solid[voxel] == 1 && winding_number(&turned, centre - tip).abs() > 0.5
            };
            let expected = (0..grid.len()).filter(|&voxel| inside(voxel)).count();
            assert_eq!(tool.count_inside(&obstacle, tip, orientation) as usize, expected, "{index}");
            assert_eq!(field.collides(&Pose::oriented(tip, orientation)), expected > 0, "{index}");
        }
    }
}
